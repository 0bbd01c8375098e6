//! Compliances of the nodes that touch, for the dense problem of friction.

use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::{Engine, Factor, LinearCombination};
use crate::obstacle::Bounds;
use faer::Mat;
use std::collections::{HashMap, HashSet};

/// Largest number of unknowns of the dense problem, reactions and two moments per node, and of the
/// columns that are kept for it.
const MOST_UNKNOWNS: usize = 3000;

/// Inverse of the step matrix in the directions of the bounds and of the slopes: the columns of
/// unit forces that were needed so far, of all ranks.
pub(super) struct ContactCompliances {
    factor: Option<Box<dyn Factor>>,
    /// Dof and part of each direction of this rank: first the bounds, then two slopes per node;
    /// `None` where a support holds it.
    directions: Vec<Option<(usize, f64)>>,
    /// Number of bounds.
    bounds: usize,
    /// Columns by rank and direction of the unit force, each with an entry per direction here.
    columns: HashMap<[usize; 2], Vec<f64>>,
}

impl ContactCompliances {
    /// Prepares the compliance at bounds and at slopes, two per node, each with its dof and factor;
    /// `None` where a support holds it.
    pub fn new(bounds: &Bounds, slopes: impl Iterator<Item = Option<(usize, f64)>>) -> ContactCompliances {
        let deflections = bounds.dofs.iter().map(|&dof| Some((dof, 1.0)));
        let directions = deflections.chain(slopes).collect();
        ContactCompliances { factor: None, directions, bounds: bounds.len(), columns: HashMap::new() }
    }

    /// Returns the directions of the slopes of a node, along x and y.
    pub fn slopes(&self, node: usize) -> [usize; 2] {
        [0, 1].map(|axis| self.bounds + 2 * node + axis)
    }

    /// Gathers directions of all ranks, each with its rank before it. Collective.
    pub fn everywhere(comm: &impl Communicator, local: &[usize]) -> Vec<[usize; 2]> {
        comm.all_gather(&local.iter().map(|&direction| [comm.rank(), direction]).collect::<Vec<_>>())
    }

    /// Solves for the columns of some directions that are not there yet. Collective.
    pub fn extend<E: Engine>(
        &mut self,
        engine: &E,
        matrix: &LinearCombination,
        directions: &[[usize; 2]],
    ) -> Result<()> {
        if directions.len() > MOST_UNKNOWNS {
            return Err(Error::Usage(format!(
                "obstacle.friction: {} reactions and moments act at once, more than the {MOST_UNKNOWNS} that friction is \
                 solved for; expected a coarser mesh, or obstacles that fewer nodes touch",
                directions.len()
            )));
        }
        let fresh = directions.iter().filter(|direction| !self.columns.contains_key(*direction)).count();
        if self.columns.len() + fresh > MOST_UNKNOWNS {
            let wanted: HashSet<&[usize; 2]> = directions.iter().collect();
            self.columns.retain(|direction, _| wanted.contains(direction));
        }
        for &[rank, direction] in directions {
            if self.columns.contains_key(&[rank, direction]) {
                continue;
            }
            let factor = match &mut self.factor {
                Some(factor) => factor,
                none => none.insert(engine.factor(matrix, &[])?),
            };
            let mut x = vec![0.0; engine.dofs()];
            if rank == engine.comm().rank() {
                self.directions[direction].iter().for_each(|&(dof, part)| x[dof] = part);
            }
            factor.solve(&mut x)?;
            let along = |direction: &Option<(usize, f64)>| direction.map_or(0.0, |(dof, part)| part * x[dof]);
            self.columns.insert([rank, direction], self.directions.iter().map(along).collect());
        }
        Ok(())
    }

    /// Returns a block of the compliance over some columns; `rows` are this rank's share of its
    /// rows. Collective.
    pub fn block(&self, comm: &impl Communicator, rows: &[usize], columns: &[[usize; 2]]) -> Mat<f64> {
        let kept: Vec<&Vec<f64>> = columns.iter().map(|column| &self.columns[column]).collect();
        let part: Vec<f64> =
            rows.iter().flat_map(|&row| kept.iter().map(move |column| column[row])).collect();
        let (entries, height) = (comm.all_gather(&part), comm.all_reduce_sum(rows.len()));
        Mat::from_fn(height, columns.len(), |i, j| entries[i * columns.len() + j])
    }
}
