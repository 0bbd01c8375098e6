//! Studies with the modal mass: their plan, errors in time and in space, files, and continuation.

use crate::common::command;
use crate::common::command::rebond;
use crate::common::models::literal;
use crate::study::{Silent, Stopping, study};
use rebond::scene::{Mass, Scene, SchemeSpec};
use rebond::study::accuracy::plan::Plan;
use rebond::study::accuracy::{self, Accuracy, Run};
use std::fs;

/// Scene of the paper's fall with an impact, and a study of it with the modal mass.
const FALL: &str = concat!(
    literal!(PAPER_FALL),
    r#"
    mesh = { element = "fvs", cells = [5, 2] }
    time = { scheme = "conserving", mass = "singular", step = 2e-5, end = 0.08 }
    output = { probes = [{ name = "corner", at = [1.2, 0.0] }] }
    [study]
    schemes = ["conserving", "exact"]
    masses = ["modal"]
    modes = [10, 20]
    steps = [8e-5, 2e-5]
    cells = [[5, 2], [10, 4]]
    reference_cells = [10, 4]
    reference_mass = "modal"
    reference_modes = 60
    until = "end"
    repeat = 1
    "#
);

fn scene(overrides: &[&str]) -> Scene {
    let overrides: Vec<String> = overrides.iter().map(|of| (*of).to_owned()).collect();
    Scene::from_str(FALL, "fall.toml", &overrides).unwrap()
}

fn find<'a>(accuracy: &'a Accuracy, name: &str) -> &'a Run {
    let run = accuracy.runs.iter().find(|run| run.case.to_string() == name);
    run.unwrap_or_else(|| panic!("no {name} in\n{accuracy}"))
}

/// The limit of a method with m modes is the exact motion with m modes: the error in time of
/// `conserving` falls with the step, that of `exact` is rounding. The error in space falls with m.
#[test]
fn errors_fall_with_the_step_and_with_the_modes() {
    let accuracy = study(FALL);
    assert!(accuracy.complete && accuracy.failures.is_empty(), "{accuracy}");
    assert_eq!(accuracy.runs.len(), 2 * 2 * (2 + 1), "{accuracy}");
    let families: Vec<(&str, &str)> =
        accuracy.limits.iter().map(|limit| (limit.family.as_str(), limit.source.as_str())).collect();
    let pair = [("modal m=10", "exact modal m=10"), ("modal m=20", "exact modal m=20")];
    assert_eq!(families, [pair, pair].concat());
    for mesh in ["fvs 5x2", "fvs 10x4"] {
        for m in [10, 20] {
            let at = |step: &str| find(&accuracy, &format!("{mesh}, conserving modal m={m}, {step} s"));
            let [long, short] = [at("8e-5"), at("2e-5")].map(|run| run.time_error.unwrap());
            assert!(1e-7 < short && short < 0.6 * long, "{mesh} m={m}: {long} {short}\n{accuracy}");
            let exact = find(&accuracy, &format!("{mesh}, exact modal m={m}"));
            assert!(exact.at_floor && exact.time_error.unwrap() < 1e-11, "{accuracy}");
            // Without error in time the whole error is that in space.
            let space = exact.space_error.unwrap();
            assert!((exact.whole_error - space).abs() < 1e-9, "{space} {}", exact.whole_error);
        }
    }
    // On the reference's own mesh only the number of modes differs.
    let split =
        |m: usize| find(&accuracy, &format!("fvs 10x4, exact modal m={m}")).whole.kinetic.unwrap().rms;
    let space = |m: usize| find(&accuracy, &format!("fvs 10x4, exact modal m={m}")).space_error.unwrap();
    assert!(0.0 < space(20) && space(20) < space(10), "{} {}", space(10), space(20));
    assert!(0.0 < split(20) && split(20) < split(10), "{} {}", split(10), split(20));
    // Limits differ between numbers of modes, so that the whole error ranks the runs.
    assert!(accuracy.to_string().contains("* on the front of whole error"), "{accuracy}");
    let orders: Vec<String> = accuracy.time_orders().into_iter().map(|of| of.method).collect();
    assert!(orders.contains(&"conserving modal m=10".to_owned()), "{orders:?}");
    let orders: Vec<String> = accuracy.space_orders().into_iter().map(|of| of.family).collect();
    assert_eq!(orders, ["modal m=10", "modal m=20"]);
}

