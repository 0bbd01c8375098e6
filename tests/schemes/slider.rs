//! Dry friction against the motion of one dof, compared with the closed form of a mass on a spring,
//! and in plates.
//!
//! A mass m on a spring K beside a slider of force F moves in half periods of undamped vibration
//! about `±F/K`, so that each turning point is 2 F/K nearer to 0, 4 F/K per period, until one lies
//! within F/K of 0, where it stays (den Hartog, *Mechanical Vibrations*, 1956, section 8.4).

use crate::common::block;
use crate::common::models::{CLAMPED, PAPER_PLATE};
use crate::common::scenes::{grid, run, same};
use rebond::contact_law::{DryFriction, Laws};
use rebond::linalg::Native;
use rebond::obstacle::Bounds;
use rebond::scheme::{
    BoundSlider, Damping, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Start, System,
    TimeDependence,
};
use std::f64::consts::PI;
use std::sync::Arc;

const MASS: f64 = 0.3;
const SPRING: f64 = 7e3;
const FORCE: f64 = 11.0;
/// Place from which the mass is let go, in multiples of F/K: it turns at -8.7, 6.7, ... and stops
/// at 0.7.
const BEGIN: f64 = 10.7;

/// Returns a mass on a spring beside a slider.
fn system(stiffness: f64) -> System<Native> {
    let engine = Native::new(1);
    let form = |value: f64| engine.form(vec![block(&[Some(0)], &[value], 0)]);
    let (spring, mass) = (form(SPRING), form(MASS));
    let mut bounds = Bounds::uniform(vec![0], f64::NEG_INFINITY, f64::INFINITY);
    bounds.laws = Laws::new(vec![Arc::new(DryFriction { force: FORCE, stiffness })], vec![[0, 0]]);
    let sliders = Some(vec![BoundSlider { number: 0, bound: 0, stiffness }]);
    System {
        engine,
        stiffness: spring,
        mass,
        damping: Damping::default(),
        load: None,
        bounds,
        bound_numbers: None,
        drive: TimeDependence { sliders, ..TimeDependence::default() },
    }
}

/// Returns the scheme called `name` of a mass that is let go from [`BEGIN`].
fn started<'s>(name: &str, system: &'s System<Native>, step: f64) -> Box<dyn Scheme + 's> {
    let start = Start { displacement: vec![BEGIN * FORCE / SPRING], velocity: vec![0.0] };
    match name {
        "newmark" => {
            let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
            Box::new(Newmark::new(system, parameters, start).unwrap())
        }
        _ => Box::new(Midpoint::new(system, step, Massless::Reflected, start).unwrap()),
    }
}

/// Returns the turning points over five periods, and the last place, in multiples of F/K.
fn turning_points(name: &str, system: &System<Native>, step: f64) -> (Vec<f64>, f64) {
    let mut scheme = started(name, system, step);
    let period = 2.0 * PI * (MASS / SPRING).sqrt();
    let mut places = vec![scheme.displacement()[0]];
    while scheme.time() < 7.0 * period {
        scheme.advance().unwrap();
        assert!(scheme.step_report().kkt < 1e-12, "{name}: {:e}", scheme.step_report().kkt);
        assert_eq!(scheme.reaction(), [0.0]);
        places.push(scheme.displacement()[0]);
    }
    places.dedup();
    let turns = |w: &&[f64]| (w[1] - w[0]) * (w[2] - w[1]) < 0.0;
    let points = places.windows(3).filter(turns).map(|w| w[1] * SPRING / FORCE).collect();
    (points, places[places.len() - 1] * SPRING / FORCE)
}

#[test]
fn a_mass_on_a_spring_loses_4_f_over_k_per_period_and_stops() {
    let system = system(f64::INFINITY);
    for name in ["newmark", "midpoint"] {
        let errors = [1e-4, 5e-5, 2.5e-5].map(|step| {
            let (points, last) = turning_points(name, &system, step);
            let exact: Vec<f64> =
                (1..=5).map(|k| (BEGIN - 2.0 * f64::from(k)) * (-1.0_f64).powi(k)).collect();
            assert!(points.len() >= 4, "{name}: {points:?}");
            let errors = exact.iter().zip(points).map(|(exact, point)| (exact - point).abs());
            errors.fold((exact[4] - last).abs(), f64::max)
        });
        assert!(errors[0] < 1e-3 && errors[2] < 0.2 * errors[0], "{name}: {errors:?}");
    }
}

/// The midpoint rule keeps the sum of energy and dissipated energy, with and without a spring; that
/// of Newmark's scheme falls in proportion to the step.
#[test]
fn energy_goes_where_the_ledger_says() {
    let begin = 0.5 * SPRING * (BEGIN * FORCE / SPRING).powi(2);
    for stiffness in [f64::INFINITY, 1e9, 5e4, 2e3] {
        let system = system(stiffness);
        let ledger = |name: &str, step: f64| {
            let mut scheme = started(name, &system, step);
            let (mut least, mut most, mut last) = (begin, begin, 0.0);
            while scheme.time() < 0.3 {
                scheme.advance().unwrap();
                let dissipated = scheme.friction()[0].dissipated;
                assert!(dissipated >= last - 1e-13 * begin, "{name}: {last} to {dissipated}");
                last = dissipated;
                let sum = scheme.energies().unwrap().total() + dissipated;
                (least, most) = (least.min(sum), most.max(sum));
            }
            assert!(last > 0.8 * begin, "{name}, {stiffness:e}: {last} of {begin}");
            [least, most].map(|sum| sum / begin - 1.0)
        };
        for step in [1e-4, 1e-3] {
            let [least, most] = ledger("midpoint", step);
            assert!(least.abs().max(most.abs()) < 1e-12, "{stiffness:e}, {step:e}: {least:e} to {most:e}");
        }
        let [coarse, fine] = [1e-4, 5e-5].map(|step| ledger("newmark", step)[0]);
        assert!((0.2..0.6).contains(&(fine / coarse)), "{stiffness:e}: {coarse:e}, {fine:e}");
        assert!(ledger("newmark", 1e-4)[1] < 0.02, "{stiffness:e}");
    }
}

/// A slider that never slips is its spring; one whose force is next to nothing is not there.
#[test]
fn limits_are_a_spring_and_nothing() {
    for (scheme, mass) in [("newmark", "singular"), ("newmark", "consistent"), ("midpoint", "consistent")] {
        let rows = |of: &str| {
            let plate = [PAPER_PLATE, &grid("fvs", 6, 2), CLAMPED].concat();
            run(&format!(
                "{plate}initial.velocity = 0.4\n{of}\noutput.probes = [{{ name = \"tip\", at = [1.2, 0.2] }}]\n\
                 time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 2e-4, end = 0.05 }}\n"
            ))
        };
        let at = "at = [1.2, 0.2], stiffness = 3e4";
        same(&rows(&format!("slider = [{{ {at}, force = 1e-9 }}]")), &rows(""), 1e-9);
        // Newmark takes the force of the slider at the end of a step, that of the spring as a mean.
        if scheme == "midpoint" {
            let stuck = rows(&format!("slider = [{{ {at}, force = 1e9 }}]"));
            same(&stuck, &rows(&format!("spring = [{{ {at} }}]")), 1e-10);
        }
    }
}
