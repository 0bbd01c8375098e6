//! Check of every solver's answers: one relative residual of the optimality (KKT) conditions.
//!
//! Stationarity is measured as a componentwise backward error (Oettli and Prager 1964): the
//! smallest relative change of the entries of the local matrices and of b for which x satisfies its
//! rows exactly,
//!
//! ```math
//! \max_i \frac{|A x - b - G^T r|_i}{(|A||x| + |b| + |G^T r|)_i}.
//! ```
//!
//! A row with only negligible terms is measured against a share of the largest magnitude that the
//! positive definite A allows it. The measure does not depend on units or on the scaling of the
//! dofs. A row without stiffness, where the dof has inertia only, is measured against the forces
//! that its inertia may exert. Violated bounds are measured against the scale of the deflection,
//! and reactions against the magnitude of their row; complementarity is the smaller of relative gap
//! and relative reaction. A is applied cell by cell, without the assembled matrix on which the
//! solvers work.
//!
//! Where a bound yields, complementarity compares the reaction with its law: it is the smaller of
//! the relative error of the reaction and that of the depth.

use crate::communicator::Communicator;
use crate::error::Result;
use crate::linalg::vectors::{Largest, is_zero, largest};
use crate::linalg::wide::widest;
use crate::linalg::{Engine, Form, LinearCombination, RowCoupling};
use crate::obstacle::{Bounds, hertz_depth, hertz_force};
use crate::vi::{Answer, Problem};
use pulp::Arch;
use std::ops::Range;

/// Share of a row's largest possible magnitude, sqrt(A_ii) max_j of sqrt(A_jj) |x_j| and
/// |b_j| / sqrt(A_jj), below which the row is measured against that share. Where all terms of a row
/// vanish in the answer, rounding of other rows is all that remains in it.
const NEGLIGIBLE: f64 = 1e-4;

/// Largest number of rows in a block, whose vectors fit into the first cache together.
const BLOCK: usize = 510;

/// Parts of the KKT residual, each dimensionless.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Componentwise backward error of A x = b + G^T r.
    pub stationarity: f64,
    /// Largest violation of a bound, relative to the scale of the deflection.
    pub penetration: f64,
    /// Largest reaction of the wrong sign, relative to the magnitude of its row.
    pub adhesion: f64,
    /// Largest minimum of relative gap and relative reaction.
    pub complementarity: f64,
}

impl Residual {
    /// Returns the largest part; NaN if any part is.
    pub fn worst(&self) -> f64 {
        let parts = [self.stationarity, self.penetration, self.adhesion, self.complementarity];
        parts.into_iter().fold(0.0, larger)
    }
}

/// Returns the larger of two numbers, and NaN if either is, which a comparison would hide.
fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Returns a / b, and 0 where a is 0 whatever b is.
fn ratio(a: f64, b: f64) -> f64 {
    if a == 0.0 { 0.0 } else { a / b }
}

/// Subtracts a term of the right-hand side from the residual, and adds its magnitude.
#[inline(always)]
fn subtract_term(term: &[f64], residual: &mut [f64], magnitude: &mut [f64]) {
    for ((r, m), b) in residual.iter_mut().zip(magnitude.iter_mut()).zip(term) {
        *r -= b;
        *m += b.abs();
    }
}

/// Returns the largest magnitude of the products of the entries of two vectors.
fn largest_product(x: &[f64], y: &[f64]) -> f64 {
    widest(
        Arch::new(),
        #[inline(always)]
        || largest(x.iter().zip(y).map(|(x, y)| x * y)),
    )
}

/// Returns the share of a row's scale below which its magnitude is not measured, given the largest
/// magnitude of x times its scale.
fn lowest_share(size: f64) -> f64 {
    (NEGLIGIBLE * size).max(f64::MIN_POSITIVE)
}

/// Returns the magnitude against which a row is measured: its own, or `floor` times its scale. A
/// row without any magnitude has no residual either.
#[inline(always)]
fn raised(magnitude: f64, floor: f64, scale: f64) -> f64 {
    magnitude.max(floor * scale).max(f64::MIN_POSITIVE)
}

