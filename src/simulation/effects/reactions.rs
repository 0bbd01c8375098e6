//! Reactions of named supports: the rows of the balance of forces at the dofs that they hold.
//!
//! K and M are applied cell by cell to the cells at the held nodes, as the engines do over the free
//! dofs, with the fields of [`StepBalance`] and the loads of the same instants. The residual at a
//! held dof is the force or the moment of its support on the plate.
//!
//! A node that several named supports hold belongs to the first of them in the scene. The springs
//! of an elastic edge act on all of its nodes, and their force counts for the edge even where
//! another support holds the node.

use super::contributions::PointTerm;
use super::following_pressure::FollowingPressure;
use super::ground::BuildContext;
use super::loads::Loads;
use super::motion::Lift;
use super::stretching::NodalEnergy;
use crate::assembly::{self, CellArrays};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE, Place};
use crate::error::Result;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{Engine, Form};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::SupportKind;
use crate::scheme::{ForcesOfDeflection, StepBalance, System};
use crate::simulation::DeflectionDof;
use crate::simulation::regions::supports;
use std::rc::Rc;

/// Function that sums values at the nodes over all processes. Collective.
type NodeSum = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Function that returns forces at all nodes, three per node, for a displacement. Collective.
type ForceAtNodes = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Function that returns loads at all nodes, three per node, at an instant (s) and a displacement.
/// Collective.
type LoadAtNodes = dyn Fn(f64, &[f64]) -> Result<Vec<f64>>;

/// Function that subtracts the loads at instants (s) with weights at the held nodes. Collective.
type LoadOfInstants = dyn Fn(&[(f64, f64)], &mut [f64]) -> Result<()>;

/// Force, in N, and moments about x and y, in N m.
pub(in crate::simulation) type Wrench = [f64; 3];

/// Node of a named support.
struct HeldNode {
    node: usize,
    point: Point,
    /// Constraints that the support bears; `None` where another support bears them.
    hold: Option<NodeConstraint>,
    /// Index of the support among the named ones.
    support: usize,
    is_own: bool,
}

/// Cell at held nodes.
struct HeldCell {
    /// Index of the cell and, with the singular mass, of its velocity.
    number: usize,
    free: CellArrays,
    /// The same arrays over all deflections and slopes.
    whole: CellArrays,
    /// Contributions of effects to K.
    beds: Vec<Rc<[f64]>>,
}

/// Forces of a support motion at the held nodes.
struct HeldLift {
    /// Forces of the shape at 1 m, and momenta at 1 m/s.
    force: Vec<f64>,
    momentum: Vec<f64>,
    /// Forces of elastic edges on the shape at 1 m.
    on_edges: Vec<f64>,
    /// Whether damping by the stiffness acts on the motion too: its shape bends the plate.
    is_damped: bool,
}

