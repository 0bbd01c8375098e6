//! Distribution function of the standard normal distribution, and its inverse.

use libm::erfc;
use std::f64::consts::{SQRT_2, TAU};

/// Returns the probability that a standard normal number is below a value.
pub(super) fn probability_below(value: f64) -> f64 {
    0.5 * erfc(-value / SQRT_2)
}

/// Returns the value that a standard normal number is below with a probability between 0 and 1.
///
/// The start is formula 26.2.23 of Abramowitz and Stegun, with an error of 5e-4, which each step of
/// Halley's method cubes.
pub(super) fn quantile(probability: f64) -> f64 {
    // 1 - p is exact where p is at least one half.
    let (tail, sign) = if probability < 0.5 { (probability, -1.0) } else { (1.0 - probability, 1.0) };
    let t = (-2.0 * tail.ln()).sqrt();
    let mut z = t
        - (2.515517 + t * (0.802853 + t * 0.010328)) / (1.0 + t * (1.432788 + t * (0.189269 + t * 0.001308)));
    for _ in 0..2 {
        let density = (-0.5 * z * z).exp() / TAU.sqrt();
        let step = (tail - probability_below(-z)) / density;
        z -= step / (1.0 + 0.5 * z * step);
    }
    sign * z
}

#[cfg(test)]
mod tests {
    use super::{probability_below, quantile};

    /// Table 26.1 and 26.5 of Abramowitz and Stegun, and Wichura's tests (Applied Statistics 37
    /// (1988) 477-484).
    #[test]
    fn normal_quantiles_are_the_tabulated_ones() {
        let table = [
            (0.25, -0.674_489_750_196_081_7),
            (0.001, -3.090_232_306_167_814),
            (1e-20, -9.262_340_089_798_408),
            (0.975, 1.959_963_984_540_054),
        ];
        for (probability, value) in table {
            assert!((quantile(probability) - value).abs() < 4e-15 * value.abs(), "{probability}");
            assert!((probability_below(value) / probability - 1.0).abs() < 1e-13, "{value}");
        }
        assert!(quantile(0.5).abs() < 1e-16);
    }
}
