//! Models: mesh, matrices, modes.

use crate::host::{Handle, Host};
use crate::matrices::Matrices;
use crate::run_data::cell_array;
use crate::scene::Scene;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rebond::Error;
use rebond::assembly::Probe;
use rebond::dof_map::PER_NODE;
use rebond::linalg::{Engine, Form};
use rebond::mesh::Point;
use rebond::modes::{self, Store, cache_folder};
use rebond::simulation;
use std::env;
use std::f64::consts::TAU;
use std::path::PathBuf;
use std::sync::Arc;

/// Model of a scene, in a thread of its own.
#[pyclass(frozen, module = "rebond._core")]
pub struct Model(Handle);

/// Mesh and dofs of a model, as plain numbers.
pub struct Layout {
    nodes: Vec<f64>,
    cells: Vec<Vec<usize>>,
    /// Dof and factor of deflection and slopes, three per node; -1 and 0 where held.
    dofs: Vec<i64>,
    factors: Vec<f64>,
    bounded: Vec<i64>,
    bounded_nodes: Vec<i64>,
    count: usize,
}

impl Layout {
    /// Collects mesh and dofs.
    pub fn of(host: &Host) -> rebond::Result<Layout> {
        let Host { scene, mesh, model, .. } = host;
        let space = simulation::space(scene, mesh)?;
        let of_shape = (0..PER_NODE * mesh.nodes.len()).map(|dof| space.dof(dof));
        let (dofs, factors) =
            of_shape.map(|of| of.map_or((-1, 0.0), |(dof, factor)| (dof as i64, factor))).unzip();
        let bounds = &model.system.bounds;
        Ok(Layout {
            nodes: mesh.nodes.iter().flat_map(|node| [node.x, node.y]).collect(),
            cells: mesh.cells.iter().map(|cell| cell.nodes().to_vec()).collect(),
            dofs,
            factors,
            bounded: bounds.dofs.iter().map(|dof| *dof as i64).collect(),
            bounded_nodes: model.sites[..bounds.len()].iter().map(|site| site.node as i64).collect(),
            count: model.system.engine.dofs(),
        })
    }

    /// Returns the numbers by name.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let count = self.nodes.len() / 2;
        let dict = PyDict::new(py);
        dict.set_item("nodes", PyArray1::from_vec(py, self.nodes).reshape([count, 2])?)?;
        dict.set_item("cells", cell_array(py, self.cells.iter().map(Vec::as_slice))?)?;
        dict.set_item("dofs", PyArray1::from_vec(py, self.dofs).reshape([count, PER_NODE])?)?;
        dict.set_item("factors", PyArray1::from_vec(py, self.factors).reshape([count, PER_NODE])?)?;
        dict.set_item("bounded_dofs", PyArray1::from_vec(py, self.bounded))?;
        dict.set_item("bounded_nodes", PyArray1::from_vec(py, self.bounded_nodes))?;
        dict.set_item("count", self.count)?;
        Ok(dict)
    }
}

/// Returns the weights of the dofs in the deflection at a point (m), one entry per dof.
pub fn at_point(host: &Host, [x, y]: [f64; 2]) -> rebond::Result<Vec<f64>> {
    let space = simulation::space(host.scene, host.mesh)?;
    let probe = Probe::new(host.mesh, &space, Point::new(x, y))?;
    let mut weights = vec![0.0; host.model.system.engine.dofs()];
    probe.push(1.0, &mut weights);
    Ok(weights)
}

/// Returns the lowest natural frequencies (Hz) and shapes with one of the masses.
fn natural_modes(host: &Host, count: usize, mass: &str) -> rebond::Result<(Vec<f64>, Vec<f64>)> {
    let model = host.model;
    let system = &model.system;
    let own;
    let mass = match mass {
        "scene" => &system.mass,
        "consistent" | "singular" => {
            let found = simulation::matrices(host.scene, host.mesh, true)?;
            // An engine multiplies forms of its own only, whose dofs it has arranged.
            own = match mass {
                "consistent" => system.engine.form(found.consistent),
                _ => system.engine.averages(found.singular),
            };
            &own
        }
        other => {
            let expected = "expected \"scene\", \"consistent\" or \"singular\"";
            return Err(Error::Usage(format!("mass: found {other:?}; {expected}")));
        }
    };
    let is_loose = model.mechanism.is_some() || !host.scene.attachments.balls.is_empty();
    let modes = modes::shapes(&system.engine, [&system.stiffness, mass], count, is_loose)?;
    let frequencies = modes.iter().map(|mode| mode.frequency).collect();
    Ok((frequencies, modes.into_iter().flat_map(|mode| mode.shape).collect()))
}

