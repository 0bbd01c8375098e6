//! Thread that holds a model, and a scheme if asked to, and does what it is told with them.

use crate::errors::{Failure, usage};
use crate::line::{Answer, Callbacks, Event, Line, WorkerEnd};
use pyo3::prelude::*;
use rebond::linalg::{Engine, Native};
use rebond::mesh::Mesh;
use rebond::scene::Scene;
use rebond::scheme::Scheme;
use rebond::simulation::{self, ExternalLoad, Model, StepMonitor};
use std::any::Any;
use std::rc::Rc;
use std::sync::Mutex;
use std::sync::PoisonError;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Loads that Python adds to those of the scene.
pub enum AddedLoad {
    /// No loads.
    None,
    /// Loads set from step to step, in N, one entry per dof at first; a single number for all dofs.
    Set(Vec<f64>),
    /// Loads by a Python function of time.
    Function,
}

/// Scheme that is stepped, with what watches it.
pub struct Stepper<'m> {
    /// Scheme at the present instant.
    pub scheme: Box<dyn Scheme + 'm>,
    monitor: StepMonitor<'m, Native>,
    /// Quantities at the probes.
    pub probes: Vec<f64>,
    /// Load that is set from step to step.
    pub load: Option<ExternalLoad>,
    has_failed: bool,
}

impl Stepper<'_> {
    /// Makes a step, and checks it.
    pub fn step(&mut self) -> rebond::Result<()> {
        self.refuse_failed()?;
        let Stepper { scheme, monitor, probes, .. } = self;
        let made = scheme.advance().and_then(|()| monitor.note(scheme.as_mut(), probes));
        self.has_failed = made.is_err();
        made
    }

    /// Refuses a scheme that stopped in the midst of a step.
    pub fn refuse_failed(&self) -> rebond::Result<()> {
        let ended = || rebond::Error::Usage("the simulation ended with an error; start another".into());
        if self.has_failed { Err(ended()) } else { Ok(()) }
    }
}

/// Model with its mesh, and its scheme if there is one.
pub struct Host<'m> {
    pub scene: &'m Scene,
    pub mesh: &'m Mesh,
    pub model: &'m Model,
    pub stepper: Option<Stepper<'m>>,
    pub end: &'m WorkerEnd,
}

impl<'m> Host<'m> {
    /// Returns the scheme.
    pub fn stepper(&mut self) -> rebond::Result<&mut Stepper<'m>> {
        self.stepper.as_mut().ok_or_else(|| rebond::Error::Usage("the model has no scheme".into()))
    }
}

type Command = Box<dyn for<'m> FnOnce(&mut Host<'m>) -> rebond::Result<Box<dyn Any + Send>> + Send>;

/// Python's end of the thread.
pub struct Handle {
    line: Line,
    commands: Mutex<Sender<Command>>,
}

impl Handle {
    /// Builds model and, if `added` is given, scheme in a thread of their own.
    pub fn start(
        py: Python<'_>,
        scene: Scene,
        added: Option<AddedLoad>,
        callbacks: &dyn Callbacks,
    ) -> PyResult<Handle> {
        let (commands, received) = channel();
        let line = Line::start(move |end| serve(&scene, added, &Rc::new(end), received))
            .map_err(|why| usage(py, &format!("no thread for the model: {why}")))?;
        line.wait::<()>(py, callbacks, || true)?;
        Ok(Handle { line, commands: Mutex::new(commands) })
    }

    /// Does something with the model, and returns the result.
    pub fn ask<T: Send + 'static>(
        &self,
        py: Python<'_>,
        callbacks: &dyn Callbacks,
        task: impl for<'m> FnOnce(&mut Host<'m>) -> rebond::Result<T> + Send + 'static,
    ) -> PyResult<T> {
        let command: Command =
            Box::new(move |host| task(host).map(|value| Box::new(value) as Box<dyn Any + Send>));
        self.line.wait(py, callbacks, || {
            self.commands.lock().unwrap_or_else(PoisonError::into_inner).send(command).is_ok()
        })
    }
}

/// Builds the model and serves commands until Python's end is gone.
fn serve(
    scene: &Scene,
    added: Option<AddedLoad>,
    end: &Rc<WorkerEnd>,
    commands: Receiver<Command>,
) -> Result<(), Failure> {
    rebond::memory::require_some()?;
    let mesh = simulation::mesh(scene)?;
    let mut model = Model::new(scene)?;
    let dofs = model.system.engine.dofs();
    let load = match &added {
        Some(AddedLoad::Set(force)) => {
            let load = model.external_load(scene);
            load.set(&of_length(force, dofs)?);
            Some(load)
        }
        Some(AddedLoad::Function) => {
            let end = Rc::clone(end);
            model.add_load(move |time, sum| {
                let Answer::Load(force) = end.ask(Event::Load(time)) else {
                    return Err(rebond::Error::Stopped("no load from Python".into()));
                };
                let force = of_length(&force, sum.len())?;
                sum.iter_mut().zip(force).for_each(|(sum, force)| *sum += force);
                Ok(())
            });
            None
        }
        _ => None,
    };
    let model = &model;
    let stepper = match added {
        None => None,
        Some(_) => {
            let mut scheme = model.scheme(scene)?;
            let mut monitor = StepMonitor::new(scene, model, scheme.as_ref())?;
            let mut probes = vec![0.0; model.probes.len()];
            monitor.note(scheme.as_mut(), &mut probes)?;
            Some(Stepper { scheme, monitor, probes, load, has_failed: false })
        }
    };
    let mut host = Host { scene, mesh: &mesh, model, stepper, end };
    let mut listens = end.report(Ok(Box::new(())));
    while let Some(command) = listens.then(|| commands.recv().ok()).flatten() {
        listens = end.report(command(&mut host).map_err(Failure::from));
    }
    Ok(())
}

/// Returns a load with one entry per dof; a single number stands for all.
pub fn of_length(force: &[f64], dofs: usize) -> rebond::Result<Vec<f64>> {
    let wrong = |what: String| Err(rebond::Error::Usage(format!("force: {what}")));
    match force {
        [all] if dofs != 1 => return of_length(&vec![*all; dofs], dofs),
        force if force.len() != dofs => {
            return wrong(format!("found {} entries; expected {dofs}, one per dof", force.len()));
        }
        _ => {}
    }
    match force.iter().position(|entry| !entry.is_finite()) {
        Some(dof) => wrong(format!("entry {dof} is {}; expected finite numbers", force[dof])),
        None => Ok(force.to_vec()),
    }
}
