//! Runs on several ranks, one of which fails.

use crate::common::models::literal;
use crate::common::ranks::{Case, case};
use rebond::communicator::Communicator;
use rebond::motion::Motion;
use rebond::petsc::Context;
use rebond::scene::Scene;
use rebond::simulation::{self, Model, Observer, Row, RunState, Snapshot};
use rebond::{Error, Result};

pub const CASES: &[Case] = &[case("an_observer_that_fails_alone_ends_all", &[1, 3], fails_alone)];

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
