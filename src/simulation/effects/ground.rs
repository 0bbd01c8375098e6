//! Build context of a model.

use super::contributions::{Contributions, PointEvaluation, PointTerm};
use crate::assembly::{self, CellArrays, Pressure, Probe};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::element::adaptive::Rules;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use crate::scene::{self, FieldInput, Scene};
use crate::simulation::membrane_forces::MembraneForces;
use crate::simulation::refinement;
use crate::simulation::stops::Stop;
use std::rc::Rc;

/// Build context of a model: this process's part of the mesh, and the relation of its dofs to the
/// engine's dofs.
pub(in crate::simulation) struct BuildContext<'g, P: Partition> {
    pub scene: &'g Scene,
    pub partition: &'g P,
    pub mesh: &'g Mesh,
    /// Constraints of the supports at the nodes.
    pub holds: &'g [NodeConstraint],
    /// Dofs of this part of the mesh, the gaps of balls and the tips of compliant stops.
    pub space: &'g DofMap,
    /// Dof of each ball's gap, then of the tip of each ball that has one, on the process that owns
    /// it.
    pub gaps: &'g [Option<usize>],
    /// Tips of compliant stops, in the order of the tips of `space`.
    pub stops: &'g [Stop],
    /// Forces in the plane.
    pub membrane: Rc<MembraneForces<'g>>,
    /// Arrays of the cells, with the masses that they carry.
    pub cells: Vec<CellArrays>,
    /// Contributions of all effects of the scene.
    pub terms: Contributions,
}

