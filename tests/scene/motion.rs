//! Moving supports and obstacles, and free rigid bodies, each compared with another frame, a closed
//! form or a balance.

use crate::common::models::{CLAMPED, STRIP, UNIT, UNIT_SECTION};
use crate::common::scenes;
use crate::common::scenes::{
    Drawing, Instant, all_round, close, grid, inspect, newmark, off, run, run_to_end, same, scene,
};
use rebond::simulation::Model;
use std::f64::consts::{PI, TAU};

fn clamped(motion: &str) -> String {
    format!("support = [{{ edge = \"left\", kind = \"clamped\", motion = \"{motion}\" }}]\n")
}

const PROBES: &str = "output.probes = [{ name = \"tip\", at = [1, 0] }, { name = \"in\", at = [0.3, 0.6] }, { name = \"root\", at = [0, 0.5] }]\n";

/// Returns the deflections relative to a moving frame.
fn seen_from(rows: Vec<Instant>, frame: impl Fn(f64) -> f64) -> Vec<Instant> {
    let relative = |mut row: Instant| {
        row.probes.iter_mut().for_each(|w| *w -= frame(row.time));
        row
    };
    rows.into_iter().map(relative).collect()
}

/// Supports rise at a constant velocity towards a ceiling. In their frame, the plate falls and the
/// ceiling comes down. Where the supports accelerate, this acts on the plate as a pressure -rho h
/// a.
#[test]
fn moving_supports_are_moving_obstacles_in_their_frame() {
    for mass in ["singular", "consistent"] {
        let rest = [&newmark(mass, 1e-3, 0.8)[..], PROBES].concat();
        let plate = [UNIT, &grid("fvs", 4, 4)].concat();
        let ceiling = |height: &str| {
            format!("obstacle = [{{ side = \"above\", height = \"{height}\", where = \"x > 0.6\" }}]\n")
        };
        let moved = run(&[&plate, &clamped("0.5*t + 1.5*t^2")[..], &ceiling("0.05"), &rest].concat());
        let from_there =
            [&ceiling("0.05 - 0.5*t - 1.5*t^2")[..], "load.pressure = -3\ninitial.velocity = -0.5\n"]
                .concat();
        let still = run(&[&plate, CLAMPED, &from_there, &rest].concat());
        assert!(moved.iter().any(|row| row.contact_force < 0.0));
        assert!(off(&moved, |_| 0.0) > 0.01);
        same(&seen_from(moved, |t| 0.5 * t + 1.5 * t * t), &still, 1e-12);
    }
}

/// The response to a motion w(t) is, in the frame of the supports, that to the pressure -rho h
/// w''(t), in every scheme and with damping.
#[test]
fn base_excitation_is_an_inertial_load() {
    for (scheme, mass) in [
        ("newmark", "singular"),
        ("newmark", "consistent"),
        ("midpoint", "singular"),
        ("midpoint", "consistent"),
        ("conserving", "singular"),
    ] {
        let rest = format!(
            "damping.mass = 0.8\ntime = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-3, end = 0.5 }}\n{PROBES}"
        );
        let plate = [UNIT, &grid("hct", 3, 3)].concat();
        let moved = run(&[&plate, &clamped("0.02*(1 - cos(8*t))")[..], &rest].concat());
        let pushed = run(&[&plate, CLAMPED, "load.pressure = \"-0.02*64*cos(8*t)\"\n", &rest].concat());
        assert!(off(&pushed, |_| 0.0) > 1e-2);
        // The load is the mean acceleration between the instants, not its values there.
        same(&seen_from(moved, |t| 0.02 * (1.0 - (8.0 * t).cos())), &pushed, 5e-6);
    }
}

