//! Contact found on coarse meshes, from which wide contact on the finest one starts.
//!
//! An exchange of all violated conditions moves the edge of a contact area by a few rows of nodes,
//! so that a plate thrown flat would take the more of them the finer its mesh. The problem is
//! therefore solved on the coarsest mesh first, to a few digits, and from mesh to mesh its answer
//! starts the next one (a cascadic iteration: F. A. Bornemann and P. Deuflhard, Numerische
//! Mathematik 75 (1996) 135-152). The coarse matrices come from multigrid, and the bounds hold
//! at the nodes that a mesh shares with the finest. A new node touches if all nodes do that its
//! deflection is interpolated from.

use super::hierarchy::{Hierarchy, Step};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::BoundedDofs;
use crate::petsc::{Context, Ksp, Matrix, MultigridLevels, Smoother, Vector};
use std::rc::Rc;

/// Largest number of exchanges on a mesh. Wherever they end, the next mesh goes on from there.
const MOST_EXCHANGES: usize = 16;

/// Weight of the nodes without contact below which all nodes of an interpolation touch.
const NO_WEIGHT: f64 = 1e-6;

/// Problems of the coarse meshes.
pub(super) struct Cascade {
    context: Rc<Context>,
    /// Coarsest first.
    meshes: Vec<CoarseMesh>,
}

/// Problem of a coarse mesh, with its last answer.
struct CoarseMesh {
    system: HeldSystem,
    b: Vector,
    x: Vector,
}

/// Matrix of a coarse mesh, solver with dofs held, and work space.
struct HeldSystem {
    matrix: Matrix,
    /// The same matrix, in which dofs are held, with the levels of its solver.
    held: Matrix,
    solver: Ksp,
    levels: MultigridLevels,
    residual: Vector,
    increment: Vector,
}

/// Dof of each mesh: its number among the bounded dofs of the finest mesh, if it is bounded.
type Numbers = [Option<usize>];

impl Cascade {
    /// Prepares the problems, given the matrix of each coarse mesh, coarsest first, which stays as
    /// it is. Collective.
    ///
    /// # Errors
    /// Returns the errors of PETSc.
    pub fn new(context: &Rc<Context>, coarse: &[Matrix], hierarchy: &Hierarchy) -> Result<Cascade> {
        let interpolations = hierarchy.interpolations();
        let smoother = hierarchy.smoother;
        let mesh = |(number, matrix)| CoarseMesh::new(context, matrix, &interpolations[..number], smoother);
        let meshes = coarse.iter().enumerate().map(mesh).collect::<Result<_>>()?;
        Ok(Cascade { context: context.clone(), meshes })
    }

    /// Sets an unknown of the finest mesh to start from, and the bounds that it is likely to touch,
    /// for the right-hand side b. Collective.
    ///
    /// # Errors
    /// Returns the errors of PETSc.
    pub fn find(
        &mut self,
        steps: &[Step],
        b: &Vector,
        bounded: &BoundedDofs,
        x: &mut Vector,
        sides: &mut [i8],
    ) -> Result<()> {
        let mut numbers = vec![None; b.local_size()];
        bounded.dofs.iter().enumerate().for_each(|(bound, &dof)| numbers[dof] = Some(bound));
        let problem = LevelContact { comm: self.context.comm(), bounded, b, numbers: &numbers };
        problem.start(&mut self.meshes, steps, x, sides)
    }
}

/// Contact problem of a mesh.
struct LevelContact<'p, C: Communicator> {
    comm: &'p C,
    bounded: &'p BoundedDofs<'p>,
    b: &'p Vector,
    numbers: &'p Numbers,
}

