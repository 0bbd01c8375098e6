//! Decoupled equations of modes that damping couples.
//!
//! The equations `$\ddot q + D \dot q + W^2 q = 0$` with a diagonal W and a full symmetric D have
//! eigenvalues `$\lambda$` and eigenvectors x with `$(\lambda^2 + \lambda D + W^2)\, x = 0$`.
//! Eigenvalues are taken in pairs `$\lambda, \mu$`, either conjugate or both real. The two motions
//! `$x e^{\lambda t}$` and `$y e^{\mu t}$` of a pair are those of one decoupled equation,
//!
//! ```math
//! \ddot p + c\,\dot p + w^2 p = 0, \qquad c = -(\lambda + \mu), \quad w^2 = \lambda \mu,
//! ```
//! ```math
//! q = S p + T \dot p, \qquad S = \frac{\lambda y - \mu x}{\lambda - \mu}, \quad T = \frac{x - y}{\lambda - \mu},
//! ```
//!
//! with real S and T, one column per pair (Garvey, Friswell and Prells, *Co-ordinate
//! transformations for second order systems, part I*, J. Sound Vib. 258, 2002; Ma, Morzfeld and
//! Imam, *The decoupling of damped linear systems in free or forced vibration*, J. Sound Vib. 329,
//! 2010). Light damping leaves S near the identity and T near 0. Near critical damping, where x and
//! y become parallel, S and T have limits, but the eigenvectors no longer have their digits.
//!
//! The eigenvalues are those of the first-order equations of (W q, q'), in which the energy is the
//! square of the norm. Its matrix is skew but for the damping, so that its eigenvectors are nearly
//! orthogonal where damping is light, and the error of each eigenvalue is the rounding of the
//! highest frequency.

use crate::error::{Error, Result};
use crate::linalg::eigen::general_eigen;
use crate::linalg::vectors::dot;
use faer::{Mat, MatRef};

/// Largest amount by which (q, q') may miss its equations, or its way to (p, p') and back, relative
/// to its energy.
const MAX_DEFECT: f64 = 1e-11;

/// Decoupled equations of damped modes; see the [module page](self).
#[derive(Debug)]
pub(crate) struct Decoupling {
    /// Angular frequencies w, in rad/s, ascending.
    pub frequencies: Vec<f64>,
    /// Decay rates c, in 1/s.
    pub decays: Vec<f64>,
    /// Matrices S and T, the latter in s.
    pub of_place: Mat<f64>,
    pub of_rate: Mat<f64>,
    /// Angular frequencies W of the coupled equations, in rad/s.
    coupled: Vec<f64>,
    /// Matrix that takes (w p, p') to (W q, q'), and its inverse.
    forward: Mat<f64>,
    inverse: Mat<f64>,
}

impl Decoupling {
    /// Decouples the equations of modes with these angular frequencies W (rad/s, positive) and the
    /// damping matrix D (1/s).
    ///
    /// # Errors
    /// Returns [`Error::Singular`] where the eigenvalue solver does not converge, and where a mode
    /// is damped so nearly critically that the decoupled equations miss the motion.
    pub fn new(coupled: Vec<f64>, damping: MatRef<f64>) -> Result<Decoupling> {
        let size = coupled.len();
        let matrix =
            Mat::from_fn(2 * size, 2 * size, |i, j| match (i.checked_sub(size), j.checked_sub(size)) {
                (None, Some(j)) if i == j => coupled[i],
                (Some(i), None) if i == j => -coupled[i],
                (Some(i), Some(j)) => -damping[(i, j)],
                _ => 0.0,
            });
        let (values, vectors) = general_eigen(matrix.as_ref())?;
        let mut pairs = pairs(&values, &vectors, &coupled);
        pairs.sort_by(|a, b| a.square.total_cmp(&b.square));
        let column = |vector: fn(&Pair) -> &[f64]| Mat::from_fn(size, size, |i, k| vector(&pairs[k])[i]);
        let (of_place, of_rate) = (column(|pair| &pair.of_place), column(|pair| &pair.of_rate));
        let frequencies: Vec<f64> = pairs.iter().map(|pair| pair.square.sqrt()).collect();
        let decays: Vec<f64> = pairs.iter().map(|pair| pair.decay).collect();
        let forward = Mat::from_fn(2 * size, 2 * size, |i, j| {
            let (row, k) = (i % size, j % size);
            let (w, s, t) = (frequencies[k], of_place[(row, k)], of_rate[(row, k)]);
            match (i < size, j < size) {
                (true, true) => coupled[row] * s / w,
                (true, false) => coupled[row] * t,
                (false, true) => -w * t,
                (false, false) => s - decays[k] * t,
            }
        });
        let inverse = faer::linalg::solvers::DenseSolveCore::inverse(&forward.partial_piv_lu());
        let decoupling = Decoupling { frequencies, decays, of_place, of_rate, coupled, forward, inverse };
        match decoupling.defect(&matrix) {
            defect if defect <= MAX_DEFECT => Ok(decoupling),
            _ => Err(Error::Singular(
                "time.scheme = \"exact\": damping is so nearly critical for a mode in contact that its motion is lost \
                 in rounding; change the damping a little, or set time.scheme = \"conserving\""
                    .into(),
            )),
        }
    }

