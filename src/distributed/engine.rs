//! Linear algebra over all ranks: products cell by cell, factors by substructures or by PETSc.

use super::assembled::assembled;
use super::exchange::DofExchange;
use super::factor::{PetscFactor, SolverKind, SystemSolver};
use super::hierarchy::Hierarchy;
use super::part::Part;
use super::products::{CellOperator, CellProducts};
use super::replicated::ReplicatedFactor;
use super::substructure::{Substructure, SubstructuredFactor};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::linalg::vectors::dot;
use crate::linalg::{
    Engine, Factor, Form, Indefinite, LinearCombination, LinearMethod, LinearSolves, MOST_SPOILT, Native,
    RowCoupling, SingularMassCells, estimate_factor_error, precise_entries,
};
use crate::petsc::{Context, Index, Ksp, Matrix, Plex, Vector, WorldComm};
use faer::Mat;
use std::borrow::Cow;
use std::cell::Cell;
use std::rc::Rc;

/// Prefix of the options of the solver whose factor counts eigenvalues, and the options with which
/// MUMPS counts negative pivots, on any number of ranks.
const COUNT: &str = "count_";
const COUNTING: [&str; 2] = ["mat_mumps_icntl_13", "mat_mumps_icntl_24"];

/// Linear algebra over all ranks: products cell by cell, factors by substructures or by PETSc.
///
/// Each rank multiplies with its own cells. Vectors hold the free dofs of the nodes that a rank
/// owns, in PETSc's order.
pub struct Distributed {
    context: Rc<Context>,
    plex: Rc<Plex>,
    /// Interpolation from coarser meshes, where these are kept.
    hierarchy: Option<Rc<Hierarchy>>,
    pub(super) products: Rc<CellProducts>,
    part: Rc<Substructure>,
    /// Systems that iterations have solved.
    solves: Rc<Cell<LinearSolves>>,
    /// Position of each local dof in global vectors; negative for a constrained dof.
    global: Vec<Index>,
    /// Position of this rank's first dof in global vectors, and the number of its dofs.
    first: usize,
    owned: usize,
    /// Rigid motions of the plate (a translation and two tilts), over the dofs that this rank owns.
    rigid: [Vec<f64>; 3],
    /// Whether free dofs come in threes on every rank: no extra dof, no partly constrained node.
    whole_nodes: bool,
}

