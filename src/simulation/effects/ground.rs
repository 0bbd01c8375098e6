//! Where a model is built.

pub(in crate::simulation) use super::super::body::Team;
use crate::assembly::{self, CellArrays, Pressure, Probe};
use crate::element::adaptive::{self, Refined, Rules};
use crate::error::{Error, Result};
use crate::mesh::{Mesh, Point};
use crate::scene::{self, Given, Scene};
use crate::space::{Hold, PER_NODE, Space};
use std::rc::Rc;

/// Adds up what all processes have over their spaces, on the engine's dofs. Collective.
pub(in crate::simulation) type AddUp = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Makes an error of one process that of all, in the midst of a run too: one that left alone would wait for the others to take
/// down with it what they own together. Collective.
pub(in crate::simulation) type Agree = dyn Fn(Result<()>) -> Result<()>;

/// Adds numbers up over all processes. Collective.
pub(in crate::simulation) type Sum = dyn Fn(&[f64]) -> Vec<f64>;

/// Where a model is built: this process's part of the mesh, and how it and the engine's dofs belong together.
pub(in crate::simulation) struct Ground<'g, T: Team> {
    pub scene: &'g Scene,
    pub team: &'g T,
    pub mesh: &'g Mesh,
    /// What supports hold at the nodes.
    pub holds: &'g [Hold],
    /// Dofs of the part of the mesh, and the gaps of balls.
    pub space: &'g Space,
    /// The dof of each ball's gap, on the process that has it.
    pub gaps: &'g [Option<usize>],
    pub cells: &'g [CellArrays],
    /// The engine's number of one of the space's dofs, if this process owns it.
    pub own: &'g dyn Fn(usize) -> Option<usize>,
    /// See there.
    pub add_up: Rc<AddUp>,
    /// See there.
    pub agree: Rc<Agree>,
    /// See there.
    pub sum: Rc<Sum>,
    /// Whether this process owns each node.
    pub owns: &'g dyn Fn(usize) -> bool,
}

/// A point of this process's part of the plate.
#[derive(Clone)]
pub(super) struct Spot {
    /// Its deflection as a sum over the space's dofs.
    pub free: Probe,
    /// Its deflection as a sum over all deflections and slopes of the part, three a node.
    pub of_shape: Probe,
}

impl<T: Team> Ground<'_, T> {
    /// A point of the plate on the process that speaks for it; `None` on the others. Collective.
    pub(super) fn spot(&self, key: &str, [x, y]: [f64; 2]) -> Result<Option<Spot>> {
        let at = Point::new(x, y);
        let here = self.mesh.locate(at).is_some();
        let ranks = self.team.gather(&[f64::from(u8::from(here))]);
        match ranks.iter().position(|&here| here == 1.0) {
            Some(first) if first == self.team.rank() => {
                let of_shape = Probe::of_shape(self.mesh, at)?;
                Ok(Some(Spot { free: of_shape.within(self.space), of_shape }))
            }
            Some(_) => Ok(None),
            None => Err(Error::Mesh(format!("{key}: the point ({x}, {y}) lies outside the plate"))),
        }
    }

    /// What a probe sees, over the engine's dofs, and this process's part of what it sees of shapes. Collective.
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

    /// Deflection and slopes of a formula of place at all nodes, three a node.
    pub(super) fn shape_of(&self, given: &Given) -> Result<Vec<f64>> {
        let mut shape = Vec::with_capacity(PER_NODE * self.mesh.nodes.len());
        for &node in &self.mesh.nodes {
            shape.extend(given.gradient(node)?);
        }
        Ok(shape)
    }

    /// Values over the space's dofs as those of the engine's that this process owns.
    pub(super) fn owned(&self, local: &[f64], dofs: usize) -> Vec<f64> {
        let mut own = vec![0.0; dofs];
        for (dof, value) in local.iter().enumerate() {
            if let Some(dof) = (self.own)(dof) {
                own[dof] = *value;
            }
        }
        own
    }

    /// The load of a pressure that does not change with time, on the space's dofs. Collective.
    pub(super) fn pressed(&self, pressure: &Given) -> Result<Vec<f64>> {
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

    /// Rules of their own on the cells where a field that does not change with time asks for them. Collective.
    fn rules(&self, given: &Given) -> Result<Rules> {
        if given.is_low() {
            return Ok(Rules::new());
        }
        let pieces = self.team.together(assembly::pieces(self.mesh))?;
        let still = given.still(0.0);
        let refined = adaptive::refine(&pieces, &|_| Some(&still), adaptive::ONCE, &*self.sum);
        seen(&given.key, self.team.together(refined)?)
    }
}

/// Share of a field's integral that may stay open where its refinement was given up.
const LEFT: f64 = 0.01;

/// The rules found for a key's field, unless too much of it stays open.
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
