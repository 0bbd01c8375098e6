//! Equilibrium of plates that rest on obstacles: reactions from moments, runs that stay at rest,
//! and plates that cannot rest.

use crate::common::Random;
use crate::common::models::{STRIP, UNIT};
use crate::common::scenes::{STILL, close, grid, model, off, refusal, run, scene};
use rebond::linalg::Engine;
use rebond::simulation::Model;

const REST: &str = "initial.equilibrium = true\nload.gravity = 2\n";

/// Returns the nodes at which obstacles bear at the start, and their forces in N.
fn reactions(model: &Model) -> Vec<([f64; 2], f64)> {
    let system = &model.system;
    let u = &model.start.displacement;
    let mut force = vec![0.0; u.len()];
    system.engine.multiply(&system.stiffness, u, &mut force).unwrap();
    let load = system.load.as_ref().unwrap();
    let of = |(i, &dof): (usize, &usize)| (model.sites[i].at, force[dof] - load[dof]);
    system.bounds.dofs.iter().enumerate().map(of).collect()
}

/// Returns the largest unbalanced force, beyond the rounding of its terms (needle-shaped cells have
/// large ones), and the largest penetration of an obstacle.
fn wrong(model: &Model) -> [f64; 2] {
    let system = &model.system;
    let u = &model.start.displacement;
    let (mut force, mut terms) = (vec![0.0; u.len()], vec![0.0; u.len()]);
    system.engine.multiply_with_magnitude(&(&system.stiffness).into(), u, [&mut force, &mut terms]).unwrap();
    let load = system.load.as_ref().unwrap();
    let near = 1e-9 + 1e-12 * u.iter().fold(0.0, |most: f64, u| most.max(u.abs()));
    let left = |dof: usize| {
        let left = match system.bounds.dofs.binary_search(&dof) {
            Ok(i) if u[dof] - system.bounds.lower[i] <= near => (load[dof] - force[dof]).max(0.0),
            Ok(i) if system.bounds.upper[i] - u[dof] <= near => (force[dof] - load[dof]).max(0.0),
            _ => (force[dof] - load[dof]).abs(),
        };
        left - 1e-13 * terms[dof]
    };
    [(0..u.len()).map(left).fold(0.0, f64::max), system.bounds.violation(u)]
}

fn stop([x, y]: [f64; 2], height: f64) -> String {
    format!("{{ side = \"below\", height = {height:?}, at = [{x:?}, {y:?}] }}")
}

/// Stops at two corners and the middle of the opposite side carry 2 N: the latter carries half,
/// wherever the stops are.
#[test]
fn three_stops_share_the_weight_by_moments() {
    for element in ["fvs", "hct"] {
        for heights in [[0.0; 3], [0.1, -0.4, 0.3], [-50.0, -50.0, -49.0]] {
            let places = [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]];
            let stops: Vec<String> = places.iter().zip(heights).map(|(at, h)| stop(*at, h)).collect();
            let stops = format!("obstacle = [{}]\n", stops.join(", "));
            let model = model(&[UNIT, &grid(element, 4, 4), &stops, REST, STILL].concat());
            for ((at, force), height) in reactions(&model).into_iter().zip(heights) {
                close("reaction", force, if at[1] > 0.5 { 1.0 } else { 0.5 }, 1e-9);
                let bound = model.sites.iter().position(|site| site.at == at).unwrap();
                let w = model.start.displacement[model.sites[bound].dof];
                assert!((w - height).abs() <= 1e-12 * height.abs().max(1.0), "{w}, on a stop at {height}");
            }
        }
    }
}

