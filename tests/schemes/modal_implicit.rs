//! The Newmark scheme and the midpoint rule with the modal mass, compared with the closed forms of
//! single modes, with the event-driven motion, and with their own balances.

use crate::common::models::{PAPER_FALL, PAPER_START};
use crate::common::scenes::{refusal, scene};
use crate::exact::corners;
use rebond::archive::Archive;
use rebond::linalg::{Form, MassModes};
use rebond::scene::Scene;
use rebond::scheme::{Exact, Scheme};
use rebond::simulation::Model;
use std::rc::Rc;

const MESH: &str = "mesh = { element = \"fvs\", cells = [8, 4] }\n\
                    output = { probes = [{ name = \"one\", at = [1.2, 0.0] }, { name = \"other\", at = [1.2, 0.4] }] }\n";

/// Returns a scene of 30 modes.
fn modal(tables: &str, scheme: &str, step: f64) -> Scene {
    let end = 1024.0 * step;
    scene(&format!(
        "{tables}{MESH}time = {{ scheme = {scheme}, mass = \"modal\", modes = 30, step = {step:e}, end = {end:e} }}\n"
    ))
}

fn modes(model: &Model) -> Rc<MassModes> {
    match &model.system.mass {
        Form::Modal { modes, .. } => modes.clone(),
        _ => panic!("not modal"),
    }
}

/// Each mode follows the difference equation of its scheme, damped by alpha + beta w^2, from its
/// own start on.
#[test]
fn modes_in_flight_follow_their_difference_equations() {
    let dt = 2e-4;
    let damping = "damping = { mass = 3, stiffness = 2e-5 }\n";
    for (beta, name) in
        [(0.5, "\"newmark\""), (0.3, "\"newmark\", beta = 0.3, restitution = 0.4"), (0.25, "\"midpoint\"")]
    {
        for (damping, alpha, of_stiffness) in [("", 0.0, 0.0), (damping, 3.0, 2e-5)] {
            let scene = modal(&format!("{PAPER_START}{damping}"), name, dt);
            let model = Model::new(&scene).unwrap();
            let modes = modes(&model);
            let mut scheme = model.scheme(&scene).unwrap();
            let count = modes.count();
            let mut q = vec![0.0; count];
            for (k, q) in q.iter_mut().enumerate() {
                let momentum = modes.momenta.col_as_slice(k);
                *q = momentum.iter().zip(&model.start.displacement).map(|(m, u)| m * u).sum();
            }
            // Newmark's equation with beta = 1/4 is that of the midpoint rule, whose first step has
            // the velocity zero and the equation of that instant as well.
            let mut before = q.clone();
            for n in 0..400 {
                for k in 0..count {
                    let square = modes.squares[k] * dt * dt;
                    let drag = 0.5 * dt * (alpha + of_stiffness * modes.squares[k]);
                    let mass = 1.0 + beta * square;
                    let next = if n == 0 {
                        q[k] - 0.5 * square * q[k] / (mass + drag)
                    } else {
                        let force = (2.0 - (1.0 - 2.0 * beta) * square) * q[k] - (mass - drag) * before[k];
                        force / (mass + drag)
                    };
                    (before[k], q[k]) = (q[k], next);
                }
                scheme.advance().unwrap();
                if n % 40 == 0 {
                    let mut u = vec![0.0; model.start.displacement.len()];
                    for (k, q) in q.iter().enumerate() {
                        let shape = modes.shapes.col_as_slice(k);
                        u.iter_mut().zip(shape).for_each(|(u, s)| *u += q * s);
                    }
                    let corner = model.probes[0].deflection(&u);
                    let error = (corners(&model, &*scheme)[0] - corner).abs();
                    assert!(error <= 1e-11, "{name} {damping} step {n}: {error:e} of {corner}");
                }
            }
        }
    }
}

