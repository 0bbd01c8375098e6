//! Results of a run, collected in memory while it advances.

use crate::line::{Answer, Event, StepNews, WorkerEnd};
use crate::scene::history_columns;
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rebond::scene::Scene;
use rebond::simulation::{Contact, Lattice, NodeEvent, Observer, Row, Snapshot};
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Columns of numbers by name, of equal length.
#[derive(Default)]
pub struct Columns {
    names: Vec<String>,
    values: Vec<Vec<f64>>,
}

impl Columns {
    fn new(names: impl IntoIterator<Item = String>) -> Columns {
        let names: Vec<String> = names.into_iter().collect();
        Columns { values: vec![Vec::new(); names.len()], names }
    }

    fn push(&mut self, row: impl IntoIterator<Item = f64>) {
        self.values.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
    }

    fn last(&self) -> Vec<f64> {
        self.values.iter().filter_map(|column| column.last().copied()).collect()
    }

    fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let dict = PyDict::new(py);
        for (name, values) in self.names.into_iter().zip(self.values) {
            dict.set_item(name, PyArray1::from_vec(py, values))?;
        }
        Ok(dict)
    }
}

/// Numbers of all snapshots, by name.
#[derive(Default)]
struct Fields {
    lattice: Option<Lattice>,
    time: Vec<f64>,
    step: Vec<f64>,
    /// Components per point and values, snapshot by snapshot and point by point.
    values: BTreeMap<&'static str, (usize, Vec<f64>)>,
}

impl Fields {
    fn push(&mut self, name: &'static str, components: usize, values: impl IntoIterator<Item = f64>) {
        self.values.entry(name).or_insert((components, Vec::new())).1.extend(values);
    }

    fn take(&mut self, snapshot: &Snapshot) {
        self.lattice.get_or_insert_with(|| snapshot.lattice.clone());
        self.time.push(snapshot.time);
        self.step.push(snapshot.step as f64);
        self.push("deflection", 1, snapshot.deflection.iter().copied());
        self.push("velocity", 1, snapshot.velocity.iter().copied());
        self.push("slope", 2, snapshot.slope.iter().flatten().copied());
        self.push("cell_velocity", 1, snapshot.mean_velocity.iter().copied());
        let [floor, ceiling] = snapshot.obstacles.each_ref().map(Option::as_ref);
        let with_obstacles = [
            ("gap", snapshot.gap.as_ref()),
            ("reaction", snapshot.reaction.as_ref()),
            ("floor", floor),
            ("ceiling", ceiling),
        ];
        for (name, values) in with_obstacles {
            values.into_iter().for_each(|values| self.push(name, 1, values.iter().copied()));
        }
        if let Some(stresses) = &snapshot.stresses {
            self.push("moment", 3, stresses.moment.iter().flatten().copied());
            self.push("stress_top", 3, stresses.stress_top.iter().flatten().copied());
            self.push("von_mises", 1, stresses.von_mises.iter().copied());
        }
    }

    /// Returns the arrays, with one row per snapshot.
    fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let dict = PyDict::new(py);
        let Some(lattice) = self.lattice else { return Ok(dict) };
        let snapshots = self.time.len();
        dict.set_item("time", PyArray1::from_vec(py, self.time))?;
        dict.set_item("step", PyArray1::from_vec(py, self.step))?;
        let points: Vec<f64> = lattice.points.iter().flatten().copied().collect();
        dict.set_item("points", PyArray1::from_vec(py, points).reshape([lattice.points.len(), 2])?)?;
        dict.set_item("cells", cell_array(py, lattice.cells.iter().map(Vec::as_slice))?)?;
        let parents = lattice.parents.iter().map(|cell| *cell as i64).collect();
        dict.set_item("parents", PyArray1::from_vec(py, parents))?;
        for (name, (components, values)) in self.values {
            let points = values.len() / (components * snapshots).max(1);
            let array = PyArray1::from_vec(py, values);
            match components {
                1 => dict.set_item(name, array.reshape([snapshots, points])?)?,
                _ => dict.set_item(name, array.reshape([snapshots, points, components])?)?,
            }
        }
        Ok(dict)
    }
}

