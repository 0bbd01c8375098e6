//! Motion of the nodes in a frame at rest, beside supports that move.

use super::effects::{BuildContext, Lift};
use crate::dof_map::DofMap;
use crate::error::Result;
use crate::linalg::vectors::axpy;
use crate::mesh::Point;
use crate::partition::Partition;

/// Deflections and slopes at all nodes of this rank's cells, three per node, in a frame at rest.
pub(super) struct NodalMotion {
    space: DofMap,
    lifts: Vec<Lift>,
}

impl NodalMotion {
    /// Creates the motion on supports with some lifts.
    pub fn new<P: Partition>(ground: &BuildContext<P>, lifts: &[Lift]) -> NodalMotion {
        NodalMotion { space: ground.space.clone(), lifts: lifts.to_vec() }
    }

    /// Returns the values for displacements over the dofs of this rank's cells, in the frame of the
    /// supports.
    pub fn relative(&self, u: &[f64]) -> Vec<f64> {
        self.space.shape(u)
    }

    /// Returns the values for displacements over the dofs of this rank's cells at an instant (s).
    pub fn at(&self, u: &[f64], time: f64) -> Result<Vec<f64>> {
        let mut shape = self.relative(u);
        self.lifts(time)?.into_iter().for_each(|(height, lift)| axpy(height, lift, &mut shape));
        Ok(shape)
    }

    /// Returns the share of each support motion in all deflections and slopes.
    pub fn shapes(&self) -> Vec<&[f64]> {
        self.lifts.iter().map(|lift| &*lift.shape).collect()
    }

    /// Returns the height (m) of each support motion at an instant (s), and its share in all
    /// deflections and slopes.
    pub fn lifts(&self, time: f64) -> Result<Vec<(f64, &[f64])>> {
        let height = |lift: &Lift| lift.motion.at(Point::origin(), time);
        self.lifts.iter().map(|lift| Ok((height(lift)?, &*lift.shape))).collect()
    }

    /// Adds the share of support velocities (m/s) to rates in the frame of the supports.
    pub fn carry(&self, support_rates: &[f64], rates: &mut [f64]) {
        self.lifts.iter().zip(support_rates).for_each(|(lift, rate)| axpy(*rate, &lift.shape, rates));
    }
}
