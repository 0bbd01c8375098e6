//! Active-set methods: block principal pivoting, and the dense box-constrained problem.
//!
//! Each iteration exchanges every index that violates a condition (the primal-dual active set
//! method). If it returns to active sets already tried, single exchanges of the last such index
//! follow until fewer indices violate a condition than ever before (Murty 1974; Júdice and Pires
//! 1994). The iteration is finite for every symmetric positive definite matrix, however degenerate.

use crate::archive::{Archive, VectorKind};
use crate::error::Result;
use crate::hash;
use crate::vi::{Answer, Problem};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::linalg::cholesky::llt::factor::{LltRegularization, cholesky_in_place, cholesky_in_place_scratch};
use faer::{Mat, MatMut, Par, Spec};
use smallvec::SmallVec;
use std::collections::HashSet;
use std::mem::MaybeUninit;

/// Number of candidates up to which a dense problem takes no memory from the heap, and the bytes
/// that its factorisation then needs.
const FEW: usize = 32;
const SCRATCH: usize = 4096;

/// Numbers, one per candidate.
type Few = SmallVec<[f64; FEW]>;

/// Status of a bounded dof.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default, serde::Serialize, serde::Deserialize)]
pub enum BoundStatus {
    /// Between the bounds.
    #[default]
    Free,
    /// On the lower bound.
    Lower,
    /// On the upper bound.
    Upper,
}

impl BoundStatus {
    /// Returns the status with the code `side as u8`.
    pub(super) fn from_code(code: u8) -> BoundStatus {
        [BoundStatus::Free, BoundStatus::Lower, BoundStatus::Upper][usize::from(code) % 3]
    }

    /// Returns -1 on the lower bound, 1 on the upper one, and 0 between them.
    pub(super) fn sign(self) -> i8 {
        match self {
            BoundStatus::Lower => -1,
            BoundStatus::Free => 0,
            BoundStatus::Upper => 1,
        }
    }

    /// Returns the status of a sign, which is opposite to the reaction's.
    pub(super) fn of_sign(sign: f64) -> BoundStatus {
        match sign {
            sign if sign < 0.0 => BoundStatus::Lower,
            sign if sign > 0.0 => BoundStatus::Upper,
            _ => BoundStatus::Free,
        }
    }

    /// Returns the bound at which x lies; `None` between both.
    pub(super) fn value(self, lower: f64, upper: f64) -> Option<f64> {
        match self {
            BoundStatus::Free => None,
            BoundStatus::Lower => Some(lower),
            BoundStatus::Upper => Some(upper),
        }
    }

    /// Saves or restores statuses, one per bound.
    pub(super) fn archive(sides: &mut [BoundStatus], archive: &mut Archive) -> Result<()> {
        archive.items(
            VectorKind::Bounds,
            sides,
            |&side| [f64::from(side as u8)],
            |[code]| BoundStatus::from_code(code as u8),
        )
    }

    /// Returns this status if its bound is finite, otherwise `Free`: a bound may have gone since
    /// the last step.
    pub(super) fn within(self, lower: f64, upper: f64) -> BoundStatus {
        if self.value(lower, upper).is_some_and(f64::is_finite) { self } else { BoundStatus::Free }
    }
}

/// Number of roundings of the magnitude of its row that a reaction of the wrong sign must exceed.
pub(crate) const SIGN_ROUNDINGS: f64 = 64.0;

/// Choice among the indices that violate a condition.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Move {
    /// Exchange all of them.
    All,
    /// Exchange the last one only.
    Last,
}

/// Exchange rule, with its memory of the active sets tried.
#[derive(Debug)]
pub(super) struct Exchange {
    /// Fingerprints of the active sets tried.
    tried: HashSet<u64>,
    /// Fewest indices that violated a condition so far.
    fewest: usize,
    /// Bound below which the number of violated conditions must fall to end single exchanges.
    single_above: Option<usize>,
    /// Number of exchanges so far.
    pub iterations: u32,
    limit: u32,
}

impl Exchange {
    pub fn new(size: usize) -> Exchange {
        let limit = u32::try_from(size).unwrap_or(u32::MAX).saturating_mul(64).saturating_add(256);
        Exchange { tried: HashSet::new(), fewest: usize::MAX, single_above: None, iterations: 0, limit }
    }

