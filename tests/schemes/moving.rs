//! Moving obstacles: laws that hold in every frame, a ball on a shaken table, and an energy balance
//! that holds to rounding.

use crate::common::models::{PAPER_FALL, PAPER_PLATE};
use crate::common::{block, difference};
use rebond::linalg::Native;
use rebond::obstacle::Bounds;
use rebond::scene::Scene;
use rebond::scheme::{Damping, Newmark, NewmarkParameters, Scheme, Solution, Start, System, TimeDependence};
use rebond::simulation::Model;

const MASS: f64 = 2.5;
const GRAVITY: f64 = 9.81;

/// Returns a ball above a floor whose height depends on time.
fn ball(height: impl Fn(f64) -> f64 + 'static) -> System<Native> {
    let engine = Native::new(1);
    let form = |value: f64| engine.form(vec![block(&[Some(0)], &[value], 0)]);
    let (stiffness, mass) = (form(0.0), form(MASS));
    let bounds = Bounds::uniform(vec![0], height(0.0), f64::INFINITY);
    let floor = move |time: f64, bounds: &mut Bounds| {
        bounds.lower[0] = height(time);
        Ok(())
    };
    let drive = TimeDependence { bounds: Some(Box::new(floor)), ..TimeDependence::default() };
    System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: Some(vec![-MASS * GRAVITY]),
        bounds,
        bound_numbers: None,
        drive,
    }
}

fn newmark(
    system: &System<Native>,
    restitution: f64,
    step: f64,
    place: f64,
    speed: f64,
) -> Newmark<'_, Native> {
    let start = Start { displacement: vec![place], velocity: vec![speed] };
    Newmark::new(system, NewmarkParameters { beta: 0.5, restitution, step }, start).unwrap()
}

#[test]
fn a_ball_that_a_floor_lifts_presses_as_newton_says() {
    // The ball never leaves, since the acceleration of the floor stays below that of gravity.
    let (size, frequency) = (0.05, 12.0);
    let height = move |t: f64| size * (1.0 - (frequency * t).cos());
    let system = ball(height);
    for step in [1e-2, 1e-3] {
        let mut scheme = newmark(&system, 0.0, step, 0.0, 0.0);
        let start = scheme.invariant().unwrap();
        for _ in 0..300 {
            scheme.advance().unwrap();
            let t = scheme.time();
            assert!((scheme.displacement()[0] - height(t)).abs() <= 1e-14);
            let acceleration = size * frequency * frequency * (frequency * t).cos();
            let expected = MASS * (GRAVITY + acceleration);
            let tolerance =
                MASS * size * frequency.powi(4) * step * step / 12.0 + 1e-16 * MASS / step.powi(2);
            assert!((scheme.reaction()[0] - expected).abs() <= 1.1 * tolerance, "t = {t}");
        }
        // The ball has the energy that the floor gave it.
        let grown = scheme.invariant().unwrap() - start;
        assert!(grown.abs() <= 1e-12, "{grown:e}");
        let total = scheme.energies().unwrap().total();
        assert!(total.abs() <= 100.0 * step * step, "{total:e}");
    }
}

/// Returns the position of a ball at an instant and its number of bounces, flight by flight: v+ =
/// -e v- + (1 + e) h'.
fn flights(height: impl Fn(f64) -> f64, e: f64, from: f64, end: f64) -> (f64, u32) {
    let (mut time, mut place, mut speed, mut bounces) = (0.0, from, 0.0, 0);
    loop {
        let at = |t: f64| place + speed * (t - time) - 0.5 * GRAVITY * (t - time).powi(2);
        let gap = |t: f64| at(t) - height(t);
        // No gap opens and closes within this interval.
        let look = 1e-4;
        let mut next = time + look;
        while gap(next) >= 0.0 && next < end {
            next += look;
        }
        if next >= end {
            return (at(end), bounces);
        }
        let (mut before, mut after) = (next - look, next);
        for _ in 0..60 {
            let middle = 0.5 * (before + after);
            if gap(middle) >= 0.0 { before = middle } else { after = middle }
        }
        let rate = (height(after + 1e-6) - height(after - 1e-6)) / 2e-6;
        let arriving = speed - GRAVITY * (after - time);
        (place, speed, time) = (height(after), (1.0 + e) * rate - e * arriving, after);
        bounces += 1;
    }
}

