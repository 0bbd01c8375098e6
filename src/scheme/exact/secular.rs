//! Eigenvalues and eigenvectors of a symmetric matrix changed by a product of rank one.
//!
//! In the eigenvectors V of a matrix with the eigenvalues `$d_i$` the changed matrix is
//! `$V (D \pm z z^T) V^T$`. Its eigenvalues are the roots of the secular equation (written here for
//! the sum; the difference is its negative with reversed order)
//!
//! ```math
//! f(\lambda) = 1 + \sum_i \frac{z_i^2}{d_i - \lambda} = 0,
//! ```
//!
//! one between each two successive `$d_i$` and one above the last. Each is sought as the offset
//! from the nearer `$d_i$`, so that all differences `$d_i - \lambda_j$` are accurate relative to
//! their own size, by iterations that interpolate f with its two neighbouring poles (R.-C. Li,
//! *Solving secular equations stably and efficiently*, LAPACK Working Note 89, 1993).
//!
//! Eigenvectors `$z_i / (d_i - \lambda_j)$` of roots with rounding errors are not orthogonal. The
//! roots found are the exact ones of another vector,
//!
//! ```math
//! \hat z_i^2 = \frac{\prod_j (\lambda_j - d_i)}{\prod_{j \ne i} (d_j - d_i)},
//! ```
//!
//! which differs from z by rounding alone, and whose eigenvectors are orthogonal to rounding (Gu
//! and Eisenstat, SIAM J. Matrix Anal. Appl. 15, 1994). Components `$z_i$` that vanish leave their
//! eigenpair unchanged, and of two equal `$d_i$` a rotation makes one component vanish.

use crate::kernels::lanes::{dot, sum};
use crate::kernels::wide::widest;
use faer::Mat;
use pulp::Arch;

/// Component of z, relative to the largest one, that counts as 0. Its square is far below the
/// rounding of any eigenvalue that a graded matrix can have.
const NEGLIGIBLE: f64 = f64::EPSILON * f64::EPSILON;

/// Difference of two eigenvalues, relative to the larger one, below which they count as equal.
const EQUAL: f64 = 8.0 * f64::EPSILON;

/// Largest number of iterations per root; bisection alone would end within them.
const MAX_ITERATIONS: usize = 120;

/// Share of a bracket between 0 and its other end that takes the place of the geometric mean.
const NEAR_POLE: f64 = 1.0 / 64.0;

/// Sign of a product of rank one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Change {
    Add,
    Subtract,
}

/// Returns the eigenvalues, ascending, and the eigenvectors of a matrix with given ones, changed
/// by plus or minus the product `$(V z) (V z)^T$`. The new eigenvectors are as orthogonal as the
/// given ones, to rounding. The cost is that of one product of square matrices.
pub(crate) fn changed_eigen(
    values: &[f64],
    vectors: &Mat<f64>,
    z: Vec<f64>,
    change: Change,
) -> (Vec<f64>, Mat<f64>) {
    let sign = if change == Change::Add { 1.0 } else { -1.0 };
    let poles = values.iter().map(|d| sign * d).collect();
    let mut deflated = Deflated { poles, z, vectors: vectors.clone() };
    let kept = deflated.kept(change);
    let poles: Vec<f64> = kept.iter().map(|&i| deflated.poles[i]).collect();
    let z: Vec<f64> = kept.iter().map(|&i| deflated.z[i]).collect();
    let (roots, turn) = widest(
        Arch::new(),
        #[inline(always)]
        || eigen(&poles, &z),
    );
    let size = vectors.nrows();
    let mut turned = Mat::zeros(size, kept.len());
    for (k, &i) in kept.iter().enumerate() {
        turned.col_as_slice_mut(k).copy_from_slice(deflated.vectors.col_as_slice(i));
    }
    let turned = turned * turn;
    for (k, &i) in kept.iter().enumerate() {
        deflated.poles[i] = roots[k];
        deflated.vectors.col_as_slice_mut(i).copy_from_slice(turned.col_as_slice(k));
    }
    let value = |i: usize| sign * deflated.poles[i];
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&i, &j| value(i).total_cmp(&value(j)));
    let mut sorted = Mat::zeros(size, order.len());
    for (k, &i) in order.iter().enumerate() {
        sorted.col_as_slice_mut(k).copy_from_slice(deflated.vectors.col_as_slice(i));
    }
    (order.into_iter().map(value).collect(), sorted)
}

