//! Search for the relaxation gamma at which a step keeps the energy, for all schemes that relax
//! their steps.

use crate::error::Result;
use std::ops::Range;

/// Largest number of trials of gamma. About four suffice; where rounding hides the root, bisection
/// closes the bracket.
const MOST_TRIALS: usize = 60;

/// Relative difference of times that is rounding.
pub(super) const SAME_TIME: f64 = 1e-9;

/// Step from (q, v) by (dq, dv), taken to the state (q + gamma dq, v + gamma dv) for a gamma that
/// the search changes.
pub(super) trait RelaxedStep {
    /// Computes the state at gamma.
    fn move_to(&mut self, gamma: f64) -> Result<()>;

    /// Returns the energy of the present state beyond its target, and the error at which the search
    /// ends, in J.
    fn excess(&self) -> Result<[f64; 2]>;

    /// Returns the derivative of the excess with respect to gamma at the present state, in J.
    fn slope(&mut self) -> Result<f64>;
}

/// Finds the larger root gamma of the energy excess, starting from the present state at gamma = 1,
/// and leaves the step there. Returns `None` where the root is outside `range`.
///
/// The search is Newton's method with the curvature from the last two slopes, inside a bracket in
/// which the excess rises.
///
/// # Errors
/// Returns the errors of the step.
pub(super) fn root(step: &mut impl RelaxedStep, range: Range<f64>) -> Result<Option<f64>> {
    let (mut below, mut above) = (None, None);
    let mut gamma = 1.0;
    let mut last: Option<(f64, f64)> = None;
    let mut best = (f64::INFINITY, gamma);
    for _ in 0..MOST_TRIALS {
        let [excess, enough] = step.excess()?;
        if excess.abs() <= enough {
            return Ok(Some(gamma));
        }
        if excess.abs() < best.0 {
            best = (excess.abs(), gamma);
        }
        if gamma <= range.start && excess > 0.0 || gamma >= range.end && excess < 0.0 {
            return Ok(None);
        }
        *(if excess < 0.0 { &mut below } else { &mut above }) = Some(gamma);
        let slope = step.slope()?;
        let curvature =
            last.map_or(0.0, |(abscissa, before)| ((slope - before) / (gamma - abscissa)).max(0.0));
        last = Some((gamma, slope));
        // The larger root of excess + slope h + curvature h^2 / 2.
        let discriminant = (slope * slope - 2.0 * excess * curvature).max(0.0).sqrt();
        let mut next = gamma - 2.0 * excess / (slope + discriminant);
        let nearest = |next: f64| (next - gamma).abs() <= f64::EPSILON * gamma;
        let (low, high) = (below.unwrap_or(range.start), above.unwrap_or(range.end));
        if !(low < next && next < high || nearest(next)) {
            next = match (below, above) {
                (None, _) => low,
                (_, None) => high.min(2.0 * gamma),
                _ => 0.5 * (low + high),
            };
        }
        if nearest(next) {
            break;
        }
        gamma = next;
        step.move_to(gamma)?;
    }
    // The root is resolved to rounding, or hidden by it.
    if gamma != best.1 {
        step.move_to(best.1)?;
    }
    Ok(Some(best.1))
}
