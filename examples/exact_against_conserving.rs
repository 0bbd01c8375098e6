//! Two ways through impacts: from event to event, and at fixed steps with exact energy.
//!
//! The exact scheme locates every touch and release of the paper's plate, without any error of the
//! step; it is the reference. The conserving scheme takes fixed steps and keeps the energy to
//! rounding through the impact at 0.055 s. Its motion converges with order 2: half the step, a
//! quarter of the error.

use rebond::scene::Scene;
use rebond::simulation::{Model, Row};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig4.toml");

/// Runs the plate to 0.06 s. Returns the deflection of the corner at the end, in m, and the largest
/// relative change of the energy.
fn run(scheme: &str, step: f64) -> rebond::Result<[f64; 2]> {
    let changes = [format!("time.scheme={scheme}"), format!("time.step={step:e}")];
    let others = ["time.end=0.06", "output.every=100"].map(String::from);
    let scene = Scene::load(SCENE, &[&changes[..], &others].concat())?;
    let mut corner = 0.0;
    let mut last = |row: &Row| {
        corner = row.probes[0];
        Ok(())
    };
    let (outcome, ended) = Model::new(&scene)?.run(&scene, &mut last)?;
    ended?;
    let energy = outcome.energy;
    Ok([corner, (energy.max - energy.min) / energy.start])
}

pub(crate) fn main() -> rebond::Result<()> {
    let [exact, drift] = run("exact", 1e-3)?;
    println!("exact              corner {exact:+.9} m, energy changes by {drift:.1e}");

    let mut errors = Vec::new();
    for step in [2e-5, 1e-5] {
        let [corner, drift] = run("conserving", step)?;
        let error = (corner - exact).abs();
        println!("conserving {step:.0e} s: error {error:.1e} m, energy changes by {drift:.1e}");
        errors.push(error);
    }
    let order = (errors[0] / errors[1]).log2();
    println!("order {order:.2}");
    assert!((1.5..3.0).contains(&order), "order {order}");
    Ok(())
}
