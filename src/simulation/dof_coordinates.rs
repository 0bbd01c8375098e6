//! Positions of the dofs, by which they are numbered independently of the distribution.

use super::effects::BuildContext;
use crate::archive::{self, Numbering, Numbers};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::linalg::Engine;
use crate::motion::Motion;
use crate::partition::Partition;
use crate::scene::{Mass, Scene};
use crate::scheme::Solution;

/// Relative distance, in units of the plate size, below which positions are equal.
const SAME: f64 = 1e-9;

/// Relative distance, in units of the plate size, up to which the dofs of two runs coincide.
const NEAR: f64 = 1e-6;

/// Free deflection at a node, or the tip of a compliant stop there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeflectionDof {
    /// Index of the dof.
    pub dof: usize,
    /// Index of the node in the mesh.
    pub node: usize,
    /// Position, in m.
    pub at: [f64; 2],
    /// Whether the dof is the tip of a compliant stop opposite to the node.
    pub is_tip: bool,
}

/// Positions of the dofs and velocities of a process, by which they are numbered independently of
/// the distribution.
#[derive(Debug, Clone, Default)]
pub struct DofCoordinates {
    /// Position, in m, and index of the dof at its node.
    dofs: Vec<[f64; 3]>,
    /// Centres of the cells and positions of attached masses, in m, or the dofs again for a
    /// consistent mass.
    velocities: Vec<[f64; 3]>,
}

impl DofCoordinates {
    /// Returns the positions for a process's part of a plate, given the engine's numbers of its
    /// dofs.
    pub(super) fn new<P: Partition>(ground: &BuildContext<P>, count: usize) -> DofCoordinates {
        let BuildContext { scene, mesh, space, partition, .. } = *ground;
        let mut dofs = vec![[0.0; 3]; count];
        let mut put = |dof: Option<usize>, [x, y]: [f64; 2], which: usize| {
            if let Some(dof) = dof.and_then(|dof| partition.own_dof(dof)) {
                dofs[dof] = [x, y, which as f64];
            }
        };
        for (number, &node) in mesh.nodes.iter().enumerate() {
            for which in 0..PER_NODE {
                put(space.dof(PER_NODE * number + which).map(|(dof, _)| dof), node.into(), which);
            }
        }
        for (number, (ball, gap)) in scene.attachments.balls.iter().zip(ground.gaps).enumerate() {
            put(*gap, ball.at, PER_NODE + number);
        }
        let (balls, obstacles) = (scene.attachments.balls.len(), scene.obstacles.len());
        for number in 0..balls {
            let which = PER_NODE + balls + obstacles + number;
            put(ground.ball_tip(number), scene.attachments.balls[number].at, which);
        }
        for (stop, dof) in ground.tips() {
            put(Some(dof), mesh.nodes[stop.node].into(), PER_NODE + balls + stop.obstacle);
        }
        let centre = |cell: usize| [mesh.middle(cell).x, mesh.middle(cell).y, 0.0];
        let velocities = match scene.time.mass {
            Mass::Singular => {
                let masses = ground.terms.masses().map(|mass| [mass.point.x, mass.point.y, 1.0]);
                (0..mesh.cells.len()).map(centre).chain(masses).collect()
            }
            Mass::Consistent | Mass::Modal => dofs.clone(),
        };
        DofCoordinates { dofs, velocities }
    }

    /// Returns whether a dof of this process is the deflection of a node.
    pub(super) fn is_deflection(&self, dof: usize) -> bool {
        self.dofs[dof][2] == 0.0
    }

