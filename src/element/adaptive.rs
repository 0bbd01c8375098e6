//! Adaptive quadrature for functions that a rule of fixed degree misses: patches between its
//! points, and edges across its triangle.
//!
//! A rule knows a function at its points only, while interval arithmetic bounds the function
//! between them. A triangle is divided into four where the bounds allow more than the points show,
//! or where its rule and those of its four parts disagree. Along a jump the triangles become small,
//! and the last ones are cut in two by the chord of the jump.

use super::quadrature::{DEGREE_3, DEGREE_6, Node};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::field::{Enclosure, NOTHING};
use crate::geometry::Point;
use std::collections::BTreeMap;

/// Function over the plate that can be integrated adaptively.
pub trait Integrand {
    /// Computes the values at points given in m.
    ///
    /// # Errors
    /// Returns [`crate::Error::Scene`] where the function has no finite value.
    fn values(&self, points: &[Point], values: &mut [f64]) -> Result<()>;

    /// Returns bounds over the rectangle between two corners, in m; slopes are along x, y and t.
    fn enclose(&self, low: Point, high: Point) -> Enclosure<3>;

    /// Returns a number that differs across jumps and kinks.
    fn side(&self, point: Point) -> u64;
}

/// Tolerances and limits of the search. All shares are of the integral of the function's magnitude
/// over the plate.
#[derive(Debug, Clone, Copy)]
pub struct Effort {
    /// Share of the whole up to which the error bound of a triangle across a jump is accepted.
    pub jump: f64,
    /// Largest difference between the rule and the rules of the four parts, relative to the larger
    /// of the triangle's own integral and the mean for its area.
    pub difference: f64,
    /// Share of the whole below which a difference is accepted on any triangle.
    pub nothing: f64,
    /// Share of the mean up to which the error bound of a triangle is accepted, whatever its points
    /// show.
    pub open: f64,
    /// Share of the whole up to which it is accepted in addition to [`Effort::open`].
    pub open_at_once: f64,
    /// Largest number of triangles at one level.
    pub most: usize,
}

/// Tolerances for functions that are integrated once for all steps.
pub const ONCE: Effort =
    Effort { jump: 1e-5, difference: 1e-6, nothing: 1e-8, open: 1e-2, open_at_once: 1e-7, most: 1 << 18 };

/// Tolerances for functions that are integrated anew at each instant.
pub const EACH_TIME: Effort =
    Effort { jump: 1e-4, difference: 1e-5, nothing: 1e-7, open: 1e-1, open_at_once: 1e-5, most: 1 << 16 };

/// Largest trusted ratio of the bounds to the curvature that the points show; bounds overestimate
/// smooth functions by up to this factor.
const TRUSTED: f64 = 32.0;

/// Share of a rectangle that counts as its edge: a jump along it has no area.
const EDGE: f64 = 1e-9;

/// Largest number of subdivisions of a triangle.
const LEVELS: usize = 24;

/// Relative difference up to which integrals count as equal, so that a piece needs no own rule.
const SAME: f64 = 1e-12;

/// Number of bisections that locate a jump on the side of a triangle.
const HALVINGS: usize = 50;

/// Quadrature rules, piece by piece, of the cells where the usual one does not suffice. Their
/// weights sum to 1 on each piece.
pub type Rules = BTreeMap<usize, Vec<Vec<Node>>>;

/// Result of an adaptive search: quadrature rules, and the integrals that they give.
#[derive(Debug, Clone, Default)]
pub struct Refined {
    /// Rules of this rank's cells.
    pub rules: Rules,
    /// Integrals of the function, and of the function times x and times y (in m), over this rank's
    /// cells.
    pub integral: [f64; 3],
    /// Integral of the function's magnitude over all cells.
    pub size: f64,
    /// Bound on the error of the rules where the search ended early, over all cells; otherwise 0.
    pub left: f64,
}

/// Piece of a cell, a triangle.
#[derive(Debug, Clone, Copy)]
pub struct Triangle {
    /// Number of the cell.
    pub cell: usize,
    /// Vertices of the piece, in m.
    pub vertices: [Point; 3],
}

impl Triangle {
    fn area(&self) -> f64 {
        let [a, b, c] = self.vertices;
        (b - a).perp(&(c - a)).abs() / 2.0
    }

