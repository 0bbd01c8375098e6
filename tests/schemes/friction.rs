//! Friction of obstacles: a rotating mass in closed form, on a belt too, and in plates the ledger,
//! the limits of the coefficient, mirrored scenes, and balance of moments.
//!
//! A rotating inertia I on a spring k that rubs with the moment M = mu N h/2 moves in half periods
//! of undamped vibration about `±M/k`: each turning point is 2 M/k nearer to 0, until one lies
//! within M/k of 0, where it stays (den Hartog, *Mechanical Vibrations*, 1956, section 8.4). On a
//! belt it sticks until the spring takes all of M, and then vibrates about M/k without loss.

use crate::common::block;
use crate::common::scenes::{Instant, grid, inspect, run, run_to_end, same, scene};
use rebond::linalg::Native;
use rebond::obstacle::Bounds;
use rebond::scheme::{
    ContactFriction, Damping, FrictionalNode, FrictionalSide, Massless, Midpoint, Newmark, NewmarkParameters,
    Scheme, Solution, Start, System, TimeDependence,
};
use rebond::simulation::{self, Model};
use std::f64::consts::PI;

const INERTIA: f64 = 0.02;
const SPRING: f64 = 300.0;
const WEIGHT: f64 = 40.0;
const COEFFICIENT: f64 = 0.3;
const ARM: f64 = 0.005;
const MOMENT: f64 = COEFFICIENT * WEIGHT * ARM;

/// Returns a mass that its weight presses on an obstacle below or above, with the same rotating
/// inertia and spring about both axes; the obstacle moves at a velocity (m/s).
fn system(side: usize, velocity: [f64; 2]) -> System<Native> {
    let engine = Native::new(3);
    let form = |w: f64, slope: f64| {
        let one = |dof: usize, value: f64| block(&[Some(dof)], &[value], dof);
        engine.form(vec![one(0, w), one(1, slope), one(2, slope)])
    };
    let (stiffness, mass) = (form(1e4, SPRING), form(0.5, INERTIA));
    let limits = if side == 0 { [0.0, f64::INFINITY] } else { [f64::NEG_INFINITY, 0.0] };
    let bounds = Bounds::uniform(vec![0], limits[0], limits[1]);
    let friction = FrictionalSide { obstacle: 0, coefficient: COEFFICIENT, arm: ARM };
    let mut sides = [None; 2];
    sides[side] = Some(friction);
    let node = FrictionalNode { bound: 0, slopes: [Some((1, 1.0)), Some((2, 1.0))], sides };
    let friction = ContactFriction {
        nodes: vec![node],
        obstacles: 1,
        path: Some(Box::new(move |_, _, [from, to]: [f64; 2]| Ok(velocity.map(|v| (to - from) * v)))),
    };
    System {
        engine,
        stiffness,
        mass,
        damping: Damping::default(),
        load: Some(vec![if side == 0 { -WEIGHT } else { WEIGHT }, 0.0, 0.0]),
        bounds,
        bound_numbers: None,
        drive: TimeDependence { friction: Some(friction), ..TimeDependence::default() },
    }
}

/// Returns the scheme called `name` of a mass that is let go from slopes.
fn started<'s>(name: &str, system: &'s System<Native>, step: f64, slopes: [f64; 2]) -> Box<dyn Scheme + 's> {
    let start = Start { displacement: vec![0.0, slopes[0], slopes[1]], velocity: vec![0.0; 3] };
    match name {
        "newmark" => {
            let parameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step };
            Box::new(Newmark::new(system, parameters, start).unwrap())
        }
        _ => Box::new(Midpoint::new(system, step, Massless::Reflected, start).unwrap()),
    }
}

fn period() -> f64 {
    2.0 * PI * (INERTIA / SPRING).sqrt()
}

