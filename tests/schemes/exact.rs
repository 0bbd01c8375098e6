//! The exact scheme, compared with an independent program, closed forms, and theory.

use crate::common::models::{PAPER_FALL, PAPER_PLATE, literal};
use crate::common::{Random, block, lift, scenes};
use rebond::Error;
use rebond::linalg::{CellClass, Native, SingularMassCell};
use rebond::obstacle::Bounds;
use rebond::scene::{self, FieldInput, Mass, Scene};
use rebond::scheme::{
    Damping, Event, EventStatistics, Exact, ExactOptions, Scheme, Solution, Start, System, TimeDependence,
};
use rebond::simulation::Model;
use std::f64::consts::PI;

/// Returns the paper's plate, at rest under 14600 Pa.
fn falling_plate(element: &str, cells: [usize; 2], scheme: &str, step: f64, end: f64) -> Scene {
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "{element}", cells = {cells:?} }}
        time = {{ scheme = "{scheme}", mass = "singular", step = {step:e}, end = {end} }}
        output = {{ probes = [{{ name = "one", at = [1.2, 0.0] }}, {{ name = "other", at = [1.2, 0.4] }}] }}
        "#
    );
    Scene::from_str(&text, "plate", &[]).expect("a valid scene")
}

/// Returns the deflections of the two corners.
pub fn corners(model: &Model, scheme: &dyn Scheme) -> [f64; 2] {
    [0, 1].map(|k| model.probes[k].deflection(scheme.displacement()))
}

/// Returns the rows of numbers of a table with a header.
pub fn table(name: &str) -> Vec<Vec<f64>> {
    let path = format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|x| x.parse().unwrap()).collect()).collect()
}

#[test]
fn the_paper_s_plate_moves_as_an_independent_program_says() {
    // Rounding of the matrix entries alone changes these by 2e-11 and 4e-10 m (fvs), 8e-10 and 2e-8
    // m (hct).
    for (element, early, late, events) in [("fvs", 2e-9, 2e-8, 186), ("hct", 5e-8, 1e-6, 478)] {
        let model = Model::new(&falling_plate(element, [10, 4], "exact", 1e-3, 0.3)).unwrap();
        let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
        let energy = scheme.energies().unwrap().total();
        let (mut errors, mut drift, mut counted, mut kkt) = ([0.0f64; 2], 0.0f64, 0, 0.0f64);
        for (n, row) in table(&format!("exact_{element}_10x4.csv")).iter().enumerate() {
            if n > 0 {
                scheme.advance().unwrap();
            }
            assert!((scheme.time() - row[0]).abs() <= 1e-12);
            for (deflection, expected) in corners(&model, &scheme).iter().zip(&row[1..]) {
                let late = usize::from(row[0] > 0.15);
                errors[late] = errors[late].max((deflection - expected).abs());
            }
            drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
            kkt = kkt.max(scheme.step_report().kkt);
            counted += scheme.take_events().len();
        }
        let tally = scheme.statistics().events.unwrap();
        println!("{element}: errors {errors:?} m, energy {drift:.1e}, residual {kkt:.1e}, {tally:?}");
        assert!(errors[0] <= early && errors[1] <= late, "{element}: {errors:?}");
        assert_eq!((counted, tally.events), (events, events as u64), "{element}");
        assert!(drift <= 1e-9, "{element}: {drift:e}");
        assert!(kkt <= 1e-11, "{element}: {kkt:e}");
        // The search makes some ten evaluations per event.
        assert!(tally.evaluations <= 12 * tally.events, "{element}: {tally:?}");
    }
}

