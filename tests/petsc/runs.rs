//! Runs on several ranks, which agree with one process, and end together when one rank fails.

use super::handles::close;
use crate::common::models::{CLAMPED, PAPER_FALL, PAPER_PLATE, UNIT, literal};
use crate::common::momentum::{Acting, Upward};
use crate::common::ranks::{Case, case};
use rebond::communicator::Communicator;
use rebond::linalg::Engine;
use rebond::modes;
use rebond::motion::Motion;
use rebond::obstacle::Bounds;
use rebond::petsc::Context;
use rebond::scene::Scene;
use rebond::scheme::{Damping, ModalDamping, System};
use rebond::simulation::{self, Model, Observer, Row, RunState, Snapshot};
use rebond::{Error, Result};

pub const CASES: &[Case] = &[
    case("what_changes_with_time", &[1, 2], what_changes_with_time),
    case("a_step_takes_three_collectives", &[2, 3], a_step_takes_three_collectives),
    case("forces_add_up_in_motion", &[1, 3], forces_add_up_in_motion),
    case("an_observer_that_fails_alone_ends_all", &[1, 3], fails_alone),
];

/// Time-dependent loads, oscillating obstacles and damping agree with the native engine step by
/// step, through an impact.
fn what_changes_with_time(arguments: &[String]) -> Result<()> {
    fn shake<E: Engine>(mut model: Model<E>, modal: bool) -> Result<Model<E>> {
        let System { engine, stiffness, mass, .. } = &model.system;
        if modal {
            let modes = modes::shapes(engine, [stiffness, mass], 2, false)?;
            model.system.drive.modal = Some(ModalDamping::new(engine, mass, &modes, &[0.05, 0.02])?);
        }
        let shape = model.system.load.clone().unwrap_or_default();
        model.system.damping = Damping { mass: 2.0, stiffness: 0.0 };
        model.system.drive.load = Some(Box::new(move |time: f64, load: &mut [f64]| {
            let factor = 3.0 * (75.0 * time).sin();
            load.iter_mut().zip(&shape).for_each(|(load, one)| *load += factor * one);
            Ok(())
        }));
        model.system.drive.bounds = Some(Box::new(|time: f64, bounds: &mut Bounds| {
            bounds.lower.fill(-0.1 + 0.02 * (60.0 * time).sin());
            Ok(())
        }));
        Ok(model)
    }
    let context = Context::start(arguments)?;
    for name in ["newmark", "midpoint", "conserving"] {
        let scene = |engine: &str| {
            let text = format!(
                r#"
                {PAPER_FALL}
                mesh = {{ element = "fvs", cells = [10, 4] }}
                load = {{ pressure = 1000 }}
                time = {{ scheme = "{name}", mass = "singular", step = 5e-4, end = 0.08 }}
                output = {{ probes = [{{ name = "corner", at = [1.2, 0] }}] }}
                solver = {{ engine = "{engine}" }}
                "#
            );
            Scene::from_str(&text, "shaken", &[])
        };
        let (native, petsc) = (scene("native")?, scene("petsc")?);
        let modal = name != "conserving";
        let alone = shake(Model::new(&native)?, modal)?;
        let parted = shake(Model::distributed(&petsc, &context)?, modal)?;
        let mut expected = alone.scheme(&native)?;
        let mut scheme = parted.scheme(&petsc)?;
        let start = scheme.energies()?.total();
        let mut contacts = 0;
        for _ in 0..native.time.steps() {
            expected.advance()?;
            scheme.advance()?;
            let corner = parted.probes[0].deflection(scheme.displacement());
            let other = alone.probes[0].deflection(expected.displacement());
            assert!(
                (context.comm().all_reduce_sum(corner) - other).abs() <= 1e-9,
                "{name}, step {}",
                scheme.step()
            );
            let (now, other) = (scheme.energies()?, expected.energies()?);
            close(now.kinetic, other.kinetic, 1e-8);
            close(now.elastic, other.elastic, 1e-8);
            close(now.work, other.work, 1e-8);
            if let Some(relaxation) = scheme.statistics().relaxation {
                close(now.total() + relaxation.dissipated, start, 1e-11);
            }
            contacts += u32::from(expected.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(contacts > 0);
    }
    Ok(())
}

/// A step whose row nobody reads takes one sum over the interface, one agreement on contact and one
/// on the residual; a product that replaces summed ones takes one more every eighth step.
fn a_step_takes_three_collectives(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    for (height, least) in [("-5", 0), ("-0.2085", 24)] {
        let text = format!(
            r#"
            {PAPER_PLATE}
            {CLAMPED}
            mesh = {{ element = "fvs", cells = [20, 8] }}
            obstacle = [{{ side = "below", height = {height} }}]
            initial = {{ static_pressure = -14600 }}
            load = {{ pressure = -1e5 }}
            time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = 0.01 }}
            solver = {{ engine = "petsc" }}
            "#
        );
        let scene = Scene::from_str(&text, "counted", &[])?;
        let model = Model::distributed(&scene, &context)?;
        let mut scheme = model.scheme(&scene)?;
        (0..16).try_for_each(|_| scheme.advance())?;
        let before = context.comm().collectives();
        let mut contacts = 0;
        for _ in 0..32 {
            scheme.advance()?;
            contacts += u32::from(scheme.reaction().iter().any(|r| *r != 0.0));
        }
        let count = context.comm().collectives() - before;
        let contacts = context.comm().all_reduce_sum(contacts);
        assert!(contacts >= least, "{contacts} steps in contact at {height} m");
        assert!(count <= 3 * 32 + 4, "{count} collectives in 32 steps at {height} m");
    }
    Ok(())
}

