//! Table `[damping]`: losses of the plate.

use super::entry::table;
use super::kinds::not_negative;

table! {
    /// Damping of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Damping {
        /// Rayleigh coefficient alpha, for a force -alpha M V; every scheme.
        mass: f64 = not_negative("a rate", "1/s").says("1/s, Rayleigh's alpha").or(0.0);
        /// Rayleigh coefficient beta, for a force -beta K V; `newmark` and `midpoint`, with the
        /// modal mass every scheme.
        stiffness: f64 = not_negative("a time", "s").says("s, Rayleigh's beta").or(0.0);
        /// Damping ratios of the lowest modes, in ascending order of frequency and without rigid
        /// motions; `newmark` and `midpoint`, with the modal mass every scheme.
        modal: Vec<f64> = not_negative("a damping ratio", "")
            .array("expected an array of the damping ratios of the first modes")
            .says("damping ratios of the first modes").or_silent(vec![]);
    }
}
