//! Runs on several ranks, which agree with one process, and end together when one rank fails.

use super::handles::close;
use crate::common::models::{PAPER_FALL, literal};
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
    case("an_observer_that_fails_alone_ends_all", &[1, 3], fails_alone),
];

/// Time-dependent loads, oscillating obstacles and damping agree with the native engine step by
/// step, through an impact.
fn what_changes_with_time(arguments: &[String]) -> Result<()> {
    fn shake<E: Engine>(mut model: Model<E>, modal: bool) -> Result<Model<E>> {
        let System { engine, stiffness, mass, .. } = &model.system;
        if modal {
            let modes = modes::shapes(engine, stiffness, mass, 2, false)?;
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
            if let Some(relaxation) = scheme.relaxation() {
                // The state of this scheme is one at or after the instant; which one depends on
                // rounding.
                close(now.total() + relaxation.dissipated, start, 1e-11);
            } else {
                close(now.kinetic, other.kinetic, 1e-8);
                close(now.elastic, other.elastic, 1e-8);
                close(now.work, other.work, 1e-8);
            }
            contacts += u32::from(expected.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(contacts > 0);
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
