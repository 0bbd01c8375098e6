//! Effects on a plate, each compared with an exact or a published result.

use crate::common::models::{CLAMPED, UNIT};
use crate::common::scenes;
use crate::common::scenes::{
    STILL, all_round, close, grid, inspect, model, newmark, off, refusal, run, run_to_end, same, scene,
};
use rebond::assembly::Probe;
use rebond::mesh::Point;
use rebond::simulation;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::PathBuf;

/// Returns the work of a scene's constant load on a deflection with its slopes, before supports.
fn work(text: &str, shape: impl Fn(Point) -> [f64; 3]) -> f64 {
    let scene = scene(text);
    let mesh = simulation::mesh(&scene).unwrap();
    let load = simulation::matrices(&scene, &mesh, false).unwrap().load;
    load.iter().zip(mesh.nodes.iter().flat_map(|node| shape(*node))).map(|(f, u)| f * u).sum()
}

const PLATE: &str = "plate = { length = 2, width = 1, thickness = 0.1, youngs_modulus = 1e6, poissons_ratio = 0.3, density = 30 }\n";

/// The work of a pressure of degree 3 on deflections of degree 2, which both elements contain, is
/// integrated without error.
#[test]
fn a_cubic_pressure_is_exact() {
    for element in ["fvs", "hct"] {
        let text = [PLATE, &grid(element, 3, 2), "load.pressure = \"x^3 - 4*x*y^2 + 5\"\n", STILL].concat();
        // These are the integrals over 2 x 1 of p times 1, x, x y, y^2.
        close("1", work(&text, |_| [1.0, 0.0, 0.0]), 4.0 - 8.0 / 3.0 + 10.0, 1e-14);
        close("x", work(&text, |p| [p.x, 1.0, 0.0]), 6.4 - 32.0 / 9.0 + 10.0, 1e-14);
        close("x y", work(&text, |p| [p.x * p.y, p.y, p.x]), 3.2 - 8.0 / 3.0 + 5.0, 1e-14);
        close("y^2", work(&text, |p| [p.y * p.y, 0.0, 2.0 * p.y]), 4.0 / 3.0 - 1.6 + 10.0 / 3.0, 1e-14);
    }
}

/// Gravity is the pressure -rho h g, and acts on every mass that the plate carries.
#[test]
fn gravity_is_a_pressure() {
    for element in ["fvs", "hct"] {
        let text = [PLATE, &grid(element, 3, 2), "load.gravity = 9.81\n", STILL].concat();
        let shape = |p: Point| [1.0 + p.x - 2.0 * p.y * p.x, 1.0 - 2.0 * p.y, -2.0 * p.x];
        let pressure = text.replace("load.gravity = 9.81", "load.pressure = -29.43");
        close("weight", work(&text, shape), work(&pressure, shape), 1e-14);
        let laden = text + "mass = [{ at = [0.7, 0.3], mass = 4 }, { at = [2, 1], mass = 1 }]\n";
        close("laden", work(&laden, |_| [1.0, 0.0, 0.0]), -9.81 * 11.0, 1e-14);
        close("moment", work(&laden, |p| [p.x, 1.0, 0.0]), -9.81 * (6.0 + 2.8 + 2.0), 1e-14);
        close("mass", inspect(&laden).mass, 11.0, 1e-14);
    }
}

/// A stiff plate with a mass on it stands on springs whose base accelerates by a(t) = a sin(W t):
/// relative to the base it moves by -a/(w^2 - W^2) (sin W t - W/w sin w t), with w^2 = k/m.
#[test]
fn a_base_accelerates_everything_on_it() {
    let (mass, stiffness, amplitude, rate) = (9.0, 3600.0, 2.0, 7.0);
    let w = f64::sqrt(stiffness / mass);
    let exact = |t: f64| -amplitude / (w * w - rate * rate) * ((rate * t).sin() - rate / w * (w * t).sin());
    let springs =
        [[0, 0], [2, 0], [0, 1], [2, 1]].map(|[x, y]| format!("{{ at = [{x}, {y}], stiffness = 900 }}"));
    for (mass, tolerance) in [("singular", 2e-6), ("consistent", 2e-6)] {
        let text = format!(
            "{}{}spring = [{}]\nmass = [{{ at = [1, 0.5], mass = 3 }}]\n\
             load.base_acceleration = \"{amplitude}*sin({rate}*t)\"\n{}\
             output.probes = [{{ name = \"middle\", at = [1, 0.5] }}]\n",
            PLATE.replace("1e6", "1e12"),
            grid("fvs", 4, 2),
            springs.join(", "),
            newmark(mass, 1e-4, 1.0)
        );
        let error = off(&run(&text), exact);
        assert!(error < tolerance, "{mass}: {error:e}");
    }
}