    /// Returns displacement and velocity of all dofs, in the order of their positions, on the first
    /// process. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub(super) fn motion<E: Engine>(
        &self,
        engine: &E,
        scene: &Scene,
        scheme: &mut dyn Solution,
    ) -> Result<Option<Motion>> {
        let rates = scheme.velocity()?;
        let values = scheme.displacement().iter().zip(&rates);
        let rows: Vec<[f64; 5]> =
            self.dofs.iter().zip(values).map(|(&[x, y, which], (u, v))| [x, y, which, *u, *v]).collect();
        let part = (numbers(engine, &self.dofs), rows);
        let parts = engine.comm().gather(&archive::to_bytes(&part)?);
        if parts.is_empty() {
            return Ok(None);
        }
        let mut dofs = Vec::new();
        for part in &parts {
            let (numbers, values): (Numbers, Vec<[f64; 5]>) = archive::from_bytes(part)?;
            dofs.resize(numbers.total, [0.0; 5]);
            numbers.own.iter().zip(values).for_each(|(&number, value)| dofs[number] = value);
        }
        let (step, time) = (scheme.step(), scheme.time());
        Ok(Some(Motion { step, time, supports: scene.supports_in_words(), dofs }))
    }

    /// Returns displacement and velocity of this process's dofs from a motion that all processes
    /// have. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] on all processes where the positions of the dofs differ.
    pub(super) fn start<E: Engine>(&self, engine: &E, motion: &Motion) -> Result<[Vec<f64>; 2]> {
        let Numbers { own: indices, total } = numbers(engine, &self.dofs);
        let extent = motion.dofs.iter().fold(0.0, |extent: f64, [x, y, ..]| extent.max(x.abs()).max(y.abs()));
        let is_there = |number: usize, [x, y, which]: [f64; 3]| {
            let [x_there, y_there, which_there, ..] = motion.dofs[number];
            which == which_there && (x - x_there).abs().max((y - y_there).abs()) <= NEAR * extent
        };
        let elsewhere = total != motion.dofs.len()
            || indices.iter().zip(&self.dofs).any(|(&number, &place)| !is_there(number, place));
        if engine.comm().all_reduce_any(elsewhere) {
            let there = motion.dofs.len();
            return Err(Error::Scene(format!(
                "initial.from: a run on another mesh: its {there} free dofs are not where the {total} of this scene are; \
                 expected the same mesh"
            )));
        }
        Ok([3, 4].map(|which| indices.iter().map(|&number| motion.dofs[number][which]).collect()))
    }

    /// Returns the global numbering of all dofs of this process. Collective.
    pub(super) fn numbering<E: Engine>(&self, engine: &E, bounded: &[usize]) -> Numbering {
        Numbering {
            dofs: numbers(engine, &self.dofs),
            velocities: numbers(engine, &self.velocities),
            bounds: self.bound_numbers(engine, bounded),
        }
    }

    /// Returns the global numbers of the bounded dofs of this process. Collective.
    pub(super) fn bound_numbers<E: Engine>(&self, engine: &E, bounded: &[usize]) -> Numbers {
        let bounds: Vec<[f64; 3]> = bounded.iter().map(|&dof| self.dofs[dof]).collect();
        numbers(engine, &bounds)
    }
}

/// Numbers positions by row, column and dof, independently of the distribution. Collective.
fn numbers<E: Engine>(engine: &E, part: &[[f64; 3]]) -> Numbers {
    let (places, before) = engine.comm().all_gather_with_offset(part);
    let extent = places.iter().fold(0.0, |extent: f64, [x, y, _]| extent.max(x.abs()).max(y.abs()));
    let [columns, lines] = [0, 1].map(|axis| {
        let values: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        ranks(&values, SAME * extent)
    });
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&i| (lines[i], columns[i], places[i][2] as usize));
    let mut numbers = vec![0; places.len()];
    for (number, &i) in order.iter().enumerate() {
        numbers[i] = number;
    }
    Numbers { own: numbers[before..][..part.len()].to_vec(), total: places.len() }
}

/// Returns the rank of each value among the different values, ascending.
fn ranks(values: &[f64], same: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0; values.len()];
    for pair in order.windows(2) {
        ranks[pair[1]] = ranks[pair[0]] + usize::from(values[pair[1]] - values[pair[0]] > same);
    }
    ranks
}
