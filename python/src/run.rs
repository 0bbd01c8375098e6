//! Whole runs.

use crate::errors::{Failure, usage};
use crate::line::{Answer, Callbacks, Event, Line, WorkerEnd};
use crate::run_data::{Collector, RunData};
use crate::scene::Scene;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rebond::output::checkpoint::{self, Checkpoint, Identity};
use rebond::output::claim::{self, RunLock};
use rebond::output::run_files::{RecordedRun, ResumedRun, RunFiles, RunSummary};
use rebond::simulation::{self, Both, Model};
use rebond::{Error, study};
use std::path::PathBuf;
use std::time::Duration;

/// Run to make in a working thread.
struct Task {
    run: RecordedRun,
    writes_files: bool,
    overwrites: bool,
    /// Least time between two steps that Python is told of; `None` if it is told of none.
    pace: Option<Duration>,
    /// Checkpoint from which the run goes on.
    from: Option<Checkpoint>,
}

impl Task {
    /// Runs the scene, and writes the run folder as the command does if asked to.
    fn execute(mut self, end: &WorkerEnd) -> rebond::Result<RunData> {
        let from = self.from.take();
        let RecordedRun { scene, identity, folder, .. } = &self.run;
        rebond::memory::require_some()?;
        let lock = if self.writes_files {
            if from.is_none() {
                let resolved = serde_json::to_value(scene).unwrap_or_default();
                claim::refuse_results(folder, identity, &resolved, self.overwrites)?;
            }
            Some(RunLock::new(folder, identity)?)
        } else {
            None
        };
        let model = Model::new(scene)?;
        let mut warnings = study::warnings(scene, &model);
        let mut files = RunFiles::new(&self.run, 0, 1);
        if lock.is_some() {
            files.prepare(from.as_ref())?;
        }
        let mut collector = Collector::new(scene, end, self.pace);
        let (collector, files, (outcome, ended)) = if lock.is_some() {
            let mut both = Both(collector, files);
            let pause = from.map(|from| from.pause);
            let done = simulation::resume(scene, &model, &simulation::condensed, pause, &mut both)?;
            (both.0, Some(both.1), done)
        } else {
            let done = model.run(scene, &mut collector)?;
            (collector, None, done)
        };
        let status = ended.as_ref().err().map_or("done".into(), ToString::to_string);
        warnings.extend(study::warning_of_run(scene, &outcome, &warnings));
        let summary = RunSummary::new(scene, identity, &outcome, &warnings, status);
        let written = match files {
            Some(files) => files.finish().and_then(|()| summary.write(folder)),
            None => Ok(()),
        };
        let mut data = collector.finish();
        data.is_finished = ended.is_ok();
        match ended {
            Ok(()) if lock.is_some() => {
                written?;
                // A finished run needs no checkpoints.
                checkpoint::clear(folder)?;
            }
            Ok(()) | Err(Error::Interrupted { .. }) => written?,
            Err(error) => return Err(error),
        }
        data.summary = serde_json::to_value(&summary).unwrap_or_default().to_string();
        Ok(data)
    }
}

/// Python function that is told of each step.
struct OnStep(Option<Py<PyAny>>);

impl Callbacks for OnStep {
    fn answer(&self, py: Python<'_>, event: &Event) -> PyResult<Answer> {
        let (Some(function), Event::Step(news)) = (&self.0, event) else { return Ok(Answer::Continue) };
        let stops = function.call1(py, (news.step, news.time, news.contact_nodes, news.row.clone()))?;
        Ok(if stops.is_truthy(py)? { Answer::Stop } else { Answer::Continue })
    }
}

/// Runs a scene. `on_step` is called with step, time, number of nodes in contact, and the row of
/// the history or None, after every step or `pace` seconds after the last call; a true answer
/// stops the run.
#[pyfunction]
pub fn run<'py>(
    py: Python<'py>,
    scene: &Scene,
    out: Option<PathBuf>,
    overwrite: bool,
    on_step: Option<Py<PyAny>>,
    pace: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let file = std::path::absolute(scene.path()).unwrap_or_else(|_| scene.path());
    let identity = crate::errors::guarded(py, || Identity::of(&scene.scene))?;
    let run = RecordedRun {
        scene: scene.scene.clone(),
        file,
        identity,
        folder: out.clone().unwrap_or_default(),
        petsc: Vec::new(),
    };
    let pace = on_step.is_some().then(|| Duration::try_from_secs_f64(pace).unwrap_or_default());
    let task = Task { run, writes_files: out.is_some(), overwrites: overwrite, pace, from: None };
    start(py, task, on_step)
}

/// Goes on with a run from its newest checkpoint, to its end or a later one (s). Returns the
/// results since the checkpoint, the scene, and what is wrong with newer checkpoints.
#[pyfunction]
pub fn resume<'py>(
    py: Python<'py>,
    folder: PathBuf,
    until: Option<String>,
    on_step: Option<Py<PyAny>>,
) -> PyResult<(Bound<'py, PyDict>, Scene, Vec<String>)> {
    let ResumedRun { run, from, damaged } =
        crate::errors::guarded(py, || ResumedRun::new(folder, until.as_deref()))?;
    let scene = Scene::of(&run.scene, &run.file);
    let damaged = damaged.iter().map(ToString::to_string).collect();
    let pace = on_step.is_some().then_some(Duration::ZERO);
    let task = Task { run, writes_files: true, overwrites: false, pace, from: Some(from) };
    Ok((start(py, task, on_step)?, scene, damaged))
}

/// Makes a run in a thread of its own, and returns its results.
fn start<'py>(py: Python<'py>, task: Task, on_step: Option<Py<PyAny>>) -> PyResult<Bound<'py, PyDict>> {
    let work = move |end: WorkerEnd| {
        let done = task.execute(&end).map_err(Failure::from);
        // The run folder is released before Python goes on.
        end.report(done.map(|data| Box::new(data) as Box<dyn std::any::Any + Send>));
        Ok(())
    };
    let line = Line::start(work).map_err(|why| usage(py, &format!("no thread for the run: {why}")))?;
    let data: RunData = line.wait(py, &OnStep(on_step), || true)?;
    data.into_dict(py)
}
