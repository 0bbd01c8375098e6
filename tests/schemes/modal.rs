//! The exact scheme where the lowest modes carry all inertia, compared with an independent program
//! and theory.

use crate::common::difference;
use crate::common::models::{PAPER_FALL, PAPER_PLATE, UNIT};
use crate::common::scenes::run_to_end;
use crate::exact::{corners, table};
use faer::{Mat, Side};
use rebond::archive::Archive;
use rebond::linalg::{Engine, Form};
use rebond::scene::Scene;
use rebond::scheme::{Event, Exact, ExactOptions, ModalScheme, Scheme, Solution, Start};
use rebond::simulation::{DeflectionDof, Model};

/// Returns the paper's scene, or other tables in its place, with the modal mass.
pub fn modal_scene(tables: &str, element: &str, cells: [usize; 2], modes: usize, step: f64) -> Scene {
    let diagonal = if element == "hct" { ", diagonal = \"right\"" } else { "" };
    let text = format!(
        r#"
        {tables}
        mesh = {{ element = "{element}", cells = {cells:?}{diagonal} }}
        time = {{ scheme = "exact", mass = "modal", modes = {modes}, step = {step:e}, end = 0.2 }}
        output = {{ probes = [{{ name = "one", at = [1.2, 0.0] }}, {{ name = "other", at = [1.2, 0.4] }}] }}
        "#
    );
    Scene::from_str(&text, "plate", &[]).expect("a valid scene")
}

fn falling_plate(element: &str, cells: [usize; 2], modes: usize, step: f64) -> Model {
    Model::new(&modal_scene(PAPER_FALL, element, cells, modes, step)).unwrap()
}

#[test]
fn the_plate_moves_as_an_independent_program_says() {
    // Energy just after the release, first impact and impulse, in J, s and N s, and the tolerance
    // of the impulse. Rounding of rebond's matrix entries changes all of them by less than 1e-9.
    // The other program's entries are known to 1e-13; random errors of 1e-14 in the entries move
    // the impulse of the triangles by up to 3e-8 and that of the quadrilaterals by 1e-9, errors of
    // 1e-13 by 3e-7 and 1e-8.
    let known = [
        ("fvs", [289.366217511, 0.054790553582, 102.684066782], 1e-8),
        ("hct", [287.649710736, 0.054752345558, 105.824058920], 3e-8),
    ];
    for (element, [released, impact, pushed], of_impulse) in known {
        let model = falling_plate(element, [10, 4], 50, 1e-3);
        let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
        let energy = scheme.energies().unwrap().total();
        let (mut error, mut drift, mut kkt, mut impulse) = (0.0f64, 0.0f64, 0.0f64, 0.0);
        let mut events: Vec<Event> = Vec::new();
        for (n, row) in table(&format!("modal_{element}_10x4_m50.csv")).iter().enumerate() {
            if n > 0 {
                scheme.advance().unwrap();
            }
            assert!((scheme.time() - row[0]).abs() <= 1e-12);
            error = error.max((corners(&model, &scheme)[0] - row[1]).abs());
            drift = drift.max((scheme.energies().unwrap().total() / energy - 1.0).abs());
            kkt = kkt.max(scheme.step_report().kkt);
            impulse += scheme.impulses().iter().sum::<f64>();
            events.extend(scheme.take_events());
        }
        println!(
            "{element}: error {error:.1e} m, energy {energy} J, drift {drift:.1e}, residual {kkt:.1e}, first impact {} s, \
             impulse {impulse} N s",
            events[0].time
        );
        assert!(error <= 1e-9, "{element}: {error:e}");
        assert!(drift <= 1e-10 && kkt <= 1e-11, "{element}: {drift:e}, {kkt:e}");
        for (of, expected, tolerance) in
            [(energy, released, 1e-8), (events[0].time, impact, 1e-8), (impulse, pushed, of_impulse)]
        {
            assert!((of / expected - 1.0).abs() <= tolerance, "{element}: {of}, not {expected}");
        }
    }
}