#[test]
fn a_plan_has_the_modes_that_make_sense() {
    let all = scene(&[
        "study.schemes=[\"newmark\", \"conserving\", \"exact\"]",
        "study.masses=[\"singular\", \"modal\"]",
        "study.modes=[10, 40]",
        "study.cells=[[5, 2], [24, 14]]",
        "study.restitutions=[0]",
        "study.skip=[\"24x14 newmark\", \"m=10 8e-5\"]",
    ]);
    let plan = Plan::new(&all, &all.study()).unwrap();
    let dropped: Vec<&str> = plan.dropped.iter().map(|dropped| dropped.what.as_str()).collect();
    assert_eq!(dropped, ["fvs 5x2, m=40", "fvs 24x14, exact singular", "24x14 newmark", "m=10 8e-5"]);
    let cases: Vec<String> = plan.cases.iter().map(ToString::to_string).collect();
    assert_eq!(
        cases,
        [
            "fvs 5x2, newmark e=0 singular, 8e-5 s",
            "fvs 5x2, newmark e=0 singular, 2e-5 s",
            "fvs 5x2, newmark e=0 modal m=10, 2e-5 s",
            "fvs 5x2, conserving singular, 8e-5 s",
            "fvs 5x2, conserving singular, 2e-5 s",
            "fvs 5x2, conserving modal m=10, 2e-5 s",
            "fvs 5x2, exact singular",
            "fvs 5x2, exact modal m=10",
            "fvs 24x14, conserving singular, 8e-5 s",
            "fvs 24x14, conserving singular, 2e-5 s",
            "fvs 24x14, conserving modal m=10, 2e-5 s",
            "fvs 24x14, conserving modal m=40, 8e-5 s",
            "fvs 24x14, conserving modal m=40, 2e-5 s",
            "fvs 24x14, exact modal m=10",
            "fvs 24x14, exact modal m=40",
        ]
    );
    let wrong = scene(&["study.skip=[\"80x32 newmark\"]"]);
    let error = Plan::new(&wrong, &wrong.study()).unwrap_err().to_string();
    assert!(error.contains("study.skip") && error.contains("80x32 newmark"), "{error}");
}

/// A study has the scene's own scheme and mass by default, and tells once what cannot take it.
#[test]
fn a_study_has_the_mass_of_its_scene() {
    let damped = concat!(
        literal!(PAPER_START),
        r#"
        obstacle = [{ side = "below", height = -0.1, at = [1.2, 0], stiffness = 1e5, damping = 50 }]
        damping = { modal = 0.02 }
        mesh = { element = "fvs", cells = [4, 2] }
        time = { scheme = "conserving", mass = "modal", modes = 8, step = 1e-3, end = 0.08 }
        study = { steps = [1e-3], repeat = 1, reference_cells = [4, 2] }
        "#
    );
    let accuracy = study(damped);
    let runs: Vec<String> = accuracy.runs.iter().map(|run| run.case.to_string()).collect();
    assert!(runs.contains(&"fvs 4x2, conserving modal m=8, 1e-3 s".to_owned()), "{accuracy}");
    let left_out =
        "\nleft out  fvs 4x2, conserving singular: time.scheme = \"conserving\" takes no damping.modal\n";
    assert_eq!(accuracy.to_string().matches(left_out).count(), 1, "{accuracy}");
    assert!(!accuracy.to_string().contains("FAILED"), "{accuracy}");
    // The exact scheme knows no dashpots, so that it is no limit here.
    let limit = accuracy.limits.iter().find(|limit| limit.family == "modal m=8").unwrap();
    assert_eq!(limit.source, "conserving modal m=8, 2.5e-4 s", "{accuracy}");

    let refused =
        damped.replace("study = {", "study = { schemes = [\"conserving\"], masses = [\"singular\"],");
    let told = study(&refused).to_string();
    assert!(told.contains(left_out) && !told.contains("none") && !told.contains("FAILED"), "{told}");
    assert!(told.ends_with("\n\nno run reached the end: expected schemes and masses that take the scene\n"));
}

