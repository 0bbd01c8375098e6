//! Space of deflections: three dofs (w, w_x, w_y) per node, without those that supports hold; and
//! dofs that belong to no node, or to the tip of a compliant stop at a node.

use crate::error::Result;
use crate::linalg::Layout;
use crate::mesh::{Mesh, Point};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use std::collections::HashMap;

/// Number of dofs per node: the deflection and its two slopes.
pub const PER_NODE: usize = 3;

/// Kind of support along an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// Clamped: no deflection and no slope.
    Clamped,
    /// Simply supported: no deflection, free to rotate.
    SimplySupported,
    /// Guided: no slope across the edge, free to deflect.
    Guided,
    /// Elastic: springs bear the edge, and no dof is held.
    Elastic,
}

impl Support {
    /// Returns whether w, the slope along the edge and the slope across it are held.
    fn holds(self) -> [bool; 3] {
        match self {
            Support::Clamped => [true, true, true],
            // Where w = 0 all along the edge, the slope along it vanishes too.
            Support::SimplySupported => [true, true, false],
            Support::Guided => [false, false, true],
            Support::Elastic => [false, false, false],
        }
    }

    /// Returns whether the support holds the deflection.
    pub fn holds_deflection(self) -> bool {
        self.holds()[0]
    }
}

/// Location of a support.
#[derive(Debug, Clone, PartialEq)]
pub enum Place {
    /// Edges, each given by a pair of nodes.
    Edges(Vec<[usize; 2]>),
    /// Single nodes.
    Nodes(Vec<usize>),
}

/// Constraints of the supports at a node.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct NodeConstraint {
    /// Number of supports that hold the deflection.
    pub deflection: f64,
    /// Sum of d d^T over the directions d in which supports hold the slope, as xx, xy, yy.
    pub slopes: [f64; 3],
}

/// Ratio of the eigenvalues of the slope tensor for two edges that meet at 45 degrees. Edges at a
/// smaller angle count as one smooth edge in their mean direction: to hold the slope along both
/// would clamp the nodes of a curved edge (Babuska's paradox).
const SMOOTH: f64 = 0.17;

/// Tolerance within which a direction counts as the direction of an axis.
const ALONG_AXIS: f64 = 1e-12;

impl NodeConstraint {
    /// Adds the constraints of a support along an edge with unit direction `along`, or at a single
    /// node where it is `None`.
    pub fn add(&mut self, support: Support, along: Option<[f64; 2]>) {
        let [deflection, slope_along, slope_across] = support.holds();
        self.deflection += f64::from(deflection);
        let Some([x, y]) = along else {
            // A single node has no edge direction: to hold the slope across means to hold both.
            if slope_across {
                self.slopes = [self.slopes[0] + 1.0, self.slopes[1], self.slopes[2] + 1.0];
            }
            return;
        };
        for (holds, [x, y]) in [(slope_along, [x, y]), (slope_across, [-y, x])] {
            if holds {
                for (sum, term) in self.slopes.iter_mut().zip([x * x, x * y, y * y]) {
                    *sum += term;
                }
            }
        }
    }

    /// Sums the constraints of all processes at each node, given the sum of their values there.
    /// Collective.
    ///
    /// An edge's support must also reach processes that have only a node of that edge.
    ///
    /// # Errors
    /// Returns the errors of the sum.
    pub fn add_up(holds: &mut [NodeConstraint], sum: impl Fn(&[f64]) -> Result<Vec<f64>>) -> Result<()> {
        let parts: [fn(&mut NodeConstraint) -> &mut f64; 4] = [
            |hold| &mut hold.deflection,
            |hold| &mut hold.slopes[0],
            |hold| &mut hold.slopes[1],
            |hold| &mut hold.slopes[2],
        ];
        for part in parts {
            let sums = sum(&holds.iter_mut().map(|hold| *part(hold)).collect::<Vec<_>>())?;
            holds.iter_mut().zip(sums).for_each(|(hold, sum)| *part(hold) = sum);
        }
        Ok(())
    }

    /// Returns whether anything is held.
    pub fn is_any(&self) -> bool {
        *self != NodeConstraint::default()
    }

