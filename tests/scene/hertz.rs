//! Stops by the law of Hertz: their keys, and what is refused.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::scenes::{STILL, grid, model, read, refusal};
use rebond::contact_law::ContactLaw;
use rebond::contact_law::StopLaw;
use rebond::scene::{Compliance, Scene};
use rebond::simulation::Model;

fn with(rest: &str, time: &str) -> String {
    [UNIT, &grid("fvs", 4, 4), CLAMPED, rest, "\n", time].concat()
}

const BELOW: &str = "side = \"below\", height = -0.1, law = \"hertz\"";

#[test]
fn keys_are_read_and_written() {
    let ball = "ball = [{ at = [0.5, 0.5], mass = 1, height = 0.1, law = \"hertz\", stiffness = 3e4 }]";
    let text = with(&format!("obstacle = [{{ {BELOW}, at = [1, 1], stiffness = 2e3 }}]\n{ball}"), STILL);
    let scene = read(&text).unwrap();
    let of = |stiffness| Some(Compliance { law: StopLaw::Hertz, stiffness, damping: 0.0 });
    assert_eq!((scene.obstacles[0].compliance, scene.attachments.balls[0].compliance), (of(2e3), of(3e4)));
    assert!(scene.effects().contains(&"stops by the law of Hertz".to_owned()));
    let resolved = scene.resolved();
    assert_eq!(Scene::from_str(&resolved, "resolved", &[]).unwrap(), scene);
    assert_eq!(resolved.matches("# N/m^1.5").count(), 2, "{resolved}");
    let linear = with(
        "obstacle = [{ side = \"below\", height = -0.1, at = [1, 1], law = \"linear\", stiffness = 2 }]",
        STILL,
    );
    assert!(!read(&linear).unwrap().resolved().contains("law"));
    // A stop by this law adds no dof: the deflection of its node is bounded.
    let model = model(&text);
    let laws = &model.system.bounds.laws;
    let mut forces = [0, 1].map(|bound| laws.get(bound, 0).unwrap().force(1.0));
    forces.sort_by(f64::total_cmp);
    assert_eq!(forces, [2e3, 3e4]);
    assert!([0, 1].iter().all(|&bound| laws.get(bound, 1).is_none()));
    assert_eq!(model.start.displacement.len(), 3 * 20 + 1);
}

#[test]
fn other_stops_may_be_at_the_same_node() {
    let stop = |of: &str| format!("{{ at = [1, 1], {of} }}");
    let below = stop(&format!("{BELOW}, stiffness = 2"));
    let spring = stop("side = \"below\", height = -0.2, stiffness = 3");
    let above = stop("side = \"above\", height = 0.2");
    let together = with(&format!("obstacle = [{below}, {spring}, {above}]"), STILL);
    assert!(Model::new(&read(&together).unwrap()).is_ok());
    for (others, key, beside) in [
        (stop("side = \"below\", height = -0.2"), 0, 1),
        (stop(&format!("{BELOW}, stiffness = 5")), 1, 0),
        ("{ side = \"below\", height = -0.3 }".to_owned(), 0, 1),
    ] {
        let text = with(&format!("obstacle = [\n{below},\n{others},\n]"), STILL);
        let said = refusal(&text).to_string();
        // The message begins with the line of the law and names that of the other obstacle.
        let first = text[..text.find("obstacle = [").unwrap()].lines().count() + 2;
        let at = |obstacle: usize| format!("scene.toml:{}:", first + obstacle);
        assert!(said.contains(&at(key)) && said.contains(&at(beside)), "{said}");
        assert!(
            said.find(&at(key)) < said.find("obstacle.") && said.contains(&format!("obstacle.{beside} ("))
        );
        let expected = format!("obstacle.{key}.law: \"hertz\" needs a side of its node for itself");
        assert!(
            said.contains("is at (1, 1) too; expected another place or side, or law = \"linear\""),
            "{said}"
        );
        assert!(said.contains(&expected), "{said}\n{expected}");
    }
}

