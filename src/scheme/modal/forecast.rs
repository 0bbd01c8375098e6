//! Polynomials in time that approximate the free motion of the modes over a horizon.
//!
//! Under a constant force h a mode moves by `$a(t)\, \dot q + b(t)\, (h - w^2 q)$` from its state,
//! see [`super::rotation`]. Over a horizon T the polynomial of second degree through the three
//! Chebyshev points differs from the motion by at most `$\max |q'''|\, T^3 / 192$`. With the
//! amplitude `$A^2 = (h / w^2 - q)^2 + (\dot q / w)^2$`, which damping only lessens, and the decay
//! rate c, `$|q'''| \le (w^3 + c w^2 + c^2 w) A$`. A mode too fast for the horizon is better
//! approximated by its position of rest `$h / w^2$`, with the error A. The third derivative of a
//! rigid motion is at most `$c\,|h - c\,\dot q|$`.

use super::limits::Limits;
use super::rotation::Rotation;
use crate::kernels::lanes::sum;
use crate::kernels::wide::widest;
use pulp::Arch;
use std::f64::consts::SQRT_2;

/// Approximation of the free motion over a horizon; see the [module page](self).
#[derive(Debug)]
pub(super) struct Forecast {
    /// Horizon, in s.
    pub seconds: f64,
    /// Coefficients of 1, t and t^2 per unit of the velocity, and per unit of the pull h - w^2 q,
    /// one entry per mode.
    of_rate: [Vec<f64>; 3],
    of_pull: [Vec<f64>; 3],
    /// Errors per unit of velocity and of pull.
    rate_error: Vec<f64>,
    pull_error: Vec<f64>,
}

impl Forecast {
    /// Prepares a horizon, in s, for modes of given squared frequencies ((rad/s)^2) and decay rates
    /// (1/s).
    pub fn new(squares: &[f64], decays: &[f64], seconds: f64) -> Forecast {
        let times = [-0.75_f64.sqrt(), 0.0, 0.75_f64.sqrt()].map(|place| 0.5 * seconds * (1.0 + place));
        let rotations = times.map(|time| Rotation::new(squares, decays, time));
        let zeros = || [(); 3].map(|_| vec![0.0; squares.len()]);
        let (mut of_rate, mut of_pull, [mut rate_error, mut pull_error, _]) = (zeros(), zeros(), zeros());
        let third = seconds.powi(3) / 192.0;
        for (k, (square, decay)) in squares.iter().zip(decays).enumerate() {
            let w = square.sqrt();
            let share = third * w * (square + decay * (w + decay));
            if share >= 1.0 {
                of_pull[0][k] = 1.0 / square;
            } else {
                let [a, b] = [
                    &rotations.each_ref().map(|column| column.a[k]),
                    &rotations.each_ref().map(|column| column.b[k]),
                ];
                of_rate.iter_mut().zip(through(times, a)).for_each(|(column, value)| column[k] = value);
                of_pull.iter_mut().zip(through(times, b)).for_each(|(column, value)| column[k] = value);
            }
            [rate_error[k], pull_error[k]] = match *square == 0.0 {
                true => [third * decay * decay, third * decay].map(|error| SQRT_2 * error),
                false => [share.min(1.0) / w, share.min(1.0) / square],
            };
        }
        Forecast { seconds, of_rate, of_pull, rate_error, pull_error }
    }

    /// Computes the coefficients of 1, t and t^2 of the motion from a state.
    pub fn motion(&self, q: &[f64], v: &[f64], pull: &[f64], motion: &mut [Vec<f64>; 3]) {
        let size = q.len();
        motion.iter_mut().for_each(|motion| motion.resize(size, 0.0));
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                let (q, v, pull) = (&q[..size], &v[..size], &pull[..size]);
                for ((motion, of_rate), of_pull) in motion.iter_mut().zip(&self.of_rate).zip(&self.of_pull) {
                    let (motion, of_rate, of_pull) =
                        (&mut motion[..size], &of_rate[..size], &of_pull[..size]);
                    for k in 0..size {
                        motion[k] = of_rate[k] * v[k] + of_pull[k] * pull[k];
                    }
                }
                let motion = &mut motion[0][..size];
                for k in 0..size {
                    motion[k] += q[k];
                }
            },
        );
    }

    /// Returns a bound of the distance between the motion from a state and its approximation: the
    /// root of the sum of the squares over all modes.
    pub fn error(&self, v: &[f64], pull: &[f64]) -> f64 {
        let size = v.len();
        let (rate_error, pull_error) = (&self.rate_error[..size], &self.pull_error[..size]);
        let pull = &pull[..size];
        let squares = widest(
            Arch::new(),
            #[inline(always)]
            || sum(size, |k| (rate_error[k] * v[k]).powi(2) + (pull_error[k] * pull[k]).powi(2)),
        );
        squares.sqrt()
    }
}

