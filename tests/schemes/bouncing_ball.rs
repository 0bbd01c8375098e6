//! A ball that bounces on the floor: the schemes on one dof, without any mesh.
//!
//! The problem is m u'' = -m g + r, u >= 0, r >= 0, r u = 0, with the ball dropped from h with
//! restitution e: the k-th apex is e^{2k} h. With one dof the step's bound-constrained problem is
//! solved by taking a maximum, so that each scheme is a recursion of one line, written here again;
//! the program's schemes follow it to rounding, for any mass.
//!
//! - Newmark: u^{n+1} = max(2 u^n - u^{n-1} - g dt^2, -e u^{n-1}). Its apexes converge as dt.
//! - Midpoint, which here has a regular mass: u^{n+1/2} = max(u^n + v^n dt/2 - g dt^2/4, 0). It has
//!   no restitution: the velocity after a bounce depends on where in the step the ball meets the
//!   floor, at every dt. Only a singular mass gives it a limit.

use crate::common::block;
use rebond::linalg::Native;
use rebond::obstacle::Bounds;
use rebond::scheme::{
    Damping, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Solution, Start, System, TimeDependence,
};

const MASS: f64 = 2.5;
const STEPS: [f64; 3] = [1e-2, 1e-3, 1e-4];

fn ball(gravity: f64) -> System<Native> {
    let engine = Native::new(1);
    let form = |value: f64| engine.form(vec![block(&[Some(0)], &[value], 0)]);
    let (stiffness, mass) = (form(0.0), form(MASS));
    let bounds = Bounds::uniform(vec![0], 0.0, f64::INFINITY);
    System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: Some(vec![-MASS * gravity]),
        bounds,
        bound_numbers: None,
        drive: TimeDependence::default(),
    }
}

fn newmark(system: &System<Native>, restitution: f64, step: f64, height: f64) -> Newmark<'_, Native> {
    let start = Start { displacement: vec![height], velocity: vec![0.0] };
    Newmark::new(system, NewmarkParameters { beta: 0.5, restitution, step }, start).unwrap()
}

fn midpoint(system: &System<Native>, step: f64, height: f64) -> Midpoint<'_, Native> {
    let start = Start { displacement: vec![height], velocity: vec![0.0] };
    Midpoint::new(system, step, Massless::Reflected, start).unwrap()
}

/// Returns the first apexes, read from the values at the instants.
fn apexes<const K: usize>(scheme: &mut dyn Scheme) -> [f64; K] {
    let mut before = scheme.displacement()[0];
    let mut now = before;
    std::array::from_fn(|_| {
        loop {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-10);
            // The bound holds for the increment of the step, and therefore to rounding.
            assert!(scheme.admissible()[0] >= -1e-15 && scheme.reaction()[0] >= 0.0);
            let next = scheme.displacement()[0];
            let top = now > before && now >= next;
            before = std::mem::replace(&mut now, next);
            if top {
                return before;
            }
        }
    })
}

#[test]
fn the_first_apexes_are_those_of_an_independent_program() {
    // The ball is dropped from 1 under g = 1; values have the given digits.
    let system = ball(1.0);
    for (e, expected) in [(1.0, ["1.00225", "1.00081", "1.00010"]), (0.5, ["0.25085", "0.24924", "0.24993"])]
    {
        for (step, expected) in STEPS.into_iter().zip(expected) {
            let [apex] = apexes(&mut newmark(&system, e, step, 1.0));
            assert_eq!(format!("{apex:.5}"), expected, "e = {e}, dt = {step}");
        }
    }
}

#[test]
fn newmark_apexes_converge_to_the_law_of_restitution() {
    // The first bounce loses or gains the velocity of a fraction of a step: at most 2 dt times the
    // speed of impact, wherever in the step it occurs.
    for gravity in [1.0, 9.81] {
        let system = ball(gravity);
        for e in [1.0, 0.8, 0.5] {
            for step in STEPS {
                let mut worst: f64 = 0.0;
                for phase in 0..10 {
                    let height = 1.0 + 0.0137 * f64::from(phase);
                    let computed: [f64; 3] = apexes(&mut newmark(&system, e, step, height));
                    for (k, apex) in (1..).zip(computed) {
                        worst = worst.max((apex - e.powi(2 * k) * height).abs());
                    }
                }
                let speed = (2.0 * gravity).sqrt();
                println!("g = {gravity}, e = {e}, dt = {step}: {:.2} dt v", worst / (step * speed));
                assert!(worst <= 2.0 * step * speed, "g = {gravity}, e = {e}, dt = {step}: {worst:e}");
            }
        }
    }
}

