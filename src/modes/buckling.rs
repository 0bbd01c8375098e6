//! Buckling of a plate under forces in its plane.
//!
//! With the stiffness K without these forces and their geometric stiffness G the plate buckles at
//! the multiples lambda of the forces for which
//!
//! ```math
//! (K + \lambda G)\, x = 0
//! ```
//!
//! has a solution. K is positive definite, and G may have both signs. Whether `$K + \lambda G$` has
//! a factor brackets the nearest multiple of either sign; inverse iteration from the inner end
//! of the bracket yields it with its shape.

use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::linalg::vectors::{copy_scaled, largest};
use crate::linalg::{Engine, Factor, Form};
use crate::random::random_vector;

/// Buckling load and shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Buckling {
    /// Multiple of the forces at which the plate buckles; negative where they must be reversed.
    pub factor: f64,
    /// Shape, in m with 1 as its largest magnitude, one entry per dof.
    pub shape: Vec<f64>,
}

/// Largest multiple that is sought.
const MOST: f64 = 1e9;

/// Relative width of the bracket from which inverse iteration starts.
const BRACKET: f64 = 0.05;

/// Number of inverse iterations, and the relative change at which they end.
const ITERATIONS: usize = 300;
const SETTLED: f64 = 1e-12;

/// Returns whether the plate bears the forces of geometric stiffness G. Collective.
///
/// # Errors
/// Returns the errors of the engine.
pub fn bears<E: Engine>(engine: &E, forms: [&Form; 2]) -> Result<bool> {
    Ok(factor(engine, forms, 1.0)?.is_some())
}

/// Returns the buckling load nearest to zero; `None` where the forces neither press the plate nor
/// would if they were reversed. Collective.
///
/// # Errors
/// Returns [`Error::Singular`] where K is singular, and the errors of the engine.
pub fn lowest<E: Engine>(engine: &E, forms: [&Form; 2]) -> Result<Option<Buckling>> {
    let mut nearest: Option<Buckling> = None;
    for sign in [1.0, -1.0] {
        let most = nearest.as_ref().map_or(MOST, |buckling| buckling.factor.abs());
        let is_nearer = |buckling: &Buckling| buckling.factor.abs() < most;
        nearest = of_sign(engine, forms, sign, most)?.filter(is_nearer).or(nearest);
    }
    Ok(nearest)
}

/// Returns the nearest buckling load of a sign, up to a multiple of the forces.
fn of_sign<E: Engine>(engine: &E, forms: [&Form; 2], sign: f64, most: f64) -> Result<Option<Buckling>> {
    let (mut low, mut high) = (0.0, 1.0_f64.min(most));
    while factor(engine, forms, sign * high)?.is_some() {
        low = high;
        if high >= most {
            return Ok(None);
        }
        high = (2.0 * high).min(most);
    }
    while high - low > BRACKET * high {
        let middle = if low > 0.0 { 0.5 * (low + high) } else { 0.1 * high };
        if middle < 1.0 / MOST {
            let wrong =
                "in_plane: nothing holds the plate, or the forces are more than 1e9 times its buckling load";
            return Err(Error::Singular(wrong.into()));
        }
        match factor(engine, forms, sign * middle)? {
            Some(_) => low = middle,
            None => high = middle,
        }
    }
    let Some(mut inverse) = factor(engine, forms, sign * low)? else { return Ok(None) };
    let [stiffness, geometric] = forms;
    let mut shape = random_vector(engine.dofs(), 1 + engine.comm().rank() as u64);
    let (mut product, mut above) = (vec![0.0; shape.len()], f64::INFINITY);
    for _ in 0..ITERATIONS {
        engine.multiply(geometric, &shape, &mut product)?;
        copy_scaled(-sign, &product, &mut shape);
        inverse.solve(&mut shape)?;
        let size = engine.dot(&shape, &shape)?.sqrt();
        shape.iter_mut().for_each(|x| *x /= size);
        let pressed = -sign * engine.multiply(geometric, &shape, &mut product)?;
        let bent = engine.multiply(stiffness, &shape, &mut product)?;
        let last = std::mem::replace(&mut above, bent / pressed);
        if (above - last).abs() <= SETTLED * above {
            break;
        }
    }
    let size = engine.comm().all_reduce_max(largest(shape.iter().copied()));
    shape.iter_mut().for_each(|x| *x /= size);
    Ok(Some(Buckling { factor: sign * above, shape }))
}

/// Returns the factor of `$K + \lambda G$`; `None` where it is not positive definite.
fn factor<E: Engine>(engine: &E, [k, g]: [&Form; 2], lambda: f64) -> Result<Option<Box<dyn Factor>>> {
    match engine.factor(&(k * 1.0 + g * lambda), &[]) {
        Ok(factor) => Ok(Some(factor)),
        Err(Error::Singular(_)) => Ok(None),
        Err(other) => Err(other),
    }
}