impl<P: Partition> BuildContext<'_, P> {
    /// Returns the communicator of the ranks that build the model.
    pub fn comm(&self) -> &P::Comm {
        self.partition.comm()
    }

    /// Returns the largest values of x, y, -x and -y over all nodes, in m. Collective.
    pub(super) fn farthest(&self) -> [f64; 4] {
        let farthest = |sign: f64, axis: usize| {
            self.mesh.nodes.iter().map(|node| sign * node[axis]).fold(f64::MIN, f64::max)
        };
        let part = [farthest(1.0, 0), farthest(1.0, 1), farthest(-1.0, 0), farthest(-1.0, 1)];
        let parts = self.comm().all_gather_one(part);
        std::array::from_fn(|k| parts.iter().map(|part| part[k]).fold(f64::MIN, f64::max))
    }

    /// Locates a point of the plate, on the one process that evaluates it; `None` on the others.
    /// Collective.
    pub(super) fn spot(&self, key: &str, [x, y]: [f64; 2]) -> Result<Option<PointEvaluation>> {
        let point = Point::new(x, y);
        let Some(cell) = self.mesh.locate_once(self.comm(), key, point)? else { return Ok(None) };
        let of_shape = Probe::in_cell(self.mesh, cell, point, |basis| basis.value)?;
        Ok(Some(PointEvaluation { free: of_shape.within(self.space), of_shape }))
    }

    /// Returns a spring (N/m) or a mass (kg) at a point of the plate, on the one process that
    /// evaluates the point; `None` on the others. Collective.
    pub(super) fn point_term(&self, key: &str, place: [f64; 2], amount: f64) -> Result<Option<PointTerm>> {
        let spot = self.spot(&format!("{key}.at"), place)?;
        Ok(spot.map(|spot| PointTerm { amount, point: place.into(), spot }))
    }

    /// Returns the coefficients of a scene's probe over the engine's dofs, and this process's part
    /// of its values for given shapes. Collective.
    pub fn probe(&self, probe: &scene::Probe, shapes: &[&[f64]]) -> Result<(Probe, Vec<f64>)> {
        let spot = self.spot(&format!("probe \"{}\"", probe.name), probe.at)?;
        let gap = probe.ball.and_then(|ball| self.gaps[ball]);
        self.framed(spot.as_ref().map(|spot| &spot.of_shape), gap, shapes)
    }

    /// Returns the slope along x (0) or y (1) at a scene's probe over the engine's dofs, and this
    /// process's part of its values for given shapes. Collective.
    pub fn slope(&self, probe: &scene::Probe, along: usize, shapes: &[&[f64]]) -> Result<(Probe, Vec<f64>)> {
        let spot = self.spot(&format!("probe \"{}\"", probe.name), probe.at)?;
        let slope = |_| Probe::of_derivative(self.mesh, probe.at.into(), |basis| basis.gradient[along]);
        self.framed(self.comm().all_ok(spot.map(slope).transpose())?.as_ref(), None, shapes)
    }

    /// Returns this process's part of a sum over all deflections and slopes, three per node, and of
    /// a gap, over the engine's dofs and for given shapes. Collective.
    pub fn framed(
        &self,
        of_shape: Option<&Probe>,
        gap: Option<usize>,
        shapes: &[&[f64]],
    ) -> Result<(Probe, Vec<f64>)> {
        let mut local = vec![0.0; self.space.dofs()];
        if let Some(of_shape) = of_shape {
            of_shape.within(self.space).push(1.0, &mut local);
        }
        gap.iter().for_each(|&gap| local[gap] += 1.0);
        let value = |shape: &&[f64]| of_shape.map_or(0.0, |of_shape| of_shape.deflection(shape));
        Ok((Probe::from_weights(&self.partition.add_up(&local)?), shapes.iter().map(value).collect()))
    }

    /// Returns deflection and slopes of a formula of x and y at all nodes, three values per node.
    pub(super) fn shape_of(&self, given: &FieldInput) -> Result<Vec<f64>> {
        let mut shape = Vec::with_capacity(PER_NODE * self.mesh.nodes.len());
        for &node in &self.mesh.nodes {
            shape.extend(given.gradient(node)?);
        }
        Ok(shape)
    }

    /// Returns the tips of compliant stops with their dofs.
    pub(in crate::simulation) fn tips(&self) -> impl Iterator<Item = (&Stop, usize)> {
        self.stops.iter().zip(&self.space.tips).map(|(stop, (dof, _))| (stop, *dof))
    }

    /// Returns the dof of the tip of a ball, if it has one, on the process that owns it.
    pub(in crate::simulation) fn ball_tip(&self, number: usize) -> Option<usize> {
        let attachments = &self.scene.attachments;
        let place = attachments.balls_with_tips().position(|ball| ball == number)?;
        self.gaps[attachments.balls.len() + place]
    }

    /// Returns values over the local dofs at the engine's dofs that this process owns.
    pub(super) fn owned(&self, local: &[f64], dofs: usize) -> Vec<f64> {
        let mut values = vec![0.0; dofs];
        for (dof, value) in local.iter().enumerate() {
            if let Some(dof) = self.partition.own_dof(dof) {
                values[dof] = *value;
            }
        }
        values
    }

    /// Returns the number of bodies beside the plate on all processes. Collective.
    pub(super) fn bodies(&self) -> usize {
        self.comm().all_reduce_sum(self.terms.bodies.len())
    }

    /// Returns the load of a constant pressure on all deflections and slopes, three per node.
    /// Collective.
    pub(super) fn pressed(&self, pressure: &FieldInput) -> Result<Vec<f64>> {
        let (cells, dofs) = (assembly::unheld(self.mesh, &self.cells), PER_NODE * self.mesh.nodes.len());
        if let Some(pressure) = pressure.number() {
            return Ok(assembly::uniform_load(&cells, dofs, pressure));
        }
        let still = pressure.still(0.0);
        let rules = match pressure.is_low() {
            true => Rules::new(),
            false => refinement::rules(&pressure.key, self.mesh, &|_| Some(&still), self.comm())?,
        };
        let integral = || {
            let mut load = vec![0.0; dofs];
            let points = Pressure::new(self.mesh, &cells)?;
            points.load(&rules, |points, values| pressure.values(points, 0.0, values), &mut load)?;
            Ok(load)
        };
        self.comm().all_ok(integral())
    }

    /// Returns the load on the local dofs, given a load on all deflections and slopes, three per
    /// node, then on the gaps.
    pub(super) fn local_load(&self, load: &[f64]) -> Vec<f64> {
        let (of_nodes, of_gaps) = load.split_at(PER_NODE * self.mesh.nodes.len());
        let mut local = self.space.restrict(of_nodes);
        let gaps = self.gaps.iter().zip(of_gaps);
        gaps.for_each(|(gap, value)| gap.iter().for_each(|&gap| local[gap] += value));
        local
    }
}