    /// Returns how far the decoupled equations miss those of `matrix`, and the way there and back
    /// misses the start, both relative to the energy.
    fn defect(&self, matrix: &Mat<f64>) -> f64 {
        let size = self.decays.len();
        let decoupled =
            Mat::from_fn(2 * size, 2 * size, |i, j| match (i.checked_sub(size), j.checked_sub(size)) {
                (None, Some(j)) if i == j => self.frequencies[i],
                (Some(i), None) if i == j => -self.frequencies[i],
                (Some(i), Some(j)) if i == j => -self.decays[i],
                _ => 0.0,
            });
        let largest = matrix.norm_max();
        let missed = (matrix * &self.forward - &self.forward * decoupled) * &self.inverse;
        let back = &self.forward * &self.inverse - Mat::<f64>::identity(2 * size, 2 * size);
        (missed.norm_l2() / largest).max(back.norm_l2())
    }

    /// Returns q and q' (columns) of p and p' (columns).
    pub fn coupled(&self, decoupled: MatRef<f64>) -> Mat<f64> {
        let energy = scaled(&self.frequencies, decoupled);
        unscaled(&self.coupled, &(&self.forward * energy))
    }

    /// Returns p and p' (columns) of q and q' (columns).
    pub fn decoupled(&self, coupled: MatRef<f64>) -> Mat<f64> {
        let wanted = scaled(&self.coupled, coupled);
        let mut solution = &self.inverse * &wanted;
        // A correction leaves only the rounding of the product with the matrix itself.
        solution += &self.inverse * (wanted - &self.forward * &solution);
        unscaled(&self.frequencies, &solution)
    }

    /// Returns the memory of the arrays, in bytes.
    pub fn bytes(&self) -> usize {
        10 * self.decays.len() * self.decays.len() * size_of::<f64>()
    }
}

/// Returns the places times their frequencies, above the rates.
fn scaled(frequencies: &[f64], state: MatRef<f64>) -> Mat<f64> {
    let size = frequencies.len();
    Mat::from_fn(2 * size, 1, |i, _| match i.checked_sub(size) {
        None => frequencies[i] * state[(i, 0)],
        Some(k) => state[(k, 1)],
    })
}

/// Returns the places and the rates in columns.
fn unscaled(frequencies: &[f64], energy: &Mat<f64>) -> Mat<f64> {
    let size = frequencies.len();
    Mat::from_fn(size, 2, |k, j| if j == 0 { energy[(k, 0)] / frequencies[k] } else { energy[(size + k, 0)] })
}

/// Decoupled equation of a pair of eigenvalues, with its columns of S and T.
struct Pair {
    square: f64,
    decay: f64,
    of_place: Vec<f64>,
    of_rate: Vec<f64>,
}

/// Pairs the eigenvalues, given with their eigenvectors of (W q, q').
fn pairs(values: &[[f64; 2]], vectors: &Mat<f64>, coupled: &[f64]) -> Vec<Pair> {
    let size = coupled.len();
    let place = |j: usize| -> Vec<f64> {
        coupled.iter().zip(&vectors.col_as_slice(j)[..size]).map(|(w, x)| x / w).collect()
    };
    let oscillating = (0..values.len()).filter(|&j| values[j][1] > 0.0);
    let mut pairs: Vec<Pair> = oscillating.map(|j| conjugate(values[j], place(j), place(j + 1))).collect();
    // The slower half of the real eigenvalues meets the faster one, so that no pair is close.
    let mut real: Vec<usize> = (0..values.len()).filter(|&j| values[j][1] == 0.0).collect();
    real.sort_by(|&i, &j| values[j][0].total_cmp(&values[i][0]));
    let (slow, fast) = real.split_at(real.len() / 2);
    let both = slow.iter().zip(fast);
    pairs.extend(both.map(|(&i, &j)| creeping([values[i][0], values[j][0]], place(i), place(j))));
    pairs
}

