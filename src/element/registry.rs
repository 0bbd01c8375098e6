//! Registry of the elements: what each is called, which cells carry it, and how it is built.
//!
//! Meshes, scenes, studies and commands ask this registry and name no element themselves, unless
//! they are about that very element. A new element is a file of its own, which builds an
//! [`Element`] on a triangle or a quadrilateral, and a variant of [`ElementKind`] with a row here.

use super::{AnyElement, Element, fvs, hct};
use crate::error::{Error, Result};
use crate::geometry::Point;
use serde::{Deserialize, Serialize};

/// Kind of element, which determines the shape of the cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// Reduced Hsieh-Clough-Tocher triangles.
    Hct,
    /// Reduced Fraeijs de Veubeke-Sander quadrilaterals.
    Fvs,
}

/// Row of the registry.
#[derive(Debug)]
struct RegistryRow {
    /// Name in a scene.
    name: &'static str,
    /// Name of the cells in titles of figures, in the plural.
    title: &'static str,
    /// Function that creates the element, whose argument tells the shape of the cells.
    builder: Builder,
}

/// Function that creates an element on the vertices of a cell, counter-clockwise, in m.
#[derive(Clone, Copy, Debug)]
enum Builder {
    Triangle(fn([Point; 3]) -> Result<Element<9>>),
    Quadrilateral(fn([Point; 4]) -> Result<Element<12>>),
}

const HCT: RegistryRow =
    RegistryRow { name: "hct", title: "HCT triangles", builder: Builder::Triangle(hct::element) };

const FVS: RegistryRow =
    RegistryRow { name: "fvs", title: "FVS quadrilaterals", builder: Builder::Quadrilateral(fvs::element) };

impl ElementKind {
    /// All elements.
    pub const ALL: [ElementKind; 2] = [ElementKind::Hct, ElementKind::Fvs];

    /// Returns the row of the element in the registry.
    const fn row(self) -> &'static RegistryRow {
        match self {
            ElementKind::Hct => &HCT,
            ElementKind::Fvs => &FVS,
        }
    }

    /// Returns the name in a scene.
    pub const fn name(self) -> &'static str {
        self.row().name
    }

    /// Returns the name of the cells in titles of figures, in the plural.
    pub const fn title(self) -> &'static str {
        self.row().title
    }

    /// Returns the shape of the cells.
    pub const fn shape(self) -> CellShape {
        match self.row().builder {
            Builder::Triangle(_) => CellShape::Triangle,
            Builder::Quadrilateral(_) => CellShape::Quadrilateral,
        }
    }

    /// Creates the element on a cell with counter-clockwise vertices, in m.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] if the cell is degenerate, clockwise, not strictly convex, not
    /// finite, or of another shape.
    pub fn on(self, vertices: &[Point]) -> Result<AnyElement> {
        match (self.row().builder, vertices) {
            (Builder::Triangle(build), &[a, b, c]) => Ok(AnyElement::Triangle(build([a, b, c])?)),
            (Builder::Quadrilateral(build), &[a, b, c, d]) => {
                Ok(AnyElement::Quadrilateral(build([a, b, c, d])?))
            }
            _ => {
                let (name, count) = (self.name(), vertices.len());
                Err(Error::Mesh(format!("a cell of {count} vertices carries no \"{name}\" element")))
            }
        }
    }
}

/// Shape of a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellShape {
    /// Triangle.
    Triangle,
    /// Strictly convex quadrilateral.
    Quadrilateral,
}

impl CellShape {
    /// Returns the number of cells of this shape into which a rectangle is divided.
    pub const fn per_rectangle(self) -> usize {
        match self {
            CellShape::Triangle => 2,
            CellShape::Quadrilateral => 1,
        }
    }
}

/// Elements that the cells of a mesh carry, one kind per shape.
///
/// By default triangles carry [`hct`] and quadrilaterals [`fvs`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ElementByShape {
    triangle: ElementKind,
    quadrilateral: ElementKind,
}

impl Default for ElementByShape {
    fn default() -> ElementByShape {
        ElementByShape { triangle: ElementKind::Hct, quadrilateral: ElementKind::Fvs }
    }
}

impl From<ElementKind> for ElementByShape {
    /// Makes the cells of the element's shape carry it, and the others the default.
    fn from(kind: ElementKind) -> ElementByShape {
        match kind.shape() {
            CellShape::Triangle => ElementByShape { triangle: kind, ..ElementByShape::default() },
            CellShape::Quadrilateral => ElementByShape { quadrilateral: kind, ..ElementByShape::default() },
        }
    }
}

impl ElementByShape {
    /// Returns the element on cells of a shape.
    pub fn of(self, shape: CellShape) -> ElementKind {
        match shape {
            CellShape::Triangle => self.triangle,
            CellShape::Quadrilateral => self.quadrilateral,
        }
    }
}