    fn point(&self, barycentric: [f64; 3]) -> Point {
        let [a, b, c] = self.vertices;
        a + (b - a) * barycentric[1] + (c - a) * barycentric[2]
    }
}

/// Barycentric coordinates, in a piece, of the corners of a part of it.
type Corners = [[f64; 3]; 3];

const WHOLE: Corners = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn combine(corners: &Corners, weights: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| (0..3).map(|i| weights[i] * corners[i][k]).sum())
}

/// Returns the part's share of the piece's area.
fn share(corners: &Corners) -> f64 {
    let [a, b, c] = corners;
    let (u, v) = ([b[1] - a[1], b[2] - a[2]], [c[1] - a[1], c[2] - a[2]]);
    (u[0] * v[1] - u[1] * v[0]).abs()
}

fn quarters(corners: &Corners) -> [Corners; 4] {
    let middle =
        |i: usize, j: usize| -> [f64; 3] { std::array::from_fn(|k| 0.5 * (corners[i][k] + corners[j][k])) };
    let [a, b, c] = *corners;
    let [ab, bc, ca] = [middle(0, 1), middle(1, 2), middle(2, 0)];
    [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
}

/// Part of a piece, with what the rule gives on it.
#[derive(Clone, Copy)]
struct Part {
    /// Index of the piece in the list of all.
    of: usize,
    corners: Corners,
    area: f64,
    /// Integrals of the function times the barycentric coordinates of the piece.
    integral: [f64; 3],
    /// Integral of the function's magnitude.
    size: f64,
    /// Largest distance of the values from an affine function.
    bent: f64,
}

/// Returns the largest difference between an integral over a part and the sum over its four parts.
fn difference(part: &Part, parts: &[Part; 4]) -> f64 {
    let sum = |k: usize| parts.iter().map(|part| part.integral[k]).sum::<f64>();
    (0..3).map(|k| (sum(k) - part.integral[k]).abs()).fold(0.0, f64::max)
}

/// Decision on a part.
enum Verdict {
    Accept,
    /// Accept, although the bounds leave this much error open.
    Leave(f64),
    Split(Box<[Part; 4]>),
}

struct Search<'s> {
    pieces: &'s [Triangle],
    effort: Effort,
    /// Integral of the function's magnitude, and area, over all cells.
    size: f64,
    area: f64,
}

