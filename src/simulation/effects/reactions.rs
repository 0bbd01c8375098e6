//! Reactions of named supports: the rows of the balance of forces at the dofs that they hold.
//!
//! K and M are applied cell by cell to the cells at the held nodes, as the engines do over the free
//! dofs, with the fields of [`StepBalance`] and the loads of the same instants. The residual at a
//! held dof is the force or the moment of its support on the plate.
//!
//! A node that several named supports hold belongs to the first of them in the scene. The springs
//! of an elastic edge act on all of its nodes, and their force is that of the edge wherever another
//! support holds the node.

use super::attached::Attached;
use super::elastic_edges::springs_of;
use super::ground::BuildContext;
use super::held_loads::HeldLoads;
use super::loads::LocalLoads;
use super::lumps::LumpedMass;
use super::motion::Lift;
use crate::assembly::{self, CellArrays, Probe};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE, Place};
use crate::error::Result;
use crate::linalg::vectors::{axpy, dot};
use crate::linalg::{ElementMatrix, Engine, Form};
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::SupportKind;
use crate::scheme::{StepBalance, System};
use crate::simulation::regions::supports;
use std::collections::HashMap;
use std::rc::Rc;

/// Function that sums values at the nodes over all processes. Collective.
type NodeSum = dyn Fn(&[f64]) -> Result<Vec<f64>>;

/// Force, in N, and moments about x and y, in N m.
pub(in crate::simulation) type Wrench = [f64; 3];

/// Node of a named support.
struct HeldNode {
    node: usize,
    at: Point,
    /// Constraints that the support bears; `None` where another support bears them.
    hold: Option<NodeConstraint>,
    /// Index of the support among the named ones.
    support: usize,
    is_own: bool,
}

/// Cell at held nodes.
struct HeldCell {
    /// Index of the cell, which is that of its velocity with the singular mass.
    number: usize,
    arrays: CellArrays,
    /// Raw matrix of foundations and elastic edges on the cell, or of the edge of one support.
    bed: Option<Rc<[f64]>>,
    /// Position among the held nodes of each node of the cell.
    slots: Vec<Option<usize>>,
}

/// Spring or mass that acts on held dofs.
struct HeldLump {
    amount: f64,
    /// Deflection in terms of the free dofs.
    free: Probe,
    /// Index of the velocity with the singular mass.
    velocity: usize,
    /// Shares of the held dofs in the force.
    shares: Probe,
}

/// Forces of a support motion at the held dofs.
struct HeldLift {
    /// Forces of the shape at 1 m, and momenta at 1 m/s.
    force: Vec<f64>,
    momentum: Vec<f64>,
    /// Forces of elastic edges on the shape at 1 m.
    on_edges: Vec<f64>,
    /// Whether damping by the stiffness acts on the motion too: its shape bends the plate.
    is_damped: bool,
}

/// Reactions of the named supports of a scene, on this process's part of the mesh.
pub(in crate::simulation) struct Reactions {
    /// Centroid of each named support, in m.
    centroids: Vec<Point>,
    nodes: Vec<HeldNode>,
    cells: Vec<HeldCell>,
    /// Cells at the elastic edges of named supports.
    edges: Vec<HeldCell>,
    springs: Vec<HeldLump>,
    /// Masses and balls.
    masses: Vec<HeldLump>,
    /// Inertia of each mode of the modal mass at the held dofs; empty for other masses.
    modes: Vec<Vec<f64>>,
    lifts: Vec<HeldLift>,
    loads: HeldLoads,
    sum_at_nodes: Box<NodeSum>,
    /// Number of nodes of this process.
    count: usize,
}