/// Returns the largest residual relative to its raised magnitude.
fn largest_ratio(residual: &[f64], magnitude: &[f64], scale: &[f64], floor: f64) -> f64 {
    widest(
        Arch::new(),
        #[inline(always)]
        || {
            let rows = residual.iter().zip(magnitude).zip(scale);
            largest(rows.map(
                #[inline(always)]
                |((r, m), scale)| r / raised(*m, floor, *scale),
            ))
        },
    )
}

/// Whether an answer needs more than its stationarity checked.
#[derive(Clone, Copy)]
struct ContactState {
    /// Whether any reaction acts.
    presses: bool,
    /// Whether x lies within all bounds.
    is_inside: bool,
}

impl ContactState {
    /// Returns the state of an answer on this rank.
    fn of(bounds: &Bounds, answer: &Answer) -> ContactState {
        ContactState { presses: !is_zero(answer.reaction), is_inside: bounds.contain(answer.x) }
    }

    /// Returns whether nothing touches.
    fn is_free(self) -> bool {
        !self.presses && self.is_inside
    }
}

/// Check of the answers to problems with one matrix, with its work vectors.
#[derive(Debug)]
pub struct KktCheck {
    /// Square roots of the diagonal of A, sqrt(A_ii).
    scale: Vec<f64>,
    /// Reciprocals of the scales, and 0 where a scale is 0.
    inverse_scale: Vec<f64>,
    /// Dofs without stiffness, each with the scale of its inertia; `None` where inertia does not
    /// count.
    loose: Option<Vec<(usize, f64)>>,
    /// All rows. Their couplings bound their magnitudes from below.
    blocks: Vec<RowBlock>,
    residual: Vec<f64>,
    magnitude: Vec<f64>,
}

/// Successive rows, with their couplings to other dofs.
#[derive(Debug)]
struct RowBlock {
    rows: Range<usize>,
    couplings: Couplings,
}

#[derive(Debug)]
enum Couplings {
    /// Couplings of successive nodes with three dofs each to their first dofs: the magnitudes for
    /// the second and the third.
    OfNodes(Vec<[f64; 2]>),
    /// Couplings of some rows.
    OfRows(Vec<CoupledRow>),
}

/// Row whose dof is coupled to another dof, and the magnitude of this coupling.
#[derive(Debug)]
struct CoupledRow {
    row: u32,
    to: u32,
    magnitude: f64,
}

/// Returns the number of successive nodes from a dof on whose other dofs are coupled to their first
/// ones, given the couplings of all dofs.
fn coupled_nodes(dof: usize, couplings: &[RowCoupling]) -> usize {
    let (nodes, _) = couplings[dof..].as_chunks::<3>();
    let couples = |(node, of): &(usize, &[RowCoupling; 3])| {
        let first = (dof + 3 * node) as u32;
        of[0].magnitude == 0.0 && of[1..].iter().all(|of| of.to == first && of.magnitude > 0.0)
    };
    nodes.iter().enumerate().take_while(couples).count()
}

/// Divides all rows into blocks, given their couplings.
fn row_blocks(couplings: &[RowCoupling]) -> Vec<RowBlock> {
    let mut blocks = Vec::<RowBlock>::new();
    let mut dof = 0;
    while dof < couplings.len() {
        let nodes = coupled_nodes(dof, couplings).min(BLOCK / 3);
        if nodes > 0 {
            let rows = dof..dof + 3 * nodes;
            let (of_nodes, _) = couplings[rows.clone()].as_chunks::<3>();
            let magnitudes = of_nodes.iter().map(|[_, x, y]| [x.magnitude, y.magnitude]).collect();
            blocks.push(RowBlock { rows, couplings: Couplings::OfNodes(magnitudes) });
            dof += 3 * nodes;
            continue;
        }
        let RowCoupling { to, magnitude } = couplings[dof];
        let coupled = (magnitude > 0.0).then_some(CoupledRow { row: dof as u32, to, magnitude });
        dof += 1;
        match blocks.last_mut() {
            Some(RowBlock { rows, couplings: Couplings::OfRows(list) }) if rows.len() < BLOCK => {
                rows.end = dof;
                list.extend(coupled);
            }
            _ => {
                let couplings = Couplings::OfRows(coupled.into_iter().collect());
                blocks.push(RowBlock { rows: dof - 1..dof, couplings });
            }
        }
    }
    blocks
}

