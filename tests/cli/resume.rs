//! A run that stops and is resumed gives the results of the uninterrupted run, to the last bit.

use crate::common::models::literal;
use rebond::Result;
use rebond::motion::Motion;
use rebond::output::checkpoint::{Checkpoint, Identity, Outputs};
use rebond::scene::Scene;
use rebond::simulation::{
    self, Contact, Envelope, Model, NodeEvent, NodeReaction, Observer, Outcome, Row, RunState, Seconds,
    Snapshot,
};
use std::path::PathBuf;

/// Plate that falls on an obstacle close below it: there is contact from the start on, chatter and
/// rest.
const FALL: &str = concat!(
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [4, 2] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.02 }, { side = "above", height = 0.05 }]
initial = { static_pressure = 3000, velocity = -0.5 }
load = { pressure = -500 }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.06 }
output = { every = 7, fields_every = 50, checkpoint_every = 37, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

/// Record of everything that a run reports, with the number of the step.
#[derive(Default)]
struct Diary {
    step: u64,
    entries: Vec<(u64, String)>,
    pauses: Vec<RunState>,
    /// State at the last step, and the number of entries before it.
    end: Option<(RunState, usize)>,
}

impl Diary {
    fn note(&mut self, step: u64, what: String) -> Result<()> {
        self.entries.push((step, what));
        Ok(())
    }
}

impl Observer for Diary {
    // Numbers are printed with enough digits to distinguish all floating-point values.
    fn row(&mut self, row: &Row) -> Result<()> {
        self.note(row.step, format!("{row:?}"))
    }

    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        self.note(self.step, format!("{ended:?}"))
    }

    fn reactions(&mut self, step: u64, time: f64, rows: &[NodeReaction]) -> Result<()> {
        self.note(step, format!("{time:?} {rows:?}"))
    }

    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        let Snapshot { step, deflection, velocity, mean_velocity, reaction, stresses, .. } = snapshot;
        self.note(*step, format!("{deflection:?} {velocity:?} {mean_velocity:?} {reaction:?} {stresses:?}"))
    }

    fn envelope(&mut self, envelope: &Envelope) -> Result<()> {
        self.note(self.step, format!("{envelope:?}"))
    }

    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        self.note(self.step, format!("{event:?}"))
    }

    fn pause(&mut self, pause: RunState) -> Result<()> {
        self.pauses.push(pause);
        Ok(())
    }

    fn keeps_end(&self) -> bool {
        true
    }

    fn end(&mut self, pause: RunState, _: Motion) -> Result<()> {
        self.end = Some((pause, self.entries.len()));
        Ok(())
    }

    fn step(&mut self, step: u64, _: usize) {
        self.step = step + 1;
    }
}

fn scene(overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|of| (*of).into()).collect();
    Scene::from_str(FALL, "fall.toml", &overrides).unwrap()
}

/// Returns the outcome of a run without its times.
fn timeless(outcome: Outcome) -> Outcome {
    Outcome { seconds: Seconds::default(), ..outcome }
}

/// Returns a run state that was written to bytes and read back.
fn through_bytes(pause: &RunState) -> RunState {
    let checkpoint = Checkpoint {
        scene: String::new(),
        scene_file: PathBuf::new(),
        identity: Identity::of(&scene(&[])).unwrap(),
        petsc: Vec::new(),
        pause: pause.clone(),
        outputs: Outputs::default(),
    };
    let read = Checkpoint::from_bytes(&checkpoint.to_bytes().unwrap()).unwrap();
    assert!(read == checkpoint);
    read.pause
}

