//! Digits added to the factor, where corrections have cost more than they do.

use rebond::archive::Archive;
use rebond::linalg::{Engine, estimate_factor_error};
use rebond::scene::Scene;
use rebond::scheme::{Conserving, Newmark, NewmarkParameters, Scheme, Solution};
use rebond::simulation::Model;

/// Largest change of a conserved energy, as a share of it.
const MAX_DRIFT: f64 = 1e-10;

/// Returns the strip of the hard scene with cells of aspect ratio 100, of another width (m), and
/// its step (s).
fn strip(element: &str, width: f64) -> (Model, f64) {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/hard/flat-cells.toml");
    let changes = [format!("mesh.element={element}"), format!("plate.width={width}")];
    let scene = Scene::load(path, &changes).unwrap();
    (Model::new(&scene).unwrap(), scene.time.step)
}

/// Rounding the entries of A costs as many digits as its condition number has, but rounding those
/// of L only half as many.
#[test]
fn twice_the_digits_leave_half_of_the_loss() {
    for element in ["fvs", "hct"] {
        for width in [0.005, 0.01, 0.02, 0.05] {
            let (Model { system, .. }, step) = strip(element, width);
            let matrix = Newmark::matrix(&system, NewmarkParameters { beta: 0.5, restitution: 0.0, step });
            let engine = &system.engine;
            let mut factor = engine.factor(&matrix, &system.bounds.dofs).unwrap();
            let spoilt = estimate_factor_error(engine, &matrix, factor.as_mut()).unwrap();
            assert!(factor.cost_of_digits().is_some() && factor.add_digits(&matrix).unwrap());
            assert!(factor.cost_of_digits().is_none(), "there are no more than twice the digits");
            let error = estimate_factor_error(engine, &matrix, factor.as_mut()).unwrap();
            println!("{element}, {width} m: error {spoilt:.1e}, with twice the digits {error:.1e}");
            assert!(spoilt > 3e-11, "{element}, {width} m: rounding spoils little");
            assert!(error <= 4.0 * (f64::EPSILON * spoilt).sqrt(), "{element}, {width} m: {error:e}");
        }
    }
}

#[test]
fn digits_take_the_place_of_corrections_and_survive_an_archive() {
    for element in ["fvs", "hct"] {
        let (model, dt) = strip(element, 0.01);
        let new = || Conserving::new(&model.system, dt, model.start.clone()).unwrap();
        let mut whole = new();
        let mut resumed: Vec<Conserving<_>> = Vec::new();
        let start = whole.energies().unwrap().total();
        let (mut drift, mut contact_steps, mut digits) = (0.0_f64, 0, None);
        let before = whole.statistics().factorisations;
        for step in 1..=300 {
            whole.advance().unwrap();
            assert!(whole.step_report().kkt <= 1e-10);
            contact_steps += u32::from(whole.reaction().iter().any(|r| *r != 0.0));
            if contact_steps == 0 && whole.statistics().factorisations > before {
                digits.get_or_insert(step);
            }
            drift = drift.max((whole.energies().unwrap().total() / start - 1.0).abs());
            for resumed in &mut resumed {
                resumed.advance().unwrap();
                assert_eq!(whole.displacement(), resumed.displacement(), "{element}, step {step}");
            }
            // Before digits are added, after that, and after contact has changed the factor.
            if [2, 20, 203].contains(&step) {
                let mut archive = Archive::Saves(Vec::new());
                whole.archive(&mut archive).unwrap();
                let entries = archive.into_entries().into_iter();
                let mut copy = new();
                copy.archive(&mut Archive::Restores { entries, same_processes: true }).unwrap();
                resumed.push(copy);
            }
        }
        println!("{element}: digits in step {digits:?}, drift {drift:.1e}, {contact_steps} steps in contact");
        assert!(digits.is_some_and(|step| (3..20).contains(&step)), "{element}: {digits:?}");
        assert!(drift <= MAX_DRIFT && contact_steps > 10, "{element}: {drift:e}, {contact_steps}");
    }
}