#[test]
fn nodes_that_come_into_reach_do_not_change_the_motion() {
    let damped = format!("{PAPER_FALL}damping = {{ mass = 5 }}\n");
    let stiff = format!("{PAPER_FALL}damping = {{ stiffness = 1e-6 }}\n");
    for (element, tables) in [("fvs", PAPER_FALL), ("hct", PAPER_FALL), ("fvs", &damped), ("fvs", &stiff)] {
        let model = Model::new(&modal_scene(tables, element, [10, 4], 50, 1e-3)).unwrap();
        let usual = ExactOptions::default();
        let run = |horizon| -> Vec<[f64; 2]> {
            let options = ExactOptions { horizon, ..usual };
            let mut scheme = Exact::with_options(&model.system, 1e-3, model.start.clone(), options).unwrap();
            (0..180)
                .map(|_| {
                    scheme.advance().unwrap();
                    corners(&model, &scheme)
                })
                .collect()
        };
        let all = run(f64::INFINITY);
        for horizon in [10.0, usual.horizon, 1e-3] {
            let apart = difference(run(horizon).as_flattened(), all.as_flattened());
            println!("{element}, {horizon} periods: {apart:.1e} m");
            assert!(apart <= 1e-11, "{element}, {horizon}: {apart:e}");
        }
    }
}