impl RowBlock {
    /// Subtracts the right-hand side and further terms from the residual of the block, and sets the
    /// magnitude of each of its rows to that of these terms and of its part in
    /// [`KktCheck::limit`]. All other vectors are those of all rows.
    #[inline(always)]
    fn subtract(
        &self,
        terms: (&[f64], &[&[f64]]),
        x: &[f64],
        scale: &[f64],
        residual: &mut [f64],
        magnitude: &mut [f64],
    ) {
        let (rhs, more) = terms;
        let block = || self.rows.clone();
        let known = x[block()].iter().zip(&rhs[block()]).zip(&scale[block()]);
        for ((r, m), ((own, b), scale)) in residual.iter_mut().zip(magnitude.iter_mut()).zip(known) {
            *r -= b;
            *m = scale * (scale * own.abs()) + b.abs();
        }
        for term in more.iter().filter(|term| !term.is_empty()) {
            subtract_term(&term[block()], residual, magnitude);
        }
        match &self.couplings {
            Couplings::OfNodes(magnitudes) => {
                let (rows, _) = magnitude.as_chunks_mut::<3>();
                let (nodes, _) = x[block()].as_chunks::<3>();
                for ((m, of), node) in rows.iter_mut().zip(magnitudes).zip(nodes) {
                    let first = node[0].abs();
                    m[1] += of[0] * first;
                    m[2] += of[1] * first;
                }
            }
            Couplings::OfRows(rows) => {
                for CoupledRow { row, to, magnitude: of } in rows {
                    magnitude[*row as usize - self.rows.start] += of * x[*to as usize].abs();
                }
            }
        }
    }
}