/// A cantilever whose clamp accelerates moves, relative to the clamp, as in the frame of the clamp.
#[test]
fn an_accelerated_frame_is_that_of_a_moving_support() {
    let text = |support: &str, load: &str| {
        format!(
            "{UNIT}{}support = [{{ edge = \"left\", kind = \"clamped\"{support} }}]\n{load}{}\
             output.probes = [{{ name = \"tip\", at = [1, 0] }}]\n",
            grid("hct", 4, 4),
            newmark("consistent", 1e-3, 0.5)
        )
    };
    let moved = run(&text(", motion = \"0.3*t^2\"", ""));
    let shaken = run(&text("", "load.base_acceleration = 0.6\n"));
    let told = scene(&text("", "load.base_acceleration = 0.6\n")).effects().join(", ");
    assert!(told.contains("accelerated base (results relative to it)"), "{told}");
    let largest = shaken.iter().fold(0.0, |largest: f64, row| largest.max(row.probes[0].abs()));
    for (moved, shaken) in moved.iter().zip(&shaken) {
        let relative = moved.probes[0] - 0.3 * moved.time * moved.time;
        assert!((relative - shaken.probes[0]).abs() < 2e-3 * largest, "t = {}", moved.time);
    }
}

/// By Timoshenko and Woinowsky-Krieger, *Theory of Plates and Shells*, 1959, article 34, w =
/// 0.01160 P a^2 / D under a force in the middle of a simply supported square. The effects of two
/// point forces at each other's place are equal.
#[test]
fn point_forces() {
    let mut before = 1.0;
    for cells in [8, 16, 32] {
        let text = format!(
            "{UNIT}{}{}initial.equilibrium = true\n{STILL}load.force = [{{ at = [0.5, 0.5], value = 1 }}]\n\
             output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
            grid("fvs", cells, cells),
            all_round("simply_supported")
        );
        let error = 1.0 - run(&text)[0].probes[0] / 0.011_600_8;
        assert!(error > 0.0 && error < before / 3.0, "{cells}: {error}");
        before = error;
    }
    assert!(before < 2e-3, "{before}");

    let deflection = |at: [f64; 2], other: [f64; 2]| {
        let text = format!(
            "{UNIT}{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\ninitial.equilibrium = true\n{STILL}\
             load.force = [{{ at = {at:?}, value = 3 }}]\noutput.probes = [{{ name = \"there\", at = {other:?} }}]\n",
            grid("hct", 5, 4)
        );
        run(&text)[0].probes[0]
    };
    let (a, b) = ([0.33, 0.71], [0.9, 0.12]);
    close("reciprocity", deflection(a, b), deflection(b, a), 1e-11);
}

/// A moment bends a strip by M L^2 / 2 EI, downwards about y; what it does to a deflection, a force
/// there does to its rotation (Betti).
#[test]
fn a_moment_at_a_point() {
    let deflection = |plate: &str, mesh: &str, load: &str, probe: &str| {
        let text = format!(
            "{plate}{mesh}support = [{{ edge = \"left\", kind = \"clamped\" }}]\ninitial.equilibrium = true\n{STILL}\
             load.{load}\noutput.probes = [{{ name = \"there\", {probe} }}]\n"
        );
        run(&text)[0].probes[0]
    };
    let strip = "plate = { length = 1, width = 0.02, thickness = 0.01, youngs_modulus = 1.2e9, poissons_ratio = 0, density = 1 }\n";
    for element in ["fvs", "hct"] {
        let tip = |load: &str| deflection(strip, &grid(element, 50, 2), load, "at = [1, 0.01]");
        let bent = tip("moment = [{ at = [1, 0.01], about = \"y\", value = 0.3 }]");
        close("M L^2 / 2 EI", bent, -0.3 / (2.0 * 1.2e9 * 0.02 * 1e-6 / 12.0), 2e-3);
        // About x it only twists the strip.
        assert!(tip("moment = [{ at = [1, 0.01], about = \"x\", value = 0.3 }]").abs() <= 1e-3 * bent.abs());
    }
    let (a, b) = ("at = [0.33, 0.71]", "at = [0.9, 0.12]");
    for (about, slope, sign) in [("x", "slope_y", 1.0), ("y", "slope_x", -1.0)] {
        let moment = format!("moment = [{{ {a}, about = \"{about}\", value = 2 }}]");
        let turned = format!("{a}, quantity = \"{slope}\"");
        let mesh = grid("hct", 5, 4);
        let deflected = deflection(UNIT, &mesh, &moment, b);
        let rotation = sign * deflection(UNIT, &mesh, &format!("force = [{{ {b}, value = 2 }}]"), &turned);
        close(about, deflected, rotation, 1e-11);
    }
}

