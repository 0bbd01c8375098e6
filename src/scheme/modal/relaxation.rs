//! Step length at which a relaxed step keeps the energy.

use std::ops::Range;

/// Largest number of trials; about four suffice.
const MOST_TRIALS: usize = 60;

/// Returns the root of `excess` in `range` that is nearest to 1, to a value of `enough`; `None` if
/// there is none.
///
/// `excess` returns value and slope at gamma. The search is Newton's method with the curvature from
/// the last two slopes, inside a bracket in which the value rises.
pub(super) fn root(mut excess: impl FnMut(f64) -> (f64, f64), range: Range<f64>, enough: f64) -> Option<f64> {
    let (mut below, mut above) = (None, None);
    let (mut gamma, mut last) = (1.0, None::<(f64, f64)>);
    let mut best = (f64::INFINITY, gamma);
    for _ in 0..MOST_TRIALS {
        let (value, slope) = excess(gamma);
        if value.abs() < best.0 {
            best = (value.abs(), gamma);
        }
        if value.abs() <= enough {
            return Some(gamma);
        }
        if value.is_nan() || gamma <= range.start && value > 0.0 || gamma >= range.end && value < 0.0 {
            return None;
        }
        *(if value < 0.0 { &mut below } else { &mut above }) = Some(gamma);
        let curvature = last.map_or(0.0, |(at, before)| ((slope - before) / (gamma - at)).max(0.0));
        last = Some((gamma, slope));
        // The larger root of value + slope h + curvature h^2 / 2.
        let discriminant = (slope * slope - 2.0 * value * curvature).max(0.0).sqrt();
        let mut next = gamma - 2.0 * value / (slope + discriminant);
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
    }
    Some(best.1)
}
