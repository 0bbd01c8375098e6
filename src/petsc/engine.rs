//! Linear algebra over all ranks: products cell by cell, factors and solves by PETSc.
//!
//! Each rank multiplies with its own cells. Vectors hold the free dofs of the nodes that a rank
//! owns, in PETSc's order. A product is that of the native engine over the dofs of the rank's cells
//! (and thus avoids the loss of h^-4 relative accuracy), with an exchange of shared dofs before and
//! after.

use super::plate::Part;
use super::{Comm, Context, Index, Ksp, Matrix, Plex, Vector, WorldComm};
use crate::archive::Archive;
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::vectors::{add, axpy, dot};
use crate::linalg::{Engine, Factor, Form, LinearCombination, Native};
use faer::Mat;
use faer::linalg::solvers::{DenseSolveCore, Solve};
use std::cell::RefCell;
use std::rc::Rc;

/// Number of columns of the inverse computed at once.
const BLOCK: usize = 64;

/// Linear algebra over all ranks; see the [module page](self).
pub struct Distributed {
    context: Rc<Context>,
    plex: Rc<Plex>,
    /// Native engine of this rank's cells, on local vectors.
    cells: Native,
    /// Position of each local dof in global vectors; negative for a constrained dof.
    global: Vec<Index>,
    /// Position of this rank's first dof in global vectors, and the number of its dofs.
    first: usize,
    own: usize,
    work: RefCell<Work>,
    /// Rigid motions of the plate (a translation and two tilts), over the dofs that this rank owns.
    rigid: [Vec<f64>; 3],
    /// Whether free dofs come in threes on every rank: no extra dof, no partly constrained node.
    whole_nodes: bool,
}

struct Work {
    global: Vector,
    /// Input of products in local vectors: zero at constrained dofs.
    read: Vector,
    /// Output of products in local vectors.
    given: Vector,
    x: Vec<f64>,
    y: Vec<f64>,
    m: Vec<f64>,
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
        let (first, own) = (vector.range().start as usize, vector.local_size());
        let zeros = || vec![0.0; global.len()];
        let (read, given) = (plex.local_vector()?, plex.local_vector()?);
        let work = Work { global: vector, read, given, x: zeros(), y: zeros(), m: zeros() };
        let cells = Native::with_layout(part.space.layout(&part.mesh));
        let mut engine = Distributed {
            context,
            plex,
            cells,
            global,
            first,
            own,
            work: RefCell::new(work),
            rigid: [(); 3].map(|()| vec![0.0; own]),
            whole_nodes: false,
        };
        engine.note_rigid_motions(part);
        Ok(engine)
    }

    /// Fills in deflections and slopes of the translation and of the tilts along x and y.
    /// Collective.
    fn note_rigid_motions(&mut self, part: &Part) {
        let first = self.global.len() - PER_NODE * part.mesh.nodes.len();
        let mut whole = first == 0;
        for (node, point) in part.mesh.nodes.iter().enumerate() {
            let motions = [[1.0, 0.0, 0.0], [point.x, 1.0, 0.0], [point.y, 0.0, 1.0]];
            let dofs = [0, 1, 2].map(|k| self.own_dof(first + PER_NODE * node + k));
            whole &= dofs.iter().all(Option::is_some) || dofs.iter().all(Option::is_none);
            for (k, dof) in dofs.iter().enumerate() {
                if let Some(dof) = *dof {
                    self.rigid.iter_mut().zip(motions).for_each(|(rigid, motion)| rigid[dof] = motion[k]);
                }
            }
        }
        self.whole_nodes = self.context.comm().all_reduce_all(whole);
    }

    /// Sets the near null space of a matrix, and its block size where dofs come in threes.
    /// Collective.
    ///
    /// Multigrid needs both.
    fn prepare_for_multigrid(&self, matrix: &mut Matrix) -> Result<()> {
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
        &self.cells
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
        (dof < self.own).then_some(dof)
    }

    /// Adds up the contributions of all ranks over their local dofs. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn add_up(&self, local: &[f64], own: &mut [f64]) -> Result<()> {
        let Work { global, given, .. } = &mut *self.work.borrow_mut();
        self.to_owners(local, own, global, given)
    }

    /// Creates an adder of contributions, which does not borrow the engine. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn adder(&self) -> Result<Adder> {
        let vectors = RefCell::new((self.plex.global_vector()?, self.plex.local_vector()?));
        Ok(Adder { plex: self.plex.clone(), own: self.own, vectors })
    }

    /// Assembles the matrix of a linear combination of forms. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn matrix(&self, sum: &LinearCombination) -> Result<Matrix> {
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for (scale, form) in sum.terms() {
            form.for_each_lower(|row, column, value| {
                let mut add = |row: usize, column: usize| {
                    rows.push(self.global[row]);
                    columns.push(self.global[column]);
                    values.push(scale * value);
                };
                add(row, column);
                if row != column {
                    add(column, row);
                }
            });
        }
        let mut matrix =
            Matrix::from_triplets(&self.context, Comm::World, self.own, &rows, &columns, &values)?;
        matrix.set_positive_definite()?;
        Ok(matrix)
    }

    /// Gathers the values of a vector at this rank's local dofs.
    fn to_local(&self, own: &[f64], values: &mut [f64], all: &mut Vector, local: &mut Vector) -> Result<()> {
        all.set_local(own)?;
        self.plex.to_local(all, local)?;
        local.copy_to(values)
    }

    fn to_owners(&self, values: &[f64], own: &mut [f64], all: &mut Vector, local: &mut Vector) -> Result<()> {
        local.set_local(values)?;
        all.fill(0.0)?;
        self.plex.add_to_global(local, all)?;
        all.copy_to(own)
    }
}

