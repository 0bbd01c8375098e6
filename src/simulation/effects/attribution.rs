//! Attribution of the reactions at bounds to the obstacles that exert them.
//!
//! A reaction upwards comes from the nearest obstacle below the node, a reaction downwards from the
//! nearest above it. Which obstacle is nearest changes in time only where several are opposite to
//! one node and some of them move; it is then determined at the instant of the reaction. Among
//! obstacles at equal height the first in the scene counts. Only its own stop bounds the tip of a
//! compliant stop.

use super::ground::BuildContext;
use super::heights::{Opposite, opposites};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::partition::Partition;
use crate::scene::Side;
use crate::simulation::DeflectionDof;

/// Obstacles behind the bounds of this process.
#[derive(Clone)]
pub(in crate::simulation) struct Attribution {
    /// Index of the nearest obstacle below and above, one entry per bound; `None` where there is
    /// none. The ball of a gap counts on after the obstacles, on both sides.
    nearest: Vec<[Option<usize>; 2]>,
    /// All obstacles with the bounds that they affect, where the nearest changes in time on any
    /// process; empty otherwise.
    contested: Vec<(usize, Opposite)>,
}

impl Attribution {
    /// Determines the obstacles at the first instant, if there is anything to touch. Collective.
    pub fn if_any<P: Partition>(
        ground: &BuildContext<P>,
        opposite: &[Vec<usize>],
        bounded: &[DeflectionDof],
    ) -> Result<Option<Attribution>> {
        if !ground.scene.has_contact() {
            return Ok(None);
        }
        let contested: Vec<_> = opposites(ground.scene, opposite, bounded).enumerate().collect();
        let mut counts = vec![[0; 2]; bounded.len()];
        let mut moves = vec![[false; 2]; bounded.len()];
        for (_, obstacle) in &contested {
            for &bound in &obstacle.bounds {
                counts[bound][side(obstacle.side)] += 1;
                moves[bound][side(obstacle.side)] |= obstacle.height.changes();
            }
        }
        let counts = counts.as_flattened().iter().zip(moves.as_flattened());
        let is_contested = counts.into_iter().any(|(count, moves)| *count > 1 && *moves);
        let is_contested = ground.comm().all_reduce_any(is_contested);
        let nodes = ground.mesh.nodes.len();
        let ball = |site: &DeflectionDof| Some(ground.scene.obstacles.len() + site.node.checked_sub(nodes)?);
        let nearest = bounded.iter().map(|site| [ball(site); 2]).collect();
        let mut attribution = Attribution { nearest, contested };
        ground.comm().all_ok(attribution.find(0.0))?;
        if !is_contested {
            attribution.contested.clear();
        }
        Ok(Some(attribution))
    }

    /// Determines the nearest obstacles at an instant (s). Collective.
    ///
    /// # Errors
    /// Returns the errors of the heights.
    pub fn set(&mut self, time: f64, comm: &impl Communicator) -> Result<()> {
        if self.contested.is_empty() {
            return Ok(());
        }
        comm.all_ok(self.find(time))
    }

    fn find(&mut self, time: f64) -> Result<()> {
        let mut best = vec![[f64::NEG_INFINITY, f64::INFINITY]; self.nearest.len()];
        for (number, obstacle) in &self.contested {
            let mut heights = vec![0.0; obstacle.points.len()];
            obstacle.height.values(&obstacle.points, time, &mut heights)?;
            for (&bound, height) in obstacle.bounds.iter().zip(heights) {
                let side = side(obstacle.side);
                let is_nearer = match obstacle.side {
                    Side::Below => height > best[bound][side],
                    Side::Above => height < best[bound][side],
                };
                if is_nearer || best[bound][side].is_infinite() {
                    (best[bound][side], self.nearest[bound][side]) = (height, Some(*number));
                }
            }
        }
        Ok(())
    }

    /// Returns the index of the obstacle or, after all obstacles, of the ball that exerts a
    /// reaction (N, or an impulse in N s) at a bound.
    pub fn obstacle(&self, bound: usize, reaction: f64) -> Option<usize> {
        self.nearest[bound][usize::from(reaction < 0.0)]
    }
}

/// Returns the position of a side in the pairs of this file.
fn side(side: Side) -> usize {
    usize::from(side == Side::Above)
}
