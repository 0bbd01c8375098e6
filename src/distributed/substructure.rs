//! Factor over all ranks by substructures.
//!
//! Each rank factors the matrix `$A_r$` of its own cells, with the dofs last that it shares with
//! other ranks and its contact dofs. Their Schur complements add up to the matrix of the
//! *interface*,
//!
//! ```math
//! S = \sum_r R_r^T \bigl( A_{kk} - A_{ki} A_{ii}^{-1} A_{ik} \bigr)_r R_r ,
//! ```
//!
//! which every rank factors for itself, the contact dofs last again. A solve is a forward sweep on
//! each rank, one sum over the ranks of the right-hand side of the interface, its solution, and a
//! backward sweep (Przemieniecki 1963, George 1973).
//!
//! `$A_r$` alone may be singular, since the cells of a rank need not be supported. It is factored
//! with what other ranks add to its diagonal, which is subtracted from its Schur complement again:
//! the elimination of the other dofs does not see it.

use super::products::CellProducts;
use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::{Cholesky, Engine, Factor, LinearCombination, SchurFactor, assemble, lower_triangle};
use crate::petsc::{Context, Index, WorldComm};
use faer::Mat;
use faer::sparse::SparseColMat;
use std::rc::Rc;

/// Largest number of entries of the Schur complements of all ranks, 0.5 GB, for which every rank
/// factors the interface for itself, unless the option [`INTERFACE`] says.
const MOST_ENTRIES: usize = 1 << 26;

/// Option with that number.
const INTERFACE: &str = "rebond_interface_entries";

/// Factor over all ranks by substructures; see the [module page](self).
pub struct SubstructuredFactor {
    part: Rc<Substructure>,
    /// Number of each of this rank's kept dofs, ascending, and its place in the interface.
    kept: Vec<usize>,
    places: Vec<usize>,
    /// Share of other ranks in the diagonal at each kept dof, in N/m for deflections.
    others: Vec<f64>,
    cells: Cholesky,
    interface: Cholesky,
    /// Places of the contact dofs of all ranks in the interface.
    contact: Vec<usize>,
    /// Pinned dofs that this rank owns, and the places of all pinned dofs in the interface.
    pinned: Vec<usize>,
    pinned_places: Vec<usize>,
    /// Values at this rank's free dofs, at its kept dofs, and at the interface.
    local: Vec<f64>,
    at_kept: Vec<f64>,
    at_interface: Vec<f64>,
}

/// Cells of this rank with the numbers of their free dofs.
pub(super) struct Substructure {
    comm: WorldComm,
    products: Rc<CellProducts>,
    /// Number of each local dof; `None` for a constrained one.
    of_local: Vec<Option<usize>>,
    /// Position of each free dof among the dofs of all ranks.
    global: Vec<usize>,
    /// Number of each dof that this rank owns.
    owned: Vec<usize>,
    /// Numbers of the dofs that other ranks have too, ascending.
    shared: Vec<usize>,
}

impl Substructure {
    /// Numbers the free dofs, given the position of each local dof among the dofs of all ranks,
    /// negative for a constrained one.
    pub fn new(comm: &WorldComm, products: &Rc<CellProducts>, positions: &[Index]) -> Substructure {
        let (mut of_local, mut global) = (Vec::with_capacity(positions.len()), Vec::new());
        for position in positions {
            let position = usize::try_from(*position).ok();
            of_local.push(position.map(|_| global.len()));
            global.extend(position);
        }
        let number = |local: &usize| of_local[*local];
        let owned = products.exchange.owned.iter().filter_map(number).collect();
        let shared = products.exchange.shared().iter().filter_map(number).collect();
        Substructure { comm: comm.clone(), products: products.clone(), of_local, global, owned, shared }
    }
}