/// Frequencies (Hz), shapes and momenta of the modes that carry a modal mass.
type MassModes = (Vec<f64>, Vec<f64>, Vec<f64>);

/// Returns the modes that carry the mass of the scene, mode by mode.
fn mass_modes(host: &Host) -> rebond::Result<MassModes> {
    let Form::Modal { modes, .. } = &host.model.system.mass else {
        return Err(Error::Usage("mass_modes: the scene has another mass; expected time.mass=modal".into()));
    };
    let columns = |of: &dyn Fn(usize) -> Vec<f64>| (0..modes.count()).flat_map(of).collect();
    Ok((
        modes.squares.iter().map(|square| square.sqrt() / TAU).collect(),
        columns(&|mode| modes.shapes.col(mode).iter().copied().collect()),
        columns(&|mode| modes.momenta.col(mode).iter().copied().collect()),
    ))
}

/// Makes models keep natural modes between runs, in a folder or where the command keeps them, and
/// returns the folder; an empty name keeps none.
#[pyfunction]
pub fn keep_modes(folder: Option<PathBuf>) -> Option<PathBuf> {
    let folder = folder.or_else(|| cache_folder(|name| env::var_os(name)));
    let folder = folder.filter(|folder| !folder.as_os_str().is_empty());
    modes::keep_in(folder.as_ref().map(|folder| Arc::new(Store::new(folder))));
    folder
}

#[pymethods]
impl Model {
    #[new]
    fn new(py: Python<'_>, scene: &Scene) -> PyResult<Model> {
        Handle::start(py, scene.scene.clone(), None, &()).map(Model)
    }

    /// Nodes, cells, dofs and bounds by name.
    fn layout<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        self.0.ask(py, &(), |host| Layout::of(host))?.into_dict(py)
    }

    /// Warnings on the scene, one sentence each.
    fn warnings(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.0.ask(py, &(), |host| Ok(rebond::study::warnings(host.scene, host.model)))
    }

    /// Matrices as triplets (values, rows, columns, shape), and vectors, by name.
    fn matrices<'py>(&self, py: Python<'py>, supported: bool) -> PyResult<Bound<'py, PyDict>> {
        self.0.ask(py, &(), move |host| Matrices::of(host, supported))?.into_dict(py)
    }

    /// Frequencies (Hz) and shapes, one row per mode.
    fn modes<'py>(&self, py: Python<'py>, count: usize, mass: String) -> PyResult<Bound<'py, PyAny>> {
        let (frequencies, shapes) = self.0.ask(py, &(), move |host| natural_modes(host, count, &mass))?;
        let count = frequencies.len();
        let dofs = shapes.len() / count.max(1);
        let shapes = PyArray1::from_vec(py, shapes).reshape([count, dofs])?;
        Ok((PyArray1::from_vec(py, frequencies), shapes).into_pyobject(py)?.into_any())
    }

    /// Frequencies (Hz), shapes and momenta of the modes that carry a modal mass, one row per mode.
    fn mass_modes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (frequencies, shapes, momenta) = self.0.ask(py, &(), |host| mass_modes(host))?;
        let size = [frequencies.len(), shapes.len() / frequencies.len().max(1)];
        let rows = |values| PyArray1::from_vec(py, values).reshape(size);
        let found = (PyArray1::from_vec(py, frequencies), rows(shapes)?, rows(momenta)?);
        Ok(found.into_pyobject(py)?.into_any())
    }

    /// Weights of the dofs in the deflection at a point.
    fn at_point<'py>(&self, py: Python<'py>, x: f64, y: f64) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(PyArray1::from_vec(py, self.0.ask(py, &(), move |host| at_point(host, [x, y]))?))
    }
}