/// Without limits each run has its whole error only; the floor is that of the finest mesh.
#[test]
fn a_study_without_limits_measures_the_whole_error_and_the_floor() {
    let text = FALL.replace("until =", "limits = false\nfloor = true\nuntil =");
    let text = text.replace("masses = [\"modal\"]", "masses = [\"singular\", \"modal\"]");
    let without = study(&text.replace("modes = [10, 20]", "modes = [20]").replace("8e-5, 2e-5", "2e-5"));
    assert!(without.failures.is_empty() && without.limits.is_empty(), "{without}");
    assert!(without.runs.iter().all(|run| run.time.is_none() && run.time_error.is_none()), "{without}");
    assert!(without.runs.iter().all(|run| run.error() == run.whole_error && run.whole_error > 0.0));
    let with = study(FALL);
    let name = "fvs 5x2, conserving modal m=20, 2e-5 s";
    let [whole, bound] = [find(&without, name).error(), find(&with, name).error()];
    // The sum of the errors in time and in space bounds the whole error.
    assert!(whole <= bound && bound < 1.5 * whole, "{whole} {bound}");

    let best: Vec<(Mass, bool)> =
        without.best.iter().map(|best| (best.mass, best.name.starts_with("fvs 10x4"))).collect();
    assert_eq!(best, [(Mass::Singular, true), (Mass::Modal, true)]);
    let floor = without.floor().unwrap();
    let largest = without.best.iter().map(|best| best.error).fold(0.0, f64::max);
    assert!(floor.deflection >= largest && floor.kinetic.unwrap() > 0.0, "{floor:?}");
    let report = without.to_string();
    assert!(
        report.contains("floor: ") && report.contains("energy\n") || report.contains("energy"),
        "{report}"
    );
}

#[test]
fn a_modal_study_that_was_stopped_goes_on() {
    let scene =
        scene(&["study.cells=[[5, 2]]", "study.floor=true", "study.masses=[\"singular\", \"modal\"]"]);
    let run = |known, left| {
        let mut watch = Stopping { left, known: None, parts: 0 };
        let ended = accuracy::study(&scene, &scene.study(), known, &accuracy::run_native, 1, &mut watch);
        (ended, watch)
    };
    let (whole, _) = run(None, usize::MAX);
    let (stopped, watch) = run(None, 9);
    assert!(stopped.is_err());
    let json = serde_json::to_vec(&watch.known.unwrap().summary("rebond study", &scene, "hash")).unwrap();
    let read = Accuracy::stopped(&json, "hash").unwrap();
    assert!(read.runs.iter().any(|run| run.case.method.modes == Some(10)), "{read}");
    let known = read.runs.len();
    let (resumed, watch) = run(Some(read), usize::MAX);
    let (whole, resumed) = (whole.unwrap(), resumed.unwrap());
    assert!(known > 0 && watch.parts < whole.runs.len(), "{known} {}", watch.parts);
    assert_eq!(whole.runs.len(), resumed.runs.len());
    for (resumed, whole) in resumed.runs.iter().zip(&whole.runs) {
        assert_eq!(resumed.case, whole.case);
        assert!((resumed.whole_error - whole.whole_error).abs() <= 1e-12 * whole.whole_error);
        assert!((resumed.error() - whole.error()).abs() <= 1e-12 * whole.error());
        assert!(resumed.whole.kinetic.is_some());
    }
    let [a, b] = [resumed.floor().unwrap(), whole.floor().unwrap()];
    assert!(a.runs == b.runs && (a.deflection - b.deflection).abs() <= 1e-12 * b.deflection, "{a:?} {b:?}");
}

