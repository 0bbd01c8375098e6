//! Results of `rebond study`: orders of convergence, combinations, fronts and files.

use crate::common::Random;
use crate::common::command;
use crate::common::command::rebond;
use crate::common::models::{PAPER_SECTION, literal, unit_plate};
use crate::common::plates::{Fvs, Hct, Matrices, Right, all_round};
use rebond::assembly;
use rebond::dof_map::Support;
use rebond::linalg::Engine;
use rebond::mesh::{Mesh, Point};
use rebond::scene::{Mass, Scene};
use rebond::simulation;
use rebond::study::accuracy::front::{Axis, front, slope};
use rebond::study::accuracy::norms::{Jet, Metric, Points, Sampler};
use rebond::study::accuracy::plan::Plan;
use rebond::study::accuracy::{self, Accuracy, Run, Watch};
use std::f64::consts::PI;
use std::fs;

pub struct Silent;

impl Watch for Silent {
    fn begins(&mut self, _: usize, _: f64) {}
    fn starts(&mut self, _: &str) {}
    fn done(&mut self, _: &Accuracy) -> rebond::Result<()> {
        Ok(())
    }
}

pub fn study(text: &str) -> Accuracy {
    let scene = Scene::from_str(text, "study.toml", &[]).unwrap();
    accuracy::study(&scene, &scene.study(), None, &accuracy::run_native, 1, &mut Silent).unwrap()
}

/// Without contact every scheme is of second order, with either mass, once the fastest of the few
/// modes is resolved.
#[test]
fn free_flight_is_of_second_order_in_time() {
    let accuracy = study(concat!(
        literal!(PAPER_START),
        r#"
        mesh = { element = "fvs", cells = [2, 1] }
        time = { scheme = "newmark", mass = "singular", step = 1e-5, end = 0.01 }
        output = { probes = [{ name = "corner", at = [1.2, 0.0] }] }
        study = { steps = [8e-6, 4e-6, 2e-6], reference_cells = [2, 1], repeat = 1 }
        "#
    ));
    assert!(accuracy.complete && accuracy.failures.is_empty(), "{accuracy}");
    let orders = accuracy.time_orders();
    // The study has Newmark with two restitutions and midpoint with either mass, and conserving
    // with the singular one; exact has no step.
    assert_eq!((orders.len(), accuracy.runs.len()), (7, 7 * 3 + 1), "{accuracy}");
    for of in orders {
        let order = of.end.unwrap_or(f64::NAN);
        assert!((1.9..2.2).contains(&order), "{}: {order}\n{accuracy}", of.method);
        assert_eq!((of.first_impact, of.second_impact), (None, None));
    }
    // On the reference's own mesh the error in space is zero.
    assert!(
        accuracy
            .runs
            .iter()
            .all(|run| run.case.method.mass != Mass::Singular || run.space_error.unwrap() < 1e-9)
    );
}

/// A simply supported plate has no singularity: the study finds order 2 for the deflection and 1 in
/// the energy norm.
#[test]
fn a_study_reads_the_orders_in_space() {
    for element in ["fvs", "hct"] {
        let accuracy = study(&format!(
            r#"
            plate = {{ length = 1, width = 1, {PAPER_SECTION} }}
            mesh = {{ element = "{element}", cells = [4, 4] }}
            support = [
              {{ edge = "left", kind = "simply_supported" }}, {{ edge = "right", kind = "simply_supported" }},
              {{ edge = "bottom", kind = "simply_supported" }}, {{ edge = "top", kind = "simply_supported" }},
            ]
            initial = {{ static_pressure = 1000 }}
            time = {{ scheme = "midpoint", mass = "singular", step = 1e-6, end = 2e-5 }}
            [study]
            schemes = ["midpoint"]
            masses = ["singular"]
            steps = [1e-6]
            cells = [[4, 4], [8, 8]]
            reference_cells = [32, 32]
            repeat = 1
            "#
        ));
        let orders = accuracy.space_orders();
        assert_eq!(orders.len(), 1);
        let finest = &orders[0];
        let (l2, energy) = (finest.l2.unwrap(), finest.energy.unwrap());
        assert!(
            (1.8..2.3).contains(&l2) && (0.9..1.2).contains(&energy),
            "{element}: {l2}, {energy}\n{accuracy}"
        );
    }
}

