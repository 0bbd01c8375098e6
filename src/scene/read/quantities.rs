//! Numbers of a scene: each with its unit and the range that is allowed.

use crate::scene::typed::{Quantity, Range};

pub(in crate::scene) const LENGTH: Quantity = Quantity::new("a length in m", Range::POSITIVE);
pub(in crate::scene) const WIDTH: Quantity = Quantity::new("a width in m", Range::POSITIVE);
pub(in crate::scene) const THICKNESS: Quantity = Quantity::new("a thickness in m", Range::POSITIVE);
pub(in crate::scene) const YOUNGS_MODULUS: Quantity = Quantity::new("Young's modulus in Pa", Range::POSITIVE);
pub(in crate::scene) const POISSONS_RATIO: Quantity = Quantity::new(
    "Poisson's ratio",
    Range::new(
        " greater than -1 and less than 0.5",
        "is out of range",
        |nu| -1.0 < nu && nu < 0.5,
        &[("exclusiveMinimum", -1.0), ("exclusiveMaximum", 0.5)],
    ),
);
pub(in crate::scene) const DENSITY: Quantity = Quantity::new("a density in kg/m3", Range::POSITIVE);
pub(in crate::scene) const SHEAR_MODULUS: Quantity = Quantity::new("a shear modulus in Pa", Range::POSITIVE);
pub(in crate::scene) const GRAIN: Quantity = Quantity::new("an angle in degrees", Range::ANY);
pub(in crate::scene) const DEFLECTION: Quantity = Quantity::new("a deflection in m", Range::ANY);
pub(in crate::scene) const FORCE: Quantity = Quantity::new("a force in N", Range::ANY);
pub(in crate::scene) const FRICTION: Quantity = Quantity::new("a force in N", Range::POSITIVE);
pub(in crate::scene) const GRAVITY: Quantity = Quantity::new("an acceleration in m/s2, downward", Range::ANY);
pub(in crate::scene) const MASS: Quantity = Quantity::new("a mass in kg", Range::POSITIVE);
pub(in crate::scene) const SPRING: Quantity = Quantity::new("a stiffness in N/m", Range::POSITIVE);
pub(in crate::scene) const HERTZ: Quantity = Quantity::new("a stiffness in N/m^1.5", Range::POSITIVE);
pub(in crate::scene) const EDGE_SPRING: Quantity = Quantity::new("a stiffness in N/m2", Range::NOT_NEGATIVE);
pub(in crate::scene) const EDGE_ROTATION: Quantity =
    Quantity::new("a stiffness against rotation in N m/rad/m", Range::NOT_NEGATIVE);
pub(in crate::scene) const BENDING: Quantity = Quantity::new("a bending stiffness in N m2", Range::POSITIVE);
pub(in crate::scene) const TORSION: Quantity =
    Quantity::new("a torsional stiffness in N m2", Range::NOT_NEGATIVE);
pub(in crate::scene) const LINE_MASS: Quantity =
    Quantity::new("a mass per length in kg/m", Range::NOT_NEGATIVE);
pub(in crate::scene) const FOUNDATION: Quantity = Quantity::new("a stiffness in N/m3", Range::NOT_NEGATIVE);
pub(in crate::scene) const LINE_STOP: Quantity = Quantity::new("a stiffness in N/m2", Range::POSITIVE);
pub(in crate::scene) const AREA_STOP: Quantity = Quantity::new("a stiffness in N/m3", Range::POSITIVE);
pub(in crate::scene) const POINT_DAMPING: Quantity = Quantity::new("a damping in N s/m", Range::NOT_NEGATIVE);
pub(in crate::scene) const LINE_DAMPING: Quantity = Quantity::new("a damping in N s/m2", Range::NOT_NEGATIVE);
pub(in crate::scene) const AREA_DAMPING: Quantity = Quantity::new("a damping in N s/m3", Range::NOT_NEGATIVE);
pub(in crate::scene) const MASS_DAMPING: Quantity = Quantity::new("a rate in 1/s", Range::NOT_NEGATIVE);
pub(in crate::scene) const STIFFNESS_DAMPING: Quantity = Quantity::new("a time in s", Range::NOT_NEGATIVE);
pub(in crate::scene) const RATIO: Quantity = Quantity::new("a damping ratio", Range::NOT_NEGATIVE);
pub(in crate::scene) const HEIGHT: Quantity = Quantity::new("a height in m", Range::ANY);
pub(in crate::scene) const PRESSURE: Quantity = Quantity::new("a pressure in Pa", Range::ANY);
pub(in crate::scene) const VELOCITY: Quantity = Quantity::new("a velocity in m/s", Range::ANY);
pub(in crate::scene) const FREQUENCY: Quantity = Quantity::new("a frequency in Hz", Range::POSITIVE);
pub(in crate::scene) const BETA: Quantity = Quantity::new(
    "Newmark's beta",
    Range::new(" of at least 0.25", "is too small", |beta| beta >= 0.25, &[("minimum", 0.25)]),
);
pub(in crate::scene) const RESTITUTION: Quantity = Quantity::new(
    "a restitution coefficient",
    Range::new(
        " from 0 to 1",
        "is out of range",
        |e| (0.0..=1.0).contains(&e),
        &[("minimum", 0.0), ("maximum", 1.0)],
    ),
);
pub(in crate::scene) const STEP: Quantity = Quantity::new("a time step in s", Range::POSITIVE);
pub(in crate::scene) const END: Quantity = Quantity::new("an end time in s", Range::POSITIVE);
pub(in crate::scene) const INSTANT: Quantity = Quantity::new("an instant in s", Range::NOT_NEGATIVE);
pub(in crate::scene) const TOLERANCE: Quantity = Quantity::new(
    "a relative KKT residual",
    Range::new(
        " greater than 0 and less than 1",
        "is out of range",
        |tolerance| 0.0 < tolerance && tolerance < 1.0,
        &[("exclusiveMinimum", 0.0), ("exclusiveMaximum", 1.0)],
    ),
);
pub(in crate::scene) const ENERGY_GUARD: Quantity = Quantity::new(
    "a ratio of energies",
    Range::new(" greater than 1", "is too small", |ratio| ratio > 1.0, &[("exclusiveMinimum", 1.0)]),
);
pub(in crate::scene) const SCALE: Quantity =
    Quantity::new("a factor that makes coordinates metres", Range::POSITIVE);
pub(in crate::scene) const MERGE: Quantity = Quantity::new("a distance in m", Range::POSITIVE);
pub(in crate::scene) const COORDINATE: Quantity = Quantity::new("a coordinate in m", Range::ANY);