/// Returns the coefficients of the polynomial of second degree through values at three times.
fn through([t0, t1, t2]: [f64; 3], [y0, y1, y2]: &[f64; 3]) -> [f64; 3] {
    let [first, second] = [(y1 - y0) / (t1 - t0), (y2 - y1) / (t2 - t1)];
    let curvature = (second - first) / (t2 - t0);
    [y0 - t0 * (first - t1 * curvature), first - curvature * (t0 + t1), curvature]
}

/// Returns the least value of the polynomial with given coefficients between 0 and `end`.
#[inline(always)]
pub(super) fn least([constant, slope, square]: [f64; 3], end: f64) -> f64 {
    let ends = constant.min(constant + end * (slope + end * square));
    // Both are computed, so that many polynomials fit into one register.
    let vertex = constant - 0.25 * slope * slope / square;
    let is_between = (square > 0.0) & (slope < 0.0) & (-slope < 2.0 * square * end);
    if is_between { vertex } else { ends }
}

/// Returns the least distance of a bounded dof from its obstacles between 0 and `end`, in m, for
/// given coefficients of 1, t and t^2 of its deflection.
#[inline(always)]
pub(super) fn distance([y, rate, curve]: [f64; 3], limits: &Limits, bound: usize, end: f64) -> f64 {
    let below = least([y - limits.lower[bound], rate, curve], end);
    below.min(least([limits.upper[bound] - y, -rate, -curve], end))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_error_bounds_the_distance_from_the_exact_motion() {
        let squares = [0.0, 0.0, 4.0, 100.0, 100.0, 1e6];
        let decays = [0.0, 3.0, 0.1, 0.0, 90.0, 5.0];
        let (q, v, pull) = ([0.3; 6], [0.7, 0.7, -0.2, 1.5, 1.5, -20.0], [1.0, -2.0, 0.5, 8.0, 30.0, 4e3]);
        for horizon in [1e-4, 1e-2, 0.1, 0.5] {
            let forecast = Forecast::new(&squares, &decays, horizon);
            let mut motion = Default::default();
            forecast.motion(&q, &v, &pull, &mut motion);
            let mut farthest = [0.0f64; 6];
            for time in (0..=1000).map(|n| horizon * f64::from(n) / 1000.0) {
                let exact = Rotation::new(&squares, &decays, time);
                for k in 0..6 {
                    let [a, b, c] = [motion[0][k], motion[1][k], motion[2][k]];
                    let exactly = q[k] + exact.a[k] * v[k] + exact.b[k] * pull[k];
                    farthest[k] = farthest[k].max((a + time * (b + time * c) - exactly).abs());
                }
            }
            for (k, far) in farthest.iter().enumerate() {
                let (mut rate, mut force) = ([0.0; 6], [0.0; 6]);
                (rate[k], force[k]) = (v[k], pull[k]);
                let bound = forecast.error(&rate, &force);
                assert!(*far <= bound + 1e-13, "mode {k} over {horizon} s: {far:e}, at most {bound:e}");
            }
        }
    }

    #[test]
    fn the_least_value_is_at_an_end_or_between() {
        for coefficients in [[1.0, -2.0, 3.0], [1.0, 2.0, 3.0], [1.0, -2.0, 0.5], [0.0, 1.0, -3.0]] {
            let [a, b, c] = coefficients;
            let values = (0..=1000).map(|n| f64::from(n) / 1000.0).map(|t| a + t * (b + t * c));
            let sampled = values.fold(f64::INFINITY, f64::min);
            let exact = least(coefficients, 1.0);
            assert!(exact <= sampled && sampled <= exact + 1e-5, "{coefficients:?}: {exact}, not {sampled}");
        }
    }
}
