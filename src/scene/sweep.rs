//! Table `[sweep]`: the runs that `rebond sweep` makes.

use crate::field::Field;

/// Sweep over one or two keys of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepSpec {
    /// Swept keys, one or two.
    pub over: Vec<SweptKey>,
    /// Order of the values, and whether runs carry their state on.
    pub direction: SweepOrder,
    /// Period of the drive in s: a number, or a formula of the parameters.
    pub period: Field,
    /// Periods of each run.
    pub periods: u64,
    /// Periods of each run before the measured ones.
    pub settle: u64,
    /// Distance of points of a section that counts as none, relative to the range of the motion.
    pub tolerance: f64,
    /// Whether the largest Lyapunov exponent is measured.
    pub lyapunov: bool,
}

impl SweepSpec {
    /// Returns the period of the drive, in s.
    pub fn period(&self) -> f64 {
        self.period.constant().unwrap_or_default()
    }
}

/// Key of the scene with the values that it takes.
#[derive(Debug, Clone, PartialEq)]
pub struct SweptKey {
    /// Name as written, which heads a column.
    pub name: String,
    /// Key of the scene, which for a parameter begins with `parameters.`.
    pub key: String,
    /// Values, in the order of the sweep.
    pub values: Vec<f64>,
    /// Values as written.
    pub text: String,
}

/// Order of the values of the first key, and start of each run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SweepOrder {
    /// Each run starts as the scene says.
    Apart,
    /// Each run starts where the run of the value before ended.
    Up,
    /// Each run starts where the run of the value after ended.
    Down,
    /// All values up, then all values down.
    UpAndDown,
}