/// In any direction, since the law is one for the length of a moment, not for its components.
#[test]
fn a_rotating_mass_loses_4_m_over_k_per_period_and_stops() {
    let begin = 10.7;
    for (name, side) in [("newmark", 0), ("newmark", 1), ("midpoint", 0), ("midpoint", 1)] {
        let system = system(side, [0.0; 2]);
        for angle in [0.0, 0.5 * PI, 0.7] {
            let direction = [f64::cos(angle), f64::sin(angle)];
            let errors = [400.0, 800.0, 1600.0].map(|steps| {
                let from = direction.map(|part| part * begin * MOMENT / SPRING);
                let mut scheme = started(name, &system, period() / steps, from);
                let mut places = Vec::new();
                while scheme.time() < 7.0 * period() {
                    let u = scheme.displacement();
                    let across = u[1] * direction[1] - u[2] * direction[0];
                    assert!(across.abs() < 1e-12 * begin * MOMENT / SPRING);
                    places.push((u[1] * direction[0] + u[2] * direction[1]) * SPRING / MOMENT);
                    scheme.advance().unwrap();
                    assert!(scheme.step_report().kkt < 1e-12, "{name}: {:e}", scheme.step_report().kkt);
                }
                places.dedup();
                let turns = |w: &&[f64]| (w[1] - w[0]) * (w[2] - w[1]) < 0.0;
                let points: Vec<f64> = places.windows(3).filter(turns).map(|w| w[1]).collect();
                let exact = (1..=5).map(|k| (begin - 2.0 * f64::from(k)) * (-1.0_f64).powi(k));
                let last = places[places.len() - 1];
                let last = (exact.clone().next_back().unwrap() - last).abs();
                assert!(points.len() >= 4, "{name}: {points:?}");
                exact.zip(points).map(|(exact, point)| (exact - point).abs()).fold(last, f64::max)
            });
            assert!(errors[0] < 5e-3 && errors[2] < 0.1 * errors[0], "{name}: {errors:?}");
        }
    }
}

/// Let go against the motion of the belt, the mass slips, sticks, and vibrates about M/k for ever,
/// touching the velocity of the belt once in each period.
#[test]
fn a_mass_on_a_belt_sticks_and_slips_as_its_closed_form() {
    let reach = MOMENT / SPRING;
    let omega = 2.0 * PI / period();
    for (name, side) in [("newmark", 0), ("midpoint", 0), ("midpoint", 1)] {
        let rate = 3.8 * omega * reach;
        // The face above the middle plane moves against the slope.
        let belt = if side == 0 { rate * ARM } else { -rate * ARM };
        let system = system(side, [belt, 0.0]);
        let sticks_at = (rate / (4.0 * omega * reach)).asin() / omega;
        let stuck = reach * (1.0 - 4.0 * (omega * sticks_at).cos());
        let slips_at = sticks_at + (reach - stuck) / rate;
        let exact = |t: f64| match t {
            t if t < sticks_at => reach * (1.0 - 4.0 * (omega * t).cos()),
            t if t < slips_at => stuck + rate * (t - sticks_at),
            t => reach + rate / omega * (omega * (t - slips_at)).sin(),
        };
        let errors = [400.0, 1600.0].map(|steps| {
            let mut scheme = started(name, &system, period() / steps, [-3.0 * reach, 0.0]);
            let mut error = 0.0_f64;
            while scheme.time() < slips_at + 0.9 * period() {
                error = error.max((scheme.displacement()[1] - exact(scheme.time())).abs() / reach);
                scheme.advance().unwrap();
                let node = scheme.friction_at_nodes()[0];
                let (t, margin) = (scheme.time(), 2.0 * period() / steps);
                let is_stuck = t > sticks_at + margin && t < slips_at - margin;
                let is_loose = t < sticks_at - margin || t > slips_at + margin;
                // The midpoint rule turns the velocity round about that of the belt in each step.
                assert!(!is_stuck || node.sticks || name == "midpoint", "{name}: {t}");
                assert!(!is_loose || !node.sticks && (node.moment[0].abs() / MOMENT - 1.0).abs() < 1e-9);
            }
            error
        });
        assert!(errors[0] < 0.03 && errors[1] < 0.35 * errors[0], "{name}: {errors:?}");
    }
}