/// Returns the corners of cells, one row per cell, with -1 for the fourth corner of a triangle
/// among quadrilaterals.
pub fn cell_array<'py, 'c>(
    py: Python<'py>,
    cells: impl Iterator<Item = &'c [usize]> + Clone,
) -> PyResult<Bound<'py, PyAny>> {
    let corners = cells.clone().map(<[usize]>::len).max().unwrap_or(0);
    let row = |cell: &'c [usize]| (0..corners).map(move |i| cell.get(i).map_or(-1, |node| *node as i64));
    let numbers: Vec<i64> = cells.clone().flat_map(row).collect();
    Ok(PyArray1::from_vec(py, numbers).reshape([cells.count(), corners])?.into_any())
}

/// Results of a run.
pub struct RunData {
    history: Columns,
    contacts: Columns,
    events: Columns,
    fields: Fields,
    /// Contents of `summary.json`.
    pub summary: String,
    /// Whether the run came to its end.
    pub is_finished: bool,
}

impl RunData {
    /// Returns the results as nested dictionaries of arrays.
    pub fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let dict = PyDict::new(py);
        dict.set_item("history", self.history.into_dict(py)?)?;
        dict.set_item("contacts", self.contacts.into_dict(py)?)?;
        dict.set_item("events", self.events.into_dict(py)?)?;
        dict.set_item("fields", self.fields.into_dict(py)?)?;
        dict.set_item("summary", self.summary)?;
        dict.set_item("finished", self.is_finished)?;
        Ok(dict)
    }
}

/// Observer that collects the results of a run, tells Python of its steps if asked to, and stops
/// the run where Python says so.
pub struct Collector<'e> {
    end: &'e WorkerEnd,
    /// Least time between two steps that Python is told of; `None` if it is told of none.
    pace: Option<Duration>,
    told: Instant,
    /// Length of a step, in s.
    dt: f64,
    has_row: bool,
    stops: bool,
    data: RunData,
}

impl<'e> Collector<'e> {
    /// Prepares to collect the results of a scene.
    pub fn new(scene: &Scene, end: &'e WorkerEnd, pace: Option<Duration>) -> Collector<'e> {
        let named = |names: &[&str]| Columns::new(names.iter().map(|name| (*name).to_owned()));
        let data = RunData {
            history: Columns::new(history_columns(scene)),
            contacts: named(&["node", "x", "y", "begin", "end", "impulse"]),
            events: named(&["time", "node", "x", "y", "closes", "velocity", "force"]),
            fields: Fields::default(),
            summary: String::new(),
            is_finished: false,
        };
        let (dt, told) = (scene.time.step, Instant::now());
        Collector { end, pace, told, dt, has_row: false, stops: false, data }
    }

    /// Returns the results.
    pub fn finish(self) -> RunData {
        self.data
    }
}

impl Observer for Collector<'_> {
    fn row(&mut self, row: &Row) -> rebond::Result<()> {
        self.data.history.push(row.numbers());
        self.has_row = true;
        Ok(())
    }

    fn contacts(&mut self, ended: &[Contact]) -> rebond::Result<()> {
        for Contact { node, at: [x, y], begin, end, impulse } in ended {
            self.data.contacts.push([*node as f64, *x, *y, *begin, *end, *impulse]);
        }
        Ok(())
    }

    fn event(&mut self, event: &NodeEvent) -> rebond::Result<()> {
        let NodeEvent { node, at: [x, y], event } = event;
        let closes = f64::from(event.closes);
        self.data.events.push([event.time, *node as f64, *x, *y, closes, event.velocity, event.force]);
        Ok(())
    }

    fn fields(&mut self, snapshot: &Snapshot) -> rebond::Result<()> {
        self.data.fields.take(snapshot);
        Ok(())
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        if self.pace.is_some_and(|pace| pace.is_zero() || self.told.elapsed() >= pace) {
            self.told = Instant::now();
            let row = self.has_row.then(|| self.data.history.last());
            let news = StepNews { step, time: step as f64 * self.dt, contact_nodes, row };
            self.stops = matches!(self.end.ask(Event::Step(news)), Answer::Stop);
        }
        self.has_row = false;
    }

    fn interrupts(&self) -> bool {
        self.stops || self.end.is_asked_to_stop()
    }
}