/// The forces of supports and obstacles, the load and the damping add up to the change of momentum
/// of the whole plate at every step, on rigid and compliant stops, on one by the law of Hertz, and
/// on moving supports.
fn forces_add_up_in_motion(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    // Scheme, mass, parameters, motion of the supports (m), drag (1/s) and damping of the stop.
    let motion = "0.01*sin(25*t)";
    let cases = [
        ("newmark", "singular", ", restitution = 0.5", motion, 2.0, 3e-3),
        ("newmark", "consistent", ", beta = 0.3", motion, 2.0, 3e-3),
        ("midpoint", "singular", "", motion, 2.0, 0.0),
        ("midpoint", "consistent", ", massless = \"reflected\"", motion, 2.0, 3e-3),
        ("conserving", "singular", "", motion, 2.0, 0.0),
        // The modal mass leaves the rest of the plate without the inertia of its supports.
        ("conserving", "modal", ", modes = 9", "", 2.0, 0.0),
    ];
    for (number, (scheme, mass, more, motion, drag, damping)) in cases.into_iter().enumerate() {
        let element = ["fvs", "hct"][number % 2];
        let motion = if motion.is_empty() { String::new() } else { format!(", motion = \"{motion}\"") };
        let text = format!(
            r#"
            {UNIT}
            mesh = {{ element = "{element}", cells = [4, 4] }}
            support = [
                {{ name = "clamp", edge = "left", kind = "clamped"{motion} }},
                {{ name = "roll", edge = "bottom", where = "x < 0.6", kind = "simply_supported"{motion} }},
            ]
            obstacle = [
                {{ name = "floor", side = "below", height = -0.02 }},
                {{ name = "post", side = "below", height = "-0.01 - 0.02*t", at = [1, 1] }},
                {{ name = "rubber", side = "above", height = 0.01, line = [[1, 0.2], [1, 0.9]], stiffness = 300, damping = {damping:?} }},
                {{ name = "nib", side = "above", height = 0, at = [0.5, 1], law = "hertz", stiffness = 1e4 }},
            ]
            load = {{ gravity = 0.25, pressure = "-0.5*cos(9*t)" }}
            rib = [{{ line = [[0, 0.2], [0.9, 0.2]], bending = 0.1, mass = 0.5 }}]
            damping = {{ mass = {drag:?} }}
            initial = {{ velocity = "-3*x*y" }}
            time = {{ scheme = "{scheme}", mass = "{mass}", step = 1.3e-3, end = 0.13{more} }}
            output = {{ every = 1 }}
            solver = {{ engine = "petsc", tolerance = 2e-11 }}
            "#
        );
        let scene = Scene::from_str(&text, "thrown", &[])?;
        let model = Model::distributed(&scene, &context)?;
        let (pressure, place) = (|t: f64| -0.5 * (9.0 * t).cos(), |t: f64| 0.01 * (25.0 * t).sin());
        let mass_of_all = 1.0 + 0.9 * 0.5;
        // Loads in time are apart from the constant weight.
        let weight = model.system.load.as_deref().expect("a weight");
        let acting = Acting { constant: -0.25 * mass_of_all, pressure: &pressure, place: &place, drag };
        let (upward, solver) = (Upward::new(&model, weight, 0.25, mass_of_all), model.solver(&scene));
        let started = model.scheme_with(&scene, &*solver)?;
        // All stops and the floor touch; no obstacle pulls.
        let (mut up, mut down) = (0, 0);
        for row in upward.check(&scene, started, &acting, &mut |_| {})? {
            let [floor, _, post, _, rubber, _, nib, _] = row[8..] else { panic!("{row:?}") };
            assert!(floor >= 0.0 && post >= 0.0 && rubber <= 0.0 && nib <= 0.0, "{row:?}");
            up += u32::from(floor > 0.0 && post > 0.0);
            down += u32::from(rubber < 0.0 && nib < 0.0);
        }
        assert!(up > 0 && down > 0, "{scheme}, {mass}: {up}, {down}");
    }
    Ok(())
}