/// Returns energy with work and heat at the ends of a run, relative to the largest heat: of the
/// midpoint rule at instants, of Newmark's scheme between them.
fn ledger(name: &str, scheme: &mut dyn Scheme, steps: usize) -> f64 {
    let heat = |scheme: &dyn Scheme| scheme.dissipated_by_obstacles().iter().sum::<f64>();
    let (mut first, mut spread, mut most, mut increment) = (None, 0.0_f64, 0.0_f64, 0.0);
    let mut last = None;
    for _ in 0..steps {
        let before = heat(scheme);
        scheme.advance().unwrap();
        let now = heat(scheme);
        let sum = if name == "newmark" {
            increment = 2.0 * (now - before) - increment;
            scheme.invariant().unwrap() + now + 0.5 * increment
        } else {
            scheme.energies().unwrap().total() + now
        };
        // The increment at the start is not known, and enters with turns of sign: means over two
        // steps are free of it.
        if let Some(mean) = last.replace(sum).map(|last: f64| 0.5 * (last + sum)) {
            spread = spread.max((mean - *first.get_or_insert(mean)).abs());
        }
        most = most.max(now.abs());
    }
    spread / most
}

#[test]
fn energy_becomes_heat_and_nothing_else() {
    for name in ["newmark", "midpoint"] {
        for velocity in [[0.0; 2], [0.02, 0.05]] {
            let system = system(0, velocity);
            let mut scheme = started(name, &system, period() / 150.0, [8.0 * MOMENT / SPRING, 0.0]);
            let error = ledger(name, scheme.as_mut(), 1000);
            assert!(error < 1e-12, "{name}, {velocity:?}: {error:e}");
        }
    }
}

/// Friction on a belt swings up two motions of one frequency.
///
/// A mass m on a spring k presses a stop of stiffness c, and a slope theta of inertia I on a spring
/// q is coupled with it by b. The moment of friction follows the normal force: about the state at
/// rest
///
/// ```text
/// m w'' = -(k + c) w - b theta,   I theta'' = -q theta - (b - M) w,   M = mu c h/2,
/// ```
///
/// so that with one frequency omega and b between 0 and M a motion `exp(lambda t)` grows, where
/// `lambda^2 = -omega^2 + i g`, `g^2 = b (M - b) / (m I)`.
#[test]
fn a_belt_swings_up_two_motions_of_one_frequency() {
    let (mass, k, c) = (0.5, 2e4, 1e6);
    let moment = COEFFICIENT * ARM * c;
    let b = 0.4 * moment;
    let square = (k + c) / mass;
    let engine = Native::new(3);
    let of_plate = block(&[Some(0), Some(1)], &[k, b, b, square * INERTIA], 0);
    let of_stop = block(&[Some(0), Some(2)], &[c, -c, -c, c], 1);
    let stiffness = engine.form(vec![of_plate, of_stop]);
    let inertia = engine.form(vec![block(&[Some(0), Some(1)], &[mass, 0.0, 0.0, INERTIA], 2)]);
    let side = FrictionalSide { obstacle: 0, coefficient: COEFFICIENT, arm: ARM };
    let node = FrictionalNode { bound: 0, slopes: [Some((1, 1.0)), None], sides: [Some(side), None] };
    let path = |_: usize, _: usize, [from, to]: [f64; 2]| Ok([from - to, 0.0]);
    let friction = ContactFriction { nodes: vec![node], obstacles: 1, path: Some(Box::new(path)) };
    let rest = -WEIGHT / c;
    let system = System {
        engine,
        stiffness,
        mass: inertia,
        damping: Damping::default(),
        load: Some(vec![(k + c) * rest, (b - moment) * rest, 0.0]),
        bounds: Bounds::uniform(vec![2], 0.0, f64::INFINITY),
        bound_numbers: None,
        drive: TimeDependence { friction: Some(friction), ..TimeDependence::default() },
    };
    let g = (b * (moment - b) / (mass * INERTIA)).sqrt();
    let rate = (0.5 * (square.hypot(g) - square)).sqrt();
    let omega = 0.5 * g / rate;
    let size = 1e-3 * rest.abs();
    let errors = [200.0, 400.0].map(|steps| {
        let start = Start {
            displacement: vec![rest + size, 0.0, 0.0],
            velocity: vec![rate * size, omega * g * mass / b * size, 0.0],
        };
        let mut scheme =
            Midpoint::new(&system, 2.0 * PI / omega / steps, Massless::Reflected, start).unwrap();
        let mut error = 0.0_f64;
        while scheme.time() < 20.0 * 2.0 * PI / omega {
            scheme.advance().unwrap();
            assert!(scheme.step_report().kkt < 1e-12, "{:e}", scheme.step_report().kkt);
            let t = scheme.time();
            let exact = size * (rate * t).exp() * (omega * t).cos();
            error = error.max((scheme.displacement()[0] - rest - exact).abs() / size);
        }
        error
    });
    assert!(rate * 40.0 * PI / omega > 0.2);
    assert!(errors[0] < 0.03 && errors[1] < 0.3 * errors[0], "{errors:?}");
}

