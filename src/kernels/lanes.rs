//! Products of vectors in eight partial sums.
//!
//! Eight sums run in the registers of the processor at once, whatever their width, so that the
//! result is the same on all processors.

pub(crate) use super::lane_values::LANES;

/// Returns the scalar product.
#[inline(always)]
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let [product] = dots(x, [y]);
    product
}

/// Returns the scalar products of a row with several vectors.
#[inline(always)]
pub(crate) fn dots<const N: usize>(row: &[f64], vectors: [&[f64]; N]) -> [f64; N] {
    let size = row.len();
    let vectors = vectors.map(|vector| &vector[..size]);
    let mut sums = [[0.0; LANES]; N];
    let whole = size - size % LANES;
    for start in (0..whole).step_by(LANES) {
        for (sums, vector) in sums.iter_mut().zip(&vectors) {
            for lane in 0..LANES {
                sums[lane] += row[start + lane] * vector[start + lane];
            }
        }
    }
    let mut products = sums.map(total);
    for (product, vector) in products.iter_mut().zip(&vectors) {
        *product += (whole..size).map(|k| row[k] * vector[k]).sum::<f64>();
    }
    products
}

/// Returns the sum over all k of `term`.
#[inline(always)]
pub(crate) fn sum(size: usize, term: impl Fn(usize) -> f64) -> f64 {
    let mut sums = [0.0; LANES];
    let whole = size - size % LANES;
    for start in (0..whole).step_by(LANES) {
        for (lane, sum) in sums.iter_mut().enumerate() {
            *sum += term(start + lane);
        }
    }
    total(sums) + (whole..size).map(term).sum::<f64>()
}

/// Returns the Euclidean norm.
#[inline(always)]
pub(crate) fn norm(x: &[f64]) -> f64 {
    sum(x.len(), |k| x[k] * x[k]).sqrt()
}

#[inline(always)]
fn total([a, b, c, d, e, f, g, h]: [f64; LANES]) -> f64 {
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}