/// Adder of the contributions of all ranks over their local dofs; see [`Distributed::adder`].
pub struct Adder {
    plex: Rc<Plex>,
    /// Number of dofs that this rank owns.
    own: usize,
    /// Global and local vector.
    vectors: RefCell<(Vector, Vector)>,
}

impl Adder {
    /// Returns the sums at the dofs that this rank owns, as [`Distributed::add_up`] does.
    /// Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn add_up(&self, values: &[f64]) -> Result<Vec<f64>> {
        let (all, local) = &mut *self.vectors.borrow_mut();
        let mut sums = vec![0.0; self.own];
        local.set_local(values)?;
        all.fill(0.0)?;
        self.plex.add_to_global(local, all)?;
        all.copy_to(&mut sums)?;
        Ok(sums)
    }
}

impl Engine for Distributed {
    type Factor = DistributedFactor;
    type Comm = WorldComm;

    fn comm(&self) -> &WorldComm {
        self.context.comm()
    }

    fn dofs(&self) -> usize {
        self.own
    }

    fn dot(&self, x: &[f64], y: &[f64]) -> Result<f64> {
        Ok(self.context.comm().all_reduce_sum_unordered(dot(x, y)))
    }

    fn to_local(&self, x: &[f64]) -> Result<Vec<f64>> {
        let Work { global, read, x: xl, .. } = &mut *self.work.borrow_mut();
        self.to_local(x, xl, global, read)?;
        Ok(xl.clone())
    }

    fn multiply(&self, form: &Form, x: &[f64], y: &mut [f64]) -> Result<f64> {
        let Work { global, read, given, x: xl, y: yl, .. } = &mut *self.work.borrow_mut();
        self.to_local(x, xl, global, read)?;
        let value = self.cells.multiply(form, xl, yl)?;
        self.to_owners(yl, y, global, given)?;
        Ok(self.context.comm().all_reduce_sum_unordered(value))
    }

    fn multiply_with_magnitude(
        &self,
        sum: &LinearCombination,
        x: &[f64],
        y: &mut [f64],
        m: &mut [f64],
    ) -> Result<()> {
        let Work { global, read, given, x: xl, y: yl, m: ml } = &mut *self.work.borrow_mut();
        self.to_local(x, xl, global, read)?;
        self.cells.multiply_with_magnitude(sum, xl, yl, ml)?;
        self.to_owners(yl, y, global, given)?;
        self.to_owners(ml, m, global, given)
    }

