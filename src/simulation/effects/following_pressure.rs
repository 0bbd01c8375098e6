//! Pressure that depends on the deflection.
//!
//! With the pressure p(x, y, t, w) the load of a basis function is `$\int p(w)\, \varphi_i$`, its
//! stiffness `$-\int p_w(w)\, \varphi_i \varphi_j$`, and its work from the flat plate
//! `$\int \int_0^w p(v)\, dv$`.

use super::ground::BuildContext;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, PER_NODE};
use crate::element::quadrature::{self, Rule};
use crate::element::{Element, with_element};
use crate::error::{Error, Result};
use crate::linalg::{ElementMatrix, vectors};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::FieldInput;
use crate::scheme::FollowingLoad;
use std::rc::Rc;

/// Abscissas and weights of Gauss and Legendre between 0 and 1, by which the work is integrated.
const GAUSS: [(f64, f64); 8] = [
    (0.019855071751231884, 0.05061426814518813),
    (0.10166676129318664, 0.11119051722668724),
    (0.2372337950418355, 0.15685332293894363),
    (0.4082826787521751, 0.181_341_891_689_181),
    (0.591_717_321_247_825, 0.181_341_891_689_181),
    (0.7627662049581645, 0.15685332293894363),
    (0.8983332387068134, 0.11119051722668724),
    (0.9801449282487681, 0.05061426814518813),
];

/// Change of the deflection, relative to the largest one, that is always within reach.
const LEAST: f64 = 1e-3;

/// Point of the quadrature of a cell.
struct PressedPoint {
    place: Point,
    /// Weight, in m2.
    weight: f64,
    /// Values of the local basis functions.
    values: Vec<f64>,
}

/// Pressure that depends on the deflection, on this process's part of the mesh.
pub(super) struct FollowingPressure<P: Partition> {
    pressure: FieldInput,
    /// Points of each cell, and the places of its deflections and slopes in the list for all nodes.
    cells: Vec<(Vec<PressedPoint>, Vec<usize>)>,
    nodes: usize,
    space: DofMap,
    partition: P,
}

impl<P: Partition> FollowingPressure<P> {
    /// Prepares the pressure of a scene; `None` where none depends on the deflection. Collective.
    ///
    /// # Errors
    /// Returns the errors of the cells.
    pub fn new(ground: &BuildContext<P>) -> Result<Option<FollowingPressure<P>>> {
        let BuildContext { scene, mesh, partition, space, .. } = *ground;
        let pressure = scene.load.as_ref().map(|load| &load.pressure);
        let Some(pressure) = pressure.filter(|pressure| pressure.follows_deflection()) else {
            return Ok(None);
        };
        let cell = |number: usize| {
            let nodes = mesh.cells[number].nodes().iter();
            let places = nodes.flat_map(|node| PER_NODE * node..PER_NODE * (node + 1)).collect();
            Ok((with_element!(&mesh.element(number)?, element => points(element)), places))
        };
        let cells = partition.comm().all_ok((0..mesh.cells.len()).map(cell).collect())?;
        let (pressure, space, partition) = (pressure.clone(), space.clone(), partition.clone());
        Ok(Some(FollowingPressure { pressure, cells, nodes: mesh.nodes.len(), space, partition }))
    }

    /// Returns deflections and slopes at the nodes of this process, three per node. Collective.
    fn shape(&self, u: &[f64]) -> Vec<f64> {
        self.space.shape(&self.partition.to_local(u))
    }

    /// Returns the load at all nodes of this process, three entries per node: this process's part.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the formula.
    pub fn at_nodes(&self, t: f64, u: &[f64]) -> Result<Vec<f64>> {
        let (shape, pressure) = (self.shape(u), self.pressure.of_deflection(t));
        let mut load = vec![0.0; PER_NODE * self.nodes];
        self.for_each(|point, places| {
            let value = point.weight * pressure.value(point.place, point.deflection(places, &shape))?;
            places.iter().zip(&point.values).for_each(|(&place, basis)| load[place] += value * basis);
            Ok(())
        })?;
        Ok(load)
    }

    /// Visits all points, each with the places of the dofs of its cell. Collective.
    fn for_each(&self, mut visit: impl FnMut(&PressedPoint, &[usize]) -> Result<()>) -> Result<()> {
        let mut cells = self.cells.iter();
        let visited = cells.try_for_each(|(points, places)| points.iter().try_for_each(|p| visit(p, places)));
        self.partition.comm().all_ok(visited)
    }

