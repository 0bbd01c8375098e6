//! Inner loops of the triangular solves, four columns at a time in whole vector registers.
//!
//! There are no closures here: the compiler would build them for the baseline processor and not
//! inline them where wider registers are enabled.

use pulp::Simd;

/// Computes y -= a_0 x_0 + a_1 x_1 + a_2 x_2 + a_3 x_3; the columns are at least as long as y.
#[inline(always)]
pub(crate) fn subtract4<S: Simd>(simd: S, a: [&[f64]; 4], x: &[f64], y: &mut [f64]) {
    let (a0, t0) = S::as_simd_f64s(&a[0][..y.len()]);
    let (a1, t1) = S::as_simd_f64s(&a[1][..y.len()]);
    let (a2, t2) = S::as_simd_f64s(&a[2][..y.len()]);
    let (a3, t3) = S::as_simd_f64s(&a[3][..y.len()]);
    let (body, tail) = S::as_mut_simd_f64s(y);
    let x0 = simd.splat_f64s(-x[0]);
    let x1 = simd.splat_f64s(-x[1]);
    let x2 = simd.splat_f64s(-x[2]);
    let x3 = simd.splat_f64s(-x[3]);
    for ((((y, a0), a1), a2), a3) in body.iter_mut().zip(a0).zip(a1).zip(a2).zip(a3) {
        let first = simd.mul_add_f64s(*a1, x1, simd.mul_f64s(*a0, x0));
        let second = simd.mul_add_f64s(*a3, x3, simd.mul_add_f64s(*a2, x2, *y));
        *y = simd.add_f64s(first, second);
    }
    for ((((y, a0), a1), a2), a3) in tail.iter_mut().zip(t0).zip(t1).zip(t2).zip(t3) {
        *y -= (a0 * x[0] + a1 * x[1]) + (a2 * x[2] + a3 * x[3]);
    }
}

/// Returns the scalar products of four columns with y; the columns are at least as long as y.
#[inline(always)]
pub(crate) fn dot4<S: Simd>(simd: S, a: [&[f64]; 4], y: &[f64]) -> [f64; 4] {
    let (a0, t0) = S::as_simd_f64s(&a[0][..y.len()]);
    let (a1, t1) = S::as_simd_f64s(&a[1][..y.len()]);
    let (a2, t2) = S::as_simd_f64s(&a[2][..y.len()]);
    let (a3, t3) = S::as_simd_f64s(&a[3][..y.len()]);
    let (body, tail) = S::as_simd_f64s(y);
    let mut sums = [simd.splat_f64s(0.0); 4];
    for ((((y, a0), a1), a2), a3) in body.iter().zip(a0).zip(a1).zip(a2).zip(a3) {
        sums[0] = simd.mul_add_f64s(*a0, *y, sums[0]);
        sums[1] = simd.mul_add_f64s(*a1, *y, sums[1]);
        sums[2] = simd.mul_add_f64s(*a2, *y, sums[2]);
        sums[3] = simd.mul_add_f64s(*a3, *y, sums[3]);
    }
    let mut rest = [0.0; 4];
    for ((((y, a0), a1), a2), a3) in tail.iter().zip(t0).zip(t1).zip(t2).zip(t3) {
        rest[0] += a0 * y;
        rest[1] += a1 * y;
        rest[2] += a2 * y;
        rest[3] += a3 * y;
    }
    [
        simd.reduce_sum_f64s(sums[0]) + rest[0],
        simd.reduce_sum_f64s(sums[1]) + rest[1],
        simd.reduce_sum_f64s(sums[2]) + rest[2],
        simd.reduce_sum_f64s(sums[3]) + rest[3],
    ]
}