impl SubstructuredFactor {
    /// Factors a sum of forms with the contact dofs (dofs that this rank owns, ascending) last.
    /// Returns `None` where the Schur complements of all ranks have too many entries. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Singular`] where rounding leaves no positive definite matrix and
    /// [`crate::Error::Memory`] where a factor does not fit, on all ranks.
    pub(super) fn new(
        part: &Rc<Substructure>,
        sum: &LinearCombination,
        contact_dofs: &[usize],
        context: &Context,
    ) -> Result<Option<SubstructuredFactor>> {
        let Substructure { comm, products, .. } = &**part;
        let most = context.count(INTERFACE)?.unwrap_or(MOST_ENTRIES);
        let is_own = |number: &usize| part.owned.binary_search(number).is_ok();
        let contact: Vec<usize> = contact_dofs.iter().map(|&dof| part.owned[dof]).collect();
        let kept = union(&part.shared, &contact);
        let triangles = comm.all_reduce_sum(kept.len() * (kept.len() + 1) / 2);
        if triangles > most {
            return Ok(None);
        }
        let global = |number: &usize| part.global[*number];
        let own_kept: Vec<usize> = kept.iter().filter(|number| is_own(number)).map(global).collect();
        let interface = comm.all_gather(&own_kept);
        let place = |number: &usize| interface.binary_search(&global(number)).unwrap_or_default();
        let places: Vec<usize> = kept.iter().map(place).collect();
        let contact = comm.all_gather(&contact.iter().map(place).collect::<Vec<_>>());

        let share = products.cells.diagonal(sum)?;
        let (mut whole, mut diagonal) = (vec![0.0; share.len()], vec![0.0; part.owned.len()]);
        products.add_up(&share, &mut diagonal);
        products.exchange.spread(&diagonal, &mut whole);
        let mut others = vec![0.0; part.global.len()];
        for (local, number) in part.of_local.iter().enumerate() {
            number.iter().for_each(|&number| others[number] = whole[local] - share[local]);
        }
        let others: Vec<f64> = kept.iter().map(|&number| others[number]).collect();
        let cells = assemble(part.global.len(), sum, |local| part.of_local[local]).and_then(|mut matrix| {
            add_to_diagonal(&mut matrix, &kept, &others);
            Cholesky::new(matrix, &kept)
        });
        let mut cells = comm.all_ok(cells)?;
        let summands = Summands { comm, places: &places, others: &others };
        Ok(Some(SubstructuredFactor {
            interface: summands.factor(cells.schur(), interface.len(), &contact, &[])?,
            local: vec![0.0; part.global.len()],
            at_kept: vec![0.0; kept.len()],
            at_interface: vec![0.0; interface.len()],
            part: part.clone(),
            kept,
            places,
            others,
            cells,
            contact,
            pinned: Vec::new(),
            pinned_places: Vec::new(),
        }))
    }

    /// Eliminates this rank's other dofs, and sums the right-hand sides of the interface, with
    /// `more` behind them, over the ranks. Collective.
    fn forward(&mut self, b: &[f64], more: &mut [f64]) -> Result<()> {
        self.local.fill(0.0);
        self.part.owned.iter().zip(b).for_each(|(&number, value)| self.local[number] = *value);
        self.cells.forward_to_schur(&self.local, &mut self.at_kept, &mut [])?;
        self.at_interface.fill(0.0);
        for (&place, value) in self.places.iter().zip(&self.at_kept) {
            self.at_interface[place] = *value;
        }
        let dofs = self.at_interface.len();
        self.at_interface.extend_from_slice(more);
        self.part.comm.all_reduce_sum_slice_unordered(&mut self.at_interface);
        more.copy_from_slice(&self.at_interface[dofs..]);
        self.at_interface.truncate(dofs);
        Ok(())
    }

    /// Completes the solution from its values at the interface.
    fn backward(&mut self, x: &mut [f64]) -> Result<()> {
        for (value, &place) in self.at_kept.iter_mut().zip(&self.places) {
            *value = self.at_interface[place];
        }
        self.cells.back_substitute(&self.at_kept, &mut self.local)?;
        x.iter_mut().zip(&self.part.owned).for_each(|(value, &number)| *value = self.local[number]);
        Ok(())
    }
}

impl Factor for SubstructuredFactor {
    fn schur_factor(&mut self) -> Option<&mut dyn SchurFactor> {
        Some(self)
    }

    fn solve(&mut self, x: &mut [f64]) -> Result<()> {
        // Other rows of a matrix with pinned dofs do not see their values.
        let values: Vec<f64> = self.pinned.iter().map(|&dof| std::mem::take(&mut x[dof])).collect();
        self.forward(x, &mut [])?;
        self.pinned_places.iter().for_each(|&place| self.at_interface[place] = 0.0);
        self.interface.solve(&mut self.at_interface)?;
        self.backward(x)?;
        self.pinned.iter().zip(values).for_each(|(&dof, value)| x[dof] = value);
        Ok(())
    }

    fn release(&mut self) {
        self.cells.release();
    }

