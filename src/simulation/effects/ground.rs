//! Build context of a model.

pub(in crate::simulation) use super::super::body::Communicator;
use crate::assembly::{self, CellArrays, Pressure, Probe};
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::element::adaptive::{self, Refined, Rules};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use crate::scene::{self, FieldInput, Scene};
use std::rc::Rc;

/// Function that sums the contributions of all processes over their dofs, on the engine's dofs.
/// Collective.
pub(in crate::simulation) type AddUp = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Function that turns an error on one rank into an error on all ranks, so that none destroys a
/// shared PETSc object alone and deadlocks. Collective.
pub(in crate::simulation) type Agree = dyn Fn(Result<()>) -> Result<()>;

/// Function that sums numbers over all processes. Collective.
pub(in crate::simulation) type Sum = dyn Fn(&[f64]) -> Vec<f64>;

/// Build context of a model: this process's part of the mesh, and the relation of its dofs to those
/// of the engine.
pub(in crate::simulation) struct BuildContext<'g, T: Communicator> {
    pub scene: &'g Scene,
    pub team: &'g T,
    pub mesh: &'g Mesh,
    /// Constraints of the supports at the nodes.
    pub holds: &'g [NodeConstraint],
    /// Dofs of this part of the mesh, and the gaps of balls.
    pub space: &'g DofMap,
    /// Dof of each ball's gap, on the process that owns it.
    pub gaps: &'g [Option<usize>],
    pub cells: &'g [CellArrays],
    /// Function that maps a local dof to the engine's dof, if this process owns it.
    pub own: &'g dyn Fn(usize) -> Option<usize>,
    /// Sum over processes, see [`AddUp`].
    pub add_up: Rc<AddUp>,
    /// Agreement on errors, see [`Agree`].
    pub agree: Rc<Agree>,
    /// Sum of numbers, see [`Sum`].
    pub sum: Rc<Sum>,
    /// Function that tells whether this process owns a node.
    pub owns: &'g dyn Fn(usize) -> bool,
}

/// Evaluation of the deflection at a point of this process's part of the plate.
#[derive(Clone)]
pub(super) struct PointEvaluation {
    /// Deflection as a linear combination of the free dofs.
    pub free: Probe,
    /// Deflection as a linear combination of all deflections and slopes of the part, three per
    /// node.
    pub of_shape: Probe,
}

impl<T: Communicator> BuildContext<'_, T> {
    /// Locates a point of the plate, on the one process that evaluates it; `None` on the others.
    /// Collective.
    pub(super) fn spot(&self, key: &str, [x, y]: [f64; 2]) -> Result<Option<PointEvaluation>> {
        let at = Point::new(x, y);
        let here = self.mesh.locate(at).is_some();
        let ranks = self.team.gather(&[f64::from(u8::from(here))]);
        match ranks.iter().position(|&here| here == 1.0) {
            Some(first) if first == self.team.rank() => {
                let of_shape = Probe::of_shape(self.mesh, at)?;
                Ok(Some(PointEvaluation { free: of_shape.within(self.space), of_shape }))
            }
            Some(_) => Ok(None),
            None => Err(Error::Mesh(format!("{key}: the point ({x}, {y}) lies outside the plate"))),
        }
    }

    /// Returns the coefficients of a scene's probe over the engine's dofs, and this process's part
    /// of its values for given shapes. Collective.
    pub fn probe(&self, probe: &scene::Probe, shapes: &[&[f64]]) -> Result<(Probe, Vec<f64>)> {
        let spot = self.spot(&format!("probe \"{}\"", probe.name), probe.at)?;
        let mut local = vec![0.0; self.space.dofs()];
        if let Some(spot) = &spot {
            spot.free.push(1.0, &mut local);
        }
        if let Some(gap) = probe.ball.and_then(|ball| self.gaps[ball]) {
            local[gap] += 1.0;
        }
        let of = |shape: &&[f64]| spot.as_ref().map_or(0.0, |spot| spot.of_shape.deflection(shape));
        Ok((Probe::from_weights(&(self.add_up)(&local)?), shapes.iter().map(of).collect()))
    }

    /// Returns deflection and slopes of a formula of x and y at all nodes, three values per node.
    pub(super) fn shape_of(&self, given: &FieldInput) -> Result<Vec<f64>> {
        let mut shape = Vec::with_capacity(PER_NODE * self.mesh.nodes.len());
        for &node in &self.mesh.nodes {
            shape.extend(given.gradient(node)?);
        }
        Ok(shape)
    }

    /// Converts values over the local dofs to those over the engine's dofs that this process owns.
    pub(super) fn owned(&self, local: &[f64], dofs: usize) -> Vec<f64> {
        let mut own = vec![0.0; dofs];
        for (dof, value) in local.iter().enumerate() {
            if let Some(dof) = (self.own)(dof) {
                own[dof] = *value;
            }
        }
        own
    }

    /// Returns the load of a constant pressure, on the local dofs. Collective.
    pub(super) fn pressed(&self, pressure: &FieldInput) -> Result<Vec<f64>> {
        let dofs = self.space.dofs();
        if let Some(pressure) = pressure.number() {
            return Ok(assembly::uniform_load(self.cells, dofs, pressure));
        }
        let rules = self.rules(pressure)?;
        let integral = || {
            let mut load = vec![0.0; dofs];
            let points = Pressure::new(self.mesh, self.cells)?;
            points.load_by(&rules, |points, values| pressure.values(points, 0.0, values), &mut load)?;
            Ok(load)
        };
        self.team.together(integral())
    }

    /// Returns special quadrature rules for cells in which a constant field needs them. Collective.
    fn rules(&self, given: &FieldInput) -> Result<Rules> {
        if given.is_low() {
            return Ok(Rules::new());
        }
        let pieces = self.team.together(assembly::pieces(self.mesh))?;
        let still = given.still(0.0);
        let refined = adaptive::refine(&pieces, &|_| Some(&still), adaptive::ONCE, &*self.sum);
        seen(&given.key, self.team.together(refined)?)
    }
}

/// Largest uncertain part of a field's integral that is accepted where its refinement stopped.
const LEFT: f64 = 0.01;

/// Returns the quadrature rules found for the field of a key, or an error where too much of its
/// integral is uncertain.
pub(in crate::simulation) fn seen(key: &str, refined: Refined) -> Result<Rules> {
    let Refined { rules, size, left, .. } = refined;
    if left <= LEFT * size {
        return Ok(rules);
    }
    Err(Error::Scene(format!(
        "{key}: its integral over the plate is {size:.3e}, of which {left:.3e} are not certain after all refinement; expected a \
         formula whose jumps and peaks are wider, or a finer mesh"
    )))
}