#[test]
fn the_search_s_tolerances_do_not_move_the_trajectory() {
    for element in ["fvs", "hct"] {
        let model = Model::new(&falling_plate(element, [10, 4], "exact", 1e-3, 0.3)).unwrap();
        let usual = ExactOptions::default();
        let run = |options, step: f64, every: usize| -> Vec<[f64; 2]> {
            let mut scheme = Exact::with_options(&model.system, step, model.start.clone(), options).unwrap();
            let mut rows = Vec::new();
            for n in 0..=300 * every {
                if n > 0 {
                    scheme.advance().unwrap();
                }
                if n % every == 0 {
                    rows.push(corners(&model, &scheme));
                }
            }
            rows
        };
        let truth = run(usual, 1e-3, 1);
        let variants = [
            ("roundings", ExactOptions { roundings: 0.5 * usual.roundings, ..usual }, 1),
            ("stride", ExactOptions { stride: 0.5 * usual.stride, ..usual }, 1),
            ("no cache", ExactOptions { memory: 0, ..usual }, 1),
            ("step", usual, 100),
        ];
        for (name, options, every) in variants {
            let other = run(options, 1e-3 / every as f64, every);
            let pairs = truth.iter().flatten().zip(other.iter().flatten());
            let apart = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            println!("{element}, {name}: {apart:.1e} m");
            assert!(apart <= 1e-10, "{element}, {name}: {apart:e}");
        }
    }
}

#[test]
fn finer_quadrilaterals() {
    // An independent program finds 592 events up to 0.2 s.
    let model = Model::new(&falling_plate("fvs", [20, 8], "exact", 1e-2, 0.2)).unwrap();
    let mut scheme = Exact::new(&model.system, 1e-2, model.start.clone()).unwrap();
    let energy = scheme.energies().unwrap().total();
    for _ in 0..20 {
        scheme.advance().unwrap();
        let drift = (scheme.energies().unwrap().total() / energy - 1.0).abs();
        println!(
            "energy {drift:.1e}, residual {:.1e}, {:?}",
            scheme.step_report().kkt,
            scheme.statistics().events
        );
        assert!(drift <= 1e-9);
    }
    assert_eq!(scheme.statistics().events.unwrap().events, 592);
}

/// Runs a plate of quadrilaterals to its end; returns its event statistics and the largest relative
/// change of energy.
fn run_fine(cells: [usize; 2], end: f64) -> (EventStatistics, f64) {
    let step = 1e-4;
    let model = Model::new(&falling_plate("fvs", cells, "exact", step, end)).unwrap();
    let mut scheme = Exact::new(&model.system, step, model.start.clone()).unwrap();
    let energy = scheme.energies().unwrap().total();
    let mut drift = 0.0f64;
    for _ in 0..(end / step).round() as usize {
        scheme.advance().unwrap();
        drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
        let kkt = scheme.step_report().kkt;
        assert!(kkt <= 1e-10, "t = {}: {kkt:e}", scheme.time());
    }
    let tally = scheme.statistics().events.unwrap();
    println!("energy {drift:.1e}, {tally:?}");
    (tally, drift)
}

#[test]
fn modes_of_many_cells_are_modes() {
    // Inaccurate eigenvectors keep neither the energy (1e-5) nor K U = F - B^T v' + G^T r (5e-7)
    // through the impact at 0.0548 s.
    let (tally, drift) = run_fine([24, 10], 0.056);
    assert!(tally.events > 50 && drift <= 1e-10, "{drift:e}, {tally:?}");
}

#[test]
#[ignore = "ten minutes"]
fn six_hundred_and_forty_cells() {
    let (tally, drift) = run_fine([40, 16], 0.1);
    assert!(tally.events > 1000 && drift <= 1e-9, "{drift:e}, {tally:?}");
}