/// Deflection over the dofs of this process, or over all deflections and slopes of its nodes.
#[derive(Clone, Copy)]
enum DofVector<'d> {
    Free(&'d [f64]),
    Whole(&'d [f64]),
}

/// Reactions of the named supports of a scene, on this process's part of the mesh.
pub(in crate::simulation) struct Reactions {
    /// Centroid of each named support, in m.
    centroids: Vec<Point>,
    nodes: Vec<HeldNode>,
    cells: Vec<HeldCell>,
    /// Supports whose reaction includes the force of contributions to K, by their index among the
    /// named ones, and the cells of these.
    edges: Vec<(usize, Vec<HeldCell>)>,
    springs: Vec<PointTerm>,
    dashpots: Vec<PointTerm>,
    /// Masses that the cells do not carry.
    masses: Vec<PointTerm>,
    /// Inertia of each mode of the modal mass at the held nodes; empty for other masses.
    modes: Vec<Vec<f64>>,
    lifts: Vec<HeldLift>,
    /// Bound and node of each place with friction.
    frictional: Vec<[usize; 2]>,
    /// Forces of stretching at all nodes of this process for a displacement over the dofs, three
    /// per node; `None` for a plate that only bends. Collective.
    stretching: Option<Box<ForceAtNodes>>,
    /// Loads that depend on the deflection at all nodes of this process, three per node, at an
    /// instant (s) and a displacement; `None` without any. Collective.
    following: Option<Box<LoadAtNodes>>,
    loads: Box<LoadOfInstants>,
    sum_at_nodes: Box<NodeSum>,
    /// Number of nodes of this process.
    count: usize,
    /// Number of cells of this process.
    velocities: usize,
}

impl Reactions {
    /// Prepares the reactions of the named supports; `None` where no support has a name.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the scene's regions on the mesh, and of the engine.
    pub(super) fn new<E: Engine, P: Partition>(
        ground: &BuildContext<P>,
        system: &System<E>,
        loads: &Loads<P>,
        lifts: &[Lift],
        bounded: &[DeflectionDof],
    ) -> Result<Option<Reactions>> {
        let BuildContext { scene, mesh, partition, terms, .. } = ground;
        if scene.supports.iter().all(|support| support.name.is_none()) {
            return Ok(None);
        }
        let (nodes, centroids) = nodes(ground)?;
        let whole = assembly::unheld(mesh, &ground.cells);
        let cell = |number: usize, beds: Vec<Rc<[f64]>>| {
            let (free, whole) = (ground.cells[number].clone(), whole[number].clone());
            HeldCell { number, free, whole, beds }
        };
        let mut is_held = vec![false; mesh.nodes.len()];
        nodes.iter().filter(|held| held.hold.is_some()).for_each(|held| is_held[held.node] = true);
        let mut beds = vec![Vec::new(); mesh.cells.len()];
        terms.stiffness.iter().for_each(|term| beds[term.cell].push(term.matrix.clone()));
        let cells = beds.into_iter().enumerate();
        let cells = cells.filter(|(number, _)| mesh.cells[*number].nodes().iter().any(|&node| is_held[node]));
        let named = scene.supports.iter().enumerate().filter(|(_, support)| support.name.is_some());
        let edge = |(index, (number, _)): (usize, (usize, _))| {
            let of_support = terms.stiffness.iter().filter(|term| term.support == Some(number));
            (index, of_support.map(|term| cell(term.cell, vec![term.matrix.clone()])).collect::<Vec<_>>())
        };
        let loads = loads.at_nodes(nodes.iter().map(|held| held.node).collect());
        let by_partition = (*partition).clone();
        let mut reactions = Reactions {
            centroids,
            cells: cells.map(|(number, beds)| cell(number, beds)).collect(),
            edges: named.enumerate().map(edge).filter(|(_, cells)| !cells.is_empty()).collect(),
            springs: terms.springs.clone(),
            dashpots: terms.dashpots.clone(),
            masses: terms.masses().cloned().collect(),
            modes: Vec::new(),
            lifts: Vec::new(),
            frictional: {
                let nodes = system.drive.friction.iter().flat_map(|friction| &friction.nodes);
                nodes.map(|node| [node.bound, bounded[node.bound].node]).collect()
            },
            stretching: NodalEnergy::new(ground).map(|energy| {
                let at_nodes: Box<ForceAtNodes> = Box::new(move |u| energy.at_nodes(u));
                at_nodes
            }),
            following: FollowingPressure::new(ground)?.map(|pressure| {
                let at_nodes: Box<LoadAtNodes> = Box::new(move |t, u| pressure.at_nodes(t, u));
                at_nodes
            }),
            loads: Box::new(move |instants, force| loads.subtract(instants, force)),
            sum_at_nodes: Box::new(move |values| by_partition.sum_at_nodes(values)),
            count: mesh.nodes.len(),
            velocities: mesh.cells.len(),
            nodes,
        };
        if let Form::Modal { modes, .. } = &system.mass {
            let inertia = |k: usize| {
                let shape = system.engine.to_local(modes.shapes.col_as_slice(k))?;
                Ok(reactions.rows(|force| reactions.add_consistent(DofVector::Free(&shape), force)))
            };
            reactions.modes = (0..modes.count()).map(inertia).collect::<Result<_>>()?;
        }
        let is_singular = matches!(system.mass, Form::SingularMassCells(_));
        reactions.lifts = lifts.iter().map(|lift| reactions.lift(lift, is_singular)).collect();
        Ok(Some(reactions))
    }

    /// Returns this process's part of the forces at its held nodes: for w in N, for the slopes in
    /// N m. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the loads.
    pub fn at_nodes<E: Engine>(&self, system: &System<E>, balance: &StepBalance) -> Result<Vec<f64>> {
        let System { engine, mass, damping, .. } = system;
        let (u, a) = (engine.to_local(&balance.displacement)?, &balance.acceleration);
        let mut force = self.rows(|force| {
            self.add_elastic(DofVector::Free(&u), force);
            if let Form::SingularMassCells(_) = mass {
                self.add_singular(|cell| a[cell.number], |k, _| a[self.velocities + k], force);
            }
        });
        if !balance.rates.is_empty() {
            let rates = engine.to_local(&balance.rates)?;
            let rates = DofVector::Free(&rates);
            let damped = self.rows(|force| {
                self.dashpots.iter().for_each(|dashpot| push(dashpot, rates.under(dashpot), force));
            });
            axpy(1.0, &damped, &mut force);
        }
        match mass {
            Form::Cells(_) => {
                let a = engine.to_local(a)?;
                axpy(1.0, &self.rows(|force| self.add_consistent(DofVector::Free(&a), force)), &mut force);
            }
            Form::SingularMassCells(_) => {}
            Form::Modal { .. } => {
                self.modes.iter().zip(a).for_each(|(inertia, a)| axpy(*a, inertia, &mut force));
            }
        }
        for ForcesOfDeflection { time, displacement, stretching, load } in &balance.followed {
            if let Some(at_nodes) = self.stretching.as_ref().filter(|_| *stretching != 0.0) {
                let pull = at_nodes(displacement)?;
                axpy(*stretching, &self.rows(|force| force.copy_from_slice(&pull)), &mut force);
            }
            if let Some(at_nodes) = self.following.as_ref().filter(|_| *load != 0.0) {
                let push = at_nodes(*time, displacement)?;
                axpy(-load, &self.rows(|force| force.copy_from_slice(&push)), &mut force);
            }
        }
        if let Some(moments) = &balance.friction {
            let of_friction = self.rows(|force| {
                for &[bound, node] in &self.frictional {
                    force[PER_NODE * node + 1..][..2].copy_from_slice(&moments[bound]);
                }
            });
            axpy(-1.0, &of_friction, &mut force);
        }
        for (k, lift) in self.lifts.iter().enumerate() {
            axpy(self.stretch(k, damping.stiffness, balance), &lift.force, &mut force);
            axpy(balance.support_accelerations[k], &lift.momentum, &mut force);
        }
        (self.loads)(&balance.loads, &mut force)?;
        for (node, force) in self.nodes.iter().zip(force.as_chunks_mut::<PER_NODE>().0) {
            *force = node.hold.as_ref().map_or([0.0; PER_NODE], |hold| DofMap::borne(hold, *force));
        }
        axpy(-1.0, &self.on_edges(DofVector::Free(&u)), &mut force);
        for (k, lift) in self.lifts.iter().enumerate() {
            axpy(-self.stretch(k, damping.stiffness, balance), &lift.on_edges, &mut force);
        }
        Ok(force)
    }

    /// Returns the place of a support motion that K acts on, in m, given the damping by the
    /// stiffness (s).
    fn stretch(&self, motion: usize, damping: f64, balance: &StepBalance) -> f64 {
        let rate = if self.lifts[motion].is_damped { damping * balance.support_rates[motion] } else { 0.0 };
        balance.places[motion] + rate
    }

    /// Returns this process's part of force and moments about the centroid, for each named support.
    pub fn sums(&self, at_nodes: &[f64]) -> Vec<Wrench> {
        let mut sums = vec![Wrench::default(); self.centroids.len()];
        for (node, [w, along_x, along_y]) in self.nodes.iter().zip(at_nodes.as_chunks().0) {
            let arm = node.point - self.centroids[node.support];
            let [force, x, y] = &mut sums[node.support];
            *force += w;
            *x += w * arm.y + along_y;
            *y -= w * arm.x + along_x;
        }
        sums
    }

    /// Returns the named support, the position and force and moments of each held node of this
    /// process, given its part of the forces. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn distribution(&self, at_nodes: &[f64]) -> Result<Vec<(usize, [f64; 2], Wrench)>> {
        let mut rows = Vec::new();
        for support in 0..self.centroids.len() {
            let of_support =
                || self.nodes.iter().enumerate().filter(move |(_, node)| node.support == support);
            let mut sums = Vec::new();
            for which in 0..PER_NODE {
                let mut values = vec![0.0; self.count];
                of_support().for_each(|(k, node)| values[node.node] = at_nodes[PER_NODE * k + which]);
                sums.push((self.sum_at_nodes)(&values)?);
            }
            for (_, HeldNode { node, point, .. }) in of_support().filter(|(_, node)| node.is_own) {
                let [w, along_x, along_y] = [0, 1, 2].map(|which| sums[which][*node]);
                rows.push((support, [point.x, point.y], [w, along_y, -along_x]));
            }
        }
        Ok(rows)
    }

    /// Returns the entries at the held nodes of forces on all deflections and slopes, to which
    /// `add` adds.
    fn rows(&self, add: impl FnOnce(&mut [f64])) -> Vec<f64> {
        let mut force = vec![0.0; PER_NODE * self.count];
        add(&mut force);
        self.nodes.iter().flat_map(|held| &force[PER_NODE * held.node..][..PER_NODE]).copied().collect()
    }

    /// Returns the forces of the plate on its elastic edges.
    fn on_edges(&self, u: DofVector) -> Vec<f64> {
        let mut sums = vec![0.0; PER_NODE * self.nodes.len()];
        for (support, cells) in &self.edges {
            let force =
                self.rows(|force| cells.iter().for_each(|cell| cell.add_beds(&u.in_cell(cell), force)));
            let rows = sums.as_chunks_mut::<PER_NODE>().0.iter_mut().zip(force.as_chunks().0);
            let rows = self.nodes.iter().zip(rows).filter(|(held, _)| held.support == *support);
            rows.for_each(|(_, (sum, row))| *sum = *row);
        }
        sums
    }

    /// Adds the elastic forces K u of plate and effects.
    fn add_elastic(&self, u: DofVector, force: &mut [f64]) {
        for cell in &self.cells {
            let values = u.in_cell(cell);
            cell.whole.add(&cell.whole.local.bending.product(&values), force);
            cell.add_beds(&values, force);
        }
        for spring in &self.springs {
            push(spring, u.under(spring), force);
        }
    }

    /// Adds the product of the consistent mass with an acceleration.
    fn add_consistent(&self, a: DofVector, force: &mut [f64]) {
        for cell in &self.cells {
            cell.whole.add_product(&cell.whole.local.mass, &a.in_cell(cell), force);
        }
        for mass in &self.masses {
            push(mass, a.under(mass), force);
        }
    }

    /// Adds the product of the singular mass with an acceleration, given the acceleration of each
    /// cell and of each mass by its index.
    fn add_singular(
        &self,
        of_cell: impl Fn(&HeldCell) -> f64,
        of_mass: impl Fn(usize, &PointTerm) -> f64,
        force: &mut [f64],
    ) {
        for cell in &self.cells {
            let a = of_cell(cell);
            let product: Vec<f64> = cell.whole.local.row.iter().map(|b| b * a).collect();
            cell.whole.add(&product, force);
        }
        for (k, mass) in self.masses.iter().enumerate() {
            push(mass, of_mass(k, mass), force);
        }
    }

    /// Returns the forces and momenta of a support motion.
    fn lift(&self, lift: &Lift, is_singular: bool) -> HeldLift {
        let u = DofVector::Whole(&lift.shape);
        let mean = |cell: &HeldCell| dot(&cell.whole.local.row, &u.in_cell(cell)) / cell.whole.local.weight;
        HeldLift {
            force: self.rows(|force| self.add_elastic(u, force)),
            momentum: self.rows(|force| match is_singular {
                true => self.add_singular(mean, |_, mass| u.under(mass), force),
                false => self.add_consistent(u, force),
            }),
            on_edges: self.on_edges(u),
            is_damped: !lift.is_rigid,
        }
    }
}