impl Reactions {
    /// Prepares the reactions of the named supports; `None` where no support has a name.
    /// Collective.
    ///
    /// # Errors
    /// Returns the errors of the scene's loads and regions on the mesh.
    pub(super) fn new<E: Engine, P: Partition>(
        ground: &BuildContext<P>,
        system: &System<E>,
        attached: &Attached,
        lifts: &[Lift],
    ) -> Result<Option<Reactions>> {
        let BuildContext { scene, mesh, partition, .. } = *ground;
        if scene.supports.iter().all(|support| support.name.is_none()) {
            return Ok(None);
        }
        let (nodes, centroids) = nodes(ground)?;
        // The same plate with all dofs, held or not, three per node, then the gaps of balls.
        let space = DofMap::unsupported(mesh).with_extra(ground.gaps.len());
        let bare = |(of, cell): (&CellArrays, &crate::mesh::Cell)| CellArrays {
            dofs: space.dofs_of(cell.nodes()).collect(),
            factors: None,
            ..of.clone()
        };
        let cells: Vec<CellArrays> = ground.cells.iter().zip(&mesh.cells).map(bare).collect();
        let gaps = ground.gaps.iter().enumerate();
        let gaps: Vec<_> = gaps.map(|(ball, gap)| gap.map(|_| space.extra(ball))).collect();
        let whole = BuildContext { space: &space, cells: &cells, gaps: &gaps, stops: &[], ..*ground };
        let unheld = Attached::new(&whole)?;
        let loads = LocalLoads::new(&whole, &unheld)?;
        let slots = Slots::of_nodes(&nodes, mesh.nodes.len(), |node| node.hold.is_some());
        let by_partition = partition.clone();
        let mut reactions = Reactions {
            centroids,
            cells: slots.cells(ground, &unheld),
            edges: edges(ground, &whole, &nodes)?,
            springs: slots.lumps(attached.springs().iter(), 0),
            masses: slots.lumps(attached.masses().iter(), mesh.cells.len()),
            modes: Vec::new(),
            lifts: Vec::new(),
            loads: HeldLoads::new(loads, nodes.iter().map(|held| held.node).collect()),
            sum_at_nodes: Box::new(move |values| by_partition.sum_at_nodes(values)),
            count: mesh.nodes.len(),
            nodes,
        };
        if let Form::Modal { modes, .. } = &system.mass {
            let inertia =
                |k: usize| reactions.consistent(&system.engine.to_local(modes.shapes.col_as_slice(k))?);
            reactions.modes = (0..modes.count()).map(inertia).collect::<Result<_>>()?;
        }
        let is_singular = matches!(system.mass, Form::SingularMassCells(_));
        let lift = |lift: &Lift| reactions.lift(ground, attached, lift, is_singular);
        reactions.lifts = lifts.iter().map(lift).collect();
        Ok(Some(reactions))
    }

