//! Residual of the state in the dofs of the structure, and its correction.

use super::reduction::ReducedModel;
use super::spectrum::factored;
use super::{Exact, Shape};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{add, scale, sum};
use crate::scheme::System;
use crate::vi::{Answer, BoundStatus, Problem};
use faer::Mat;
use faer::linalg::solvers::Solve;

/// KKT residual, dimensionless, above which a shape is corrected. Residuals of up to 1e-9 occur at
/// held nodes where a motion that the velocities hardly resolve is soft, such as two cells that can
/// almost turn without changing their means.
const MAX_SHAPE_RESIDUAL: f64 = 1e-11;

impl<E: Engine> Exact<'_, E> {
    /// Checks the residual of the present shape, and corrects the shape where rounding is too large
    /// and the correction helps.
    pub(super) fn check_shape(&mut self) -> Result<()> {
        self.record.report.kkt = self.residual()?;
        if self.record.report.kkt > MAX_SHAPE_RESIDUAL {
            let (shape, reaction) = self.corrected()?;
            let kept = (
                std::mem::replace(&mut self.shape, shape.into()),
                std::mem::replace(&mut self.record.reaction, reaction),
            );
            let corrected = self.residual()?;
            if corrected < self.record.report.kkt {
                self.record.report.kkt = corrected;
            } else {
                (self.shape, self.record.reaction) = kept;
            }
        }
        Ok(())
    }

    /// Returns the inertial force `$-B^T (v' + D v)$` of the present shape, in N, one entry
    /// per dof.
    fn inertia(&self) -> Result<Vec<f64>> {
        let System { engine, mass, .. } = self.system;
        let mut b = vec![0.0; engine.dofs()];
        engine.project_transpose(mass, &self.shape().acceleration, &mut b)?;
        scale(-1.0, &mut b);
        Ok(b)
    }

    /// Returns the relative residual of `$K U = F - B^T (v' + D v) + G^T r$` and of the
    /// bounds.
    fn residual(&mut self) -> Result<f64> {
        let System { engine, stiffness, bounds, load, .. } = self.system;
        let inertia = self.inertia()?;
        let mut displacement = self.shape().displacement.clone();
        let length = self.system.length(bounds, bounds.magnitude(), &displacement);
        let load = load.as_deref().unwrap_or(&[]);
        let problem = Problem { matrix: &stiffness.into(), rhs: load, bounds, length };
        let answer = Answer { x: &mut displacement, reaction: &mut self.record.reaction };
        self.check.residual(engine, &problem, &[&inertia], &answer)
    }

    /// Returns the present shape and reactions corrected by a solution of the saddle-point problem
    /// for their residual, with the active bounds held.
    fn corrected(&self) -> Result<(Shape, Vec<f64>)> {
        let ReducedModel { candidates, bounds, lift_at, flexibility, compliance, basis, .. } =
            &self.reduction;
        let modes = &self.motion.modes;
        let Shape { displacement, velocity, acceleration } = self.shape();
        let column = |values: &[f64]| Mat::from_fn(values.len(), 1, |i, _| values[i]);
        let mut force = vec![0.0; displacement.len()];
        self.system.force(displacement, &mut force)?;
        add(&self.inertia()?, &mut force);
        self.system.bounds.add_transposed(&self.record.reaction, &mut force);
        let position = &modes.spectrum.vectors * modes.coordinates(&self.state).get(.., ..1)
            - basis.of(self.system, &column(displacement))?;
        let (mut du, mut da) = self.saddle.solve(column(&force), position)?;
        // The compliance of the active bounds is as definite as when the modes were found.
        let active: Vec<usize> = (0..bounds.len()).filter(|&i| modes.sides[i] != BoundStatus::Free).collect();
        let held = factored(compliance, &active)?
            .solve(&Mat::from_fn(active.len(), 1, |k, _| -du[(bounds.dofs[active[k]], 0)]));
        let mut forces = Mat::zeros(bounds.len(), 1);
        for (k, &i) in active.iter().enumerate() {
            forces[(i, 0)] = held[(k, 0)];
        }
        du += flexibility * &forces;
        da += lift_at.transpose() * &forces;
        for &i in &active {
            du[(bounds.dofs[i], 0)] = 0.0;
        }
        let shape = Shape {
            displacement: sum(displacement, du.col_as_slice(0)),
            velocity: velocity.clone(),
            acceleration: sum(acceleration, &basis.velocity(da.col_as_slice(0))),
        };
        let mut reaction = self.record.reaction.clone();
        for (i, &bound) in candidates.iter().enumerate() {
            reaction[bound] += forces[(i, 0)];
        }
        Ok((shape, reaction))
    }
}
