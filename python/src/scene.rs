//! Scenes: a TOML text with changes of its keys.

use crate::errors::guarded;
use pyo3::prelude::*;
use rebond::output::plot::Obstacle;
use rebond::output::resolved::obstacles;
use rebond::quantity::raised;
use rebond::scene::HISTORY_COLUMNS;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Returns the columns of the history of a scene.
pub fn history_columns(scene: &rebond::scene::Scene) -> Vec<String> {
    let probes = scene.output.probes.iter().map(|probe| probe.name.clone());
    HISTORY_COLUMNS.iter().map(|name| (*name).to_owned()).chain(probes).chain(scene.force_columns()).collect()
}

/// Validated scene.
#[pyclass(frozen, module = "rebond._core")]
pub struct Scene {
    text: Vec<u8>,
    file: String,
    changes: Vec<String>,
    /// Scene that text and changes give.
    pub scene: rebond::scene::Scene,
}

impl Scene {
    fn read(py: Python<'_>, text: Vec<u8>, file: String, changes: Vec<String>) -> PyResult<Scene> {
        let scene = guarded(py, || rebond::scene::Scene::from_bytes(&text, &file, &changes))?;
        Ok(Scene { text, file, changes, scene })
    }

    /// Returns the scene of a run that is read back.
    pub fn of(scene: &rebond::scene::Scene, file: &Path) -> Scene {
        let text = scene.written().into_bytes();
        Scene { text, file: file.to_string_lossy().into_owned(), changes: Vec::new(), scene: scene.clone() }
    }

    /// Returns the file of the scene, which may not exist.
    pub fn path(&self) -> PathBuf {
        PathBuf::from(&self.file)
    }
}

#[pymethods]
impl Scene {
    /// Reads a scene file.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Scene> {
        // The library reads it first, with its limit on the length and its messages.
        guarded(py, || rebond::scene::Scene::load(&path, &[]))?;
        let text = guarded(py, || fs::read(&path).map_err(rebond::Error::io(&path)))?;
        Scene::read(py, text, path.to_string_lossy().into_owned(), Vec::new())
    }

    /// Reads a scene from a text; messages call it `file`, whose folder holds the files it names.
    #[staticmethod]
    fn from_text(py: Python<'_>, text: String, file: String) -> PyResult<Scene> {
        Scene::read(py, text.into_bytes(), file, Vec::new())
    }

    /// Returns the scene with more changes of the form `key=value`.
    fn changed(&self, py: Python<'_>, changes: Vec<String>) -> PyResult<Scene> {
        let changes = self.changes.iter().cloned().chain(changes).collect();
        Scene::read(py, self.text.clone(), self.file.clone(), changes)
    }

    #[getter]
    fn file(&self) -> &str {
        &self.file
    }

    #[getter]
    fn changes(&self) -> Vec<String> {
        self.changes.clone()
    }

    #[getter]
    fn title(&self) -> &str {
        &self.scene.title
    }

    #[getter]
    fn effects(&self) -> Vec<String> {
        self.scene.effects()
    }

    /// Step and end (s), and number of steps.
    #[getter]
    fn time(&self) -> (f64, f64, u64) {
        let time = &self.scene.time;
        (time.step, time.end, time.steps())
    }

    #[getter]
    fn probes(&self) -> Vec<String> {
        self.scene.output.probes.iter().map(|probe| probe.name.clone()).collect()
    }

    /// Quantity and unit of each probe, for the axis of a picture.
    #[getter]
    fn axes(&self) -> Vec<(&'static str, String)> {
        let axes = self.scene.output.probes.iter().map(|probe| probe.quantity.axis());
        axes.map(|(quantity, unit)| (quantity, raised(unit))).collect()
    }

    /// Heights (m) and names of the obstacles that a history shows beside deflections, from the
    /// heights opposite each probe.
    fn obstacles(&self, opposite: BTreeMap<String, Vec<f64>>) -> Vec<(f64, String)> {
        let resolved = serde_json::to_value(&self.scene).unwrap_or_default();
        let named = |obstacle: Obstacle| match obstacle {
            Obstacle::Part(height, name) => (height, name),
            Obstacle::Below(height) | Obstacle::Above(height) => (height, "obstacle".to_owned()),
        };
        obstacles(&resolved, &opposite).into_iter().map(named).collect()
    }

    #[getter]
    fn columns(&self) -> Vec<String> {
        history_columns(&self.scene)
    }

    /// The scene as TOML with every default filled in.
    #[getter]
    fn resolved(&self, py: Python<'_>) -> PyResult<String> {
        guarded(py, || Ok(self.scene.resolved()))
    }

    /// The resolved scene as JSON.
    #[getter]
    fn json(&self, py: Python<'_>) -> PyResult<String> {
        guarded(py, || Ok(serde_json::to_value(&self.scene).unwrap_or_default().to_string()))
    }
}