#[test]
fn the_schemes_of_the_paper_converge_to_it() {
    let steps = [4e-5, 2e-5, 1e-5, 5e-6];
    let (period, end) = (2e-4, 0.07);
    let model = Model::new(&falling_plate("fvs", [10, 4], "exact", period, end)).unwrap();
    let mut truth = Exact::new(&model.system, period, model.start.clone()).unwrap();
    let instants = (end / period).round() as usize;
    let truth: Vec<[f64; 2]> = (0..instants)
        .map(|_| {
            truth.advance().unwrap();
            corners(&model, &truth)
        })
        .collect();
    let errors_of = |name: &str, mass: Mass| {
        let errors = steps.map(|step| {
            let mut scene = falling_plate("fvs", [10, 4], name, step, end);
            scene.time.mass = mass;
            if let scene::SchemeSpec::Midpoint { massless } = &mut scene.time.scheme {
                *massless = mass.massless();
            }
            let model = Model::new(&scene).unwrap();
            let mut scheme = model.scheme(&scene).unwrap();
            let mut sum = 0.0;
            for expected in &truth {
                for _ in 0..(period / step).round() as usize {
                    scheme.advance().unwrap();
                }
                sum += (corners(&model, scheme.as_ref())[0] - expected[0]).powi(2);
            }
            (sum / truth.len() as f64).sqrt()
        });
        println!("{name}, {mass:?} mass: rms {errors:?} m");
        errors
    };
    for name in ["newmark", "midpoint"] {
        let errors = errors_of(name, Mass::Singular);
        // The order is 1 overall, with fluctuations, since each event lies at another place within
        // a step.
        assert!(errors[3] <= errors[0] / 4.0, "{name}: {errors:?}");
        assert!(errors.windows(2).all(|pair| pair[1] <= 1.2 * pair[0]), "{name}: {errors:?}");
        // The consistent mass defines another semi-discrete problem, to which no step converges.
        let others = errors_of(name, Mass::Consistent);
        assert!(others.iter().all(|error| *error > 5e-4), "{name}: {others:?}");
    }
}

#[test]
fn time_runs_backwards_as_well() {
    let model = Model::new(&falling_plate("fvs", [6, 2], "exact", 1e-3, 0.1)).unwrap();
    let dofs = model.start.displacement.len();
    let mut random = Random::new(7);
    for _ in 0..4 {
        let velocity: Vec<f64> = (0..dofs).map(|d| if d % 3 == 0 { random.signed() } else { 0.0 }).collect();
        let start = Start { displacement: model.start.displacement.clone(), velocity: velocity.clone() };
        let mut there = Exact::new(&model.system, 1e-3, start).unwrap();
        for _ in 0..70 {
            there.advance().unwrap();
        }
        let events = there.statistics().events.unwrap().events;
        assert!(events > 0);
        // This displacement rate has the reversed velocities of the end.
        let turned = lift(&model.system, there.cell_velocity()).into_iter().map(|v| -v).collect();
        let start = Start { displacement: there.displacement().to_vec(), velocity: turned };
        let mut back = Exact::new(&model.system, 1e-3, start).unwrap();
        for _ in 0..70 {
            back.advance().unwrap();
        }
        let apart = crate::common::difference(back.displacement(), &model.start.displacement);
        println!("{events} events there, {} back: {apart:.1e}", back.statistics().events.unwrap().events);
        assert!(apart <= 1e-8, "{apart:e}");
        assert_eq!(back.statistics().events.unwrap().events, events);
    }
}

/// Returns balls of mass 2 that fall under gravity, each on a massless tip with a spring of
/// stiffness K between them. Each has dofs (tip, ball), and the tips are bounded.
fn balls(count: usize, gravity: f64, lower: f64, upper: f64) -> System<Native> {
    balls_on_springs(K, count, gravity, lower, upper)
}

fn balls_on_springs(k: f64, count: usize, gravity: f64, lower: f64, upper: f64) -> System<Native> {
    let engine = Native::new(2 * count);
    let dofs = |k: usize| [Some(2 * k), Some(2 * k + 1)];
    let stiffness = (0..count).map(|ball| block(&dofs(ball), &[k, -k, -k, k], 0)).collect();
    let average = |k: usize| SingularMassCell {
        dofs: [Some(2 * k + 1)].into(),
        row: [MASS].into(),
        mass: MASS,
        class: CellClass::Plate(0),
    };
    let mass = engine.averages((0..count).map(average).collect());
    let load = (0..count).flat_map(|_| [0.0, -MASS * gravity]).collect();
    let bounds = Bounds::uniform((0..count).map(|k| 2 * k).collect(), lower, upper);
    System {
        stiffness: engine.form(stiffness),
        mass,
        damping: Damping::default(),
        load: Some(load),
        bounds,
        bound_numbers: None,
        drive: TimeDependence::default(),
        engine,
    }
}

const MASS: f64 = 2.0;
const K: f64 = 2e4;

/// Returns the frequency of a ball on its spring, 100 rad/s.
fn omega() -> f64 {
    (K / MASS).sqrt()
}

