//! Residuals fed forward, where rounding spoils the step matrix a little, until digits are added:
//! no energy appears, and a restored scheme goes on to the bit.

use rebond::archive::Archive;
use rebond::linalg::{Engine, estimate_factor_error};
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters, Scheme, Solution};
use rebond::simulation::Model;

/// Largest rise of the invariant, as a share of the initial energy.
const MAX_RISE: f64 = 1e-9;

/// Returns the strip of the hard scene with cells of aspect ratio 100, of another width (m).
fn strip(element: &str, mass: &str, width: f64) -> (Model, NewmarkParameters) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/hard/flat-cells.toml");
    let changes =
        [format!("mesh.element={element}"), format!("time.mass={mass}"), format!("plate.width={width}")];
    let scene = Scene::load(path, &changes).unwrap();
    let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: scene.time.step };
    (Model::new(&scene).unwrap(), parameters)
}

#[test]
fn residuals_fed_forward_keep_the_promise_and_survive_an_archive() {
    for (element, mass) in [("fvs", "singular"), ("hct", "singular"), ("fvs", "consistent")] {
        let mut fed = 0;
        for width in [0.05, 0.06, 0.07, 0.08, 0.1] {
            let (model, parameters) = strip(element, mass, width);
            let matrix = Newmark::matrix(&model.system, parameters);
            let engine = &model.system.engine;
            let mut factor = engine.factor(&matrix, &[]).unwrap();
            let error = estimate_factor_error(engine, &matrix, factor.as_mut()).unwrap();
            if !(3e-11..=1e-10).contains(&error) {
                continue;
            }
            fed += 1;
            let new = || Newmark::new(&model.system, parameters, model.start.clone()).unwrap();
            let (mut whole, mut resumed) = (new(), new());
            let start = whole.invariant().unwrap();
            let (mut least, mut rise, mut contact_steps) = (start, 0.0_f64, 0);
            for step in 1..=500 {
                whole.advance().unwrap();
                assert!(whole.step_report().kkt <= 1e-10);
                contact_steps += u64::from(whole.reaction().iter().any(|r| *r != 0.0));
                let now = whole.invariant().unwrap();
                rise = rise.max((now - least) / start);
                least = least.min(now);
                if step == 103 {
                    let mut archive = Archive::Saves(Vec::new());
                    whole.archive(&mut archive).unwrap();
                    let entries = archive.into_entries().into_iter();
                    resumed.archive(&mut Archive::Restores { entries, same_processes: true }).unwrap();
                } else if step > 103 {
                    resumed.advance().unwrap();
                    assert_eq!(whole.displacement(), resumed.displacement(), "{element}, step {step}");
                    assert_eq!(whole.energies().unwrap(), resumed.energies().unwrap());
                }
            }
            println!(
                "{element}, {mass}, {width} m: error {error:.1e}, rise {rise:.1e}, {contact_steps} in contact"
            );
            assert!(rise <= MAX_RISE && contact_steps > 10, "{element}, {mass}, {width} m: {rise:e}");
        }
        assert!(fed > 0, "{element}, {mass}: no strip is spoilt a little");
    }
}