/// Runs a scene, and resumes it from each of its checkpoints with a new model.
fn goes_on(overrides: &[&str]) {
    let scene = scene(&[&["solver.energy_guard=1e9"], overrides].concat());
    let model = Model::new(&scene).unwrap();
    let mut whole = Diary::default();
    let (outcome, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut whole).unwrap();
    ended.unwrap();
    assert!(outcome.contact_steps > 2 && outcome.steps == scene.time.steps(), "{outcome:?}");
    assert_eq!(whole.pauses.len() as u64, (scene.time.steps() - 1) / scene.output.checkpoint_every.unwrap());
    for pause in &whole.pauses {
        let model = Model::new(&scene).unwrap();
        let mut rest = Diary { step: pause.step + 1, ..Diary::default() };
        let (resumed, ended) =
            simulation::resume(&scene, &model, &simulation::condensed, Some(through_bytes(pause)), &mut rest)
                .unwrap();
        ended.unwrap();
        let expected: Vec<_> = whole.entries.iter().filter(|(step, _)| *step > pause.step).collect();
        assert!(
            expected.iter().eq(&rest.entries.iter().collect::<Vec<_>>()),
            "{overrides:?} from {}",
            pause.step
        );
        assert_eq!(timeless(resumed), timeless(outcome.clone()), "{overrides:?} from {}", pause.step);
    }
}

/// Runs a scene to an end, and from there to a later one. The result equals that of a single run.
fn goes_on_to_a_later_end(overrides: &[&str]) {
    let all = |end: &str| scene(&[&["solver.energy_guard=1e9"], overrides, &[end]].concat());
    let run = |scene: &Scene| {
        let (model, mut diary) = (Model::new(scene).unwrap(), Diary::default());
        let (outcome, ended) = simulation::run(scene, &model, &simulation::condensed, &mut diary).unwrap();
        ended.unwrap();
        (outcome, diary)
    };
    // At the first of these ends no row is due and contact may continue, and intervals that are
    // joined in the longer run are not joined in the shorter one.
    for (first, later) in [("time.end=0.006", "time.end=0.06"), ("time.end=0.05", "time.end=0.06")] {
        let (_, short) = run(&all(first));
        let scene = all(later);
        let (expected, whole) = run(&scene);
        let (pause, before) = short.end.unwrap();
        assert!(whole.entries[..before] == short.entries[..before], "{overrides:?}");
        let mut rest = Diary { step: pause.step, ..Diary::default() };
        let model = Model::new(&scene).unwrap();
        let pause = Some(through_bytes(&pause));
        let (outcome, ended) =
            simulation::resume(&scene, &model, &simulation::condensed, pause, &mut rest).unwrap();
        ended.unwrap();
        assert!(whole.entries[before..] == rest.entries[..], "{overrides:?}: after {first}");
        assert_eq!(timeless(outcome), timeless(expected), "{overrides:?}: after {first}");
    }
}

#[test]
fn a_run_that_is_done_goes_on_to_a_later_end() {
    for scheme in ["newmark", "midpoint", "conserving", "exact"] {
        goes_on_to_a_later_end(&[&format!("time.scheme={scheme}")]);
    }
    goes_on_to_a_later_end(&[
        "load.pressure='-500 + 800 * sin(90 * t)'",
        "obstacle.0.height='-0.02 + 0.004 * sin(70 * t + 3 * x)'",
        "support.0.motion='0.003 * sin(50 * t)'",
        "ball=[{ at = [0.9, 0.2], mass = 0.5, height = 0.032, velocity = -1 }]",
    ]);
}

#[test]
fn newmark_goes_on_with_either_mass_and_any_restitution() {
    for mass in ["singular", "consistent"] {
        for restitution in ["0", "0.5", "1"] {
            goes_on(&[&format!("time.mass={mass}"), &format!("time.restitution={restitution}")]);
        }
    }
}

#[test]
fn midpoint_goes_on_with_either_mass_and_massless_part() {
    let midpoint = "time.scheme=midpoint";
    goes_on(&[midpoint]);
    goes_on(&[midpoint, "time.massless=reflected"]);
    goes_on(&[midpoint, "time.mass=consistent"]);
}

#[test]
fn conserving_goes_on() {
    goes_on(&["time.scheme=conserving"]);
    goes_on(&["time.scheme=conserving", "time.step=1e-3", "time.end=0.2", "mesh.element=hct"]);
}

