//! The relaxed midpoint rule conserves the energy at every step, however long, and stays above the
//! obstacle.
//!
//! These tests measure what the documentation of the scheme proves: the energy of every state
//! equals the initial energy, gamma is at least 1/2, U(p) satisfies its optimality conditions, and
//! the scheme converges to the exact trajectory with order 2.

use crate::common::models::{CLAMPED, PAPER_FALL, PAPER_PLATE, UNIT};
use crate::common::{Random, largest, scenes, solve_dense};
use rebond::linalg::Engine;
use rebond::scene::Scene;
use rebond::scheme::{Conserving, Massless, Midpoint, Potential, Scheme, Solution, System};
use rebond::simulation::Model;

/// Returns the paper's plate on some cells, at rest under 14600 Pa above an obstacle.
fn falling_plate(element: &str, cells: [usize; 2], overrides: &[&str]) -> Scene {
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "{element}", cells = {cells:?} }}
        time = {{ scheme = "conserving", mass = "singular", step = 1e-4, end = 0.3 }}
        output = {{ probes = [{{ name = "corner", at = [1.2, 0] }}, {{ name = "far_corner", at = [1.2, 0.4] }}] }}
        "#
    );
    let overrides: Vec<String> = overrides.iter().map(|&o| o.into()).collect();
    Scene::from_str(&text, "plate", &overrides).unwrap()
}

/// Returns the largest magnitude of any part of the initial energy.
fn scale(scheme: &dyn Scheme) -> f64 {
    let energies = scheme.energies().unwrap();
    largest(&[energies.total(), energies.kinetic, energies.elastic, energies.work])
}

/// Runs a scene and asserts at every instant that its energy has changed by at most `allowed` times
/// the initial energy.
fn keeps_its_energy(scene: &Scene, allowed: f64) {
    let model = Model::new(scene).unwrap();
    let bounds = &model.system.bounds;
    let mut scheme = model.scheme(scene).unwrap();
    let (start, scale) = (scheme.energies().unwrap().total(), scale(scheme.as_ref()));
    let (mut drift, mut contacts) = (0.0f64, 0);
    while scheme.step() < scene.time.steps() {
        scheme.advance().unwrap();
        drift = drift.max((scheme.energies().unwrap().total() - start).abs() / scale);
        assert!(drift <= allowed, "t = {}: {drift:e}", scheme.time());
        assert!(scheme.step_report().kkt <= 1e-10, "t = {}: {:e}", scheme.time(), scheme.step_report().kkt);
        assert!(bounds.violation(scheme.displacement()) <= 1e-12);
        contacts += u64::from(scheme.reaction().iter().any(|r| *r != 0.0));
    }
    let relaxation = scheme.statistics().relaxation.unwrap();
    let Scene { mesh, time, .. } = scene;
    println!("{:?} {:?} dt = {:e}: {drift:.1e}, {relaxation:?}", mesh.element, mesh.cells, time.step);
    assert!(contacts > 0 && relaxation.relaxed_steps > 0, "contact came and went");
    assert!(relaxation.least_gamma >= 0.5 - 1e-9, "{}", relaxation.least_gamma);
}

#[test]
fn energy_is_kept_at_long_and_short_steps() {
    for element in ["fvs", "hct"] {
        for (step, end) in [("1e-3", "2"), ("1e-4", "0.5"), ("1e-5", "0.1")] {
            let [step, end] = [format!("time.step={step}"), format!("time.end={end}")];
            keeps_its_energy(&falling_plate(element, [10, 4], &[&step, &end]), 1e-11);
        }
    }
}

