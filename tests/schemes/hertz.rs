//! Stops by the law of Hertz, compared with closed forms of an impact and of statics, balances of
//! energy and momentum, and the rigid obstacle as their limit.
//!
//! A mass m that meets a stop r = k d^{3/2} with a speed v keeps m v^2 / 2 + (2/5) k d^{5/2}
//! (Timoshenko and Goodier, *Theory of Elasticity*, 1970, section 141; Johnson, *Contact
//! Mechanics*, 1985, section 11.4). It goes down to d = (5 m v^2 / (4 k))^{2/5} under a force of k
//! d^{3/2}, leaves after the time T = (4/5) sqrt(pi) Gamma(2/5) / Gamma(9/10) d / v, and receives
//! the impulse 2 m v.

use crate::common::block;
use crate::common::models::{CLAMPED, PAPER_PLATE, PAPER_START};
use crate::common::scenes::{STILL, all_round, close, grid, model, run, run_to_end, scene, start};
use rebond::contact_law::{Hertz, Laws, RIGID};
use rebond::linalg::vectors::axpy;
use rebond::linalg::{Engine, Native};
use rebond::obstacle::Bounds;
use rebond::scheme::{
    Damping, Massless, Midpoint, Newmark, NewmarkParameters, Scheme, Start, System, TimeDependence,
    equilibrium, equilibrium_on_bounds,
};
use rebond::simulation::Model;
use rebond::vi::condensed::DENSE_LIMIT;
use std::sync::Arc;

const MASS: f64 = 0.3;
const STIFFNESS: f64 = 2e6;
const SPEED: f64 = 1.5;

/// Gamma(2/5) and Gamma(9/10), Abramowitz and Stegun's function to 16 digits.
const GAMMA: [f64; 2] = [2.218_159_543_757_688, 1.068_628_702_119_319_3];

fn deepest(mass: f64, stiffness: f64, speed: f64) -> f64 {
    (1.25 * mass * speed * speed / stiffness).powf(0.4)
}

fn duration(mass: f64, stiffness: f64, speed: f64) -> f64 {
    0.8 * std::f64::consts::PI.sqrt() * GAMMA[0] / GAMMA[1] * deepest(mass, stiffness, speed) / speed
}

/// Returns a mass above (side 0) or below (side 1) a stop at 0.
fn system(side: usize) -> System<Native> {
    let engine = Native::new(1);
    let form = |value: f64| engine.form(vec![block(&[Some(0)], &[value], 0)]);
    let (stiffness, mass) = (form(0.0), form(MASS));
    let limits = [[0.0, f64::INFINITY], [f64::NEG_INFINITY, 0.0]][side];
    let mut bounds = Bounds::uniform(vec![0], limits[0], limits[1]);
    let mut numbers = [RIGID; 2];
    numbers[side] = 0;
    bounds.laws = Laws::new(vec![Arc::new(Hertz(STIFFNESS))], vec![numbers]);
    System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: None,
        bounds,
        bound_numbers: None,
        drive: TimeDependence::default(),
    }
}

/// Returns the scheme called `name` of a mass that is at the stop with the speed v.
fn one_mass<'s>(name: &str, system: &'s System<Native>, side: usize, step: f64) -> Box<dyn Scheme + 's> {
    let velocity = vec![[-SPEED, SPEED][side]];
    let start = Start { displacement: vec![0.0], velocity };
    let newmark = |restitution| NewmarkParameters { beta: 0.5, restitution, step };
    match name {
        "midpoint" => Box::new(Midpoint::new(system, step, Massless::Reflected, start).unwrap()),
        "newmark" => Box::new(Newmark::new(system, newmark(0.0), start).unwrap()),
        _ => Box::new(Newmark::new(system, newmark(1.0), start).unwrap()),
    }
}

/// Observed impact of a mass on a stop.
#[derive(Default)]
struct Seen {
    depth: f64,
    force: f64,
    impulse: f64,
    /// End of the contact, in s.
    end: f64,
    /// Error of the place after the impact, relative to the depth.
    place: f64,
}

