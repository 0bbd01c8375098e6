//! Cost of a step and of its parts for the paper's plate in free flight.
//!
//! `cargo bench` prints for each mesh: `solve` alone (a pair of triangular solves, the lower limit
//! for any scheme that factors once), `stiffness` (K applied cell by cell), `check` (the KKT
//! residual), the whole `step` of Newmark's scheme with the singular mass, and a `contact` step of
//! the plate pressed onto its obstacle. `assembly` and `factor` occur once per run. At the end a
//! table gives the ratio of steps to solves, by this program and by faer alone, and those of
//! contact steps and of the main loop to free steps; these are timed in turns, so that other
//! programs slow all alike, and the quietest turns count. A second table has the mean step of the
//! modal mass, over a flight and an impact.
//! `cargo bench --bench step -- --report` prints the tables alone; words after `--report` choose
//! the meshes whose names contain one of them.

use divan::{Bencher, black_box};
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, MatMut, Par, Side, Spec};
use rebond::linalg::{Engine, Factor, LinearCombination};
use rebond::scene::Scene;
use rebond::scheme::{Newmark, NewmarkParameters, Scheme};
use rebond::simulation::{Model, Observer, Row};
use rebond::vi::kkt::KktCheck;
use rebond::vi::{Answer, Problem};
use std::time::{Duration, Instant};

#[path = "../tests/common/models.rs"]
mod models;
use models::{CLAMPED, PAPER_FALL, PAPER_PLATE};

const MESHES: [&str; 6] = ["fvs 10x4", "hct 10x4", "fvs 80x32", "hct 80x32", "fvs 160x64", "hct 160x64"];

/// Returns the paper's plate far above its obstacle, at rest under 14600 Pa.
fn scene(mesh: &str) -> Scene {
    scene_with(
        mesh,
        r#"
        obstacle = [{ side = "below", height = -0.3 }]
        initial = { static_pressure = 14600 }
        "#,
    )
}

/// Returns the plate at rest, bent down onto its obstacle by 14600 Pa, so that its free edge
/// touches.
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
        {PAPER_PLATE}
        mesh = {{ element = "{element}", cells = [{cells}] }}
        {CLAMPED}
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
    bencher.bench_local(|| model.system.engine.factor(&Newmark::matrix(&model.system, PARAMETERS), &[]));
}