/// A mesh from a file is refined; a plate of two thicknesses has the norms of both.
#[test]
fn a_study_of_a_mesh_from_a_file_refines_it() {
    let text = r#"
        plate = { thickness = "0.01 + 0.01*x", youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
        mesh = { file = "square_41_text.msh" }
        support = [{ edge = "left", kind = "clamped" }]
        initial = { static_pressure = 1000 }
        time = { scheme = "midpoint", mass = "consistent", step = 1e-5, end = 2e-4 }
        study = { schemes = ["midpoint"], masses = ["consistent"], steps = [1e-5], refinements = [0, 1], repeat = 1 }
        "#;
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/gmsh/study.toml");
    let scene = Scene::from_str(text, beside, &[]).unwrap();
    assert_eq!(scene.study().reference_refine, 2);
    let accuracy =
        accuracy::study(&scene, &scene.study(), None, &accuracy::run_native, 1, &mut Silent).unwrap();
    assert!(accuracy.complete && accuracy.failures.is_empty(), "{accuracy}");
    assert_eq!(accuracy.probes.len(), 9);
    let singular: Vec<_> = accuracy.limits.iter().filter(|limit| limit.family == "singular").collect();
    let meshes: Vec<&str> = singular.iter().map(|limit| limit.mesh.as_str()).collect();
    assert_eq!(meshes, ["file", "file refine 1"]);
    let [coarse, fine] = [0, 1].map(|i| singular[i].space.energy.unwrap().end.rms);
    assert!(0.0 < fine && fine < 0.8 * coarse, "{coarse} {fine}");
    assert!((singular[0].size / singular[1].size - 2.0).abs() < 1e-12);

    for (key, value) in [("cells", "[[4, 4]]"), ("elements", "[\"fvs\"]"), ("reference_cells", "[8, 8]")] {
        let error = Scene::from_str(text, beside, &[format!("study.{key}={value}")]).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains("study.refinements"), "{error}");
    }
}