/// Steps a scheme through an impact, in steps of a length (s), towards a side.
fn impact(scheme: &mut dyn Scheme, side: usize, steps: usize) -> Seen {
    let sign = [1.0, -1.0][side];
    let mut seen = Seen::default();
    for _ in 0..steps {
        scheme.advance().unwrap();
        assert!(scheme.step_report().kkt <= 1e-12, "{:e}", scheme.step_report().kkt);
        let force = sign * scheme.reaction()[0];
        assert!(force >= 0.0, "the stop pulls: {force}");
        seen.depth = seen.depth.max(-sign * scheme.displacement()[0]);
        seen.force = seen.force.max(force);
        seen.impulse += sign * scheme.impulses()[0];
        seen.end = if force > 0.0 { scheme.time() } else { seen.end };
    }
    let place = SPEED * (scheme.time() - duration(MASS, STIFFNESS, SPEED));
    seen.place = (sign * scheme.displacement()[0] - place).abs() / deepest(MASS, STIFFNESS, SPEED);
    seen
}

/// Depth, force, duration and impulse are those of the closed form, and the place after the impact
/// converges at the order of the scheme.
#[test]
fn an_impact_is_that_of_the_closed_form() {
    let (depth, time) = (deepest(MASS, STIFFNESS, SPEED), duration(MASS, STIFFNESS, SPEED));
    for side in [0, 1] {
        let system = system(side);
        for (name, order, tolerance) in
            [("newmark", 1.0, 4e-3), ("newmark e=1", 2.0, 5e-6), ("midpoint", 2.0, 2e-6)]
        {
            let mut errors = Vec::new();
            for steps in [400, 800, 1600] {
                let step = 1.5 * time / f64::from(steps);
                let mut scheme = one_mass(name, &system, side, step);
                let seen = impact(scheme.as_mut(), side, steps as usize);
                errors.push(seen.place);
                assert!((seen.end - time).abs() <= 1.5 * step, "{name}: {} for {time}", seen.end);
                if steps == 1600 {
                    close(&format!("{name}: depth"), seen.depth, depth, tolerance);
                    close(&format!("{name}: force"), seen.force, STIFFNESS * depth.powf(1.5), tolerance);
                    close(&format!("{name}: impulse"), seen.impulse, 2.0 * MASS * SPEED, tolerance);
                }
            }
            for pair in errors.windows(2) {
                let found = (pair[0] / pair[1]).log2();
                assert!((found - order).abs() <= 0.1, "{name}: order {found}: {errors:?}");
            }
        }
    }
}

/// Returns a ball that hits the clamped edge of a plate, with 500 steps to 1.25 times the duration
/// of the contact.
fn ball(stiffness: f64, steps: u32, scheme: &str) -> String {
    let end = 1.25 * duration(MASS, stiffness, SPEED);
    let mesh = grid("fvs", 4, 2);
    format!(
        "{PAPER_PLATE}{CLAMPED}{mesh}ball = [{{ at = [0, 0.2], mass = {MASS}, height = 0, velocity = -{SPEED}, \
         law = \"hertz\", stiffness = {stiffness:e} }}]\noutput.probes = [{{ name = \"ball\", ball = 0 }}]\n\
         time = {{ {scheme}, step = {:e}, end = {end:e} }}\n",
        end / f64::from(steps)
    )
}

/// Returns the errors of the place of a ball after it bounced off the clamped edge, relative to the
/// depth of the contact, with 250 and 500 steps. Depth and force are asserted to be those of the
/// closed form, and the energy to be kept to a tolerance.
pub fn errors_of_bounces(stiffness: f64, scheme: &str, energy: f64) -> [f64; 2] {
    let [depth, time] = [deepest, duration].map(|of| of(MASS, stiffness, SPEED));
    [250, 500].map(|steps| {
        let rows = run(&ball(stiffness, steps, scheme));
        let what = format!("{stiffness:e}, {scheme}, {steps}");
        close(&what, -rows.iter().fold(0.0, |least: f64, row| least.min(row.probes[0])), depth, 1e-3);
        let force = rows.iter().fold(0.0, |most: f64, row| most.max(row.contact_force));
        close(&what, force, stiffness * depth.powf(1.5), 1e-3);
        for row in &rows {
            close(&what, row.energy, rows[0].energy, energy);
        }
        let last = rows.last().unwrap();
        (last.probes[0] - SPEED * (last.time - time)).abs() / depth
    })
}