/// Eigenpairs before the change, rotated so that z vanishes where it can.
struct Deflated {
    /// Eigenvalues, with the sign of the change.
    poles: Vec<f64>,
    z: Vec<f64>,
    vectors: Mat<f64>,
}

impl Deflated {
    /// Returns the eigenpairs that the change affects, by ascending pole, once no two poles of them
    /// are equal.
    fn kept(&mut self, change: Change) -> Vec<usize> {
        let largest = self.z.iter().fold(0.0_f64, |largest, z| largest.max(z.abs()));
        let count = self.z.len();
        let ascending = (0..count).map(|k| if change == Change::Add { k } else { count - 1 - k });
        let mut kept: Vec<usize> = Vec::with_capacity(count);
        for i in ascending.filter(|_| largest > 0.0) {
            if self.z[i].abs() <= NEGLIGIBLE * largest {
                continue;
            }
            if let Some(&last) = kept.last()
                && self.poles[i] - self.poles[last] <= EQUAL * self.poles[i].abs().max(self.poles[last].abs())
            {
                self.rotate(last, i);
                kept.pop();
            }
            kept.push(i);
        }
        kept
    }

    /// Rotates two eigenvectors with equal poles so that the first component of z vanishes.
    fn rotate(&mut self, i: usize, j: usize) {
        let length = self.z[i].hypot(self.z[j]);
        let (s, c) = (self.z[i] / length, self.z[j] / length);
        (self.z[i], self.z[j]) = (0.0, length);
        let (a, b) = (self.poles[i], self.poles[j]);
        (self.poles[i], self.poles[j]) = (a + (b - a) * (s * s), b - (b - a) * (s * s));
        let (x, y) = self.vectors.two_cols_mut(i, j);
        for (x, y) in x.iter_mut().zip(y.iter_mut()) {
            (*x, *y) = (c * *x - s * *y, c * *y + s * *x);
        }
    }
}

/// Returns the roots and the orthogonal eigenvectors of D + z z^T with distinct poles, ascending,
/// and no vanishing component of z.
#[inline(always)]
fn eigen(poles: &[f64], z: &[f64]) -> (Vec<f64>, Mat<f64>) {
    let size = poles.len();
    let squares: Vec<f64> = z.iter().map(|z| z * z).collect();
    let mut roots = vec![0.0; size];
    // Differences of poles and roots, d_i - lambda_j.
    let mut columns = Mat::zeros(size, size);
    let mut gaps = vec![0.0; size];
    // The ratios of the product for each component are at most 1 in pairs.
    let mut weights = vec![1.0; size];
    for j in 0..size {
        let column = columns.col_as_slice_mut(j);
        let (origin, offset) = root(poles, &squares, &mut gaps, j);
        roots[j] = poles[origin] + offset;
        column.iter_mut().zip(&gaps).for_each(|(x, gap)| *x = gap - offset);
        let pole = poles[j];
        weights[j] *= -column[j];
        for range in [0..j, j + 1..size] {
            let factors = weights[range.clone()].iter_mut().zip(&column[range.clone()]).zip(&poles[range]);
            for ((w, x), d) in factors {
                *w *= x / (d - pole);
            }
        }
    }
    for (w, z) in weights.iter_mut().zip(z) {
        *w = w.abs().sqrt().copysign(*z);
    }
    for j in 0..size {
        let column = columns.col_as_slice_mut(j);
        column.iter_mut().zip(&weights).for_each(|(x, w)| *x = w / *x);
        let scale = 1.0 / dot(column, column).sqrt();
        column.iter_mut().for_each(|x| *x *= scale);
    }
    (roots, columns)
}

