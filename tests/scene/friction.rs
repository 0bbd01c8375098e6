//! Friction of obstacles in a scene: what it reads, and what excludes it.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::scenes::{STILL, grid, read, refusal, run_to_end};
use rebond::scene::Scene;
use rebond::simulation::Model;

fn with(rest: &str, time: &str) -> String {
    [UNIT, &grid("fvs", 4, 4), CLAMPED, rest, "\n", time].concat()
}

const BELT: &str = "obstacle = [{ name = \"belt\", side = \"below\", height = -0.1, friction = 0.3, \
                    velocity = [0.5, \"sin(t)\"] }]\n";

#[test]
fn friction_is_read_written_and_refused() {
    let scene = read(&with(BELT, STILL)).unwrap();
    assert_eq!(Scene::from_str(&scene.resolved(), "resolved", &[]).unwrap(), scene);
    assert!(scene.effects().contains(&"friction of obstacles".to_owned()));
    assert!(scene.dissipates() && scene.changes().is_some());
    for (more, expected) in [
        ("time.scheme = \"exact\"", "time.scheme = \"exact\" takes only what does not change with time"),
        ("time.restitution = 0.5", "time.restitution: makes the node of obstacle.0.friction rebound"),
        ("time.mass = \"modal\"", "time.mass: \"modal\" takes no obstacle.0.friction"),
        ("obstacle.0.friction = -0.1", "obstacle.0.friction: -0.1 is negative"),
        ("in_plane.stretching = true", "obstacle.0.friction: contradicts in_plane.stretching"),
    ] {
        let overrides = [more.replacen(" = ", "=", 1)];
        let error = Scene::from_str(&with(BELT, STILL), "s.toml", &overrides).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let error = refusal(&with(&BELT.replace("friction = 0.3, ", ""), STILL)).to_string();
    assert!(error.contains("obstacle.0.velocity: has no use without obstacle.0.friction"), "{error}");
    let other = BELT.replace("}]", "}, { side = \"below\", height = -0.2, where = \"x > 0.4\" }]");
    let error = refusal(&with(&other, STILL)).to_string();
    assert!(error.contains("obstacle.0.friction: needs a side of its nodes for itself"), "{error}");
    let probe = |at: &str, belt: &str| {
        let probe =
            format!("output.probes = [{{ name = \"m\", at = {at}, quantity = \"friction_moment_x\" }}]\n");
        refusal(&with(&[belt, &probe].concat(), STILL)).to_string()
    };
    let error = probe("[0.31, 0.2]", BELT);
    assert!(
        error.contains("faces a node at (0.31, 0.2); expected the place of a node, the nearest"),
        "{error}"
    );
    let error = probe("[0.31, 0.2]", "");
    assert!(error.contains("expected an obstacle with friction"), "{error}");
}

/// Thick friction on small cells is doubted before it fails.
#[test]
fn moments_that_act_over_a_cell_are_doubted() {
    let warnings = |friction: &str| {
        let scene = read(&with(&BELT.replace("0.3", friction), STILL)).unwrap();
        Model::new(&scene).unwrap().warnings
    };
    let is_doubted =
        |friction: &str| warnings(friction).iter().any(|said| said.contains("half the thickness"));
    assert!(!is_doubted("0.1") && is_doubted("1000"));
    let (_, outcome) = run_to_end(&with(BELT, STILL));
    assert_eq!(outcome.dissipated["belt"], 0.0);
}
