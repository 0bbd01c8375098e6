//! The main loop of a run allocates nothing in steps without contact or in lasting contact, rows
//! included.

use crate::models::{PAPER_FALL, literal};
use crate::{MEMORY, alone};
use rebond::error::Result;
use rebond::scene::Scene;
use rebond::simulation::{Model, Observer, Row};

/// Number of steps at the start that may still allocate.
const WARM_UP: u64 = 8;

/// Number of some steps, and of those that allocated.
#[derive(Default)]
struct Steps {
    all: u64,
    allocating: u64,
}

/// Observer that compares the peak of the allocated memory since the last step with what was
/// allocated then.
#[derive(Default)]
struct Allocations {
    /// Allocated memory at the last step, in bytes.
    held: usize,
    /// Number of nodes in contact at the last step.
    touching: usize,
    /// Number of steps between two instants without contact, and of those that allocated.
    free: Steps,
    /// The same for steps between two instants with as many nodes in contact.
    lasting: Steps,
    rows: u64,
}

impl Observer for Allocations {
    fn row(&mut self, _: &Row) -> Result<()> {
        self.rows += 1;
        Ok(())
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        if step > WARM_UP && contact_nodes == self.touching {
            let steps = if contact_nodes == 0 { &mut self.free } else { &mut self.lasting };
            steps.all += 1;
            steps.allocating += u64::from(MEMORY.peak_usage() > self.held);
        }
        self.touching = contact_nodes;
        self.held = MEMORY.current_usage();
        MEMORY.reset_peak_usage();
    }
}

/// Returns what the steps of a scene allocated and the number of steps in contact: of three runs,
/// the one with the fewest steps that allocate. The program that runs the tests allocates, too,
/// where it reports on the test before.
fn allocations(text: &str) -> (Allocations, u64) {
    let runs = (0..3).map(|_| allocations_of_one(text));
    runs.min_by_key(|(of, _)| of.free.allocating + of.lasting.allocating).unwrap()
}

/// Runs the scene of a text on the native engine, and returns what its steps allocated and the
/// number of steps in contact.
fn allocations_of_one(text: &str) -> (Allocations, u64) {
    let scene = Scene::from_str(text, "steps", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut allocations = Allocations::default();
    let (outcome, ended) = model.run(&scene, &mut allocations).unwrap();
    ended.unwrap();
    (allocations, outcome.contact_steps)
}

#[test]
fn steps_without_contact_allocate_nothing() {
    let _alone = alone();
    let (Allocations { free, rows, .. }, contact_steps) = allocations(&format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        time = {{ scheme = "newmark", mass = "singular", step = 5e-5, end = 0.1 }}
        output = {{ every = 4 }}
        "#
    ));
    assert!(contact_steps > 10 && free.all > 1500 && rows > 500);
    // Nodes that come into reach, touch or leave make room for their records.
    assert!(free.allocating <= 16, "{} of {} free steps allocate", free.allocating, free.all);
}

/// The free edge is pressed onto the obstacle, where all of its nodes stay in contact.
#[test]
fn steps_in_lasting_contact_allocate_nothing() {
    let _alone = alone();
    let (Allocations { lasting, .. }, _) = allocations(&format!(
        r#"
        {}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        obstacle = [{{ side = "below", height = -1e-7, where = "x > 1.1999" }}]
        load = {{ pressure = -1e5 }}
        time = {{ scheme = "newmark", mass = "singular", step = 1e-4, end = 5e-3 }}
        output = {{ every = 4 }}
        "#,
        literal!(PAPER_PLATE)
    ));
    assert!(lasting.all > 30, "{} steps in lasting contact", lasting.all);
    assert!(lasting.allocating <= 2, "{} of {} steps allocate", lasting.allocating, lasting.all);
}