/// Modes (1, 2) and (2, 1) of a square plate have the same frequency, as have (1, 3) and (3, 1).
#[test]
fn modes_that_divide_those_of_equal_frequency_are_doubted() {
    let supports = ["left", "right", "top", "bottom"]
        .map(|edge| format!("[[support]]\nedge = \"{edge}\"\nkind = \"simply_supported\"\n"));
    for (modes, is_doubted) in [(1, false), (2, true), (3, false), (5, true), (6, false)] {
        let text = format!(
            "{UNIT}
            mesh = {{ element = \"fvs\", cells = [4, 4] }}
            time = {{ scheme = \"conserving\", mass = \"modal\", modes = {modes}, step = 1e-3, end = 1 }}
            {}",
            supports.concat()
        );
        let model = Model::new(&Scene::from_str(&text, "square", &[]).unwrap()).unwrap();
        let advice = format!("take {} modes, or more", modes - 1);
        assert_eq!(model.warnings.iter().any(|words| words.contains(&advice)), is_doubted, "{modes} modes");
    }
}

#[test]
fn no_node_of_the_mesh_penetrates() {
    // The obstacle lies below all nodes, near enough that many of them come into reach and touch.
    let near = PAPER_FALL.replace("height = -0.1", "height = '-0.004 - 0.08 * x'");
    for tables in [PAPER_FALL, &near] {
        let model = Model::new(&modal_scene(tables, "fvs", [20, 8], 60, 2e-5)).unwrap();
        let mut scheme = Exact::new(&model.system, 2e-5, model.start.clone()).unwrap();
        let energy = scheme.energies().unwrap().total();
        let (mut deepest, mut touched) = (0.0f64, vec![false; model.system.bounds.len()]);
        for _ in 0..5000 {
            scheme.advance().unwrap();
            deepest = deepest.max(model.system.bounds.violation(scheme.displacement()));
            scheme.take_events().iter().for_each(|event| touched[event.bound] = true);
        }
        let drift = (scheme.energies().unwrap().total() / energy - 1.0).abs();
        let touched = touched.iter().filter(|touched| **touched).count();
        println!("{touched} nodes touch, at most {deepest:.1e} m deep, energy {drift:.1e}");
        assert!(touched >= 9 && deepest <= 1e-12 && drift <= 1e-10, "{touched}, {deepest:e}, {drift:e}");
    }
}

#[test]
fn the_rest_answers_as_all_higher_modes_together() {
    // A force on a plate at rest moves no mode at the start, and the others at once to their
    // equilibrium, the sum of A_j A_j / w_j^2.
    let mut model = falling_plate("fvs", [10, 4], 50, 1e-3);
    let dofs = model.system.engine.dofs();
    let Form::Modal { consistent, .. } = &model.system.mass else { panic!("not the modal mass") };
    let (k, m) = (dense(&model, &model.system.stiffness), dense(&model, &Form::Cells(consistent.clone())));
    let modes = all_modes(&k, &m);
    let sites: Vec<usize> = model.sites.iter().map(|site| site.dof).filter(|dof| dof % 3 == 0).collect();
    let (mut error, mut largest) = (0.0f64, 0.0f64);
    for &push in &sites {
        let mut load = vec![0.0; dofs];
        load[push] = 1.0;
        model.system.load = Some(load);
        let rest = Start { displacement: vec![0.0; dofs], velocity: vec![0.0; dofs] };
        let scheme = Exact::new(&model.system, 1e-3, rest).unwrap();
        for &dof in &sites {
            let spectral: f64 =
                modes[50..].iter().map(|(square, shape)| shape[push] * shape[dof] / square).sum();
            error = error.max((scheme.displacement()[dof] - spectral).abs());
            largest = largest.max(spectral.abs());
        }
    }
    println!("largest {largest:.1e} m/N, error {error:.1e} m/N");
    assert!(error <= 1e-10 * largest, "{error:e} of {largest:e}");
}

/// Returns the matrix of a form.
pub fn dense(model: &Model, form: &Form) -> Mat<f64> {
    let dofs = model.system.engine.dofs();
    let mut matrix = Mat::zeros(dofs, dofs);
    let mut unit = vec![0.0; dofs];
    for j in 0..dofs {
        unit[j] = 1.0;
        model.system.engine.multiply(form, &unit, matrix.col_as_slice_mut(j)).unwrap();
        unit[j] = 0.0;
    }
    matrix
}

/// Returns all modes of K x = w^2 M x, each with w^2 and its shape, ascending.
pub fn all_modes(k: &Mat<f64>, m: &Mat<f64>) -> Vec<(f64, Vec<f64>)> {
    let size = m.nrows();
    let roots: Vec<f64> = (0..size).map(|i| m[(i, i)].sqrt()).collect();
    let scaled = |of: &Mat<f64>| Mat::from_fn(size, size, |i, j| of[(i, j)] / (roots[i] * roots[j]));
    let (k, m) = (scaled(k), scaled(m));
    let factor = m.llt(Side::Lower).unwrap();
    let lower = factor.L();
    let mut inverse = Mat::<f64>::identity(size, size);
    for j in 0..size {
        for i in 0..size {
            let sum: f64 = (0..i).map(|k| lower[(i, k)] * inverse[(k, j)]).sum();
            inverse[(i, j)] = (inverse[(i, j)] - sum) / lower[(i, i)];
        }
    }
    let mut standard = &inverse * k * inverse.transpose();
    let vectors = rotated(&mut standard);
    let shapes = inverse.transpose() * vectors;
    let shape = |k: usize| (0..size).map(|i| shapes[(i, k)] / roots[i]).collect();
    let mut modes: Vec<(f64, Vec<f64>)> = (0..size).map(|k| (standard[(k, k)], shape(k))).collect();
    modes.sort_by(|a, b| a.0.total_cmp(&b.0));
    modes
}

/// Makes a symmetric matrix diagonal by Jacobi's rotations. Returns the eigenvectors.
fn rotated(matrix: &mut Mat<f64>) -> Mat<f64> {
    let size = matrix.nrows();
    let mut vectors = Mat::<f64>::identity(size, size);
    for _ in 0..12 {
        for j in 1..size {
            for i in 0..j {
                let (a, b, c) = (matrix[(i, i)], matrix[(j, j)], matrix[(i, j)]);
                if c.abs() <= 1e-18 * (a * b).abs().sqrt() {
                    continue;
                }
                let half = (b - a) / (2.0 * c);
                let tangent = half.signum() / (half.abs() + half.hypot(1.0));
                let cosine = 1.0 / tangent.hypot(1.0);
                let sine = tangent * cosine;
                let turn = |x: &mut f64, y: &mut f64| {
                    (*x, *y) = (cosine * *x - sine * *y, sine * *x + cosine * *y);
                };
                for k in 0..size {
                    let (mut x, mut y) = (matrix[(k, i)], matrix[(k, j)]);
                    turn(&mut x, &mut y);
                    (matrix[(k, i)], matrix[(k, j)]) = (x, y);
                }
                for k in 0..size {
                    let (mut x, mut y) = (matrix[(i, k)], matrix[(j, k)]);
                    turn(&mut x, &mut y);
                    (matrix[(i, k)], matrix[(j, k)]) = (x, y);
                }
                for k in 0..size {
                    let (mut x, mut y) = (vectors[(k, i)], vectors[(k, j)]);
                    turn(&mut x, &mut y);
                    (vectors[(k, i)], vectors[(k, j)]) = (x, y);
                }
            }
        }
    }
    vectors
}

/// Record of a free plate that falls askew, and meets the obstacle with one corner first.
pub struct FreeFall {
    pub events: usize,
    /// Largest difference of the momenta from those that the impulses leave, in N s and N m s.
    pub unbalanced: f64,
    /// Energies at the start and after each step, in J.
    pub energies: Vec<f64>,
}

/// Lets a free plate hit, with further tables in its scene.
pub fn free_fall(tables: &str) -> FreeFall {
    let tables = format!(
        "{PAPER_PLATE}obstacle = [{{ side = \"below\", height = '-0.01 - 0.02 * x + 0.01 * y' }}]\n\
         initial = {{ velocity = '-2 + x' }}\n{tables}"
    );
    let model = Model::new(&modal_scene(&tables, "fvs", [10, 4], 40, 1e-3)).unwrap();
    let mut scheme = Exact::new(&model.system, 1e-3, model.start.clone()).unwrap();
    let dofs = model.system.engine.dofs();
    // Rigid motions: upward, and about the two axes.
    let mut rigid = [vec![0.0; dofs], vec![0.0; dofs], vec![0.0; dofs]];
    for DeflectionDof { dof, at: [x, y], .. } in &model.sites {
        (rigid[0][*dof], rigid[1][*dof], rigid[2][*dof]) = (1.0, *x, *y);
        (rigid[1][dof + 1], rigid[2][dof + 2]) = (1.0, 1.0);
    }
    let momenta = |scheme: &mut Exact<_>| -> [f64; 3] {
        let mut momentum = vec![0.0; dofs];
        let rate = scheme.velocity().unwrap();
        model.system.engine.multiply(&model.system.mass, &rate, &mut momentum).unwrap();
        [0, 1, 2].map(|k| momentum.iter().zip(&rigid[k]).map(|(p, e)| p * e).sum())
    };
    let mut expected = momenta(&mut scheme);
    let energies = vec![scheme.energies().unwrap().total()];
    let mut fall = FreeFall { events: 0, unbalanced: 0.0, energies };
    for _ in 0..100 {
        scheme.advance().unwrap();
        for (bound, impulse) in scheme.impulses().iter().enumerate() {
            let dof = model.system.bounds.dofs[bound];
            (0..3).for_each(|k| expected[k] += impulse * rigid[k][dof]);
        }
        fall.unbalanced = fall.unbalanced.max(difference(&momenta(&mut scheme), &expected));
        fall.energies.push(scheme.energies().unwrap().total());
        assert!(scheme.step_report().kkt <= 1e-10, "{:e}", scheme.step_report().kkt);
        fall.events += scheme.take_events().len();
    }
    fall
}

#[test]
fn a_free_plate_that_hits_keeps_momentum_and_energy() {
    let FreeFall { events, unbalanced, energies } = free_fall("");
    let drift = energies.iter().map(|energy| (energy / energies[0] - 1.0).abs()).fold(0.0, f64::max);
    println!("{events} events, momentum {unbalanced:.1e} N s, energy {drift:.1e}");
    assert!(events > 20 && unbalanced <= 1e-9 && drift <= 1e-10, "{events}, {unbalanced:e}, {drift:e}");
}

/// Returns the energies of an exact run with the modal mass from row to row, in J, each taken
/// before and after the state is saved.
fn energies_around_saves(text: &str) -> Vec<[f64; 2]> {
    let scene = Scene::from_str(text, "plate", &[]).unwrap();
    let model = Model::new(&scene).unwrap();
    let mut scheme = Exact::new(&model.system, scene.time.step, model.start.clone()).unwrap();
    let mut rows = Vec::new();
    for _ in 0..scene.time.steps() {
        scheme.advance().unwrap();
        let before = scheme.energies().unwrap().total();
        scheme.archive(&mut Archive::Saves(Vec::new())).unwrap();
        rows.push([before, scheme.energies().unwrap().total()]);
    }
    rows
}

#[test]
fn a_ball_that_leaves_while_a_stop_is_pressed_takes_its_energy_along() {
    // The ball is the only rigid motion. While it flies, the nodes in contact with the stop are
    // moved by no rigid motion at all. Nothing damps: the energy stays that of the ball, m v^2 / 2.
    for modes in [9, 15] {
        let rows = energies_around_saves(&format!(
            r#"
            plate = {{ length = 0.46, width = 0.6, thickness = 0.0135, youngs_modulus = 63e9, poissons_ratio = 0.0, density = 670.0 }}
            mesh = {{ element = "fvs", cells = [6, 4] }}
            support = [{{ edge = "left", kind = "clamped" }}]
            obstacle = [{{ side = "above", height = 0.0006, stiffness = 5e8 }}]
            ball = [{{ at = [0.24, 0.1], side = "below", mass = 0.5, velocity = 10.0, height = -0.002, stiffness = 3.6e7 }}]
            time = {{ scheme = "exact", mass = "modal", modes = {modes}, step = 2e-5, end = 2e-3 }}
            "#
        ));
        for energy in rows.into_iter().flatten() {
            assert!((energy / 25.0 - 1.0).abs() <= 1e-10, "{modes}: {energy:e}");
        }
    }
}

#[test]
fn saving_a_state_does_not_change_it() {
    let rows = energies_around_saves(&format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "fvs", cells = [4, 2] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        obstacle = [{{ side = "below", height = -0.001, line = [[1.2, 0.0], [1.2, 0.4]], stiffness = 1e5 }}]
        load = {{ pressure = -200.0 }}
        time = {{ scheme = "exact", mass = "modal", modes = 6, step = 1e-3, end = 0.05 }}
        "#
    ));
    // The energy is that of the motion less the work of the load, and nothing damps.
    for [before, after] in &rows {
        assert!((before - rows[0][0]).abs() <= 1e-12 && before == after, "{before:e}, {after:e}");
    }
}

/// In contact every part is computed, so that such a step would not end within years.
#[test]
fn a_step_of_too_many_parts_is_refused() {
    let model = falling_plate("fvs", [10, 4], 50, 1e-3);
    let refused = ModalScheme::conserving(&model.system, 1e5, model.start.clone()).err().unwrap().to_string();
    assert!(refused.starts_with("time.step = 1e5 s: the fastest of 50 modes has "), "{refused}");
    assert!(refused.ends_with("expected at most 1e7"), "{refused}");
}

/// The largest deflection of a struck plate is as large as at every row of every node, the last
/// included. Many modes are excited, and contacts change the velocity suddenly.
#[test]
fn the_largest_deflection_is_as_large_as_at_every_row() {
    for (scheme, end) in [("conserving", 0.0113), ("newmark", 0.0113), ("exact", 0.04)] {
        let nodes = (0..=6).flat_map(|i| (0..=4).map(move |j| (i, j)));
        let probe = |(i, j)| {
            format!("{{ name = \"n{i}{j}\", at = [{}, {}] }}", f64::from(i) / 5.0, f64::from(j) / 10.0)
        };
        let probes: Vec<String> = nodes.map(probe).collect();
        let text = format!(
            "{PAPER_PLATE}mesh = {{ element = \"fvs\", cells = [6, 4] }}\n\
             obstacle = [{{ side = \"below\", height = -1e-3 }}]\n\
             initial.velocity = \"if(x > 1.1 and y < 0.1, -5, 0)\"\n\
             time = {{ scheme = \"{scheme}\", mass = \"modal\", modes = 30, step = 2e-5, end = {end} }}\n\
             output = {{ every = 1, probes = [{}] }}\n",
            probes.join(", ")
        );
        let (rows, outcome) = run_to_end(&text);
        let largest = rows.iter().flat_map(|row| &row.probes).fold(0.0, |m: f64, w| m.max(w.abs()));
        let told = outcome.largest_deflection.unwrap();
        println!("{scheme}: {told:?} for {largest:e}");
        assert!((told.value.abs() - largest).abs() <= 1e-3 * largest, "{scheme}: {told:?} for {largest:e}");
    }
}