/// A simply supported square is shaken by W sin(p t), with damping alpha. Each mode (m, n) has 16 /
/// (pi^2 m n) of the acceleration of the base and its own transfer function, W p^2 / (w^2 - p^2 + i
/// alpha p).
#[test]
fn transfer_function_of_a_damped_mode() {
    let [p, w0, alpha] = [15.0, 1e-3, 6.0];
    let text = format!(
        "{UNIT}{}{}damping.mass = {alpha}\n{}output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
        grid("fvs", 12, 12),
        all_round("simply_supported").replace(" }", &format!(", motion = \"{w0}*sin({p}*t)\" }}")),
        newmark("consistent", 2e-3, 4.0)
    );
    let rows = run(&text);
    let steady = |t: f64| {
        let mut sum = w0 * (p * t).sin();
        for (m, n) in (1..40).step_by(2).flat_map(|m| (1..40).step_by(2).map(move |n| (m, n))) {
            let mode = (PI * PI * f64::from(m * m + n * n)).powi(2);
            let sign = if (m + n) % 4 == 2 { 1.0 } else { -1.0 };
            let share = sign * 16.0 / (PI * PI * f64::from(m * n)) * w0 * p * p;
            let (real, imaginary) = (mode - p * p, alpha * p);
            sum += share * (real * (p * t).sin() - imaginary * (p * t).cos())
                / (real * real + imaginary * imaginary);
        }
        sum
    };
    // The transient from the start has decayed to exp(-3 * 3).
    let late: Vec<Instant> = rows.into_iter().filter(|row| row.time > 3.0).collect();
    let largest = off(&late, |_| 0.0);
    assert!(largest > 2.0 * w0);
    assert!(off(&late, steady) < 1e-2 * largest, "{} of {largest}", off(&late, steady));
}

/// Motions that are written differently are computed by the static shapes of the plate, which add
/// up to the rigid motion. Springs to the ground act on the rigid shape only, as a time-dependent
/// load; then the results differ by the error of the step.
#[test]
fn lifts_add_up_to_a_rigid_motion() {
    let stop = "obstacle = [{ side = \"above\", height = 0.02, at = [1, 0] }]\n";
    let springs = "foundation = [{ stiffness = 5, where = \"x > 0.5\" }]\nspring = [{ at = [0.9, 0.2], stiffness = 3 }]\n";
    for (more, tolerance) in [(stop, 1e-10), (springs, 1e-6)] {
        for mass in ["singular", "consistent"] {
            let scene = |motions: [&str; 2]| {
                let supports = [
                    format!("{{ edge = \"left\", kind = \"clamped\", motion = \"{}\" }}", motions[0]),
                    format!("{{ at = [1, 1], kind = \"simply_supported\", motion = \"{}\" }}", motions[1]),
                ];
                format!(
                    "{UNIT}{}support = [{}]\nmass = [{{ at = [1, 0.2], mass = 0.1 }}]\n{more}{}{PROBES}",
                    grid("fvs", 4, 4),
                    supports.join(", "),
                    newmark(mass, 1e-3, 1.0)
                )
            };
            let together = run(&scene(["0.3*t^2", "0.3*t^2"]));
            assert_eq!(together.iter().any(|row| row.contact_force < 0.0), more == stop);
            same(&together, &run(&scene(["0.3*t^2", "0.3*t*t"])), tolerance);
        }
    }
}

/// One end of a clamped strip rises slowly: its shape is the static one of beam theory, x^2 (3 - x)
/// / 2, at every instant. Ends with constant displacements a and b bend it from the first instant
/// on.
#[test]
fn supports_that_move_apart_bend_the_plate() {
    let scene = |left: &str, right: &str, more: &str| {
        format!(
            "{STRIP}{}support = [{{ edge = \"left\", kind = \"clamped\"{left} }}, {{ edge = \"right\", kind = \"simply_supported\"{right} }}]\n\
             output.probes = [{{ name = \"middle\", at = [0.5, 0.05] }}, {{ name = \"end\", at = [1, 0.05] }}, {{ name = \"root\", at = [0, 0.05] }}]\n{more}",
            grid("fvs", 8, 1)
        )
    };
    // The motion is slow compared with the first period of 0.4 s; only its own inertia remains,
    // 1e-4 of the deflection.
    let slow = run(&scene("", ", motion = \"0.5*(1 - cos(pi*t/40))\"", &newmark("singular", 2e-2, 40.0)));
    for row in &slow {
        let moved = 0.5 * (1.0 - (PI * row.time / 40.0).cos());
        assert!(
            (row.probes[0] - 0.3125 * moved).abs() < 1e-4,
            "{}: {}",
            row.time,
            row.probes[0] - 0.3125 * moved
        );
        assert!((row.probes[1] - moved).abs() < 1e-14 && row.probes[2] == 0.0);
    }
    for mass in ["singular", "consistent"] {
        let apart = scene(", motion = 0.01", ", motion = 0.03", &newmark(mass, 1e-3, 0.1));
        for row in run(&apart) {
            for (w, expected) in row.probes.iter().zip([0.01 + 0.3125 * 0.02, 0.03, 0.01]) {
                assert!((w - expected).abs() < 1e-12, "{}: {w}, not {expected}", row.time);
            }
        }
    }
}