/// A ball bounces off the clamped edge as the closed form says; `conserving` keeps its energy. With
/// the singular mass the ball must not vibrate on the stop far faster than the plate.
#[test]
fn a_ball_bounces_off_a_held_point() {
    for stiffness in [1e3, 1e6, 1e9, 1e12, 1e15] {
        for (scheme, energy) in [
            ("scheme = \"conserving\", mass = \"singular\"", 1e-12),
            ("scheme = \"midpoint\", mass = \"singular\"", 1e-4),
            ("scheme = \"midpoint\", mass = \"consistent\"", 1e-4),
            ("scheme = \"newmark\", mass = \"consistent\", restitution = 1", 2e-4),
        ] {
            if stiffness > 1e12 && scheme.contains("singular") {
                continue;
            }
            let errors = errors_of_bounces(stiffness, scheme, energy);
            let order = (errors[0] / errors[1]).log2();
            assert!((order - 2.0).abs() <= 0.3, "{stiffness:e}, {scheme}: order {order}: {errors:?}");
        }
    }
}

/// Scene of the paper's plate, released between two stops, with a scheme.
pub fn between_pins(stiffness: f64, time: &str) -> String {
    let law = format!("law = \"hertz\", stiffness = {stiffness:e}");
    let mesh = grid("fvs", 10, 4);
    format!(
        "{PAPER_START}{mesh}obstacle = [{{ side = \"below\", height = -0.1, at = [1.2, 0], {law} }}, \
         {{ side = \"above\", height = 0.15, at = [0.6, 0.2], {law} }}]\ntime = {{ {time} }}\n\
         output = {{ every = 1, probes = [{{ name = \"corner\", at = [1.2, 0] }}] }}\n"
    )
}

/// Asserts that `conserving` with a mass keeps its energy for 2 s between stops of any stiffness.
pub fn assert_energy_is_kept(mass: &str) {
    for stiffness in [1e3, 1e6, 1e9, 1e12, 1e15] {
        let time = format!("scheme = \"conserving\", {mass}, step = 1e-4, end = 2");
        let (rows, outcome) = run_to_end(&between_pins(stiffness, &time));
        assert!(outcome.contact_steps > 0 && outcome.worst_penetration == 0.0);
        let start = rows[0].energy;
        let drift = rows.iter().fold(0.0, |worst: f64, row| worst.max((row.energy / start - 1.0).abs()));
        println!("{stiffness:e}: drift {drift:e}, kkt {:e}", outcome.worst_kkt);
        assert!(drift <= 1e-12, "{stiffness:e}: {drift:e}");
        assert!(outcome.worst_kkt <= 1e-12, "{stiffness:e}: {:e}", outcome.worst_kkt);
    }
}

#[test]
fn the_conserving_scheme_keeps_the_energy_for_two_seconds() {
    assert_energy_is_kept("mass = \"singular\"");
}

/// Asserts that the invariant of Newmark's scheme with e = 0 never rises, at steps far above those
/// that resolve the contact, whatever the stiffness of the stops.
pub fn assert_invariant_never_rises(mass: &str) {
    for stiffness in [1e3, 1e7, 1e11, 1e15] {
        let time = format!("scheme = \"newmark\", {mass}, step = 5e-4, end = 0.3");
        let scene = scene(&between_pins(stiffness, &time));
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let (mut before, mut forces) = (scheme.invariant().unwrap(), 0);
        assert!(before <= start * (1.0 + 1e-9), "{before} from {start}");
        for _ in 0..scene.time.steps() {
            scheme.advance().unwrap();
            let now = scheme.invariant().unwrap();
            assert!(now <= before + 1e-12 * start, "{stiffness:e}, {mass}: {now} after {before}");
            before = now;
            forces += usize::from(scheme.reaction().iter().any(|r| *r != 0.0));
        }
        assert!(forces > 0);
    }
}

#[test]
fn the_invariant_of_newmark_never_rises() {
    assert_invariant_never_rises("mass = \"singular\"");
    assert_invariant_never_rises("mass = \"consistent\"");
}

