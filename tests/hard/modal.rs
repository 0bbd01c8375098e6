//! Random plates whose lowest modes carry all inertia, with properties that must hold for each.

use crate::properties::{Drawn, REFUSALS, check, drawn, maybe};
use proptest::prelude::*;
use rebond::linalg::Engine;
use rebond::scene::{ContactSolver, EngineName, Mass, Scene, SchemeSpec};
use rebond::simulation::{DeflectionDof, Model};
use rebond::study::accuracy::plan::Method;
use rebond::study::stability::{Ending, run_native};
use std::cell::Cell;
use std::fmt;

/// Random plate with the modal mass and attachments.
#[derive(Clone)]
struct Modal {
    plate: Drawn,
    /// Number of modes, as a share of the number of nodes.
    share: f64,
    /// Young's modulus across the grain over that along it, and the angle of the grain in degrees.
    across: Option<[f64; 2]>,
    /// Stiffness of a spring and mass of a body at a place in units of the length and the width,
    /// relative to those of the plate; 0 for none.
    spring: f64,
    body: f64,
    place: [f64; 2],
}

impl Modal {
    fn scene(&self, scheme: SchemeSpec) -> Scene {
        let Drawn { plate: [length, ratio, thickness, modulus, _, density], cells, .. } = self.plate;
        let (width, thickness) = (length * ratio, length * thickness);
        let place = format!("[{:e}, {:e}]", self.place[0] * length, self.place[1] * width);
        let modes = 1.0 + self.share * ((cells[0] + 1) * (cells[1] + 1)) as f64;
        let mut keys = vec![
            format!("time.scheme={}", scheme.name()),
            "time.mass=modal".to_owned(),
            format!("time.modes={}", modes as usize),
        ];
        if let Some([across, grain]) = self.across {
            keys.push(format!("plate.youngs_modulus_across={:e}", across * modulus));
            keys.push(format!("plate.shear_modulus={:e}", 0.3 * modulus));
            keys.push(format!("plate.grain={grain:e}"));
        }
        if self.spring > 0.0 {
            let stiffness = self.spring * modulus * thickness.powi(3) / (length * length);
            keys.push(format!("spring=[{{ at = {place}, stiffness = {stiffness:e} }}]"));
        }
        if self.body > 0.0 {
            let mass = self.body * density * thickness * length * width;
            keys.push(format!("mass=[{{ at = {place}, mass = {mass:e} }}]"));
        }
        self.plate.scene(&keys)
    }
}

impl fmt::Debug for Modal {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Modal { plate, share, across, spring, body, place } = self;
        write!(f, "{plate:?}\nshare {share}, across {across:?}, spring {spring}, body {body} at {place:?}")
    }
}

fn modal() -> impl Strategy<Value = Modal> {
    let across = prop::option::weighted(0.4, [0.3..1.0, 0.0..90.0]);
    (drawn(), 0.1..1.0, across, maybe(0.1..10.0), maybe(0.1..2.0), [0.0..1.0, 0.0..1.0]).prop_map(
        |(mut plate, share, across, spring, body, place)| {
            // Times of slow steps would hold thousands of contacts.
            plate.step = plate.step.min(-1.5);
            Modal { plate, share, across, spring, body, place }
        },
    )
}

const SCHEMES: [SchemeSpec; 2] = [SchemeSpec::Exact, SchemeSpec::Conserving];

#[test]
fn energy_and_bounds_hold_on_random_plates() {
    let (ran, touched) = (Cell::new(0), Cell::new(0));
    check(120, 5, modal(), |modal| {
        for scheme in SCHEMES {
            let (engine, vi) = (EngineName::Native, ContactSolver::Condensed);
            let trial = run_native(
                &modal.scene(scheme),
                Method { scheme, mass: Mass::Modal, modes: None, engine, vi },
            );
            match &trial.ending {
                Ending::Holds => ran.set(ran.get() + 1),
                Ending::Refused(why) => {
                    let known = REFUSALS.iter().chain(&["time.modes"]).any(|known| why.contains(known));
                    prop_assert!(known, "{scheme:?}: {why}");
                }
                other => prop_assert!(false, "{scheme:?}: {other:?}: {trial:?}"),
            }
            if let Some(figures) = trial.figures {
                touched.set(touched.get() + u32::from(figures.contact_steps > 0));
                let holds = figures.worst_kkt <= 1e-10 && figures.penetration <= 1e-12;
                prop_assert!(holds, "{scheme:?}: {trial:?}");
            }
        }
        Ok(())
    });
    println!("{} runs, {} with contact", ran.get(), touched.get());
    assert!(ran.get() >= 150 && touched.get() >= 50, "{} runs, {} with contact", ran.get(), touched.get());
}

/// Asserts that the momentum of a free plate changes by the loads and by the impulses of contact.
fn momentum_balances(mut modal: Modal, runs: &Cell<u32>) -> Result<(), TestCaseError> {
    modal.plate.supports = [None; 4];
    modal.plate.pressure = 0.0;
    modal.spring = 0.0;
    for scheme in SCHEMES {
        let scene = modal.scene(scheme);
        let Ok(model) = Model::new(&scene) else { continue };
        let Ok(mut scheme) = model.scheme(&scene) else { continue };
        let system = &model.system;
        let mut upward = vec![0.0; system.engine.dofs()];
        model.sites.iter().for_each(|DeflectionDof { dof, .. }| upward[*dof] = 1.0);
        let along = |of: &[f64]| -> f64 { of.iter().zip(&upward).map(|(p, e)| p * e).sum() };
        let force = system.load.as_deref().map_or(0.0, along);
        let mut product = vec![0.0; upward.len()];
        let mut impulse = 0.0;
        let mut start = None;
        for _ in 0..40 {
            let rate = scheme.velocity().unwrap();
            system.engine.multiply(&system.mass, &rate, &mut product).unwrap();
            let size = product.iter().zip(&upward).map(|(p, e)| (p * e).abs()).sum::<f64>();
            let momentum = along(&product);
            let expected = *start.get_or_insert(momentum) + impulse + force * scheme.time();
            let scale = size + impulse.abs() + (force * scheme.time()).abs();
            let off = (momentum - expected).abs();
            prop_assert!(off <= 1e-9 * scale, "{off:e} of {scale:e} at step {}", scheme.step());
            scheme.advance().unwrap();
            impulse += scheme.impulses().iter().sum::<f64>();
        }
        runs.set(runs.get() + u32::from(impulse != 0.0));
    }
    Ok(())
}

#[test]
fn momentum_balances_on_random_free_plates() {
    let runs = Cell::new(0);
    check(60, 6, modal(), |modal| momentum_balances(modal, &runs));
    println!("{} runs with impacts", runs.get());
    assert!(runs.get() >= 15, "{} runs with impacts", runs.get());
}