    /// Returns how the slopes are constrained.
    fn slope(&self) -> Slope {
        let [xx, xy, yy] = self.slopes;
        let (mean, radius) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let (least, most) = (mean - radius, mean + radius);
        if most == 0.0 {
            return Slope::Axes([false, false]);
        }
        if least > SMOOTH * most {
            return Slope::Axes([true, true]);
        }
        if xy.abs() <= ALONG_AXIS * most {
            return Slope::Axes([xx > yy, yy > xx]);
        }
        // The eigenvector of the larger eigenvalue is held; the slope along the other one is free.
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        Slope::Askew([-angle.sin(), angle.cos()])
    }
}

/// Slopes that a node has left.
enum Slope {
    /// Whether w_x and w_y are held.
    Axes([bool; 2]),
    /// Unit direction in which the slope is free; the slope across it is held.
    Askew([f64; 2]),
}

/// Numbering of the free dofs, node by node, and of extra ones that belong to no node.
///
/// At a support oblique to the axes a node has one slope dof, in the direction that the support
/// leaves free; w_x and w_y are that dof times a factor each.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DofMap {
    free: Vec<Option<usize>>,
    /// Factors of the dofs at oblique supports; all others have the factor 1.
    factors: HashMap<usize, f64>,
    count: usize,
    extra: usize,
    /// Dof and node of each tip of a compliant stop, in the order in which they were given.
    pub(crate) tips: Vec<(usize, usize)>,
}

