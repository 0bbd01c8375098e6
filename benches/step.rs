//! What a step costs, and what it is made of: the paper's plate in free flight.
//!
//! `cargo bench` prints, for each mesh: `solve` alone (the floor of any scheme that factors once: a pair of triangular
//! solves), `stiffness` (K applied cell by cell), `judge` (the KKT residual), and the whole `step` of Newmark with the singular
//! mass. Not covered: contact, memory bandwidth shared with other programs, the first factorisation (`assembly`, `factor`).

use divan::Bencher;
use rebond::linalg::{Engine, Factor};
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters, Scheme};
use rebond::simulation::Model;
use rebond::vi::kkt::Judge;

const MESHES: [&str; 6] = ["fvs 10x4", "hct 10x4", "fvs 80x32", "hct 80x32", "fvs 160x64", "hct 160x64"];

/// The paper's plate without its obstacle, from rest under 14600 Pa.
fn scene(mesh: &str) -> Scene {
    let (element, cells) = mesh.split_once(' ').expect("an element and its cells");
    let cells = cells.replace('x', ", ");
    let text = format!(
        r#"
        plate = {{ length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }}
        mesh = {{ element = "{element}", cells = [{cells}] }}
        support = [{{ edge = "left", kind = "clamped" }}]
        obstacle = [{{ side = "below", height = -0.3 }}]
        initial = {{ static_pressure = 14600 }}
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
        judge.residual(&model.system.engine, &sum, x, &model.system.bounds, 1.0, x, &reaction).unwrap()
    });
}

#[divan::bench(args = MESHES)]
fn f_step(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let mut scheme = Newmark::new(&model.system, PARAMETERS, model.start.clone()).expect("a sound start");
    bencher.bench_local(|| scheme.advance());
}

fn main() {
    divan::main();
}