/// Returns a run of a clamped plate under a load, with its deflections at two points.
fn loaded(load: &str) -> Vec<scenes::Instant> {
    run(&format!(
        "{UNIT}{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n{load}\n{}\
         output = {{ every = 10, probes = [{{ name = \"tip\", at = [1, 0] }}, {{ name = \"in\", at = [0.3, 0.6] }}] }}\n",
        grid("fvs", 4, 4),
        newmark("singular", 1e-3, 0.5)
    ))
}

/// A load gives the same motion in each form: constant, as a product of time and place, as a sum of
/// products, and as a formula that is neither.
#[test]
fn loads_in_time() {
    let constant = loaded("load.pressure = 3");
    same(&constant, &loaded("load.pressure = \"3 + 0*t\""), 1e-13);
    same(&constant, &loaded("load.pressure = \"3*(sin(t)^2 + cos(t)^2)\""), 1e-13);
    same(&constant, &loaded("load.pressure = \"exp(x - t)*exp(t - x)*3\""), 1e-13);

    // This load travels. The formula exp(x - 2t) is a finite sum of products, unlike exp(-(x -
    // 2t)^2).
    let products = loaded("load.pressure = \"exp(x)*exp(-2*t) + y*sin(9*t)\"");
    same(&products, &loaded("load.pressure = \"exp(x - 2*t) + y*sin(9*t)\""), 1e-13);
    same(
        &loaded("load.pressure = \"sin(3*x - 5*t)\""),
        &loaded("load.pressure = \"hypot(sin(3*x - 5*t), 0)*sign(sin(3*x - 5*t))\""),
        1e-5,
    );

    // A pressure around a point converges to a point force as its patch shrinks.
    let force = loaded("load.force = [{ at = [0.5, 0.5], value = \"sin(7*t)\" }]");
    let twice = loaded(
        "load.force = [{ at = [0.5, 0.5], value = \"2*sin(7*t)\" }, { at = [0.5, 0.5], value = \"-sin(7*t)\" }]",
    );
    same(&force, &twice, 1e-13);
    let steady = loaded("load.force = [{ at = [0.5, 0.5], value = 1 }]");
    same(&steady, &loaded("load.force = [{ at = [0.5, 0.5], value = \"1 + 0*t\" }]"), 1e-13);
}

#[test]
fn measured_loads() {
    let file = |name: &str, rows: &str| {
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(name);
        fs::write(&path, rows).unwrap();
        path.to_string_lossy().into_owned()
    };
    let ramp = file("ramp.csv", "time,value\n0,0\n0.2,1\n9,1\n");
    let table = loaded(&format!(
        "load.pressure = {{ table = '{ramp}', interpolation = \"linear\", times = \"4*x*y\" }}"
    ));
    same(&table, &loaded("load.pressure = \"4*x*y*min(5*t, 1)\""), 1e-13);
    // The natural spline through -1, 0, 1 is straight; through 0, 1, 0 it is (3 s - s^3) / 2 up to
    // its maximum.
    let bump = file("bump.csv", "0,0\n0.25,1\n0.5,0\n");
    let table = loaded(&format!(
        "load.force = [{{ at = [1, 1], value = {{ table = '{bump}', interpolation = \"spline\", times = 2 }} }}]"
    ));
    same(
        &table,
        &loaded("load.force = [{ at = [1, 1], value = \"3*(1 - abs(4*t - 1)) - (1 - abs(4*t - 1))^3\" }]"),
        1e-13,
    );
}