impl DofMap {
    /// Numbers the dofs that supports on named edges leave free.
    ///
    /// # Errors
    /// Returns [`Mesh`](crate::Error::Mesh) for an edge that the mesh does not have.
    pub fn new<'n>(mesh: &Mesh, supports: impl IntoIterator<Item = (&'n str, Support)>) -> Result<DofMap> {
        Ok(DofMap::of(&DofMap::holds(mesh, &DofMap::on_edges(mesh, supports)?)))
    }

    /// Returns supports on all sides of named edges.
    ///
    /// # Errors
    /// Returns the errors of [`DofMap::new`].
    pub fn on_edges<'n>(
        mesh: &Mesh,
        supports: impl IntoIterator<Item = (&'n str, Support)>,
    ) -> Result<Vec<(Place, Support)>> {
        let place = |(name, support): (&str, Support)| {
            mesh.edge_nodes(name)?;
            Ok((Place::Edges(mesh.edges[name].clone()), support))
        };
        supports.into_iter().map(place).collect()
    }

    /// Returns the constraints of the supports, one entry per node.
    pub fn holds(mesh: &Mesh, supports: &[(Place, Support)]) -> Vec<NodeConstraint> {
        let mut holds = vec![NodeConstraint::default(); mesh.nodes.len()];
        for (place, support) in supports {
            match place {
                Place::Edges(edges) => {
                    for &[a, b] in edges {
                        let side = (mesh.nodes[b] - mesh.nodes[a]).normalize();
                        for node in [a, b] {
                            holds[node].add(*support, Some([side.x, side.y]));
                        }
                    }
                }
                Place::Nodes(nodes) => nodes.iter().for_each(|&node| holds[node].add(*support, None)),
            }
        }
        holds
    }

    /// Numbers the dofs that the constraints leave free.
    pub fn of(holds: &[NodeConstraint]) -> DofMap {
        DofMap::numbered(holds, &[], true, 0)
    }

    /// Numbers every dof, held or not: `extra` dofs of no node, then node by node w, w_x and w_y
    /// with a dof for each tip of a compliant stop there. `tips` has the node of each tip.
    pub fn of_all(holds: &[NodeConstraint], extra: usize, tips: &[usize]) -> DofMap {
        DofMap::numbered(holds, tips, false, extra)
    }

    /// Returns for each of w, w_x and w_y of a node whether its constraints remove it.
    pub fn held(hold: &NodeConstraint) -> [bool; PER_NODE] {
        let [x, y] = match hold.slope() {
            Slope::Axes(held) => held,
            Slope::Askew(_) => [false, true],
        };
        [hold.deflection > 0.0, x, y]
    }

    /// Returns the part of the forces at w, w_x and w_y of a node that its constraints bear.
    pub fn borne(hold: &NodeConstraint, force: [f64; PER_NODE]) -> [f64; PER_NODE] {
        let [w, along_x, along_y] = force;
        let deflection = if hold.deflection > 0.0 { w } else { 0.0 };
        match hold.slope() {
            Slope::Axes([x, y]) => [deflection, if x { along_x } else { 0.0 }, if y { along_y } else { 0.0 }],
            Slope::Askew([x, y]) => {
                let free = along_x * x + along_y * y;
                [deflection, along_x - free * x, along_y - free * y]
            }
        }
    }

    fn numbered(holds: &[NodeConstraint], tips: &[usize], leave_out: bool, extra: usize) -> DofMap {
        let mut tips_at = vec![Vec::new(); if tips.is_empty() { 0 } else { holds.len() }];
        tips.iter().enumerate().for_each(|(tip, &node)| tips_at[node].push(tip));
        let mut space = DofMap { count: extra, tips: vec![(0, 0); tips.len()], ..DofMap::default() };
        for (node, hold) in holds.iter().enumerate() {
            let first = space.free.len();
            for held in DofMap::held(hold) {
                let is_left_out = held && leave_out;
                space.free.push((!is_left_out).then_some(space.count));
                space.count += usize::from(!is_left_out);
            }
            if let Slope::Askew([x, y]) = hold.slope() {
                space.free[first + 2] = space.free[first + 1];
                space.factors.extend([(first + 1, x), (first + 2, y)]);
            }
            for &tip in tips_at.get(node).into_iter().flatten() {
                space.tips[tip] = (space.count, node);
                space.count += 1;
            }
        }
        space
    }

    /// Returns the free dofs of a deflection given by its values and slopes at all nodes, three per
    /// node. Tips of compliant stops have the deflection of their node, other extra dofs are 0, and
    /// values that supports hold are lost.
    pub fn interpolate(&self, shape: &[f64]) -> Vec<f64> {
        let mut x = self.restrict(shape);
        for &(dof, node) in &self.tips {
            x[dof] = shape[PER_NODE * node];
        }
        x
    }

    /// Returns the load on the free dofs of a load on all deflections and slopes, three per node:
    /// at an oblique support, the part in the free direction.
    pub fn restrict(&self, load: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; self.dofs()];
        for (i, value) in load.iter().enumerate() {
            if let Some((dof, factor)) = self.dof(i) {
                x[dof] += factor * value;
            }
        }
        x
    }

    /// Returns deflection and slopes at all nodes, three per node; 0 where held.
    pub fn shape(&self, x: &[f64]) -> Vec<f64> {
        let mut shape: Vec<f64> = self.free.iter().map(|dof| dof.map_or(0.0, |dof| x[dof])).collect();
        self.factors.iter().for_each(|(&dof, factor)| shape[dof] *= factor);
        shape
    }

    /// Returns the space with `extra` more dofs after the nodes' dofs.
    pub fn with_extra(mut self, extra: usize) -> DofMap {
        self.extra = extra;
        self
    }

    /// Returns the space with one more dof for the tip of a compliant stop at each of some nodes,
    /// after all others.
    pub fn with_tips(mut self, nodes: impl IntoIterator<Item = usize>) -> DofMap {
        for node in nodes {
            self.tips.push((self.dofs(), node));
            self.extra += 1;
        }
        self
    }

    /// Returns the index of an extra dof after the nodes' dofs.
    pub fn extra(&self, number: usize) -> usize {
        self.count + number
    }

    /// Returns the factors of the dofs of some nodes, node by node, or `None` where all are 1.
    pub fn factors_of(&self, nodes: &[usize]) -> Option<Vec<f64>> {
        let dofs = || nodes.iter().flat_map(|&node| PER_NODE * node..PER_NODE * (node + 1));
        let factor = |dof: usize| self.factors.get(&dof).copied();
        (!self.factors.is_empty() && dofs().any(|dof| factor(dof).is_some()))
            .then(|| dofs().map(|dof| factor(dof).unwrap_or(1.0)).collect())
    }

    /// Returns the number of free dofs.
    pub fn dofs(&self) -> usize {
        self.count + self.extra
    }

    /// Returns the dof of a node's deflection, if it is free.
    pub fn deflection(&self, node: usize) -> Option<usize> {
        self.free[PER_NODE * node]
    }

    /// Returns the free dof that determines a dof of the mesh (three per node), and the factor that
    /// multiplies its value.
    pub fn dof(&self, shape_dof: usize) -> Option<(usize, f64)> {
        Some((self.free[shape_dof]?, self.factors.get(&shape_dof).copied().unwrap_or(1.0)))
    }

    /// Returns the free dofs of some nodes, three per node; `None` for those that are held.
    pub fn dofs_of<'s>(&'s self, nodes: &'s [usize]) -> impl Iterator<Item = Option<usize>> + 's {
        nodes.iter().flat_map(|&node| self.free[PER_NODE * node..PER_NODE * (node + 1)].iter().copied())
    }

    /// Returns the free deflection dofs and their nodes, ascending.
    pub fn deflections(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.free.len() / PER_NODE).filter_map(|node| Some((self.deflection(node)?, node)))
    }

    /// Returns the layout of the dofs for products cell by cell. The nodes follow each other line
    /// by line in x, kind by kind.
    pub fn layout(&self, mesh: &Mesh) -> Layout {
        let mut order: Vec<usize> = (0..mesh.nodes.len()).collect();
        order.sort_by(|&a, &b| {
            let (a, b) = (mesh.nodes[a], mesh.nodes[b]);
            a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
        });
        // Where the first node has its dofs at lines of the cache, so have others.
        let stride = order.len().next_multiple_of(CACHE_LINE);
        let mut places = vec![None; self.dofs()];
        for (rank, node) in order.into_iter().enumerate() {
            for (kind, free) in self.dofs_of(&[node]).enumerate() {
                free.into_iter().for_each(|dof| places[dof] = Some(kind * stride + rank));
            }
        }
        // Dofs that belong to no node come after all others.
        let mut others = PER_NODE * stride..;
        Layout::new(places.into_iter().map(|place| place.or_else(|| others.next()).unwrap_or_default()))
    }
}