/// Stops at any points that are no nodes have the same reactions from moments.
#[test]
fn stops_off_the_nodes_share_the_weight_too() {
    for element in ["fvs", "hct"] {
        let stops = [[0.13, 0.22], [0.81, 0.17], [0.44, 0.93]].map(|at| stop(at, 0.0)).join(", ");
        let text = [UNIT, &grid(element, 4, 4), &format!("obstacle = [{stops}]\n"), REST, STILL].concat();
        let found = reactions(&model(&text));
        let moment = |arm: fn([f64; 2]) -> f64| found.iter().map(|(at, f)| f * arm(*at)).sum::<f64>();
        close("sum", moment(|_| 1.0), 2.0, 1e-9);
        close("moment in x", moment(|at| at[0]), 1.0, 1e-9);
        close("moment in y", moment(|at| at[1]), 1.0, 1e-9);
        assert!(found.len() == 3 && found.iter().all(|(_, f)| *f > 0.1), "{found:?}");
    }
}

/// On a floor all nodes touch it. In a bowl, far below, and between two obstacles every force is
/// balanced and none pulls.
#[test]
fn floors_bowls_and_gaps() {
    for height in [0.0, -3.0, 1e3] {
        let floor = format!("obstacle = [{{ side = \"below\", height = {height:?} }}]\n");
        let model = model(&[UNIT, &grid("fvs", 5, 4), &floor, REST, STILL].concat());
        assert_eq!(model.system.bounds.len(), 30);
        for site in &model.sites {
            let w = model.start.displacement[site.dof];
            assert!((w - height).abs() <= 1e-12 * height.abs().max(1.0), "{w} on a floor at {height}");
        }
        close("weight", reactions(&model).iter().map(|(_, f)| f).sum(), 2.0, 1e-9);
    }
    let bowls = [
        "{ side = \"below\", height = \"0.3*((x-0.6)^2 + (y-0.4)^2) - 7\" }",
        "{ side = \"below\", height = \"-3*(x - 0.5)^2 + y\", where = \"abs(x-0.5) > 0.2\" }, { side = \"above\", height = \"0.05 + 2*y\" }",
        "{ side = \"below\", height = \"2*abs(x - 0.55) + 0.1*abs(y-0.3)\" }",
    ];
    for element in ["fvs", "hct"] {
        for bowl in bowls {
            let bowl = format!("obstacle = [{bowl}]\n");
            let model = model(&[UNIT, &grid(element, 6, 5), &bowl, REST, STILL].concat());
            let [force, beyond] = wrong(&model);
            assert!(force <= 1e-9 && beyond <= 1e-12, "{bowl}: {force:e} N, {beyond:e} m");
        }
    }
}

/// A hinge with a stop, and a lever held down by a stop, have reactions from moments. A spring
/// holds as a support does.
#[test]
fn levers_rest_on_supports_and_stops() {
    let hinge = "support = [{ edge = \"left\", kind = \"simply_supported\" }]\n";
    let tip = "obstacle = [{ side = \"below\", height = 0.01, line = [[1, 0], [1, 0.1]] }]\n";
    let held = model(&[STRIP, &grid("fvs", 8, 2), hinge, tip, REST, STILL].concat());
    close("half the weight", reactions(&held).iter().map(|(_, f)| f).sum(), 0.1, 1e-9);

    let lever = "obstacle = [{ side = \"below\", height = 0, where = \"abs(x - 0.25) < 1e-6\" }, \
                 { side = \"above\", height = 0.02, where = \"x < 1e-6\" }]\n";
    let found = reactions(&model(&[STRIP, &grid("hct", 8, 2), lever, REST, STILL].concat()));
    let sum = |x: f64| found.iter().filter(|(at, _)| at[0] == x).map(|(_, f)| f).sum::<f64>();
    close("pivot", sum(0.25), 0.4, 1e-8);
    close("held down", sum(0.0), -0.2, 1e-8);

    // There is a spring at one corner, and stops at another corner and in the middle of the
    // opposite side. By moments the latter carries half of the weight, and the others a quarter.
    let spring = "spring = [{ at = [0, 0], stiffness = 100 }]\n";
    let stops = format!("obstacle = [{}, {}]\n", stop([1.0, 0.0], 0.0), stop([0.5, 1.0], 0.0));
    let sprung = model(&[UNIT, &grid("fvs", 4, 4), spring, &stops, REST, STILL].concat());
    let found = reactions(&sprung);
    close("opposite", found.iter().find(|(at, _)| at[1] == 1.0).unwrap().1, 1.0, 1e-8);
    close("beside", found.iter().find(|(at, _)| at[1] == 0.0).unwrap().1, 0.5, 1e-8);
}