fn start(places: &[f64], velocities: &[f64]) -> Start {
    let twice = |of: &[f64]| of.iter().flat_map(|x| [*x, *x]).collect();
    Start { displacement: twice(places), velocity: twice(velocities) }
}

fn run(scheme: &mut Exact<Native>, end: f64) -> Vec<Event> {
    let mut events = Vec::new();
    while scheme.time() < end {
        scheme.advance().unwrap();
        assert!(scheme.step_report().kkt <= 1e-11, "{:e}", scheme.step_report().kkt);
        events.extend(scheme.take_events());
    }
    events
}

#[test]
fn a_ball_bounces_by_its_closed_form() {
    // In contact y'' = -g - w^2 y holds from y = 0 at speed -v to y = 0 again. With tan(a) = w v /
    // g the contact lasts 2 (pi - a) / w.
    let (gravity, height) = (9.81, 1.0);
    let system = balls(1, gravity, 0.0, f64::INFINITY);
    let mut scheme = Exact::new(&system, 0.01, start(&[height], &[0.0])).unwrap();
    let energy = scheme.energies().unwrap().total();
    let events = run(&mut scheme, 20.0);
    let speed = (2.0 * gravity * height).sqrt();
    let (fall, contact) = (speed / gravity, 2.0 * (PI - (omega() * speed / gravity).atan()) / omega());
    for (k, event) in events.iter().enumerate() {
        let bounce = (k / 2) as f64;
        let begins = fall + bounce * (2.0 * fall + contact);
        let expected = if event.closes { begins } else { begins + contact };
        assert!((event.time - expected).abs() <= 1e-12 * (1.0 + expected), "{k}: {} {expected}", event.time);
        assert_eq!(event.closes, k % 2 == 0);
        assert!((event.velocity.abs() - speed).abs() <= 1e-11, "{k}: {}", event.velocity);
    }
    assert_eq!(events.len(), 42);
    assert!((scheme.energies().unwrap().total() / energy - 1.0).abs() <= 1e-12);
}

#[test]
fn a_ball_between_two_walls_keeps_its_period() {
    // Without weight, the flights last 2 x gap / v and the contacts 2 x pi / w.
    let system = balls(1, 0.0, -1.0, 1.0);
    let mut scheme = Exact::new(&system, 0.05, start(&[0.0], &[3.0])).unwrap();
    let events = run(&mut scheme, 50.0);
    let (flight, contact) = (2.0 / 3.0, PI / omega());
    for (k, event) in events.iter().enumerate() {
        let expected =
            1.0 / 3.0 + (k / 2) as f64 * (flight + contact) + if event.closes { 0.0 } else { contact };
        assert!((event.time - expected).abs() <= 1e-12 * (1.0 + expected), "{k}: {} {expected}", event.time);
        let direction = if (k / 2) % 2 == 0 { 1.0 } else { -1.0 };
        let direction = if event.closes { direction } else { -direction };
        assert!((event.velocity - 3.0 * direction).abs() <= 1e-11);
    }
    assert!(events.len() > 100);
}

#[test]
fn balls_that_land_together_are_taken_together() {
    let system = balls(3, 10.0, 0.0, f64::INFINITY);
    let mut scheme = Exact::new(&system, 0.01, start(&[1.0, 1.0, 1.0], &[0.0; 3])).unwrap();
    let events = run(&mut scheme, 5.0);
    assert!(events.len() >= 18);
    for together in events.chunks(3) {
        let [a, b, c] = together else { panic!("{together:?}") };
        assert!((a.time - b.time).abs() <= 1e-14 && (b.time - c.time).abs() <= 1e-14, "{together:?}");
        assert!(a.closes == b.closes && b.closes == c.closes);
    }
}

#[test]
fn a_touch_that_only_grazes_changes_nothing() {
    // Thrown up at speed 1 under g = 1, the ball turns at 1/2, exactly at the ceiling.
    for ceiling in [0.5, 0.5 + 1e-16, 0.5 - 1e-16] {
        let system = balls(1, 1.0, f64::NEG_INFINITY, ceiling);
        let mut scheme = Exact::new(&system, 1e-2, start(&[0.0], &[1.0])).unwrap();
        let events = run(&mut scheme, 2.0);
        assert!(events.len() <= 2, "{events:?}");
        assert!(scheme.displacement()[0].abs() <= 1e-14, "{}", scheme.displacement()[0]);
    }
}