#[test]
#[ignore = "takes minutes"]
fn energy_is_kept_for_two_seconds() {
    for element in ["fvs", "hct"] {
        for step in ["1e-3", "5e-4", "1e-4", "5e-5", "1e-5", "5e-6", "1e-6"] {
            keeps_its_energy(
                &falling_plate(element, [10, 4], &[&format!("time.step={step}"), "time.end=2"]),
                1e-11,
            );
        }
        for step in ["1e-3", "1e-4", "1e-5"] {
            keeps_its_energy(&falling_plate(element, [20, 8], &[&format!("time.step={step}")]), 1e-10);
        }
        for (step, end) in [("1e-3", "0.3"), ("1e-4", "0.1")] {
            let [step, end] = [format!("time.step={step}"), format!("time.end={end}")];
            keeps_its_energy(&falling_plate(element, [80, 32], &[&step, &end]), 1e-9);
        }
    }
}

#[test]
fn energy_is_kept_where_the_midpoint_rule_multiplies_it() {
    let scene = |scheme| falling_plate("hct", [20, 8], &["time.step=1e-3", &format!("time.scheme={scheme}")]);
    let reflected =
        falling_plate("hct", [20, 8], &["time.step=1e-3", "time.scheme=midpoint", "time.massless=reflected"]);
    // The second value is from an independent program.
    for (scene, expected) in [(reflected, 8.54), (scene("midpoint"), 3603.0)] {
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let mut gain = 1.0f64;
        while scheme.step() < scene.time.steps() {
            scheme.advance().unwrap();
            gain = gain.max(scheme.energies().unwrap().total() / start);
        }
        println!("the midpoint rule multiplies the energy by {gain}");
        assert!((gain / expected - 1.0).abs() <= 0.01, "{gain}");
    }
    keeps_its_energy(&scene("conserving"), 1e-10);
}

#[test]
fn energy_is_kept_on_a_fine_mesh() {
    keeps_its_energy(&falling_plate("fvs", [80, 32], &["time.step=1e-3", "time.end=0.06"]), 1e-9);
}

/// A plate without supports is thrown between two obstacles under a load: all nodes land at once,
/// and all of them may stay.
#[test]
fn energy_is_kept_by_a_plate_thrown_flat_under_load() {
    for element in ["fvs", "hct"] {
        let text = format!(
            r#"
            {PAPER_PLATE}
            mesh = {{ element = "{element}", cells = [6, 2] }}
            obstacle = [{{ side = "below", height = -0.02 }}, {{ side = "above", height = 0.01 }}]
            load = {{ pressure = -762.2 }}
            initial = {{ velocity = 1.0 }}
            time = {{ scheme = "conserving", mass = "singular", step = 2e-4, end = 0.4 }}
            "#
        );
        keeps_its_energy(&Scene::from_str(&text, "thrown", &[]).unwrap(), 1e-11);
    }
}

/// Returns the exact deflections of the tip's corners at every ms.
fn exact(element: &str) -> Vec<[f64; 2]> {
    let path = format!("{}/tests/data/exact_{element}_10x4.csv", env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(path).unwrap();
    let row = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|number| number.parse().unwrap()).collect();
        [numbers[1], numbers[2]]
    };
    text.lines().skip(1).map(row).collect()
}

/// Returns the root mean square error of the tip's corners up to an end, in m.
fn error(element: &str, steps_a_ms: u64, end: f64) -> f64 {
    let step = format!("time.step={:e}", 1e-3 / steps_a_ms as f64);
    let scene = falling_plate(element, [10, 4], &[&step]);
    let model = Model::new(&scene).unwrap();
    let mut scheme = model.scheme(&scene).unwrap();
    let (mut sum, mut count) = (0.0, 0);
    for exact in exact(element).into_iter().skip(1).take((1e3 * end).round() as usize) {
        for _ in 0..steps_a_ms {
            scheme.advance().unwrap();
        }
        for (probe, exact) in model.probes.iter().zip(exact) {
            sum += (probe.deflection(scheme.displacement()) - exact).powi(2);
            count += 1;
        }
    }
    (sum / f64::from(count)).sqrt()
}