    fn velocities(&self, mass: &Form) -> usize {
        match mass {
            Form::Cells(_) => self.own,
            Form::SingularMassCells(averages) => averages.cells(),
        }
    }

    fn is_singular(&self, mass: &Form) -> bool {
        matches!(mass, Form::SingularMassCells(_))
    }

    fn project(&self, mass: &Form, x: &[f64], v: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => v.copy_from_slice(x),
            Form::SingularMassCells(_) => {
                let Work { global, read, x: xl, .. } = &mut *self.work.borrow_mut();
                self.to_local(x, xl, global, read)?;
                self.cells.project(mass, xl, v)?;
            }
        }
        Ok(())
    }

    fn project_transpose(&self, mass: &Form, v: &[f64], y: &mut [f64]) -> Result<()> {
        match mass {
            Form::Cells(_) => {
                self.multiply(mass, v, y)?;
            }
            Form::SingularMassCells(_) => {
                let Work { global, given, y: yl, .. } = &mut *self.work.borrow_mut();
                self.cells.project_transpose(mass, v, yl)?;
                self.to_owners(yl, y, global, given)?;
            }
        }
        Ok(())
    }

    fn mass_norm_squared(&self, mass: &Form, v: &[f64]) -> Result<f64> {
        match mass {
            Form::Cells(_) => self.multiply(mass, v, &mut vec![0.0; self.own]),
            Form::SingularMassCells(_) => {
                let own = self.cells.mass_norm_squared(mass, v)?;
                Ok(self.context.comm().all_reduce_sum_unordered(own))
            }
        }
    }

    fn diagonal(&self, sum: &LinearCombination) -> Result<Vec<f64>> {
        let mut diagonal = vec![0.0; self.own];
        self.add_up(&self.cells.diagonal(sum)?, &mut diagonal)?;
        Ok(diagonal)
    }

    fn factor(&self, sum: &LinearCombination, contact_dofs: &[usize]) -> Result<DistributedFactor> {
        DistributedFactor::new(self, self.matrix(sum)?, contact_dofs)
    }

    fn change_contact_dofs(
        &self,
        factor: &mut DistributedFactor,
        _: &LinearCombination,
        contact_dofs: &[usize],
    ) -> Result<bool> {
        factor.set_contact_dofs(contact_dofs)?;
        Ok(false)
    }
}

/// Matrix factored by PETSc: Cholesky by MUMPS, unless `-ksp_...` and `-pc_...` say otherwise.
///
/// The Schur complement of the contact dofs is the inverse of their block S of A^-1 (the
/// flexibility), which comes from solves with many right-hand sides at once.
pub struct DistributedFactor {
    context: Rc<Context>,
    matrix: Matrix,
    solver: Ksp,
    /// Whether a factorisation solves the systems, rather than an iteration chosen by options.
    direct: bool,
    /// Solver of the matrix with some dofs held, if there are any.
    pinned: Option<Ksp>,
    /// Held dofs that this rank owns.
    held: Vec<usize>,
    right: Vector,
    solution: Vector,
    /// Position of this rank's first dof in global vectors.
    first: usize,
    /// Contact dofs of this rank, and the offset of the first among those of all ranks.
    contact_dofs: Vec<usize>,
    before: usize,
    /// Flexibility (block of A^-1 at the contact dofs), and its inverse, the Schur complement.
    flexibility: Mat<f64>,
    schur: Mat<f64>,
    /// Solution of the last condensed right-hand side without contact, its values at the contact
    /// dofs, and the condensed right-hand side.
    free: Vec<f64>,
    free_contact_dofs: Vec<f64>,
    condensed: Vec<f64>,
}

impl DistributedFactor {
    fn new(engine: &Distributed, mut matrix: Matrix, contact_dofs: &[usize]) -> Result<DistributedFactor> {
        let direct = Ksp::new(&engine.context, Comm::World, "")?.is_direct()?;
        if !direct {
            engine.prepare_for_multigrid(&mut matrix)?;
        }
        let mut factor = DistributedFactor {
            context: engine.context.clone(),
            solver: solver(&engine.context, &matrix)?,
            direct,
            pinned: None,
            held: Vec::new(),
            right: engine.vector()?,
            solution: engine.vector()?,
            first: engine.first,
            contact_dofs: Vec::new(),
            before: 0,
            flexibility: Mat::zeros(0, 0),
            schur: Mat::zeros(0, 0),
            free: vec![0.0; engine.own],
            free_contact_dofs: Vec::new(),
            condensed: Vec::new(),
            matrix,
        };
        factor.set_contact_dofs(contact_dofs)?;
        Ok(factor)
    }

