//! Cost of a step and of its parts, for the paper's plate with Newmark's scheme and the singular
//! mass, beside a solve by faer alone.
//!
//! `cargo bench --bench step -- [WORDS]` prints a row for each part on each mesh whose name has one
//! of the words: the median time over many turns, its quartiles, and the median ratio to the
//! program's own solve. The last rows are mean steps of the modal mass, over flight and impact.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};
use rebond::linalg::{Engine, LinearCombination};
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters, Scheme, Solution};
use rebond::simulation::{Model, Observer, Row};
use rebond::vi::kkt::KktCheck;
use rebond::vi::{Answer, Problem};
use std::time::{Duration, Instant};

#[path = "../tests/common/models.rs"]
mod models;
mod turns;
use models::{CLAMPED, PAPER_FALL, PAPER_PLATE};
use turns::{Times, part};

const MESHES: [&str; 8] = [
    "fvs 10x4",
    "hct 10x4",
    "fvs 80x32",
    "hct 80x32",
    "fvs 160x64",
    "hct 160x64",
    "fvs 320x128",
    "hct 320x128",
];

const PARAMETERS: NewmarkParameters = NewmarkParameters { beta: 0.5, restitution: 0.0, step: 1e-4 };

/// Number of times that a mesh is set up, and the time for the turns of each. Every set-up has
/// other addresses in memory, and the caches serve some of them better.
const SET_UPS: u32 = 3;
const WATCH: Duration = Duration::from_secs(4);

/// Number of steps of the main loop in a turn.
const STEPS: u64 = 40;

/// Plate far above its obstacle, at rest under 14600 Pa.
const FREE: &str = r#"
    obstacle = [{ side = "below", height = -0.3 }]
    initial = { static_pressure = 14600 }
"#;

/// Plate at rest, bent down onto its obstacle by 14600 Pa, so that its free edge touches.
const RESTING: &str = r#"
    obstacle = [{ side = "below", height = -0.2 }]
    initial = { static_pressure = -14600 }
    load = { pressure = -14600 }
"#;

fn scene(mesh: &str, more: &str, steps: u64) -> Scene {
    let (element, cells) = mesh.split_once(' ').expect("an element and its cells");
    let (cells, step) = (cells.replace('x', ", "), PARAMETERS.step);
    let text = format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "{element}", cells = [{cells}] }}
        {CLAMPED}
        {more}
        time = {{ scheme = "newmark", mass = "singular", step = {step:?}, end = {:?} }}
        output.every = {steps}
        "#,
        step * steps as f64
    );
    Scene::from_str(&text, "bench", &[]).expect("a valid scene")
}

struct Unobserved;

impl Observer for Unobserved {
    fn row(&mut self, _: &Row) -> Result<(), rebond::Error> {
        Ok(())
    }
}

/// Sparse Cholesky solver of an independent program, with its default settings.
struct Faer {
    symbolic: SymbolicCholesky<usize>,
    values: Vec<f64>,
    memory: MemBuffer,
}

impl Faer {
    fn new(dofs: usize, sum: &LinearCombination) -> Faer {
        let mut entries = Vec::new();
        for (scale, form) in sum.terms() {
            form.for_each_lower(|row, column, value| entries.push(Triplet::new(row, column, scale * value)));
        }
        let matrix =
            SparseColMat::<usize, f64>::try_new_from_triplets(dofs, dofs, &entries).expect("entries");
        let (ordering, params) = (SymmetricOrdering::Amd, CholeskySymbolicParams::default());
        let symbolic = factorize_symbolic_cholesky(matrix.symbolic(), Side::Lower, ordering, params);
        let symbolic = symbolic.expect("enough memory");
        let mut values = vec![0.0; symbolic.len_val()];
        let scratch = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default());
        symbolic
            .factorize_numeric_llt(
                &mut values,
                matrix.as_ref(),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut MemBuffer::new(scratch)),
                Spec::default(),
            )
            .expect("positive definite");
        let memory = MemBuffer::new(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        Faer { symbolic, values, memory }
    }

    /// Solves A x = b in place.
    fn solve(&mut self, x: &mut [f64]) {
        let (rows, stack) = (x.len(), MemStack::new(&mut self.memory));
        let x = MatMut::from_column_major_slice_mut(x, rows, 1);
        LltRef::new(&self.symbolic, &self.values).solve_in_place_with_conj(Conj::No, x, Par::Seq, stack);
    }
}

