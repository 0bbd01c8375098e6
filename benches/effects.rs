//! Cost of effects: the time of a step with each effect, compared with that of the bare plate.
//! Effects that a scene does not have must cost nothing.
//!
//! All scenes take turns of a few steps, so that other work on the machine slows them alike; the
//! shortest of many turns counts. Set-up, output and PETSc are not covered.

use rebond::linalg::Engine;
use rebond::scene::Scene;
use rebond::simulation::Model;
use std::time::{Duration, Instant};

#[path = "../tests/common/models.rs"]
mod models;
use models::{CLAMPED, PAPER_PLATE};

const MESHES: [&str; 2] = ["[10, 4]", "[40, 16]"];

/// Meshes on which the stresses are measured.
const STRESSED: [&str; 3] = ["[10, 4]", "[20, 8]", "[64, 64]"];

/// Number of steps per turn.
const STEPS: u32 = 16;

/// Measuring time of each mesh, and that for a report, in which no time is a failure.
const WATCH: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(2)];

/// Relative cost that an absent effect may have.
const NOTHING: f64 = 0.02;

/// Name of a scene, its content, and whether its effects are absent.
const SCENES: [(&str, &str, bool); 15] = [
    ("bare", "", true),
    ("bare, again", "", true),
    ("no load", "load = { pressure = 0, gravity = 0 }", true),
    ("no damping", "damping = { mass = 0, stiffness = 0 }", true),
    ("no motion", "support = [{ edge = \"left\", kind = \"clamped\", motion = 0 }]", true),
    ("constant load", "load.pressure = \"-1e-3*x\"", false),
    ("load in time", "load.pressure = \"-1e-3*x*sin(9*t)\"", false),
    ("travelling load", "load.pressure = \"-1e-3*exp(x - t)\"", false),
    ("damping", "damping = { mass = 1, stiffness = 1e-6 }", false),
    ("obstacle out of reach", "obstacle = [{ side = \"below\", height = -1e3 }]", false),
    ("stop out of reach", "obstacle = [{ side = \"below\", height = -1e3, at = [1.2, 0] }]", false),
    ("contact", "obstacle = [{ side = \"below\", height = -0.2 }]\nload.pressure = -14600", false),
    ("named support", "support = [{ name = \"clamp\", edge = \"left\", kind = \"clamped\" }]", false),
    (
        "compliant stops out of reach",
        "obstacle = [{ side = \"below\", height = -1e3, stiffness = 1e8 }]",
        false,
    ),
    (
        "contact with compliant stops",
        "obstacle = [{ side = \"below\", height = -0.2, stiffness = 1e8 }]\nload.pressure = -14600",
        false,
    ),
];

fn scene(mesh: &str, more: &str) -> Scene {
    parsed(&scene_text("fvs", mesh, more))
}

fn parsed(text: &str) -> Scene {
    Scene::from_str(text, "bench", &[]).expect("a valid scene")
}

fn scene_text(element: &str, mesh: &str, more: &str) -> String {
    let support = if more.contains("support") { "" } else { CLAMPED };
    let pressure = if more.contains("-0.2") { -14600.0 } else { 1.0 };
    format!(
        r#"
        {PAPER_PLATE}
        mesh = {{ element = "{element}", cells = {mesh} }}
        initial = {{ static_pressure = {pressure:?} }}
        {support}
        {more}
        time = {{ scheme = "newmark", mass = "singular", step = 1e-5, end = 1 }}
        "#
    )
}

/// Prints the time of the stresses at all nodes at an instant, in units of a product with K: at one
/// that brings no new peak, as most do, and at one that brings a new peak at every node.
fn print_stress_costs(watch: Duration) {
    println!("\n{:<24}{:>14}{:>14}   (time of a product with K = 1)", "extremes", "no new peak", "all new");
    for (element, cells) in ["fvs", "hct"].into_iter().flat_map(|of| STRESSED.map(|cells| (of, cells))) {
        let text = scene_text(element, cells, "output = { extremes = true }");
        let model = Model::new(&parsed(&text)).expect("a sound model");
        let (system, u) = (&model.system, &model.start.displacement);
        let mut force = vec![0.0; u.len()];
        let [mut product, mut usual, mut first] = [Duration::MAX; 3];
        let mut seen = model.stress_watch().expect("a scene with extremes");
        let clock = Instant::now();
        while clock.elapsed() < watch {
            let turn = Instant::now();
            for _ in 0..STEPS {
                system.engine.multiply(&system.stiffness, u, &mut force).expect("a product");
            }
            product = product.min(turn.elapsed());
            let turn = Instant::now();
            for _ in 0..STEPS {
                seen.note(&system.engine, u, 0.0).expect("stresses");
            }
            usual = usual.min(turn.elapsed());
            let mut new: Vec<_> = (0..STEPS).filter_map(|_| model.stress_watch()).collect();
            let turn = Instant::now();
            for unseen in &mut new {
                unseen.note(&system.engine, u, 0.0).expect("stresses");
            }
            first = first.min(turn.elapsed());
        }
        let [usual, first] = [usual, first].map(|time| time.as_secs_f64() / product.as_secs_f64());
        println!("{:<24}{usual:>14.2}{first:>14.2}", format!("{element} {cells}"));
    }
}

fn main() {
    let is_report = std::env::args().any(|word| word == "--report");
    let watch = WATCH[usize::from(is_report)];
    println!("{:<24}{:>14}{:>14}   (time of a step, in units of the bare plate's)", "", MESHES[0], MESHES[1]);
    let columns = MESHES.map(|mesh| {
        let scenes = SCENES.map(|(_, more, _)| scene(mesh, more));
        let models: Vec<Model> =
            scenes.iter().map(|scene| Model::new(scene).expect("a sound model")).collect();
        let mut schemes: Vec<_> = models
            .iter()
            .zip(&scenes)
            .map(|(model, scene)| model.scheme(scene).expect("a sound start"))
            .collect();
        let mut least = [f64::INFINITY; SCENES.len()];
        let clock = Instant::now();
        while clock.elapsed() < watch {
            for ((scheme, model), (least, (_, more, _))) in
                schemes.iter_mut().zip(&models).zip(least.iter_mut().zip(SCENES))
            {
                let is_named = more.contains("name");
                let turn = Instant::now();
                for _ in 0..STEPS {
                    scheme.advance().expect("a sound step");
                    if is_named {
                        model.support_forces(scheme.as_mut()).expect("sound forces");
                    }
                }
                *least = least.min(turn.elapsed().as_secs_f64());
            }
        }
        least.map(|seconds| seconds / least[0])
    });
    for (row, (name, _, _)) in SCENES.iter().enumerate() {
        println!("{name:<24}{:>14.3}{:>14.3}", columns[0][row], columns[1][row]);
    }
    let absent = |row: &usize| SCENES[*row].2;
    let most =
        columns.iter().flat_map(|column| (0..SCENES.len()).filter(absent).map(|row| column[row] - 1.0));
    let most = most.fold(0.0, f64::max);
    println!(
        "\nabsent effects cost at most {:.1} % of a step; {:.0} % is the limit",
        100.0 * most,
        100.0 * NOTHING
    );
    // The bare plate is measured twice; the difference shows the noise of the machine.
    let noise = columns.iter().map(|column| (column[1] - 1.0).abs()).fold(0.0, f64::max);
    print_stress_costs(watch / 5);
    if noise > 0.5 * NOTHING {
        println!("the machine is too busy to judge: the same scene twice differs by {:.1} %", 100.0 * noise);
    } else {
        assert!(is_report || most < NOTHING, "absent effects cost {most}");
    }
}
