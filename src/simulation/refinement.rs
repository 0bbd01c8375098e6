//! Acceptance of the special quadrature rules that a field needs.

use crate::element::adaptive::{Refined, Rules};
use crate::error::{Error, Result};

/// Largest uncertain part of a field's integral that is accepted where its refinement stopped.
const LEFT: f64 = 0.01;

/// Returns the quadrature rules found for the field of a key, or an error where too much of its
/// integral is uncertain.
pub(super) fn seen(key: &str, refined: Refined) -> Result<Rules> {
    let Refined { rules, size, left, .. } = refined;
    if left <= LEFT * size {
        return Ok(rules);
    }
    Err(Error::Scene(format!(
        "{key}: its integral over the plate is {size:.3e}, of which {left:.3e} are not certain after all refinement; expected a \
         formula whose jumps and peaks are wider, or a finer mesh"
    )))
}
