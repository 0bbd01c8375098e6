//! Conforming plate elements, made of cubics in Bernstein-Bezier form and built in physical space.
//!
//! Every element divides its cell into triangles around a centre and takes a cubic on each. It
//! is C1 inside the cell and has a normal derivative that is *linear* along each outer edge.
//! Deflection and slopes along an edge then depend on the dofs of its two nodes only, so that cells
//! of every kind join with C1 continuity, which Kirchhoff-Love plates need. Because nothing is
//! mapped from a reference cell, every element contains every quadratic on every cell shape.
//!
//! The dofs of a cell are `(w, w_x, w_y)` at each vertex, in the order of the vertices.
//! [`hct::element`] and [`fvs::element`] return an [`Element`] of 9 and of 12 dofs, and
//! [`ElementKind`] lists them for all who choose one; an [`AnyElement`] is either.
//!
//! Source for the Bezier form and its C1 conditions: Lai and Schumaker, *Spline Functions on
//! Triangulations*, 2007, chapters 2 and 6.

pub mod adaptive;
mod any;
pub mod fvs;
pub mod hct;
pub mod quadrature;
mod registry;

pub(crate) use any::with_element;
pub use any::{AnyElement, BasisFunction};
pub use registry::{CellShape, ElementByShape, ElementKind};

use self::quadrature::Rule;
use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::geometry::Point;

/// Values and derivatives of an element's basis functions at a point; column (or entry) `i` belongs
/// to dof `i`.
///
/// A derivative of order k has the unit m^-k, times m for the slope dofs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basis<const N: usize> {
    /// Values of the basis functions.
    pub value: SVector<f64, N>,
    /// First derivatives, with rows x and y.
    pub gradient: SMatrix<f64, 2, N>,
    /// Second derivatives, with rows xx, xy and yy.
    pub hessian: SMatrix<f64, 3, N>,
}

/// Sub-triangle of an element, and the cubic on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece<const N: usize> {
    /// Vertices, counter-clockwise: two vertices of the cell, then its centre, relative to the
    /// element's origin, in m.
    pub vertices: [Point; 3],
    /// Bezier ordinates in the order 300, 210, 120, 030, 201, 111, 021, 102, 012, 003 of the
    /// exponents of the barycentric coordinates. Entry `i` of each belongs to basis function `i`.
    pub ordinates: [SVector<f64, N>; 10],
}

/// Macro-element: the pieces of one cell.
#[derive(Clone, Debug, PartialEq)]
pub struct Element<const N: usize> {
    /// First vertex of the cell, in m. All else is relative to it, so that a cell far from the
    /// origin of the coordinates loses no digits.
    pub origin: Point,
    /// Pieces of the cell; piece `i` stands on the edge from vertex `i` to the next.
    pub pieces: Vec<Piece<N>>,
}

/// Difference in barycentric coordinates up to which two pieces contain a point equally well.
const TIE: f64 = 1e-12;

impl<const N: usize> Piece<N> {
    /// Returns the area, in m^2.
    pub fn area(&self) -> f64 {
        let [a, b, c] = self.vertices;
        (b - a).perp(&(c - a)) / 2.0
    }

    /// Returns the values of the basis functions alone, which is cheaper than [`Piece::basis`].
    pub fn values(&self, [u, v, w]: [f64; 3]) -> SVector<f64, N> {
        let bernstein = [
            u * u * u,
            3.0 * u * u * v,
            3.0 * u * v * v,
            v * v * v,
            3.0 * u * u * w,
            6.0 * u * v * w,
            3.0 * v * v * w,
            3.0 * u * w * w,
            3.0 * v * w * w,
            w * w * w,
        ];
        self.ordinates.iter().zip(bernstein).map(|(ordinate, b)| ordinate * b).sum()
    }