/// All schemes converge to one motion through several contacts.
#[test]
fn schemes_agree() {
    let corner = |time: &str| {
        let rows = run(&between_pins(1e7, &format!("{time}, mass = \"singular\", end = 0.07")));
        rows.last().unwrap().probes[0]
    };
    let reference = corner("scheme = \"conserving\", step = 2e-6");
    for (scheme, tolerance) in [
        ("scheme = \"conserving\", step = 5e-6", 2e-7),
        ("scheme = \"midpoint\", step = 5e-6", 2e-7),
        ("scheme = \"midpoint\", massless = \"reflected\", step = 5e-6", 2e-7),
        ("scheme = \"newmark\", restitution = 1, step = 5e-6", 5e-7),
        ("scheme = \"newmark\", step = 5e-6", 1e-4),
    ] {
        let error = (corner(scheme) - reference).abs();
        assert!(error <= tolerance, "{scheme}: {error:e}");
    }
}

/// A load F presses a mass on a spring K down by d where F = K d + k d^{3/2}; without the spring
/// the stop alone bears it, and d = (F / k)^{2/3}.
#[test]
fn statics_of_one_mass() {
    for side in [0, 1] {
        let sign = [-1.0, 1.0][side];
        for stiffness in [1e3, 1e6, 1e9, 1e15] {
            let mut system = system(side);
            system.bounds.laws.rate = (stiffness / STIFFNESS).powf(2.0 / 3.0);
            for depth in [1e-9, 1e-5, 0.01] {
                let force = stiffness * f64::powf(depth, 1.5);
                let form = |value: f64| system.engine.form(vec![block(&[Some(0)], &[value], 0)]);
                let spring = form(7e4);
                let load = [sign * (7e4 * depth + force)];
                let (u, r, report) = equilibrium(&system.engine, &spring, &load, &system.bounds).unwrap();
                assert!(report.kkt <= 1e-13);
                close("depth on a spring", sign * u[0], depth, 1e-12);
                close("force on a spring", -sign * r[0], force, 1e-11);
                let (none, hold) = (form(0.0), form(10.0));
                let load = [sign * force];
                let (u, r, report) =
                    equilibrium_on_bounds(&system.engine, &none, &hold * 1.0, &load, &system.bounds).unwrap();
                assert!(report.kkt <= 1e-12, "{:e}", report.kkt);
                close("depth", sign * u[0], depth, 1e-9);
                close("force", -sign * r[0], force, 1e-9);
            }
        }
    }
}

/// A plate whose edges are guided rests on a stop in its middle, which bears its weight.
#[test]
fn a_plate_rests_on_a_point() {
    for (stiffness, pressure) in [(1e3, -20.0), (1e6, -20.0), (1e12, -20.0), (1e6, 20.0)] {
        let side = if pressure < 0.0 { "below" } else { "above" };
        let guided = all_round("guided");
        let text = format!(
            "{PAPER_PLATE}{guided}{}obstacle = [{{ side = \"{side}\", height = 0.05, at = [0.6, 0.2], law = \"hertz\", \
             stiffness = {stiffness:e} }}]\ninitial = {{ static_pressure = {pressure:?} }}\n{STILL}\
             output.probes = [{{ name = \"middle\", at = [0.6, 0.2] }}]\n",
            grid("fvs", 6, 4)
        );
        let force = f64::abs(pressure) * 1.2 * 0.4;
        let depth = (force / stiffness).powf(2.0 / 3.0);
        let found = pressure.signum() * (start(&text)[0] - 0.05);
        assert!((found - depth).abs() <= 1e-9 * depth + 1e-13, "{stiffness:e}: {found} for {depth}");
    }
}