/// Three stops lie almost in a line, and a plate balances on a ridge.
#[test]
fn hardly_held_and_balanced() {
    let near = [[0.0, 0.5], [1.0, 0.5], [0.5, 0.502]];
    for offset in [0.0, 0.001] {
        let stops = near.map(|[x, y]| stop([x, y - offset], 0.0)).join(", ");
        let text = [UNIT, &grid("fvs", 4, 4), &format!("obstacle = [{stops}]\n"), REST, STILL].concat();
        let model = model(&text);
        let [force, beyond] = wrong(&model);
        assert!(force <= 1e-6 && beyond <= 1e-12, "{offset}: {force:e} N, {beyond:e} m");
    }
    let ridge = "obstacle = [{ side = \"below\", height = 0, line = [[0.5, 0], [0.5, 1]] }]\n";
    let model = model(&[UNIT, &grid("fvs", 4, 4), ridge, REST, STILL].concat());
    let [force, beyond] = wrong(&model);
    assert!(force <= 1e-9 && beyond <= 1e-12, "{force:e} N, {beyond:e} m");
}

/// A plate that starts at rest stays at rest, with every scheme and mass.
#[test]
fn a_run_from_rest_stays_at_rest() {
    let probes = "output.probes = [{ name = \"a\", at = [0.7, 0.6] }, { name = \"b\", at = [0, 1] }]\n";
    let stops = [[0.1, 0.0], [1.0, 0.0], [0.5, 1.0]].map(|at| stop(at, -0.25)).join(", ");
    for (scheme, mass) in [
        ("newmark", "singular"),
        ("newmark", "consistent"),
        ("midpoint", "singular"),
        ("midpoint", "consistent"),
        ("conserving", "singular"),
        ("exact", "singular"),
    ] {
        let time = format!("time = {{ scheme = \"{scheme}\", mass = \"{mass}\", step = 1e-3, end = 0.2 }}\n");
        let text =
            [UNIT, &grid("fvs", 4, 4), &format!("obstacle = [{stops}]\n"), REST, &time, probes].concat();
        let rows = run(&text);
        let start = rows[0].probes[0];
        let moved = off(&rows, |_| start);
        assert!((start + 0.25).abs() > 1e-3 && moved <= 1e-10, "{scheme}, {mass}: {moved:e}");
    }
}

/// Balls stay where they are, even a ball that lies on the plate; static pressure and moving
/// obstacles have their values at t = 0.
#[test]
fn balls_pressure_and_moving_obstacles() {
    let floor = "obstacle = [{ side = \"below\", height = \"-1 + t\", where = \"x < 0.01 or x > 0.99\" }]\n";
    let ball = "ball = [{ at = [0.5, 0.5], mass = 0.1, height = 5 }]\n";
    let pressed = "initial.static_pressure = -2\n";
    let model = model(&[UNIT, &grid("fvs", 4, 4), floor, ball, pressed, STILL].concat());
    for site in model.sites.iter().filter(|site| site.at[0] == 0.0 && site.node < 25) {
        assert!((model.start.displacement[site.dof] + 1.0).abs() <= 1e-12);
    }
}