    /// Returns the basis functions and their derivatives at a point given by its barycentric
    /// coordinates in the piece.
    ///
    /// De Casteljau's algorithm leaves ordinates after one, two and three steps that give the
    /// second derivatives, the first derivatives and the value.
    pub fn basis(&self, barycentric: [f64; 3]) -> Basis<N> {
        let [u, v, w] = barycentric;
        let step = |b: &[SVector<f64, N>], [i, j, k]: [usize; 3]| b[i] * u + b[j] * v + b[k] * w;
        let q = [[0, 1, 4], [1, 2, 5], [2, 3, 6], [4, 5, 7], [5, 6, 8], [7, 8, 9]]
            .map(|t| step(&self.ordinates, t));
        let l = [[0, 1, 3], [1, 2, 4], [3, 4, 5]].map(|t| step(&q, t));

        // Derivatives along the two sides from the first vertex; the chain rule turns them to x and
        // y.
        let first = [(l[1] - l[0]) * 3.0, (l[2] - l[0]) * 3.0];
        let second =
            [q[0] - q[1] * 2.0 + q[2], q[0] - q[1] - q[3] + q[4], q[0] - q[3] * 2.0 + q[5]].map(|d| d * 6.0);
        let g = self.barycentric_gradients();
        let along = |d: [f64; 2]| first[0] * d[0] + first[1] * d[1];
        let twice = |a: [f64; 2], b: [f64; 2]| {
            second[0] * (a[0] * b[0]) + second[1] * (a[0] * b[1] + a[1] * b[0]) + second[2] * (a[1] * b[1])
        };
        let [x, y] = [[g.m11, g.m12], [g.m21, g.m22]];
        Basis {
            value: step(&l, [0, 1, 2]),
            gradient: SMatrix::from_rows(&[along(x), along(y)].map(|row| row.transpose())),
            hessian: SMatrix::from_rows(&[twice(x, x), twice(x, y), twice(y, y)].map(|row| row.transpose())),
        }
    }

    /// Returns the gradients of the second and third barycentric coordinates, as columns, in 1/m.
    fn barycentric_gradients(&self) -> Matrix2<f64> {
        let [a, b, c] = self.vertices;
        let (b, c) = (b - a, c - a);
        Matrix2::new(c.y, -b.y, -c.x, b.x) / b.perp(&c)
    }

    /// Returns the barycentric coordinates of a point relative to the element's origin, in m.
    fn barycentric(&self, point: Point) -> [f64; 3] {
        let vw = self.barycentric_gradients().tr_mul(&(point - self.vertices[0]));
        [1.0 - vw.x - vw.y, vw.x, vw.y]
    }
}

impl<const N: usize> Element<N> {
    /// Returns the piece that contains a point, and the point's barycentric coordinates in it.
    ///
    /// On the line between two pieces, to rounding, the first of them is taken. Outside the cell
    /// the nearest piece is the one with the largest smallest barycentric coordinate, which is
    /// negative there: its cubic is extrapolated.
    pub fn locate(&self, point: Point) -> (usize, [f64; 3]) {
        self.pieces_at(point).next().unwrap_or_default()
    }

    /// Returns the points of a quadrature rule on all pieces: the piece, the place in m, the
    /// barycentric coordinates in the piece, and the weight.
    pub fn nodes<'e>(&'e self, rule: Rule<'e>) -> impl Iterator<Item = (&'e Piece<N>, Point, [f64; 3], f64)> {
        self.pieces.iter().enumerate().flat_map(move |(number, piece)| {
            let nodes = rule.of(number).iter();
            nodes.map(move |&(place, weight)| (piece, self.point(number, place), place, weight))
        })
    }

    /// Returns all pieces that contain a point, to rounding, like [`Element::locate`].
    fn pieces_at(&self, point: Point) -> impl Iterator<Item = (usize, [f64; 3])> {
        let point = Point::from(point - self.origin);
        let depth = |b: &[f64; 3]| b.iter().copied().fold(f64::INFINITY, f64::min);
        let places: Vec<_> = self.pieces.iter().map(|piece| piece.barycentric(point)).collect();
        let deepest = places.iter().map(depth).fold(f64::NEG_INFINITY, f64::max);
        places.into_iter().enumerate().filter(move |(_, place)| depth(place) >= deepest - TIE)
    }

    /// Returns the basis functions and their derivatives at a point of the cell.
    ///
    /// Second derivatives jump across the line between two pieces, where they are the mean over
    /// the pieces. At the barycentre of a triangle they happen to agree (Farin, *Triangular
    /// Bernstein-Bezier patches*, 1986); at the centre of a quadrilateral they do not.
    pub fn basis_at(&self, point: Point) -> Basis<N> {
        let of_piece = |(piece, barycentric): (usize, _)| self.pieces[piece].basis(barycentric);
        let of_pieces: Vec<Basis<N>> = self.pieces_at(point).map(of_piece).collect();
        let sum: SMatrix<f64, 3, N> = of_pieces.iter().map(|basis| basis.hessian).sum();
        Basis { hessian: sum / of_pieces.len() as f64, ..of_pieces[0] }
    }

    /// Returns the point of the plate with the given barycentric coordinates in a piece, in m.
    pub fn point(&self, piece: usize, barycentric: [f64; 3]) -> Point {
        let vertices = self.pieces[piece].vertices;
        self.origin + (0..3).map(|i| vertices[i].coords * barycentric[i]).sum::<Vector2<f64>>()
    }
}