/// On one mesh the norms by matrices equal those by quadrature, with thickness and material that
/// vary within and between cells.
#[test]
fn norms_are_those_of_the_scenes_sections() {
    let text = r#"
        plate = { length = 1, width = 1, thickness = "0.01 + 0.01*x", youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
        mesh = { element = "hct", cells = [3, 2] }
        part = [{ where = "y > 0.5", youngs_modulus = 70e9, density = 2700 }]
        support = [{ edge = "left", kind = "clamped" }]
        time = { scheme = "midpoint", mass = "consistent", step = 1e-5, end = 1e-4 }
        "#;
    let scene = Scene::from_str(text, "norms", &[]).unwrap();
    let mesh = simulation::mesh(&scene).unwrap();
    let space = simulation::space(&scene, &mesh).unwrap();
    let sections = simulation::sections(&scene, &mesh).unwrap();
    let metric = Metric::new(&mesh, &space, &sections).unwrap();
    let points = Points::new(&mesh, &sections).unwrap();
    let sampler = Sampler::new(&mesh, &space, &points.at).unwrap();
    let mut random = Random::new(7);
    let [a, b]: [Vec<f64>; 2] = std::array::from_fn(|_| (0..space.dofs()).map(|_| random.signed()).collect());
    let by_matrices = metric.distance(&a, &b).unwrap();
    let by_points = points.distance(&sampler.jets(&a), &sampler.jets(&b));
    assert!((by_points.energy / by_matrices.energy - 1.0).abs() < 1e-3, "{by_points:?} {by_matrices:?}");
    assert!((by_points.l2 / by_matrices.l2 - 1.0).abs() < 0.02, "{by_points:?} {by_matrices:?}");
}

/// Returns the errors on the unit square, simply supported with D = 1, under the pressure 4 pi^4
/// sin(pi x) sin(pi y), for which w = sin(pi x) sin(pi y).
fn sinusoidal_error(mesh: Mesh) -> [f64; 2] {
    let exact = |p: Point| (PI * p.x).sin() * (PI * p.y).sin();
    let pressure = |p: Point| 4.0 * PI.powi(4) * exact(p);
    let plate = unit_plate(0.3);
    let support = all_round(Support::SimplySupported);
    let matrices = Matrices::new(mesh, plate, &support);
    let Matrices { mesh, space, engine, stiffness, .. } = &matrices;
    let fill = |points: &[Point], values: &mut [f64]| {
        values.iter_mut().zip(points).for_each(|(value, &at)| *value = pressure(at));
        Ok(())
    };
    let mut load = vec![0.0; space.dofs()];
    assembly::Pressure::new(mesh, &matrices.cells)
        .unwrap()
        .load(&Default::default(), fill, &mut load)
        .unwrap();
    engine.factor(&stiffness.into(), &[]).unwrap().solve(&mut load).unwrap();
    let points = Points::new(mesh, &plate).unwrap();
    let jet = |p: &Point| -> Jet {
        let mixed = PI * PI * (PI * p.x).cos() * (PI * p.y).cos();
        [exact(*p), -PI * PI * exact(*p), mixed, -PI * PI * exact(*p)]
    };
    let expected: Vec<Jet> = points.at.iter().map(jet).collect();
    let jets = Sampler::new(mesh, space, &points.at).unwrap().jets(&load);
    let norms = points.distance(&jets, &expected);
    [norms.l2, norms.energy]
}

#[test]
fn both_elements_converge_on_uniform_and_jittered_meshes() {
    let mut random = Random::new(5);
    for element in [Fvs, Hct] {
        for jitter in [0.0, 0.2] {
            let (mut l2, mut energy) = (Vec::new(), Vec::new());
            for cells in [8, 16, 32] {
                let mut mesh = Mesh::rectangle(1.0, 1.0, [cells; 2], element, Right).unwrap();
                let size = 1.0 / cells as f64;
                for node in &mut mesh.nodes {
                    let inside = |x: f64| x > 0.5 * size && x < 1.0 - 0.5 * size;
                    if inside(node.x) && inside(node.y) {
                        let mut shift = || jitter * size * random.signed();
                        *node += Point::new(shift(), shift()).coords;
                    }
                }
                let [deflection, curvature] = sinusoidal_error(mesh);
                l2.push((size, deflection));
                energy.push((size, curvature));
            }
            let (l2, energy) = (slope(&l2).unwrap(), slope(&energy).unwrap());
            assert!(
                (1.8..2.3).contains(&l2) && (0.9..1.15).contains(&energy),
                "{element:?}, jitter {jitter}: {l2}, {energy}"
            );
        }
    }
}

#[test]
fn a_plan_has_every_combination_that_makes_sense() {
    let text = concat!(
        literal!(PAPER_PLATE),
        r#"
        mesh = { element = "fvs", cells = [10, 4] }
        obstacle = [{ side = "below", height = -0.1 }]
        time = { scheme = "newmark", mass = "singular", step = 5e-6, end = 0.5 }
        [study]
        schemes = ["newmark", "midpoint"]
        steps = [5e-6, 1e-3, 1e-5]
        elements = ["fvs", "hct"]
        cells = [[10, 4], [20, 8]]
        refinements = [0, 1]
        vi = ["condensed", "snes"]
        "#
    );
    let scene = Scene::from_str(text, "plan.toml", &[]).unwrap();
    let plan = Plan::new(&scene, &scene.study()).unwrap();
    // The mesh 20x8 equals 10x4 refined once.
    assert_eq!(plan.grids.len(), 2 * 3);
    let methods: Vec<String> = plan.methods.iter().map(ToString::to_string).collect();
    assert_eq!(
        methods,
        [
            "newmark e=0 singular",
            "newmark e=1 singular",
            "newmark e=0 consistent",
            "newmark e=1 consistent",
            "midpoint singular"
        ]
    );
    assert_eq!(plan.cases.len(), 6 * 5 * 3);
    assert_eq!(plan.cases[0].step, 1e-3, "long steps come first");
    let dropped: Vec<&str> = plan.dropped.iter().map(|dropped| dropped.what.as_str()).collect();
    assert_eq!(dropped, ["native:snes", "midpoint consistent"]);

    // Without obstacles the midpoint scheme is stable with either mass.
    let free = text.replace("obstacle = [{ side = \"below\", height = -0.1 }]", "");
    let scene = Scene::from_str(&free, "plan.toml", &[]).unwrap();
    assert_eq!(Plan::new(&scene, &scene.study()).unwrap().methods.len(), 6);
}

/// No method leaves the friction of a scene out, be it the reference.
#[test]
fn studies_follow_friction() {
    let text = concat!(
        literal!(PAPER_PLATE),
        r#"
        mesh = { element = "fvs", cells = [4, 2] }
        support = [{ edge = "left", kind = "clamped" }]
        obstacle = [{ side = "below", height = -0.001, friction = 0.3 }]
        initial.velocity = -0.5
        time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 4e-3 }
        output.probes = [{ name = "tip", at = [1.2, 0.2] }]
        [study]
        masses = ["singular", "modal"]
        modes = [6]
        repeat = 1
        "#
    );
    let scene = Scene::from_str(text, "plan.toml", &[]).unwrap();
    let plan = Plan::new(&scene, &scene.study()).unwrap();
    let methods: Vec<String> = plan.methods.iter().map(ToString::to_string).collect();
    assert_eq!(methods, ["newmark e=0 singular", "midpoint singular", "conserving singular"]);
    let reference = study(text).reference;
    assert!(reference.contains("midpoint singular"), "{reference}");
    let sliding = text.replace(
        "height = -0.001, friction = 0.3 }]",
        "height = -0.001, where = \"x < 1\" }]\nslider = [{ at = [1.2, 0.2], force = 1 }]",
    );
    let scene = Scene::from_str(&sliding, "plan.toml", &[]).unwrap();
    let methods = Plan::new(&scene, &scene.study()).unwrap().methods;
    let methods: Vec<String> = methods.iter().map(ToString::to_string).collect();
    assert_eq!(methods, ["newmark e=0 singular", "midpoint reflected singular"]);
    let reference = study(&sliding).reference;
    assert!(reference.contains("midpoint reflected"), "{reference}");
}

