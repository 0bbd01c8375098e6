//! Static equilibrium, to the last digit.

use crate::error::Result;
use crate::linalg::Engine;
use crate::obstacle::Bounds;
use crate::vi::{Condensed, Step, Verdict};

/// Corrections after the first solve. The first removes what rounding the entries of the factored K has spoilt
/// (some 1e-16 h^-4); the second is there for the finest meshes.
const CORRECTIONS: usize = 2;

/// Equilibrium under a load within bounds: K U = F + G^T r. Returns U, r and what the solver reached.
///
/// The factored K loses digits as h^-4; corrections by its residual, K applied cell by cell, bring them back.
///
/// # Errors
/// [`crate::Error::Singular`] where K is: the structure is a mechanism.
pub fn equilibrium<E: Engine + 'static>(
    engine: &E,
    stiffness: &E::Form,
    load: &[f64],
    bounds: &Bounds,
) -> Result<(Vec<f64>, Vec<f64>, Verdict)>
where
    E::Factor: 'static,
{
    let sum = [(1.0, stiffness)];
    let dofs = engine.dofs();
    let mut step: Step<E> = Step::new(Box::new(Condensed::new(engine, &sum, bounds.len())?), engine, &sum)?;
    let mut u = vec![0.0; dofs];
    let mut x = vec![0.0; dofs];
    let mut b = vec![0.0; dofs];
    let mut reaction = vec![0.0; bounds.len()];
    let mut verdict = Verdict::default();
    let mut left = bounds.clone();
    for _ in 0..=CORRECTIONS {
        engine.multiply(stiffness, &u, &mut b)?;
        b.iter_mut().zip(load).for_each(|(b, f)| *b = f - *b);
        left.shift(bounds, |dof, bound| bound - u[dof]);
        let length = engine.maximum(u.iter().fold(bounds.magnitude(), |m, u| m.max(u.abs())))?;
        let step = step.solve(engine, &sum, &b, &left, length, &mut x, &mut reaction)?;
        verdict = Verdict {
            iterations: verdict.iterations + step.iterations,
            kkt: step.kkt,
            retries: verdict.retries + step.retries,
        };
        u.iter_mut().zip(&x).for_each(|(u, x)| *u += x);
    }
    Ok((u, reaction, verdict))
}