/// Rigid plate of 1 kg on four springs of 25 N/m at its corners, or on a foundation of 100 N/m3,
/// which heaves at 10 rad/s.
const RAFT: &str = "plate = { length = 1, width = 1, thickness = 1, youngs_modulus = 1e9, poissons_ratio = 0, density = 1 }\n";
const SPRINGS: &str = "spring = [{ at = [0, 0], stiffness = 25 }, { at = [1, 0], stiffness = 25 }, \
    { at = [0, 1], stiffness = 25 }, { at = [1, 1], stiffness = 25 }]\n";
const FOUNDATION: &str = "foundation = [{ stiffness = 60 }, { stiffness = 40, where = \"x < 2\" }]\n";

#[test]
fn springs_and_foundations_carry_a_raft() {
    // The rigid motions are heave and two rotations. With springs at the corners the rotations have
    // omega^2 = 12 k / m; on a foundation all three frequencies are equal.
    let lowest = inspect(&[RAFT, &grid("fvs", 4, 4), SPRINGS, STILL].concat()).consistent.lowest;
    assert_eq!(lowest.len(), 6);
    for (value, expected) in lowest.iter().zip([10.0, 300_f64.sqrt(), 300_f64.sqrt()]) {
        // The plate bends a little, with k a^2 / D = 3e-4.
        close("springs", TAU * value, expected, 1e-3);
    }
    let lowest = inspect(&[RAFT, &grid("hct", 4, 4), FOUNDATION, STILL].concat()).consistent.lowest;
    for value in &lowest[..3] {
        close("foundation", TAU * value, 10.0, 1e-5);
    }
}

/// A foundation adds k / (rho h) to the square of every frequency; for a simply supported plate
/// this is D k^4 + k_f.
#[test]
fn a_foundation_lifts_all_frequencies_alike() {
    for element in ["fvs", "hct"] {
        let of = |foundation: &str| {
            inspect(
                &[UNIT, &grid(element, 12, 12), &all_round("simply_supported"), foundation, STILL].concat(),
            )
            .consistent
            .lowest
        };
        let (bare, laid) = (of(""), of("foundation = [{ stiffness = \"900*(1 + 0*x)\" }]\n"));
        for (bare, laid) in bare.iter().zip(laid) {
            close("difference", (TAU * laid).powi(2) - (TAU * bare).powi(2), 900.0, 1e-7);
        }
        close(
            "first",
            (TAU * of("foundation = [{ stiffness = 900 }]\n")[0]).powi(2),
            4.0 * PI.powi(4) + 900.0,
            1e-2,
        );
    }
}

/// A mass M in the middle of a simply supported square satisfies 1 / M = sum over modes of 4 phi^2
/// w^2 / (w_mn^2 - w^2).
#[test]
fn an_added_mass() {
    let mass = 0.7;
    let left_over = |w2: f64| {
        let odd = (1..400).step_by(2).map(|m| f64::from(m * m));
        let modes = odd.clone().flat_map(|m| odd.clone().map(move |n| (PI * PI * (m + n)).powi(2)));
        modes.map(|mode| 4.0 * w2 / (mode - w2)).sum::<f64>() - 1.0 / mass
    };
    let (mut low, mut high) = (0.0, 4.0 * PI.powi(4) * (1.0 - 1e-9));
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if left_over(middle) > 0.0 { high = middle } else { low = middle }
    }
    let exact = low.sqrt() / TAU;
    // The mass is on a node that four cells share, or at the centre of a cell.
    for cells in [[8, 16], [7, 17]] {
        let errors = cells.map(|cells| {
            let text = [UNIT, &grid("fvs", cells, cells), &all_round("simply_supported"), STILL].concat();
            let inspection = inspect(&format!("{text}mass = [{{ at = [0.5, 0.5], mass = {mass} }}]\n"));
            [inspection.consistent, inspection.singular].map(|of| of.lowest[0] / exact - 1.0)
        });
        let [coarse, fine] = errors;
        for (k, most) in [3e-3, 4e-3].into_iter().enumerate() {
            assert!(fine[k] > -1e-6 && fine[k] < coarse[k] / 3.0 && fine[k] < most, "{cells:?}: {errors:?}");
        }
    }
}