/// The step from rest at an extreme has the closed form q_n = q_0 cos(n theta).
#[test]
fn undamped_modes_have_the_known_discrete_frequency() {
    let dt = 2e-4;
    for (beta, name) in [(0.5, "\"newmark\""), (0.25, "\"midpoint\"")] {
        let scene = modal(PAPER_START, name, dt);
        let model = Model::new(&scene).unwrap();
        let (modes, steps) = (modes(&model), 1000);
        let mut scheme = model.scheme(&scene).unwrap();
        (0..steps).for_each(|_| scheme.advance().unwrap());
        let mut corner = 0.0;
        for (k, square) in modes.squares.iter().enumerate() {
            let momentum = modes.momenta.col_as_slice(k);
            let q: f64 = momentum.iter().zip(&model.start.displacement).map(|(m, u)| m * u).sum();
            let half = (0.25 * square * dt * dt / (1.0 + beta * square * dt * dt)).sqrt();
            let theta = 2.0 * half.asin();
            corner += q
                * (f64::from(steps) * theta).cos()
                * model.probes[0].deflection(modes.shapes.col_as_slice(k));
        }
        let error = (corners(&model, &*scheme)[0] - corner).abs();
        assert!(error <= 1e-10, "{name}: {error:e} of {corner}");
    }
}

/// Number of intervals of 4e-4 s in which motions are compared, and of those before the first
/// touch at 0.0548 s.
const COMPARED: usize = 160;
const FLIGHT: usize = 136;

/// Returns the exact deflection of the corner, in m, at the end of each interval.
fn exact_corner() -> Vec<f64> {
    let model = Model::new(&modal(PAPER_FALL, "\"exact\"", 4e-4)).unwrap();
    let mut exact = Exact::new(&model.system, 4e-4, model.start.clone()).unwrap();
    let mut at = || {
        exact.advance().unwrap();
        corners(&model, &exact)[0]
    };
    (0..COMPARED).map(|_| at()).collect()
}

/// Returns the largest error of the corner before and during the first impact, in m, against the
/// exact motion of the same modes, and the share of the energy that the run has lost.
fn errors(scheme: &str, step: f64, exact: &[f64]) -> [f64; 3] {
    let scene = modal(PAPER_FALL, scheme, step);
    let model = Model::new(&scene).unwrap();
    let every = (4e-4 / step).round() as u32;
    let mut scheme = model.scheme(&scene).unwrap();
    let energy = scheme.energies().unwrap().total();
    let mut errors = [0.0f64; 3];
    for (n, there) in exact.iter().enumerate() {
        for _ in 0..every {
            scheme.advance().unwrap();
        }
        let phase = usize::from(n >= FLIGHT);
        errors[phase] = errors[phase].max((there - corners(&model, &*scheme)[0]).abs());
    }
    errors[2] = 1.0 - scheme.energies().unwrap().total() / energy;
    errors
}

/// The order in flight is that of steps which resolve all modes.
#[test]
fn short_steps_approach_the_exact_motion() {
    let exact = exact_corner();
    for scheme in
        ["\"newmark\"", "\"newmark\", restitution = 0.5", "\"newmark\", restitution = 1", "\"midpoint\""]
    {
        let all = [2e-5, 1e-5, 5e-6].map(|step| errors(scheme, step, &exact));
        println!("{scheme}: {all:?}");
        let order = (all[1][0] / all[2][0]).log2();
        assert!((1.9..2.2).contains(&order), "{scheme}: order {order} in flight");
        let order = (all[0][1] / all[2][1]).log2() / 2.0;
        assert!(order >= 0.8, "{scheme}: order {order} in the impact");
        assert!(all[2][2].abs() <= 1e-2, "{scheme}: loses {:e}", all[2][2]);
        if scheme == "\"newmark\"" {
            assert!(all.iter().all(|of| of[2] >= -1e-3), "{all:?}");
        }
    }
}

/// Loads and supports in time.
const DRIVEN: &str = "load = { pressure = '900 * sin(170 * t)' }\n";

/// In flight the invariant of Newmark with beta = 1/2 and the energy of the midpoint rule change by
/// the work of loads and supports alone; with e = 0 the invariant falls in contact.
#[test]
fn energies_balance_with_work() {
    let start =
        PAPER_START.replace("kind = \"clamped\"", "kind = \"clamped\", motion = '0.003 * sin(50 * t)'");
    for (contact, obstacle) in
        [(false, ""), (true, "obstacle = [{ side = \"below\", height = '-0.05 + 0.01 * sin(90 * t)' }]\n")]
    {
        for name in ["\"newmark\"", "\"newmark\", restitution = 1", "\"midpoint\""] {
            let scene = modal(&format!("{start}{DRIVEN}{obstacle}"), name, 5e-5);
            let model = Model::new(&scene).unwrap();
            let mut scheme = model.scheme(&scene).unwrap();
            let first = scheme.invariant().unwrap();
            let scale = scheme.energies().unwrap().elastic;
            let (mut drift, mut rise, mut touched) = (0.0f64, 0.0f64, false);
            for _ in 0..1300 {
                scheme.advance().unwrap();
                let change = (scheme.invariant().unwrap() - first) / scale;
                (drift, rise) = (drift.max(change.abs()), rise.max(change));
                touched |= scheme.reaction().iter().any(|r| *r != 0.0);
            }
            println!("{name} {contact}: drift {drift:e}, rise {rise:e}");
            assert_eq!(touched, contact, "{name}");
            assert!(contact || drift <= 1e-11, "{name}: {drift:e}");
            assert!(name != "\"newmark\"" || rise <= 1e-11, "{name}: {rise:e}");
        }
    }
}