/// Strip of bending stiffness 1 N m and mass 1 kg/m2.
const STRIP: &str = "plate = { length = 1, width = 0.1, thickness = 0.01, youngs_modulus = 12e6, poissons_ratio = 0, \
                     density = 100 }\n";

/// Strip of 1 x 0.1, clamped at its left end, whose tip rests on an obstacle under a load.
fn strip(element: &str, obstacle: &str, load: &str) -> String {
    let clamped = "support = [{ edge = \"left\", kind = \"clamped\", name = \"wall\" }]\n";
    let obstacle = format!("obstacle = [{{ name = \"floor\", side = \"below\", height = 0, {obstacle} }}]\n");
    let probes = "output.every = 1\noutput.probes = [{ name = \"middle\", at = [0.5, 0.05] }, \
                  { name = \"tilt\", at = [1, 0], quantity = \"slope_x\" }, \
                  { name = \"moment\", at = [1, 0], quantity = \"friction_moment_x\" }, \
                  { name = \"slip\", at = [1, 0], quantity = \"slip_velocity_x\" }, \
                  { name = \"lean\", at = [1, 0], quantity = \"slope_y\" }]\n";
    [STRIP, &grid(element, 8, 1), clamped, &obstacle, &format!("load.pressure = \"{load}\"\n"), probes]
        .concat()
}

const METHODS: [(&str, &str); 5] = [
    ("newmark", "singular"),
    ("newmark", "consistent"),
    ("midpoint", "consistent"),
    ("midpoint", "singular"),
    ("conserving", "singular"),
];

fn time((scheme, mass): (&str, &str), step: f64, end: f64) -> String {
    format!("time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = {step:?}, end = {end:?} }}\n")
}

/// The heat of the tip is the integral of mu N (h/2) along its tilt, N being the force of the
/// obstacle: with constant N, 4 mu N (h/2) times the amplitude per cycle of full slip.
#[test]
fn the_tip_of_a_strip_dissipates_the_friction_along_its_tilt() {
    let load = "-100 + 30*sin(12*t)";
    for element in ["fvs", "hct"] {
        let errors = [1e-3, 2.5e-4].map(|dt| {
            let text = strip(element, "where = \"x > 0.95\", friction = 0.5", load)
                + "initial.static_pressure = -100\ndamping.mass = 10.0\n"
                + &time(METHODS[0], dt, 3.0);
            let (rows, outcome) = run_to_end(&text);
            let integral: f64 = rows
                .windows(2)
                .map(|w| {
                    let force = 0.5 * (w[0].contact_force + w[1].contact_force);
                    let turn = [1, 4].map(|probe| w[1].probes[probe] - w[0].probes[probe]);
                    0.5 * 0.005 * force * turn[0].hypot(turn[1])
                })
                .sum();
            // Probes tell the moment of an instant, and the slip of the step from it.
            for w in rows.windows(2).skip(1) {
                let slip = 0.005 * (w[1].probes[1] - w[0].probes[1]) / dt;
                assert!((w[0].probes[3] - slip).abs() < 1e-9, "{} {slip}", w[0].probes[3]);
                assert!(w[0].probes[2] * w[0].probes[3] <= 1e-15);
            }
            (outcome.dissipated["floor"] / integral - 1.0).abs()
        });
        // On triangles, whose diagonals lie one way, the corners of the tip do not move alike.
        let tolerance = if element == "fvs" { 5e-6 } else { 0.05 };
        assert!(errors.into_iter().all(|error| error < tolerance), "{element}: {errors:?}");
    }
}

