//! Simulations that Python steps.

use crate::host::{AddedLoad, Handle, of_length};
use crate::line::{Answer, Callbacks, Event};
use crate::model::{Layout, at_point};
use crate::scene::Scene;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rebond::Error;
use rebond::linalg::Engine;

/// Scheme of a scene, in a thread of its own.
#[pyclass(frozen, module = "rebond._core")]
pub struct Simulation {
    handle: Handle,
    force: Function,
}

/// Python function that returns the load at a time (s), if there is one.
struct Function(Option<Py<PyAny>>);

impl Callbacks for Function {
    fn answer(&self, py: Python<'_>, event: &Event) -> PyResult<Answer> {
        let (Some(function), Event::Load(time)) = (&self.0, event) else { return Ok(Answer::Continue) };
        let force = function.call1(py, (*time,))?;
        let force: PyReadonlyArray1<f64> = force.extract(py)?;
        Ok(Answer::Load(force.as_array().to_vec()))
    }
}

/// Step of a simulation: index, time, nodes in contact, force of the obstacles, residual,
/// iterations, probes.
type Step = (u64, f64, usize, f64, f64, u32, Vec<f64>);

#[pymethods]
impl Simulation {
    /// Starts the scheme. `force` is a function of time, `set` the load to begin with where loads
    /// are set from step to step; both are None for the scene's own loads.
    #[new]
    fn new(
        py: Python<'_>,
        scene: &Scene,
        force: Option<Py<PyAny>>,
        set: Option<PyReadonlyArray1<f64>>,
    ) -> PyResult<Simulation> {
        let added = match (&force, set) {
            (Some(_), _) => AddedLoad::Function,
            (None, Some(set)) => AddedLoad::Set(set.as_array().to_vec()),
            (None, None) => AddedLoad::None,
        };
        let force = Function(force);
        let handle = Handle::start(py, scene.scene.clone(), Some(added), &force)?;
        Ok(Simulation { handle, force })
    }

    /// Makes steps, with a load from the next instant on if one is given, and returns the last.
    fn step(&self, py: Python<'_>, count: u64, set: Option<PyReadonlyArray1<f64>>) -> PyResult<Step> {
        let set = set.map(|set| set.as_array().to_vec());
        self.handle.ask(py, &self.force, move |host| {
            let (end, dofs) = (host.end, host.model.system.engine.dofs());
            let stepper = host.stepper()?;
            if let Some(set) = set {
                let none =
                    || Error::Usage("force: the simulation was started without; expected force=0.0".into());
                stepper.load.as_ref().ok_or_else(none)?.set(&of_length(&set, dofs)?);
            }
            stepper.refuse_failed()?;
            for _ in 0..count {
                stepper.step()?;
                if end.is_asked_to_stop() {
                    break;
                }
            }
            let scheme = &stepper.scheme;
            let reactions = scheme.record().candidates().map(|bound| scheme.reaction()[bound]);
            let (mut nodes, mut total) = (0, 0.0);
            reactions.for_each(|r| {
                nodes += usize::from(r != 0.0);
                total += r;
            });
            let report = scheme.step_report();
            Ok((
                scheme.step(),
                scheme.time(),
                nodes,
                total,
                report.kkt,
                report.iterations,
                stepper.probes.clone(),
            ))
        })
    }

    /// Time of the next instant at which the scheme asks for a load that is set, in s.
    fn force_time(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        let time = |load: &rebond::simulation::ExternalLoad| load.next_time();
        self.handle.ask(py, &self.force, move |host| Ok(host.stepper()?.load.as_ref().map(time)))
    }

    /// Displacement, velocity or reactions at the present instant.
    fn vector<'py>(&self, py: Python<'py>, name: String) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = self.handle.ask(py, &self.force, move |host| {
            let stepper = host.stepper()?;
            stepper.refuse_failed()?;
            let scheme = &mut stepper.scheme;
            Ok(match name.as_str() {
                "velocity" => scheme.velocity()?,
                "reactions" => scheme.reaction().to_vec(),
                "lower" => scheme.limits().lower.clone(),
                "upper" => scheme.limits().upper.clone(),
                _ => scheme.displacement().to_vec(),
            })
        })?;
        Ok(PyArray1::from_vec(py, values))
    }

    /// Kinetic energy, elastic energy and work, in J.
    fn energies(&self, py: Python<'_>) -> PyResult<(f64, f64, f64)> {
        self.handle.ask(py, &self.force, |host| {
            let energies = host.stepper()?.scheme.energies()?;
            Ok((energies.kinetic, energies.elastic, energies.work))
        })
    }

    /// Nodes, cells, dofs and bounds by name.
    fn layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.handle.ask(py, &self.force, |host| Layout::of(host))?.into_dict(py)
    }

    /// Warnings on the scene, one sentence each.
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.handle.ask(py, &self.force, |host| Ok(rebond::study::warnings(host.scene, host.model)))
    }

    /// Weights of the dofs in the deflection at a point.
    fn at_point<'py>(&self, py: Python<'py>, x: f64, y: f64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.handle.ask(py, &self.force, move |host| at_point(host, [x, y]))?))
    }
}
