//! Free vibration of a clamped square plate, beside Leissa's frequency.
//!
//! The natural frequencies of a plate satisfy `$K x = \omega^2 M x$`. For a square of side a, all of
//! whose edges are clamped, the lowest is `$\omega = 35.992 \sqrt{D / \rho h} / a^2$` (A. W. Leissa,
//! The free vibration of rectangular plates, Journal of Sound and Vibration 31, 1973, 257-293).

use rebond::{modes, scene::Scene, simulation::Model};
use std::f64::consts::TAU;

const SCENE: &str = r#"
    mesh = { element = "fvs", cells = [16, 16] }
    support = [
      { edge = "left", kind = "clamped" },
      { edge = "right", kind = "clamped" },
      { edge = "bottom", kind = "clamped" },
      { edge = "top", kind = "clamped" },
    ]
    time = { scheme = "newmark", mass = "consistent", step = 1e-5, end = 1e-2 }

    [plate]
    length = 0.5           # m
    width = 0.5            # m
    thickness = 2e-3       # m
    youngs_modulus = 70e9  # Pa
    poissons_ratio = 0.3
    density = 2700.0       # kg/m3
"#;

pub(crate) fn main() -> rebond::Result<()> {
    let scene = Scene::from_str(SCENE, "square.toml", &[])?;
    let model = Model::new(&scene)?;
    let system = &model.system;
    let computed = modes::lowest(&system.engine, [&system.stiffness, &system.mass], 3, false)?;

    let plate = scene.plate.plate;
    let unit = (plate.rigidity() / plate.surface_density()).sqrt() / (TAU * scene.plate.length.powi(2));
    // The second frequency is double, since the square has two diagonals.
    let leissa = [35.992 * unit, 73.413 * unit, 73.413 * unit];

    println!("      computed      Leissa   error");
    for (f, exact) in computed.iter().zip(&leissa) {
        println!("{f:11.4} Hz {exact:8.4} Hz {:7.1e}", f / exact - 1.0);
    }
    assert!((computed[0] / leissa[0] - 1.0).abs() < 5e-3);
    Ok(())
}
