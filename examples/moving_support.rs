//! A moving support, and the principle of equivalence.
//!
//! The clamp of a strip starts from rest and accelerates upwards at 9.81 m/s2, by a formula of t.
//! Relative to the clamp, the strip moves as one under gravity beside a clamp at rest. No second
//! derivative of the formula is evaluated: Newmark's scheme takes second differences, which are
//! exact for a parabola, so that the two runs agree to rounding.

use rebond::scene::Scene;
use rebond::simulation::{Model, Row};

const STRIP: &str = r#"
    mesh = { element = "fvs", cells = [8, 2] }
    support = [{ edge = "left", kind = "clamped" }]
    time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.1 }
    output.every = 100
    output.probes = [{ name = "tip", at = [0.2, 0.015] }, { name = "clamp", at = [0, 0.015] }]

    [plate]
    length = 0.2            # m
    width = 0.03            # m
    thickness = 1e-3        # m
    youngs_modulus = 210e9  # Pa
    poissons_ratio = 0.3
    density = 7800.0        # kg/m3
"#;

/// Returns the times (s) and the deflections (m) of the tip relative to the clamp.
fn relative(change: &str) -> rebond::Result<Vec<[f64; 2]>> {
    let scene = Scene::from_str(STRIP, "strip.toml", &[change.into()])?;
    let mut rows = Vec::new();
    let mut record = |row: &Row| {
        rows.push([row.time, row.probes[0] - row.probes[1]]);
        Ok(())
    };
    let (_, ended) = Model::new(&scene)?.run(&scene, &mut record)?;
    ended.map(|()| rows)
}

pub(crate) fn main() -> rebond::Result<()> {
    let shaken = relative("support.0.motion=0.5*9.81*t^2")?;
    let heavy = relative("load.gravity=9.81")?;

    println!("time (s)   on the moving clamp (m)   under gravity (m)");
    let mut largest = 0.0_f64;
    for ([time, moved], [_, fell]) in shaken.iter().zip(&heavy) {
        println!("{time:8.3} {moved:25.12} {fell:19.12}");
        largest = largest.max((moved - fell).abs());
    }
    assert!(largest < 1e-12, "{largest:e} m apart");
    Ok(())
}
