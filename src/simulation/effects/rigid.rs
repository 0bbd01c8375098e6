//! Rigid motions of the plate, and of each disconnected part of its mesh, that supports and effects
//! restrain.

use super::contributions::Restraint;
use super::ground::BuildContext;
use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::{NodeConstraint, Rigid};
use crate::error::{Error, Result};
use crate::mesh::{Point, Unions};
use crate::partition::Partition;
use crate::scheme::RigidVelocities;
use nalgebra::Vector3;
use std::collections::BTreeSet;

impl<P: Partition> BuildContext<'_, P> {
    /// Returns node, position and constraints of all restraints of this process, first by supports,
    /// then by effects.
    fn restraints(&self) -> impl Iterator<Item = (usize, Point, NodeConstraint)> {
        let held = self.holds.iter().enumerate().filter(|(_, hold)| hold.is_any());
        let held = held.filter(|(node, _)| self.partition.owns_node(*node));
        let held = held.map(|(node, hold)| (node, self.mesh.nodes[node], *hold));
        let of_effects = self.terms.restraints.iter();
        held.chain(of_effects.map(|Restraint { node, point, hold }| (*node, *point, *hold)))
    }

    /// Returns the rigid motions that nothing restrains, in words. Collective.
    pub(super) fn mechanism(&self) -> Option<&'static str> {
        self.rigid(&[]).mechanism()
    }

    /// Returns the rigid motions that supports, effects and some fixed points restrain. Collective.
    pub(super) fn rigid(&self, at_rest: &[Point]) -> Rigid {
        let [right, top, left, bottom] = self.farthest();
        let centre = Point::new(0.5 * (right - left), 0.5 * (top - bottom));
        let mut rigid = Rigid::new(centre, 0.5 * (right + left).hypot(top + bottom));
        self.restraints().for_each(|(_, point, hold)| rigid.hold(point, &hold));
        at_rest.iter().for_each(|&point| rigid.hold_deflection(point));
        let constraints = self.comm().all_reduce_sum_slice(rigid.constraints());
        rigid.set_constraints(&constraints);
        rigid
    }

    /// Returns the velocities of rigid motions with the singular mass. Collective.
    pub(super) fn rigid_velocities(&self) -> RigidVelocities {
        let rigid = self.rigid(&[]);
        let (centre, size) = rigid.frame();
        let masses = self.terms.masses().map(|mass| mass.point);
        let points: Vec<Point> = assembly::centres_of_mass(self.mesh, &self.cells).chain(masses).collect();
        let velocities = |motions: &[Vector3<f64>]| {
            let rate =
                |motion: &Vector3<f64>, point: &Point| motion.x + motion.yz().dot(&(point - centre)) / size;
            motions.iter().map(|motion| points.iter().map(|point| rate(motion, point)).collect()).collect()
        };
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        RigidVelocities { all: velocities(&axes), free: velocities(&rigid.free()) }
    }

    /// Returns an error where nothing restrains a rigid motion and the singular mass gives it no
    /// inertia either: its means over all cells vanish, as for a single row of cells rotating about
    /// its centre line. Collective.
    pub(super) fn refuse_weightless(&self) -> Result<()> {
        let fixed = self.terms.masses.iter().map(|mass| mass.point);
        let centres = assembly::centres_of_mass(self.mesh, &self.cells);
        match self.rigid(&fixed.chain(centres).collect::<Vec<_>>()).mechanism() {
            None => Ok(()),
            Some(motion) => Err(Error::Singular(format!(
                "a rigid motion has neither stiffness nor inertia: {motion}, with zero mean velocity in every cell; \
                 take more rows of cells, hold the plate, or set time.mass = \"consistent\""
            ))),
        }
    }

    /// Returns an error where the mesh has several parts and one of them is not held by itself.
    /// Collective.
    pub(super) fn require_held_parts(&self) -> Result<()> {
        if self.scene.file.as_ref().is_none_or(|file| file.parts == 1) {
            return Ok(());
        }
        let (part_of, count) = parts(self)?;
        let nodes = || self.mesh.nodes.iter().zip(&part_of);
        let sums = |add: &dyn Fn(&Point, usize) -> [f64; 3]| {
            let mut sums = vec![[0.0; 3]; count];
            for (node, &part) in nodes() {
                sums[part].iter_mut().zip(add(node, part)).for_each(|(sum, value)| *sum += value);
            }
            self.comm().all_reduce_sum_slice(sums.as_flattened()).as_chunks().0.to_vec()
        };
        let places: Vec<[f64; 3]> = sums(&|node, _| [1.0, node.x, node.y]);
        let centres: Vec<Point> = places.iter().map(|[count, x, y]| Point::new(*x, *y) / *count).collect();
        let sizes: Vec<[f64; 3]> = sums(&|node, part| [1.0, (node - centres[part]).norm_squared(), 0.0]);
        let frames = centres.iter().zip(&sizes);
        let mut rigid: Vec<Rigid> =
            frames.map(|(centre, [count, size, _])| Rigid::new(*centre, (size / count).sqrt())).collect();
        self.restraints().for_each(|(node, point, hold)| rigid[part_of[node]].hold(point, &hold));
        let seen: Vec<f64> = rigid.iter().flat_map(|rigid| rigid.constraints().to_vec()).collect();
        let seen = self.comm().all_reduce_sum_slice(&seen);
        for ((rigid, seen), centre) in rigid.iter_mut().zip(seen.chunks_exact(9)).zip(&centres) {
            rigid.set_constraints(seen);
            if let Some(motion) = rigid.mechanism() {
                return Err(Error::Singular(format!(
                    "the part of the mesh around ({}, {}) is not held by itself: {motion}; where mesh.parts is more than 1, each \
                     part needs supports, springs or a foundation of its own",
                    centre.x, centre.y
                )));
            }
        }
        Ok(())
    }
}

/// Returns the part of each node of this process, and the number of parts over all. Collective.
fn parts<P: Partition>(ground: &BuildContext<P>) -> Result<(Vec<usize>, usize)> {
    let (of_node, count) = ground.mesh.part_of_nodes();
    let counts = ground.comm().all_gather_one(count);
    let first: usize = counts[..ground.comm().rank()].iter().sum();
    let number = |node: usize| first + of_node[node];
    // The part numbers that the owner of a node and this process give it belong to one part.
    let called = |node: usize| if ground.partition.owns_node(node) { (number(node) + 1) as f64 } else { 0.0 };
    let owners = ground.partition.sum_at_nodes(&(0..of_node.len()).map(called).collect::<Vec<_>>())?;
    let pairs: BTreeSet<[usize; 2]> =
        owners.iter().enumerate().map(|(node, owner)| [number(node), *owner as usize - 1]).collect();
    let pairs: Vec<[usize; 2]> = pairs.into_iter().collect();
    let mut unions = Unions::new(counts.iter().sum());
    for [one, other] in ground.comm().all_gather(&pairs) {
        unions.unite(one, other);
    }
    let (part_of, count) = unions.sets();
    Ok(((0..of_node.len()).map(|node| part_of[number(node)]).collect(), count))
}