/// A root that turns: it lies on two supports, one of which moves, and the tip is held down.
/// The face slides by the tilt of the whole plate, of which the supports turn a part.
#[test]
fn a_root_that_turns_drags_the_tip_over_the_obstacle() {
    for method in [METHODS[0], METHODS[3], METHODS[4]] {
        let moved = |y: f64| {
            let moves = "kind = \"simply_supported\", motion = \"5e-3*sin(3*t)\"";
            format!("{{ at = [0.125, {y:?}], {moves} }}")
        };
        let turned = format!(
            "{{ edge = \"left\", kind = \"simply_supported\", name = \"wall\" }}, {}, {}",
            moved(0.0),
            moved(0.1)
        );
        let errors = [2e-3, 5e-4].map(|dt| {
            let text = strip("fvs", "where = \"x > 0.95\", friction = 0.05", "-100")
                .replace("{ edge = \"left\", kind = \"clamped\", name = \"wall\" }", &turned)
                + "initial.static_pressure = -100\ndamping.mass = 30.0\n"
                + &time(method, dt, 2.0);
            let (rows, outcome) = run_to_end(&text);
            let tilts = rows.iter().map(|row| row.probes[1]);
            let most = tilts.clone().fold(f64::NEG_INFINITY, f64::max) - tilts.fold(f64::INFINITY, f64::min);
            let integral: f64 = rows
                .windows(2)
                .map(|w| {
                    let force = 0.5 * (w[0].contact_force + w[1].contact_force);
                    0.05 * 0.005 * force * (w[1].probes[1] - w[0].probes[1]).abs()
                })
                .sum();
            // The part of the supports, 0.04 at most, is not small beside the tilt.
            assert!((0.01..0.1).contains(&most), "{most}");
            (outcome.dissipated["floor"] / integral - 1.0).abs()
        });
        assert!(errors.iter().all(|error| *error < 2e-3), "{method:?}: {errors:?}");
    }
}

/// With a constant force N at a tip that slides all the time, its heat per cycle is
/// `4 mu N (h/2) Theta`, where Theta is the amplitude of its tilt.
#[test]
fn a_turned_root_costs_4_mu_n_arm_theta_per_cycle() {
    let turned = "support = [{ edge = \"left\", kind = \"simply_supported\" }, \
                  { at = [0.125, 0], kind = \"simply_supported\", motion = \"5e-3*sin(3*t)\" }, \
                  { at = [0.125, 0.1], kind = \"simply_supported\", motion = \"5e-3*sin(3*t)\" }]\n\
                  load.force = [{ at = [1, 0], value = -100 }, { at = [1, 0.1], value = -100 }]\n\
                  damping.mass = 30.0\n";
    for method in [METHODS[0], METHODS[3], METHODS[4]] {
        let text = strip("fvs", "where = \"x > 0.95\", friction = 0.003", "0");
        let text = text.lines().filter(|line| !line.starts_with("support") && !line.starts_with("load"));
        let text = text.collect::<Vec<_>>().join("\n") + "\n" + turned;
        let cycle = 2.0 * PI / 3.0;
        let [before, after] = [3.0, 4.0].map(|cycles| {
            let (rows, outcome) = run_to_end(&(text.clone() + &time(method, cycle / 1000.0, cycles * cycle)));
            let tilts = rows[rows.len() - 1000..].iter().map(|row| row.probes[1]);
            let [least, most] = [f64::min, f64::max].map(|of_two| tilts.clone().reduce(of_two).unwrap());
            (outcome.dissipated["floor"], 0.5 * (most - least))
        });
        let expected = 4.0 * 0.003 * 200.0 * 0.005 * after.1;
        let heat = after.0 - before.0;
        assert!((heat / expected - 1.0).abs() < 2e-3, "{method:?}: {heat} {expected}");
    }
}

const RAMP: &str = "-50*(1 - cos(2*t))";
const DAMPED: &str = "damping.mass = 20.0\n";

