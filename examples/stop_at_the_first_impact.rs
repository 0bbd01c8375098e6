//! An observer that follows a run and stops it at the first impact.
//!
//! An observer receives rows, contacts, snapshots and events as a run makes them. Its method `step`
//! is called after every step, and `interrupts` asks whether to stop there; the run then ends with
//! [`Error::Interrupted`], and its state can be kept and resumed.

use rebond::scene::Scene;
use rebond::simulation::{Model, Observer, Row, RunState};
use rebond::{Error, Result};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig4.toml");

/// Observer of one run.
#[derive(Default)]
struct FirstImpact {
    lowest: f64,
    touches: bool,
    stopped: Option<RunState>,
}

impl Observer for FirstImpact {
    fn row(&mut self, row: &Row) -> Result<()> {
        self.lowest = self.lowest.min(row.probes[0]);
        Ok(())
    }

    fn step(&mut self, _: u64, contact_nodes: usize) {
        self.touches = contact_nodes > 0;
    }

    fn interrupts(&self) -> bool {
        self.touches
    }

    fn pause(&mut self, state: RunState) -> Result<()> {
        self.stopped = Some(state);
        Ok(())
    }
}

pub(crate) fn main() -> Result<()> {
    let changes = ["mesh.element=fvs", "time.step=1e-5", "time.end=0.5"].map(String::from);
    let scene = Scene::load(SCENE, &changes)?;
    let mut observer = FirstImpact::default();
    let (outcome, ended) = Model::new(&scene)?.run(&scene, &mut observer)?;

    assert!(matches!(ended, Err(Error::Interrupted { .. })));
    let time = observer.stopped.expect("the state of the interrupted run").time;
    println!("stopped at {time:.5} s after {} of {} steps", outcome.steps, scene.time.steps());
    println!("the corner reached {:.4} m", observer.lowest);
    // The modes of the discrete plate, computed by another program, touch at this instant.
    assert!((time - 0.054734550).abs() <= 2.0 * scene.time.step);
    Ok(())
}