/// The velocity of a rigid ball would jump where supports hold the plate.
#[test]
fn a_rigid_ball_over_a_support_is_refused() {
    let scene = |more: &str| {
        [
            UNIT,
            &grid("fvs", 4, 4),
            &all_round("clamped"),
            more,
            "time = { scheme = \"conserving\", mass = \"singular\", step = 1e-3, end = 1e-3 }\n",
        ]
        .concat()
    };
    let error = refusal(&scene("ball = [{ at = [0, 0.5], mass = 1, height = 0.1 }]\n")).to_string();
    assert!(error.contains("[[ball]] is above a point that supports hold"), "{error}");
    model(&scene("ball = [{ at = [0, 0.5], mass = 1, height = 0.1, stiffness = 10 }]\n"));
}

/// Returns x with x'' + a x' + (w^2 + b w^2 d/dt) x = 0, from x = 0 with velocity 1 and from x = 1
/// at rest.
fn damped(alpha: f64, beta: f64, t: f64) -> [f64; 2] {
    let w2 = 100.0;
    let decay = 0.5 * (alpha + beta * w2);
    let w = (w2 - decay * decay).sqrt();
    let fade = (-decay * t).exp();
    [fade * (w * t).sin() / w, fade * ((w * t).cos() + decay / w * (w * t).sin())]
}

/// The heave of the raft is correct in every scheme with every mass and every damping that the
/// scheme allows.
#[test]
fn damped_heave() {
    let schemes = [
        ("newmark", "singular", 2e-5),
        ("newmark", "consistent", 2e-5),
        ("midpoint", "singular", 2e-5),
        ("midpoint", "consistent", 2e-5),
        ("conserving", "singular", 2e-5),
        ("exact", "singular", 1e-8),
    ];
    for (scheme, mass, tolerance) in schemes {
        for (alpha, beta) in [(0.0, 0.0), (1.5, 0.0), (0.0, 0.01), (0.7, 0.02)] {
            if (scheme == "exact" || scheme == "conserving") && beta > 0.0 {
                continue;
            }
            // Heave is a mode of its own, however soft the raft.
            let raft = [RAFT, &grid("fvs", 2, 2), FOUNDATION].concat();
            let rest = format!(
                "damping = {{ mass = {alpha:?}, stiffness = {beta:?} }}\n\
                 time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-3, end = 1 }}\n\
                 output.probes = [{{ name = \"corner\", at = [1, 0] }}]\n"
            );
            let thrown = run(&format!("{raft}{rest}initial.velocity = 1\n"));
            let error = off(&thrown, |t| damped(alpha, beta, t)[0]);
            assert!(error <= tolerance, "{scheme} {mass} {alpha} {beta}: velocity, {error:e}");
            let let_go = run(&format!("{raft}{rest}initial.deflection = 1\n"));
            let error = off(&let_go, |t| damped(alpha, beta, t)[1]);
            assert!(error <= 10.0 * tolerance, "{scheme} {mass} {alpha} {beta}: deflection, {error:e}");
        }
    }
}

/// Initial deflections and slopes are those of the formula. Quadratics, which both elements
/// contain, have their exact energy, D (1 - nu) for x y on the unit square.
#[test]
fn a_start_has_the_energy_of_its_formula() {
    for element in ["fvs", "hct"] {
        let start = |initial: &str, mass: &str| {
            let end = newmark(mass, 1e-6, 1e-6);
            let probes = "output.probes = [{ name = \"in\", at = [0.37, 0.61] }]\n";
            run(&[UNIT, &grid(element, 3, 4), initial, &end, probes].concat())[0].clone()
        };
        let bent = start("initial.deflection = \"2*x*y + 1\"\n", "singular");
        close("elastic", bent.energy, 4.0 * 0.7, 1e-12);
        close("probe", bent.probes[0], 1.0 + 2.0 * 0.37 * 0.61, 1e-14);
        // The exact value is 1/2 int (x + 2 y)^2.
        close(
            "kinetic",
            start("initial.velocity = \"x + 2*y\"\n", "consistent").energy,
            0.5 * (1.0 / 3.0 + 1.0 + 4.0 / 3.0),
            1e-12,
        );
    }
}