    /// Returns this process's part of the forces at its held nodes: for w in N, for the slopes in
    /// N m. Collective.
    ///
    /// # Errors
    /// Returns the errors of the engine and of the loads.
    pub fn at_nodes<E: Engine>(&self, system: &System<E>, balance: &StepBalance) -> Result<Vec<f64>> {
        let System { engine, mass, damping, .. } = system;
        let u = engine.to_local(&balance.displacement)?;
        let mut force = self.elastic(|cell| cell.values(&u));
        push(&self.springs, |spring| spring.free.deflection(&u), &mut force);
        match mass {
            Form::Cells(_) => {
                let inertia = self.consistent(&engine.to_local(&balance.acceleration)?)?;
                axpy(1.0, &inertia, &mut force);
            }
            Form::SingularMassCells(_) => {
                for cell in &self.cells {
                    let a = balance.acceleration[cell.number];
                    let product: Vec<f64> = cell.arrays.local.row.iter().map(|b| b * a).collect();
                    cell.add(&product, &mut force);
                }
                push(&self.masses, |mass| balance.acceleration[mass.velocity], &mut force);
            }
            Form::Modal { .. } => {
                let modes = self.modes.iter().zip(&balance.acceleration);
                modes.for_each(|(inertia, a)| axpy(*a, inertia, &mut force));
            }
        }
        for (k, lift) in self.lifts.iter().enumerate() {
            axpy(self.stretch(k, damping.stiffness, balance), &lift.force, &mut force);
            axpy(balance.support_accelerations[k], &lift.momentum, &mut force);
        }
        self.loads.subtract(&balance.loads, &mut force)?;
        for (node, force) in self.nodes.iter().zip(force.as_chunks_mut::<PER_NODE>().0) {
            *force = node.hold.as_ref().map_or([0.0; PER_NODE], |hold| DofMap::borne(hold, *force));
        }
        axpy(-1.0, &self.on_edges(|cell| cell.values(&u)), &mut force);
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

    /// Returns the forces of the plate on its elastic edges for given values of each cell.
    fn on_edges(&self, values: impl Fn(&HeldCell) -> Vec<f64>) -> Vec<f64> {
        let mut force = vec![0.0; PER_NODE * self.nodes.len()];
        for cell in &self.edges {
            cell.add_bed(&values(cell), &mut force);
        }
        force
    }

    /// Returns this process's part of force and moments about the centroid, for each named support.
    pub fn sums(&self, at_nodes: &[f64]) -> Vec<Wrench> {
        let mut sums = vec![Wrench::default(); self.centroids.len()];
        for (node, [w, along_x, along_y]) in self.nodes.iter().zip(at_nodes.as_chunks().0) {
            let arm = node.at - self.centroids[node.support];
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
            for (_, HeldNode { node, at, .. }) in of_support().filter(|(_, node)| node.is_own) {
                let [w, along_x, along_y] = [0, 1, 2].map(|which| sums[which][*node]);
                rows.push((support, [at.x, at.y], [w, along_y, -along_x]));
            }
        }
        Ok(rows)
    }

    /// Returns the elastic forces of plate and foundations for given values of each cell.
    fn elastic(&self, values: impl Fn(&HeldCell) -> Vec<f64>) -> Vec<f64> {
        let mut force = vec![0.0; PER_NODE * self.nodes.len()];
        for cell in &self.cells {
            let values = values(cell);
            cell.add(&cell.arrays.local.bending.product(&values), &mut force);
            cell.add_bed(&values, &mut force);
        }
        force
    }

    /// Returns the product of the consistent mass with an acceleration over the local dofs.
    fn consistent(&self, local: &[f64]) -> Result<Vec<f64>> {
        let mut force = vec![0.0; PER_NODE * self.nodes.len()];
        for cell in &self.cells {
            cell.add_product(&cell.arrays.local.mass, &cell.values(local), &mut force);
        }
        push(&self.masses, |mass| mass.free.deflection(local), &mut force);
        Ok(force)
    }

    /// Returns the forces and momenta of a support motion.
    fn lift<P: Partition>(
        &self,
        ground: &BuildContext<P>,
        attached: &Attached,
        lift: &Lift,
        is_singular: bool,
    ) -> HeldLift {
        let nodes = |cell: &HeldCell| ground.mesh.cells[cell.number].nodes().to_vec();
        let values = &|cell: &HeldCell| -> Vec<f64> {
            nodes(cell).iter().flat_map(|&node| &lift.shape[PER_NODE * node..][..PER_NODE]).copied().collect()
        };
        let (mut force, on_edges) = (self.elastic(values), self.on_edges(values));
        // Lumps in the order of the attachments.
        let at = |of: Option<&LumpedMass>| of.map_or(0.0, |of| of.spot.of_shape.deflection(&lift.shape));
        let mut springs = attached.springs().iter();
        push(&self.springs, |_| at(springs.next()), &mut force);
        let mut momentum = vec![0.0; force.len()];
        for cell in &self.cells {
            let local = &cell.arrays.local;
            let values = values(cell);
            if is_singular {
                let velocity = dot(&local.row, &values) / local.weight;
                let product: Vec<f64> = local.row.iter().map(|b| b * velocity).collect();
                cell.add(&product, &mut momentum);
            } else {
                cell.add_product(&local.mass, &values, &mut momentum);
            }
        }
        let mut masses = attached.masses().iter();
        push(&self.masses, |_| at(masses.next()), &mut momentum);
        HeldLift { force, momentum, on_edges, is_damped: !lift.is_rigid }
    }
}

/// Adds the forces of lumps at the held dofs, each its amount times a value.
fn push(lumps: &[HeldLump], mut value: impl FnMut(&HeldLump) -> f64, force: &mut [f64]) {
    for lump in lumps {
        let value = value(lump);
        lump.shares.push(lump.amount * value, force);
    }
}

impl HeldCell {
    /// Returns the values of the cell's dofs in a vector over the local dofs.
    fn values(&self, local: &[f64]) -> Vec<f64> {
        (0..self.arrays.dofs.len()).map(|i| self.arrays.value(i, local)).collect()
    }

    /// Adds the forces of foundations and elastic edges at the held nodes.
    fn add_bed(&self, values: &[f64], force: &mut [f64]) {
        if let Some(matrix) = &self.bed {
            self.add_product(matrix, values, force);
        }
    }

    /// Adds a vector over the cell's dofs at the held nodes.
    fn add(&self, of_cell: &[f64], force: &mut [f64]) {
        for (slot, values) in self.slots.iter().zip(of_cell.as_chunks::<PER_NODE>().0) {
            if let Some(slot) = slot {
                axpy(1.0, values, &mut force[PER_NODE * slot..][..PER_NODE]);
            }
        }
    }

