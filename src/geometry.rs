//! Points of the plate's mid-plane and the polygons that they make.

use std::fmt::Display;

use nalgebra::Vector2;

use crate::error::{Error, Result};

/// Returns the least and the greatest of some numbers, leaving NaN out; infinite ones, the wrong
/// way round, for no number.
pub fn range(values: impl IntoIterator<Item = f64>) -> [f64; 2] {
    let ends = [f64::INFINITY, f64::NEG_INFINITY];
    values.into_iter().fold(ends, |[low, high], value| [low.min(value), high.max(value)])
}

/// Point of the plate's mid-plane, in m.
pub type Point = nalgebra::Point2<f64>;

/// Smallest cross product of the two sides at a corner, relative to the square of the longest side,
/// above which the corner is not flat.
///
/// At that flatness the element's second derivatives, which are differences of the order of its
/// square, consist of rounding only.
const FLAT: f64 = 1e-8;

/// Checks that a polygon is finite, counter-clockwise and strictly convex; messages call it `name`.
pub(crate) fn require_convex(name: impl Display, vertices: &[Point]) -> Result<()> {
    let flat = FLAT * longest_edge(vertices).powi(2);
    let area = area(vertices);
    let count = vertices.len();
    let mut spans = (0..count).map(|i| {
        let corner = vertices[i];
        (vertices[(i + 1) % count] - corner).perp(&(vertices[(i + count - 1) % count] - corner))
    });
    let flaw = if vertices.iter().any(|v| !(v.x.is_finite() && v.y.is_finite())) {
        "has a coordinate that is not a finite number"
    } else if area.abs() <= flat || area.is_nan() {
        "is degenerate: its area is negligible"
    } else if area < 0.0 {
        "is inverted: its nodes run clockwise"
    } else if !spans.all(|span| span > flat) {
        "is not strictly convex"
    } else {
        return Ok(());
    };
    Err(Error::Mesh(format!("{name} {flaw}; its vertices are {}", list(vertices))))
}

/// Returns the start of each side of a polygon, and the side as a vector.
pub(crate) fn sides(vertices: &[Point]) -> impl Iterator<Item = (Point, Vector2<f64>)> + '_ {
    vertices.iter().zip(vertices.iter().cycle().skip(1)).map(|(a, b)| (*a, b - a))
}

/// Returns the length of the longest side of a polygon, in m.
pub(crate) fn longest_edge(vertices: &[Point]) -> f64 {
    sides(vertices).map(|(_, side)| side.norm()).fold(0.0, f64::max)
}

/// Returns the signed area of a polygon, computed from differences of coordinates, in m^2.
pub(crate) fn area(vertices: &[Point]) -> f64 {
    vertices.windows(2).skip(1).map(|v| (v[0] - vertices[0]).perp(&(v[1] - vertices[0]))).sum::<f64>() / 2.0
}

/// Segment with coordinates along and across it.
#[derive(Clone, Copy)]
pub(crate) struct Segment {
    pub from: Point,
    /// Unit vector along the segment; zero for a segment of one point.
    pub along: Vector2<f64>,
    /// Length, in m.
    pub length: f64,
}

impl Segment {
    /// Creates the segment between two points.
    pub fn new([from, to]: [Point; 2]) -> Segment {
        let side = to - from;
        let length = side.norm();
        Segment { from, along: if length > 0.0 { side / length } else { side }, length }
    }

    /// Returns a point's coordinate along the segment and its distance to the left of it, in m.
    pub fn measure(&self, point: Point) -> [f64; 2] {
        let arm = point - self.from;
        [arm.dot(&self.along), self.along.perp(&arm)]
    }

    /// Returns the distance of a point, in m.
    pub fn distance(&self, point: Point) -> f64 {
        let [along, _] = self.measure(point);
        (point - (self.from + self.along * along.clamp(0.0, self.length))).norm()
    }
}

/// Formats points as `(0, 0), (1, 0), (0, 1)`.
pub(crate) fn list(points: &[Point]) -> String {
    points.iter().map(|&point| place(point)).collect::<Vec<_>>().join(", ")
}

/// Formats a point as `(0.3, 1e30)`: all digits, with an exponent instead of many zeros.
pub(crate) fn place(point: impl Into<[f64; 2]>) -> String {
    let [x, y] = point.into().map(|coordinate| {
        let text = format!("{coordinate:?}");
        text.strip_suffix(".0").map_or(text.clone(), str::to_owned)
    });
    format!("({x}, {y})")
}
