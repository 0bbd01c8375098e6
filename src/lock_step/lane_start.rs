//! Start of one of several systems in lock step, in their common coordinates.

use super::lane_levels::MasslessPart;
use super::shared_modes::SharedModes;
use crate::kernels::Lanes;
use crate::linalg::vectors::{axpy, dot};
use crate::scheme::Start;
use crate::scheme::modal::data::{ModalData, ModalLoads};
use crate::vi::ComplianceSolver;

/// Start of one lane.
pub(super) struct LaneStart {
    /// Modal coordinates and velocities.
    pub q: Vec<f64>,
    pub v: Vec<f64>,
    /// Initial velocities of the bounded dofs, in m/s.
    pub bounded_velocity: Vec<f64>,
    /// Reactions in which a massless part that follows the loads starts, in N.
    pub reaction: Vec<f64>,
    /// Massless part e of the start, in m, one entry per dof; empty unless it swings.
    pub massless: Vec<f64>,
    /// Initial velocity, in m/s, one entry per dof.
    pub velocity: Vec<f64>,
    /// Work of the constant load up to the start, less the energies there that count as work.
    pub work: f64,
}

impl LaneStart {
    /// Computes the start of one lane, given the factors of the loads there.
    pub fn new(
        shared: &SharedModes,
        lane: usize,
        start: &Start,
        loads: &ModalLoads,
        factors: &[Lanes],
    ) -> LaneStart {
        let SharedModes { system, modes, massless, model, rows, .. } = shared;
        let Start { displacement, velocity } = start;
        let (mut q, mut v) = (vec![0.0; modes.count()], vec![0.0; modes.count()]);
        modes.project(displacement, &mut q);
        modes.project(velocity, &mut v);
        let bounds = &system.bounds;
        let of_modes =
            |values: &[f64]| (0..rows.ncols()).map(|i| dot(rows.col_as_slice(i), values)).collect();
        let mut lane_start = LaneStart {
            bounded_velocity: match massless {
                MasslessPart::Swings => bounds.dofs.iter().map(|&dof| velocity[dof]).collect(),
                _ => of_modes(&v),
            },
            reaction: vec![0.0; model.candidates.len()],
            massless: Vec::new(),
            velocity: velocity.clone(),
            work: 0.0,
            q,
            v,
        };
        let data = ModalData { factors: own_factors(loads, factors, lane), ..ModalData::default() };
        match massless {
            MasslessPart::None => {}
            MasslessPart::Follows => {
                let limits = &loads.limits;
                let shift = loads.shift(&data);
                let free: Vec<f64> = of_modes(&lane_start.q);
                let free: Vec<f64> = free.iter().zip(&shift).map(|(q, shift)| q + shift).collect();
                let mut x = free.clone();
                let problem = model.problem(&free, &limits.lower, &limits.upper);
                ComplianceSolver::new(free.len()).solve(problem, &mut x, &mut lane_start.reaction);
                let every: Vec<usize> = (0..free.len()).collect();
                lane_start.work = loads.work(&data, &lane_start.q, &every, &lane_start.reaction)
                    - loads.elastic(&data)
                    - dot(&lane_start.reaction, &shift)
                    - dot(loads.constant_force(), &lane_start.q);
            }
            MasslessPart::Swings => {
                lane_start.massless = displacement.clone();
                for (k, q) in lane_start.q.iter().enumerate() {
                    axpy(-q, modes.shapes.col_as_slice(k), &mut lane_start.massless);
                }
                let mut response = vec![0.0; displacement.len()];
                loads.add_response(&data, &mut response);
                axpy(-1.0, &response, &mut lane_start.massless);
            }
        }
        lane_start
    }
}

/// Returns the factors of the loads of one lane.
pub(super) fn own_factors(loads: &ModalLoads, factors: &[Lanes], lane: usize) -> Vec<f64> {
    factors[..loads.count()].iter().map(|factors| factors.0[lane]).collect()
}