    /// Replaces the contact dofs; columns of those that stay are kept.
    fn set_contact_dofs(&mut self, contact_dofs: &[usize]) -> Result<()> {
        // Whether each contact dof is an old one, and its index among them.
        let place = |dof: &usize| {
            let old = self.contact_dofs.binary_search(dof);
            (old.is_ok(), old.map_or(0, |k| self.before + k))
        };
        let own: Vec<(bool, usize)> = contact_dofs.iter().map(place).collect();
        let (places, before) = self.context.comm().all_gather_with_offset(&own);
        (self.contact_dofs, self.before) = (contact_dofs.to_vec(), before);
        let count = places.len();
        let old = |i: usize| places[i].0.then_some(places[i].1);
        let mut block = Mat::zeros(count, count);
        for (j, i) in (0..count).flat_map(|j| (0..count).map(move |i| (j, i))) {
            if let (Some(i_old), Some(j_old)) = (old(i), old(j)) {
                block[(i, j)] = self.flexibility[(i_old, j_old)];
            }
        }
        let new: Vec<usize> = (0..count).filter(|&j| old(j).is_none()).collect();
        self.solve_for_columns(&new, &mut block)?;
        for (&j, i) in new.iter().flat_map(|j| (0..count).map(move |i| (j, i))) {
            // Both columns were solved for: take their mean.
            let value = if old(i).is_none() { 0.5 * (block[(i, j)] + block[(j, i)]) } else { block[(i, j)] };
            (block[(i, j)], block[(j, i)]) = (value, value);
        }
        self.flexibility = block;
        self.invert()
    }

    /// Computes the Schur complement from the flexibility.
    fn invert(&mut self) -> Result<()> {
        let count = self.flexibility.nrows();
        self.schur = Mat::zeros(0, 0);
        if count > 0 {
            let llt = self.flexibility.llt(faer::Side::Lower).map_err(|_| {
                crate::Error::Singular(format!(
                    "the flexibility of {count} contact dofs is not positive definite"
                ))
            })?;
            self.schur = llt.inverse();
        }
        Ok(())
    }

    /// Returns the assembled matrix that is factored.
    pub fn matrix(&self) -> &Matrix {
        &self.matrix
    }

    /// Solves for columns of the flexibility.
    fn solve_for_columns(&mut self, columns: &[usize], block: &mut Mat<f64>) -> Result<()> {
        let (own, count) = (self.free.len(), block.nrows());
        for lot in columns.chunks(BLOCK) {
            let mut right = Matrix::dense(&self.context, Comm::World, own, lot.len())?;
            let mut solution = Matrix::dense(&self.context, Comm::World, own, lot.len())?;
            right.with_columns_mut(|values| {
                for (number, column) in lot.iter().enumerate() {
                    let mine = column.checked_sub(self.before).and_then(|k| self.contact_dofs.get(k));
                    if let Some(dof) = mine {
                        values[number * own + dof] = 1.0;
                    }
                }
            })?;
            self.solver.solve_columns(&right, &mut solution)?;
            let mut rows = vec![0.0; count * lot.len()];
            solution.with_columns(|values| {
                for (k, &dof) in self.contact_dofs.iter().enumerate() {
                    for number in 0..lot.len() {
                        rows[number * count + self.before + k] = values[number * own + dof];
                    }
                }
            })?;
            self.context.comm().all_reduce_sum_slice_unordered(&mut rows);
            for (number, &column) in lot.iter().enumerate() {
                for row in 0..count {
                    block[(row, column)] = rows[number * count + row];
                }
            }
        }
        Ok(())
    }