#[test]
fn exact_goes_on() {
    goes_on(&["time.scheme=exact"]);
    goes_on(&["time.scheme=exact", "damping.mass=2"]);
    goes_on(&["time.scheme=exact", "time.step=1e-3", "time.end=0.1", "output.checkpoint_every=3"]);
    // Nodes come into reach between the checkpoints.
    let modal = ["time.scheme=exact", "time.mass=modal", "time.modes=8"];
    goes_on(&modal);
    goes_on(&[&modal[..], &["damping={ mass = 1, stiffness = 1e-6, modal = [0.02, 0.01] }"]].concat());
    goes_on(&[&modal[..], &["time.step=1e-3", "time.end=0.1", "output.checkpoint_every=3"]].concat());
    let split = ["time.scheme=conserving", "time.mass=modal", "time.modes=8"];
    goes_on(&split);
    goes_on(&[&split[..], &["time.step=1e-3", "time.end=0.1", "output.checkpoint_every=3"]].concat());
    for scheme in ["time.scheme=newmark", "time.scheme=midpoint"] {
        goes_on(&[scheme, "time.mass=modal", "time.modes=8"]);
    }
    // Enough nodes for several tiers of the certificates.
    goes_on(&[&split[..], &["mesh.cells=[16, 8]"]].concat());
}

/// Time-dependent data resume from the interruption: a load, an obstacle and supports that move, a
/// ball that rides, damping.
#[test]
fn what_changes_with_time_goes_on() {
    let changes = [
        "load.pressure='-500 + 800 * sin(90 * t)'",
        "obstacle.0.height='-0.02 + 0.004 * sin(70 * t + 3 * x)'",
        "support.0.motion='0.003 * sin(50 * t)'",
        "damping.mass=0.5",
    ];
    let ball = "ball=[{ at = [0.9, 0.2], mass = 0.5, height = 0.032, velocity = -1 }]";
    goes_on(&[&changes[..], &[ball]].concat());
    goes_on(
        &[&changes[..], &["time.restitution=0.5", "time.mass=consistent", "damping.stiffness=1e-5", ball]]
            .concat(),
    );
    goes_on(&[&changes[..], &["time.scheme=midpoint"]].concat());
    goes_on(
        &[&changes[..], &["time.scheme=midpoint", "time.massless=reflected", "damping.stiffness=1e-5"]]
            .concat(),
    );
    let modal = "damping={ modal = [0.02, 0.01] }";
    goes_on(&[&changes[..3], &[modal]].concat());
    goes_on(&[&changes[..3], &["time.scheme=midpoint", modal]].concat());
    goes_on(&[&changes[..], &["time.scheme=conserving", "time.step=5e-4", "time.end=0.2"]].concat());
    let split = ["time.scheme=conserving", "time.mass=modal", "time.modes=8", "mesh.cells=[12, 6]"];
    goes_on(&[&changes[..], &split].concat());
    for scheme in ["time.scheme=newmark", "time.scheme=midpoint"] {
        goes_on(&[&changes[..], &split[1..], &[scheme]].concat());
    }
}

/// Extremes of the stress, stresses in snapshots, and accelerations, which are differences of
/// velocities.
#[test]
fn stresses_and_accelerations_go_on() {
    let stresses =
        ["output.extremes=true", "output.stresses=true", "part=[{ where = 'x > 0.6', thickness = 0.008 }]"];
    let moment = "{ name = 'moment', at = [0.1, 0.2], quantity = 'von_mises_top' }";
    let quantities = format!(
        "output.probes=[{moment}, {{ name = 'a', at = [1.2, 0], quantity = 'acceleration' }}, {{ name = 'v', at = [0.7, 0], quantity = 'velocity' }}]"
    );
    let moment = format!("output.probes=[{moment}]");
    goes_on(&[&stresses[..], &["time.mass=consistent", &quantities]].concat());
    goes_on(&[&stresses[..], &["time.mass=consistent", "time.scheme=midpoint", &quantities]].concat());
    goes_on(&[&stresses[..], &["time.scheme=exact", &moment]].concat());
    let modal = [
        "time.scheme=conserving",
        "time.mass=modal",
        "time.modes=8",
        "support.0.motion='0.003 * sin(50 * t)'",
    ];
    goes_on(&[&stresses[..], &modal, &[&quantities]].concat());
    goes_on_to_a_later_end(&[&stresses[..], &["time.mass=consistent", &quantities]].concat());
}