impl Distributed {
    /// Creates the engine of a plate. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(part: &Part) -> Result<Distributed> {
        let plex = part.plex.clone();
        let context = plex.context().clone();
        let global = plex.global_dofs()?;
        let vector = plex.global_vector()?;
        let (first, owned) = (vector.range().start as usize, vector.local_size());
        let cells = Native::with_layout(part.space.layout(&part.mesh));
        let exchange = DofExchange::new(context.comm(), &global, first, owned);
        let products = Rc::new(CellProducts::new(exchange, cells));
        let mut engine = Distributed {
            part: Rc::new(Substructure::new(context.comm(), &products, &global)),
            context,
            plex,
            hierarchy: part.hierarchy.clone(),
            products,
            solves: Rc::default(),
            global,
            first,
            owned,
            rigid: [(); 3].map(|()| vec![0.0; owned]),
            whole_nodes: false,
        };
        engine.set_rigid_motions(part);
        Ok(engine)
    }

    /// Sets the deflections and slopes of the translation and of the tilts along x and y.
    /// Collective.
    fn set_rigid_motions(&mut self, part: &Part) {
        let mut whole = self.global.len() == PER_NODE * part.mesh.nodes.len();
        for (node, point) in part.mesh.nodes.iter().enumerate() {
            let motions = [[1.0, 0.0, 0.0], [point.x, 1.0, 0.0], [point.y, 0.0, 1.0]];
            let Some(first) = part.space.deflection(node) else { continue };
            let dofs = [0, 1, 2].map(|k| self.own_dof(first + k));
            whole &= dofs.iter().all(Option::is_some) || dofs.iter().all(Option::is_none);
            for (k, dof) in dofs.iter().enumerate() {
                if let Some(dof) = *dof {
                    self.rigid.iter_mut().zip(motions).for_each(|(rigid, motion)| rigid[dof] = motion[k]);
                }
            }
        }
        for &(tip, node) in &part.space.tips {
            if let Some(tip) = self.own_dof(tip) {
                let point = part.mesh.nodes[node];
                self.rigid.iter_mut().zip([1.0, point.x, point.y]).for_each(|(rigid, w)| rigid[tip] = w);
            }
        }
        self.whole_nodes = self.context.comm().all_reduce_all(whole);
    }

    /// Sets the near null space of a matrix, and its block size where dofs come in threes.
    /// Collective.
    ///
    /// Algebraic multigrid needs both.
    fn prepare_for_algebraic_multigrid(&self, matrix: &mut Matrix) -> Result<()> {
        if self.whole_nodes {
            matrix.set_block_size(PER_NODE)?;
        }
        let vector = |values: &Vec<f64>| {
            let mut vector = self.vector()?;
            vector.set_local(values)?;
            Ok(vector)
        };
        matrix.set_near_null_space(self.rigid.iter().map(vector).collect::<Result<_>>()?)
    }

    /// Returns the context of MPI and PETSc.
    pub fn context(&self) -> &Rc<Context> {
        &self.context
    }

    /// Returns the native engine of this rank's cells over local dofs, which creates forms.
    pub fn cells(&self) -> &Native {
        &self.products.cells
    }

    /// Creates a global vector of zeros.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn vector(&self) -> Result<Vector> {
        self.plex.global_vector()
    }

    /// Returns this rank's index of a local dof, if the rank owns it and it is free.
    pub fn own_dof(&self, local: usize) -> Option<usize> {
        let dof = usize::try_from(self.global[local]).ok()?.checked_sub(self.first)?;
        (dof < self.owned).then_some(dof)
    }

    /// Adds up the contributions of all ranks over their local dofs. Collective.
    pub fn add_up(&self, local: &[f64], sums: &mut [f64]) {
        self.products.add_up(local, sums);
    }

    /// Assembles the matrix of a positive definite linear combination of forms. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn matrix(&self, sum: &LinearCombination) -> Result<Matrix> {
        let mut matrix = self.symmetric_matrix(sum, false)?;
        matrix.set_positive_definite()?;
        Ok(matrix)
    }

    /// Assembles the matrix of a linear combination of forms, as a sum of the matrices of the
    /// ranks' cells where the solver needs them by themselves. Collective.
    fn symmetric_matrix(&self, sum: &LinearCombination, of_subdomains: bool) -> Result<Matrix> {
        assembled(&self.context, (&self.global, self.owned), sum, of_subdomains)
    }

    /// Factors a sum of forms with twice the digits, in full on each rank. Collective.
    fn replicated(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Box<dyn Factor>> {
        let entries = precise_entries(sum, |local| usize::try_from(self.global[local]).ok());
        let range = self.first..self.first + self.owned;
        let factor = ReplicatedFactor::new(&self.context, &entries, range, contact_dofs)?;
        Ok(Box::new(factor))
    }

    /// Factors a sum of forms, or prepares the iteration that the options choose, whatever digits
    /// rounding takes. Collective.
    fn factor_in_doubles(
        &self,
        linear: SystemSolver,
        sum: &LinearCombination,
        contact_dofs: &[usize],
    ) -> Result<Box<dyn Factor>> {
        if let SolverKind::Substructures = linear.kind {
            let factor = SubstructuredFactor::new(&self.part, sum, contact_dofs, &self.context)?;
            if let Some(factor) = factor {
                return Ok(Box::new(factor));
            }
        }
        let mut matrix = self.symmetric_matrix(sum, matches!(linear.kind, SolverKind::Subdomains))?;
        matrix.set_positive_definite()?;
        if linear.method() == LinearMethod::Iterative {
            self.prepare_for_algebraic_multigrid(&mut matrix)?;
        }
        let operator = CellOperator::new(&self.products, self.owned, sum);
        Ok(Box::new(PetscFactor::new(&self.context, matrix, operator, linear, self.solves.clone())?))
    }
}

impl Engine for Distributed {
    type Comm = WorldComm;

    fn comm(&self) -> &WorldComm {
        self.context.comm()
    }

