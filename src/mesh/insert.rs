//! Insertion of nodes at points, and where lines cross the sides of cells.
//!
//! A point becomes a node by the best of several changes of the cells around it. Either a nearby
//! node moves there, or the cell (alone or with neighbours) is divided into triangles that meet in
//! the point. The best change is the one whose worst new cell has the best angles. Boundaries,
//! named edges and edges between groups keep their shape; a point near one gets a second node
//! opposite to it there if that makes better angles.

use std::collections::{HashMap, HashSet};

use super::{Cell, Grid, Mesh, Point};
use crate::error::{Error, Result};
use crate::geometry::{self, Segment};

/// Distance up to which a node counts as at a point, relative to the size of the plate.
pub(crate) const NEAR: f64 = 1e-6;

/// Largest distance by which a node moves, relative to the shortest side around it.
const FARTHEST_MOVE: f64 = 0.35;

/// Least quality of a new cell, which admits angles from 0.03 to 177 degrees. Right-angled needles
/// keep the elements' accuracy (the maximum angle condition), and rounding leaves them enough
/// digits.
const LEAST_QUALITY: f64 = 5e-4;

/// Distance of a side from a point, relative to the side's length, up to which the side may get a
/// node opposite to the point.
const BESIDE: f64 = 0.5;

/// Largest number of searches for sides that a line crosses.
const MOST_PASSES: usize = 100;

/// Location where nodes are required.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mark {
    /// Node at a point.
    At(Point),
    /// Nodes at the ends of a line, where they lie in the plate, and where it crosses the sides of
    /// cells.
    Line([Point; 2]),
}

/// Node that was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Made {
    /// Position of the node, in m.
    pub at: Point,
    /// Previous position of a moved node, in m; `None` for a new one.
    pub moved_from: Option<Point>,
}

/// Returns the distance from a place, in m, up to which a node counts as there.
pub(crate) fn nearness(nodes: &[Point], place: Point) -> f64 {
    NEAR * nodes.iter().map(|p| (p - place).norm()).fold(0.0, f64::max)
}

impl Mark {
    /// Returns the point from which the mark's nearness is measured.
    fn place(&self) -> Point {
        match self {
            Mark::At(point) => *point,
            Mark::Line([from, _]) => *from,
        }
    }
}

impl Grid {
    /// Returns whether a grid has nodes wherever marks require them; for an oblique line the answer
    /// is no.
    pub fn has_nodes(&self, marks: &[(String, Mark)]) -> bool {
        let end = self.node(self.nodes() - 1);
        let corners = [Point::origin(), Point::new(end.x, 0.0), Point::new(0.0, end.y), end];
        let [nx, ny] = self.cells;
        // Whether the nearest line of nodes is near enough.
        let on = |axis: usize, value: f64, near: f64| {
            let count = [nx, ny][axis] as f64;
            let number = (value / end[axis] * count).round().clamp(0.0, count);
            (value - end[axis] * number / count).abs() <= near
        };
        marks.iter().all(|(_, mark)| {
            let near = nearness(&corners, mark.place()) * 0.5;
            let is_node = |p: &Point| on(0, p.x, near) && on(1, p.y, near);
            let is_outside = |p: &Point| (0..2).any(|axis| p[axis] < -near || p[axis] > end[axis] + near);
            match mark {
                Mark::At(point) => is_node(point),
                Mark::Line([from, to]) => {
                    let lies =
                        |axis: usize| (to[axis] - from[axis]).abs() <= near && on(axis, from[axis], near);
                    (lies(0) || lies(1)) && [from, to].into_iter().all(|p| is_node(p) || is_outside(p))
                }
            }
        })
    }
}

impl Mesh {
    /// Returns the mesh with nodes wherever marks require them, and the nodes that were moved or
    /// made for this. A mesh that has them all stays unchanged. The marks' names appear in
    /// messages.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] for a point outside the mesh, and for one where a node would make
    /// cells too flat.
    pub fn with_nodes(self, marks: &[(String, Mark)]) -> Result<(Mesh, Vec<Made>)> {
        if marks.iter().all(|(_, mark)| self.has(mark)) {
            return Ok((self, Vec::new()));
        }
        let mut work = Work::new(self, marks);
        for (key, mark) in marks {
            let near = nearness(&work.mesh.nodes, mark.place());
            match mark {
                Mark::At(point) => work.place(key, *point, near)?,
                Mark::Line(ends) => {
                    for end in ends {
                        // An end too near to an edge gets no node.
                        if let Some(cell) = work.mesh.locate(*end) {
                            work.settle(*end, cell, near);
                        }
                    }
                }
            }
        }
        for (key, mark) in marks {
            if let Mark::Line(ends) = mark {
                work.cross(key, *ends, nearness(&work.mesh.nodes, mark.place()))?;
            }
        }
        work.finish()
    }

