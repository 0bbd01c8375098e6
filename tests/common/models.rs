//! Test models: plates and scenes that tests, benches and examples share.
//!
//! Benches and examples include this file by its path, so that it needs no other file of this
//! folder. Texts of scenes are constants, which `format!` captures by name; constants that are put
//! together by `concat!` take them as `literal!(NAME)`. Each text of whole tables ends its line.
#![allow(dead_code, unused_imports, unused_macros)] // Each program uses only a part.

use rebond::plate::Plate;

/// Expands to the literal of the constant of the same name.
macro_rules! literal {
    (PAPER_SECTION) => {
        "thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770"
    };
    (PAPER_PLATE) => {
        concat!("plate = { length = 1.2, width = 0.4, ", literal!(PAPER_SECTION), " }\n")
    };
    (CLAMPED) => {
        "support = [{ edge = \"left\", kind = \"clamped\" }]\n"
    };
    (PAPER_START) => {
        concat!(literal!(PAPER_PLATE), literal!(CLAMPED), "initial = { static_pressure = 14600 }\n")
    };
    (PAPER_FALL) => {
        concat!(literal!(PAPER_START), "obstacle = [{ side = \"below\", height = -0.1 }]\n")
    };
    (PAPER_PUSH) => {
        concat!(
            literal!(PAPER_PLATE),
            literal!(CLAMPED),
            "initial = { static_pressure = -14600 }\nload = { pressure = -1e5 }\n"
        )
    };
    (UNIT_SECTION) => {
        "thickness = 1, youngs_modulus = 10.92, poissons_ratio = 0.3, density = 1"
    };
}
pub(crate) use literal;

/// Keys of a plate table for the paper's steel, 1 cm thick.
pub const PAPER_SECTION: &str = literal!(PAPER_SECTION);

/// The paper's plate of 1.2 m x 0.4 m.
pub const PAPER_PLATE: &str = literal!(PAPER_PLATE);

/// Support that clamps the left edge.
pub const CLAMPED: &str = literal!(CLAMPED);

/// The paper's plate, clamped at the left edge and released from its equilibrium under 14600 Pa.
pub const PAPER_START: &str = literal!(PAPER_START);

/// The paper's scene except for its mesh and its time: the released plate meets an obstacle 0.1 m
/// below its plane.
pub const PAPER_FALL: &str = literal!(PAPER_FALL);

/// The paper's plate, clamped at the left edge, bent down by 14600 Pa and pushed further.
pub const PAPER_PUSH: &str = literal!(PAPER_PUSH);

/// Keys of a plate table for D = 1 N m, 1 kg/m2 and nu = 0.3.
pub const UNIT_SECTION: &str = literal!(UNIT_SECTION);

/// Plate on the unit square with D = 1 N m, a mass of 1 kg and nu = 0.3.
pub const UNIT: &str = concat!("plate = { length = 1, width = 1, ", literal!(UNIT_SECTION), " }\n");

/// Strip of 1 m x 0.1 m with rigidity E h^3 / 12 = 1 N m (nu = 0) and 1 kg/m2.
pub const STRIP: &str = "plate = { length = 1, width = 0.1, thickness = 1, youngs_modulus = 12, poissons_ratio = 0, density = 1 }\n";

/// Returns the paper's plate, whose sides are 1.2 m and 0.4 m.
pub const fn plate() -> Plate {
    Plate::isotropic(0.01, 210e9, 0.3, 7770.0)
}

/// Returns a plate with D = 1 and rho h = 1: frequencies are lambda / (2 pi a^2), deflections w D /
/// (q a^4).
pub const fn unit_plate(poissons_ratio: f64) -> Plate {
    let youngs_modulus = 12.0 * (1.0 - poissons_ratio * poissons_ratio);
    Plate::isotropic(1.0, youngs_modulus, poissons_ratio, 1.0)
}
