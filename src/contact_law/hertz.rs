//! Law of Hertz (1881) for elastic bodies with curved surfaces: with the depth d,
//!
//! ```math
//! r = k\, d_+^{3/2}, \qquad \varphi = \tfrac25\, k\, d_+^{5/2} .
//! ```

use super::{ContactLaw, Tangent};

/// Law of Hertz with its stiffness k, in N/m^1.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hertz(pub f64);

impl ContactLaw for Hertz {
    fn force(&self, depth: f64) -> f64 {
        if depth > 0.0 { self.0 * depth * depth.sqrt() } else { 0.0 }
    }

    fn depth(&self, force: f64) -> f64 {
        let root = (force / self.0).cbrt();
        root * root
    }

    fn energy(&self, depth: f64) -> f64 {
        0.4 * depth * self.force(depth)
    }

    fn linearised(&self, depth: f64, _: f64) -> Tangent {
        let stiffness = if depth > 0.0 { 1.5 * self.0 * depth.sqrt() } else { 0.0 };
        Tangent { force: self.force(depth), stiffness }
    }
}