    /// Returns whether nodes exist wherever a mark requires them.
    fn has(&self, mark: &Mark) -> bool {
        let near = nearness(&self.nodes, mark.place());
        let has_node = |point: &Point| self.nodes.iter().any(|node| (node - point).norm() <= near);
        match mark {
            Mark::At(point) => has_node(point),
            Mark::Line(ends) => {
                ends.iter().all(|end| has_node(end) || self.locate(*end).is_none())
                    && self.crossed(&Segment::new(*ends), near).is_empty()
            }
        }
    }

    /// Returns the sides of cells that a segment crosses away from nodes, ordered along it, each
    /// once, with a cell to its left.
    fn crossed(&self, segment: &Segment, near: f64) -> Vec<([usize; 2], usize)> {
        let mut crossings = Vec::new();
        let mut seen = HashSet::new();
        for (number, cell) in self.cells.iter().enumerate() {
            for [a, b] in cell.edges() {
                let [[from, left], [to, right]] = [a, b].map(|node| segment.measure(self.nodes[node]));
                if left * right >= 0.0 || left.abs() <= near || right.abs() <= near {
                    continue;
                }
                let along = from + (to - from) * (left / (left - right));
                let inside = along >= -near && along <= segment.length + near;
                if inside && seen.insert([a.min(b), a.max(b)]) {
                    crossings.push((along, [a, b], number));
                }
            }
        }
        crossings.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        crossings.into_iter().map(|(_, side, cell)| (side, cell)).collect()
    }
}

/// Change of the mesh.
#[derive(Default)]
struct Plan {
    /// Positions of new nodes, which are numbered after those of the mesh.
    nodes: Vec<Point>,
    /// Node that moves, and its new position.
    moved: Option<(usize, Point)>,
    /// Cells that are removed.
    removed: Vec<usize>,
    /// Cells that are added, each with a removed cell whose groups it inherits.
    added: Vec<(Cell, usize)>,
    /// Sides that are divided in two, with the new node on each.
    cuts: Vec<([usize; 2], usize)>,
    /// Least quality of the changed cells.
    quality: f64,
}

/// Mesh under change.
struct Work {
    mesh: Mesh,
    /// Cell to the left of each side.
    owners: HashMap<[usize; 2], usize>,
    /// Sides with a name, as ascending node pairs.
    named: HashSet<[usize; 2]>,
    /// Groups to which each cell belongs.
    groups: Vec<Vec<usize>>,
    /// Nodes that must stay where they are.
    fixed: HashSet<usize>,
    made: Vec<Made>,
}

fn ascending([a, b]: [usize; 2]) -> [usize; 2] {
    [a.min(b), a.max(b)]
}

impl Work {
    fn new(mesh: Mesh, marks: &[(String, Mark)]) -> Work {
        let mut groups = vec![Vec::new(); mesh.cells.len()];
        for (name, cells) in mesh.groups.values().enumerate() {
            cells.iter().for_each(|&cell| groups[cell].push(name));
        }
        let mut fixed: HashSet<usize> = mesh.points.values().flatten().copied().collect();
        for (_, mark) in marks {
            let near = nearness(&mesh.nodes, mark.place());
            let ends = match mark {
                Mark::At(point) => [*point, *point],
                Mark::Line(ends) => *ends,
            };
            let segment = Segment::new(ends);
            let here = (0..mesh.nodes.len()).filter(|&node| segment.distance(mesh.nodes[node]) <= near);
            fixed.extend(here);
        }
        let sides = mesh.cells.iter().enumerate();
        Work {
            owners: sides.flat_map(|(number, cell)| cell.edges().map(move |side| (side, number))).collect(),
            named: mesh.edges.values().flatten().map(|side| ascending(*side)).collect(),
            groups,
            fixed,
            made: Vec::new(),
            mesh,
        }
    }

    /// Makes a node at a point, unless there is one.
    fn place(&mut self, key: &str, point: Point, near: f64) -> Result<()> {
        let cell = match self.mesh.locate(point) {
            Some(cell) => cell,
            None => self.on_boundary(key, point, near)?,
        };
        if self.settle(point, cell, near) {
            return Ok(());
        }
        let node = self.nearest(point);
        Err(Error::Mesh(format!(
            "{key}: a node at {} would make cells of angles near 0 or 180 degrees; expected a point farther from the \
             plate's edge and from other nodes that must stay, or on one, such as {}",
            geometry::place(point),
            geometry::place(node)
        )))
    }