/// Creates the macro-element of the pieces `(v_i, v_{i+1}, centre)`, for V vertices and N = 3 V
/// dofs.
///
/// `weights[i]` are the barycentric coordinates of the centre with respect to `v_{i-1}`, `v_i` and
/// `v_{i+1}`; C1 continuity needs nothing else. Two cubics that share their ordinates on the line
/// from `v_i` to the centre are C1 across it when each ordinate on the line is that combination of
/// its neighbours towards `v_{i-1}`, `v_i` and `v_{i+1}`. This holds next to `v_i`, where the
/// slopes fix all of them, and it *defines* the ordinates next to the centre and at it.
///
/// `ring` and `centre` are relative to `origin`, in m.
fn fan<const V: usize, const N: usize>(
    origin: Point,
    ring: [Point; V],
    centre: Point,
    weights: [[f64; 3]; V],
) -> Element<N> {
    let next = |i: usize| (i + 1) % V;
    let previous = |i: usize| (i + V - 1) % V;
    // Ordinate a third of the way from vertex i along a vector, on the tangent plane at the vertex.
    let tangent = |i: usize, vector: Vector2<f64>| {
        let mut ordinate = SVector::<f64, N>::zeros();
        ordinate[3 * i] = 1.0;
        ordinate[3 * i + 1] = vector.x / 3.0;
        ordinate[3 * i + 2] = vector.y / 3.0;
        ordinate
    };
    let combine = |[a, b, c]: [f64; 3], [x, y, z]: [&SVector<f64, N>; 3]| x * a + y * b + z * c;

    let corner: [_; V] = std::array::from_fn(|i| tangent(i, Vector2::zeros()));
    let spoke: [_; V] = std::array::from_fn(|i| tangent(i, centre - ring[i]));
    let forth: [_; V] = std::array::from_fn(|i| tangent(i, ring[next(i)] - ring[i]));
    let back: [_; V] = std::array::from_fn(|i| tangent(next(i), ring[i] - ring[next(i)]));
    // Ordinate 111 makes the normal derivative along the edge linear: its middle Bezier ordinate is
    // the mean of its values at the ends.
    let middle: [_; V] = std::array::from_fn(|i| {
        let j = next(i);
        let edge = ring[j] - ring[i];
        let s = (centre - ring[i]).dot(&edge) / edge.norm_squared();
        let along = |a: &SVector<f64, N>, b: &SVector<f64, N>| a * (1.0 - s) + b * s;
        let ends = [spoke[i] - along(&corner[i], &forth[i]), spoke[j] - along(&back[i], &corner[j])];
        along(&forth[i], &back[i]) + (ends[0] + ends[1]) / 2.0
    });
    let inner: [_; V] =
        std::array::from_fn(|i| combine(weights[i], [&middle[previous(i)], &spoke[i], &middle[i]]));
    let top = combine(weights[0], [&inner[V - 1], &inner[0], &inner[1]]);

    let piece = |i: usize| {
        let j = next(i);
        Piece {
            vertices: [ring[i], ring[j], centre],
            ordinates: [
                corner[i], forth[i], back[i], corner[j], spoke[i], middle[i], spoke[j], inner[i], inner[j],
                top,
            ],
        }
    };
    Element { origin, pieces: (0..V).map(piece).collect() }
}