impl Search<'_> {
    fn measure(&self, function: &dyn Integrand, number: usize, corners: Corners) -> Result<Part> {
        let piece = &self.pieces[number];
        let area = piece.area() * share(&corners);
        let mut part = Part { of: number, corners, area, integral: [0.0; 3], size: 0.0, bent: 0.0 };
        let places = DEGREE_6.map(|(weights, _)| combine(&corners, weights));
        let mut values = [0.0; DEGREE_6.len()];
        function.values(&places.map(|place| piece.point(place)), &mut values)?;
        let mut moments = [0.0; 3];
        for (((weights, weight), place), value) in DEGREE_6.iter().zip(&places).zip(values) {
            for k in 0..3 {
                part.integral[k] += area * weight * value * place[k];
                moments[k] += weight * value * weights[k];
            }
            part.size += area * weight * value.abs();
        }
        // The affine function with the same moments.
        let sum: f64 = moments.iter().sum();
        let affine = moments.map(|moment| 12.0 * moment - 3.0 * sum);
        for ((weights, _), value) in DEGREE_6.iter().zip(values) {
            let nearest: f64 = (0..3).map(|k| affine[k] * weights[k]).sum();
            part.bent = part.bent.max((value - nearest).abs());
        }
        Ok(part)
    }

    /// Returns the error bound of the rule on a part, per unit of area, and whether a jump causes
    /// it.
    fn open(&self, function: &dyn Integrand, part: &Part) -> (f64, bool) {
        let vertices = part.corners.map(|corner| self.pieces[part.of].point(corner));
        let axis = |k: usize, pick: fn(f64, f64) -> f64| {
            vertices[1..].iter().fold(vertices[0][k], |m, v| pick(m, v[k]))
        };
        let (low, high) = (
            Point::new(axis(0, f64::min), axis(1, f64::min)),
            Point::new(axis(0, f64::max), axis(1, f64::max)),
        );
        let inset = (high - low) * EDGE;
        let bounds = function.enclose(low + inset, high - inset);
        let (value, jumps) = (bounds.value, bounds.jumps());
        // Deviation from the affine function with the middle slopes, counted twice because the
        // function is not known at the centre.
        let bent = bounds.slope[0].width() + bounds.slope[1].width();
        let open = if jumps || bent.is_nan() { value.width() } else { value.width().min(bent) };
        (if open.is_nan() { f64::INFINITY } else { open }, jumps)
    }

    fn judge(&self, function: &dyn Integrand, part: &Part, last: bool) -> Result<Verdict> {
        let (open, jumps) = self.open(function, part);
        let mean = self.size / self.area;
        if open <= NOTHING || !jumps && open <= self.effort.difference * mean {
            return Ok(Verdict::Accept);
        }
        // Where there are no bounds, such as beside a pole, the magnitude at the points replaces
        // them.
        let room = if open.is_finite() { open * part.area } else { part.size };
        if jumps && room <= self.effort.jump * self.size {
            return Ok(Verdict::Accept);
        }
        if last {
            return Ok(Verdict::Leave(room));
        }
        let parts = self.quarter(function, part)?;
        let may_be_open = self.effort.open * mean * part.area + self.effort.open_at_once * self.size;
        let seen = open <= TRUSTED * part.bent || room <= may_be_open;
        let apart = difference(part, &parts);
        let tolerance = self.effort.difference * part.size.max(mean * part.area);
        let nothing = self.effort.nothing * self.size;
        let mut agrees = !jumps && seen && apart <= tolerance.max(nothing);
        // Across a kink the errors of a rule may cancel by chance, but hardly twice.
        if agrees && tolerance > nothing && self.is_across(function, part) {
            let mut apart = 0.0;
            for part in &parts {
                apart += difference(part, &self.quarter(function, part)?);
            }
            agrees = apart <= tolerance;
        }
        Ok(if agrees { Verdict::Accept } else { Verdict::Split(Box::new(parts)) })
    }

    /// Returns the four parts that a part is divided into.
    fn quarter(&self, function: &dyn Integrand, part: &Part) -> Result<[Part; 4]> {
        let mut parts = [*part; 4];
        for (quarter, corners) in parts.iter_mut().zip(quarters(&part.corners)) {
            *quarter = self.measure(function, part.of, corners)?;
        }
        Ok(parts)
    }

    /// Returns whether a jump or kink separates the corners and points of a part.
    fn is_across(&self, function: &dyn Integrand, part: &Part) -> bool {
        let side = |place: [f64; 3]| function.side(self.pieces[part.of].point(place));
        let first = side(part.corners[0]);
        let corners = part.corners[1..].iter().copied();
        let points = DEGREE_6.map(|(weights, _)| combine(&part.corners, weights));
        corners.chain(points).any(|place| side(place) != first)
    }

    /// Cuts a part in two along the chord of a jump that separates one corner from the others, or
    /// returns it whole.
    fn cut(&self, function: &dyn Integrand, number: usize, corners: &Corners) -> Vec<Corners> {
        let piece = &self.pieces[number];
        let side = |place: [f64; 3]| function.side(piece.point(place));
        let sides = corners.map(side);
        let is_alone =
            |i: &usize| sides[*i] != sides[(i + 1) % 3] && sides[(i + 1) % 3] == sides[(i + 2) % 3];
        let Some(alone) = (0..3).find(is_alone) else { return vec![*corners] };
        let [a, b, c] = [0, 1, 2].map(|k| corners[(alone + k) % 3]);
        let crossing = |end: [f64; 3]| {
            let along = |t: f64| -> [f64; 3] { std::array::from_fn(|k| a[k] + t * (end[k] - a[k])) };
            let (mut near, mut far) = (0.0, 1.0);
            for _ in 0..HALVINGS {
                let middle = 0.5 * (near + far);
                if side(along(middle)) == sides[alone] { near = middle } else { far = middle }
            }
            along(near)
        };
        let (p, q) = (crossing(b), crossing(c));
        let whole = share(corners);
        // The shorter diagonal is the same in a mirror.
        let distance = |u: [f64; 3], v: [f64; 3]| (0..3).map(|k| (u[k] - v[k]).powi(2)).sum::<f64>();
        let [first, second] =
            if distance(p, c) <= distance(b, q) { [[p, b, c], [p, c, q]] } else { [[p, b, q], [b, c, q]] };
        let mut parts = vec![[a, p, q], first, second];
        parts.retain(|part| share(part) > f64::EPSILON * whole);
        parts
    }
}