    /// Adds the product of a symmetric matrix over the cell's dofs at the held nodes.
    fn add_product(&self, matrix: &[f64], values: &[f64], force: &mut [f64]) {
        let product: Vec<f64> = matrix.chunks_exact(values.len()).map(|row| dot(row, values)).collect();
        self.add(&product, force);
    }
}

/// Position of each node among the held ones.
struct Slots(Vec<Option<usize>>);

impl Slots {
    /// Numbers the held nodes that are `chosen`.
    fn of_nodes(nodes: &[HeldNode], count: usize, chosen: impl Fn(&HeldNode) -> bool) -> Slots {
        let mut slots = vec![None; count];
        let chosen = nodes.iter().enumerate().filter(|(_, held)| chosen(held));
        chosen.for_each(|(slot, held)| slots[held.node] = Some(slot));
        Slots(slots)
    }

    /// Returns a cell with the matrix of what it lies on.
    fn cell<P: Partition>(
        &self,
        ground: &BuildContext<P>,
        number: usize,
        bed: Option<Rc<[f64]>>,
    ) -> HeldCell {
        let nodes = ground.mesh.cells[number].nodes();
        let slots = nodes.iter().map(|&node| self.0[node]).collect();
        HeldCell { number, arrays: ground.cells[number].clone(), bed, slots }
    }

    /// Returns the cells at held nodes.
    fn cells<P: Partition>(&self, ground: &BuildContext<P>, unheld: &Attached) -> Vec<HeldCell> {
        let mut beds: HashMap<usize, Rc<[f64]>> = HashMap::new();
        for (number, matrix) in unheld.bed_matrices() {
            let sum = |known: &Rc<[f64]>| known.iter().zip(&*matrix).map(|(a, b)| a + b).collect();
            let sum = beds.get(&number).map_or_else(|| matrix.clone(), sum);
            beds.insert(number, sum);
        }
        let cells =
            (0..ground.mesh.cells.len()).map(|number| self.cell(ground, number, beds.get(&number).cloned()));
        cells.filter(|cell| cell.slots.iter().any(Option::is_some)).collect()
    }

    /// Returns all lumps with their shares at held dofs; `first` is the velocity of the first.
    fn lumps<'l>(&self, lumps: impl Iterator<Item = &'l LumpedMass>, first: usize) -> Vec<HeldLump> {
        let lump = |(k, LumpedMass { amount, spot, .. }): (usize, &'l LumpedMass)| {
            let held = spot.of_shape.weights().iter().filter_map(|(dof, weight)| {
                Some((PER_NODE * self.0[dof / PER_NODE]? + dof % PER_NODE, *weight))
            });
            let shares = held.fold(Probe::default(), |probe, (dof, weight)| probe.with(dof, weight));
            HeldLump { amount: *amount, free: spot.free.clone(), velocity: first + k, shares }
        };
        lumps.enumerate().map(lump).collect()
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
    for (of, (place, kind)) in named.filter(|(support, _)| support.name.is_some()) {
        let mut flags = vec![0.0; mesh.nodes.len()];
        let mut sums = [0.0; 3];
        let mut weigh = |weight: f64, at: Point| {
            sums.iter_mut().zip([weight, weight * at.x, weight * at.y]).for_each(|(sum, of)| *sum += of);
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
            if bears || of.elastic.is_some() {
                nodes.push(HeldNode {
                    node,
                    at: mesh.nodes[node],
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

/// Returns the cells at the elastic edges of named supports, with the springs of each. Collective.
fn edges<P: Partition>(
    ground: &BuildContext<P>,
    whole: &BuildContext<P>,
    nodes: &[HeldNode],
) -> Result<Vec<HeldCell>> {
    let BuildContext { scene, mesh, .. } = *ground;
    let places = supports(scene, mesh, ground.comm())?;
    let named = scene.supports.iter().zip(places).filter(|(support, _)| support.name.is_some());
    let mut cells = Vec::new();
    for (number, (support, (place, _))) in named.enumerate() {
        let sides = springs_of(ground, support, &place);
        let blocks = ground.comm().all_ok(assembly::edge_springs(mesh, whole.cells, sides))?;
        let slots = Slots::of_nodes(nodes, mesh.nodes.len(), |node| node.support == number);
        let cell = |(cell, block): (usize, ElementMatrix)| slots.cell(ground, cell, Some(block.matrix));
        cells.extend(blocks.into_iter().map(cell));
    }
    Ok(cells)
}