/// The order is 2 once the step resolves the fastest motion (9.1 kHz; 61 kHz on triangles), before
/// the first impact and after it.
#[test]
fn the_exact_trajectory_is_met_with_order_2() {
    for (element, end, steps, cap) in [("fvs", 0.05, [100, 400], 5e-8), ("fvs", 0.1, [200, 800], 4e-6)] {
        let [coarse, fine] = steps.map(|steps| error(element, steps, end));
        let order = (coarse / fine).log2() / 2.0;
        println!("{element} to {end} s: {coarse:.2e} m, {fine:.2e} m, order {order:.2}");
        assert!((1.7..2.3).contains(&order) && fine <= cap, "{element} to {end}: {coarse:e}, {fine:e}");
    }
}

#[test]
fn in_free_flight_it_is_the_midpoint_rule() {
    let scene = falling_plate("hct", [10, 4], &[]);
    let model = Model::new(&scene).unwrap();
    let mut conserving = Conserving::new(&model.system, 1e-4, model.start.clone()).unwrap();
    let mut midpoint =
        Midpoint::new(&model.system, 1e-4, Massless::Equilibrium, model.start.clone()).unwrap();
    while conserving.time() < 0.05 {
        conserving.advance().unwrap();
        midpoint.advance().unwrap();
        // The scheme corrects changes of the energy by rounding, of 1e-13.
        assert!(crate::common::difference(conserving.displacement(), midpoint.displacement()) <= 1e-10);
    }
    assert_eq!(conserving.statistics().relaxation.unwrap().relaxed_steps, 0);
}

/// The two reports of the midpoint rule have the same motion of p.
#[test]
fn the_massless_part_does_not_change_the_motion() {
    let scene = falling_plate("fvs", [10, 4], &[]);
    let model = Model::new(&scene).unwrap();
    let System { engine, mass, .. } = &model.system;
    let scheme = |massless| Midpoint::new(&model.system, 1e-4, massless, model.start.clone()).unwrap();
    let (mut least, mut flips) = (scheme(Massless::Equilibrium), scheme(Massless::Reflected));
    let mut apart = 0.0f64;
    while least.time() < 0.1 {
        least.advance().unwrap();
        flips.advance().unwrap();
        let mut p = [(); 2].map(|()| vec![0.0; engine.velocities(mass)]);
        engine.project(mass, least.displacement(), &mut p[0]).unwrap();
        engine.project(mass, flips.displacement(), &mut p[1]).unwrap();
        assert!(crate::common::difference(&p[0], &p[1]) <= 1e-9, "t = {}", least.time());
        assert!(model.system.bounds.violation(least.displacement()) <= 1e-15);
        let [least, flips] = [&least, &flips].map(|scheme| scheme.energies().unwrap());
        assert!((least.kinetic - flips.kinetic).abs() <= 1e-6);
        apart = apart.max((flips.elastic - least.elastic).abs());
    }
    assert!(apart > 1.0, "{apart} J flip to and fro");
}