#[test]
fn an_endless_coefficient_holds_the_slopes_and_none_is_not_there() {
    let load = "-10 + 3*sin(12*t)";
    for method in METHODS {
        let rows = |obstacle: &str, more: &str| {
            let text = strip("fvs", &format!("where = \"x > 0.95\"{obstacle}"), RAMP) + more;
            run(&(text + &time(method, 2e-3, 1.0)))
        };
        let bits = |rows: &[Instant]| rows.iter().map(|row| row.probes[0].to_bits()).collect::<Vec<_>>();
        let plain = "output.probes = [{ name = \"middle\", at = [0.5, 0.05] }]\n";
        let without = |obstacle: &str| {
            let text = strip("fvs", &format!("where = \"x > 0.95\"{obstacle}"), load);
            let text = &text[..text.find("output").unwrap()];
            run(&[text, plain, &time(method, 2e-3, 1.0)].concat())
        };
        assert_eq!(bits(&without("")), bits(&without(", friction = 0.0")), "{method:?}");
        let held = strip("fvs", "where = \"x > 0.95\"", RAMP)
            .replace("support = [", "support = [{ edge = \"right\", kind = \"clamped\" }, ");
        let held = &held[..held.find("output").unwrap()];
        let held = held.lines().filter(|line| !line.starts_with("obstacle")).collect::<Vec<_>>().join("\n");
        let held = run(&[&held, "\n", DAMPED, plain, &time(method, 2e-3, 1.0)].concat());
        let mut stuck = rows(", friction = 100", DAMPED);
        stuck.iter_mut().for_each(|row| row.probes.truncate(1));
        same(&stuck, &held, 1e-9);
    }
}

/// A strip ends in a rigid plate that lies with its middle on a belt: an inertia I on a spring
/// `k = 12 EI/l^3 (a^2 + a l + l^2/3)`, a half the length of the plate, l the length of the
/// strip. From rest it slips, sticks when it is as fast as the belt, slips again at M/k, and comes
/// up with the belt once in each period.
#[test]
fn a_plate_on_a_belt_sticks_and_slips_as_a_rotating_mass() {
    const BELT: f64 = 2.5e-3;
    let text = "plate = { length = 1, width = 0.1, thickness = 0.01, youngs_modulus = 12e6, \
                poissons_ratio = 0, density = 1 }\n\
                part = [{ where = \"x > 0.5\", thickness = 0.1, density = 1000 }]\n\
                support = [{ edge = \"left\", kind = \"clamped\" }]\n\
                obstacle = [{ side = \"below\", height = 0, where = \"abs(x - 0.75) < 0.06\", \
                friction = 0.02, velocity = [2.5e-3, 0] }]\n\
                load.force = [{ at = [0.75, 0], value = -20 }, { at = [0.75, 0.1], value = -20 }]\n\
                output.every = 1\n\
                output.probes = [{ name = \"tilt\", at = [0.75, 0], quantity = \"slope_x\" }]\n";
    let spring = 12.0 * 0.1 / 0.125 * (0.0625 + 0.125 + 0.25 / 3.0);
    let angle = 0.02 * 40.0 * 0.05 / spring;
    let rate = BELT / 0.05;
    for method in METHODS {
        // With the singular mass each cell of the rigid plate is a point at its centre.
        let inertia = match method.1 {
            "singular" => 5.0 * (0.0625_f64.powi(2) + 0.1875_f64.powi(2)) / 2.0,
            _ => 5.0 * 0.25 / 12.0,
        };
        let omega = (spring / inertia).sqrt();
        let sticks_at = (rate / (omega * angle)).asin() / omega;
        let stuck = angle * (1.0 - (omega * sticks_at).cos());
        let slips_at = sticks_at + (angle - stuck) / rate;
        let exact = |t: f64| match t {
            t if t < sticks_at => angle * (1.0 - (omega * t).cos()),
            t if t < slips_at => stuck + rate * (t - sticks_at),
            t => angle + rate / omega * (omega * (t - slips_at)).sin(),
        };
        let rows = run(&[text, &grid("fvs", 8, 1), &time(method, 1e-3, 6.0)].concat());
        let errors = rows.iter().map(|row| (row.probes[0] - exact(row.time)).abs() / angle);
        let error = errors.fold(0.0, f64::max);
        assert!(slips_at > 2.0 * sticks_at && error < 0.02, "{method:?}: {error}");
    }
}