#[divan::bench(args = MESHES)]
fn c_solve(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let sum = Newmark::matrix(&model.system, PARAMETERS);
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
fn e_check(bencher: Bencher, mesh: &str) {
    let model = model(mesh);
    let sum = Newmark::matrix(&model.system, PARAMETERS);
    let (engine, bounds) = (&model.system.engine, &model.system.bounds);
    let mut check = KktCheck::new(engine, &sum).unwrap();
    let mut x = model.start.displacement.clone();
    let mut reaction = vec![0.0; bounds.len()];
    let problem = Problem { matrix: &sum, rhs: &model.start.displacement, bounds, length: 1.0 };
    let answer = Answer { x: &mut x, reaction: &mut reaction };
    bencher.bench_local(|| check.residual(engine, &problem, &[], &answer).unwrap());
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

/// Lower limit from an independent program: faer's sparse Cholesky solver of the assembled matrix
/// with its default settings.
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

/// Meshes and steps (s) of the table of costs.
const COSTS: [(&str, [f64; 3]); 8] = [
    ("fvs 10x4", [1e-3, 1e-4, 1e-5]),
    ("hct 10x4", [1e-3, 1e-4, 1e-5]),
    ("fvs 80x32", [1e-3, 1e-4, 1e-5]),
    ("hct 80x32", [1e-3, 1e-4, 1e-5]),
    ("fvs 160x64", [1e-3, 1e-4, 1e-5]),
    ("hct 160x64", [1e-3, 1e-4, 1e-5]),
    ("fvs 320x128", [1e-3, 1e-4, 1e-5]),
    ("hct 320x128", [1e-3, 1e-4, 1e-5]),
];

/// Prints the cost of a free step relative to the faster of two solves, of a contact step relative
/// to a free one, and of the main loop of a run relative to its steps, on the chosen meshes.
fn costs(is_chosen: impl Fn(&str) -> bool) {
    println!(
        "medians of quiet turns, in us; step / solve, contact step / free step, step of a run / free step"
    );
    println!(
        "{:<13}{:>7}{:>11}{:>11}{:>11}{:>7}{:>11}{:>7}{:>11}{:>7}",
        "mesh", "dt, s", "solve", "faer", "step", "ratio", "contact", "ratio", "run", "ratio"
    );
    for (mesh, steps) in COSTS.into_iter().filter(|(mesh, _)| is_chosen(mesh)) {
        for step in steps {
            cost(mesh, step);
        }
    }
}

/// Least number of times that the parts of a step are set up and timed, and the time that more
/// set-ups fill. Each has other addresses in memory, and the caches serve some of them better: the
/// times differ by up to 3 %.
const LEAST_SET_UPS: u32 = 3;
const SET_UP_TIME: Duration = Duration::from_secs(15);

/// Least number of times that each part runs in each set-up. On the finest mesh the first 70 steps
/// of 1e-3 s take a second solve.
const LEAST_RUNS: u32 = 180;

/// Product of the number of dofs and the number of times that a part runs before the next one's
/// turn: some milliseconds, within which other programs seldom begin or end. On the finest mesh the
/// parts take turns run by run.
const DOFS_IN_A_ROW: usize = 100_000;

/// Reciprocal of the share of turns that count: those whose parts take least time together, since
/// other programs slow some parts more than others.
const QUIETEST: usize = 10;

fn cost(mesh: &str, dt: f64) {
    let mut scene = scene(mesh);
    scene.time.step = dt;
    let clock = Instant::now();
    let mut turns: Vec<Turn> = (0..)
        .take_while(|set_up| *set_up < LEAST_SET_UPS || clock.elapsed() < SET_UP_TIME)
        .flat_map(|_| turns(mesh, &scene))
        .collect();
    turns.sort_by(|a, b| a.total().total_cmp(&b.total()));
    turns.truncate(turns.len().div_ceil(QUIETEST));
    let of = |value: fn(&Turn) -> f64| median(turns.iter().map(value));
    let [solve, faer, step, contact] = [of(|t| t.solve), of(|t| t.faer), of(|t| t.step), of(|t| t.contact)];
    let [run, ratio_of_run] = step_in_run(&scene, step);
    let [solve, faer, step, contact, run] = [solve, faer, step, contact, run].map(|seconds| 1e6 * seconds);
    println!(
        "{mesh:<13}{dt:>7.0e}{solve:>11.2}{faer:>11.2}{step:>11.2}{:>7.2}{contact:>11.2}{:>7.2}{run:>11.2}{:>7.2}",
        of(|t| t.step / t.solve.min(t.faer)),
        of(|t| t.contact / t.step),
        ratio_of_run,
    );
}

/// Times of the parts of a step in one turn, in s: for each part that of its shortest run.
struct Turn {
    solve: f64,
    /// Solve by faer alone.
    faer: f64,
    /// Free step.
    step: f64,
    /// Step in contact.
    contact: f64,
}

impl Turn {
    fn total(&self) -> f64 {
        self.solve + self.faer + self.step + self.contact
    }
}

/// Returns the median of some values.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Sets up a solve, the same by faer alone, a free step and a step in contact, and times them in
/// turns.
fn turns(mesh: &str, scene: &Scene) -> Vec<Turn> {
    let parameters = NewmarkParameters { step: scene.time.step, ..PARAMETERS };
    let model = Model::new(scene).expect("a sound model");
    let sum = Newmark::matrix(&model.system, parameters);
    let mut factor = model.system.engine.factor(&sum, &[]).expect("positive definite");
    let mut faer = Faer::new(model.system.engine.dofs(), &sum);
    let mut free = Newmark::new(&model.system, parameters, model.start.clone()).expect("a sound start");
    let at_rest = Model::new(&resting(mesh)).expect("a sound model");
    let start = at_rest.start.clone();
    let mut contact = Newmark::new(&at_rest.system, parameters, start).expect("a sound start");

    let b = &model.start.displacement;
    let (mut x, mut y) = (b.clone(), b.clone());
    let clock = Instant::now();
    let runs = (DOFS_IN_A_ROW / b.len()).max(1) as u32;
    let least = LEAST_RUNS.div_ceil(runs) as usize;
    let mut turns = Vec::new();
    while turns.len() < least || clock.elapsed() < Duration::from_secs(2) {
        turns.push(Turn {
            solve: seconds(runs, || {
                x.copy_from_slice(b);
                let _ = factor.solve(black_box(&mut x));
            }),
            faer: seconds(runs, || {
                y.copy_from_slice(b);
                faer.solve(black_box(&mut y));
            }),
            step: seconds(runs, || free.advance().expect("a sound step")),
            contact: seconds(runs, || contact.advance().expect("a sound step")),
        });
    }
    let largest = x.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    assert!(x.iter().zip(&y).all(|(x, y)| (x - y).abs() <= 1e-6 * largest), "{mesh}: the solves differ");
    assert!(contact.reaction().iter().any(|r| *r != 0.0), "{mesh}: the plate has left its obstacle");
    turns
}

/// Number of times that a run and its steps alone are set up, and number of times that they are
/// compared in each set-up. Their addresses in memory change the ratio by up to 4 %.
const RUNS: u32 = 5;
const COMPARISONS: u64 = 7;

/// Observer that takes the steps of the run once more after each row, with a scheme of its own.
struct StepsAlone<'m> {
    scheme: Box<dyn Scheme + 'm>,
    /// Number of steps between two rows.
    steps: u64,
    /// Time at which the run went on.
    resumed: Instant,
    /// Times of the steps in the run and alone, in s, for each row.
    times: Vec<[f64; 2]>,
}

impl Observer for StepsAlone<'_> {
    fn row(&mut self, row: &Row) -> Result<(), rebond::Error> {
        let in_run = self.resumed.elapsed().as_secs_f64();
        if row.step > 0 {
            let clock = Instant::now();
            for _ in 0..self.steps {
                self.scheme.advance()?;
            }
            self.times.push([in_run, clock.elapsed().as_secs_f64()]);
        }
        self.resumed = Instant::now();
        Ok(())
    }
}

