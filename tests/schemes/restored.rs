//! A restored scheme shows the bits of the one that was saved, at every instant, and goes on with
//! them.

use crate::balance::{METHODS, time};
use crate::common::models::{CLAMPED, PAPER_PLATE};
use crate::common::scenes::{grid, scene};
use rebond::Result;
use rebond::archive::{Archive, Entry};
use rebond::scheme::{Scheme, StepBalance, StepRecord};
use rebond::simulation::Model;

/// Everything that a scheme shows at an instant, and the archive of its state.
#[derive(Debug, PartialEq)]
struct View {
    single: Vec<u64>,
    displacement: Vec<u64>,
    velocity: Vec<u64>,
    bounds: [Vec<u64>; 5],
    record: (u64, Vec<usize>, String),
    energies: String,
    balance: StepBalance,
    entries: Vec<Entry>,
}

impl View {
    fn new(scheme: &mut dyn Scheme) -> Result<View> {
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
        let mut archive = Archive::Saves(Vec::new());
        scheme.archive(&mut archive)?;
        // Single dofs come before the whole displacement, which schemes may keep.
        let dofs = scheme.balance()?.displacement.len();
        let single: Vec<f64> = (0..dofs).map(|dof| scheme.displacement_of(dof)).collect();
        let StepRecord { step, admissible, reaction, impulses, report, .. } = scheme.record();
        let limits = scheme.limits();
        Ok(View {
            single: bits(&single),
            bounds: [admissible, reaction, impulses, &limits.lower, &limits.upper].map(|of| bits(of)),
            record: (*step, scheme.record().candidates().collect(), format!("{report:?}")),
            energies: format!("{:?}", scheme.energies()?),
            displacement: bits(scheme.displacement()),
            velocity: bits(&scheme.velocity()?),
            balance: scheme.balance()?,
            entries: archive.into_entries(),
        })
    }
}

/// Runs a scene, and in every third step a scheme restored from it beside it. Returns the number of
/// steps in contact.
fn restores(text: &str) -> usize {
    let scene = scene(text);
    let model = Model::new(&scene).unwrap_or_else(|error| panic!("{error}\n{text}"));
    let mut scheme = model.scheme(&scene).unwrap();
    scheme.keep_balance().unwrap();
    let mut touched = 0;
    let mut resumed: Option<Box<dyn Scheme>> = None;
    for n in 0..scene.time.steps() {
        let view = View::new(&mut *scheme).unwrap();
        touched += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
        if let Some(mut resumed) = resumed.take() {
            resumed.advance().unwrap();
            assert!(View::new(&mut *resumed).unwrap() == view, "step {n}, a step later\n{text}");
        }
        if n % 3 == 1 {
            let mut restored = model.scheme(&scene).unwrap();
            restored.keep_balance().unwrap();
            let entries = view.entries.clone().into_iter();
            restored.archive(&mut Archive::Restores { entries, same_processes: true }).unwrap();
            assert!(View::new(&mut *restored).unwrap() == view, "step {n}\n{text}");
            resumed = Some(restored);
        }
        scheme.advance().unwrap();
    }
    touched
}

#[test]
fn a_restored_scheme_shows_what_the_saved_one_shows() {
    for method in METHODS {
        // Exact motions are linear between events, without a rigid ball beside the singular mass.
        let ball = "ball = [{ at = [1.0, 0.2], mass = 0.5, height = 0.01, velocity = -1 }]\n";
        let shaken = ("\"-0.004 + 0.001*sin(300*t)\"", ball);
        let still = ("-0.004", if method.0 == "exact" { "" } else { ball });
        for (height, ball) in [still, shaken].into_iter().take(if method.0 == "exact" { 1 } else { 2 }) {
            let text = format!(
                "{PAPER_PLATE}{CLAMPED}{}obstacle = [{{ side = \"below\", height = {height} }}]\n{ball}\
                 initial.velocity = -0.5\nload.gravity = 9.81\n{}solver.energy_guard = 1e9\n",
                grid("fvs", 4, 2),
                time(method, 7e-4, 60),
            );
            let touched = restores(&text);
            println!("{method:?}, {height}: {touched} steps in contact");
            assert!((2..57).contains(&touched), "{touched} steps in contact\n{text}");
        }
    }
}

#[test]
fn friction_goes_on_with_the_bits() {
    for method in [
        ("newmark", "singular", ""),
        ("midpoint", "consistent", ", massless = \"reflected\""),
        ("midpoint", "singular", ""),
        ("conserving", "singular", ""),
    ] {
        let belt = "friction = 0.4, velocity = [\"0.3*cos(40*t)\", 0.1]";
        let text = format!(
            "{PAPER_PLATE}{CLAMPED}{}obstacle = [{{ side = \"below\", height = -0.004, {belt} }}]\n\
             initial.velocity = -0.5\nload.gravity = 9.81\n{}solver.energy_guard = 1e9\n",
            grid("fvs", 4, 2),
            time(method, 7e-4, 60),
        );
        let touched = restores(&text);
        assert!((2..57).contains(&touched), "{touched} steps in contact\n{text}");
    }
}
