//! Elementary operations on vectors, with the names of BLAS and PETSc.
//!
//! Every function works entry by entry on slices of equal length and panics where the lengths
//! differ. Products are rounded before they are added, so that `axpy(-a, x, y)` has the bits of
//! `y -= a * x`.
//!
//! ```
//! use rebond::linalg::vectors::{axpy, dot, waxpy};
//!
//! let (x, mut y, mut w) = ([1.0, 2.0], [10.0, 20.0], [0.0; 2]);
//! axpy(0.5, &x, &mut y);
//! assert_eq!(y, [10.5, 21.0]);
//! waxpy(-1.0, &x, &y, &mut w);
//! assert_eq!(w, [9.5, 19.0]);
//! assert_eq!(dot(&x, &w), 47.5);
//! ```

/// Computes y = x + y.
pub fn add(x: &[f64], y: &mut [f64]) {
    update(x, y, |x, y| y + x);
}

/// Computes y = y - x.
pub fn subtract(x: &[f64], y: &mut [f64]) {
    update(x, y, |x, y| y - x);
}

/// Computes y = a x + y.
pub fn axpy(a: f64, x: &[f64], y: &mut [f64]) {
    update(x, y, |x, y| y + a * x);
}

/// Computes y = a y + x; the residual y = b - y is `aypx(-1.0, b, y)`.
pub fn aypx(a: f64, x: &[f64], y: &mut [f64]) {
    update(x, y, |x, y| a * y + x);
}

/// Computes the entrywise product `$y_i = x_i y_i$`.
pub fn hadamard(x: &[f64], y: &mut [f64]) {
    update(x, y, |x, y| x * y);
}

/// Computes y = a x.
pub fn copy_scaled(a: f64, x: &[f64], y: &mut [f64]) {
    update(x, y, |x, _| a * x);
}

/// Computes x = a x.
pub fn scale(a: f64, x: &mut [f64]) {
    for x in x {
        *x *= a;
    }
}

/// Computes x = x / a, which a product with 1 / a would round differently.
pub fn divide(a: f64, x: &mut [f64]) {
    for x in x {
        *x /= a;
    }
}

/// Computes w = a x + y.
pub fn waxpy(a: f64, x: &[f64], y: &[f64], w: &mut [f64]) {
    combine(x, y, w, |x, y| a * x + y);
}

/// Computes w = a x + b y.
pub fn waxpby(a: f64, x: &[f64], b: f64, y: &[f64], w: &mut [f64]) {
    combine(x, y, w, |x, y| a * x + b * y);
}

/// Returns x + y.
pub fn sum(x: &[f64], y: &[f64]) -> Vec<f64> {
    let mut w = x.to_vec();
    add(y, &mut w);
    w
}

/// Returns x - y.
pub fn difference(x: &[f64], y: &[f64]) -> Vec<f64> {
    let mut w = x.to_vec();
    subtract(y, &mut w);
    w
}

/// Returns the scalar product, summed in the order of the entries.
pub fn dot(x: &[f64], y: &[f64]) -> f64 {
    assert_eq!(x.len(), y.len(), "vectors of different lengths");
    x.iter().zip(y).map(|(x, y)| x * y).sum()
}