/// Adds the force of a spring, a dashpot or a mass, its amount times a value.
fn push(term: &PointTerm, value: f64, force: &mut [f64]) {
    term.spot.of_shape.push(term.amount * value, force);
}

impl HeldCell {
    /// Adds the forces of the contributions of effects.
    fn add_beds(&self, values: &[f64], force: &mut [f64]) {
        self.beds.iter().for_each(|matrix| self.whole.add_product(matrix, values, force));
    }
}

impl DofVector<'_> {
    /// Returns the values at the dofs of a cell.
    fn in_cell(&self, cell: &HeldCell) -> Vec<f64> {
        match self {
            DofVector::Free(u) => cell.free.values(u),
            DofVector::Whole(shape) => cell.whole.values(shape),
        }
    }

    /// Returns the deflection at a spring or a mass.
    fn under(&self, term: &PointTerm) -> f64 {
        match self {
            DofVector::Free(u) => term.spot.free.deflection(u),
            DofVector::Whole(shape) => term.spot.of_shape.deflection(shape),
        }
    }
}

/// Returns the nodes of this process at named supports, and the centroid of each of them.
/// Collective.
fn nodes<P: Partition>(ground: &BuildContext<P>) -> Result<(Vec<HeldNode>, Vec<Point>)> {
    let BuildContext { scene, mesh, holds, partition, .. } = *ground;
    let comm = partition.comm();
    let mut is_taken = vec![false; mesh.nodes.len()];
    let (mut nodes, mut centroids) = (Vec::new(), Vec::new());
    let named = scene.supports.iter().zip(supports(scene, mesh, comm)?);
    for (support, (place, kind)) in named.filter(|(support, _)| support.name.is_some()) {
        let mut flags = vec![0.0; mesh.nodes.len()];
        let mut sums = [0.0; 3];
        let mut weigh = |weight: f64, p: Point| {
            sums.iter_mut().zip([weight, weight * p.x, weight * p.y]).for_each(|(sum, term)| *sum += term);
        };
        match place {
            Place::Edges(edges) => {
                for [a, b] in edges {
                    (flags[a], flags[b]) = (1.0, 1.0);
                    let ends = [mesh.nodes[a], mesh.nodes[b]];
                    weigh((ends[1] - ends[0]).norm(), nalgebra::center(&ends[0], &ends[1]));
                }
            }
            Place::Nodes(nodes) => {
                for node in nodes {
                    flags[node] = 1.0;
                    weigh(1.0, mesh.nodes[node]);
                }
            }
        }
        let flags = partition.sum_at_nodes(&flags)?;
        for (node, _) in flags.iter().enumerate().filter(|(_, flag)| **flag > 0.0) {
            let bears = kind != SupportKind::Elastic && !std::mem::replace(&mut is_taken[node], true);
            if bears || support.elastic.is_some() {
                nodes.push(HeldNode {
                    node,
                    point: mesh.nodes[node],
                    hold: bears.then_some(holds[node]),
                    support: centroids.len(),
                    is_own: partition.owns_node(node),
                });
            }
        }
        let [weight, x, y] = comm.all_reduce_sum(sums);
        centroids.push(Point::new(x, y) / weight);
    }
    Ok((nodes, centroids))
}