/// Returns the mean time of a step in the main loop of a run, in s, and its ratio to that of the
/// same steps by the scheme alone, for a step of about `step` seconds: the medians of the rows of
/// several runs, each of which counts with its steps. The two follow each other closely, so that
/// other programs slow both alike.
fn step_in_run(scene: &Scene, step: f64) -> [f64; 2] {
    let mut scene = scene.clone();
    let steps = ((0.02 / step) as u64).max(20);
    scene.time.end = (COMPARISONS * steps) as f64 * scene.time.step;
    scene.output.every = steps;
    let mut times = Vec::new();
    for _ in 0..RUNS {
        let model = Model::new(&scene).expect("a sound model");
        let scheme = model.scheme(&scene).expect("a sound start");
        let mut alone = StepsAlone { scheme, steps, resumed: Instant::now(), times: Vec::new() };
        let (_, end) = model.run(&scene, &mut alone).expect("a sound start");
        end.expect("a sound run");
        assert_eq!(alone.times.len() as u64, COMPARISONS, "rows of the run");
        times.extend(alone.times);
    }
    let in_run = median(times.iter().map(|[in_run, _]| *in_run));
    [in_run / steps as f64, median(times.iter().map(|[in_run, alone]| in_run / alone))]
}

/// Returns the shortest time of some runs, in s, each short enough to be undisturbed. The first of
/// several warms the caches and is not counted.
fn seconds(runs: u32, mut work: impl FnMut()) -> f64 {
    let mut least = f64::INFINITY;
    for run in 0..runs {
        let clock = Instant::now();
        work();
        if run > 0 || runs == 1 {
            least = least.min(clock.elapsed().as_secs_f64());
        }
    }
    least
}

/// Prints the mean cost of a step where the lowest 200 modes carry all inertia, over the flight of
/// the paper's plate and its first impact.
fn average_modal_steps() {
    println!("\n{:<14}{:>12}{:>16}   (200 modes, mean over 0.08 s)", "mesh", "set-up in s", "step in us");
    for cells in ["80, 32", "320, 128"] {
        let text = format!(
            r#"
            {PAPER_FALL}
            mesh = {{ element = "fvs", cells = [{cells}] }}
            time = {{ scheme = "conserving", mass = "modal", modes = 200, step = 2e-6, end = 0.08 }}
            "#
        );
        let scene = Scene::from_str(&text, "bench", &[]).expect("a valid scene");
        let clock = Instant::now();
        let model = Model::new(&scene).expect("a sound model");
        let mut scheme = model.scheme(&scene).expect("a sound start");
        let ready = clock.elapsed().as_secs_f64();
        for _ in 0..scene.time.steps() {
            scheme.advance().expect("a sound step");
        }
        let step = (clock.elapsed().as_secs_f64() - ready) / scene.time.steps() as f64;
        println!("{:<14}{ready:>12.1}{:>16.2}", format!("fvs {}", cells.replace(", ", "x")), 1e6 * step);
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let meshes = arguments.split(|argument| argument == "--report").nth(1);
    if meshes.is_none() {
        divan::main();
    }
    let meshes: Vec<&String> =
        meshes.unwrap_or_default().iter().filter(|argument| *argument != "--bench").collect();
    // The tables are omitted where only a part of the benchmarks is requested.
    if arguments.iter().all(|argument| argument == "--bench" || argument == "--report") {
        costs(|_| true);
        average_modal_steps();
    } else if !meshes.is_empty() {
        costs(|mesh| meshes.iter().any(|word| mesh.contains(*word)));
    }
}
