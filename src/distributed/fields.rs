//! Solver of a problem in two fields over all ranks: the displacement in the plane.
//!
//! Each rank numbers its dofs of the first field, then its dofs of the second one, as PETSc does in
//! a matrix of blocks.

use super::assembled::assembled;
use super::exchange::DofExchange;
use super::factor::{PetscFactor, SolverKind, SystemSolver};
use super::hierarchy::{Hierarchy, Level};
use super::own_mesh::section;
use super::products::CellProducts;
use super::substructure::{Substructure, SubstructuredFactor};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::{ElementMatrix, Factor, LinearCombination, Native};
use crate::mesh::Mesh;
use crate::partition::{LocalSolver, NodalField};
use crate::petsc::{Index, Plex, Refinement};
use std::rc::Rc;

/// Prefix of the options of the solver of the displacement in the plane.
pub const IN_PLANE: &str = "in_plane_";

/// Solver of two fields: by substructures, or by multigrid on a mesh that keeps its coarser levels,
/// unless options with the prefix `in_plane_` say otherwise.
pub(super) struct FieldsSolver {
    products: Rc<CellProducts>,
    factor: Box<dyn Factor>,
    /// Values at the dofs that this rank owns.
    values: Vec<f64>,
}

impl FieldsSolver {
    /// Factors the matrix of two fields on a part of a mesh, given cell by cell, or prepares the
    /// iteration. `passed` are the coarser meshes, if they are kept. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where a factorisation fails, and
    /// [`crate::Error::Petsc`] where PETSc reports an error.
    pub fn new(
        (plex, mesh, owns): (&Plex, &Mesh, &[bool]),
        passed: &[(Plex, Refinement)],
        fields: &[NodalField; 2],
        blocks: Vec<ElementMatrix>,
    ) -> Result<FieldsSolver> {
        let (context, comm) = (plex.context(), plex.context().comm());
        let with_dofs = |field: &NodalField| {
            let plex = plex.with_section(&section(plex, &field.holds, &[], &[])?)?;
            let range = plex.global_vector()?.range();
            Ok((Rc::new(plex), comm.all_gather_one([range.start as usize, range.end as usize])))
        };
        let [(first, of_first), (second, of_second)] = [with_dofs(&fields[0])?, with_dofs(&fields[1])?];
        // Ranks without dofs begin where the next one does.
        let owner =
            |ranges: &[[usize; 2]], dof: usize| ranges.partition_point(|[start, _]| *start <= dof) - 1;
        let shifted = |dofs: Vec<Index>, ranges: &[[usize; 2]], shift: &dyn Fn(usize) -> usize| {
            let place = |dof| usize::try_from(dof).map_or(dof, |n| (n + shift(owner(ranges, n))) as Index);
            dofs.into_iter().map(place).collect::<Vec<Index>>()
        };
        let mut global = shifted(first.global_dofs()?, &of_first, &|rank| of_second[rank][0]);
        global.extend(shifted(second.global_dofs()?, &of_second, &|rank| of_first[rank][1]));
        let [[start, end], [other_start, other_end]] = [of_first[comm.rank()], of_second[comm.rank()]];
        let owned = end - start + other_end - other_start;
        let exchange = DofExchange::new(comm, &global, start + other_start, owned);
        let products = Rc::new(CellProducts::new(exchange, Native::new(global.len())));
        let form = products.cells.form(blocks);
        let sum = LinearCombination::from(&form);
        let level = |plex: Rc<Plex>, NodalField { space, holds }: &NodalField| {
            Hierarchy::new(comm, passed, &Level { plex, mesh, space, holds, owns, extra_cells: &[] })
        };
        let hierarchy = if passed.is_empty() {
            None
        } else {
            Some(Rc::new(Hierarchy::of_two(&level(first, &fields[0])?, &level(second, &fields[1])?)?))
        };
        let linear = SystemSolver::new(context, IN_PLANE, hierarchy.as_ref())?;
        let substructured = if let SolverKind::Substructures = linear.kind {
            let part = Rc::new(Substructure::new(comm, &products, &global));
            SubstructuredFactor::new(&part, &sum, &[], context)?
        } else {
            None
        };
        let factor: Box<dyn Factor> = match substructured {
            Some(factor) => Box::new(factor),
            None => {
                let is_of_subdomains = matches!(linear.kind, SolverKind::Subdomains);
                let mut matrix = assembled(context, (&global, owned), &sum, is_of_subdomains)?;
                matrix.set_positive_definite()?;
                Box::new(PetscFactor::new(context, matrix, None, linear, Rc::default())?)
            }
        };
        Ok(FieldsSolver { products, factor, values: vec![0.0; owned] })
    }
}

impl LocalSolver for FieldsSolver {
    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        self.products.add_up(x, &mut self.values);
        self.factor.solve(&mut self.values)?;
        x.fill(0.0);
        self.products.exchange.spread(&self.values, x);
        Ok(())
    }
}