/// A start in the first mode stays in this mode: no other mode appears, and the frequency is pi.
#[test]
fn a_start_in_a_mode_stays_in_it() {
    let text = format!(
        "{UNIT}{}{}initial.deflection = \"1e-3*sin(pi*x)*sin(pi*y)\"\n{}\
         output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}, {{ name = \"off\", at = [0.25, 0.5] }}]\n",
        grid("fvs", 16, 16),
        all_round("simply_supported"),
        newmark("consistent", 1e-4, 0.5)
    );
    let rows = run(&text);
    assert!(off(&rows, |t| 1e-3 * (TAU * PI * t).cos()) < 1.5e-5);
    for row in &rows {
        assert!((row.probes[1] - 0.5_f64.sqrt() * row.probes[0]).abs() < 3e-6, "{}", row.time);
    }
}

/// A plate in its first mode, at 2 pi^2 rad/s, decays with the ratio that `damping.modal` gives;
/// the second mode has another ratio.
#[test]
fn a_damping_ratio_is_the_modes_own() {
    let (w, ratio) = (TAU * PI, 0.05);
    let turns = w * (1.0_f64 - ratio * ratio).sqrt();
    // The tolerance is the error of the mesh's frequency, which is smaller with the consistent
    // mass.
    let two = "[0.05, 0.5]";
    for (scheme, mass, ratios, tolerance) in [
        ("newmark", "consistent", two, 1e-5),
        ("newmark", "singular", two, 3e-5),
        ("midpoint", "consistent", two, 1e-5),
        // One number is the ratio of all modes.
        ("conserving", "modal", "0.05", 1e-5),
    ] {
        let text = format!(
            "{UNIT}{}{}initial.deflection = \"1e-3*sin(pi*x)*sin(pi*y)\"\ndamping.modal = {ratios}\n\
             time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-4, end = 0.5 }}\n\
             output.probes = [{{ name = \"centre\", at = [0.5, 0.5] }}]\n",
            grid("fvs", 16, 16),
            all_round("simply_supported"),
        );
        let damped = |t: f64| {
            1e-3 * (-ratio * w * t).exp() * ((turns * t).cos() + ratio * w / turns * (turns * t).sin())
        };
        let error = off(&run(&text), damped);
        assert!(error < tolerance, "{scheme} {mass}: {error:e}");
    }
}

/// A plate that starts in equilibrium under its loads stays there, also on its obstacle.
#[test]
fn equilibrium_stays() {
    for contact in
        ["", "obstacle = [{ side = \"below\", height = \"-0.03 - 0.01*x\", where = \"x > 0.4\" }]\n"]
    {
        let text = |initial: &str| {
            format!(
                "{UNIT}{}support = [{{ edge = \"left\", kind = \"clamped\" }}]\n{contact}{initial}\n{}\
                 load = {{ gravity = 0.5, pressure = \"0.1*x - 0.2*t*0\", force = [{{ at = [0.6, 0.2], value = \"-0.1*cos(t*0)\" }}] }}\n\
                 spring = [{{ at = [1, 1], stiffness = 2 }}]\n\
                 output.probes = [{{ name = \"tip\", at = [1, 0] }}, {{ name = \"in\", at = [0.3, 0.6] }}]\n",
                grid("fvs", 5, 4),
                newmark("singular", 1e-3, 0.1)
            )
        };
        let (rows, outcome) = run_to_end(&text("initial.equilibrium = true"));
        assert!(rows[0].probes[0] < -0.02);
        assert_eq!(outcome.contact_steps > 0, !contact.is_empty());
        for row in &rows {
            for (now, then) in row.probes.iter().zip(&rows[0].probes) {
                assert!((now - then).abs() < 1e-10, "t = {}: {now} after {then}", row.time);
            }
        }
        // A plate that does not start in equilibrium moves.
        assert!(off(&run(&text("")), |_| 0.0) > 1e-3);
    }
}