/// A foundation on the ground acts on a plate that its supports lift; on a rigid lift its force is
/// k w(t).
#[test]
fn a_foundation_stays_behind() {
    let text = format!(
        "{UNIT}{}{}foundation = [{{ stiffness = 50 }}]\ninitial.equilibrium = true\n{}{PROBES}",
        grid("fvs", 4, 4),
        clamped("0.01 + 0*t"),
        newmark("singular", 1e-3, 0.2)
    );
    // The strip starts in equilibrium on its foundation, and therefore stays at rest, as under the
    // pressure -k w0.
    let rows = run(&text);
    let pushed = "foundation = [{ stiffness = 50 }]\ninitial.static_pressure = -0.5\n";
    let frame =
        run(&[UNIT, &grid("fvs", 4, 4), CLAMPED, pushed, &newmark("singular", 1e-3, 0.2), PROBES].concat());
    for row in &rows {
        for (w, expected) in row.probes.iter().zip(&frame[0].probes) {
            assert!((w - 0.01 - expected).abs() < 1e-12, "{}: {w}", row.time);
        }
    }
}

/// Returns a nearly massless plate, which acts as a spring of stiffness k under its middle, for a
/// ball of 2 kg.
fn trampoline(more: &str) -> String {
    let light = UNIT.replace("density = 1", "density = 1e-9");
    format!(
        "{light}{}{}ball = [{{ at = [0.5, 0.5], mass = 2, height = 0.3 }}]\nload.gravity = 9.81\n\
         output.probes = [{{ name = \"ball\", ball = 0 }}, {{ name = \"plate\", at = [0.5, 0.5] }}]\n{more}",
        grid("fvs", 4, 4),
        all_round("simply_supported")
    )
}

/// The ball falls, sinks in by the closed form of a mass on a spring, and comes back, twice.
#[test]
fn a_ball_on_a_trampoline() {
    // The stiffness follows from the plate's own response to a force.
    let force = format!(
        "{UNIT}{}{}initial.equilibrium = true\nload.force = [{{ at = [0.5, 0.5], value = -1 }}]\n{}\
         output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
        grid("fvs", 4, 4),
        all_round("simply_supported"),
        scenes::STILL
    );
    let k = -1.0 / run(&force)[0].probes[0];
    let (g, m, height) = (9.81, 2.0, 0.3);
    let w = (k / m).sqrt();
    let v = f64::sqrt(2.0 * g * height);
    let falls = v / g;
    // The contact follows y = -(v / w) sin(w s) - (g / w^2)(1 - cos(w s)) until it is 0 again.
    let contact = (TAU - 2.0 * (v * w / g).atan()) / w;
    let height_at = |t: f64| {
        let s = (t + falls) % (2.0 * falls + contact);
        if s < 2.0 * falls {
            let s = s - falls;
            return height - 0.5 * g * s * s;
        }
        let s = s - 2.0 * falls;
        -(v / w) * (w * s).sin() - g / (w * w) * (1.0 - (w * s).cos())
    };
    for (scheme, step, tolerance) in
        [("newmark", 1e-4, 2e-3), ("conserving", 5e-4, 2e-3), ("midpoint", 1e-4, 2e-3)]
    {
        let time =
            format!("time = {{ scheme = \"{scheme}\", mass = \"singular\", step = {step:?}, end = 1.6 }}\n");
        let (rows, outcome) = run_to_end(&trampoline(&time));
        let error = off(&rows, height_at);
        assert!(error < tolerance, "{scheme}: {error}");
        close("first impact", outcome.first_impact.unwrap().time, falls, 1e-3);
        for row in &rows {
            assert!(row.probes[0] - row.probes[1] > -1e-9, "{scheme}, t = {}: through the plate", row.time);
        }
        if scheme == "conserving" {
            let start = rows[0].energy;
            assert!(rows.iter().all(|row| (row.energy / start - 1.0).abs() < 1e-9));
            close("energy", start, m * g * height, 1e-6);
        }
    }
}

/// A ball thrown from below does not stick to the plate: gravity turns it.
#[test]
fn a_ball_that_does_not_reach_the_plate() {
    let text = format!(
        "{UNIT}{}{}ball = [{{ at = [0.3, 0.6], side = \"below\", mass = 2, height = -0.5, velocity = 1.5 }}]\nload.gravity = 9.81\n\
         initial.equilibrium = true\n{}output.probes = [{{ name = \"ball\", ball = 0 }}, {{ name = \"plate\", at = [0.5, 0.5] }}]\n",
        grid("fvs", 4, 4),
        all_round("clamped"),
        newmark("singular", 1e-3, 0.3)
    );
    let rows = run(&text);
    assert!(off(&rows, |t| -0.5 + 1.5 * t - 4.905 * t * t) < 1e-12);
    // The ball does not affect the plate, which keeps the deflection of a clamped square under its
    // weight.
    for row in &rows {
        assert!((row.probes[1] - rows[0].probes[1]).abs() < 1e-12);
    }
    close("sag", rows[0].probes[1], -9.81 * 0.001_265, 1e-1);
}

