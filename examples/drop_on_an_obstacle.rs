//! A bent plate is let go and falls on an obstacle: the paper's experiment, to its first impact.
//!
//! The scene is that of figure 4: a steel plate, clamped at one edge, starts at rest from its
//! equilibrium under 14600 Pa, and its free edge meets a flat obstacle 0.1 m below. Between two
//! impacts the discrete plate is linear, so that its modes give the instant of the first one; an
//! independent program found 0.054734550 s.

use rebond::scene::Scene;
use rebond::simulation::{Model, Row};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig4.toml");

pub(crate) fn main() -> rebond::Result<()> {
    // Every key of a scene can be changed, as by `--set` of the command.
    let changes = ["mesh.element=fvs", "time.step=1e-5", "time.end=0.06", "output.every=500"];
    let scene = Scene::load(SCENE, &changes.map(String::from))?;
    let model = Model::new(&scene)?;

    println!("   time (s)   energy (J)   corner (m)   nodes in contact");
    let mut show = |row: &Row| {
        let Row { time, energy, contact_nodes, probes, .. } = row;
        println!("{time:11.4} {energy:12.4} {:12.5} {contact_nodes:18}", probes[0]);
        Ok(())
    };
    let (outcome, ended) = model.run(&scene, &mut show)?;
    ended?;

    let impact = outcome.first_impact.expect("the plate falls on the obstacle");
    println!("first impact at {:.9} s, at {:.4} m/s", impact.time, impact.velocity);
    assert!((impact.time - 0.054734550).abs() < scene.time.step);
    Ok(())
}