#[test]
fn without_restitution_the_ball_stays_where_it_falls() {
    let system = ball(9.81);
    for step in STEPS {
        let mut scheme = newmark(&system, 0.0, step, 1.0);
        let landing = (2.0f64 / 9.81).sqrt();
        while scheme.time() < 2.0 * landing {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt <= 1e-10);
            if scheme.time() > landing + 2.0 * step {
                assert!(scheme.displacement()[0].abs() <= 1e-15, "{:e}", scheme.displacement()[0]);
                // The floor carries the weight of the ball.
                let weight = MASS * 9.81;
                assert!((scheme.reaction()[0] - weight).abs() <= 1e-12 * weight, "{}", scheme.reaction()[0]);
            }
        }
        assert_eq!(scheme.statistics().factorisations, 2, "one before contact, one with the candidate last");
    }
}

#[test]
fn newmark_follows_its_recursion() {
    for (e, step, gravity) in [(1.0, 1e-2, 9.81), (0.7, 3e-3, 1.0), (0.5, 1e-3, 9.81), (0.0, 1e-2, 9.81)] {
        let system = ball(gravity);
        let mut scheme = newmark(&system, e, step, 1.0);
        let (mut before, mut now) = (1.0 - 0.5 * gravity * step * step, 1.0);
        for _ in 0..3000 {
            let next = f64::max(2.0 * now - before - gravity * step * step, -e * before);
            (before, now) = (now, next);
            scheme.advance().unwrap();
            let error = (scheme.displacement()[0] - now).abs();
            assert!(error <= 1e-9, "e = {e}, t = {}: {error:e}", scheme.time());
        }
    }
}

#[test]
fn midpoint_follows_its_recursion() {
    for (step, gravity) in [(1e-2, 9.81), (3e-3, 1.0)] {
        let system = ball(gravity);
        let mut scheme = midpoint(&system, step, 1.0);
        let (mut u, mut v) = (1.0f64, 0.0);
        // The floor turns an error in u into an error of the speed 4/dt times as large. Values that
        // agree to rounding after one bounce therefore differ visibly some bounces later.
        let mut tolerance = 1e-12;
        let mut landed = false;
        while tolerance < 1e-5 {
            let free = 0.5 * step * v - 0.25 * gravity * step * step;
            let lands = free < -u;
            if lands && !landed {
                tolerance *= 10.0 / step;
            }
            landed = lands;
            let half = free.max(-u);
            v = 4.0 / step * half - v;
            u += 2.0 * half;
            scheme.advance().unwrap();
            let error = (scheme.displacement()[0] - u).abs();
            assert!(error <= tolerance, "t = {}: {error:e}, not {tolerance:e}", scheme.time());
            assert_eq!(scheme.reaction()[0] > 0.0, landed, "t = {}", scheme.time());
        }
        assert!(scheme.time() > 2.0 * (2.0 / gravity).sqrt());
    }
}

#[test]
fn midpoint_with_a_regular_mass_has_no_law_of_restitution() {
    let system = ball(1.0);
    for step in [1e-2, 1e-3] {
        let (mut least, mut most) = (f64::INFINITY, 0.0f64);
        for phase in 0..40 {
            let height = 1.0 + 0.00137 * f64::from(phase);
            let [apex] = apexes(&mut midpoint(&system, step, height));
            (least, most) = (least.min(apex / height), most.max(apex / height));
        }
        println!("dt = {step}: apexes from {least:.3} to {most:.3} of the height");
        assert!(least < 0.3 && most > 3.0, "dt = {step}: {least} to {most}");
    }
}
