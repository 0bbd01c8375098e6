//! Cost of effects: the time of a step with each effect, compared with that of the bare plate.
//! Effects that a scene does not have must cost nothing.
//!
//! All scenes take turns; the median over the turns of the time relative to that of the bare plate
//! counts. Set-up, output and PETSc are not covered.

use rebond::linalg::Engine;
use rebond::scene::Scene;
use rebond::simulation::Model;
use std::time::{Duration, Instant};

#[path = "../tests/common/models.rs"]
mod models;
mod turns;
use models::{CLAMPED, PAPER_PLATE};
use turns::{Times, part};

const MESHES: [&str; 2] = ["[10, 4]", "[40, 16]"];

/// Meshes on which the stresses are measured.
const STRESSED: [&str; 3] = ["[10, 4]", "[20, 8]", "[64, 64]"];

/// Meshes on which a plate stretches, and the relative time that a step may then take with each
/// mass. With the singular one two more solves tell what the means over cells feel.
const STRETCHED: [&str; 2] = ["[10, 4]", "[80, 32]"];
const STRETCHING: [(&str, f64); 2] = [("consistent", 12.0), ("singular", 15.0)];

/// Number of watches of the stresses per turn.
const STEPS: u32 = 16;

/// Measuring time of each mesh, and that for a report, in which no time is a failure.
const WATCH: [Duration; 2] = [Duration::from_secs(10), Duration::from_secs(2)];

/// Relative cost that an absent effect may have.
const NOTHING: f64 = 0.02;

/// Name of a scene, its content, and whether its effects are absent.
const SCENES: [(&str, &str, bool); 16] = [
    ("bare", "", true),
    ("bare, again", "", true),
    ("no load", "load = { pressure = 0, gravity = 0 }", true),
    ("no damping", "damping = { mass = 0, stiffness = 0 }", true),
    ("no motion", "support = [{ edge = \"left\", kind = \"clamped\", motion = 0 }]", true),
    ("constant load", "load.pressure = \"-1e-3*x\"", false),
    ("load in time", "load.pressure = \"-1e-3*x*sin(9*t)\"", false),
    ("travelling load", "load.pressure = \"-1e-3*exp(x - t)\"", false),
    ("damping", "damping = { mass = 1, stiffness = 1e-6 }", false),
    ("prestress", "in_plane.tension.xx = 1e4", false),
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
    println!("\n{:<30}{:>14}{:>14}   (time of a product with K = 1)", "extremes", "no new peak", "all new");
    for (element, cells) in
        ["fvs", "hct"].into_iter().flat_map(|element| STRESSED.map(|cells| (element, cells)))
    {
        let text = scene_text(element, cells, "output = { extremes = true }");
        let model = Model::new(&parsed(&text)).expect("a sound model");
        let (engine, u) = (&model.system.engine, &model.start.displacement);
        let mut force = vec![0.0; u.len()];
        let new = || model.stress_watch().expect("a scene with extremes");
        let mut seen = new();
        let mut unseen = Vec::new();
        let mut parts = [
            part("product", || engine.multiply(&model.system.stiffness, u, &mut force).expect("a product")),
            part("no new peak", || seen.note(engine, u, 0.0).expect("stresses")),
            (
                "all new".to_owned(),
                Box::new(|| {
                    unseen.clear();
                    unseen.extend((0..STEPS).map(|_| new()));
                    let clock = Instant::now();
                    unseen.iter_mut().for_each(|watch| watch.note(engine, u, 0.0).expect("stresses"));
                    clock.elapsed().as_secs_f64() / f64::from(STEPS)
                }),
            ),
        ];
        let mut times = Times::default();
        times.measure(&mut parts, watch);
        println!(
            "{:<30}{:>14.2}{:>14.2}",
            format!("{element} {cells}"),
            times.ratio(1, 0),
            times.ratio(2, 0)
        );
    }
}