    /// Makes a node at a point of a cell, unless there is one. Returns whether there is one now.
    fn settle(&mut self, point: Point, cell: usize, near: f64) -> bool {
        if let Some(node) = self.mesh.nodes.iter().position(|node| (node - point).norm() <= near) {
            self.fixed.insert(node);
            return true;
        }
        let plan = self.best(point, cell, near);
        let is_possible = plan.is_some();
        plan.into_iter().for_each(|plan| self.apply(plan));
        is_possible
    }

    fn nearest(&self, point: Point) -> Point {
        let distance = |p: &&Point| (*p - point).norm();
        self.mesh.nodes.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).copied().unwrap_or(point)
    }

    /// Returns the cell next to a point that lies outside by no more than `near`.
    fn on_boundary(&self, key: &str, point: Point, near: f64) -> Result<usize> {
        for (number, cell) in self.mesh.cells.iter().enumerate() {
            for side in cell.edges().filter(|[a, b]| !self.owners.contains_key(&[*b, *a])) {
                let segment = self.segment(side);
                if segment.distance(point) <= near {
                    return Ok(number);
                }
            }
        }
        let node = self.nearest(point);
        Err(Error::Mesh(format!(
            "{key}: the point {} lies outside the plate; the nearest node is at {}",
            geometry::place(point),
            geometry::place(node)
        )))
    }

    /// Makes nodes where a segment crosses the sides of cells. A side stays whole where a node
    /// would make cells too flat.
    fn cross(&mut self, key: &str, ends: [Point; 2], near: f64) -> Result<()> {
        let segment = Segment::new(ends);
        let mut left_whole = HashSet::new();
        for _ in 0..MOST_PASSES {
            let crossed = self.mesh.crossed(&segment, near);
            if crossed.iter().all(|(side, _)| left_whole.contains(&ascending(*side))) {
                return Ok(());
            }
            for ([a, b], _) in crossed {
                let Some(&cell) =
                    self.owners.get(&[a, b]).filter(|_| !left_whole.contains(&ascending([a, b])))
                else {
                    continue;
                };
                let [from, to] = [a, b].map(|node| self.mesh.nodes[node]);
                let [[_, left], [_, right]] = [from, to].map(|p| segment.measure(p));
                // Nodes may have moved onto the line in the meantime.
                if left * right >= 0.0 || left.abs() <= near || right.abs() <= near {
                    continue;
                }
                let point = from + (to - from) * (left / (left - right));
                match self.best(point, cell, near) {
                    Some(plan) => self.apply(plan),
                    None => {
                        left_whole.insert(ascending([a, b]));
                    }
                }
            }
        }
        Err(Error::Mesh(format!("{key}: the cells cannot be cut along the line")))
    }

    fn segment(&self, side: [usize; 2]) -> Segment {
        Segment::new(side.map(|node| self.mesh.nodes[node]))
    }

    /// Returns the cell on the other side of a cell's side.
    fn beyond(&self, [a, b]: [usize; 2]) -> Option<usize> {
        self.owners.get(&[b, a]).copied()
    }

    /// Returns whether a side must keep its shape: on the boundary, named, or between groups.
    fn is_hard(&self, side: [usize; 2]) -> bool {
        let group = self.owners.get(&side).map(|&cell| &self.groups[cell]);
        let other = self.beyond(side).map(|cell| &self.groups[cell]);
        group.is_none() || other.is_none() || group != other || self.named.contains(&ascending(side))
    }

    /// Returns the cells around a node that may move, starting from one of them.
    fn around(&self, node: usize, first: usize) -> Option<Vec<usize>> {
        if self.fixed.contains(&node) {
            return None;
        }
        let mut cells = vec![first];
        loop {
            let cell = &self.mesh.cells[*cells.last()?];
            let side = cell.edges().find(|[_, end]| *end == node)?;
            if self.is_hard(side) {
                return None;
            }
            let next = self.beyond(side)?;
            if next == first {
                return Some(cells);
            }
            if cells.contains(&next) {
                return None;
            }
            cells.push(next);
        }
    }

    /// Returns the best change that makes a node at a point of a cell, or `None` if each would make
    /// cells too flat.
    fn best(&self, point: Point, cell: usize, near: f64) -> Option<Plan> {
        let sides: Vec<[usize; 2]> = self.mesh.cells[cell].edges().collect();
        let distance = |side: &[usize; 2]| self.segment(*side).distance(point);
        let nearest = sides.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let on = (distance(&nearest) <= near).then_some(nearest);
        let on_hard = on.filter(|side| self.is_hard(*side));
        let point = match on_hard {
            // Projection keeps the point on the boundary despite rounding.
            Some(side) => {
                let segment = self.segment(side);
                let [along, _] = segment.measure(point);
                segment.from + segment.along * along
            }
            None => point,
        };
        let mut plans: Vec<Plan> = Vec::new();
        let mut cells = vec![cell];
        if on_hard.is_none() {
            cells.extend(on.and_then(|side| self.beyond(side)));
            for &neighbour in &cells {
                let nodes = self.mesh.cells[neighbour].nodes();
                plans.extend(nodes.iter().filter_map(|&node| self.moving(node, point, neighbour)));
            }
        }
        let soft = |side: &[usize; 2]| !self.is_hard(*side);
        let neighbours: Vec<usize> =
            sides.iter().filter(|side| soft(side)).filter_map(|side| self.beyond(*side)).collect();
        let mut cavities = vec![cells.clone()];
        for (k, &one) in neighbours.iter().enumerate() {
            cavities.push([&cells[..], &[one]].concat());
            cavities.extend(neighbours[k + 1..].iter().map(|&other| [&cells[..], &[one, other]].concat()));
        }
        let foot = |side: &[usize; 2]| {
            let segment = self.segment(*side);
            let [along, across] = segment.measure(point);
            let inside = along > 0.0 && along < segment.length && across < BESIDE * segment.length;
            (inside && Some(*side) != on && self.is_hard(*side))
                .then(|| (*side, segment.from + segment.along * along))
        };
        let feet: Vec<([usize; 2], Point)> = sides.iter().filter_map(foot).collect();
        let mut choices = vec![Vec::new()];
        choices.extend(feet.iter().map(|foot| vec![*foot]));
        if feet.len() > 1 {
            choices.push(feet);
        }
        for cavity in &mut cavities {
            let mut seen = HashSet::new();
            cavity.retain(|cell| seen.insert(*cell));
            plans.extend(choices.iter().filter_map(|feet| self.cut(cavity, point, on_hard, feet)));
        }
        let mut best: Option<Plan> = None;
        for plan in plans {
            if plan.quality > best.as_ref().map_or(LEAST_QUALITY, |best| best.quality) {
                best = Some(plan);
            }
        }
        best
    }

    /// Plans the move of a node of a cell to a point.
    fn moving(&self, node: usize, point: Point, cell: usize) -> Option<Plan> {
        let around = self.around(node, cell)?;
        let sides = around.iter().flat_map(|&cell| self.mesh.cells[cell].edges());
        let touching = sides.filter(|side| side.contains(&node)).map(|side| self.segment(side).length);
        let shortest = touching.fold(f64::INFINITY, f64::min);
        if (self.mesh.nodes[node] - point).norm() > FARTHEST_MOVE * shortest {
            return None;
        }
        let place = |n: &usize| if *n == node { point } else { self.mesh.nodes[*n] };
        let qualities = around
            .iter()
            .map(|&cell| cell_quality(&self.mesh.cells[cell].nodes().iter().map(place).collect::<Vec<_>>()));
        let quality = qualities.fold(f64::INFINITY, f64::min);
        Some(Plan { moved: Some((node, point)), quality, ..Plan::default() })
    }

    /// Plans the division of some cells into triangles that meet in a point, on one of their outer
    /// sides or inside, with nodes at its feet on other sides.
    fn cut(
        &self,
        cavity: &[usize],
        point: Point,
        on: Option<[usize; 2]>,
        feet: &[([usize; 2], Point)],
    ) -> Option<Plan> {
        let count = self.mesh.nodes.len();
        let mut plan = Plan { nodes: vec![point], removed: cavity.to_vec(), ..Plan::default() };
        let (mut inner, mut outer) = (HashSet::new(), HashSet::new());
        for &cell in cavity {
            inner.extend(self.mesh.cells[cell].nodes());
            for side in self.mesh.cells[cell].edges() {
                if self.beyond(side).is_some_and(|other| cavity.contains(&other)) {
                    continue;
                }
                let [a, b] = side;
                outer.extend([a, b]);
                let foot = feet.iter().find(|(edge, _)| *edge == side);
                let node = match foot {
                    Some((_, foot)) => {
                        plan.nodes.push(*foot);
                        count + plan.nodes.len() - 1
                    }
                    None => count,
                };
                if foot.is_none() && on != Some(side) {
                    plan.added.push((Cell::Triangle([a, b, count]), cell));
                    continue;
                }
                if foot.is_some() {
                    plan.added.push((Cell::Triangle([a, node, count]), cell));
                    plan.added.push((Cell::Triangle([node, b, count]), cell));
                }
                plan.cuts.push((side, node));
                let Some(other) = self.beyond(side) else { continue };
                if plan.removed.contains(&other) {
                    return None;
                }
                plan.removed.push(other);
                let rest = self.mesh.cells[other].edges().filter(|rest| *rest != [b, a]);
                plan.added.extend(rest.map(|[c, d]| (Cell::Triangle([c, d, node]), other)));
            }
        }
        // A node inside the cavity would be lost.
        if inner != outer || feet.iter().any(|(side, _)| !plan.cuts.iter().any(|(cut, _)| cut == side)) {
            return None;
        }
        let place = |n: &usize| if *n < count { self.mesh.nodes[*n] } else { plan.nodes[*n - count] };
        let quality =
            |(cell, _): &(Cell, usize)| cell_quality(&cell.nodes().iter().map(place).collect::<Vec<_>>());
        plan.quality = plan.added.iter().map(quality).fold(f64::INFINITY, f64::min);
        Some(plan)
    }

    fn apply(&mut self, plan: Plan) {
        let first = self.mesh.nodes.len();
        if let Some((node, point)) = plan.moved {
            let moved_from = Some(self.mesh.nodes[node]);
            self.mesh.nodes[node] = point;
            self.fixed.insert(node);
            self.made.push(Made { at: point, moved_from });
        }
        for point in plan.nodes {
            self.fixed.insert(self.mesh.nodes.len());
            self.mesh.nodes.push(point);
            self.made.push(Made { at: point, moved_from: None });
        }
        debug_assert!(plan.cuts.iter().all(|(_, node)| *node >= first));
        for &cell in &plan.removed {
            for side in self.mesh.cells[cell].edges() {
                self.owners.remove(&side);
            }
        }
        let groups: Vec<Vec<usize>> =
            plan.added.iter().map(|(_, parent)| self.groups[*parent].clone()).collect();
        let mut places = plan.removed.into_iter();
        for ((cell, _), groups) in plan.added.into_iter().zip(groups) {
            let number = match places.next() {
                Some(number) => {
                    (self.mesh.cells[number], self.groups[number]) = (cell, groups);
                    number
                }
                None => {
                    self.mesh.cells.push(cell);
                    self.groups.push(groups);
                    self.mesh.cells.len() - 1
                }
            };
            self.owners.extend(cell.edges().map(|side| (side, number)));
        }
        for (side, node) in plan.cuts {
            if !self.named.remove(&ascending(side)) {
                continue;
            }
            self.named.extend(side.map(|end| ascending([end, node])));
            for sides in self.mesh.edges.values_mut() {
                let cut = |&[a, b]: &[usize; 2]| {
                    let is_cut = ascending([a, b]) == ascending(side);
                    if is_cut { vec![[a, node], [node, b]] } else { vec![[a, b]] }
                };
                *sides = sides.iter().flat_map(cut).collect();
            }
        }
    }

    fn finish(mut self) -> Result<(Mesh, Vec<Made>)> {
        if self.made.is_empty() {
            return Ok((self.mesh, self.made));
        }
        for (name, cells) in self.mesh.groups.values_mut().enumerate() {
            *cells = (0..self.groups.len()).filter(|&cell| self.groups[cell].contains(&name)).collect();
        }
        self.mesh.check()?;
        Ok((self.mesh, self.made))
    }
}

/// Returns the quality of a cell's angles: at most 1, for an equilateral triangle and a rectangle;
/// 0 for a flat cell; less for an inverted one.
fn cell_quality(vertices: &[Point]) -> f64 {
    use std::f64::consts::PI;
    let count = vertices.len();
    let angle = |i: usize| {
        let corner = vertices[i];
        let (next, last) = (vertices[(i + 1) % count] - corner, vertices[(i + count - 1) % count] - corner);
        next.perp(&last).atan2(next.dot(&last))
    };
    let angles = (0..count).map(angle);
    let (least, most) = angles.fold((PI, 0.0_f64), |(least, most), a| (least.min(a), most.max(a)));
    // Large angles are worse than small ones.
    let (small, large) = if count == 3 { (3.0 / PI, 1.5 / PI) } else { (2.0 / PI, 2.0 / PI) };
    if geometry::area(vertices) <= 0.0 { -1.0 } else { (small * least).min((large * (PI - most)).powi(2)) }
}