#[test]
fn a_touch_of_less_than_a_nanosecond_is_not_missed() {
    // The ball reaches the ceiling at 4e-9 m/s; gravity takes it back after 2 v / g = 8e-10 s.
    let (gravity, speed, below) = (10.0, 4e-9, 1e-9);
    let system = balls_on_springs(2e12, 1, gravity, f64::NEG_INFINITY, 0.0);
    let thrown = (2.0_f64 * gravity * below + speed * speed).sqrt();
    let mut scheme = Exact::new(&system, 1.0, start(&[-below], &[thrown])).unwrap();
    let events = run(&mut scheme, 1.0);
    let [closes, opens] = events[..] else { panic!("{events:?}") };
    assert!(closes.closes && !opens.closes);
    for (velocity, expected) in [(closes.velocity, speed), (opens.velocity, -speed)] {
        assert!((velocity - expected).abs() <= 1e-4 * speed, "{events:?}");
    }
    assert!((opens.time - closes.time - 2.0 * speed / gravity).abs() <= 1e-4 * speed, "{events:?}");
}

#[test]
fn a_start_at_the_floor() {
    let contact = PI / omega();
    // Thrown down, the ball touches at time 0. Thrown up, it leaves, and nothing happens.
    let system = balls(1, 0.0, 0.0, f64::INFINITY);
    let mut scheme = Exact::new(&system, 1e-3, start(&[0.0], &[-1.0])).unwrap();
    assert!(scheme.take_events().is_empty());
    let events = run(&mut scheme, 0.1);
    let [opens] = events[..] else { panic!("{events:?}") };
    assert!(!opens.closes && (opens.time - contact).abs() <= 1e-14, "{opens:?}");
    let mut scheme = Exact::new(&system, 1e-3, start(&[0.0], &[1.0])).unwrap();
    assert!(run(&mut scheme, 0.1).is_empty());
    assert!((scheme.displacement()[0] - 0.1).abs() <= 1e-14);
    // At rest without a load the ball stays: it neither leaves nor presses.
    let mut scheme = Exact::new(&system, 1.0, start(&[0.0], &[0.0])).unwrap();
    assert!(run(&mut scheme, 100.0).is_empty());
    assert_eq!((scheme.displacement()[0], scheme.reaction()[0]), (0.0, 0.0));
    // At rest under its weight with a slack spring, the ball oscillates about its equilibrium and
    // comes to rest again once per period.
    let system = balls(1, 10.0, 0.0, f64::INFINITY);
    let mut scheme = Exact::new(&system, 2.0 * contact, start(&[0.0], &[0.0])).unwrap();
    assert!(run(&mut scheme, 100.0 * contact).len() <= 100);
    assert!(scheme.displacement()[0].abs() <= 1e-13 && scheme.displacement()[1].abs() <= 1e-13);
}

#[test]
fn a_long_rest_stays_a_rest() {
    let (gravity, sag) = (10.0, MASS * 10.0 / K);
    let system = balls(1, gravity, 0.0, f64::INFINITY);
    let at_rest = Start { displacement: vec![0.0, -sag], velocity: vec![0.0; 2] };
    let mut scheme = Exact::new(&system, 1e3, at_rest).unwrap();
    assert!(run(&mut scheme, 1e6).is_empty());
    assert!((scheme.reaction()[0] - MASS * gravity).abs() <= 1e-12);
    assert!((scheme.displacement()[1] + sag).abs() <= 1e-16);
}