/// Returns the nearer pole of a root and the root's offset from it, and sets `gaps` to the
/// differences of the poles to that one.
#[inline(always)]
fn root(poles: &[f64], squares: &[f64], gaps: &mut [f64], j: usize) -> (usize, f64) {
    let from = |origin: usize, gaps: &mut [f64]| {
        gaps.iter_mut().zip(poles).for_each(|(gap, d)| *gap = d - poles[origin]);
    };
    from(j, gaps);
    let is_last = j + 1 == poles.len();
    let mut upper = if is_last { squares.iter().sum() } else { gaps[j + 1] };
    let mut offset = 0.5 * upper;
    let mut sums = SecularSums::new(squares, gaps, j, offset);
    let (mut origin, mut lower) = (j, 0.0);
    if !is_last {
        // The root of the two neighbouring poles, with all others as they are in the middle.
        let half = offset;
        let others = sums.value + squares[j] / half - squares[j + 1] / half;
        if sums.value < 0.0 {
            origin = j + 1;
            (lower, upper) = (-half, 0.0);
            from(origin, gaps);
        } else {
            upper = half;
        }
        let (a, b) = (gaps[j], gaps[j + 1]);
        let first = others * (a + b) + squares[j] + squares[j + 1];
        offset = lower_root(others, first, squares[j] * b + squares[j + 1] * a);
        offset = inside(lower, upper, offset);
        sums = SecularSums::new(squares, gaps, j, offset);
    }
    for _ in 0..MAX_ITERATIONS {
        if sums.value.abs() <= f64::EPSILON * sums.magnitude {
            break;
        }
        if sums.value > 0.0 {
            upper = offset;
        } else {
            lower = offset;
        }
        let next = inside(lower, upper, offset + sums.step(gaps, j, offset));
        if next == offset || next <= lower || next >= upper {
            break;
        }
        offset = next;
        sums = SecularSums::new(squares, gaps, j, offset);
    }
    (origin, offset)
}

/// Returns a number if it is inside a bracket, and otherwise one between its ends, which have the
/// same sign or are 0.
#[inline(always)]
fn inside(lower: f64, upper: f64, wanted: f64) -> f64 {
    match wanted {
        _ if wanted > lower && wanted < upper => wanted,
        _ if lower == 0.0 => NEAR_POLE * upper,
        _ if upper == 0.0 => NEAR_POLE * lower,
        _ => (lower.abs().sqrt() * upper.abs().sqrt()).copysign(lower),
    }
}

/// Returns the root (b - sqrt(b^2 - 4 a c)) / 2 a of a x^2 - b x + c.
#[inline(always)]
fn lower_root(a: f64, b: f64, c: f64) -> f64 {
    let root = (b * b - 4.0 * a * c).abs().sqrt();
    if b > 0.0 { 2.0 * c / (b + root) } else { (b - root) / (2.0 * a) }
}

/// Value of f at an offset from a pole, with what the next step needs.
struct SecularSums {
    value: f64,
    /// Sum of the magnitudes of all terms.
    magnitude: f64,
    /// Slopes of the terms of poles below and above the root.
    slopes: [f64; 2],
}

impl SecularSums {
    #[inline(always)]
    fn new(squares: &[f64], gaps: &[f64], j: usize, offset: f64) -> SecularSums {
        let [below, slope_below] = terms(&squares[..=j], &gaps[..=j], offset);
        let [above, slope_above] = terms(&squares[j + 1..], &gaps[j + 1..], offset);
        SecularSums {
            value: 1.0 + below + above,
            magnitude: 1.0 - below + above,
            slopes: [slope_below, slope_above],
        }
    }

    /// Returns the step to the root of the function that has the neighbouring poles and the value
    /// and the slopes of f.
    #[inline(always)]
    fn step(&self, gaps: &[f64], j: usize, offset: f64) -> f64 {
        let [below, above] = self.slopes;
        let a = gaps[j] - offset;
        if j + 1 == gaps.len() {
            return a + a * a * below / (self.value - a * below);
        }
        let b = gaps[j + 1] - offset;
        let rest = self.value - a * below - b * above;
        lower_root(rest, (a + b) * self.value - a * b * (below + above), a * b * self.value)
    }
}

/// Returns the sums of z^2 / x and of z^2 / x^2 with x = gap - offset.
#[inline(always)]
fn terms(squares: &[f64], gaps: &[f64], offset: f64) -> [f64; 2] {
    let gaps = &gaps[..squares.len()];
    let term = |k: usize| squares[k] / (gaps[k] - offset);
    [sum(squares.len(), term), sum(squares.len(), |k| term(k) / (gaps[k] - offset))]
}