/// A static start presses stops beside a rigid obstacle, which the free plate would cross at more
/// nodes than a dense problem takes. The force at each stop is that of its law, and all other rows
/// are in equilibrium to rounding.
#[test]
fn a_static_start_presses_stops_beside_wide_contact() {
    let plate = format!("{PAPER_PLATE}{CLAMPED}{}", grid("fvs", 60, 20));
    let load = format!("initial.equilibrium = true\nload.pressure = -14600\n{STILL}");
    let obstacles = "obstacle = [{ side = \"below\", height = -0.005, where = \"x < 1.1\" }, \
         { side = \"below\", height = -0.0025, at = [1.2, 0.2], law = \"hertz\", stiffness = 1e7 }, \
         { side = \"below\", height = -0.001, at = [1.2, 0], law = \"hertz\", stiffness = 1e9 }]\n";
    let free = model(&[&*plate, &load].concat()).start.displacement;
    let Model { system, start, .. } = model(&[&*plate, obstacles, &load].concat());
    let (bounds, load, u) = (&system.bounds, system.load.as_ref().unwrap(), &start.displacement);
    let (mut force, mut terms) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    system.engine.multiply_with_magnitude(&(&system.stiffness).into(), u, [&mut force, &mut terms]).unwrap();
    axpy(-1.0, load, &mut force);
    let crossed = bounds.dofs.iter().zip(&bounds.lower).filter(|(dof, lower)| free[**dof] < **lower);
    assert!(crossed.count() > DENSE_LIMIT);
    let (mut stops, mut nodes) = (0, 0);
    for (i, &dof) in bounds.dofs.iter().enumerate() {
        if bounds.laws.get(i, 0).is_some() {
            close("force of a stop", force[dof], bounds.reaction(i, u[dof]), 1e-9);
            stops += 1;
        } else if u[dof] <= bounds.lower[i] + 1e-15 {
            assert!(force[dof] >= -1e-12 * terms[dof], "the obstacle pulls: {:e}", force[dof]);
            nodes += 1;
        } else {
            continue;
        }
        force[dof] = 0.0;
    }
    assert!(stops == 2 && nodes > 0, "{stops} stops, {nodes} nodes");
    assert!(bounds.violation(u) <= 1e-15);
    for (dof, (force, terms)) in force.iter().zip(&terms).enumerate() {
        assert!(force.abs() <= 1e-12 * (terms + load[dof].abs()), "dof {dof}: {force:e} of {terms:e}");
    }
}

/// Stiff stops converge to the rigid obstacle at the order 2/3 in 1/k.
#[test]
fn a_stiff_stop_is_a_rigid_obstacle() {
    let middle = |law: &str| {
        let text = format!(
            "{PAPER_PLATE}{CLAMPED}{}obstacle = [{{ side = \"below\", height = -0.01, at = [1.2, 0.2]{law} }}]\n\
             initial = {{ static_pressure = -14600 }}\n{STILL}output.probes = [{{ name = \"middle\", at = [0.9, 0.2] }}]\n",
            grid("fvs", 10, 4)
        );
        start(&text)[0]
    };
    let rigid = middle("");
    let error = |power: i32| (middle(&format!(", law = \"hertz\", stiffness = 1e{power}")) - rigid).abs();
    let errors: Vec<f64> = (9..=13).map(error).collect();
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log10();
        assert!((order - 2.0 / 3.0).abs() <= 0.01, "order {order} in 1/k: {errors:?}");
    }
}

/// A ball without load flies at constant velocity while the plate hits an obstacle, with or without
/// a contact law: its row of the equilibrium has neither stiffness nor force.
#[test]
fn a_ball_far_from_the_plate_flies_on() {
    for law in ["", ", law = \"hertz\", stiffness = 1e9"] {
        let text = format!(
            "{PAPER_START}{}obstacle = [{{ side = \"below\", height = -0.1 }}]\n\
             ball = [{{ at = [0.61, 0.22], mass = 0.5, height = 0.9, velocity = -0.3{law} }}]\n\
             time = {{ scheme = \"conserving\", mass = \"singular\", step = 1e-4, end = 0.07 }}\n\
             output.probes = [{{ name = \"ball\", ball = 0 }}]\n",
            grid("fvs", 10, 4)
        );
        let (rows, outcome) = run_to_end(&text);
        assert!(outcome.contact_steps > 0 && outcome.worst_kkt <= 1e-12, "{:e}", outcome.worst_kkt);
        let last = rows.last().unwrap();
        assert!((last.probes[0] - (0.9 - 0.3 * last.time)).abs() <= 1e-12);
    }
}