#[test]
fn a_free_plate_thrown_flat_touches_with_all_its_nodes_at_once() {
    let text = concat!(
        "plate = { length = 0.5, width = 0.4, ",
        literal!(PAPER_SECTION),
        r#" }
        mesh = { element = "fvs", cells = [4, 3] }
        obstacle = [{ side = "below", height = -0.05 }, { side = "above", height = 0.08 }]
        initial = { velocity = -2.0 }
        time = { scheme = "exact", mass = "singular", step = 1e-3, end = 0.1 }
    "#
    );
    let scene = Scene::from_str(text, "thrown", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
    let energy = scheme.energies().unwrap().total();
    let mut events = Vec::new();
    for _ in 0..100 {
        scheme.advance().unwrap();
        events.extend(scheme.take_events());
        assert!((scheme.energies().unwrap().total() / energy - 1.0).abs() <= 1e-9, "t = {}", scheme.time());
        assert!(scheme.step_report().kkt <= 1e-10);
    }
    println!("{:?}", scheme.statistics().events);
    let nodes = model.system.bounds.len();
    for (k, event) in events.iter().take(nodes).enumerate() {
        assert!(event.closes && (event.time - 0.025).abs() <= 1e-12, "{k}: {event:?}");
    }
    assert!(
        events.iter().any(|event| event.closes && event.velocity > 0.0),
        "it hits the other obstacle too"
    );
}

#[test]
fn a_free_plate_under_a_load_falls_by_the_law_of_galilei() {
    let text = r#"
        plate = { length = 0.5, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 8000 }
        mesh = { element = "hct", cells = [3, 2] }
        load = { pressure = -800.0 }
        initial = { velocity = 3.0 }
        time = { scheme = "exact", mass = "singular", step = 0.1, end = 2.0 }
    "#;
    let scene = Scene::from_str(text, "fall", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut scheme = Exact::new(&model.system, 0.1, model.start.clone()).unwrap();
    for _ in 0..20 {
        scheme.advance().unwrap();
        let t = scheme.time();
        assert!(scheme.step_report().kkt <= 1e-11, "t = {t}: {:e}", scheme.step_report().kkt);
        for site in &model.sites {
            let error = scheme.displacement()[site.dof] - (3.0 * t - 5.0 * t * t);
            assert!(error.abs() <= 1e-10, "t = {t}: {error:e}");
        }
    }
}

#[test]
fn a_plate_held_all_around_moves_although_no_displacement_gives_its_cells_a_checkerboard() {
    let text = concat!(
        "plate = { length = 1, width = 1, ",
        literal!(PAPER_SECTION),
        r#" }
        mesh = { element = "fvs", cells = [6, 6] }
        support = [
            { edge = "left", kind = "simply_supported" }, { edge = "right", kind = "simply_supported" },
            { edge = "bottom", kind = "simply_supported" }, { edge = "top", kind = "simply_supported" },
        ]
        obstacle = [{ side = "below", height = -1e-3 }]
        initial = { static_pressure = 14600 }
        time = { scheme = "exact", mass = "singular", step = 1e-4, end = 0.02 }
        output = { probes = [{ name = "centre", at = [0.5, 0.5] }] }
    "#
    );
    let scene = |scheme: &str, step: &str| {
        let set = [format!("time.scheme={scheme}"), format!("time.step={step}")];
        Scene::from_str(text, "held", &set).expect("a valid scene")
    };
    let centres = |scene: &Scene, every: u64| -> Vec<f64> {
        let model = Model::new(scene).unwrap();
        let mut scheme = model.scheme(scene).unwrap();
        let energy = scheme.energies().unwrap().total();
        let mut centres = Vec::new();
        while scheme.step() < scene.time.steps() {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt < 1e-11, "{}", scheme.step_report().kkt);
            let drift = scheme.energies().unwrap().total() / energy - 1.0;
            assert!(drift.abs() <= 1e-11, "{drift}");
            if scheme.step().is_multiple_of(every) {
                centres.push(model.probes[0].deflection(scheme.displacement()));
            }
        }
        centres
    };
    let exact = centres(&scene("exact", "1e-4"), 1);
    let rms = |step: &str, every: u64| {
        let other = centres(&scene("conserving", step), every);
        assert_eq!(other.len(), exact.len());
        (exact.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / exact.len() as f64).sqrt()
    };
    // The plate hits the obstacle and rebounds past its flat position, and a finer step of another
    // scheme is nearer to the exact motion.
    assert!(exact.iter().any(|w| *w < -9e-4) && exact[100..].iter().any(|w| *w > 0.0));
    let (coarse, fine) = (rms("1e-5", 10), rms("1e-6", 100));
    assert!(fine < 0.1 * coarse && fine < 1e-6, "{coarse} and {fine} m");
}

#[test]
fn too_many_events_in_a_step_are_an_error_that_says_when_and_where() {
    let system = balls(1, 0.0, -1.0, 1.0);
    let options = ExactOptions { events_per_step: 10, ..ExactOptions::default() };
    let mut scheme = Exact::with_options(&system, 100.0, start(&[0.0], &[3.0]), options).unwrap();
    let error = scheme.advance().unwrap_err();
    assert!(matches!(error, Error::Events { step: 1, count: 10, bound: 0, .. }), "{error}");
    assert_eq!(error.exit_code(), 3);
    let time = 1.0 / 3.0 + 5.0 * (2.0 / 3.0 + PI / omega());
    assert!(error.to_string().contains(&format!("{time:.9}")), "{error}");
}

#[test]
fn without_the_inf_sup_condition_there_is_nothing_to_follow() {
    // With P1 displacements and P0 velocities on a bar, ker B = {0}.
    let cells = 4;
    let engine = Native::new(cells);
    let dofs = |cell: usize| [cell, cell + 1].map(|d| (d < cells).then_some(d));
    let stiffness = engine.form((0..cells).map(|c| block(&dofs(c), &[4.0, -4.0, -4.0, 4.0], 0)).collect());
    let average = |c| SingularMassCell {
        dofs: dofs(c).into(),
        row: [0.125, 0.125].into(),
        mass: 0.25,
        class: CellClass::Plate(0),
    };
    let mass = engine.averages((0..cells).map(average).collect());
    let bounds = Bounds::uniform(vec![0], 0.0, f64::INFINITY);
    let at_rest = Start { displacement: vec![0.5; cells], velocity: vec![0.0; cells] };
    let system = System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: None,
        bounds,
        bound_numbers: None,
        drive: TimeDependence::default(),
    };
    let error = Exact::new(&system, 1.0, at_rest).map(drop).unwrap_err();
    assert!(error.to_string().contains("inf-sup") && error.to_string().contains("newmark"), "{error}");
}

