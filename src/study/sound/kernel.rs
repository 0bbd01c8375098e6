//! Band-limited interpolation: a sinc in a window.
//!
//! A signal of values x_n at the times t_n, `dt` apart, is `$\sum_n x_n\,dt\,g(t - t_n)$` between
//! them, where `$g(t) = 2 f\,k(2 f t)$` with `$k(u) = \operatorname{sinc}(u)\,w(u / Z)$`. The
//! window w has four cosines and side lobes of -93 dB: A. H. Nuttall, IEEE Transactions on
//! Acoustics, Speech, and Signal Processing 29, 1981, pages 84-91. The derivative of g gives the
//! derivative of the signal, without the losses of differences.

use std::f64::consts::PI;

/// Number Z of zeros of the sinc on either side.
const ZEROS: usize = 64;

/// Number of tabulated values from zero to zero; errors between them are 3e-7.
const PARTS: usize = 2048;

/// Nuttall's window with a continuous first derivative.
const WINDOW: [f64; 4] = [0.355768, 0.487396, 0.144232, 0.012604];

/// Function g or its derivative.
pub struct Kernel {
    /// Values of k or k' from 0 on.
    table: Vec<f64>,
    /// Number of zeros per second, 2 f.
    zeros: f64,
    /// Number of derivatives, 0 or 1.
    order: i32,
}

impl Kernel {
    /// Creates the kernel of a signal (order 0) or of its derivative (order 1), which removes what
    /// is faster than a limit (Hz) and leaves what is slower than 0.88 of it.
    pub fn new(limit: f64, order: i32) -> Kernel {
        let value = |i: usize| {
            let u = i as f64 / PARTS as f64;
            let angles = [0.0, 1.0, 2.0, 3.0].map(|k| k * PI / ZEROS as f64);
            let window: f64 = WINDOW.iter().zip(angles).map(|(a, angle)| a * (angle * u).cos()).sum();
            let slope: f64 = WINDOW.iter().zip(angles).map(|(a, angle)| -a * angle * (angle * u).sin()).sum();
            let [sinc, rise] = match i {
                0 => [1.0, 0.0],
                _ => {
                    let sinc = (PI * u).sin() / (PI * u);
                    [sinc, ((PI * u).cos() - sinc) / u]
                }
            };
            if order == 0 { sinc * window } else { rise * window + sinc * slope }
        };
        // The main lobe of the window has four of these parts on either side.
        let zeros = 2.0 * limit / (1.0 + 4.0 / ZEROS as f64);
        Kernel { table: (0..=ZEROS * PARTS).map(value).collect(), zeros, order }
    }

    /// Returns the time from which the kernel is zero, in s.
    pub fn reach(&self) -> f64 {
        ZEROS as f64 / self.zeros
    }

    /// Returns the value at a time, in 1/s or 1/s^2.
    pub fn value(&self, time: f64) -> f64 {
        let place = (time * self.zeros).abs() * PARTS as f64;
        let (first, share) = (place as usize, place.fract());
        let Some(&[a, b]) = self.table.get(first..first + 2).and_then(|pair| pair.first_chunk()) else {
            return 0.0;
        };
        let sign = if self.order == 1 { time.signum() } else { 1.0 };
        sign * self.zeros.powi(self.order + 1) * (a + share * (b - a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the largest error of a cosine of some frequency (Hz) with 1000 values a second, or
    /// of its derivative, and the largest value, both relative to the exact amplitude.
    fn worst(frequency: f64, limit: f64, order: i32) -> [f64; 2] {
        let (kernel, turn, dt) = (Kernel::new(limit, order), 2.0 * PI * frequency, 1e-3);
        let (mut error, mut largest) = (0.0_f64, 0.0_f64);
        for i in 0..50 {
            let time = 1.0 + 0.37e-3 * f64::from(i);
            let values = (0..2000).map(|n| f64::from(n) * dt);
            let sum: f64 = values.map(|t| (turn * t).cos() * dt * kernel.value(time - t)).sum();
            let exact = if order == 0 { (turn * time).cos() } else { -turn * (turn * time).sin() };
            error = error.max((sum - exact).abs() / turn.powi(order));
            largest = largest.max(sum.abs() / turn.powi(order));
        }
        [error, largest]
    }

    #[test]
    fn what_is_below_the_limit_stays_and_the_rest_goes() {
        for order in [0, 1] {
            for frequency in [3.0, 50.0, 200.0, 400.0, 440.0] {
                let [error, _] = worst(frequency, 500.0, order);
                assert!(error < 1e-4, "{frequency} Hz, {order}: {error}");
            }
            for frequency in [201.0, 300.0, 450.0] {
                let [_, largest] = worst(frequency, 200.0, order);
                assert!(largest < 1e-4, "{frequency} Hz, {order}: {largest}");
            }
        }
    }
}