/// On a belt the strip swings about the state in which it slides evenly, as fast as one whose tip
/// is supported: its middle has the period of the first mode.
#[test]
fn a_strip_on_a_belt_swings_as_if_its_tip_were_supported() {
    let belt = "where = \"x > 0.95\", friction = 0.3, velocity = [-1, 0]";
    let text = strip("fvs", belt, "-100") + "initial.static_pressure = -100\n" + &time(METHODS[2], 5e-4, 4.0);
    let rows = run(&text);
    let held = strip("fvs", belt, "-100")
        .replace("support = [", "support = [{ edge = \"right\", kind = \"simply_supported\" }, ");
    let held = held.lines().filter(|line| !line.starts_with("obstacle") && !line.starts_with("output"));
    let held = held.collect::<Vec<_>>().join("\n") + "\n" + &time(METHODS[2], 5e-4, 4.0);
    let frequency = inspect(&held).consistent.lowest[0];
    assert!(rows[1..].iter().all(|row| row.contact_force > 0.0));
    let mean = rows.iter().map(|row| row.probes[0]).sum::<f64>() / rows.len() as f64;
    let rises: Vec<f64> = rows
        .windows(2)
        .filter(|w| w[0].probes[0] < mean && w[1].probes[0] >= mean)
        .map(|w| w[1].time)
        .collect();
    let period = (rises[rises.len() - 1] - rises[0]) / (rises.len() - 1) as f64;
    assert!(rises.len() > 5 && (period * frequency - 1.0).abs() < 0.01, "{period} {frequency}");
}

/// Mirrored in its middle plane a scene moves the mirrored way, and its heat is the same.
#[test]
fn mirrored_scenes_move_mirrored() {
    for method in METHODS {
        let rows = |side: &str, sign: f64| {
            let text = strip(
                "hct",
                "friction = 0.1, velocity = [0.3, \"0.1*cos(3*t)\"]",
                &format!("{sign}*(4 + 9*sin(8*t))"),
            );
            run_to_end(&(text.replace("\"below\"", &format!("\"{side}\"")) + &time(method, 2e-3, 0.6)))
        };
        let (below, mut above) = (rows("below", -1.0), rows("above", 1.0));
        above.0.iter_mut().for_each(|row| row.probes.iter_mut().for_each(|value| *value = -*value));
        // A slip is one of faces, which does not turn round.
        let scale = below.0.iter().map(|row| row.probes[0].abs()).fold(0.0, f64::max);
        above.0.iter_mut().for_each(|row| row.probes[3] = -row.probes[3]);
        same(&below.0, &above.0, 1e-9 * (1.0 + scale));
        let [one, other] = [&below.1, &above.1].map(|outcome| outcome.dissipated["floor"]);
        assert!((one / other - 1.0).abs() < 1e-9, "{one} {other}");
    }
}

/// In plates that stay in contact, schemes turn energy into heat to rounding, on a belt too; only
/// the midpoint rule with a massless rest in equilibrium misses some where slopes begin to slip.
const START: &str = "initial = { static_pressure = -100, velocity = \"x^2*(1 - x)^2\" }\n";

#[test]
fn plates_keep_the_ledger() {
    for (method, massless) in
        [(METHODS[0], ""), (METHODS[1], ""), (METHODS[2], ""), (METHODS[3], ", massless = \"reflected\"")]
    {
        let tip = "where = \"x > 0.95\", friction = 0.05, velocity = [\"0.02*sin(5*t)\", 0.01]";
        let text = strip("fvs", tip, "-100") + START;
        let time = time(method, 2e-3, 1.0).replace(" }", &format!("{massless} }}"));
        let scene = scene(&(text + &time));
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme_with(&scene, &simulation::condensed).unwrap();
        let error = ledger(method.0, scheme.as_mut(), 400);
        assert!(error < 1e-11, "{method:?}: {error:e}");
    }
}

/// `conserving` keeps energy and heat together through impacts at any step, at which neither is
/// accurate.
#[test]
fn impacts_with_friction_keep_the_ledger_at_any_step() {
    for element in ["fvs", "hct"] {
        for step in [2e-3, 2e-2] {
            let belt = "where = \"x > 0.5\", friction = 0.3, velocity = [\"0.3*sin(5*t)\", 0.1]";
            let text = strip(element, belt, "-0.1").replace("height = 0", "height = -0.02")
                + "initial.velocity = \"-0.3*x\"\n";
            let scene = scene(&(text + &time(METHODS[4], step, 1500.0 * step)));
            let model = Model::new(&scene).unwrap();
            let mut scheme = model.scheme_with(&scene, &simulation::condensed).unwrap();
            let (mut first, mut most, mut contacts) = (None, 0.0_f64, 0);
            let (mut spread, mut touches) = (0.0_f64, false);
            for _ in 0..1500 {
                scheme.advance().unwrap();
                let energies = scheme.energies().unwrap();
                let heat: f64 = scheme.dissipated_by_obstacles().iter().sum();
                let sum = energies.total() + heat;
                spread = spread.max((sum - *first.get_or_insert(sum)).abs());
                most = most.max(energies.kinetic + energies.elastic);
                let now = scheme.reaction().iter().any(|r| *r != 0.0);
                contacts += u32::from(now && !touches);
                touches = now;
                assert!(scheme.step_report().kkt < 1e-9, "{:e}", scheme.step_report().kkt);
            }
            assert!(
                contacts > 10 && spread < 1e-12 * most,
                "{element}, {step}: {contacts}, {spread:e} {most}"
            );
        }
    }
}