#[test]
fn a_ball_on_a_table_that_shakes_bounces_by_the_law_of_restitution() {
    let height = |t: f64| 0.02 * (25.0 * t).sin();
    let system = ball(height);
    for e in [0.6, 0.9, 1.0] {
        let (expected, bounces) = flights(height, e, 0.5, 1.2);
        let errors = [1e-3, 1e-4, 1e-5].map(|step: f64| {
            let mut scheme = newmark(&system, e, step, 0.5, 0.0);
            for _ in 0..(1.2 / step).round() as usize {
                scheme.advance().unwrap();
                assert!(scheme.admissible()[0] >= scheme.limits().lower[0] - 1e-15);
            }
            (scheme.displacement()[0] - expected).abs()
        });
        println!("e = {e}, {bounces} bounces: {errors:?}");
        assert!(bounces >= 2);
        // The error of a bounce is a fraction of a step.
        for (error, step) in errors.iter().zip([1e-3, 1e-4, 1e-5]) {
            assert!(*error <= 50.0 * step, "e = {e}: {errors:?}");
        }
    }
}

/// Returns a free plate thrown down onto an obstacle, both carried along at a speed.
fn thrown(scheme: &str, carried: f64) -> (Scene, Model) {
    let text = format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "fvs", cells = [6, 2] }}
        obstacle = [{{ side = "below", height = -0.02 }}, {{ side = "above", height = 0.03 }}]
        load = {{ pressure = -762.2 }}
        initial = {{ velocity = {:?} }}
        time = {{ {scheme}, mass = "singular", step = 2e-4, end = 0.1 }}
        "#,
        carried - 1.0
    );
    let scene = Scene::from_str(&text, "thrown", &[]).expect("a valid scene");
    let mut model = Model::new(&scene).unwrap();
    let at_rest = model.system.bounds.clone();
    model.system.drive.bounds = Some(Box::new(move |time: f64, bounds: &mut Bounds| {
        bounds
            .lower
            .iter_mut()
            .zip(&at_rest.lower)
            .for_each(|(own, at_rest)| *own = at_rest + carried * time);
        bounds
            .upper
            .iter_mut()
            .zip(&at_rest.upper)
            .for_each(|(own, at_rest)| *own = at_rest + carried * time);
        Ok(())
    }));
    // The plate rotates a little, so that not all nodes land at once.
    let tilts: Vec<(usize, f64)> =
        model.sites.iter().map(|site| (site.dof, 0.5 * site.at[0] + 0.2 * site.at[1])).collect();
    for (dof, tilt) in tilts {
        model.start.velocity[dof] += tilt;
    }
    (scene, model)
}

