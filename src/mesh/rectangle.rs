//! Structured meshes of a rectangle.

use super::{Cell, Mesh, Point};
use crate::error::{Error, Result};

/// Which way each rectangle is cut into two triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Diagonal {
    /// `/`: from the lower left corner to the upper right one.
    #[default]
    Right,
    /// `\`: the mirror image of [`Diagonal::Right`] under `y -> width - y`.
    Left,
    /// A checkerboard of both; the rectangle at the origin has `/`.
    Alternating,
}

/// The element, and with it the shape of the cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// Reduced Hsieh-Clough-Tocher, on triangles.
    Hct,
    /// Reduced Fraeijs de Veubeke-Sander, on quadrilaterals.
    Fvs,
}

/// The most nodes a mesh may have: the numbers of their three dofs fit a signed 32-bit integer.
const MOST_NODES: usize = i32::MAX as usize / 3;

impl Mesh {
    /// The rectangle `(0, length) x (0, width)`, in metres, cut into `cells[0]` by `cells[1]` equal rectangles.
    ///
    /// Each rectangle is one quadrilateral, or two triangles as `diagonal` says. Nodes and rectangles are numbered with
    /// x fastest; the two triangles of a rectangle follow each other. The edges are named `left` (x = 0), `right`,
    /// `bottom` (y = 0) and `top`, and run counter-clockwise around the plate.
    ///
    /// # Errors
    /// [`Error::Mesh`] if a side is not positive and finite, a count is zero, or the mesh cannot be held in memory.
    pub fn rectangle(
        length: f64,
        width: f64,
        cells: [usize; 2],
        kind: ElementKind,
        diagonal: Diagonal,
    ) -> Result<Mesh> {
        for (name, side) in [("length", length), ("width", width)] {
            if !(side > 0.0 && side.is_finite()) {
                return Err(Error::Mesh(format!("the {name} of the plate is {side} m: it must be positive")));
            }
        }
        let [nx, ny] = cells;
        if nx == 0 || ny == 0 {
            return Err(Error::Mesh(format!("{nx} by {ny} cells: there must be at least one each way")));
        }
        let too_many = || Error::Mesh(format!("{nx} by {ny} cells are more than this program can hold"));
        let count = nx.checked_add(1).zip(ny.checked_add(1)).and_then(|(mx, my)| mx.checked_mul(my));
        let count = count.filter(|&count| count <= MOST_NODES).ok_or_else(too_many)?;

        let mut mesh = Mesh::default();
        mesh.nodes.try_reserve_exact(count).map_err(|_| too_many())?;
        mesh.cells
            .try_reserve_exact(if kind == ElementKind::Hct { 2 } else { 1 } * nx * ny)
            .map_err(|_| too_many())?;

        for j in 0..=ny {
            mesh.nodes.extend((0..=nx).map(|i| Point::new(division(length, i, nx), division(width, j, ny))));
        }
        let node = |i: usize, j: usize| i + (nx + 1) * j;
        for j in 0..ny {
            for i in 0..nx {
                let [v00, v10, v11, v01] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
                let right =
                    diagonal == Diagonal::Right || diagonal == Diagonal::Alternating && (i + j) % 2 == 0;
                match kind {
                    ElementKind::Fvs => mesh.cells.push(Cell::Quadrilateral([v00, v10, v11, v01])),
                    ElementKind::Hct if right => {
                        mesh.cells.extend([Cell::Triangle([v00, v10, v11]), Cell::Triangle([v00, v11, v01])])
                    }
                    ElementKind::Hct => {
                        mesh.cells.extend([Cell::Triangle([v01, v00, v10]), Cell::Triangle([v01, v10, v11])])
                    }
                }
            }
        }
        mesh.edges.insert("bottom".into(), (0..nx).map(|i| [node(i, 0), node(i + 1, 0)]).collect());
        mesh.edges.insert("right".into(), (0..ny).map(|j| [node(nx, j), node(nx, j + 1)]).collect());
        mesh.edges.insert("top".into(), (0..nx).rev().map(|i| [node(i + 1, ny), node(i, ny)]).collect());
        mesh.edges.insert("left".into(), (0..ny).rev().map(|j| [node(0, j + 1), node(0, j)]).collect());
        Ok(mesh)
    }
}

/// The `i`-th of the points that divide `side` into `n` equal parts; the last is `side` to the bit.
fn division(side: f64, i: usize, n: usize) -> f64 {
    if i == n { side } else { side * i as f64 / n as f64 }
}
