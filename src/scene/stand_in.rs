//! Types that belong to `crate::mesh` and `crate::plate`. Until those modules stand they live here; then this file
//! goes, and `scene` re-exports theirs.

use serde::Serialize;

/// The finite element.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// Reduced Hsieh-Clough-Tocher triangle, 9 dofs.
    Hct,
    /// Reduced Fraeijs de Veubeke-Sander quadrilateral, 12 dofs.
    Fvs,
}

/// How a rectangle is cut into two triangles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Diagonal {
    /// `/` everywhere.
    Right,
    /// `\` everywhere.
    Left,
    /// A checkerboard of both; the rectangle at the origin is `/`.
    Alternating,
}

/// Thickness and material of the plate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Plate {
    /// Full thickness, m.
    pub thickness: f64,
    /// Young's modulus, Pa.
    pub youngs_modulus: f64,
    /// Poisson's ratio.
    pub poissons_ratio: f64,
    /// Density, kg/m3.
    pub density: f64,
}
