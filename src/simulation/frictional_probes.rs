//! Friction at probes: moment and slip of the node at the place of the probe.

use super::DeflectionDof;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::geometry;
use crate::linalg::Engine;
use crate::mesh::Point;
use crate::scene::{ProbeQuantity, Scene};
use crate::scheme::{ContactFriction, NodalFriction, Solution, System};

/// Distance within which a node is at the place of a probe, relative to the distance from the
/// origin.
const AT: f64 = 1e-9;

/// Probes of friction.
#[derive(Debug, Default)]
pub(super) struct FrictionalProbes {
    /// Number of each probe, its quantity, and the bound of its node on the process that has it.
    probes: Vec<(usize, ProbeQuantity, Option<usize>)>,
}

impl FrictionalProbes {
    /// Finds the nodes at a scene's probes of friction. Collective.
    ///
    /// # Errors
    /// Returns [`Error::Scene`] where no obstacle with friction faces a node there.
    pub fn new<E: Engine>(
        scene: &Scene,
        system: &System<E>,
        sites: &[DeflectionDof],
    ) -> Result<FrictionalProbes> {
        let comm = system.engine.comm();
        let mut probes = Vec::new();
        for (number, probe) in scene.output.probes.iter().enumerate() {
            if !probe.quantity.is_of_friction() {
                continue;
            }
            let nodes = system.drive.friction.as_ref().map_or(&[][..], |ContactFriction { nodes, .. }| nodes);
            let place = Point::from(probe.at);
            let distance = |bound: usize| (Point::from(sites[bound].at) - place).norm();
            let nearest = nodes.iter().map(|node| (distance(node.bound), node.bound));
            let nearest = nearest.min_by(|one, other| one.0.total_cmp(&other.0));
            let ranks = comm.all_gather_one(
                nearest.map_or((f64::INFINITY, [0.0; 2]), |(distance, bound)| (distance, sites[bound].at)),
            );
            let first = (0..ranks.len()).min_by(|&one, &other| ranks[one].0.total_cmp(&ranks[other].0));
            let first = first.unwrap_or_default();
            let (distance, nearest_place) = ranks[first];
            if distance > AT * (1.0 + place.coords.norm()) {
                let expected = match distance {
                    d if d.is_infinite() => "expected an obstacle with friction".to_owned(),
                    _ => format!(
                        "expected the place of a node, the nearest of which is {}",
                        geometry::place(nearest_place)
                    ),
                };
                return Err(Error::Scene(format!(
                    "probe \"{}\": no obstacle with friction faces a node at {}; {expected}",
                    probe.name,
                    geometry::place(probe.at)
                )));
            }
            let bound = nearest.filter(|_| first == comm.rank()).map(|(_, bound)| bound);
            probes.push((number, probe.quantity, bound));
        }
        Ok(FrictionalProbes { probes })
    }

    /// Writes the values in the last step of a scheme, 0 of nodes that do not touch. Collective.
    pub fn read(&self, comm: &impl Communicator, scheme: &dyn Solution, values: &mut [f64]) {
        if self.probes.is_empty() {
            return;
        }
        let nodes = scheme.friction_at_nodes();
        let dt = scheme.record().dt;
        let value = |&(_, quantity, bound): &(usize, ProbeQuantity, Option<usize>)| {
            let node = nodes.iter().find(|node| Some(node.bound) == bound);
            node.map_or(0.0, |NodalFriction { moment, slip, .. }| match quantity {
                ProbeQuantity::FrictionMoment(axis) => moment[axis],
                ProbeQuantity::SlipVelocity(axis) => slip[axis] / dt,
                _ => 0.0,
            })
        };
        let values_of = comm.all_reduce_sum_slice(&self.probes.iter().map(value).collect::<Vec<f64>>());
        self.probes.iter().zip(values_of).for_each(|((probe, ..), value)| values[*probe] = value);
    }
}