/// Moving plate with snapshots and checkpoints.
const SCENE: &str = concat!(
    literal!(PAPER_PLATE),
    r#"
    mesh = { element = "fvs", cells = [4, 2] }
    support = [{ edge = "left", kind = "clamped" }]
    obstacle = [{ side = "below", height = -0.001 }]
    initial = { velocity = "-x" }
    time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 4e-3 }
    output = { every = 4, fields_every = 10, checkpoint_every = 10 }
    solver = { engine = "petsc" }
"#
);

/// Point at which an observer fails.
#[derive(Debug, Clone, Copy, PartialEq)]
enum At {
    Row(u64),
    Fields(u64),
    Pause(u64),
    End,
}

/// Observer whose disk is full from some point on, on one rank.
struct Full {
    at: Option<At>,
    rows: u64,
}

impl Full {
    fn fails(&self, now: At) -> Result<()> {
        match self.at {
            Some(at) if at == now => Err(Error::Io {
                path: "full".into(),
                source: std::io::Error::new(std::io::ErrorKind::StorageFull, "no space left"),
            }),
            _ => Ok(()),
        }
    }
}

impl Observer for Full {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.rows += 1;
        self.fails(At::Row(row.step))
    }

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        self.fails(At::Fields(snapshot.step))
    }

    fn pause(&mut self, pause: RunState) -> Result<()> {
        self.fails(At::Pause(pause.step))
    }

    fn keeps_end(&self) -> bool {
        true
    }

    fn end(&mut self, _: RunState, _: Motion) -> Result<()> {
        self.fails(At::End)
    }
}

/// The other ranks stop after the same step and know the cause and the exit code, so that no rank
/// waits for another.
fn fails_alone(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let scene = Scene::from_str(SCENE, "full", &[])?;
    let model = Model::distributed(&scene, &context)?;
    let last = context.size() - 1;
    // Checkpoints and ends belong to the first rank.
    for (at, rank, rows) in [
        (At::Row(0), 0, 1),
        (At::Row(12), last, 4),
        (At::Row(40), last, 11),
        (At::Fields(20), last, 6),
        (At::Pause(20), 0, 6),
        (At::End, 0, 10),
    ] {
        let mut observer = Full { at: (context.rank() == rank).then_some(at), rows: 0 };
        let (outcome, ended) = simulation::run(&scene, &model, &*model.solver(&scene), &mut observer)?;
        let error = ended.expect_err("a rank failed");
        assert_eq!(error.exit_code(), 4, "{at:?}: {error}");
        assert!(error.to_string().contains("no space left"), "{at:?}: {error}");
        // An observer that has failed receives no more data.
        assert!(context.rank() != rank || observer.rows == rows, "{at:?}: {} rows", observer.rows);
        assert_eq!(
            context.comm().all_reduce_sum(outcome.steps as usize),
            context.size() * outcome.steps as usize
        );
    }
    Ok(())
}
