//! The main loop of a run allocates nothing in steps without contact, rows included.

use crate::models::PAPER_FALL;
use crate::{MEMORY, alone};
use rebond::error::Result;
use rebond::scene::Scene;
use rebond::simulation::{Model, Observer, Row};

/// Number of steps at the start that may still allocate.
const WARM_UP: u64 = 8;

/// Observer that compares the peak of the allocated memory since the last step with what was
/// allocated then.
#[derive(Default)]
struct Allocations {
    /// Allocated memory at the last step, in bytes.
    held: usize,
    /// Whether the last step had no contact.
    was_free: bool,
    /// Number of steps between two instants without contact, and of those that allocated.
    free: u64,
    allocating: u64,
    rows: u64,
}

impl Observer for Allocations {
    fn row(&mut self, _: &Row) -> Result<()> {
        self.rows += 1;
        Ok(())
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        let is_free = contact_nodes == 0;
        if step > WARM_UP && is_free && self.was_free {
            self.free += 1;
            self.allocating += u64::from(MEMORY.peak_usage() > self.held);
        }
        self.was_free = is_free;
        self.held = MEMORY.current_usage();
        MEMORY.reset_peak_usage();
    }
}

#[test]
fn steps_without_contact_allocate_nothing() {
    let _alone = alone();
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "fvs", cells = [10, 4] }}
        time = {{ scheme = "newmark", mass = "singular", step = 5e-5, end = 0.1 }}
        output = {{ every = 4 }}
        "#
    );
    let scene = Scene::from_str(&text, "steps", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut allocations = Allocations::default();
    let (outcome, ended) = model.run(&scene, &mut allocations).unwrap();
    ended.unwrap();
    let Allocations { free, allocating, rows, .. } = allocations;
    assert!(outcome.contact_steps > 10 && free > 1500 && rows > 500);
    // Nodes that come into reach, touch or leave make room for their records.
    assert!(allocating <= 16, "{allocating} of {free} free steps allocate");
}
