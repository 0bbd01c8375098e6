//! Exact motion of the modes without contact, over one step.
//!
//! Under a constant force h each mode `$\ddot q + c\,\dot q + w^2 q = h$` changes by
//!
//! ```math
//! \Delta q = a\,\dot q + b\,(h - w^2 q), \qquad \Delta \dot q = d\,\dot q + a\,(h - w^2 q)
//! ```
//!
//! with, in the functions s and v of [`motion`](crate::scheme::exact), a = s / w, b = v / w^2 and
//! d = -(v + c s / w). Increments keep the digits that a product with the cosine would lose, so
//! that many steps do not drift.

use crate::scheme::exact::responses::{phase, rigid_response};

/// Exact motion of all modes over one step; see the [module page](self).
#[derive(Debug)]
pub(super) struct Rotation {
    /// Length of the step, in s.
    pub seconds: f64,
    pub a: Vec<f64>,
    pub b: Vec<f64>,
    d: Vec<f64>,
}

impl Rotation {
    /// Prepares a step, for modes of given squared frequencies ((rad/s)^2) and decay rates (1/s).
    pub fn new(squares: &[f64], decays: &[f64], seconds: f64) -> Rotation {
        let zeros = || vec![0.0; squares.len()];
        let mut rotation = Rotation { seconds: f64::NAN, a: zeros(), b: zeros(), d: zeros() };
        rotation.set(squares, decays, seconds);
        rotation
    }

    /// Prepares a step of another length, in s.
    pub fn set(&mut self, squares: &[f64], decays: &[f64], seconds: f64) {
        self.seconds = seconds;
        for (k, (square, decay)) in squares.iter().zip(decays).enumerate() {
            [self.a[k], self.b[k], self.d[k]] = if *square == 0.0 {
                let (g, mean) = rigid_response(*decay, seconds);
                [g, 0.5 * g * mean, -decay * g]
            } else {
                let w = square.sqrt();
                let (s, v) = phase(w, *decay, seconds);
                [s / w, v / square, -(v + decay / w * s)]
            };
        }
    }

    /// Computes the increments of q and q' under a constant force h.
    #[inline(always)]
    pub fn increments(
        &self,
        squares: &[f64],
        force: &[f64],
        [q, rate]: [&[f64]; 2],
        [dq, drate]: [&mut [f64]; 2],
    ) {
        let Rotation { a, b, d, .. } = self;
        let size = squares.len();
        let (force, q, rate) = (&force[..size], &q[..size], &rate[..size]);
        let (a, b, d, dq, drate) = (&a[..size], &b[..size], &d[..size], &mut dq[..size], &mut drate[..size]);
        for k in 0..size {
            let pull = force[k] - squares[k] * q[k];
            dq[k] = a[k] * rate[k] + b[k] * pull;
            drate[k] = d[k] * rate[k] + a[k] * pull;
        }
    }
}