/// Obstacles act everywhere, by condition, group, point and line; of several on a side the nearest
/// counts.
#[test]
fn obstacles_bound_what_they_are_opposite_to() {
    let plate = [UNIT, &grid("fvs", 4, 4), &all_round("guided"), STILL].concat();
    let bounds = |obstacles: &str| {
        let model = model(&format!("{plate}obstacle = [{obstacles}]\n"));
        let bounds = &model.system.bounds;
        let sites = model.sites[..bounds.len()].iter();
        sites
            .zip(bounds.lower.iter().zip(&bounds.upper))
            .map(|(site, (l, u))| (site.at, [*l, *u]))
            .collect::<Vec<_>>()
    };
    const NONE: f64 = f64::INFINITY;
    let all = bounds(
        "{ side = \"below\", height = \"-1 - x*y\" }, { side = \"above\", height = 2, where = \"x > 0.6\" }, \
                      { side = \"below\", height = -1.1, where = \"y > 0.4\" }",
    );
    assert_eq!(all.len(), 25);
    for ([x, y], [lower, upper]) in all {
        assert_eq!(lower, if y > 0.4 { (-1.0 - x * y).max(-1.1) } else { -1.0 - x * y });
        assert_eq!(upper, if x > 0.6 { 2.0 } else { NONE });
    }
    let point = bounds("{ side = \"above\", height = 0.1, at = [0.25, 0.75] }");
    assert_eq!(point, [([0.25, 0.75], [-NONE, 0.1])]);
    let line = bounds("{ side = \"below\", height = -0.1, line = [[0, 0.25], [0.5, 0.25]] }");
    let places: Vec<[f64; 2]> = line.iter().map(|(at, _)| *at).collect();
    assert_eq!(places, [[0.0, 0.25], [0.25, 0.25], [0.5, 0.25]]);

    // A group consists of the nodes of its cells.
    let mesh = "plate = { thickness = 1, youngs_modulus = 1, poissons_ratio = 0, density = 1 }\nmesh.file = 'gmsh/square_41_text.msh'\n";
    let mesh = [mesh, &all_round("guided"), STILL].concat();
    let read =
        rebond::mesh::Mesh::load("tests/data/gmsh/square_41_text.msh", rebond::mesh::Import::default())
            .unwrap();
    for (group, cells) in &read.groups {
        let model =
            model(&format!("{mesh}obstacle = [{{ side = \"below\", height = -1, group = \"{group}\" }}]\n"));
        let mut nodes: Vec<usize> =
            cells.iter().flat_map(|&cell| read.cells[cell].nodes().to_vec()).collect();
        nodes.sort_unstable();
        nodes.dedup();
        let bounded: Vec<usize> =
            model.sites[..model.system.bounds.len()].iter().map(|site| site.node).collect();
        assert_eq!(bounded, nodes, "{group}");
    }
}