/// No method leaves the dashpot of a stop out, be it the reference; a ball is a rigid motion.
#[test]
fn studies_follow_dashpots_of_stops_and_balls() {
    let accuracy = study(concat!(
        literal!(PAPER_PLATE),
        r#"
        mesh = { element = "fvs", cells = [4, 2] }
        support = [{ edge = "left", kind = "clamped" }]
        obstacle = [{ side = "below", height = -0.001, at = [1.2, 0.2], stiffness = 1e5, damping = 300 }]
        ball = [{ at = [0.6, 0.2], mass = 0.1, height = 1, stiffness = 1e5 }]
        initial.velocity = -0.5
        time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 4e-3 }
        output.probes = [{ name = "tip", at = [1.2, 0.2] }]
        study = { masses = ["singular"], repeat = 1 }
        "#
    ));
    assert!(accuracy.reference.contains("midpoint reflected"), "{accuracy}");
    let methods: Vec<String> = accuracy.runs.iter().map(|run| run.case.to_string()).collect();
    assert!(!methods.is_empty() && methods.iter().all(|name| name.contains("newmark")), "{methods:?}");
    let refused = accuracy.dropped.iter().filter(|absent| absent.why.contains("damped stop"));
    assert!(refused.count() == 3, "{accuracy}");
}