/// Parts of a subdivided piece.
struct Parts {
    /// Integrals over the piece by the usual rule.
    usual: [f64; 3],
    /// Integrals over the parts by their own rules.
    integral: [f64; 3],
    size: f64,
    nodes: Vec<Node>,
}

impl Parts {
    fn new(usual: &Part) -> Parts {
        Parts { usual: usual.integral, integral: [0.0; 3], size: 0.0, nodes: Vec::new() }
    }

    /// Adds a part on which the usual rule suffices.
    fn add(&mut self, part: &Part) {
        (0..3).for_each(|k| self.integral[k] += part.integral[k]);
        self.size += part.size;
        self.push(&DEGREE_6, &part.corners);
    }

    /// Adds a part across a jump.
    fn add_cut(&mut self, search: &Search, function: &dyn Integrand, part: &Part) -> Result<()> {
        let piece = &search.pieces[part.of];
        for corners in search.cut(function, part.of, &part.corners) {
            let area = piece.area() * share(&corners);
            let places = DEGREE_3.map(|(weights, _)| combine(&corners, weights));
            let mut values = [0.0; DEGREE_3.len()];
            function.values(&places.map(|place| piece.point(place)), &mut values)?;
            for ((place, (_, weight)), value) in places.iter().zip(DEGREE_3).zip(values) {
                (0..3).for_each(|k| self.integral[k] += area * weight * value * place[k]);
                self.size += area * weight * value.abs();
            }
            self.push(&DEGREE_3, &corners);
        }
        Ok(())
    }

    fn push(&mut self, rule: &[Node], corners: &Corners) {
        let share = share(corners);
        self.nodes.extend(rule.iter().map(|(weights, weight)| (combine(corners, *weights), weight * share)));
    }

    /// Returns whether the usual rule gives the same integrals.
    fn is_usual(&self) -> bool {
        (0..3).all(|k| (self.integral[k] - self.usual[k]).abs() <= SAME * self.size)
    }
}

/// Finds the cells of this rank where the rule of degree 6 does not suffice for a function, which
/// may differ from cell to cell, and rules that do. Collective.
///
/// # Errors
/// Returns the errors of the function, on the rank where they occurred.
pub fn refine<'f>(
    pieces: &[Triangle],
    function: &dyn Fn(usize) -> Option<&'f dyn Integrand>,
    effort: Effort,
    comm: &impl Communicator,
) -> Result<Refined> {
    let of_piece = |number: usize| function(pieces[number].cell);
    let mut search = Search { pieces, effort, size: 0.0, area: 0.0 };
    let mut fault = Ok(());
    // An error is kept until the end, because the other ranks wait for this one in each sum.
    let mut attempt = |result: Result<()>| {
        if fault.is_ok() {
            fault = result;
        }
    };
    let mut sums = [0.0; 2];
    for (number, piece) in pieces.iter().enumerate() {
        if let Some(function) = of_piece(number) {
            attempt(search.measure(function, number, WHOLE).map(|part| sums[0] += part.size));
            sums[1] += piece.area();
        }
    }
    [search.size, search.area] = comm.all_reduce_sum(sums);
    let mut refined = Refined::default();
    let mut cut_up: BTreeMap<usize, Parts> = BTreeMap::new();
    let mut active: Vec<Part> = Vec::new();
    let mut done = 0.0;
    for level in 0..=LEVELS {
        let last = level == LEVELS || level > 0 && sums[1] > effort.most as f64;
        let mut next: Vec<Part> = Vec::new();
        let mut look = |function: &dyn Integrand, part: Part| -> Result<()> {
            // The parts must fit into memory even where every cell asks for them.
            let last = last || next.len() >= 4 * effort.most;
            let open = match search.judge(function, &part, last)? {
                Verdict::Split(parts) => {
                    if level == 0 {
                        cut_up.insert(part.of, Parts::new(&part));
                    }
                    next.extend(*parts);
                    return Ok(());
                }
                Verdict::Accept => 0.0,
                Verdict::Leave(open) => open,
            };
            refined.left += open;
            done += part.size;
            let jumps = search.open(function, &part).1;
            if level == 0 && !jumps {
                add(&mut refined.integral, &pieces[part.of], part.integral);
                return Ok(());
            }
            let parts = cut_up.entry(part.of).or_insert_with(|| Parts::new(&part));
            if jumps {
                parts.add_cut(&search, function, &part)
            } else {
                parts.add(&part);
                Ok(())
            }
        };
        if level == 0 {
            for number in 0..pieces.len() {
                if let Some(function) = of_piece(number) {
                    attempt(search.measure(function, number, WHOLE).and_then(|part| look(function, part)));
                }
            }
        } else {
            for part in std::mem::take(&mut active) {
                if let Some(function) = of_piece(part.of) {
                    attempt(look(function, part));
                }
            }
        }
        active = next;
        sums = [done + active.iter().map(|part| part.size).sum::<f64>(), active.len() as f64];
        [search.size, sums[1]] = comm.all_reduce_sum(sums);
        if sums[1] == 0.0 {
            break;
        }
    }
    (refined.size, refined.left) = (search.size, comm.all_reduce_sum(refined.left));
    fault?;
    for (number, parts) in &cut_up {
        add(&mut refined.integral, &pieces[*number], parts.integral);
    }
    refined.rules = rules(pieces, cut_up);
    Ok(refined)
}