/// Returns the equation of a conjugate pair, of the eigenvector a + ib for the eigenvalue with the
/// positive imaginary part.
fn conjugate([real, imaginary]: [f64; 2], a: Vec<f64>, b: Vec<f64>) -> Pair {
    // The phase for which a and b are orthogonal and a is the longer one; its length is 1.
    let angle = 0.5 * (2.0 * dot(&a, &b)).atan2(dot(&a, &a) - dot(&b, &b));
    let (sin, cos) = angle.sin_cos();
    let along = |a: &f64, b: &f64| cos * a + sin * b;
    let length = a.iter().zip(&b).map(|(a, b)| along(a, b).powi(2)).sum::<f64>().sqrt();
    let of_rate: Vec<f64> =
        a.iter().zip(&b).map(|(a, b)| (cos * b - sin * a) / (length * imaginary)).collect();
    let of_place = a.iter().zip(&b).zip(&of_rate);
    Pair {
        square: real * real + imaginary * imaginary,
        decay: -2.0 * real,
        of_place: of_place.map(|((a, b), t)| along(a, b) / length - real * t).collect(),
        of_rate,
    }
}

/// Returns the equation of two real eigenvalues with their eigenvectors.
fn creeping([lambda, mu]: [f64; 2], x: Vec<f64>, y: Vec<f64>) -> Pair {
    // Eigenvectors of length 1 that point the same way.
    let (of_x, of_y) = (1.0 / dot(&x, &x).sqrt(), dot(&x, &y).signum() / dot(&y, &y).sqrt());
    let both = || x.iter().zip(&y).map(|(x, y)| (of_x * x, of_y * y));
    Pair {
        square: lambda * mu,
        decay: -(lambda + mu),
        of_place: both().map(|(x, y)| (lambda * y - mu * x) / (lambda - mu)).collect(),
        of_rate: both().map(|(x, y)| (x - y) / (lambda - mu)).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::golden_vector;

    /// Returns W with the entries 1, 2, 3, ... and D = 0.1 W + strength * (a full matrix).
    fn problem(size: usize, strength: f64) -> (Vec<f64>, Mat<f64>) {
        let w: Vec<f64> = (1..=size).map(|k| k as f64).collect();
        let entries = golden_vector(size * size);
        let root = Mat::from_fn(size, size, |i, j| entries[size * i + j]);
        let full = &root * root.transpose();
        let diagonal = |i, j| if i == j { 0.1 * w[i] } else { 0.0 };
        let damping = Mat::from_fn(size, size, |i, j| strength * full[(i, j)] + diagonal(i, j));
        (w, damping)
    }

    #[test]
    fn decoupled_equations_are_those_of_the_modes() {
        for strength in [0.0, 1e-3, 0.1, 1.0, 10.0, 1e3] {
            let (w, damping) = problem(12, strength);
            let decoupling = Decoupling::new(w.clone(), damping.as_ref()).unwrap();
            let start = golden_vector(24);
            let p = Mat::from_fn(12, 2, |k, j| start[12 * j + k]);
            let q = decoupling.coupled(p.as_ref());
            assert!((decoupling.decoupled(q.as_ref()) - &p).norm_max() < 1e-10, "{strength}");
            // Derivatives of p by the decoupled equations give those of q by the coupled ones.
            let next = |a: MatRef<f64>, b: MatRef<f64>| {
                Mat::from_fn(12, 1, |k, _| {
                    -decoupling.frequencies[k].powi(2) * a[(k, 0)] - decoupling.decays[k] * b[(k, 0)]
                })
            };
            let second = next(p.get(.., ..1), p.get(.., 1..));
            let third = next(p.get(.., 1..), second.as_ref());
            let place = &decoupling.of_place * p.get(.., ..1) + &decoupling.of_rate * p.get(.., 1..);
            let rate = &decoupling.of_place * p.get(.., 1..) + &decoupling.of_rate * &second;
            let acceleration = &decoupling.of_place * &second + &decoupling.of_rate * third;
            let wanted = Mat::from_fn(12, 1, |k, _| -w[k] * w[k] * q[(k, 0)]) - &damping * q.get(.., 1..);
            for (computed, wanted) in
                [(&place, q.get(.., ..1)), (&rate, q.get(.., 1..)), (&acceleration, wanted.as_ref())]
            {
                let apart = (computed - wanted).norm_max() / wanted.norm_max();
                assert!(apart < 1e-10, "{strength}: {apart:e}");
            }
        }
    }

    #[test]
    fn modes_that_nothing_couples_keep_their_equations() {
        let (w, damping) = problem(8, 0.0);
        let decoupling = Decoupling::new(w.clone(), damping.as_ref()).unwrap();
        for (k, w) in w.iter().enumerate() {
            assert!((decoupling.frequencies[k] / w - 1.0).abs() < 1e-13);
            assert!((decoupling.decays[k] / (0.1 * w) - 1.0).abs() < 1e-12);
            assert!(decoupling.of_rate.col(k).norm_max() < 1e-13);
        }
    }
}
