//! Start of the Newmark scheme.
//!
//! The ghost value `$U^{-1} = U^1 - 2 \Delta t\, v_0$` makes the energy at t = 0 exact. `$U^1$`
//! follows from half a trapezoidal step:
//!
//! ```math
//! \Bigl(\frac{M}{\Delta t^2} + \beta K\Bigr)\, 2 (U^1 - U^0) = \frac{2}{\Delta t} M v_0 + F - K U^0 + G^T r .
//! ```
//!
//! The start is second order and depends on `$v_0$` only through the momentum `$M v_0$`. It gains
//! no energy however rough `$v_0$` is (a clamped plate thrown as a whole, a single node): for beta
//! = 1/2, no load, no contact, `$y = U^1 - U^0$` and `$A = M / \Delta t^2 + K / 2$`,
//!
//! ```math
//! H^{1/2} - \tfrac12 |U^0|_K^2 = \tfrac12 y \cdot A y + \tfrac12 y \cdot K U^0
//!    = \tfrac12 \Bigl|\frac{M v_0}{\Delta t}\Bigr|_{A^{-1}}^2 - \tfrac18 |K U^0|_{A^{-1}}^2 \le \tfrac12 |v_0|_M^2 .
//! ```
//!
//! The damping matrix D multiplies `$(U^1 - U^0) / \Delta t$`, which is part of the step matrix.

use super::{Levels, NewmarkParameters};
use crate::error::Result;
use crate::linalg::Engine;
use crate::linalg::vectors::{axpy, scale, subtract, waxpby};
use crate::obstacle::Bounds;
use crate::scheme::drive::ModalDamping;
use crate::scheme::quadratisation::RankOne;
use crate::scheme::step_driver::{Formulas, StepDriver};

/// First step, whose unknown is `$x = 2 (U^1 - U^0)$`.
pub(super) struct FirstStep<'l, 's, E: Engine> {
    pub levels: &'l mut Levels<'s, E>,
    /// Initial velocity `$v_0$`, in m/s, one entry per dof.
    pub v0: &'l [f64],
}

impl<E: Engine> Levels<'_, E> {
    /// Returns the elastic and kinetic energy at the start, in J, with the initial velocity `$v_0$`
    /// (m/s). Collective.
    pub fn energy_at_start(&self, v0: &[f64]) -> Result<f64> {
        let mut v = vec![0.0; self.system.engine.velocities(&self.system.mass)];
        let kinetic = self.system.kinetic_energy(v0, &mut v)?;
        Ok(kinetic + self.force.elastic_energy(self.system, &self.u_n, &mut vec![0.0; self.u_n.len()])?)
    }
}

impl<E: Engine> FirstStep<'_, '_, E> {
    /// Sets `$U^0 - U^{-1} = 2 \Delta t\, v_0 - x / 2$`, and replaces the unknown by that of all
    /// other steps, `$U^1 - 2 U^0 + U^{-1} = x / 2 - (U^0 - U^{-1})$`.
    pub fn update(self, driver: &mut StepDriver<E>) {
        let Levels { d_n, parameters, force, .. } = self.levels;
        waxpby(2.0 * parameters.step, self.v0, -0.5, &driver.x, d_n);
        force.start(driver.stiffness_product());
        scale(0.5, &mut driver.x);
        subtract(d_n, &mut driver.x);
    }
}

impl<E: Engine> Formulas<E> for FirstStep<'_, '_, E> {
    fn displacement(&self) -> &[f64] {
        &self.levels.u_n
    }

    fn limits(&self) -> &Bounds {
        self.levels.limits()
    }

    /// `$b = \frac{2}{\Delta t} M v_0 + F - K U^0 - g \sqrt{2 V}$`
    fn right_hand_side(&mut self, b: &mut [f64]) -> Result<()> {
        self.levels.force(b);
        let momentum = self.levels.system.momentum(self.v0)?;
        let dt = self.levels.parameters.step;
        axpy(2.0 / dt, &momentum, b);
        self.levels.stretching.iter().for_each(|stretching| stretching.subtract_force(stretching.root, b));
        Ok(())
    }

    fn modal_velocities(&self, modal: &ModalDamping) -> Result<Vec<f64>> {
        modal.of_rate(&self.levels.system.engine, self.v0)
    }

    /// `$d = v_0$`
    fn known(&self) -> &[f64] {
        self.v0
    }

    /// `$U^{0,e} = U^0 + \tfrac12\,x - \frac{2 e}{1 + e}\,\Delta t\,d$`
    fn bounded_configuration(&self) -> [f64; 2] {
        let NewmarkParameters { restitution: e, step: dt, .. } = self.levels.parameters;
        [0.5, -2.0 * e / (1.0 + e) * dt]
    }

    /// `$\tfrac12 (U^1 - U^{-1}) = \Delta t\,d$`
    fn displacement_of_forces(&self) -> [f64; 2] {
        [0.0, self.levels.parameters.step]
    }

    fn stretching(&self) -> Option<RankOne<'_>> {
        self.levels.stretching()
    }
}
