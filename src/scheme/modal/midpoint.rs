//! Midpoint rule for the modal mass (paper, equation 6).
//!
//! With the unknown `$x = q^{n+1/2} - q^n$`, a step is
//!
//! ```math
//! \Bigl( \frac{4}{\Delta t^2} + \Omega^2 + \frac{2}{\Delta t} D \Bigr) x
//!    = \frac{2}{\Delta t} \dot q^n + h - \Omega^2 q^n + A^T r, \qquad
//!    q^{n+1} = q^n + 2 x, \quad \dot q^{n+1} = \frac{4}{\Delta t} x - \dot q^n ,
//! ```
//!
//! with the mean h of the modal force over the step and the reactions r that keep the deflections
//! `$A q^{n+1/2} + G W + R r$` of the midpoint within the mean bounds. The massless rest of the
//! reported displacement is in equilibrium with the modes and admissible, as with
//! [`Massless::Equilibrium`](crate::scheme::Massless).

use super::ModalScheme;
use super::data::ModalData;
use super::state::kick;
use crate::error::Result;
use crate::kernels::lanes::dot;
use crate::linalg::Engine;
use std::rc::Rc;

impl<E: Engine> ModalScheme<'_, E> {
    /// Makes a step of the midpoint rule to an instant, in s.
    pub(super) fn midpoint_step(&mut self, end: f64) -> Result<()> {
        let dt = self.record.dt;
        if !self.now.is_settled {
            self.now.settle_free(&self.rows);
        }
        std::mem::swap(&mut self.now, &mut self.before);
        let gain = loop {
            let next = self.data_at(end)?;
            if let Some(next) = &next {
                self.follow_supports(next, dt);
            }
            let gain = self.solve_midpoint(next.as_ref());
            self.note_implicit();
            self.settle(dt);
            self.span = dt;
            if !self.comes_late(true)? {
                break gain;
            }
        };
        // Nodes may have joined since the step was solved.
        let data = self.now.data.clone();
        let obstacles = if self.system.drive.varies() { self.obstacle_work(&data) } else { 0.0 };
        self.balance.work += gain + obstacles;
        self.presses = self.mean.iter().any(|r| *r != 0.0);
        self.keep_data(end - dt, dt, 1.0);
        self.note_approaches(end - dt);
        Ok(())
    }

    /// Solves the step from the state before, and sets the present position and velocity. Returns
    /// the energy received from the loads, in J.
    fn solve_midpoint(&mut self, next: Option<&Rc<ModalData>>) -> f64 {
        let dt = self.record.dt;
        let ModalScheme { before, now, modes, rows, model, implicit, mean, .. } = self;
        let middle = next.map(|next| ModalData::between(&before.data, next, 0.5));
        let middle = middle.as_ref().unwrap_or(&before.data);
        let mut pull = middle.force.clone();
        for (k, pull) in pull.iter_mut().enumerate() {
            *pull += 2.0 / dt * before.v[k] - modes.squares[k] * before.q[k];
            now.q[k] = before.q[k] + implicit.inverse[k] * *pull;
        }
        let deflection = |i: usize| middle.near.shift[i] + dot(rows.col_as_slice(i), &now.q);
        let free: Vec<f64> = (0..rows.ncols()).map(deflection).collect();
        implicit.solve(1.0, model, free, &middle.near);
        kick(rows, &implicit.reaction, 1.0, &mut pull);
        let mut received = 0.0;
        for (k, pull) in pull.iter().enumerate() {
            let x = implicit.inverse[k] * pull;
            now.q[k] = before.q[k] + 2.0 * x;
            now.v[k] = 4.0 / dt * x - before.v[k];
            received += middle.force[k] * 2.0 * x;
        }
        now.frame_rates.clone_from(&before.frame_rates);
        now.data = next.unwrap_or(&before.data).clone();
        mean.clone_from(&implicit.reaction);
        received
    }
}
