//! What a step costs, and what it is made of: the paper's plate in free flight.
//!
//! `cargo bench` prints, for each mesh: `solve` alone (the floor of any scheme that factors once: a pair of triangular
//! solves), `stiffness` (K applied cell by cell), `judge` (the KKT residual), the whole `step` of Newmark with the singular
//! mass, and a `contact` step, of the plate pressed onto its obstacle. `assembly` and `factor` come once in a run. At the end
//! a table of steps over solves, timed in turns so that other programs slow both alike.

use divan::{Bencher, black_box};
use rebond::linalg::{Engine, Factor};
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters, Scheme};
use rebond::simulation::Model;
use rebond::vi::kkt::Judge;
use std::time::{Duration, Instant};

const MESHES: [&str; 6] = ["fvs 10x4", "hct 10x4", "fvs 80x32", "hct 80x32", "fvs 160x64", "hct 160x64"];

/// The paper's plate far above its obstacle, from rest under 14600 Pa.
fn scene(mesh: &str) -> Scene {
    scene_with(
        mesh,
        r#"
        obstacle = [{ side = "below", height = -0.3 }]
        initial = { static_pressure = 14600 }
        "#,
    )
}

/// The plate at rest, bent down onto its obstacle by 14600 Pa: its free edge touches.
fn resting(mesh: &str) -> Scene {
    scene_with(
        mesh,
        r#"
        obstacle = [{ side = "below", height = -0.2 }]
        initial = { static_pressure = -14600 }
        load = { pressure = -14600 }
        "#,
    )
}

fn scene_with(mesh: &str, more: &str) -> Scene {
    let (element, cells) = mesh.split_once(' ').expect("an element and its cells");
    let cells = cells.replace('x', ", ");
    let text = format!(
        r#"
        plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
        mesh = {{ element = "{element}", cells = [{cells}] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        {more}
        time = {{ scheme = "newmark", mass = "singular", step = 1e-5, end = 1 }}
        "#
    );
    Scene::from_str(&text, "bench", &[]).expect("a valid scene")
}

fn model(mesh: &str) -> Model {
    Model::new(&scene(mesh)).expect("a sound model")
}

const PARAMETERS: NewmarkParameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 1e-5 };

#[divan::bench(args = MESHES)]
fn a_assembly(bencher: Bencher, mesh: &str) {
    let scene = scene(mesh);
    bencher.bench_local(|| Model::new(&scene));
}

#[divan::bench(args = MESHES)]
fn b_factor(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    bencher.bench_local(|| model.system.engine.factor(&Newmark::sum(&model.system, PARAMETERS), &[]));
}

#[divan::bench(args = MESHES)]
fn c_solve(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let sum = Newmark::sum(&model.system, PARAMETERS);
    let mut factor = model.system.engine.factor(&sum, &[]).expect("positive definite");
    let mut x = model.start.displacement.clone();
    bencher.bench_local(|| {
        x.copy_from_slice(&model.start.displacement);
        factor.solve(&mut x).unwrap();
    });
}

#[divan::bench(args = MESHES)]
fn d_stiffness(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let mut y = model.start.displacement.clone();
    bencher.bench_local(|| {
        model.system.engine.multiply(&model.system.stiffness, &model.start.displacement, &mut y).unwrap()
    });
}

#[divan::bench(args = MESHES)]
fn e_judge(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let sum = Newmark::sum(&model.system, PARAMETERS);
    let x = &model.start.displacement;
    let mut judge = Judge::new(&model.system.engine, &sum).unwrap();
    let reaction = vec![0.0; model.system.bounds.len()];
    bencher.bench_local(|| {
        judge
            .residual(&model.system.engine, &sum, &[x.as_slice()], &model.system.bounds, 1.0, x, &reaction)
            .unwrap()
    });
}

#[divan::bench(args = MESHES)]
fn f_step(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let mut scheme = Newmark::new(&model.system, PARAMETERS, model.start.clone()).expect("a sound start");
    bencher.bench_local(|| scheme.advance());
}

#[divan::bench(args = ["fvs 10x4", "hct 10x4", "fvs 80x32", "hct 80x32"])]
fn g_contact(bencher: Bencher, mesh: &str) {
    let model = Model::new(&resting(mesh)).expect("a sound model");
    let mut scheme = Newmark::new(&model.system, PARAMETERS, model.start.clone()).expect("a sound start");
    bencher.bench_local(|| scheme.advance());
    assert!(scheme.reaction().iter().any(|r| *r != 0.0), "the plate has left its obstacle");
}

/// Prints what a free step costs beside a solve.
fn compare() {
    println!("\n{:<12}{:>12}{:>12}{:>8}   (medians, in us)", "mesh", "solve", "step", "ratio");
    for mesh in MESHES {
        let model = model(mesh);
        let sum = Newmark::sum(&model.system, PARAMETERS);
        let mut factor = model.system.engine.factor(&sum, &[]).expect("positive definite");
        let mut scheme = Newmark::new(&model.system, PARAMETERS, model.start.clone()).expect("a sound start");
        let mut x = model.start.displacement.clone();
        let (mut solves, mut steps) = (Vec::new(), Vec::new());
        let clock = Instant::now();
        while clock.elapsed() < Duration::from_millis(500) {
            solves.push(seconds(|| {
                x.copy_from_slice(&model.start.displacement);
                let _ = factor.solve(black_box(&mut x));
            }));
            steps.push(seconds(|| scheme.advance().expect("a sound step")));
        }
        let (solve, step) = (median(solves), median(steps));
        println!("{mesh:<12}{:>12.2}{:>12.2}{:>8.2}", 1e6 * solve, 1e6 * step, step / solve);
    }
}

/// Seconds that one of several runs takes; the first warms the caches and is not counted.
fn seconds(mut work: impl FnMut()) -> f64 {
    const RUNS: u32 = 8;
    work();
    let clock = Instant::now();
    for _ in 0..RUNS {
        work();
    }
    clock.elapsed().as_secs_f64() / f64::from(RUNS)
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn main() {
    divan::main();
    // Not where only a part was asked for.
    if std::env::args().skip(1).all(|argument| argument == "--bench") {
        compare();
    }
}