/// Returns the scalar product of m with a x + b y, in eight sums that do not wait for each other.
pub(crate) fn dot_of_sum(m: &[f64], [a, b]: [f64; 2], [x, y]: [&[f64]; 2]) -> f64 {
    assert!(x.len() == m.len() && y.len() == m.len(), "vectors of different lengths");
    let [(m, m_rest), (x, x_rest), (y, y_rest)] = [m, x, y].map(|vector| vector.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (m, (x, y)) in m.iter().zip(x.iter().zip(y)) {
        for k in 0..8 {
            sums[k] += m[k] * (a * x[k] + b * y[k]);
        }
    }
    let rest = m_rest.iter().zip(x_rest.iter().zip(y_rest));
    rest.fold(sums.iter().sum(), |sum, (m, (x, y))| sum + m * (a * x + b * y))
}

/// Returns whether all entries are 0.
pub(crate) fn is_zero(x: &[f64]) -> bool {
    // Without an early end the loop has no branches, and registers hold a number for each value.
    x.iter().fold(0, |others, value| others | u64::from(*value != 0.0)) == 0
}

/// Returns whether all entries are 0 with a positive sign.
fn is_clear(x: &[f64]) -> bool {
    x.iter().fold(0, |others, value| others | value.to_bits()) == 0
}

/// Sets all entries to 0. Where they are, nothing is written: memory that is only read need not be
/// written back.
pub(crate) fn clear(x: &mut [f64]) {
    if !is_clear(x) {
        x.fill(0.0);
    }
}

/// Largest magnitude of some numbers, and NaN if one is: magnitudes order like their bits, with NaN
/// last. Vector registers compare signed integers only.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Largest(i64);

impl Largest {
    /// Raises the largest magnitude to the one of a number.
    #[inline(always)]
    pub fn raise(&mut self, value: f64) {
        self.0 = self.0.max(value.abs().to_bits() as i64);
    }

    /// Returns the largest magnitude so far, 0 without any number.
    #[inline(always)]
    pub fn value(self) -> f64 {
        f64::from_bits(self.0 as u64)
    }
}

/// Returns the largest magnitude of some numbers, and NaN if one is.
#[inline(always)]
pub(crate) fn largest(values: impl Iterator<Item = f64>) -> f64 {
    let mut largest = Largest::default();
    for value in values {
        largest.raise(value);
    }
    largest.value()
}

/// Sets each entry of y to `map` of the entries of x and y.
#[inline(always)]
fn update(x: &[f64], y: &mut [f64], map: impl Fn(f64, f64) -> f64) {
    assert_eq!(x.len(), y.len(), "vectors of different lengths");
    for (y, x) in y.iter_mut().zip(x) {
        *y = map(*x, *y);
    }
}

/// Sets each entry of w to `map` of the entries of x and y.
#[inline(always)]
fn combine(x: &[f64], y: &[f64], w: &mut [f64], map: impl Fn(f64, f64) -> f64) {
    assert!(x.len() == w.len() && y.len() == w.len(), "vectors of different lengths");
    for (w, (x, y)) in w.iter_mut().zip(x.iter().zip(y)) {
        *w = map(*x, *y);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_have_the_bits_of_loops() {
        let x = [0.1, -0.0, 3e300, 1.0 / 3.0];
        let y = [0.7, 0.0, -3e-300, 1.0 / 7.0];
        let a = -1.0 / 11.0;
        let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<u64>>();
        let by_loop = |entry: &dyn Fn(f64, f64) -> f64| {
            let values: Vec<f64> = x.iter().zip(&y).map(|(x, y)| entry(*x, *y)).collect();
            bits(&values)
        };
        let in_place = |form: &dyn Fn(&[f64], &mut [f64])| {
            let mut y = y;
            form(&x, &mut y);
            bits(&y)
        };
        assert_eq!(in_place(&|x, y| axpy(-a, x, y)), by_loop(&|x, y| y - a * x));
        assert_eq!(in_place(&|x, y| axpy(1.0, x, y)), in_place(&add));
        assert_eq!(in_place(&|x, y| axpy(-1.0, x, y)), in_place(&subtract));
        assert_eq!(in_place(&|x, y| aypx(-1.0, x, y)), by_loop(&|x, y| x - y));
        assert_eq!(in_place(&|_, y| scale(-1.0, y)), by_loop(&|_, y| -y));
        assert_eq!(in_place(&|x, w| waxpy(-a, x, &y, w)), by_loop(&|x, y| y - a * x));
        assert_eq!(in_place(&|x, w| waxpby(a, x, -2.0, &y, w)), by_loop(&|x, y| a * x - 2.0 * y));
        assert_eq!(in_place(&|x, w| copy_scaled(a, x, w)), by_loop(&|x, _| a * x));
        assert_eq!(in_place(&hadamard), by_loop(&|x, y| x * y));
        assert_eq!(bits(&sum(&x, &y)), by_loop(&|x, y| x + y));
        assert_eq!(bits(&difference(&x, &y)), by_loop(&|x, y| x - y));
    }

    #[test]
    fn a_dot_with_a_sum_counts_each_entry_once() {
        for size in [0, 7, 8, 21] {
            let entries =
                |entry: fn(f64) -> f64| (0..size).map(|i| entry(f64::from(i))).collect::<Vec<f64>>();
            let [m, x, y] = [entries(|i| 1.0 + i), entries(|i| 2.0 - i), entries(|i| i * i)];
            let mut sum = vec![0.0; x.len()];
            waxpby(3.0, &x, -0.5, &y, &mut sum);
            assert_eq!(dot_of_sum(&m, [3.0, -0.5], [&x, &y]), dot(&m, &sum));
        }
    }

    #[test]
    #[should_panic(expected = "vectors of different lengths")]
    fn lengths_must_agree() {
        axpy(1.0, &[1.0], &mut [1.0, 2.0]);
    }
}