#[test]
fn a_mesh_too_large_for_dense_matrices_is_refused_at_once() {
    let mut scene = falling_plate("fvs", [160, 64], "conserving", 1e-3, 0.1);
    scene.initial.static_pressure = FieldInput::new("initial.static_pressure", 0.0);
    let model = Model::new(&scene).unwrap();
    let error = Exact::new(&model.system, 1e-3, model.start.clone()).map(drop).unwrap_err();
    assert!(error.to_string().contains("10240 cells") && error.to_string().contains("conserving"), "{error}");
}

#[test]
fn a_consistent_mass_is_refused() {
    let mut scene = falling_plate("fvs", [4, 2], "newmark", 1e-3, 0.1);
    scene.time.mass = Mass::Consistent;
    let model = Model::new(&scene).unwrap();
    let error = Exact::new(&model.system, 1e-3, model.start.clone()).map(drop).unwrap_err();
    assert!(error.to_string().contains("singular"), "{error}");
}

/// A ball in flight meets no force, and its row of the balance is the rounding of what the plate
/// does. Over a plate at rest it flies by the law of Galilei.
#[test]
fn a_rigid_ball_flies_over_a_plate_that_is_released() {
    let (cells, modes) = ("mass = \"singular\"", "mass = \"modal\", modes = 8");
    for (mass, pressure) in [(cells, 0), (cells, 1), (modes, 0), (modes, 1)] {
        let text = format!(
            r#"
            {PAPER_PLATE}
            support = [{{ edge = "left", kind = "clamped" }}]
            mesh = {{ element = "fvs", cells = [6, 2] }}
            ball = [{{ at = [1.0, 0.2], mass = 0.5, height = 0.05, velocity = -0.1 }}]
            initial = {{ static_pressure = {pressure} }}
            time = {{ scheme = "exact", {mass}, step = 1e-3, end = 0.1 }}
            output = {{ probes = [{{ name = "ball", ball = 0 }}] }}
            "#
        );
        for scenes::Instant { time, probes, .. } in scenes::run(&text) {
            let expected = 0.05 - 0.1 * time;
            assert!((probes[0] - expected).abs() <= 1e-13, "{mass}: {time} s, {:e}", probes[0]);
        }
    }
}