/// The error names the motion that no obstacle stops, and the key.
#[test]
fn what_nothing_holds_is_refused() {
    let cases = [
        ("obstacle = [{ side = \"above\", height = 1 }]\n", "it would fall for ever"),
        ("load.pressure = 9\nobstacle = [{ side = \"below\", height = 0 }]\n", "it would rise for ever"),
        (
            "obstacle = [{ side = \"below\", height = 0, where = \"x < 0.3\" }]\n",
            "it would tip about the line through (0.25",
        ),
        ("obstacle = [{ side = \"below\", height = 0, at = [0.5, 0.25] }]\n", "it would tip about the line"),
    ];
    for (obstacles, words) in cases {
        let error = refusal(&[UNIT, &grid("fvs", 4, 4), obstacles, REST, STILL].concat());
        assert_eq!(error.exit_code(), 2);
        let error = error.to_string();
        assert!(error.starts_with("initial.equilibrium: ") && error.contains("mechanism"), "{error}");
        assert!(error.contains(words), "{error}");
    }
}

/// Returns the depth of a point inside the triangles of some others, as a least barycentric
/// coordinate, which is negative outside all of them.
fn inside(at: [f64; 2], stops: &[[f64; 2]]) -> f64 {
    let area =
        |a: [f64; 2], b: [f64; 2], c: [f64; 2]| (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    let mut deepest = f64::NEG_INFINITY;
    for (i, &a) in stops.iter().enumerate() {
        for (j, &b) in stops.iter().enumerate().skip(i + 1) {
            for &c in &stops[j + 1..] {
                let whole = area(a, b, c);
                let parts = [area(at, b, c), area(a, at, c), area(a, b, at)].map(|part| part / whole);
                deepest = deepest.max(parts.into_iter().fold(f64::INFINITY, f64::min));
            }
        }
    }
    deepest
}

/// Asserts that under a random load on random stops there is an equilibrium if the load's resultant
/// lies among the stops, and a refusal otherwise.
fn random_stops(tries: u64) {
    let mut counts = [0, 0];
    for seed in 0..tries {
        let mut random = Random::new(seed);
        let stops: Vec<[f64; 2]> = (0..3 + random.below(3)).map(|_| [random.unit(), random.unit()]).collect();
        // The resultant of -(1 + a (x - 1/2) + b (y - 1/2)) acts at 1/2 + a/12, 1/2 + b/12.
        let [a, b] = [2.0 * random.signed(), 2.0 * random.signed()];
        let depth = inside([0.5 + a / 12.0, 0.5 + b / 12.0], &stops);
        if depth.abs() < 1e-3 {
            continue;
        }
        let height = 10.0_f64.powf(2.0 * random.signed());
        let stops: Vec<String> = stops.iter().map(|at| stop(*at, height * random.signed())).collect();
        let element = ["fvs", "hct"][random.below(2)];
        let text = [
            UNIT,
            &grid(element, 2 + random.below(3), 2 + random.below(3)),
            &format!("obstacle = [{}]\n", stops.join(", ")),
            &format!(
                "initial.equilibrium = true\nload.pressure = \"-(1 + {a}*(x - 0.5) + {b}*(y - 0.5))\"\n"
            ),
            STILL,
        ]
        .concat();
        match Model::new(&scene(&text)) {
            Ok(model) => {
                assert!(depth > 0.0, "seed {seed}: it rests, at depth {depth}");
                counts[0] += 1;
                let [force, beyond] = wrong(&model);
                assert!(force <= 1e-6 && beyond <= 1e-9 * height, "seed {seed}: {force:e} N, {beyond:e} m");
            }
            Err(error) => {
                let error = error.to_string();
                if error.contains("angles near 0 or 180") {
                    continue;
                }
                assert!(depth < 0.0 && error.contains("it would tip"), "seed {seed}, depth {depth}: {error}");
                counts[1] += 1;
            }
        }
    }
    assert!(counts.iter().all(|&count| 5 * count > tries), "{counts:?}");
}

#[test]
fn random_stops_hold_what_lies_among_them() {
    random_stops(100);
}

#[test]
#[ignore = "10,000 plates"]
fn ten_thousand_random_stops_hold_what_lies_among_them() {
    random_stops(10_000);
}