#[test]
fn the_command_writes_a_table_two_files_and_pictures() {
    let scene = concat!(
        "title = \"a short fall\"\n",
        literal!(PAPER_FALL),
        r#"
        mesh = { element = "fvs", cells = [4, 2] }
        time = { scheme = "newmark", mass = "singular", step = 1e-5, end = 0.08 }
        solver = { energy_guard = 1.05 }
        output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
        "#
    );
    let folder = command::folder("study-files", scene);
    let arguments =
        ["study", "fall.toml", "--out", "out", "--schemes", "newmark,midpoint", "--masses", "singular"];
    let more = [
        "--steps",
        "1e-3,1e-4,2e-5",
        "--cells",
        "4x2,8x4",
        "--reference",
        "16x8",
        "--at",
        "0.03",
        "--repeat",
        "1",
    ];
    let output = rebond(&folder, &[&arguments[..], &more].concat());
    let report = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for words in
        ["fvs 8x4", "order in time", "order in space", "cheapest on fvs 4x2", "cheapest of all", "FAILED"]
    {
        assert!(report.contains(words), "no {words:?} in\n{report}");
    }

    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("out/study.json")).unwrap()).unwrap();
    assert_eq!(json["complete"], true);
    let advice = json["advice"].as_str().unwrap();
    assert!(advice.starts_with("take fvs ") && report.contains(&format!("\n\n{advice}\n")), "{advice}");
    let (runs, failures) = (json["runs"].as_array().unwrap(), json["failures"].as_array().unwrap());
    assert_eq!(runs.len() + failures.len(), 3 * 3 * 2, "{failures:?}");
    assert!(
        failures.iter().all(|failure| failure["why"].as_str().unwrap().contains("guard")),
        "{failures:?}"
    );
    for run in runs {
        assert_eq!(run["time"]["at"][0][0].as_f64().map(|t| (t * 1e3).round()), Some(30.0));
        assert!(run["time"]["l2"]["first_impact"]["rms"].as_f64().unwrap() > 0.0);
        assert!(run["worst_kkt"].as_f64().unwrap() <= 1e-10);
    }

    let csv = fs::read_to_string(folder.join("out/study.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 1 + runs.len());
    assert!(rows.iter().all(|row| row.len() == rows[0].len()));
    assert_eq!(rows[0][..4], ["mesh", "scheme", "mass", "restitution"]);

    for name in ["work-precision", "work-precision-fvs-4x2", "orders-fvs-8x4", "energy-drift-fvs-4x2", "cost"]
    {
        let picture = fs::read_to_string(folder.join(format!("out/plots/{name}.svg"))).unwrap();
        assert!(picture.contains("rebond study fall.toml"), "{name} does not tell its command");
        assert!(folder.join(format!("out/plots/{name}.png")).is_file());
    }
}

#[test]
fn wrong_lists_are_told_like_wrong_keys() {
    let folder = command::folder("study-wrong", include_str!("../../scenes/csma2013/fig4.toml"));
    let cases = [
        (["--schemes", "newmrak"], "study.schemes.0: \"newmrak\" is not valid"),
        (["--steps", "1e-3,7.77e-4"], "study.steps: no instants are common"),
        (["--cells", "10x0"], "study.cells.0.1: 0 is too small"),
    ];
    for (flags, words) in cases {
        let output = rebond(&folder, &[&["study", "fall.toml"][..], &flags].concat());
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(words) && message.lines().count() == 1, "{message}");
    }
    assert!(!folder.join("studies").exists());
}

/// Two steps show no trend, by which a claim would hold or fail.
#[test]
fn few_steps_judge_no_claim() {
    let folder = command::folder("study-few", "");
    let output = rebond(&folder, &["figures", "--out", "out", "--smallest-step", "5e-5"]);
    let claims = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success() && !claims.contains("FAILS"), "{claims}");
    assert_eq!(claims.matches(": not judged, the steps are too few").count(), 6, "{claims}");
}