#[test]
fn the_command_names_the_modes_in_all_files() {
    let text = FALL.replace("masses = [\"modal\"]", "masses = [\"singular\", \"modal\"]\nfloor = true");
    let folder = command::folder("study-modal-files", &text);
    let lists = ["--modes", "8,16", "--cells", "4x2,5x2", "--reference", "8x4", "--reference-modes", "40"];
    let more = ["--steps", "4e-5", "--skip", "4x2 exact", "--out", "out"];
    let output = rebond(&folder, &[&["study", "fall.toml"][..], &lists, &more].concat());
    let report = String::from_utf8(output.stdout).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for words in
        ["conserving modal m=8", "exact modal m=16", "limit, modal m=16", "floor: ", "left out  4x2 exact"]
    {
        assert!(report.contains(words), "no {words:?} in\n{report}");
    }
    let csv = fs::read_to_string(folder.join("out/study.csv")).unwrap();
    let rows: Vec<Vec<&str>> = csv.lines().map(|line| line.split(',').collect()).collect();
    let column =
        |head: &str| rows[0].iter().position(|own| *own == head).unwrap_or_else(|| panic!("no {head}"));
    for row in &rows[1..] {
        let is_modal = row[column("mass")] == "modal";
        assert_eq!(matches!(row[column("modes")], "8" | "16"), is_modal, "{row:?}");
        for head in
            ["set_up_seconds", "stepping_seconds", "whole_error", "energy_split", "whole_rms_after_impact"]
        {
            assert!(row[column(head)].parse::<f64>().unwrap() > 0.0, "{head} in {row:?}");
        }
    }
    let json: serde_json::Value =
        serde_json::from_slice(&fs::read(folder.join("out/study.json")).unwrap()).unwrap();
    let modes: Vec<u64> =
        json["runs"].as_array().unwrap().iter().filter_map(|run| run["modes"].as_u64()).collect();
    assert_eq!(modes, [8, 16, 8, 16, 8, 16]);
    assert!(json["floor"]["kinetic"].as_f64().unwrap() > 0.0);
    for name in ["after-impact", "work-precision", "work-precision-fvs-5x2"] {
        let picture = fs::read_to_string(folder.join(format!("out/plots/{name}.svg"))).unwrap();
        assert!(picture.contains("best runs of all masses differ"), "{name} lacks the floor");
    }
    let picture = fs::read_to_string(folder.join("out/plots/work-precision-fvs-5x2.svg")).unwrap();
    assert!(picture.contains("modal m=16"));
}

#[test]
fn wrong_modes_are_told_like_wrong_keys() {
    let cases = [
        ("study.masses=[\"singular\"]", "study.modes", ""),
        ("study.modes=[0]", "study.modes.0", "a number of modes"),
        ("study.reference_mass=\"consistent\"", "study.reference_mass", "\"modal\""),
        ("study.skip=[\" \"]", "study.skip.0", "words of a run's name"),
        ("study.limits=1", "study.limits", "true"),
    ];
    for (wrong, key, expected) in cases {
        let text = if expected.is_empty() {
            FALL.replace("masses = [\"modal\"]", "masses = [\"singular\"]")
        } else {
            FALL.into()
        };
        let overrides = if expected.is_empty() { vec![] } else { vec![wrong.to_owned()] };
        let error = Scene::from_str(&text, "fall.toml", &overrides).unwrap_err().to_string();
        assert!(error.contains(key) && error.contains(expected), "{wrong}: {error}");
    }
    // A flag that chooses another mass does not stumble over the scene's modes.
    let scene = scene(&["study.masses=[\"singular\"]"]);
    assert!(Plan::new(&scene, &scene.study()).unwrap().methods.iter().all(|method| method.modes.is_none()));
    assert!(accuracy::study(&scene, &scene.study(), None, &accuracy::run_native, 1, &mut Silent).is_ok());
    let exact = |run: &&Run| run.case.method.scheme == SchemeSpec::Exact;
    assert_eq!(study(FALL).runs.iter().filter(exact).count(), 4);
}