/// The mesh has many nodes near the obstacle, which join as candidates in steps of any length.
#[test]
fn no_node_penetrates_and_checkpoints_restore_the_bits() {
    let near = PAPER_FALL.replace("height = -0.1", "height = '-0.004 - 0.08 * x'");
    for (name, step) in [
        ("\"newmark\"", 2e-5),
        ("\"newmark\"", 1e-3),
        ("\"newmark\", beta = 0.4, restitution = 0.6", 1e-4),
        ("\"midpoint\"", 2e-5),
        ("\"midpoint\"", 1e-3),
    ] {
        let mut scene = modal(&near, name, step);
        scene.mesh.cells = [16, 8];
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let deepest = |scheme: &dyn Scheme| model.system.bounds.violation(scheme.displacement());
        let steps = (0.07 / step) as u32;
        let (mut worst, mut touched) = (0.0f64, vec![false; model.system.bounds.len()]);
        let mut saved: Option<Archive> = None;
        for n in 0..steps {
            if n == steps * 6 / 7 {
                let mut archive = Archive::Saves(Vec::new());
                scheme.archive(&mut archive).unwrap();
                saved = Some(Archive::Restores {
                    entries: archive.into_entries().into_iter(),
                    same_processes: true,
                });
            }
            scheme.advance().unwrap();
            // With e = 0 the bounded configuration is that of the next instant.
            if !name.contains("restitution") {
                worst = worst.max(deepest(&*scheme));
            }
            scheme.reaction().iter().zip(&mut touched).for_each(|(r, touched)| *touched |= *r != 0.0);
        }
        let touched = touched.iter().filter(|touched| **touched).count();
        println!("{name}, {step:e} s: {touched} nodes touch, at most {worst:.1e} m deep");
        assert!(touched >= 9 && worst <= 1e-12, "{name}, {step}: {touched}, {worst:e}");
        let mut resumed = model.scheme(&scene).unwrap();
        resumed.archive(&mut saved.unwrap()).unwrap();
        while resumed.time() < scheme.time() - 0.5 * step {
            resumed.advance().unwrap();
        }
        let bits = |scheme: &dyn Scheme| -> Vec<u64> {
            let all = scheme.displacement().iter().chain(scheme.reaction()).chain(scheme.impulses());
            all.map(|x| x.to_bits()).chain([scheme.energies().unwrap().total().to_bits()]).collect()
        };
        assert!(bits(&*resumed) == bits(&*scheme), "{name}, {step}");
    }
}

#[test]
fn what_the_modal_mass_cannot_take_is_refused_by_name() {
    let time = |scheme: &str, more: &str| {
        format!(
            "{PAPER_FALL}{MESH}{more}time = {{ scheme = {scheme}, mass = \"modal\", modes = 30, step = 1e-4, end = 0.1 }}\n"
        )
    };
    let soft = |text: String| text.replace("height = -0.1", "height = -0.1, stiffness = 1e6, damping = 10");
    for (text, words) in [
        (time("\"newmark\", beta = 0.25", ""), "time.beta: 0.25 lets the massless rest"),
        (
            time("\"midpoint\", massless = \"reflected\"", ""),
            "time.massless: \"reflected\" contradicts time.mass",
        ),
        (soft(time("\"newmark\"", "")), "with time.mass = \"modal\" follows no damped tips"),
        (soft(time("\"midpoint\"", "")), "with time.mass = \"modal\" follows no damped tips"),
    ] {
        let error = refusal(&text).to_string();
        assert!(error.contains(words), "{error}");
    }
}