/// The claims are tested at steps down to 1e-5 s, and hold better at smaller ones.
#[test]
fn the_claims_of_the_paper_hold() {
    let folder = command::folder("study-figures", "");
    let output = rebond(&folder, &["figures", "--out", "out", "--smallest-step", "1e-5", "--json"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let claims: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let claims = claims.as_array().unwrap();
    assert_eq!(claims.len(), 6);
    for claim in claims {
        assert_eq!(claim["verdict"], "holds", "{claim}");
    }
    for figure in 1..=6 {
        let name = |more: &str, extension: &str| folder.join(format!("out/fig{figure}{more}.{extension}"));
        for more in ["", "-more"] {
            let picture = fs::read_to_string(name(more, "svg")).unwrap();
            assert!(picture.contains("rebond figures"));
            assert_eq!(picture.contains(">exact<"), more == "-more");
            assert!(name(more, "png").is_file());
        }
    }
}

/// Scene that runs in a short time and has an impact.
const FALL: &str = concat!(
    literal!(PAPER_FALL),
    r#"
    mesh = { element = "fvs", cells = [4, 2] }
    time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.08 }
    output = { probes = [{ name = "corner", at = [1.2, 0.0] }] }
    [study]
    steps = [1e-3, 1e-4]
    masses = ["singular"]
    reference_cells = [4, 2]
    until = "end"
    repeat = 1
    "#
);

/// The test depends on errors only, since seconds depend on the machine.
#[test]
fn the_exact_scheme_leads_the_front() {
    let accuracy = study(FALL);
    let limit = &accuracy.limits[0];
    assert_eq!((limit.source.as_str(), limit.refused.len()), ("exact singular", 0), "{accuracy}");
    let (exact, others): (Vec<&Run>, Vec<&Run>) =
        accuracy.runs.iter().partition(|run| run.case.method.scheme == rebond::scene::SchemeSpec::Exact);
    assert_eq!((exact.len(), others.len()), (1, 4 * 2), "{accuracy}");
    assert!(exact[0].at_floor && exact[0].time_error.unwrap() < 1e-12, "{accuracy}");
    assert!(others.iter().all(|run| run.time_error.unwrap() > 1e-5), "{accuracy}");
    assert!(front(&accuracy.runs.iter().collect::<Vec<_>>(), Axis::Time).contains(&exact[0]));
    let row =
        accuracy.csv().lines().find(|line| line.starts_with("fvs 4x2,exact,singular,,")).map(str::to_owned);
    let heads = accuracy.csv().lines().next().map(str::to_owned).unwrap();
    let on_front = heads.split(',').position(|head| head == "on_front").unwrap();
    assert!(row.is_some_and(|row| row.split(',').nth(on_front) == Some("true")), "{}", accuracy.csv());
}

/// The errors and seconds of each case are invented, so that the best choice is plain.
#[test]
fn the_advice_is_the_cheapest_run_whose_step_is_short_enough() {
    let mut accuracy = study(FALL);
    accuracy.runs.retain(|run| run.case.method.scheme.name().to_string() == "conserving");
    let advice = |space: f64| {
        let mut accuracy = accuracy.clone();
        for run in &mut accuracy.runs {
            // The error in time is of first order.
            (run.time_error, run.space_error) = (Some(100.0 * run.case.step), Some(space));
            (run.set_up_seconds, run.stepping_seconds) = (0.0, 1e-6 / run.case.step);
        }
        accuracy.advice().unwrap()
    };
    let take = |step: &str, ms: f64, error: &str, part: &str| {
        format!(
            "take fvs 4x2, conserving singular, {step} s: {ms} ms of computing, error {error} over the whole \
             run, mostly by the {part}"
        )
    };
    assert_eq!(advice(0.2), take("1e-3", 1.0, "3.0e-1", "mesh"));
    assert_eq!(advice(0.05), take("1e-4", 10.0, "6.0e-2", "mesh"));
    assert_eq!(advice(1e-3), take("1e-4", 10.0, "1.1e-2", "step"));

    // Modal mass without limits: with ten modes the error is a tenth, with a shorter step the same.
    let few = &mut accuracy.runs[0];
    (few.case.method.mass, few.case.method.modes) = (Mass::Modal, Some(5));
    (few.time_error, few.space_error, few.whole_error) = (None, None, 0.1);
    let mut short = few.clone();
    short.case.step = 1e-4;
    let mut many = few.clone();
    (many.case.method.modes, many.whole_error) = (Some(10), 0.01);
    accuracy.runs = vec![accuracy.runs[0].clone(), short];
    assert!(accuracy.advice().unwrap().ends_with("error 1.0e-1 over the whole run"), "{accuracy}");
    // The most accurate run takes too long for what it gains over twice its error.
    many.stepping_seconds = 1e3;
    accuracy.runs.iter_mut().for_each(|run| run.whole_error = 0.019);
    accuracy.runs.push(many.clone());
    assert!(!accuracy.advice().unwrap().contains("m=10"), "{accuracy}");
    accuracy.runs.iter_mut().rev().skip(1).for_each(|run| run.whole_error = 0.021);
    assert!(accuracy.advice().unwrap().contains("m=10"), "{accuracy}");
    assert_eq!(Accuracy::default().advice(), None);
}

/// Observer that stops a study after some parts of its work and keeps the results so far.
pub struct Stopping {
    pub left: usize,
    pub known: Option<Accuracy>,
    pub parts: usize,
}

impl Watch for Stopping {
    fn begins(&mut self, parts: usize, _: f64) {
        self.parts = parts;
    }
    fn starts(&mut self, _: &str) {}
    fn done(&mut self, so_far: &Accuracy) -> rebond::Result<()> {
        self.known = Some(so_far.clone());
        self.left -= 1;
        if self.left == 0 { Err(rebond::Error::Usage("stopped".into())) } else { Ok(()) }
    }
}

#[test]
fn runs_at_once_have_the_same_errors() {
    let scene = Scene::from_str(FALL, "study.toml", &[]).unwrap();
    let study = |jobs| {
        accuracy::study(&scene, &scene.study(), None, &accuracy::run_native, jobs, &mut Silent).unwrap()
    };
    let (alone, at_once) = (study(1), study(3));
    let errors =
        |of: &Accuracy| of.runs.iter().map(|run| (run.case.to_string(), run.time_error)).collect::<Vec<_>>();
    assert_eq!(errors(&alone), errors(&at_once));
    assert!(!alone.to_string().contains("at once"));
    assert!(at_once.to_string().contains("3 runs were made at once"), "{at_once}");
}

#[test]
fn a_study_that_was_stopped_goes_on() {
    let scene = Scene::from_str(FALL, "study.toml", &[]).unwrap();
    let run = |known, left| {
        let mut watch = Stopping { left, known: None, parts: 0 };
        let ended = accuracy::study(&scene, &scene.study(), known, &accuracy::run_native, 1, &mut watch);
        (ended, watch)
    };
    // The parts are the reference, its limit, and nine runs.
    let (whole, watch) = run(None, usize::MAX);
    assert_eq!(watch.parts, 11);
    let (stopped, watch) = run(None, 5);
    let known = watch.known.unwrap();
    assert!(stopped.is_err() && known.runs.len() == 3);
    let json = serde_json::to_vec(&known.summary("rebond study", &scene, "hash")).unwrap();
    assert!(Accuracy::stopped(&json, "of another scene").is_none());
    let read = Accuracy::stopped(&json, "hash").unwrap();
    assert_eq!(read.runs.len(), 3);
    // The remaining parts are the limit again and six runs.
    let (resumed, watch) = run(Some(read), usize::MAX);
    assert_eq!(watch.parts, 7);
    let errors = |accuracy: rebond::Result<Accuracy>| {
        let accuracy = accuracy.unwrap();
        assert!(accuracy.complete && accuracy.limits.len() == 1);
        accuracy.runs.iter().map(|run| (run.case.to_string(), run.time_error.unwrap())).collect::<Vec<_>>()
    };
    for ((case, error), (expected_case, expected)) in errors(resumed).into_iter().zip(errors(whole)) {
        assert!(
            case == expected_case && (error - expected).abs() <= 1e-12 * expected,
            "{case}: {error}, {expected}"
        );
    }
}