/// Number of values in a line of the cache.
const CACHE_LINE: usize = 8;

/// Largest eigenvalue of the constraint matrix at which a rigid motion counts as free.
const HELD: f64 = 1e-9;

/// Constraints on the rigid motions w = a + b x + c y, with x and y relative to a centre and a
/// size.
#[derive(Debug, Clone, Copy)]
pub struct Rigid {
    centre: Point,
    size: f64,
    /// Sum of the squares of the constraints, as functions of a, b, c.
    constraints: Matrix3<f64>,
}

impl Rigid {
    /// Creates the unconstrained state for a plate around a point, with its size in m.
    pub fn new(centre: Point, size: f64) -> Rigid {
        Rigid { centre, size, constraints: Matrix3::zeros() }
    }

    /// Constrains the deflection at a point.
    pub fn hold_deflection(&mut self, point: Point) {
        let arm = (point - self.centre) / self.size;
        let row = Vector3::new(1.0, arm.x, arm.y);
        self.constraints += row * row.transpose();
    }

    /// Adds the constraints of the supports at a node.
    pub fn hold(&mut self, point: Point, hold: &NodeConstraint) {
        if hold.deflection > 0.0 {
            self.hold_deflection(point);
        }
        let [xx, xy, yy] = hold.slopes;
        self.constraints += Matrix3::new(0.0, 0.0, 0.0, 0.0, xx, xy, 0.0, xy, yy);
    }

    /// Returns the constraints as numbers that add up over ranks.
    pub fn constraints(&self) -> &[f64] {
        self.constraints.as_slice()
    }

    /// Sets the constraints to the sum over all ranks.
    pub fn set_constraints(&mut self, sum: &[f64]) {
        self.constraints = Matrix3::from_column_slice(sum);
    }

    /// Returns the centre and the size, in m, to which the motions are relative.
    pub fn frame(&self) -> (Point, f64) {
        (self.centre, self.size)
    }

    /// Returns the rigid motions that are free, as orthonormal vectors (a, b, c).
    pub fn free(&self) -> Vec<Vector3<f64>> {
        let eigen = SymmetricEigen::new(self.constraints);
        (0..3)
            .filter(|&k| eigen.eigenvalues[k] < HELD)
            .map(|k| eigen.eigenvectors.column(k).into_owned())
            .collect()
    }

    /// Returns the free rigid motions in words, or `None` where there is none.
    pub fn mechanism(&self) -> Option<&'static str> {
        match &self.free()[..] {
            [] => None,
            [motion] if motion[0].abs() > 0.999 => Some("it can move up and down"),
            [_] => Some("it can turn about a line"),
            [_, _] => Some("it can move up and down and turn about a line"),
            _ => Some("nothing holds it"),
        }
    }
}