    fn solve_with(&mut self, pinned: bool, x: &mut [f64]) -> Result<()> {
        let solver = if pinned { self.pinned.as_mut().unwrap_or(&mut self.solver) } else { &mut self.solver };
        // Held dofs have equations of their own, whose size the norm of an iteration cannot weigh
        // against that of the others.
        let held: &[usize] = if pinned && !self.direct { &self.held } else { &[] };
        let values: Vec<f64> = held.iter().map(|&dof| std::mem::take(&mut x[dof])).collect();
        self.right.set_local(x)?;
        solver.solve(&self.right, &mut self.solution)?;
        self.solution.copy_to(x)?;
        held.iter().zip(values).for_each(|(&dof, value)| x[dof] = value);
        Ok(())
    }

    fn times_schur(&self, x: &[f64]) -> Vec<f64> {
        let mut product = vec![0.0; x.len()];
        for (j, x) in x.iter().enumerate() {
            axpy(*x, self.schur.col_as_slice(j), &mut product);
        }
        product
    }
}

/// Creates a solver of a matrix and factors it.
fn solver(context: &Rc<Context>, matrix: &Matrix) -> Result<Ksp> {
    let mut solver = Ksp::new(context, Comm::World, "")?;
    solver.default_to_cholesky()?;
    solver.set_operator(matrix)?;
    solver.set_from_options()?;
    solver.set_up()?;
    Ok(solver)
}

impl Factor for DistributedFactor {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.solve_with(true, x)
    }

    fn schur(&self) -> &Mat<f64> {
        &self.schur
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64]) -> Result<()> {
        let mut free = std::mem::take(&mut self.free);
        free.copy_from_slice(b);
        self.solve_with(false, &mut free)?;
        self.free = free;
        let own: Vec<f64> = self.contact_dofs.iter().map(|&dof| self.free[dof]).collect();
        self.free_contact_dofs = self.context.comm().all_gather(&own);
        self.condensed = self.times_schur(&self.free_contact_dofs);
        h.copy_from_slice(&self.condensed);
        Ok(())
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        if values != self.free_contact_dofs {
            // x = x_free + A^-1 G^T r, where the reactions r move the contact dofs to their values.
            // Overwriting these entries of x by the values themselves would gain a last digit and
            // spoil the equilibrium on fine meshes.
            let forces = self.times_schur(values);
            x.fill(0.0);
            for (k, &dof) in self.contact_dofs.iter().enumerate() {
                x[dof] = forces[self.before + k] - self.condensed[self.before + k];
            }
            self.solve_with(false, x)?;
            add(&self.free, x);
        } else {
            x.copy_from_slice(&self.free);
        }
        Ok(())
    }

    fn solve_schur(&self, h: &mut [f64]) {
        if *h == self.condensed {
            h.copy_from_slice(&self.free_contact_dofs);
            return;
        }
        let mut right = Mat::from_fn(h.len(), 1, |i, _| h[i]);
        if let Ok(llt) = self.schur.llt(faer::Side::Lower) {
            llt.solve_in_place(&mut right);
        }
        h.iter_mut().enumerate().for_each(|(i, h)| *h = right[(i, 0)]);
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        self.pinned = None;
        self.held = dofs.to_vec();
        if self.context.comm().all_reduce_any(!dofs.is_empty()) {
            let rows: Vec<Index> = dofs.iter().map(|&dof| (self.first + dof) as Index).collect();
            let mut held = self.matrix.duplicate()?;
            held.copy_from(&self.matrix)?;
            held.zero_rows_columns(&rows, 1.0)?;
            held.set_positive_definite()?;
            held.share_near_null_space(&self.matrix)?;
            self.pinned = Some(solver(&self.context, &held)?);
        }
        Ok(())
    }

    /// Archives the flexibility, whose columns depend on the order in which they were solved for.
    fn archive(&mut self, archive: &mut Archive) -> Result<()> {
        let count = self.flexibility.nrows();
        let mut columns: Vec<f64> =
            (0..count).flat_map(|j| self.flexibility.col_as_slice(j).to_vec()).collect();
        if archive.value_of_same(&mut columns)? && !archive.saves() {
            self.flexibility = Mat::from_fn(count, count, |i, j| columns[count * j + i]);
            self.invert()?;
        }
        Ok(())
    }
}