    /// Forgets the active sets tried, which were found from answers of fewer digits.
    pub fn forget(&mut self) {
        self.tried.clear();
        (self.fewest, self.single_above) = (usize::MAX, None);
    }

    /// Chooses the next exchange for `broken` violated conditions at the active sets whose
    /// fingerprint is called for. Returns `None` where no condition is violated, or at the limit.
    pub fn next(&mut self, broken: usize, fingerprint: impl FnOnce() -> u64) -> Option<Move> {
        if broken == 0 || self.iterations == self.limit {
            return None;
        }
        self.iterations += 1;
        self.fewest = self.fewest.min(broken);
        if self.single_above.is_some_and(|bound| broken < bound) {
            self.single_above = None;
        }
        if self.single_above.is_none() && !self.tried.insert(fingerprint()) {
            self.single_above = Some(self.fewest);
        }
        Some(if self.single_above.is_some() { Move::Last } else { Move::All })
    }

    /// Exchanges indices that violate a condition. Returns `false` where none does, or at the
    /// limit.
    pub fn advance(&mut self, sides: &mut [BoundStatus], broken: &[(usize, BoundStatus)]) -> bool {
        match self.next(broken.len(), || fingerprint(sides)) {
            None => return false,
            Some(Move::All) => exchange(sides, broken),
            Some(Move::Last) => exchange(sides, &broken[broken.len() - 1..]),
        }
        true
    }
}

/// Returns a fingerprint, which different active sets share only by chance.
pub(super) fn fingerprint(sides: &[BoundStatus]) -> u64 {
    hash::fnv1a(sides.iter().map(|side| *side as u8))
}

/// Values on which the exchange of indices is decided, one entry per bound.
#[derive(Clone, Copy)]
pub(super) struct BoundValues<'a> {
    /// Lower and upper bounds on x, in m.
    pub lower: &'a [f64],
    pub upper: &'a [f64],
    /// Unknown x at the bounds, in m.
    pub x: &'a [f64],
    /// Reactions, in N.
    pub reaction: &'a [f64],
    /// Magnitude of the row of each reaction, in N. A reaction has the wrong sign only if it
    /// exceeds the rounding of its row.
    pub magnitude: &'a [f64],
}

/// Sets the reactions, given A x: A x - b where x is held or a bound that yields is loaded.
pub(super) fn set_reactions(
    sides: &[BoundStatus],
    &Problem { rhs: b, bounds, .. }: &Problem,
    product: &[f64],
    Answer { x, reaction }: &mut Answer,
) {
    for (i, &dof) in bounds.dofs.iter().enumerate() {
        let force = product[dof] - b[dof];
        let bears = sides[i] != BoundStatus::Free || bounds.reaction(i, x[dof]) * force > 0.0;
        reaction[i] = if bears { force } else { 0.0 };
    }
}

/// Returns the indices that violate a condition, ascending, and the statuses they should have.
pub(super) fn broken(sides: &[BoundStatus], values: BoundValues) -> Vec<(usize, BoundStatus)> {
    let BoundValues { lower, upper, x, reaction, magnitude } = values;
    let wanted = |i: usize| {
        let rounding = SIGN_ROUNDINGS * f64::EPSILON * magnitude[i];
        match sides[i] {
            BoundStatus::Free if x[i] < lower[i] => BoundStatus::Lower,
            BoundStatus::Free if x[i] > upper[i] => BoundStatus::Upper,
            BoundStatus::Lower if reaction[i] < -rounding && lower[i] < upper[i] => BoundStatus::Free,
            BoundStatus::Upper if reaction[i] > rounding && lower[i] < upper[i] => BoundStatus::Free,
            stays => stays,
        }
    };
    (0..sides.len()).map(|i| (i, wanted(i))).filter(|(i, side)| *side != sides[*i]).collect()
}

/// Sets the statuses of some indices.
pub(super) fn exchange(sides: &mut [BoundStatus], moves: &[(usize, BoundStatus)]) {
    for &(i, side) in moves {
        sides[i] = side;
    }
}

