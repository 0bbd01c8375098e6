//! Weighted sums of forms, written like formulas.

use super::Form;
use std::ops::{Add, Mul};

/// Weighted sum of forms `$A = \sum_i c_i A_i$`, such as the matrix of a step.
///
/// Terms keep the order in which they are added; the weights of equal forms add up.
///
/// ```
/// use rebond::linalg::{CellClass, ElementMatrix, Engine, Native};
///
/// let engine = Native::new(1);
/// let form = |entry: f64| {
///     let (dofs, matrix) = ([Some(0)].into(), [entry].into());
///     let class = CellClass::Plate(0);
///     engine.form(vec![ElementMatrix { dofs, matrix, bending: None, class }])
/// };
/// let (m, k) = (&form(2.0), &form(50.0));
/// let d = m * 3.0 + k * 0.1;
/// let dt = 0.5;
/// let matrix = m * (1.0 / (dt * dt)) + k + d * (0.5 / dt);
/// assert_eq!(matrix.terms().len(), 2);
/// assert_eq!(engine.diagonal(&matrix)?, [2.0 * (4.0 + 3.0) + 50.0 * (1.0 + 0.1)]);
/// # Ok::<(), rebond::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct LinearCombination<'a> {
    terms: Vec<(f64, &'a Form)>,
}

impl<'a> LinearCombination<'a> {
    /// Returns the weights and forms.
    pub fn terms(&self) -> &[(f64, &'a Form)] {
        &self.terms
    }

    /// Returns whether a mass of modes is among the forms.
    pub(crate) fn has_modes(&self) -> bool {
        self.terms.iter().any(|(_, form)| matches!(form, Form::Modal { .. }))
    }
}

impl<'a> From<&'a Form> for LinearCombination<'a> {
    fn from(form: &'a Form) -> LinearCombination<'a> {
        form * 1.0
    }
}

impl<'a> Mul<f64> for &'a Form {
    type Output = LinearCombination<'a>;

    fn mul(self, factor: f64) -> LinearCombination<'a> {
        LinearCombination { terms: vec![(factor, self)] }
    }
}

impl<'a> Mul<f64> for LinearCombination<'a> {
    type Output = LinearCombination<'a>;

    fn mul(mut self, factor: f64) -> LinearCombination<'a> {
        for (weight, _) in &mut self.terms {
            *weight *= factor;
        }
        self
    }
}

impl<'a, T: Into<LinearCombination<'a>>> Add<T> for LinearCombination<'a> {
    type Output = LinearCombination<'a>;

    fn add(mut self, other: T) -> LinearCombination<'a> {
        for (weight, form) in other.into().terms {
            match self.terms.iter_mut().find(|(_, term)| std::ptr::eq(*term, form)) {
                Some((sum, _)) => *sum += weight,
                None => self.terms.push((weight, form)),
            }
        }
        self
    }
}

impl<'a, T: Into<LinearCombination<'a>>> Add<T> for &'a Form {
    type Output = LinearCombination<'a>;

    fn add(self, other: T) -> LinearCombination<'a> {
        LinearCombination::from(self) + other
    }
}
