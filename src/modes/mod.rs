//! Natural modes: `$K x = (2 \pi f)^2 M x$` with the consistent or the singular mass, at any mesh
//! size.
//!
//! [`lowest_basis`], on any engine, is a block Lanczos iteration with a factored K. Rounding the
//! entries of the assembled K perturbs its low modes as h^-4. The assembled matrix therefore only
//! proposes directions: residuals and eigenvalues are those of the cell-by-cell operator. The
//! inertia of `$K - \sigma M$` counts the modes, so that none is missed. [`highest`] is Lanczos'
//! method on a factored `$K + \sigma M$`. Both find the finite modes only, because the kernel of a
//! singular mass moves without inertia.

mod basis;
mod blocks;
pub mod buckling;
mod dense;
mod inverse;
mod kept;
mod kept_columns;
mod krylov;
pub(crate) mod lanczos;
mod store;

pub use basis::{ModalBasis, ModeRange, lowest_basis};
pub(crate) use dense::modes_with_mass;
pub(crate) use kept::kept_basis;
pub(crate) use kept_columns::KeptColumns;
pub(crate) use store::current_store;
pub use store::{Store, cache_folder, keep_in};

use crate::error::{Error, Result};
use crate::linalg::vectors::{aypx, hadamard};
use crate::linalg::{Engine, Form, Native};
use crate::random::random_vector;
use basis::lowest_existing;
use std::f64::consts::TAU;

/// Natural mode.
#[derive(Debug, Clone, PartialEq)]
pub struct Mode {
    /// Frequency f, in Hz; 0 for a rigid motion.
    pub frequency: f64,
    /// Mode shape x with modal mass x^T M x = 1 kg, one entry per dof.
    pub shape: Vec<f64>,
}

/// Returns the `count` lowest natural frequencies of a stiffness and a mass, ascending and with
/// their multiplicity, or fewer if there are no more, in Hz.
///
/// # Errors
/// Returns the errors of [`shapes`].
pub fn lowest<E: Engine>(engine: &E, forms: [&Form; 2], count: usize, mechanism: bool) -> Result<Vec<f64>> {
    let modes = shapes(engine, forms, count, mechanism)?;
    Ok(modes.into_iter().map(|mode| mode.frequency).collect())
}

/// Returns the `count` lowest natural modes of a stiffness and a mass, ascending, or fewer if there
/// are no more. A modal mass has its modes with it.
///
/// `mechanism` says that K is singular: the rigid motions come first, at exactly 0 Hz.
///
/// # Errors
/// Returns the errors of [`lowest_basis`], except that a lower number of modes is none.
pub fn shapes<E: Engine>(engine: &E, forms: [&Form; 2], count: usize, mechanism: bool) -> Result<Vec<Mode>> {
    let basis;
    let (squares, shapes) = match forms[1] {
        Form::Modal { modes, .. } => (&modes.squares, &modes.shapes),
        _ => {
            basis = lowest_existing(engine, forms, ModeRange::Count(count), mechanism)?;
            (&basis.squares, &basis.shapes)
        }
    };
    let mode = |(j, square): (usize, &f64)| Mode {
        frequency: square.sqrt() / TAU,
        shape: shapes.col_as_slice(j).to_vec(),
    };
    Ok(squares.iter().take(count).enumerate().map(mode).collect())
}

/// Steps and tolerance of Lanczos' method for the highest frequency: first while sigma is sought,
/// then for the result. The tolerance is a bound, and the actual error is often near its square.
const SHIFT_SEARCH: (usize, f64) = (20, 0.1);
const HIGHEST: (usize, f64) = (400, 1e-6);

/// Largest lambda / sigma that is found while sigma is sought and afterwards, and largest growth of
/// sigma from one factorisation to the next.
const MOST_LAMBDA: f64 = 1e8;
const MOST_LAMBDA_NEARBY: f64 = 1e3;
const MOST_GROWTH: f64 = 100.0;

/// Returns the highest natural frequency, of the fastest motion that a time step has to follow, in
/// Hz.
///
/// Velocities v see the operator `$1 - \sigma W (K + \sigma M)^{-1} W^T$`, where `$W^T v$` is the
/// momentum of v; its eigenvalues are `$\lambda / (\lambda + \sigma)$`. With sigma near the largest
/// lambda, rounding does no harm. Where rows of B depend on each other, as on a plate that is held
/// all round, some velocities have no momentum and belong to no deflection. Their eigenvalue is
/// exactly 1, and is left out. Rounding may take it from 1; sigma then lies between one from which
/// lambda seems far larger and one from which it is smaller.
///
/// # Errors
/// Returns [`Error::Singular`] where K + sigma M is singular, because the mass does not see some
/// rigid motion.
pub fn highest(engine: &Native, stiffness: &Form, mass: &Form) -> Result<f64> {
    let dofs = engine.dofs();
    let x = random_vector(dofs, 1);
    let mut product = vec![0.0; dofs];
    let elastic = engine.multiply(stiffness, &x, &mut product)?;
    let mut sigma = elastic / engine.multiply(mass, &x, &mut product)?;
    let (mut accuracy, mut most) = (SHIFT_SEARCH, MOST_LAMBDA);
    let mut bracket = [0.0, f64::INFINITY];
    loop {
        let mut factor = engine.factor(&(stiffness + mass * sigma), &[])?;
        let mut u = vec![0.0; dofs];
        let operator = |v: &[f64], w: &mut [f64]| {
            engine.project_transpose(mass, v, &mut u)?;
            factor.solve(&mut u)?;
            engine.project(mass, &u, w)?;
            aypx(-sigma, v, w);
            Ok(())
        };
        let metric = |v: &[f64], w: &mut [f64]| {
            w.copy_from_slice(v);
            match mass {
                Form::Cells(_) => engine.project_transpose(mass, v, w)?,
                Form::SingularMassCells(averages) => hadamard(&averages.masses, w),
                Form::Modal { .. } => {}
            }
            Ok(())
        };
        let limit = 1.0 - 1.0 / most;
        let part = lanczos::largest(engine.velocities(mass), accuracy, limit, operator, metric)?;
        let value = sigma * part / (1.0 - part);
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::Singular("the highest natural frequency is not a positive number".into()));
        }
        if accuracy == HIGHEST {
            return Ok(value.sqrt() / TAU);
        }
        bracket[usize::from(value < sigma)] = sigma;
        let [low, high] = bracket;
        if value <= 10.0 * sigma && sigma <= 10.0 * value || high <= 2.0 * low {
            (accuracy, most) = (HIGHEST, MOST_LAMBDA_NEARBY);
        }
        // Velocities without momentum that are not told apart yet have too large a value.
        sigma = value.min(MOST_GROWTH * sigma);
        if accuracy != HIGHEST && !(low < sigma && sigma < high) {
            sigma = (low * high).sqrt();
        }
    }
}