/// Dense problem H x = h + r with bounds l, u on every entry of x.
#[derive(Clone, Copy)]
pub struct DenseProblem<'a> {
    /// Matrix H, symmetric positive definite.
    pub matrix: &'a Mat<f64>,
    /// Right-hand side h.
    pub rhs: &'a [f64],
    /// Lower bounds l.
    pub lower: &'a [f64],
    /// Upper bounds u.
    pub upper: &'a [f64],
}

impl DenseProblem<'_> {
    /// Solves the problem, starting from the active sets in `sides`. Returns the number of
    /// exchanges.
    pub fn solve(&self, sides: &mut [BoundStatus], answer: &mut Answer) -> u32 {
        let DenseProblem { matrix, rhs, lower, upper } = *self;
        let Answer { x, reaction } = answer;
        let size = rhs.len();
        let mut rule = Exchange::new(size);
        let mut magnitude = Few::from_elem(0.0, size);
        let magnitude = &mut magnitude[..];
        loop {
            self.solve_fixed(sides, x);
            for ((r, m), &h) in reaction.iter_mut().zip(&mut *magnitude).zip(rhs) {
                (*r, *m) = (-h, h.abs());
            }
            for (j, &value) in x.iter().enumerate() {
                let column = matrix.col_as_slice(j);
                for ((r, m), &entry) in reaction.iter_mut().zip(&mut *magnitude).zip(column) {
                    *r += entry * value;
                    *m += (entry * value).abs();
                }
            }
            let values = BoundValues { lower, upper, x, reaction, magnitude };
            if !rule.advance(sides, &broken(sides, values)) {
                break;
            }
        }
        for (r, side) in reaction.iter_mut().zip(sides.iter()) {
            if *side == BoundStatus::Free {
                *r = 0.0;
            }
        }
        rule.iterations
    }

    /// Puts the active entries on their bounds and solves for the others.
    fn solve_fixed(&self, sides: &[BoundStatus], x: &mut [f64]) {
        let DenseProblem { matrix, rhs: h, lower, upper } = *self;
        let mut free = SmallVec::<[usize; FEW]>::new();
        for (i, side) in sides.iter().enumerate() {
            match side.value(lower[i], upper[i]) {
                None => free.push(i),
                Some(bound) => x[i] = bound,
            }
        }
        if free.is_empty() {
            return;
        }
        let rhs = |&i: &usize| {
            let entries = matrix.col_as_slice(i).iter().zip(&*x).zip(sides);
            let fixed = entries.filter(|(_, side)| **side != BoundStatus::Free);
            h[i] - fixed.map(|((entry, x), _)| entry * x).sum::<f64>()
        };
        let mut values: Few = free.iter().map(rhs).collect();
        let mut block = SmallVec::<[f64; FEW * FEW]>::new();
        for &column in &free {
            let column = matrix.col_as_slice(column);
            block.extend(free.iter().map(|&row| column[row]));
        }
        solve_in_place(MatMut::from_column_major_slice_mut(&mut block, free.len(), free.len()), &mut values);
        free.iter().zip(values).for_each(|(&i, value)| x[i] = value);
    }
}

/// Solves A x = b with a dense matrix A: b becomes x, and A is overwritten. A matrix that is not
/// positive definite to rounding gives NaN, which the KKT check reports.
fn solve_in_place(mut a: MatMut<f64>, b: &mut [f64]) {
    let size = b.len();
    let scratch = cholesky_in_place_scratch::<f64>(size, Par::Seq, Spec::default());
    let mut few = [const { MaybeUninit::uninit() }; SCRATCH];
    let mut many = (scratch.unaligned_bytes_required() > SCRATCH).then(|| MemBuffer::new(scratch));
    let stack = MemStack::new(many.as_deref_mut().unwrap_or(&mut few));
    let regularisation = LltRegularization::default();
    match cholesky_in_place(a.as_mut(), regularisation, Par::Seq, stack, Spec::default()) {
        Ok(_) => {
            let b = MatMut::from_column_major_slice_mut(b, size, 1);
            llt::solve::solve_in_place(a.as_ref(), b, Par::Seq, MemStack::new(&mut []));
        }
        Err(_) => b.fill(f64::NAN),
    }
}