/// Returns whether the rule of degree 6 suffices for a function on all cells. Collective.
///
/// # Errors
/// Returns the errors of the function, on the rank where they occurred.
pub fn is_calm(
    pieces: &[Triangle],
    function: &dyn Integrand,
    effort: Effort,
    comm: &impl Communicator,
) -> Result<bool> {
    let mut search = Search { pieces, effort, size: 0.0, area: 0.0 };
    let mut sums = [0.0; 2];
    let measured = (0..pieces.len()).try_for_each(|number| {
        sums[0] += search.measure(function, number, WHOLE)?.size;
        sums[1] += pieces[number].area();
        Ok(())
    });
    [search.size, search.area] = comm.all_reduce_sum(sums);
    let is_calm = |number: usize| {
        let part = search.measure(function, number, WHOLE)?;
        let accepted = matches!(search.judge(function, &part, false)?, Verdict::Accept);
        Ok(accepted && !search.open(function, &part).1)
    };
    let mut stirred = measured.and_then(|()| {
        for number in 0..pieces.len() {
            if !is_calm(number)? {
                return Ok(true);
            }
        }
        Ok(false)
    });
    let anywhere = comm.all_reduce_any(!matches!(stirred, Ok(false)));
    if stirred.is_ok() {
        stirred = Ok(anywhere);
    }
    stirred.map(|stirred| !stirred)
}

/// Adds integrals over a piece of a function times its barycentric coordinates, as integrals of the
/// function and of the function times x and y.
fn add(integral: &mut [f64; 3], piece: &Triangle, parts: [f64; 3]) {
    for (vertex, part) in piece.vertices.iter().zip(parts) {
        integral[0] += part;
        integral[1] += part * vertex.x;
        integral[2] += part * vertex.y;
    }
}

/// Returns the rules of the cells in which some piece needs its own.
fn rules(pieces: &[Triangle], cut_up: BTreeMap<usize, Parts>) -> Rules {
    let mut rules = Rules::new();
    let mut unusual: BTreeMap<usize, Parts> =
        cut_up.into_iter().filter(|(_, parts)| !parts.is_usual()).collect();
    let cells: std::collections::BTreeSet<usize> =
        unusual.keys().map(|number| pieces[*number].cell).collect();
    for cell in cells {
        let first = pieces.partition_point(|piece| piece.cell < cell);
        let count = pieces[first..].iter().take_while(|piece| piece.cell == cell).count();
        let of_piece = |number: usize| unusual.remove(&number).map_or(DEGREE_6.to_vec(), |parts| parts.nodes);
        rules.insert(cell, (first..first + count).map(of_piece).collect());
    }
    rules
}