/// Reactions of supports, forces and impacts of obstacles, and stops that yield, some with the
/// memory of a dashpot.
#[test]
fn forces_and_compliant_stops_go_on() {
    let named = ["support.0.name=clamp", "obstacle.0.name=floor", "obstacle.1.name=stop"];
    let yields = ["obstacle.1.stiffness=1e7", "obstacle.0.line=[[1.2, 0], [1.2, 0.4]]"];
    let moving = ["support.0.motion='0.003 * sin(50 * t)'", "load.pressure='-500*sin(90*t)'"];
    let damped = "obstacle.1.damping=2e3";
    goes_on(&[&named[..], &yields, &moving, &[damped, "time.restitution=0.5"]].concat());
    goes_on(&[&named[..], &yields, &[damped, "time.scheme=midpoint", "time.massless=reflected"]].concat());
    goes_on(&[&named[..], &yields, &moving, &["time.scheme=conserving"]].concat());
    goes_on(&[&named[..], &yields, &["time.scheme=exact"]].concat());
    let modal = ["time.scheme=conserving", "time.mass=modal", "time.modes=8"];
    goes_on(&[&named[..], &yields, &moving, &modal].concat());
    goes_on_to_a_later_end(&[&named[..], &yields, &moving, &modal].concat());
}

#[test]
fn stops_by_the_law_of_hertz_go_on() {
    let stops = [
        "obstacle=[{ name = 'pin', side = 'below', height = -0.02, at = [1.2, 0], law = 'hertz', stiffness = 1e8 }, \
         { side = 'below', height = '-0.02 + 0.005*sin(60*t)', at = [1.2, 0.4], law = 'hertz', stiffness = 1e5 }, \
         { side = 'above', height = 0.05, where = 'x > 1' }]",
        "ball=[{ at = [0.6, 0.2], mass = 0.3, height = 0.002, velocity = -3, law = 'hertz', stiffness = 1e9 }]",
    ];
    for restitution in ["0", "0.5"] {
        goes_on(&[&stops[..], &[&format!("time.restitution={restitution}")]].concat());
    }
    goes_on(&[&stops[..], &["time.scheme=midpoint"]].concat());
    goes_on(&[&stops[..], &["time.scheme=midpoint", "time.massless=reflected"]].concat());
    goes_on(&[&stops[..], &["time.scheme=conserving"]].concat());
    for scheme in ["newmark", "midpoint", "conserving"] {
        let scheme = format!("time.scheme={scheme}");
        goes_on(&[&stops[..], &[&scheme, "time.mass=modal", "time.modes=8"]].concat());
    }
}

#[test]
fn ribs_go_on() {
    let ribs = "rib=[{ line = [[0.1, 0.05], [1.15, 0.3]], bending = 2e3, torsion = 5e2, mass = 4 }, \
                { edge = 'top', bending = 1e3, mass = 2 }]";
    for scheme in ["newmark", "midpoint", "conserving"] {
        goes_on(&[ribs, &format!("time.scheme={scheme}")]);
    }
    goes_on(&[ribs, "time.scheme=exact"]);
    goes_on(&[ribs, "time.scheme=exact", "time.mass=modal", "time.modes=8"]);
}

/// More nodes touch at once than the dense problem of contact admits, so active dofs are held in
/// the factor.
#[test]
fn wide_contact_goes_on() {
    let flat = [
        "support=[]",
        "initial={ velocity = -3 }",
        "load.pressure=0",
        "mesh.cells=[26, 20]",
        "output.fields_every=9",
    ];
    let hit =
        ["time.end=2e-3", "output.checkpoint_every=1", "obstacle=[{ side = 'below', height = -0.002 }]"];
    for scheme in ["newmark", "conserving"] {
        goes_on(&[&flat[..], &hit, &[&format!("time.scheme={scheme}")]].concat());
    }
    // Stops by the law of Hertz push beside the held dofs.
    let stops = "obstacle=[{ side = 'below', height = -0.002, where = 'x > 0.1' }, \
                 { side = 'below', height = -0.0015, at = [0.04, 0.2], law = 'hertz', stiffness = 1e8 }, \
                 { side = 'below', height = -0.0015, at = [0.04, 0.22], law = 'hertz', stiffness = 1e12 }]";
    for scheme in ["newmark", "conserving"] {
        goes_on(
            &[&flat[..], &hit, &["mesh.cells=[30, 20]", stops, &format!("time.scheme={scheme}")]].concat(),
        );
    }
}