/// A ball meets a block at an instant of the output, where all forces are rounding, or between two
/// of them: it leaves at the same speed.
#[test]
fn a_rigid_ball_may_meet_a_block_at_an_instant_of_the_output() {
    let speed = |mass: &str, height: f64, step: f64| {
        let text = format!(
            "plate = {{ length = 0.1, width = 0.1, thickness = 0.05, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7800 }}\n\
             {}{}foundation = [{{ stiffness = 1e5 }}]\n\
             ball = [{{ at = [0.05, 0.05], mass = 1.0, height = {height:e}, velocity = -1.0 }}]\n\
             time = {{ scheme = \"exact\", {mass}, step = {step:e}, end = {:e} }}\n\
             output.probes = [{{ name = \"v\", ball = 0, quantity = \"velocity\" }}]\n",
            scenes::all_round("guided"),
            scenes::grid("fvs", 4, 4),
            height + 1e-4,
        );
        scenes::run(&text).last().unwrap().probes[0]
    };
    for mass in ["mass = \"singular\"", "mass = \"modal\", modes = 10"] {
        let [on, between] = [(5e-5, 1e-5), (5.5e-5, 3.1e-5)].map(|(height, step)| speed(mass, height, step));
        assert!((on - between).abs() <= 1e-9 * on.abs(), "{mass}: {on} and {between} m/s");
    }
}

/// Wherever a mass lies in the cells, the exact scheme follows the motion through contact and keeps
/// the energy.
#[test]
fn masses_anywhere_keep_the_energy() {
    for element in ["fvs", "hct"] {
        for at in [[0.9, 0.25], [0.96, 0.2], [0.9, 0.2], [0.887, 0.261], [1.2, 0.4]] {
            let (rows, _) = scenes::run_to_end(&format!(
                "{PAPER_FALL}mesh = {{ element = \"{element}\", cells = [10, 4] }}\nmass = [{{ at = {at:?}, mass = 5 }}]\n\
                 time = {{ scheme = \"exact\", mass = \"singular\", step = 1e-3, end = 0.1 }}\n"
            ));
            assert!(rows.iter().any(|row| row.contact_force > 0.0), "{element}, {at:?}: no contact");
            for row in &rows {
                let change = (row.energy / rows[0].energy - 1.0).abs();
                assert!(change <= 1e-10, "{element}, {at:?}, t = {}: {change:e}", row.time);
            }
        }
    }
}

/// A mass on the corner that hits bounces off in the limit of small cells as with the modal mass.
#[test]
fn a_mass_on_a_node_in_contact_converges() {
    let corner = |cells: [usize; 2], time: &str| {
        let rows = scenes::run(&format!(
            "{PAPER_FALL}mesh = {{ element = \"fvs\", cells = {cells:?} }}\nmass = [{{ at = [1.2, 0.0], mass = 5 }}]\n\
             time = {{ {time}, end = 0.07 }}\noutput = {{ probes = [{{ name = \"corner\", at = [1.2, 0.0] }}] }}\n"
        ));
        assert!(rows.iter().any(|row| row.contact_force > 0.0));
        rows
    };
    let modal = corner([20, 8], "scheme = \"conserving\", mass = \"modal\", modes = 150, step = 2e-6");
    let errors = [[10, 4], [20, 8]].map(|cells| {
        let rows = corner(cells, "scheme = \"exact\", mass = \"singular\", step = 1e-4");
        let squares = rows.iter().zip(modal.iter().step_by(50)).map(|(row, modal)| {
            assert!((row.time - modal.time).abs() <= 1e-12);
            (row.probes[0] - modal.probes[0]).powi(2)
        });
        (squares.sum::<f64>() / rows.len() as f64).sqrt()
    });
    assert!(errors[0] <= 1.2e-3 && errors[1] <= 0.4 * errors[0], "{errors:?} m");
}