#[test]
fn what_does_not_fit_is_refused_by_name() {
    let stop = format!("obstacle = [{{ {BELOW}, at = [1, 1], stiffness = 2 }}]");
    for mass in ["mass = \"singular\"", "mass = \"modal\", modes = 5"] {
        let time = format!("time = {{ scheme = \"exact\", {mass}, step = 1, end = 1 }}\n");
        let said = refusal(&with(&stop, &time)).to_string();
        let expected = "obstacle.0.law: \"hertz\" contradicts time.scheme = \"exact\", which has closed forms for linear motions only";
        assert!(said.contains(expected), "{said}");
    }
    let cases = [
        (
            "at = [1, 1], stiffness = -1",
            "obstacle.0.stiffness: -1 is not positive; expected a stiffness in N/m^1.5 greater than 0",
        ),
        (
            "at = [1, 1], stiffness = inf",
            "obstacle.0.stiffness: inf is not a finite number; expected a stiffness in N/m^1.5",
        ),
        ("at = [1, 1]", "obstacle.0.stiffness: missing; expected a stiffness in N/m^1.5 greater than 0"),
        (
            "at = [1, 1], stiffness = 1, damping = 0",
            "obstacle.0.damping: has no meaning beside law = \"hertz\"",
        ),
        (
            "line = [[1, 0], [1, 1]], stiffness = 1",
            "obstacle.0.law: \"hertz\" is the law of a contact at a point",
        ),
        (
            "where = \"x > 0.5\", stiffness = 1",
            "obstacle.0.law: \"hertz\" is the law of a contact at a point",
        ),
    ];
    for (keys, expected) in cases {
        let said = refusal(&with(&format!("obstacle = [{{ {BELOW}, {keys} }}]"), STILL)).to_string();
        assert!(said.contains(expected), "{said}\n{expected}");
    }
    let rigid = "obstacle = [{ side = \"below\", height = -0.1, law = \"linear\" }]";
    let said = refusal(&with(rigid, STILL)).to_string();
    assert!(said.contains("obstacle.0.law: has no use without obstacle.0.stiffness"), "{said}");
}

#[test]
fn sliders_are_read_written_and_refused() {
    let slider =
        |of: &str| with(&format!("slider = [{{ name = \"pad\", at = [1, 1], force = 3{of} }}]"), STILL);
    let scene = read(&slider(", stiffness = 2e4")).unwrap();
    assert_eq!(Scene::from_str(&scene.resolved(), "resolved", &[]).unwrap(), scene);
    assert!(scene.effects().contains(&"dry friction".to_owned()));
    assert_eq!(scene.force_columns(), ["force_pad"]);
    for (more, expected) in [
        (
            "time.scheme = \"conserving\"",
            "time.scheme: \"conserving\" keeps the energy, which a [[slider]] dissipates",
        ),
        ("time.scheme = \"exact\"", "time.scheme: \"exact\" keeps the energy"),
        ("time.restitution = 0.5", "time.restitution: makes the node of a [[slider]] rebound"),
        ("time.mass = \"modal\"", "time.mass: \"modal\" takes no [[slider]]"),
        ("time.scheme = \"midpoint\"", "time.massless: \"equilibrium\" takes no [[slider]]"),
        ("slider.0.force = 0", "slider.0.force: 0 is not positive"),
        ("support.0.motion = \"0.01*sin(t)\"", "support.0.motion: contradicts [[slider]]"),
    ] {
        let overrides = [more.replacen(" = ", "=", 1)];
        let error = Scene::from_str(&slider(""), "s.toml", &overrides).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let floor = "obstacle = [{ side = \"below\", height = -1, at = [1, 1] }]\n";
    let error = refusal(&[floor, &slider("")].concat()).to_string();
    assert!(error.contains("slider.0.at: obstacle 1 faces its node"), "{error}");
}
