//! Structured meshes of a rectangle.

use super::{Cell, Mesh, Point};
use crate::element::{CellShape, ElementKind};
use crate::error::{Error, Result};

/// Direction of the diagonal that divides each rectangle into two triangles.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Diagonal {
    /// `/`, from the lower left corner to the upper right one.
    #[default]
    Right,
    /// `\`, the mirror image of [`Diagonal::Right`] under `y -> width - y`.
    Left,
    /// Both in a checkerboard; the rectangle at the origin has `/`.
    Alternating,
}

/// Largest number of nodes, for which the numbers of their three dofs fit a signed 32-bit integer.
const MOST_NODES: usize = i32::MAX as usize / 3;

/// Rectangle `(0, sides[0]) x (0, sides[1])`, in m, divided into equal rectangles. Nodes and cells
/// are computed one by one, so that a part of the mesh can be built alone.
///
/// Each rectangle is one quadrilateral, or two triangles according to `diagonal`. Nodes and
/// rectangles are numbered with x fastest; the two triangles of a rectangle are consecutive.
#[derive(Clone, Copy, Debug)]
pub struct Grid {
    sides: [f64; 2],
    /// Numbers of rectangles along x and y.
    pub(crate) cells: [usize; 2],
    /// Element that the cells carry.
    pub(crate) kind: ElementKind,
    diagonal: Diagonal,
}

impl Grid {
    /// Creates a grid of `cells[0]` by `cells[1]` rectangles.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] if a side is not positive and finite, a count is zero, or the nodes
    /// cannot be numbered.
    pub fn new(sides: [f64; 2], cells: [usize; 2], kind: ElementKind, diagonal: Diagonal) -> Result<Grid> {
        for (name, side) in ["length", "width"].into_iter().zip(sides) {
            if !(side > 0.0 && side.is_finite()) {
                return Err(Error::Mesh(format!("the {name} of the plate is {side} m: it must be positive")));
            }
        }
        let [nx, ny] = cells;
        if nx == 0 || ny == 0 {
            return Err(Error::Mesh(format!("{nx} by {ny} cells: there must be at least one each way")));
        }
        let count = nx.checked_add(1).zip(ny.checked_add(1)).and_then(|(mx, my)| mx.checked_mul(my));
        if count.is_none_or(|count| count > MOST_NODES) {
            return Err(too_many(cells));
        }
        Ok(Grid { sides, cells, kind, diagonal })
    }

    /// Returns the grid of which this one is the refinement, a number of times.
    ///
    /// # Errors
    /// Returns the errors of [`Grid::new`]. The counts must be multiples of `2^times`.
    pub fn coarsened(&self, times: u32) -> Result<Grid> {
        Grid::new(self.sides, self.cells.map(|count| count >> times), self.kind, self.diagonal)
    }

    /// Returns the number of nodes.
    pub fn nodes(&self) -> usize {
        (self.cells[0] + 1) * (self.cells[1] + 1)
    }

    /// Returns the position of a node, in m.
    pub fn node(&self, number: usize) -> Point {
        let ([length, width], [nx, ny]) = (self.sides, self.cells);
        Point::new(division(length, number % (nx + 1), nx), division(width, number / (nx + 1), ny))
    }

    /// Returns the number of rectangles.
    pub fn rectangles(&self) -> usize {
        self.cells[0] * self.cells[1]
    }

    /// Returns the cells of a rectangle, in order.
    pub fn cells(&self, rectangle: usize) -> impl Iterator<Item = Cell> {
        let nx = self.cells[0];
        let (i, j) = (rectangle % nx, rectangle / nx);
        let node = |i: usize, j: usize| i + (nx + 1) * j;
        let [v00, v10, v11, v01] = [node(i, j), node(i + 1, j), node(i + 1, j + 1), node(i, j + 1)];
        let right =
            self.diagonal == Diagonal::Right || self.diagonal == Diagonal::Alternating && (i + j) % 2 == 0;
        let (first, second) = match self.kind.shape() {
            CellShape::Quadrilateral => (Cell::Quadrilateral([v00, v10, v11, v01]), None),
            CellShape::Triangle if right => {
                (Cell::Triangle([v00, v10, v11]), Some(Cell::Triangle([v00, v11, v01])))
            }
            CellShape::Triangle => (Cell::Triangle([v01, v00, v10]), Some(Cell::Triangle([v01, v10, v11]))),
        };
        std::iter::once(first).chain(second)
    }
}

fn too_many([nx, ny]: [usize; 2]) -> Error {
    Error::Mesh(format!("{nx} by {ny} cells are more than this program can hold"))
}

impl Mesh {
    /// Creates the rectangle `(0, length) x (0, width)`, in m, divided into `cells[0]` by
    /// `cells[1]` equal rectangles; see [`Grid`].
    ///
    /// The edges are named `left` (x = 0), `right`, `bottom` (y = 0) and `top`, and run
    /// counter-clockwise around the plate.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] if a side is not positive and finite, a count is zero, or the mesh
    /// does not fit into memory.
    pub fn rectangle(
        length: f64,
        width: f64,
        cells: [usize; 2],
        kind: ElementKind,
        diagonal: Diagonal,
    ) -> Result<Mesh> {
        let grid = Grid::new([length, width], cells, kind, diagonal)?;
        let mut mesh = Mesh { elements: kind.into(), ..Mesh::default() };
        let reserved = mesh.nodes.try_reserve_exact(grid.nodes());
        let count = kind.shape().per_rectangle() * grid.rectangles();
        if reserved.and(mesh.cells.try_reserve_exact(count)).is_err() {
            return Err(too_many(cells));
        }
        mesh.nodes.extend((0..grid.nodes()).map(|number| grid.node(number)));
        mesh.cells.extend((0..grid.rectangles()).flat_map(|rectangle| grid.cells(rectangle)));
        let [nx, ny] = cells;
        let node = |i: usize, j: usize| i + (nx + 1) * j;
        mesh.edges.insert("bottom".into(), (0..nx).map(|i| [node(i, 0), node(i + 1, 0)]).collect());
        mesh.edges.insert("right".into(), (0..ny).map(|j| [node(nx, j), node(nx, j + 1)]).collect());
        mesh.edges.insert("top".into(), (0..nx).rev().map(|i| [node(i + 1, ny), node(i, ny)]).collect());
        mesh.edges.insert("left".into(), (0..ny).rev().map(|j| [node(0, j + 1), node(0, j)]).collect());
        Ok(mesh)
    }
}

/// Returns point `i` of the division of `side` into `n` equal parts; the last is `side` to the bit.
fn division(side: f64, i: usize, n: usize) -> f64 {
    if i == n { side } else { side * i as f64 / n as f64 }
}