impl<C: Communicator> LevelContact<'_, C> {
    /// Sets an unknown to start from, and the bounds that it touches, by the answer of the next
    /// coarser mesh. Collective.
    fn start(
        &self,
        coarser: &mut [CoarseMesh],
        steps: &[Step],
        x: &mut Vector,
        sides: &mut [i8],
    ) -> Result<()> {
        let (Some((mesh, coarser)), Some((step, steps))) = (coarser.split_last_mut(), steps.split_last())
        else {
            return x.fill(0.0);
        };
        let CoarseMesh { system, b, x: coarse_x } = mesh;
        let mut numbers = vec![None; b.local_size()];
        step.shared.iter().for_each(|&[fine, coarse]| numbers[coarse] = self.numbers[fine]);
        step.interpolation.multiply_transposed(self.b, b)?;
        let problem = LevelContact { b, numbers: &numbers, ..*self };
        problem.start(coarser, steps, coarse_x, sides)?;
        system.solve(&problem, coarse_x, sides)?;
        self.spread_contact(step, &numbers, &mut system.increment, x, sides)?;
        step.interpolation.multiply(coarse_x, x)
    }

    /// Lets the nodes that the coarse mesh does not have touch where all do that they are
    /// interpolated from. `weights` and `sums` are work space on the coarse mesh and on this one.
    /// Collective.
    fn spread_contact(
        &self,
        step: &Step,
        coarse: &Numbers,
        weights: &mut Vector,
        sums: &mut Vector,
        sides: &mut [i8],
    ) -> Result<()> {
        let mut is_new: Vec<bool> = self.numbers.iter().map(Option::is_some).collect();
        step.shared.iter().for_each(|&[fine, _]| is_new[fine] = false);
        let new = || self.numbers.iter().zip(&is_new).map(|(bound, is_new)| bound.filter(|_| *is_new));
        new().flatten().for_each(|bound| sides[bound] = 0);
        for (side, limits) in [-1, 1].into_iter().zip(self.bounded.limits) {
            weights.fill(0.0)?;
            weights.with_local_mut(|weights| {
                for &[_, node] in &step.shared {
                    let touches = coarse[node].is_some_and(|bound| sides[bound] == side);
                    weights[node] = f64::from(u8::from(!touches));
                }
            })?;
            step.interpolation.multiply(weights, sums)?;
            sums.with_local(|sums| {
                for (bound, sum) in new().zip(sums) {
                    let Some(bound) = bound.filter(|&bound| limits[bound].is_finite()) else { continue };
                    if sum.abs() < NO_WEIGHT {
                        sides[bound] = side;
                    }
                }
            })?;
        }
        Ok(())
    }
}

impl CoarseMesh {
    fn new(
        context: &Rc<Context>,
        matrix: &Matrix,
        interpolations: &[&Matrix],
        smoother: Smoother,
    ) -> Result<CoarseMesh> {
        let mut held = matrix.duplicate()?;
        held.set_positive_definite()?;
        let mut solver = Ksp::new(context, "")?;
        let levels = solver.default_to_multigrid(&held, interpolations, smoother)?;
        solver.set_operator(&held)?;
        solver.set_from_options()?;
        solver.set_up()?;
        let vector = || matrix.vector();
        let (residual, increment) = (vector()?, vector()?);
        let system = HeldSystem { matrix: matrix.share()?, held, solver, levels, residual, increment };
        Ok(CoarseMesh { system, b: vector()?, x: vector()? })
    }
}

impl HeldSystem {
    /// Exchanges all bounds that violate a condition, from the unknown x on, until none does or
    /// there have been many exchanges. Collective.
    fn solve<C: Communicator>(
        &mut self,
        problem: &LevelContact<C>,
        x: &mut Vector,
        sides: &mut [i8],
    ) -> Result<()> {
        let LevelContact { comm, bounded: BoundedDofs { limits: [lower, upper], .. }, b, numbers } = problem;
        let places = numbers.iter().enumerate().filter_map(|(dof, bound)| Some((dof, (*bound)?)));
        let places: Vec<(usize, usize)> = places.collect();
        let HeldSystem { matrix, held, solver, levels, residual, increment } = self;
        for _ in 0..MOST_EXCHANGES {
            let touching: Vec<(usize, usize)> =
                places.iter().copied().filter(|&(_, bound)| sides[bound] != 0).collect();
            let dofs: Vec<usize> = touching.iter().map(|(dof, _)| *dof).collect();
            solver.hold(held, levels, &dofs)?;
            let value = |bound: usize| if sides[bound] < 0 { lower[bound] } else { upper[bound] };
            x.with_local_mut(|x| touching.iter().for_each(|&(dof, bound)| x[dof] = value(bound)))?;
            matrix.multiply(x, residual)?;
            residual.scale(-1.0)?;
            residual.add_scaled(1.0, b)?;
            residual.with_local_mut(|residual| dofs.iter().for_each(|&dof| residual[dof] = 0.0))?;
            solver.solve_roughly(residual, increment)?;
            x.add_scaled(1.0, increment)?;
            matrix.multiply(x, residual)?;
            residual.add_scaled(-1.0, b)?;
            let mut exchanges = 0;
            x.with_local(|x| {
                residual.with_local(|force| {
                    for &(dof, bound) in &places {
                        let (low, high) = (lower[bound], upper[bound]);
                        let pulls = f64::from(sides[bound]) * force[dof] > 0.0 && low < high;
                        let next = match sides[bound] {
                            0 if x[dof] < low => -1,
                            0 if x[dof] > high => 1,
                            _ if pulls => 0,
                            side => side,
                        };
                        exchanges += usize::from(next != sides[bound]);
                        sides[bound] = next;
                    }
                })
            })??;
            if comm.all_reduce_sum(exchanges) == 0 {
                break;
            }
        }
        Ok(())
    }
}