    /// Returns a multiple of the stiffness at the start and a displacement (m), cell by cell, in
    /// classes from `first` on. Without softening the parts that pull the plate on are left out.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the formula.
    pub fn stiffness(
        &self,
        ground: &BuildContext<P>,
        u: &[f64],
        (factor, softens): (f64, bool),
        first: usize,
    ) -> Result<Vec<ElementMatrix>> {
        let (shape, pressure) = (self.shape(u), self.pressure.of_deflection(0.0));
        let block = |number: usize| {
            let (points, places) = &self.cells[number];
            let mut matrix = vec![0.0; places.len() * places.len()];
            for point in points {
                let [_, slope, _] = pressure.jet(point.place, point.deflection(places, &shape))?;
                let slope = factor * point.weight * if softens { slope } else { slope.min(0.0) };
                for (row, a) in matrix.chunks_exact_mut(places.len()).zip(&point.values) {
                    row.iter_mut().zip(&point.values).for_each(|(entry, b)| *entry -= slope * a * b);
                }
            }
            Ok(ground.cells[number].form(&Rc::from(matrix), first + number))
        };
        self.partition.comm().all_ok((0..self.cells.len()).map(block).collect())
    }
}

impl PressedPoint {
    /// Returns the deflection, in m.
    fn deflection(&self, places: &[usize], shape: &[f64]) -> f64 {
        self.values.iter().zip(places).map(|(basis, &place)| basis * shape[place]).sum()
    }
}

impl<P: Partition> FollowingLoad for FollowingPressure<P> {
    fn force(&self, t: f64, u: &[f64], force: &mut [f64]) -> Result<()> {
        let load = self.at_nodes(t, u)?;
        force.copy_from_slice(&self.partition.add_up(&self.space.restrict(&load))?);
        Ok(())
    }

    fn work(&self, t: f64, u: &[f64]) -> Result<f64> {
        let (shape, pressure) = (self.shape(u), self.pressure.of_deflection(t));
        let mut work = 0.0;
        self.for_each(|point, places| {
            let deflection = point.deflection(places, &shape);
            for (share, weight) in GAUSS {
                work +=
                    point.weight * weight * deflection * pressure.value(point.place, share * deflection)?;
            }
            Ok(())
        })?;
        Ok(self.partition.comm().all_reduce_sum(work))
    }

    fn refuse_poles(&self, time: f64, u: &[f64]) -> Result<()> {
        let (shape, pressure) = (self.shape(u), self.pressure.of_deflection(time));
        let points = self.cells.iter().flat_map(|(points, places)| points.iter().map(move |p| (p, places)));
        let poles = points.filter_map(|(point, places)| {
            let w = pressure.pole(point.place, point.deflection(places, &shape))?;
            Some([point.place.x, point.place.y, w])
        });
        // All ranks have the same error.
        let poles = self.partition.comm().all_gather(&poles.take(1).collect::<Vec<_>>());
        poles.first().map_or(Ok(()), |&[x, y, w]| {
            Err(Error::PulledIn { key: self.pressure.key.clone(), time, point: [x, y], w })
        })
    }

    fn changes(&self) -> bool {
        self.pressure.changes()
    }

    fn reach(&self, t: f64, u: &[f64], x: &[f64]) -> Result<f64> {
        let (shape, change, pressure) = (self.shape(u), self.shape(x), self.pressure.of_deflection(t));
        let farthest = vectors::largest(shape.iter().step_by(PER_NODE).copied());
        let mut reach = f64::INFINITY;
        self.for_each(|point, places| {
            let [_, slope, curvature] = pressure.jet(point.place, point.deflection(places, &shape))?;
            let step = point.deflection(places, &change);
            if slope > 0.0 && curvature * step > 0.0 {
                let free = (slope / curvature).abs().max(LEAST * farthest);
                reach = reach.min(free / step.abs());
            }
            Ok(())
        })?;
        Ok(-self.partition.comm().all_reduce_max(-reach))
    }
}

/// Returns the points of the quadrature of a cell.
fn points<const N: usize>(element: &Element<N>) -> Vec<PressedPoint> {
    let rule = Rule::from(&quadrature::DEGREE_6);
    let mut points = Vec::new();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        points.push(PressedPoint {
            place,
            weight: weight * piece.area(),
            values: piece.values(barycentric).iter().copied().collect(),
        });
    }
    points
}