/// Errors that only the mesh reveals; each message begins with the key.
#[test]
fn errors_name_the_key() {
    let plate = [UNIT, &grid("fvs", 4, 4), STILL].concat();
    let cases = [
        (
            "support = [{ at = [1.3, 0.3], kind = \"clamped\" }]",
            "support.0.at: the point (1.3, 0.3) lies outside the plate; the nearest node is at (1, 0.25)",
        ),
        (
            "support = [{ edge = \"left\", where = \"y > 5\", kind = \"clamped\" }]",
            "support.0.where: it holds at both ends of no cell's side",
        ),
        (
            "obstacle = [{ side = \"below\", height = -1, where = \"x > 5\" }]",
            "obstacle.0.where: it holds at no node",
        ),
        (
            "obstacle = [{ side = \"below\", height = -1, group = \"rubber\" }]",
            "obstacle.0.group: the mesh has no group named \"rubber\"",
        ),
        (
            "obstacle = [{ side = \"below\", height = -1, line = [[0, 1.1], [1, 1.1]] }]",
            "obstacle.0.line: no node lies on it",
        ),
        ("obstacle = [{ side = \"below\", height = \"-1/x\" }]", "obstacle.0.height: column 1: -1/x is"),
        (
            "obstacle = [{ side = \"below\", height = \"-0.9 + x\" }, { side = \"above\", height = \"y\" }]",
            "obstacle: at (1, 0) those below and above leave no room at t = 0.0 s",
        ),
        ("part = [{ where = \"x > 5\", thickness = 1 }]", "part.0.where: it holds at the centre of no cell"),
        ("foundation = [{ stiffness = \"0.5 - x\" }]", "foundation.0.stiffness: -"),
        ("load.pressure = \"sqrt(x - 0.5)\"", "load.pressure: column 1: sqrt(x - 0.5) is NaN"),
        (
            "load.pressure = \"exp(x - t)*sqrt(x - 0.5)\"\ninitial.equilibrium = true\nsupport = [{ edge = \"left\", kind = \"clamped\" }]",
            "load.pressure: ",
        ),
        ("initial.deflection = \"sqrt(x)\"", "initial.deflection: column 1: no slope along x"),
        ("initial.velocity = \"1/x\"", "initial.velocity: column 1: 1/x is"),
        (
            "support = [{ edge = \"left\", kind = \"clamped\" }]\ninitial.deflection = \"x + y\"",
            "initial.deflection: ",
        ),
        (
            "support = [{ edge = \"left\", kind = \"clamped\" }]\ninitial.deflection = \"0.1*x\"",
            "initial.deflection: a slope of 0.1 at (0, 0), where a support holds the plate at 0",
        ),
        (
            "support = [{ edge = \"left\", kind = \"clamped\" }]\ninitial.deflection = \"-x^2*(1 - y/4)\"\nobstacle = [{ side = \"below\", height = -0.5 }]",
            "initial.deflection: at (1, 0) the plate starts 5.000e-1 m beyond obstacle.0.height; expected",
        ),
        (
            "support = [{ edge = \"left\", kind = \"simply_supported\", motion = \"t\" }, { edge = \"left\", where = \"y < 0.3\", kind = \"simply_supported\" }]",
            "support.0.motion: supports that move differently must hold the plate",
        ),
        (
            "support = [{ edge = \"left\", kind = \"clamped\", motion = \"t\" }, { edge = \"top\", kind = \"clamped\" }]",
            "support.0.motion: the node at (0, 1) is also held by a support that moves otherwise",
        ),
    ];
    for (rest, words) in cases {
        let error = refusal(&format!("{plate}{rest}\n"));
        assert_eq!(error.exit_code(), 2, "{error}");
        assert!(error.to_string().starts_with(words), "{error}\nexpected {words}");
    }
    // Entries of several, or with a name, are also counted from 1.
    let second = "support = [{ edge = \"left\", kind = \"clamped\" }, { name = \"bolt\", at = [1.3, 0.3], kind = \"clamped\" }]";
    let said = refusal(&format!("{plate}{second}\n")).to_string();
    assert!(said.starts_with("support.1.at: ") && said.ends_with("; this is support 2 (\"bolt\")"), "{said}");
    let nowhere = "support = [{ edge = \"left\", kind = \"clamped\" }, { edge = \"top\", where = \"x < 0\", kind = \"clamped\" }]";
    let said = refusal(&format!("{plate}{nowhere}\n")).to_string();
    assert!(said.starts_with("support.1.where: ") && said.ends_with("; this is support 2"), "{said}");
    let taper = plate.replace("thickness = 1", "thickness = \"0.5 - x\"");
    assert!(refusal(&taper).to_string().starts_with("plate.thickness: "));
    // Nothing can move where all dofs are held.
    let held = format!("{UNIT}{}{}{STILL}", grid("fvs", 1, 1), all_round("clamped"));
    assert!(refusal(&held).to_string().contains("nothing can move"));
    run(&format!("{plate}{CLAMPED}"));
}

/// A probe gives the element's own deflection anywhere in a cell, and only the nodal value at a
/// node.
#[test]
fn probes_see_the_element() {
    let scene = scene(&[UNIT, &grid("fvs", 4, 4), STILL].concat());
    let mesh = simulation::mesh(&scene).unwrap();
    let at_node = Probe::of_shape(&mesh, Point::new(0.5, 0.75)).unwrap();
    assert_eq!(at_node.weights().len(), 1);
    let inside = Probe::of_shape(&mesh, Point::new(0.6, 0.7)).unwrap();
    let quadratic: Vec<f64> = mesh.nodes.iter().flat_map(|p| [p.x * p.y + 3.0, p.y, p.x]).collect();
    close("inside", inside.deflection(&quadratic), 0.42 + 3.0, 1e-14);
}