impl KktCheck {
    /// Creates the check of problems with this matrix.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn new<E: Engine>(engine: &E, matrix: &LinearCombination) -> Result<KktCheck> {
        let scale: Vec<f64> = engine.diagonal(matrix)?.into_iter().map(f64::sqrt).collect();
        let inverse_scale = scale.iter().map(|scale| if *scale > 0.0 { 1.0 / scale } else { 0.0 }).collect();
        let zeros = vec![0.0; scale.len()];
        let blocks = row_blocks(&engine.couplings(matrix)?);
        Ok(KktCheck { residual: zeros.clone(), magnitude: zeros, scale, inverse_scale, blocks, loose: None })
    }

    /// Creates the check of problems with a stiffness K, given K + s M as well: rows in which K has
    /// no entry, like those of balls, are measured against the forces that s M exerts there.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn with_inertia<E: Engine>(
        engine: &E,
        stiffness: &LinearCombination,
        with_mass: &LinearCombination,
    ) -> Result<KktCheck> {
        let mut check = KktCheck::new(engine, stiffness)?;
        let of_mass = engine.diagonal(with_mass)?.into_iter().map(f64::sqrt).enumerate();
        check.loose = Some(of_mass.filter(|(dof, _)| check.scale[*dof] == 0.0).collect());
        Ok(check)
    }

    /// Returns the largest part of the residual of an answer over all ranks; see the [module
    /// page](self). Collective.
    ///
    /// The slices of `more` are further terms of the right-hand side, added in turn to the one of
    /// the problem: each counts with its own magnitude, and an empty one is zero. Where the length
    /// of the problem is 0, as at rest on obstacles at 0, the answer itself gives the scale of the
    /// deflection.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn residual<E: Engine>(
        &mut self,
        engine: &E,
        problem: &Problem,
        more: &[&[f64]],
        answer: &Answer,
    ) -> Result<f64> {
        let length = self.length(engine, problem, answer);
        let own = self.parts(engine, &Problem { length, ..*problem }, more, answer)?.worst();
        Ok(engine.comm().all_reduce_max(own))
    }

    /// Returns an upper limit of [`KktCheck::residual`] at the cost of the product A x alone, and
    /// sets `product` to the product of x with `part`, a form of the matrix. Returns `None` where
    /// the engine has no such product. Collective.
    ///
    /// The magnitude of a row is replaced by a part of it: its diagonal entry, and for a slope the
    /// coupling to the deflection of its node. The share of the largest possible magnitude is that
    /// of x alone.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn limit<E: Engine>(
        &mut self,
        engine: &E,
        problem: &Problem,
        more: &[&[f64]],
        answer: &Answer,
        (part, product): (&Form, &mut [f64]),
    ) -> Result<Option<f64>> {
        let x = &*answer.x;
        if !engine.multiply_with_part(problem.matrix, part, x, (&mut self.residual, product))? {
            return Ok(None);
        }
        let length = self.length(engine, problem, answer);
        let size = engine.comm().all_reduce_max(largest_product(&self.scale, x));
        let contact = ContactState::of(problem.bounds, answer);
        let own = if contact.is_free() && self.loose.is_none() {
            self.subtract_and_compare((problem.rhs, more), x, size)
        } else {
            self.subtract_with_diagonal((problem.rhs, more), x);
            self.compare(engine, &Problem { length, ..*problem }, size, answer, contact)?.worst()
        };
        Ok(Some(engine.comm().all_reduce_max(own)))
    }

    /// Returns the length scale of a problem. Where it is 0, the answer gives one: its largest
    /// deflection, or that of a bounded dof which has the energy of its largest entry. Deflections
    /// alone may be what rounding left of slopes. Collective.
    fn length<E: Engine>(&self, engine: &E, problem: &Problem, answer: &Answer) -> f64 {
        if problem.length != 0.0 {
            return problem.length;
        }
        let deflection = engine.comm().all_reduce_max(problem.bounds.largest(answer.x));
        let size = largest_product(&self.scale, answer.x);
        let size = engine.comm().all_reduce_max(size);
        let stiffest = engine.comm().all_reduce_max(problem.bounds.largest(&self.scale));
        if stiffest > 0.0 { larger(deflection, size / stiffest) } else { deflection }
    }

    /// Subtracts the right-hand side and further terms from the residual, and sets the magnitude of
    /// each row to that of these terms and of its part in [`KktCheck::limit`].
    fn subtract_with_diagonal(&mut self, terms: (&[f64], &[&[f64]]), x: &[f64]) {
        let KktCheck { scale, blocks, residual, magnitude, .. } = self;
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for block in &*blocks {
                    let [residual, magnitude] =
                        [&mut *residual, &mut *magnitude].map(|of| &mut of[block.rows.clone()]);
                    block.subtract(terms, x, scale, residual, magnitude);
                }
            },
        );
    }

    /// Subtracts terms as [`KktCheck::subtract_with_diagonal`] does, and returns the stationarity
    /// of an answer without reactions, given the largest magnitude of x times its scale. The
    /// magnitudes of a block do not outlast it, so that they stay in the first cache.
    fn subtract_and_compare(&mut self, terms: (&[f64], &[&[f64]]), x: &[f64], size: f64) -> f64 {
        let KktCheck { scale, blocks, residual, magnitude, .. } = self;
        let floor = lowest_share(size);
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                let mut ratio = Largest::default();
                for block in &*blocks {
                    let (residual, scale_of_block) =
                        (&mut residual[block.rows.clone()], &scale[block.rows.clone()]);
                    let magnitude = &mut magnitude[..block.rows.len()];
                    block.subtract(terms, x, scale, residual, magnitude);
                    for ((r, m), scale) in residual.iter().zip(magnitude).zip(scale_of_block) {
                        ratio.note(r / raised(*m, floor, *scale));
                    }
                }
                ratio.value()
            },
        )
    }

    /// Subtracts terms of the right-hand side from the residual, and adds their magnitudes. Returns
    /// their largest magnitude, divided by its scale.
    fn subtract_terms(&mut self, terms: &[&[f64]]) -> f64 {
        terms.iter().fold(0.0, |size, term| {
            widest(
                Arch::new(),
                #[inline(always)]
                || subtract_term(term, &mut self.residual, &mut self.magnitude),
            );
            larger(size, largest_product(term, &self.inverse_scale))
        })
    }

    /// Returns the residual A x - b - G^T r of the last check, in N, one entry per dof.
    pub fn forces(&self) -> &[f64] {
        &self.residual
    }

    /// Returns the parts of the residual on this rank, with the arguments of
    /// [`KktCheck::residual`]. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn parts<E: Engine>(
        &mut self,
        engine: &E,
        problem: &Problem,
        more: &[&[f64]],
        answer: &Answer,
    ) -> Result<Residual> {
        let x = &*answer.x;
        engine.multiply_with_magnitude(problem.matrix, x, &mut self.residual, &mut self.magnitude)?;
        let size = largest_product(&self.scale, x);
        let size = larger(size, self.subtract_terms(&[problem.rhs]));
        let size = larger(size, self.subtract_terms(more));
        let size = engine.comm().all_reduce_max(size);
        self.compare(engine, problem, size, answer, ContactState::of(problem.bounds, answer))
    }

    /// Returns the parts of the residual on this rank, given A x less all terms of the right-hand
    /// side, the magnitude of each row, and the largest magnitude on all ranks of x times its
    /// scale, or of the terms divided by their scales if that is larger and known. Collective.
    fn compare<E: Engine>(
        &mut self,
        engine: &E,
        problem: &Problem,
        size: f64,
        answer: &Answer,
        contact: ContactState,
    ) -> Result<Residual> {
        let KktCheck { scale, residual, magnitude, loose, .. } = self;
        let Problem { bounds, length, .. } = *problem;
        let (x, reaction) = (&*answer.x, &*answer.reaction);
        if contact.presses {
            for (&dof, &r) in bounds.dofs.iter().zip(reaction).filter(|(_, r)| **r != 0.0) {
                residual[dof] -= r;
                magnitude[dof] += r.abs();
            }
        }
        if let Some(loose) = loose {
            let size =
                engine.comm().all_reduce_max(largest(loose.iter().map(|(dof, scale)| scale * x[*dof])));
            loose.iter().for_each(|(dof, scale)| {
                magnitude[*dof] = magnitude[*dof].max(NEGLIGIBLE * size * scale);
            });
        }
        let floor = lowest_share(size);
        let stationarity = largest_ratio(residual, magnitude, scale, floor);
        let mut parts = Residual { stationarity, penetration: 0.0, adhesion: 0.0, complementarity: 0.0 };
        if contact.is_free() {
            return Ok(parts);
        }
        for (i, (&dof, &r)) in bounds.dofs.iter().zip(reaction).enumerate() {
            // Free dofs within their bounds add nothing.
            if r == 0.0 && contact.is_inside {
                continue;
            }
            let (below, above) = (x[dof] - bounds.lower[i], bounds.upper[i] - x[dof]);
            if r == 0.0 && below >= 0.0 && above >= 0.0 {
                continue;
            }
            let force = raised(magnitude[dof], floor, scale[dof]);
            let [lower, upper] = bounds.rigid(i);
            let outside = larger(0.0, larger(lower - x[dof], x[dof] - upper));
            parts.penetration = larger(parts.penetration, ratio(outside, length));
            let side = usize::from(if r == 0.0 { above < 0.0 } else { r < 0.0 });
            if let Some(k) = bounds.yields(i, side) {
                let depth = bounds.depth(i, side, x[dof]);
                let of_depth = (depth.max(0.0) - hertz_depth(k, r.abs())).abs();
                let of_force = (r.abs() - hertz_force(k, depth)).abs();
                let error = ratio(of_depth, length).min(ratio(of_force, force));
                parts.complementarity = larger(parts.complementarity, error);
                continue;
            }
            // A positive reaction pushes up, off the lower bound.
            let gap = if r >= 0.0 { below } else { above };
            let adhesion = if gap.is_infinite() { r.abs() } else { 0.0 };
            parts.adhesion = larger(parts.adhesion, ratio(adhesion, force));
            parts.complementarity =
                larger(parts.complementarity, ratio(gap.abs(), length).min(ratio(r.abs(), force)));
        }
        Ok(parts)
    }
}