/// U(p) satisfies its optimality conditions, which are sufficient: p is kept, the bounds hold,
/// reactions push only where something touches, and K U - F - G^T r is a combination of rows of B.
#[test]
fn the_minimiser_satisfies_its_optimality_conditions() {
    let mut random = Random::new(5);
    let mut touched = 0;
    for element in ["fvs", "hct"] {
        let model = Model::new(&falling_plate(element, [4, 2], &["load.pressure=-2000"])).unwrap();
        let System { engine, stiffness, mass, bounds, load, .. } = &model.system;
        let (dofs, cells) = (engine.dofs(), engine.velocities(mass));
        let mut potential = Potential::new(&model.system).unwrap();
        let rows: Vec<Vec<f64>> = (0..cells)
            .map(|cell| {
                let (mut unit, mut row) = (vec![0.0; cells], vec![0.0; dofs]);
                unit[cell] = 1.0;
                engine.project_transpose(mass, &unit, &mut row).unwrap();
                row
            })
            .collect();
        // Each dof is measured in its own unit, so that rounding is visible in all of them.
        let units: Vec<f64> =
            engine.diagonal(&stiffness.into()).unwrap().iter().map(|k| 1.0 / k.sqrt()).collect();
        for _ in 0..20 {
            let mut u: Vec<f64> = (0..dofs).map(|dof| 20.0 * units[dof] * random.signed()).collect();
            for (&dof, lower) in bounds.dofs.iter().zip(&bounds.lower) {
                u[dof] = (u[dof] + lower + 0.002).max(*lower);
            }
            let (mut before, mut after) = (vec![0.0; cells], vec![0.0; cells]);
            engine.project(mass, &u, &mut before).unwrap();
            let mut reaction = vec![0.0; bounds.len()];
            let verdict = potential.settle(0.0, &mut u, &mut reaction).unwrap();
            assert!(verdict.kkt <= 1e-10, "{:e}", verdict.kkt);
            engine.project(mass, &u, &mut after).unwrap();
            assert!(crate::common::difference(&before, &after) <= 1e-11 * largest(&before));
            assert!(bounds.violation(&u) <= 1e-15);
            for ((&dof, lower), r) in bounds.dofs.iter().zip(&bounds.lower).zip(&reaction) {
                assert!(*r == 0.0 || *r > 0.0 && (u[dof] - lower).abs() <= 1e-15);
                touched += u32::from(*r > 0.0);
            }
            let mut left = vec![0.0; dofs];
            engine.multiply(stiffness, &u, &mut left).unwrap();
            let size = (0..dofs).map(|dof| (units[dof] * left[dof]).abs()).fold(0.0, f64::max);
            for (left, load) in left.iter_mut().zip(load.as_ref().unwrap()) {
                *left -= load;
            }
            for (&dof, r) in bounds.dofs.iter().zip(&reaction) {
                left[dof] -= r;
            }
            // This is the part that rows of B do not explain, by least squares.
            let dot =
                |a: &[f64], b: &[f64]| (0..dofs).map(|i| units[i] * units[i] * a[i] * b[i]).sum::<f64>();
            let gram: Vec<f64> = rows.iter().flat_map(|a| rows.iter().map(move |b| dot(a, b))).collect();
            let right: Vec<f64> = rows.iter().map(|row| dot(row, &left)).collect();
            let share = solve_dense(&gram, &right).unwrap();
            for (row, share) in rows.iter().zip(&share) {
                left.iter_mut().zip(row).for_each(|(left, b)| *left -= share * b);
            }
            let left = (0..dofs).map(|dof| (units[dof] * left[dof]).abs()).fold(0.0, f64::max);
            assert!(left <= 1e-9 * size, "{element}: {left:e} of {size:e}");
        }
    }
    assert!(touched > 20, "{touched} nodes touch");
}

/// A plate that damping brings to rest, on compliant ground or in the air, never changes contact,
/// so that every state lies on its grid instant: the reported elastic energy is that of the
/// reported displacement, down to the rounding of the energy at the start.
#[test]
fn energies_are_those_of_the_instant_as_long_as_contact_stays() {
    for ground in ["", "foundation = [{ stiffness = 50 }]\n"] {
        let text = format!(
            "{UNIT}{CLAMPED}{}{ground}initial.static_pressure = 1\ndamping.mass = 3\n\
             time = {{ scheme = \"conserving\", mass = \"singular\", step = 1e-2, end = 6 }}\n",
            scenes::grid("fvs", 3, 3)
        );
        let scene = scenes::scene(&text);
        let model = Model::new(&scene).unwrap();
        let mut scheme = model.scheme(&scene).unwrap();
        let start = scheme.energies().unwrap().total();
        let mut force = vec![0.0; model.system.engine.dofs()];
        for _ in 0..scene.time.steps() {
            scheme.advance().unwrap();
            let elastic = 0.5
                * model
                    .system
                    .engine
                    .multiply(&model.system.stiffness, scheme.displacement(), &mut force)
                    .unwrap();
            let off = (scheme.energies().unwrap().elastic - elastic).abs();
            assert!(off <= 1e-12 * start, "step {}: off by {off:e} of {start:e} J\n{text}", scheme.step());
        }
        assert_eq!(scheme.statistics().relaxation.unwrap().relaxed_steps, 0);
    }
}
