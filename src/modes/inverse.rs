//! Inverse of K + s M, factored anew where another shift s tells the wanted modes apart better.

use super::blocks::{multiply, random_block};
use crate::error::{Error, Result};
use crate::linalg::{ColumnSolver, Engine, Form};
use faer::Mat;

/// Shift for a mechanism, relative to the largest wanted eigenvalue, and the factor by which it may
/// be off. The shift is small against the wanted eigenvalues and large against rounding.
const SHIFT: f64 = 1e-4;
const SHIFT_DRIFT: f64 = 100.0;

/// Smallest shift relative to the Rayleigh quotient of a random vector, which is near the largest
/// eigenvalue: a smaller shift would be lost in the rounding of K.
const LEAST_SHIFT: f64 = 1e-13;

/// Spread of the wanted eigenvalues, relative to the smallest, below which they are a cluster that
/// the inverse of K hardly tells apart: those of a soft plate on a stiff bed.
const CLUSTER: f64 = 0.1;

/// Smallest distance of the shift from a cluster, as for [`LEAST_SHIFT`], the factor by which it
/// has to come nearer to be worth a factorisation, and the factor by which it backs away from a
/// cluster that begins below it.
const LEAST_DISTANCE: f64 = 1e-12;
const NEARER: f64 = 0.1;
const BACK: f64 = 10.0;

/// Operator (K + s M)^-1. On what is orthogonal to the modes below -s it is positive definite.
///
/// Where K belongs to a mechanism, s is positive. Where the wanted modes, but for the lowest ones,
/// are a cluster, s is negative, and -s lies below the cluster by about its spread. Elsewhere s is
/// 0.
pub(super) struct ShiftedInverse<'e, E: Engine> {
    pub engine: &'e E,
    pub stiffness: &'e Form,
    pub mass: &'e Form,
    pub mechanism: bool,
    /// Shift s, in (rad/s)^2.
    pub shift: f64,
    /// Number of vectors solved for.
    pub solves: usize,
    /// Number of modes below -s.
    pub below: usize,
    solver: ColumnSolver,
    least_shift: f64,
}

impl<'e, E: Engine> ShiftedInverse<'e, E> {
    /// Factors K, or K + s M for a mechanism; `share` estimates the largest wanted eigenvalue
    /// relative to the largest of all. Collective.
    pub fn new(
        engine: &'e E,
        [stiffness, mass]: [&'e Form; 2],
        mechanism: bool,
        wanted: impl FnOnce(f64) -> f64,
    ) -> Result<ShiftedInverse<'e, E>> {
        let (mut shift, mut least_shift) = (0.0, 0.0);
        if mechanism {
            let quotient = rayleigh_quotient(engine, stiffness, mass)?;
            least_shift = LEAST_SHIFT * quotient;
            shift = (SHIFT * wanted(quotient)).max(least_shift);
            if !(shift > 0.0 && shift.is_finite()) {
                return Err(Error::Singular("the structure has no stiffness or no mass".into()));
            }
        }
        let solver = solver(engine, stiffness, mass, shift)?;
        Ok(ShiftedInverse {
            engine,
            stiffness,
            mass,
            mechanism,
            shift,
            solves: 0,
            below: 0,
            solver,
            least_shift,
        })
    }

    /// Factors again where the shift is far from the best one for the largest wanted eigenvalue.
    /// Returns whether it did. Collective.
    pub fn adapt(&mut self, largest_wanted: f64) -> Result<bool> {
        let best = (SHIFT * largest_wanted).max(self.least_shift);
        let near = self.shift <= SHIFT_DRIFT * best && best <= SHIFT_DRIFT * self.shift;
        if !self.mechanism || near || self.shift < 0.0 {
            return Ok(false);
        }
        self.solver = solver(self.engine, self.stiffness, self.mass, best)?;
        self.shift = best;
        Ok(true)
    }

    /// Factors again with the shift just below a cluster among the wanted eigenvalues, given in
    /// ascending order, so that the inverse tells its modes apart like those of a plate without a
    /// bed. The modes below the cluster, at most as many as in it, must be among the first ones,
    /// which have `converged`. Returns their number if it did. Collective.
    ///
    /// The inertia proves that no other eigenvalue lies below the shift, on engines that count.
    pub fn approach(&mut self, wanted: &[f64], converged: usize) -> Result<Option<usize>> {
        let Some(last) = wanted.last() else { return Ok(None) };
        let below = wanted.partition_point(|square| last - square > CLUSTER * square.abs());
        let (first, spread) = (wanted[below], last - wanted[below]);
        if below > converged || 2 * below > wanted.len() || spread < 0.0 {
            return Ok(None);
        }
        let least = LEAST_DISTANCE * rayleigh_quotient(self.engine, self.stiffness, self.mass)?;
        let mut distance = spread.max(least);
        while distance < NEARER * (first + self.shift) {
            let sigma = first - distance;
            match self.engine.factor_beyond(self.stiffness, self.mass, sigma)? {
                None => return Ok(None),
                Some(factor) if factor.negative == below => {
                    (self.shift, self.below, self.solver) = (-sigma, below, factor.solve);
                    return Ok(Some(below));
                }
                Some(_) => distance *= BACK,
            }
        }
        Ok(None)
    }

    /// Solves (K + s M) X = B in place, one system per column. Collective.
    pub fn solve(&mut self, x: &mut Mat<f64>) -> Result<()> {
        self.solves += x.ncols();
        (self.solver)(x)
    }
}

/// Returns the Rayleigh quotient of a random vector, which is near the largest eigenvalue.
fn rayleigh_quotient<E: Engine>(engine: &E, stiffness: &Form, mass: &Form) -> Result<f64> {
    let x = random_block(engine, 1, 0);
    Ok(multiply(engine, stiffness, &x)?.1[0] / multiply(engine, mass, &x)?.1[0])
}

/// Returns the solver of K + s M, which is positive definite.
fn solver<E: Engine>(engine: &E, stiffness: &Form, mass: &Form, shift: f64) -> Result<ColumnSolver> {
    let sum = if shift != 0.0 { stiffness + mass * shift } else { stiffness.into() };
    let mut factor = engine.factor(&sum, &[])?;
    Ok(Box::new(move |x| factor.solve_columns(x)))
}