#[cfg(test)]
mod tests {
    use super::{Change, changed_eigen};
    use crate::linalg::eigen::symmetric_eigen;
    use crate::random::random_vector;
    use faer::Mat;

    /// Compares the eigenpairs of D plus or minus z z^T with those of the eigenvalue solver.
    fn agrees(name: &str, d: &[f64], z: &[f64]) {
        let size = d.len();
        let unit = Mat::<f64>::identity(size, size);
        for (change, sign) in [(Change::Add, 1.0), (Change::Subtract, -1.0)] {
            let diagonal =
                |values: &[f64]| Mat::from_fn(size, size, |i, j| if i == j { values[i] } else { 0.0 });
            let matrix = diagonal(d) + Mat::from_fn(size, size, |i, j| sign * z[i] * z[j]);
            let (values, vectors) = changed_eigen(d, &unit, z.to_vec(), change);
            let (expected, _) = symmetric_eigen(matrix.as_ref()).unwrap();
            let norm = expected.iter().fold(0.0_f64, |norm, value| norm.max(value.abs()));
            let skew = (vectors.transpose() * &vectors - &unit).norm_max();
            let residual = (&matrix * &vectors - &vectors * diagonal(&values)).norm_max() / norm;
            let apart = expected.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / norm;
            assert!(values.is_sorted(), "{name}, {size}, {change:?}");
            assert!(skew <= 1e-14, "{name}, {size}, {change:?}: {skew:e} from orthogonal");
            assert!(residual <= 2e-15, "{name}, {size}, {change:?}: residual {residual:e}");
            // The eigenvalue solver has errors of some roundings per row.
            assert!(apart <= 1e-15 * (size as f64 + 9.0), "{name}, {size}, {change:?}: {apart:e} apart");
        }
    }

    #[test]
    fn changes_of_rank_one_agree_with_the_eigenvalue_solver() {
        for size in [1, 2, 3, 20, 70] {
            let z = random_vector(size, 3);
            let scaled = |scale: &dyn Fn(usize) -> f64| -> Vec<f64> {
                z.iter().enumerate().map(|(k, z)| z * scale(k)).collect()
            };
            let along = |value: &dyn Fn(usize) -> f64| -> Vec<f64> { (0..size).map(value).collect() };
            let mut random = random_vector(size, 1);
            random.sort_by(f64::total_cmp);
            agrees("random", &random, &z);
            let graded = along(&|k| 1e3 * (1.0 + k as f64).powi(4));
            agrees("graded", &graded, &scaled(&|k| 1e2 * (1.0 + k as f64)));
            agrees("large change", &graded, &scaled(&|_| 1e6));
            agrees("equal", &along(&|k| (k / 4) as f64), &z);
            agrees("nearly equal", &along(&|k| (k / 4) as f64 + 1e-14 * (k % 4) as f64), &z);
            agrees(
                "small parts",
                &along(&|k| 1.0 + k as f64),
                &scaled(&|k| 0.1_f64.powi((7 * k % 40) as i32)),
            );
            agrees("no change", &graded, &vec![0.0; size]);
        }
    }

    /// The sum of the lowest eigenvalues of a graded matrix is not lost in the rounding of the
    /// largest: the roots of two poles are those of a quadratic equation.
    #[test]
    fn small_eigenvalues_are_accurate_relative_to_their_own_size() {
        let (d, z) = ([1e-12, 1.0], [1e-6, 1.0]);
        let (values, _) = changed_eigen(&d, &Mat::identity(2, 2), z.to_vec(), Change::Add);
        // The product of the roots is d_0 d_1 + z_0^2 d_1 + z_1^2 d_0 = 3e-12, their sum 2 + 2e-12.
        let sum = 2.0 + 2e-12;
        let large = 0.5 * (sum + f64::sqrt(sum * sum - 12e-12));
        assert!((values[0] / (3e-12 / large) - 1.0).abs() <= 1e-15, "{:e}", values[0]);
        assert!((values[1] / large - 1.0).abs() <= 1e-15, "{}", values[1]);
    }
}