    fn dofs(&self) -> usize {
        self.owned
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64> {
        Ok(self.context.comm().all_reduce_sum_unordered(dot(x, y)))
    }

    fn to_local<'x>(&self, x: &'x [f64]) -> Result<Cow<'x, [f64]>> {
        Ok(self.products.with_local(x, |local| Cow::Owned(local.to_vec())))
    }

    fn multiply_cells(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        let value =
            self.products.through_cells(x, [y], |x, [y, _]| self.cells().multiply_cells(form, x, y))?;
        Ok(self.context.comm().all_reduce_sum_unordered(value))
    }

    fn cell_velocities(&self, mass: &SingularMassCells, x: &[f64], v: &mut [f64]) -> Result<()> {
        self.products.with_local(x, |x| self.cells().cell_velocities(mass, x, v))
    }

    fn cell_momenta(&self, mass: &SingularMassCells, v: &[f64], y: &mut [f64]) -> Result<()> {
        let mut local = vec![0.0; self.global.len()];
        self.cells().cell_momenta(mass, v, &mut local)?;
        self.add_up(&local, y);
        Ok(())
    }

    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<()> {
        self.products
            .through_cells(x, products, |x, [y, m]| self.cells().multiply_with_magnitude(sum, x, [y, m]))
    }

    fn multiply_with_part(
        &self,
        sum: &LinearCombination,
        part: &Form,
        x: &[f64],
        products: [&mut [f64]; 2],
    ) -> Result<bool> {
        let product =
            |x: &[f64], [y, z]: &mut [Vec<f64>; 2]| self.cells().multiply_with_part(sum, part, x, [y, z]);
        Ok(!sum.has_modes() && self.products.through_cells(x, products, product)?)
    }

    fn couplings(&self, sum: &LinearCombination) -> Result<Vec<RowCoupling>> {
        let local = self.cells().couplings(sum)?;
        let magnitudes: Vec<f64> = local.iter().map(|coupling| coupling.magnitude).collect();
        let mut sums = vec![0.0; self.owned];
        self.add_up(&magnitudes, &mut sums);
        let mut couplings = vec![RowCoupling::default(); self.owned];
        for (dof, coupling) in local.iter().enumerate().filter(|(_, coupling)| coupling.magnitude > 0.0) {
            if let (Some(dof), Some(to)) = (self.own_dof(dof), self.own_dof(coupling.to as usize)) {
                couplings[dof] = RowCoupling { to: to as u32, magnitude: sums[dof] };
            }
        }
        Ok(couplings)
    }

    fn diagonal(&self, sum: &LinearCombination) -> Result<Vec<f64>> {
        let mut diagonal = vec![0.0; self.owned];
        self.add_up(&self.cells().diagonal(sum)?, &mut diagonal);
        Ok(diagonal)
    }

    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<Box<dyn Factor>> {
        let linear = SystemSolver::new(&self.context, "", self.hierarchy.as_ref())?;
        let is_direct = linear.method() == LinearMethod::Direct;
        let factor = self.factor_in_doubles(linear, sum, contact_dofs);
        let is_indefinite = matches!(factor, Err(Error::Singular(_)));
        if is_direct && self.comm().all_reduce_any(is_indefinite) {
            return self.replicated(sum, contact_dofs);
        }
        let mut factor = factor?;
        // How many digits MUMPS loses depends on the kernels of BLAS. What is left may do where a
        // factor with twice the digits does not fit.
        if is_direct {
            let error = estimate_factor_error(self, sum, factor.as_mut())?;
            if (error > MOST_SPOILT || error.is_nan())
                && let Ok(factor) = self.replicated(sum, contact_dofs)
            {
                return Ok(factor);
            }
        }
        Ok(factor)
    }

    fn linear_solves(&self) -> LinearSolves {
        self.solves.get()
    }

    /// Factors by MUMPS as L D L^T; the options of this solver have the prefix `count_`. Returns
    /// `None` where they choose no factorisation.
    fn factor_beyond(&self, k: &Form, m: &Form, sigma: f64) -> Result<Option<Indefinite>> {
        for name in COUNTING {
            self.context.default_option(&format!("{COUNT}{name}"), "1")?;
        }
        let mut solver = Ksp::new(&self.context, COUNT)?;
        if !solver.is_direct()? {
            return Ok(None);
        }
        solver.default_to_cholesky()?;
        solver.set_operator(&self.symmetric_matrix(&(k + m * -sigma), false)?)?;
        solver.set_from_options()?;
        solver.set_up()?;
        let [negative, _, _] = solver.inertia()?;
        let mut right = Vector::new(&self.context, self.owned)?;
        let mut solution = right.duplicate()?;
        let solve = move |x: &mut Mat<f64>| {
            for mut column in x.col_iter_mut() {
                let column = column.as_mut().try_as_col_major_mut().expect("a dense column").as_slice_mut();
                right.set_local(column)?;
                solver.solve(&right, &mut solution)?;
                solution.with_local(|values| column.copy_from_slice(values))?;
            }
            Ok(())
        };
        Ok(Some(Indefinite { negative, solve: Box::new(solve) }))
    }
}