/// Sets up the parts of a step on a mesh, lets them take turns, and returns their names.
fn measure(mesh: &str, times: &mut Times) -> Vec<String> {
    let free = scene(mesh, FREE, STEPS);
    let [model, resting] =
        [&free, &scene(mesh, RESTING, STEPS)].map(|scene| Model::new(scene).expect("a sound model"));
    let (engine, bounds, b) = (&model.system.engine, &model.system.bounds, &model.start.displacement);
    let sum = Newmark::matrix(&model.system, PARAMETERS);
    let mut factor = engine.factor(&sum, &[]).expect("positive definite");
    let mut faer = Faer::new(engine.dofs(), &sum);
    let mut check = KktCheck::new(engine, &sum).expect("a check");
    let start = |model: &Model| model.start.clone();
    let mut flying = Newmark::new(&model.system, PARAMETERS, start(&model)).expect("a sound start");
    let mut touching = Newmark::new(&resting.system, PARAMETERS, start(&resting)).expect("a sound start");
    let [mut x, mut y, mut z, mut force] = [0; 4].map(|_| b.clone());
    factor.solve(&mut x).expect("a solve");
    faer.solve(&mut y);
    let largest = x.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() <= 1e-6 * largest), "{mesh}: the solves differ");
    let mut reaction = vec![0.0; bounds.len()];
    let run = || {
        let (outcome, end) = model.run(&free, &mut Unobserved).expect("a sound start");
        end.expect("a sound run");
        outcome.seconds.stepping / STEPS as f64
    };
    let mut parts = [
        part("solve", || {
            x.copy_from_slice(b);
            factor.solve(&mut x).expect("a solve");
        }),
        part("solve by faer", || {
            y.copy_from_slice(b);
            faer.solve(&mut y);
        }),
        part("product with K", || {
            engine.multiply(&model.system.stiffness, b, &mut force).expect("a product")
        }),
        part("KKT check", || {
            let problem = Problem { matrix: &sum, rhs: b, bounds, length: 1.0 };
            let answer = Answer { x: &mut z, reaction: &mut reaction };
            check.residual(engine, &problem, &[], &answer).expect("a residual");
        }),
        part("free step", || flying.advance().expect("a sound step")),
        part("step in contact", || touching.advance().expect("a sound step")),
        ("step of a run".to_owned(), Box::new(run)),
        part("set-up", || Model::new(&free).expect("a sound model")),
        part("factor", || engine.factor(&sum, &[]).expect("positive definite")),
    ];
    times.measure(&mut parts, WATCH);
    let names = parts.into_iter().map(|(name, _)| name).collect();
    assert!(touching.reaction().iter().any(|r| *r != 0.0), "{mesh}: the plate has left its obstacle");
    names
}

/// Prints the mean cost of a step where the lowest 200 modes carry all inertia, over the flight of
/// the paper's plate and its first impact.
fn print_modal_steps(mesh: &str) {
    let (element, cells) = mesh.split_once(' ').expect("an element and its cells");
    let text = format!(
        r#"
        {PAPER_FALL}
        mesh = {{ element = "{element}", cells = [{}] }}
        time = {{ scheme = "conserving", mass = "modal", modes = 200, step = 2e-6, end = 0.08 }}
        "#,
        cells.replace('x', ", ")
    );
    let scene = Scene::from_str(&text, "bench", &[]).expect("a valid scene");
    let clock = Instant::now();
    let model = Model::new(&scene).expect("a sound model");
    let mut scheme = model.scheme(&scene).expect("a sound start");
    let ready = clock.elapsed().as_secs_f64();
    let steps = scene.time.steps();
    (0..steps).for_each(|_| scheme.advance().expect("a sound step"));
    let step = (clock.elapsed().as_secs_f64() - ready) / steps as f64;
    println!("{mesh:<12} {:<16}{:>12.2}", "modal step", 1e6 * step);
    println!("{mesh:<12} {:<16}{:>12.2}", "modal set-up", 1e6 * ready);
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).filter(|word| !word.starts_with("--")).collect();
    let is_chosen = |mesh: &str| words.is_empty() || words.iter().any(|word| mesh.contains(word.as_str()));
    println!("{:<12} {:<16}{:>12}{:>12}{:>12}{:>8}", "mesh", "part", "median, us", "from", "to", "ratio");
    for mesh in MESHES.into_iter().filter(|mesh| is_chosen(mesh)) {
        let mut times = Times::default();
        let names = (0..SET_UPS).fold(Vec::new(), |_, _| measure(mesh, &mut times));
        for (k, name) in names.iter().enumerate() {
            let [from, median, to] = times.quartiles(k).map(|seconds| 1e6 * seconds);
            let ratio = times.ratio(k, 0);
            println!("{mesh:<12} {name:<16}{median:>12.2}{from:>12.2}{to:>12.2}{ratio:>8.2}");
        }
    }
    ["fvs 80x32", "fvs 320x128"].into_iter().filter(|mesh| is_chosen(mesh)).for_each(print_modal_steps);
}