/// Prints the time of a step of a strip whose mid-plane stretches, without contact at some
/// thicknesses, in units of the same step without; returns the largest, relative to its limit.
fn print_stretching_cost(watch: Duration) -> f64 {
    println!("\n{:<30}{:>14}{:>14}   (time of a step, in units of one without)", "", "bare", "stretching");
    let cost = |(mass, limit): (&str, f64), cells: &str| {
        let held = "support = [{ edge = \"left\", kind = \"clamped\" }, \
                    { edge = \"right\", kind = \"clamped\" }]\nload.pressure = -2e5";
        let text = scene_text("fvs", cells, held).replace("\"singular\"", &format!("\"{mass}\""));
        let scenes = [text.clone(), format!("{text}in_plane.stretching = true")].map(|text| parsed(&text));
        let models = scenes.each_ref().map(|scene| Model::new(scene).expect("a sound model"));
        let steps = models.iter().zip(&scenes).map(|(model, scene)| {
            let mut scheme = model.scheme(scene).expect("a sound start");
            part("step", move || scheme.advance().expect("a sound step"))
        });
        let mut times = Times::default();
        times.measure(&mut steps.collect::<Vec<_>>(), watch);
        let (bare, ratio) = (1e6 * times.quartiles(0)[1], times.ratio(1, 0));
        println!("{:<30}{bare:>11.2} us{ratio:>14.2}", format!("fvs {cells} {mass}"));
        ratio / limit
    };
    let pairs = STRETCHING.into_iter().flat_map(|row| STRETCHED.map(|cells| cost(row, cells)));
    pairs.fold(0.0, f64::max)
}

/// Returns the times of a step with each effect on a mesh.
fn times(mesh: &str, watch: Duration) -> Times {
    let scenes = SCENES.map(|(_, more, _)| scene(mesh, more));
    let models = scenes.each_ref().map(|scene| Model::new(scene).expect("a sound model"));
    let steps = SCENES.iter().zip(&models).zip(&scenes).map(|(((name, more, _), model), scene)| {
        let mut scheme = model.scheme(scene).expect("a sound start");
        part(name, move || {
            scheme.advance().expect("a sound step");
            if more.contains("name") {
                model.support_forces(scheme.as_mut()).expect("sound forces");
            }
        })
    });
    let mut times = Times::default();
    times.measure(&mut steps.collect::<Vec<_>>(), watch);
    times
}

fn main() {
    let is_report = std::env::args().any(|word| word == "--report");
    let watch = WATCH[usize::from(is_report)];
    println!("{:<30}{:>14}{:>14}   (time of a step, in units of the bare plate's)", "", MESHES[0], MESHES[1]);
    let columns = MESHES.map(|mesh| times(mesh, watch));
    let [coarse, fine] = columns.each_ref().map(|times| 1e6 * times.quartiles(0)[1]);
    println!("{:<30}{coarse:>11.2} us{fine:>11.2} us", "bare");
    let costs = |row: usize| columns.each_ref().map(|times| times.ratio(row, 0));
    for (row, (name, ..)) in SCENES.iter().enumerate().skip(1) {
        let [coarse, fine] = costs(row);
        println!("{name:<30}{coarse:>14.3}{fine:>14.3}");
    }
    let absent = (0..SCENES.len()).filter(|row| SCENES[*row].2);
    let most = absent.flat_map(costs).fold(0.0, |most: f64, cost| most.max(cost - 1.0));
    let (percent, limit) = (100.0 * most, 100.0 * NOTHING);
    println!("\nabsent effects cost at most {percent:.1} % of a step; {limit:.0} % is the limit");
    // The bare plate is measured twice; the difference shows the noise of the machine.
    let noise = costs(1).into_iter().fold(0.0, |most: f64, cost| most.max((cost - 1.0).abs()));
    print_stress_costs(watch / 5);
    let stretching = print_stretching_cost(watch / 5);
    if noise > 0.5 * NOTHING {
        println!("the machine is too busy to judge: the same scene twice differs by {:.1} %", 100.0 * noise);
    } else {
        assert!(is_report || most < NOTHING, "absent effects cost {most}");
        assert!(is_report || stretching < 1.0, "stretching takes {stretching} times as long as it may");
    }
}
