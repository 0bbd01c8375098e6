//! Laws of contact: how the reaction of a bound depends on the depth of x beyond it.
//!
//! A bound without a law is rigid. A law is a convex energy of the depth, so that a step remains a
//! convex problem: Newton's method replaces it by its tangent, a rigid bound that lies elsewhere on
//! a compliance of its own, or a constant force. Each law is a file of its own behind
//! [`ContactLaw`]; solvers and schemes know the trait only.

mod dry_friction;
mod hertz;
mod registry;

pub use dry_friction::DryFriction;
pub use hertz::Hertz;
pub use registry::{StopLaw, StopLawSpec};

use std::fmt::Debug;
use std::sync::Arc;

/// Law of one side of a bound: a convex energy of the depth.
pub trait ContactLaw: Debug + Send + Sync {
    /// Returns the force at a depth (m), in N; 0 outside.
    fn force(&self, depth: f64) -> f64;

    /// Returns the least depth at which the law has a force (N), in m; infinite where it has none.
    fn depth(&self, force: f64) -> f64;

    /// Returns the energy at a depth (m), in J, whose derivative is the force.
    fn energy(&self, depth: f64) -> f64;

    /// Returns the tangent near a depth (m) and a force (N) of the last iteration.
    fn linearised(&self, depth: f64, force: f64) -> Tangent;
}

/// Tangent of a law: its force (N) and stiffness (N/m) at a depth. Infinite stiffness holds x at
/// the bound.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tangent {
    /// Force at the depth, in N.
    pub force: f64,
    /// Derivative of the force, in N/m.
    pub stiffness: f64,
}

/// Law of a bound on an unknown of another unit.
#[derive(Debug, Clone)]
pub struct ScaledLaw {
    law: Arc<dyn ContactLaw>,
    /// Depth of the law per depth of the unknown.
    depth_rate: f64,
    /// Force of the unknown per force of the law.
    force_rate: f64,
}

impl ScaledLaw {
    /// Returns the law for an unknown whose unit is `unit` present ones, with `force` new units of
    /// force in a present one.
    pub fn scaled(self, unit: f64, force: f64) -> ScaledLaw {
        let ScaledLaw { law, depth_rate, force_rate } = self;
        ScaledLaw { law, depth_rate: depth_rate * unit, force_rate: force_rate * force }
    }
}

impl ContactLaw for ScaledLaw {
    fn force(&self, depth: f64) -> f64 {
        self.force_rate * self.law.force(self.depth_rate * depth)
    }

    fn depth(&self, force: f64) -> f64 {
        self.law.depth(force / self.force_rate) / self.depth_rate
    }

    fn energy(&self, depth: f64) -> f64 {
        self.force_rate / self.depth_rate * self.law.energy(self.depth_rate * depth)
    }

    fn linearised(&self, depth: f64, force: f64) -> Tangent {
        let Tangent { force, stiffness } =
            self.law.linearised(self.depth_rate * depth, force / self.force_rate);
        Tangent { force: self.force_rate * force, stiffness: self.force_rate * self.depth_rate * stiffness }
    }
}

/// Laws of the lower and the upper bound of a dof; `None` for a rigid one.
pub type SidedLaws = [Option<ScaledLaw>; 2];

/// Numbers of the laws of the lower and the upper bound of a dof in their table; [`RIGID`] for a
/// rigid one.
pub type LawNumbers = [u32; 2];

/// Number of a bound without a law.
pub const RIGID: u32 = u32::MAX;

/// Laws of some bounds, from a table that all ranks share.
#[derive(Debug, Clone)]
pub struct Laws {
    /// All laws; empty where the bounds of all ranks are rigid.
    table: Arc<[Arc<dyn ContactLaw>]>,
    /// Laws of the two sides, one entry per bound; empty with the table.
    numbers: Vec<LawNumbers>,
    /// Depth per depth of the unknown that is bounded.
    pub rate: f64,
}

impl Default for Laws {
    /// Returns the laws of rigid bounds.
    fn default() -> Laws {
        Laws { table: Arc::new([]), numbers: Vec::new(), rate: 1.0 }
    }
}

impl Laws {
    /// Creates the laws of bounds from their numbers in a table, which is the same on all ranks.
    pub fn new(table: Vec<Arc<dyn ContactLaw>>, numbers: Vec<LawNumbers>) -> Laws {
        Laws { numbers: if table.is_empty() { Vec::new() } else { numbers }, table: table.into(), rate: 1.0 }
    }

    /// Returns whether the bounds of all ranks are rigid.
    pub fn are_rigid(&self) -> bool {
        self.table.is_empty()
    }

    /// Returns the numbers of the laws of a bound.
    pub fn numbers(&self, bound: usize) -> LawNumbers {
        self.numbers.get(bound).copied().unwrap_or([RIGID; 2])
    }

    /// Returns whether a bound has a law on either side.
    pub fn has(&self, bound: usize) -> bool {
        self.numbers(bound) != [RIGID; 2]
    }

    /// Returns laws from the same table for other bounds.
    pub fn with(&self, numbers: Vec<LawNumbers>) -> Laws {
        Laws { table: self.table.clone(), numbers, rate: self.rate }
    }

    /// Returns the laws with numbers in the table.
    pub fn numbered(&self, numbers: LawNumbers) -> SidedLaws {
        numbers.map(|number| {
            let law = self.table.get(number as usize)?.clone();
            Some(ScaledLaw { law, depth_rate: self.rate, force_rate: 1.0 })
        })
    }

    /// Returns the law of the lower (0) or upper (1) bound of a dof; `None` for a rigid one.
    pub fn get(&self, bound: usize, side: usize) -> Option<ScaledLaw> {
        let [law, _] = self.numbered([self.numbers(bound)[side], RIGID]);
        law
    }

    /// Returns the law that exerts a reaction (N, positive upwards); `None` for a rigid bound.
    pub fn pressed(&self, bound: usize, reaction: f64) -> Option<ScaledLaw> {
        self.get(bound, usize::from(reaction < 0.0))
    }

    /// Returns the energy stored in the bounds under given reactions (N), in J.
    pub fn stored_under(&self, reaction: &[f64]) -> f64 {
        let stored = |(bound, r): (usize, &f64)| {
            self.pressed(bound, *r).map_or(0.0, |law| law.energy(law.depth(r.abs())))
        };
        let reactions = if self.are_rigid() { &[] } else { reaction };
        reactions.iter().enumerate().map(stored).sum()
    }
}