    fn pin(&mut self, dofs: &[usize]) -> Result<()> {
        let numbers = dofs.iter().map(|&dof| self.part.owned[dof]);
        let (kept, inner): (Vec<usize>, Vec<usize>) =
            numbers.partition(|number| self.kept.binary_search(number).is_ok());
        let factored = self.cells.pin(&inner);
        self.part.comm.all_ok(factored)?;
        let place = |number: &usize| self.places[self.kept.binary_search(number).unwrap_or_default()];
        self.pinned = dofs.to_vec();
        self.pinned_places = self.part.comm.all_gather(&kept.iter().map(place).collect::<Vec<_>>());
        let summands = Summands { comm: &self.part.comm, places: &self.places, others: &self.others };
        let size = self.at_interface.len();
        self.interface = summands.factor(self.cells.schur(), size, &self.contact, &self.pinned_places)?;
        Ok(())
    }
}

impl SchurFactor for SubstructuredFactor {
    fn schur(&mut self) -> &Mat<f64> {
        self.interface.schur()
    }

    fn forward_to_schur(&mut self, b: &[f64], h: &mut [f64], more: &mut [f64]) -> Result<()> {
        self.forward(b, more)?;
        self.interface.forward_to_schur(&self.at_interface, h, &mut [])
    }

    fn back_substitute(&mut self, values: &[f64], x: &mut [f64]) -> Result<()> {
        self.interface.back_substitute(values, &mut self.at_interface)?;
        self.backward(x)
    }

    fn solve_schur(&mut self, h: &mut [f64]) {
        self.interface.solve_schur(h);
    }
}

/// Contribution of this rank to the matrix of the interface.
struct Summands<'s> {
    comm: &'s WorldComm,
    /// Place of each kept dof in the interface.
    places: &'s [usize],
    /// Share of other ranks in the diagonal at each kept dof.
    others: &'s [f64],
}

impl Summands<'_> {
    /// Adds up the Schur complements of all ranks, and factors the sum over `dofs` dofs with the
    /// contact dofs last, where pinned ones have rows of the identity. Collective.
    fn factor(&self, schur: &Mat<f64>, dofs: usize, contact: &[usize], pinned: &[usize]) -> Result<Cholesky> {
        let count = self.places.len();
        let mut entries = Vec::with_capacity(count * (count + 1) / 2);
        for column in 0..count {
            entries.extend_from_slice(&schur.col_as_slice(column)[column..]);
            let diagonal = entries.len() - (count - column);
            entries[diagonal] -= self.others[column];
        }
        let counts = self.comm.all_gather_one(count);
        let (places, entries) = (self.comm.all_gather(self.places), self.comm.all_gather(&entries));
        let mut is_pinned = vec![false; dofs];
        pinned.iter().for_each(|&place| is_pinned[place] = true);
        let visit = |visit: &mut dyn FnMut(usize, usize, f64)| {
            let (mut places, mut entries) = (&places[..], entries.iter());
            for &count in &counts {
                let (of_rank, rest) = places.split_at(count);
                places = rest;
                for (column, &a) in of_rank.iter().enumerate() {
                    for (&b, &entry) in of_rank[column..].iter().zip(&mut entries) {
                        if !is_pinned[a] && !is_pinned[b] {
                            visit(a.max(b), a.min(b), entry);
                        }
                    }
                }
            }
            pinned.iter().for_each(|&place| visit(place, place, 1.0));
        };
        let matrix = lower_triangle(dofs, |see| visit(&mut |_, column, _| see(column)), |see| visit(see))
            .and_then(|(pattern, values)| Cholesky::new(SparseColMat::new(pattern, values), contact));
        self.comm.all_ok(matrix)
    }
}

/// Adds values to the diagonal of a lower triangle at some dofs.
fn add_to_diagonal(matrix: &mut SparseColMat<usize, f64>, dofs: &[usize], values: &[f64]) {
    for (&dof, value) in dofs.iter().zip(values) {
        let entry = matrix.col_range(dof).find(|&entry| matrix.row_idx()[entry] == dof);
        entry.into_iter().for_each(|entry| matrix.val_mut()[entry] += *value);
    }
}

/// Returns the union of two ascending lists.
fn union(a: &[usize], b: &[usize]) -> Vec<usize> {
    let mut union = [a, b].concat();
    union.sort_unstable();
    union.dedup();
    union
}
