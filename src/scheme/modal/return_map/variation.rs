//! Derivative of the state by the one at the start of a period, on its way.

use super::super::rotation::Rotation;
use crate::linalg::vectors::axpy;
use faer::Mat;

/// Derivative, modal coordinates first. Kicks on both sides of an instant are applied together.
pub(super) struct Variation {
    derivative: Mat<f64>,
    /// Stiffness of contact and stretching at the instant, in 1/s^2; `None` without.
    stiffness: Option<Mat<f64>>,
    /// Duration of the kick that is due there, in s.
    due: f64,
}

impl Variation {
    /// Creates the derivative at the start, for a number of modes and a stiffness there.
    pub fn new(modes: usize, stiffness: Option<Mat<f64>>) -> Variation {
        Variation { derivative: Mat::identity(2 * modes, 2 * modes), stiffness, due: 0.0 }
    }

    /// Multiplies by the derivative of a part of a step to an instant with a stiffness.
    pub fn advance(&mut self, rotation: &Rotation, squares: &[f64], stiffness: Option<Mat<f64>>) {
        let half = 0.5 * rotation.seconds;
        self.due += half;
        self.kick();
        let count = squares.len();
        let none = vec![0.0; count];
        let (mut dq, mut dv) = (none.clone(), none.clone());
        for j in 0..2 * count {
            let (q, v) = self.derivative.col_as_slice_mut(j).split_at_mut(count);
            rotation.increments(squares, &none, [q, v], [&mut dq, &mut dv]);
            axpy(1.0, &dq, q);
            axpy(1.0, &dv, v);
        }
        (self.stiffness, self.due) = (stiffness, half);
    }

    /// Changes the stiffness at the instant for what comes after it.
    pub fn change(&mut self, stiffness: Option<Mat<f64>>) {
        self.kick();
        self.stiffness = stiffness;
    }

    /// Returns the derivative.
    pub fn end(mut self) -> Mat<f64> {
        self.kick();
        self.derivative
    }

    fn kick(&mut self) {
        if let Some(stiffness) = &self.stiffness {
            let count = stiffness.nrows();
            let change = stiffness * self.derivative.as_ref().subrows(0, count);
            for j in 0..change.ncols() {
                axpy(-self.due, change.col_as_slice(j), &mut self.derivative.col_as_slice_mut(j)[count..]);
            }
        }
        self.due = 0.0;
    }
}