/// A ball hits a free plate: together they conserve momentum and energy, and a rigid plate gets the
/// velocity of a perfect shock.
#[test]
fn a_ball_meets_a_free_plate() {
    let text = |scheme: &str| {
        format!(
            "{UNIT}{}ball = [{{ at = [0.5, 0.5], mass = 0.5, height = 0.01, velocity = -3 }}]\n\
             time = {{ scheme = \"{scheme}\", mass = \"singular\", step = 1e-4, end = 0.3 }}\n",
            grid("fvs", 4, 4)
        )
    };
    for (scheme, tolerance) in [("conserving", 1e-10), ("newmark", 2e-2)] {
        let scene = scene(&text(scheme));
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let system = &model.system;
        let momentum = |v: &[f64]| {
            use rebond::linalg::Engine;
            // The height of the ball is its gap over the plate, so a rise of everything is a rise
            // of every deflection.
            let rise: Vec<f64> =
                (0..v.len()).map(|dof| f64::from(dof % 3 == 0 && dof + 1 < v.len())).collect();
            let mut product = vec![0.0; v.len()];
            system.engine.multiply(&system.mass, v, &mut product).unwrap();
            product.iter().zip(rise).map(|(p, rise)| p * rise).sum::<f64>()
        };
        let (start, energy) = (momentum(&scheme.velocity().unwrap()), scheme.energies().unwrap().total());
        close("momentum", start, -1.5, 1e-12);
        close("energy", energy, 2.25, 1e-12);
        let mut touched = false;
        let mut least = f64::INFINITY;
        while scheme.step() < scene.time.steps() {
            scheme.advance().unwrap();
            touched |= scheme.reaction().iter().any(|r| *r != 0.0);
            let now = momentum(&scheme.velocity().unwrap());
            least = least.min(now);
            assert!((now - start).abs() < 1e-9, "t = {}: {now}", scheme.time());
            let now = scheme.energies().unwrap().total();
            assert!((now / energy - 1.0).abs() < tolerance, "t = {}: {now} J", scheme.time());
        }
        assert!(touched);
    }
}

/// A ball in the air is a rigid motion beside the plate's own frequencies.
#[test]
fn a_ball_in_the_air_is_free() {
    let text = format!(
        "{UNIT}{}{}ball = [{{ at = [0.5, 0.5], mass = 1, height = 1 }}]\nload.gravity = 9.81\n{}",
        grid("fvs", 4, 4),
        all_round("simply_supported"),
        scenes::STILL
    );
    let inspection = inspect(&text);
    assert_eq!(inspection.consistent.lowest[0], 0.0);
    close("plate", inspection.consistent.lowest[1], PI, 3e-2);
    close("mass", inspection.mass, 2.0, 1e-13);
}

/// Oblique supports that move apart, and a ball, give the same result when everything is rotated.
#[test]
fn motion_of_askew_supports() {
    let angle: f64 = 0.7;
    let turn = |x: f64, y: f64| [x * angle.cos() - y * angle.sin(), x * angle.sin() + y * angle.cos()];
    let scene = |turned: bool| {
        let map = |x: f64, y: f64| if turned { turn(x, y) } else { [x, y] };
        let file = Drawing::grid([5, 4], [1.0, 0.8], true, map).write(&format!("apart-{turned}.msh"));
        format!(
            "plate = {{ {UNIT_SECTION} }}\nmesh.file = '{file}'\n\
             support = [{{ edge = \"left\", kind = \"simply_supported\", motion = \"0.01*sin(9*t)^2\" }}, {{ edge = \"right\", kind = \"simply_supported\" }}, {{ edge = \"top\", kind = \"guided\" }}]\n\
             ball = [{{ at = {:?}, mass = 0.3, height = 0.005 }}]\nload.gravity = 9.81\n{}output.probes = [{{ name = \"in\", at = {:?} }}, {{ name = \"ball\", ball = 0 }}]\n",
            map(0.41, 0.37),
            newmark("consistent", 1e-3, 0.3),
            map(0.7, 0.3)
        )
    };
    same(&run(&scene(false)), &run(&scene(true)), 1e-10);
}
