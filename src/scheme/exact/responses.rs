//! Responses of a damped mode to a unit impulse and to a unit step of force, and their integrals.
//!
//! The functions s and v, and their integrals, are those of the page [`super::motion`]; each is
//! evaluated by the formula that keeps its digits.

/// Returns sin and 1 - cos of an angle; the latter as 2 sin^2 of half the angle, which is accurate
/// near 0.
fn turn(angle: f64) -> (f64, f64) {
    let (s, c) = (0.5 * angle).sin_cos();
    (2.0 * s * c, 2.0 * s * s)
}

/// Returns s and v of a mode; see the [module page](self).
pub(in crate::scheme) fn phase(w: f64, damping: f64, time: f64) -> (f64, f64) {
    if damping == 0.0 {
        return turn(w * time);
    }
    let decay = 0.5 * damping;
    let square = (w - decay) * (w + decay);
    let omega = square.abs().sqrt();
    let (g, v) = if square > 0.0 {
        let (sine, versine) = turn(omega * time);
        let share = (-decay * time).exp();
        let g = share * sine / omega;
        (g, share * versine - (-decay * time).exp_m1() - decay * g)
    } else {
        let slow = w * w / (decay + omega);
        let spread = 2.0 * omega;
        let both = if spread * time == 0.0 { time } else { -(-spread * time).exp_m1() / spread };
        let g = (-slow * time).exp() * both;
        (g, -(-slow * time).exp_m1() - slow * g)
    };
    (w * g, v)
}

/// Ratio of the integral of v to the time above which the difference formula is used: its relative
/// error is then about a hundred roundings at most. Below it v is small throughout and the series
/// is used.
const MIN_DIFFERENCE: f64 = 0.01;

/// Returns the integrals of s and v of a mode from 0 to an instant; see the [module page](self).
pub(super) fn sums(w: f64, damping: f64, duration: f64) -> [f64; 2] {
    let (s, v) = phase(w, damping, duration);
    let direct = duration - s / w - damping * v / (w * w);
    if direct > MIN_DIFFERENCE * duration {
        return [v / w, direct];
    }
    // Halve the time until the series has a few terms, then double again.
    let fastest = w.max(damping) * duration;
    let halvings = if fastest > 0.5 { (2.0 * fastest).log2().ceil() } else { 0.0 };
    let mut time = duration / halvings.exp2();
    let (angle, drag) = (w * time, damping * time);
    let (mut before, mut term, mut k) = (0.0, 0.5 * angle * angle, 2.0);
    let mut sum = 0.0;
    // Without damping every other term vanishes.
    while f64::abs(term) + f64::abs(before) > f64::EPSILON * f64::abs(sum) {
        sum += term / (k + 1.0);
        let next = -(drag * k * term + angle * angle * before) / ((k + 1.0) * k);
        (before, term, k) = (term, next, k + 1.0);
    }
    let mut of_v = time * sum;
    for _ in 0..halvings as u32 {
        let (s, v) = phase(w, damping, time);
        of_v = 2.0 * of_v + v * (time - of_v) + s * v / w;
        time *= 2.0;
    }
    [v / w, of_v]
}

/// Returns the first and second integrals of a rigid motion's g from 0 to an instant.
pub(super) fn rigid_response_sums(damping: f64, time: f64) -> [f64; 2] {
    let (g, mean) = rigid_response(damping, time);
    let first = 0.5 * g * mean;
    let x = damping * time;
    if x > 1.0 {
        return [first, (0.5 * time * time - first) / damping];
    }
    let (mut sum, mut term, mut k) = (1.0 / 6.0, 1.0 / 6.0, 4.0);
    while f64::abs(term) > f64::EPSILON * sum {
        term *= -x / k;
        sum += term;
        k += 1.0;
    }
    [first, time * time * time * sum]
}

/// Returns g of a rigid motion and twice the ratio of its integral to it; both equal t without
/// damping.
pub(in crate::scheme) fn rigid_response(damping: f64, time: f64) -> (f64, f64) {
    let x = damping * time;
    if x == 0.0 {
        return (time, time);
    }
    let g = -(-x).exp_m1() / damping;
    if x > 1.0 {
        return (g, 2.0 * (time - g) / (damping * g));
    }
    // The series 2 sum_k (-x)^k / (k + 2)! avoids the cancellation of the difference.
    let (mut sum, mut term, mut k) = (1.0, 1.0, 3.0);
    while f64::abs(term) > f64::EPSILON {
        term *= -x / k;
        sum += term;
        k += 1.0;
    }
    (g, time * time * sum / g)
}