/// On a belt that turns the tip slides in every direction and sticks, and the steps of
/// `conserving` lead to the motion of Newmark's scheme, with second order.
#[test]
fn conserving_steps_converge_on_a_belt_that_turns() {
    let belt = "where = \"x > 0.95\", friction = 0.5, \
                velocity = [\"0.005*cos(9*t)\", \"0.005*sin(9*t)\"]";
    let rows = |method, step: f64| {
        let text = strip("fvs", belt, "-100 + 60*sin(12*t)") + START + &time(method, step, 0.45);
        let (rows, outcome) = run_to_end(&text);
        let every = rows.len() / 45;
        let probes = rows.iter().step_by(every).map(|row| row.probes[0]).collect::<Vec<f64>>();
        (probes, outcome.dissipated["floor"])
    };
    let (truth, heat) = rows(METHODS[0], 2.5e-5);
    let errors = [2e-3, 5e-4].map(|step| {
        let (probes, of_step) = rows(METHODS[4], step);
        let errors = probes.iter().zip(&truth).map(|(one, other)| (one - other).abs());
        let size = truth.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
        [errors.fold(0.0, f64::max) / size, (of_step / heat - 1.0).abs()]
    });
    assert!(errors[0][0] < 5e-4 && errors[1][0] < 0.2 * errors[0][0], "{errors:?}");
    assert!(errors.iter().all(|[_, of_heat]| *of_heat < 2e-4), "{errors:?}");
}

/// At rest on a moving belt, load, obstacle, friction and supports turn the plate by nothing, be it
/// that a support holds the slope of the nodes that touch.
#[test]
fn moments_of_friction_count_in_the_balance() {
    for method in [METHODS[0], METHODS[3], METHODS[4]] {
        balance_of_moments(method, "");
        balance_of_moments(method, "{ edge = \"right\", kind = \"guided\", name = \"guide\" }, ");
    }
}

fn balance_of_moments(method: (&str, &str), guide: &str) {
    let text = strip("fvs", "where = \"x > 0.95\", friction = 0.3, velocity = [-1, 0]", "-10");
    let text = text.replace("output.probes", "damping = { mass = 30.0 }\noutput.probes");
    let text = text.replace("support = [", &format!("support = [{guide}"));
    let scene = scene(&(text + &time(method, 2e-3, 4.0)));
    let model = Model::new(&scene).unwrap();
    let mut last = Vec::new();
    struct Last<'l>(&'l mut Vec<f64>);
    impl simulation::Observer for Last<'_> {
        fn row(&mut self, row: &simulation::Row) -> rebond::Result<()> {
            *self.0 = [row.forces, row.probes].concat();
            Ok(())
        }
    }
    let (_, ended) = simulation::run(&scene, &model, &simulation::condensed, &mut Last(&mut last)).unwrap();
    ended.unwrap();
    let columns = scene.force_columns();
    let value = |name: &str| last[columns.iter().position(|column| column == name).unwrap()];
    // Each of the two corners of the tip has half of the friction; the load's centre is at 0.5.
    let of_friction = 2.0 * last[columns.len() + 2];
    let turning = value("force_floor") * 1.0 - 10.0 * 0.1 * 0.5 + of_friction;
    let names = ["moment_y_wall", "moment_y_guide"].into_iter().take(if guide.is_empty() { 1 } else { 2 });
    let of_supports: f64 = names.map(value).sum();
    assert!(of_friction.abs() > 1e-4);
    assert!((turning - of_supports).abs() < 1e-9, "{method:?}, {guide}: {turning} {of_supports}");
}
