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
//! the relative errors of reaction and depth.

mod rows;

use crate::communicator::Communicator;
use crate::error::Result;
use crate::kernels::wide::widest;
use crate::linalg::vectors::{is_zero, largest};
use crate::linalg::{Engine, Form, LinearCombination, RowCoupling};
use crate::obstacle::Bounds;
use crate::vi::{Answer, Problem, laws};
use pulp::Arch;
use rows::{RowTerms, raised};

/// Share of a row's largest possible magnitude, sqrt(A_ii) max_j of sqrt(A_jj) |x_j| and
/// |b_j| / sqrt(A_jj), below which the row is measured against that share. Where all terms of a row
/// vanish in the answer, rounding of other rows is all that remains in it.
const NEGLIGIBLE: f64 = 1e-4;

/// Parts of the KKT residual, each dimensionless.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
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
        largest(parts.into_iter())
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
    /// Least magnitude of a deflection without stiffness times its scale, in sqrt(J).
    least_size: f64,
    /// Couplings of the rows, which bound their magnitudes from below.
    couplings: Vec<RowCoupling>,
    residual: Vec<f64>,
    magnitude: Vec<f64>,
    /// Bounds with a reaction, each with its row and the entry of A x.
    pressed: Vec<(usize, usize, f64)>,
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
        Ok(KktCheck {
            scale,
            inverse_scale,
            loose: None,
            least_size: 0.0,
            couplings: engine.couplings(matrix)?,
            residual: zeros.clone(),
            magnitude: zeros,
            pressed: Vec::new(),
        })
    }

    /// Creates the check of problems with a stiffness K, given K + s M as well: rows in which K has
    /// no entry, as of balls, are measured against the forces that s M exerts there. Where
    /// the whole answer is rounding, as at the instant at which a ball meets a plate at rest, all
    /// rows are measured against these forces at deflections of `length` (m). Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub fn with_inertia<E: Engine>(
        engine: &E,
        stiffness: &LinearCombination,
        with_mass: &LinearCombination,
        length: f64,
    ) -> Result<KktCheck> {
        let mut check = KktCheck::new(engine, stiffness)?;
        let of_mass = engine.diagonal(with_mass)?.into_iter().map(f64::sqrt).enumerate();
        let loose: Vec<_> = of_mass.filter(|(dof, _)| check.scale[*dof] == 0.0).collect();
        let size = largest(loose.iter().map(|(_, scale)| scale * length));
        check.least_size = engine.comm().all_reduce_max(size);
        check.loose = Some(loose);
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
        let worst = self.parts(engine, &Problem { length, ..*problem }, more, answer)?.worst();
        Ok(engine.comm().all_reduce_max(worst))
    }

    /// Returns an upper limit of [`KktCheck::residual`] at the cost of the product A x alone, and
    /// sets `product` to the product of x with `part`, a form of the matrix. Returns `None` where
    /// the engine has no such product, inertia counts or there is more than one further term.
    /// Collective.
    ///
    /// The magnitude of a row is replaced by a part of it: its diagonal entry, and for a slope the
    /// coupling to the deflection of its node. The share of the largest possible magnitude is that
    /// of x alone, on this rank.
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
        let term = match *more {
            [] => &[],
            [term] => term,
            _ => return Ok(None),
        };
        if self.loose.is_some()
            || !engine.multiply_with_part(problem.matrix, part, x, [&mut self.residual, product])?
        {
            return Ok(None);
        }
        // The scales of this rank alone are smaller, which keeps this an upper limit.
        let is_alone = engine.comm().size() == 1;
        let length = if is_alone { self.length(engine, problem, answer) } else { problem.length };
        let size = largest_product(&self.scale, x);
        let contact = ContactState::of(problem.bounds, answer);
        let parts = self.limit_of_parts(&Problem { length, ..*problem }, term, size, answer, contact);
        Ok(Some(engine.comm().all_reduce_max(parts.worst())))
    }

    /// Returns upper limits of the parts of the residual on this rank, given A x in its place, a
    /// further term of the right-hand side or an empty vector, and the largest magnitude of x times
    /// its scale.
    fn limit_of_parts(
        &mut self,
        problem: &Problem,
        term: &[f64],
        size: f64,
        answer: &Answer,
        contact: ContactState,
    ) -> Residual {
        let KktCheck { scale, couplings, residual, magnitude, pressed, .. } = self;
        let (bounds, floor) = (problem.bounds, lowest_share(size));
        let rows = RowTerms { x: &*answer.x, scale, couplings, terms: [problem.rhs, term] };
        let terms = |row: usize| (problem.rhs[row], term.get(row).copied().unwrap_or_default());
        let reaction = &*answer.reaction;
        pressed.clear();
        if contact.presses {
            // Rows with a reaction miss nothing in the comparison, and are compared after it.
            for (bound, &row) in bounds.dofs.iter().enumerate() {
                if reaction[bound] != 0.0 {
                    pressed.push((bound, row, residual[row]));
                    let (b, more) = terms(row);
                    residual[row] = b + more;
                }
            }
        }
        let mut stationarity = rows.compare(floor, residual, magnitude);
        if contact.is_free() {
            return Residual { stationarity, ..Residual::default() };
        }
        let magnitude =
            |row: usize, reaction: f64| raised(rows.magnitude(row) + reaction.abs(), floor, scale[row]);
        for &(bound, row, product) in &*pressed {
            let (b, more) = terms(row);
            residual[row] = product - b - more - reaction[bound];
            stationarity = larger(stationarity, residual[row].abs() / magnitude(row, reaction[bound]));
        }
        if contact.is_inside {
            let touching = pressed.iter().map(|(bound, ..)| *bound);
            of_contact(problem, answer, touching, stationarity, magnitude)
        } else {
            of_contact(problem, answer, 0..bounds.len(), stationarity, magnitude)
        }
    }

    /// Returns the length scale of a problem. Where it is 0, the answer gives one: its largest
    /// deflection, or the deflection of a bounded dof with the energy of its largest entry.
    /// Deflections alone may be what rounding left of slopes. Collective.
    fn length<E: Engine>(&self, engine: &E, problem: &Problem, answer: &Answer) -> f64 {
        let length = engine.comm().all_reduce_max(problem.length);
        if length != 0.0 {
            return length;
        }
        let deflection = engine.comm().all_reduce_max(problem.bounds.largest(answer.x));
        let size = largest_product(&self.scale, answer.x);
        let size = engine.comm().all_reduce_max(size);
        let stiffest = engine.comm().all_reduce_max(problem.bounds.largest(&self.scale));
        if stiffest > 0.0 { larger(deflection, size / stiffest) } else { deflection }
    }

    /// Subtracts terms of the right-hand side from the residual, and adds their magnitudes. Returns
    /// their largest magnitude, divided by its scale.
    fn subtract_terms(&mut self, terms: &[&[f64]]) -> f64 {
        terms.iter().fold(0.0, |size, term| {
            widest(
                Arch::new(),
                #[inline(always)]
                || {
                    let rows = self.residual.iter_mut().zip(&mut self.magnitude);
                    rows.zip(*term).for_each(|((r, m), b)| (*r, *m) = (*r - b, *m + b.abs()));
                },
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
        engine.multiply_with_magnitude(problem.matrix, x, [&mut self.residual, &mut self.magnitude])?;
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
        let KktCheck { scale, residual, magnitude, loose, least_size, .. } = self;
        let bounds = problem.bounds;
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
            let size = larger(size, *least_size);
            loose.iter().for_each(|(dof, scale)| {
                magnitude[*dof] = magnitude[*dof].max(NEGLIGIBLE * size * scale);
            });
        }
        let floor = lowest_share(larger(size, *least_size));
        let stationarity = largest_ratio(residual, magnitude, scale, floor);
        if contact.is_free() {
            return Ok(Residual { stationarity, ..Residual::default() });
        }
        Ok(of_contact(problem, answer, 0..bounds.len(), stationarity, |row, _| {
            raised(magnitude[row], floor, scale[row])
        }))
    }
}

/// Returns all parts of the residual of an answer that touches, given the bounds that may touch,
/// the stationarity, and the raised magnitude of a row with its reaction.
fn of_contact(
    problem: &Problem,
    answer: &Answer,
    touching: impl Iterator<Item = usize>,
    stationarity: f64,
    magnitude: impl Fn(usize, f64) -> f64,
) -> Residual {
    let Problem { bounds, length, .. } = *problem;
    let (x, reaction) = (&*answer.x, &*answer.reaction);
    let mut parts = Residual { stationarity, ..Residual::default() };
    for i in touching {
        let (dof, r) = (bounds.dofs[i], reaction[i]);
        let (below, above) = (x[dof] - bounds.lower[i], bounds.upper[i] - x[dof]);
        // Free dofs within their bounds add nothing.
        if r == 0.0 && below >= 0.0 && above >= 0.0 {
            continue;
        }
        let force = magnitude(dof, r);
        let [lower, upper] = bounds.rigid(i);
        let outside = larger(0.0, larger(lower - x[dof], x[dof] - upper));
        parts.penetration = larger(parts.penetration, ratio(outside, length));
        let side = usize::from(if r == 0.0 { above < 0.0 } else { r < 0.0 });
        if let Some(law) = bounds.laws.get(i, side) {
            let [force_error, depth_error] = laws::errors(&law, bounds.depth(i, side, x[dof]), r.abs());
            let error = ratio(depth_error, length).min(ratio(force_error, force));
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
    parts
}
