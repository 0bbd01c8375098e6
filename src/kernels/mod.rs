//! Kernels: inner loops over cells and vectors, in the widest registers of the processor.
//!
//! All that is fast and hard to read stands behind this door. Forms are stored cell by cell and
//! multiplied eight cells at a time: `batch` groups the cells, `layout` orders the vectors, and
//! `cells`, `strains` and `singular_mass` multiply. `lanes`, `wide` and `simd` have loops over
//! vectors.

pub(crate) mod batch;
pub(crate) mod cells;
pub(crate) mod double_double;
pub(crate) mod lane_mask;
pub(crate) mod lane_values;
pub(crate) mod lanes;
pub(crate) mod layout;
pub(crate) mod simd;
pub(crate) mod singular_mass;
pub(crate) mod strains;
pub(crate) mod wide;
pub(crate) mod workspace;

pub use cells::CellForm;
pub(crate) use lane_mask::LaneMask;
pub(crate) use lane_values::Lanes;
pub use layout::Layout;
pub use singular_mass::SingularMassCells;

use std::rc::Rc;

/// Class of congruent cells, by its number: they have the same local values.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum CellClass {
    /// Cells of a plate. In one form, either all of these have [`ElementMatrix::bending`] or none.
    Plate(usize),
    /// Cells without: springs, foundations, and cells at supports with oblique axes.
    Bare(usize),
}

/// Contribution of one cell to a symmetric form.
#[derive(Debug, Clone, PartialEq)]
pub struct ElementMatrix {
    /// Free dof of each local dof; `None` where a support holds it at zero.
    pub dofs: Rc<[Option<usize>]>,
    /// Local matrix, symmetric, n x n, row by row.
    pub matrix: Rc<[f64]>,
    /// Factored representation of a form that vanishes on rigid motions; `None` to apply `matrix`.
    pub bending: Option<Rc<Bending>>,
    /// Class of congruent cells, which share `matrix` and `bending`.
    pub class: CellClass,
}

/// Local form that vanishes on rigid motions, for three dofs (w, w_x, w_y) per node, written as the
/// square of a root R of the deformation.
///
/// The rigid motion of the cell's first node is removed by differences. This keeps the digits that
/// an assembled stiffness loses as h^-4, and the root keeps half of those that the local matrix
/// loses as the fourth power of the cell's aspect ratio.
#[derive(Debug, Clone, PartialEq)]
pub struct Bending {
    /// Position of each node after the first, relative to the first, in m.
    pub arms: Vec<[f64; 2]>,
    /// Upper triangular root R, row by row. It acts on the dofs d of the nodes after the first,
    /// less the rigid motion of the first node; the form is |R d|^2.
    pub root: Vec<f64>,
}

/// Contribution of one cell to the singular mass `$B^T C^{-1} B$`: one row of B and its entry of C.
#[derive(Debug, Clone, PartialEq)]
pub struct SingularMassCell {
    /// Free dof of each local dof; `None` where a support holds it at zero.
    pub dofs: Rc<[Option<usize>]>,
    /// Row of B, the integrals of rho h phi_i over the cell, in kg (in kg m for a slope).
    pub row: Rc<[f64]>,
    /// Entry of C, the mass of the cell, in kg.
    pub mass: f64,
    /// Class of congruent cells, which share `row` and `mass`.
    pub class: CellClass,
}