#[test]
fn a_plate_and_obstacles_that_are_carried_along_move_as_at_rest() {
    for (scheme, tolerance) in [
        (r#"scheme = "newmark", restitution = 0"#, 1e-10),
        (r#"scheme = "newmark", restitution = 0.5"#, 1e-10),
        (r#"scheme = "newmark", restitution = 1"#, 1e-10),
        (r#"scheme = "midpoint", massless = "reflected""#, 1e-9),
        (r#"scheme = "midpoint""#, 1e-9),
        (r#"scheme = "conserving""#, 1e-9),
    ] {
        let carried = 3.0;
        let [(scene, still), (_, moves)] = [thrown(scheme, 0.0), thrown(scheme, carried)];
        let [mut a, mut b] = [&still, &moves].map(|model| model.scheme(&scene).unwrap());
        let (mut worst, mut contacts) = (0.0f64, 0);
        for _ in 0..scene.time.steps() {
            a.advance().unwrap();
            b.advance().unwrap();
            let mut back = b.displacement().to_vec();
            for site in &moves.sites {
                back[site.dof] -= carried * b.time();
            }
            worst = worst.max(difference(a.displacement(), &back));
            contacts += u32::from(a.reaction().iter().any(|r| *r != 0.0));
            assert!(b.step_report().kkt <= 1e-10);
        }
        println!("{scheme}: {worst:.1e} m apart, {contacts} steps in contact");
        assert!(worst <= tolerance && contacts > 5, "{scheme}: {worst:e}, {contacts}");
    }
}

/// Returns the paper's plate at rest under 14600 Pa above a shaken obstacle.
fn shaken(element: &str, scheme: &str, step: f64) -> (Scene, Model) {
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "{element}", cells = [10, 4] }}
        time = {{ {scheme}, mass = "singular", step = {step:e}, end = 0.3 }}
        output = {{ probes = [{{ name = "corner", at = [1.2, 0] }}] }}
        "#
    );
    let scene = Scene::from_str(&text, "shaken", &[]).expect("a valid scene");
    let mut model = Model::new(&scene).unwrap();
    model.system.drive.bounds = Some(Box::new(|time: f64, bounds: &mut Bounds| {
        bounds.lower.fill(-0.1 + 0.02 * (60.0 * time).sin());
        Ok(())
    }));
    (scene, model)
}

#[test]
fn conserving_balances_the_work_of_an_obstacle_that_shakes() {
    for (element, step, damping) in
        [("fvs", 1e-4, 0.0), ("hct", 1e-4, 0.0), ("fvs", 1e-3, 0.0), ("fvs", 1e-4, 5.0)]
    {
        let (scene, mut model) = shaken(element, r#"scheme = "conserving""#, step);
        model.system.damping.mass = damping;
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let (mut worst, mut contacts) = (0.0f64, 0);
        for _ in 0..(0.5 / step).round() as usize {
            scheme.advance().unwrap();
            let energies = scheme.energies().unwrap();
            let balance = energies.total() + scheme.statistics().relaxation.unwrap().dissipated - start;
            worst = worst.max(balance.abs() / start.max(energies.work.abs()));
            contacts += u32::from(scheme.reaction().iter().any(|r| *r != 0.0));
            assert!(scheme.limits().violation(scheme.displacement()) <= 1e-12, "t = {}", scheme.time());
            assert!(scheme.step_report().kkt <= 1e-10);
        }
        let (relaxation, work) = (scheme.statistics().relaxation.unwrap(), scheme.energies().unwrap().work);
        println!("{element}, {step:e} s: {worst:.1e}, {work} J given, {contacts} in contact, {relaxation:?}");
        assert!(worst <= 1e-11, "{element}, {step:e}: {worst:e}");
        assert!(contacts > 5 && work.abs() > 0.1, "{contacts}, {work}");
    }
}

#[test]
fn all_schemes_tend_to_one_motion_over_an_obstacle_that_shakes() {
    // The comparison covers the first impact, at 0.055 s.
    let corner = |scheme: &str, step: f64| {
        let (scene, model) = shaken("fvs", scheme, step);
        let mut scheme = model.scheme(&scene).unwrap();
        for _ in 0..(0.065 / step).round() as usize {
            scheme.advance().unwrap();
        }
        model.probes[0].deflection(scheme.displacement())
    };
    let truth = corner(r#"scheme = "conserving""#, 5e-7);
    for scheme in [
        r#"scheme = "newmark", restitution = 0"#,
        r#"scheme = "newmark", restitution = 1"#,
        r#"scheme = "midpoint", massless = "reflected""#,
        r#"scheme = "midpoint""#,
        r#"scheme = "conserving""#,
    ] {
        let [coarse, fine] = [2e-5, 2.5e-6].map(|step| (corner(scheme, step) - truth).abs());
        println!("{scheme}: {coarse:.1e} and {fine:.1e} m");
        assert!(fine <= coarse / 3.0 && fine <= 3e-5, "{scheme}: {coarse:e} and {fine:e}");
    }
}
