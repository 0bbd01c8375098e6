//! Dry friction of a given normal force behind a spring, the element of Jenkins: with the depth d,
//!
//! ```math
//! r = \min(k\, d_+,\; F) .
//! ```
//!
//! Two bounds at one place, the anchor of the spring, make it resist in both directions. Once the
//! force has reached F the anchor follows x, and F times its way is dissipated. Without a spring
//! the anchor is x itself, and the law is rigid up to F.

use super::{ContactLaw, Tangent};

/// Law of dry friction behind a spring.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DryFriction {
    /// Force F at which it slips, in N.
    pub force: f64,
    /// Stiffness k of its spring, in N/m; infinite without one.
    pub stiffness: f64,
}

impl ContactLaw for DryFriction {
    fn force(&self, depth: f64) -> f64 {
        if depth > 0.0 { (self.stiffness * depth).min(self.force) } else { 0.0 }
    }

    fn depth(&self, force: f64) -> f64 {
        if force <= self.force { force / self.stiffness } else { f64::INFINITY }
    }

    fn energy(&self, depth: f64) -> f64 {
        let elastic = depth.clamp(0.0, self.force / self.stiffness);
        self.force(depth) * (depth.max(0.0) - 0.5 * elastic)
    }

    /// Without a spring, x is held while it takes no more than F to hold it, and once it has come
    /// back from a slip.
    fn linearised(&self, depth: f64, force: f64) -> Tangent {
        let DryFriction { force: most, stiffness } = *self;
        if stiffness.is_infinite() && depth <= 0.0 && force > 0.0 {
            let is_held = depth < 0.0 || force <= most;
            return Tangent { force: most, stiffness: if is_held { f64::INFINITY } else { 0.0 } };
        }
        let stretches = depth > 0.0 && stiffness * depth < most;
        Tangent { force: self.force(depth), stiffness: if stretches { stiffness } else { 0.0 } }
    }
}
