//! The command from the user's point of view: exit codes, messages and files.

use crate::common::command;
use crate::common::command::{comparison, rebond, text};
use crate::common::models::literal;
use std::path::PathBuf;
use std::process::{Command, Output};

const SCENE: &str = concat!(
    "title = \"a short fall\"\n",
    literal!(PAPER_FALL),
    r#"
mesh = { element = "fvs", cells = [4, 2] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.08 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("cli-{test}"), SCENE)
}

/// Asserts an exit code and a message of exactly one line that contains some words.
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    assert_eq!(text(&output.stderr).lines().count(), 1, "{}", text(&output.stderr));
    command::assert_fails(output, code, words);
}

#[test]
fn a_run_writes_history_summary_and_picture() {
    let folder = folder("run");
    let output = rebond(&folder, &["run", "fall.toml"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let report = text(&output.stdout);
    for words in ["a short fall", "contact below", "first impact", "runs/fall"] {
        assert!(report.contains(words), "no {words:?} in:\n{report}");
    }
    let history = std::fs::read_to_string(folder.join("runs/fall/history.csv")).unwrap();
    assert_eq!(history.lines().count(), 1 + 81);
    assert!(history.lines().next().unwrap().ends_with(",kkt,corner"));
    let summary = command::summary(&folder.join("runs/fall"));
    assert_eq!(summary["status"], "done");
    assert_eq!(summary["steps"], 800);
    assert!(summary["first_impact"]["time"].as_f64().unwrap() > 0.05);
    assert!(summary["worst_kkt"].as_f64().unwrap() <= 1e-10);
    let picture = std::fs::read_to_string(folder.join("runs/fall/plots/history.svg")).unwrap();
    assert!(picture.contains("<svg") && picture.contains("a short fall"));
}

/// A run prints the warnings of a check on standard error and keeps them in its summary.
#[test]
fn a_run_hides_no_warning_of_its_check() {
    let folder = folder("warnings");
    let clamped = r#"support=[{edge="left",kind="clamped"},{edge="right",kind="clamped"},{edge="top",kind="clamped"},{edge="bottom",kind="clamped"}]"#;
    for (settings, words) in [
        (&["time.step=1e-2"][..], "time.step = 0.01 s"),
        (&["time.mass=consistent"], "does not vanish with the step"),
        (&["support=[]", "initial={ velocity = -1 }"], "nothing holds it"),
        (
            &["initial={ velocity = 1 }"],
            "initial.velocity: 1.0 m/s at (0, 0), where a support holds the plate at 0; it stops the plate there at once",
        ),
        (
            &["initial={ velocity = '0.1*x' }"],
            "initial.velocity: a slope of 0.1 1/s at (0, 0), where a support holds",
        ),
        (
            &["initial={ velocity = '0.1*x/3' }"],
            "initial.velocity: a slope of 0.03333 1/s at (0, 0), where a support holds",
        ),
        (&["mesh={ element = 'hct', cells = [2, 2] }", clamped], "inf-sup condition fails"),
        (
            &[
                "ball=[{ at=[0.6, 0.2], mass=1, height=0.1 }]",
                "output.probes=[{ name='s', at=[0.65, 0.2], quantity='von_mises_top' }]",
            ],
            "beside a point that is held or loaded (ball.0)",
        ),
        (&["ball=[{ at=[0.6, 0.2], mass=1, height=0.1 }]"], "ball.0.mass: the rebound of a rigid ball"),
    ] {
        let settings: Vec<&str> =
            settings.iter().chain(&["time.end=0.02"]).flat_map(|set| ["--set", set]).collect();
        let on = |command: &str, more: &[&str]| {
            let output = rebond(&folder, &[&[command, "fall.toml"], &settings[..], more].concat());
            command::succeeds(&output);
            output
        };
        let check: serde_json::Value = serde_json::from_slice(&on("check", &["--json"]).stdout).unwrap();
        let expected: Vec<&str> =
            check["warnings"].as_array().unwrap().iter().map(|warning| warning.as_str().unwrap()).collect();
        assert!(expected.iter().any(|warning| warning.contains(words)), "{words}: {expected:?}");
        let said = text(&on("run", &["--overwrite"]).stderr);
        let said: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("warning: ")).collect();
        assert_eq!(said, expected);
        assert_eq!(command::summary(&folder.join("runs/fall"))["warnings"], check["warnings"]);
        assert!(on("run", &["--quiet"]).stderr.is_empty());
    }
}

#[test]
fn the_same_run_twice_writes_the_same_bytes() {
    let folder = folder("twice");
    for out in ["one", "two"] {
        assert!(rebond(&folder, &["run", "fall.toml", "--quiet", "--out", out]).status.success());
    }
    let history = |out: &str| std::fs::read(folder.join(out).join("history.csv")).unwrap();
    assert_eq!(history("one"), history("two"));
}

#[test]
fn quiet_prints_nothing_and_json_prints_json() {
    let folder = folder("quiet");
    let output = rebond(&folder, &["run", "fall.toml", "--quiet"]);
    assert!(output.status.success() && output.stdout.is_empty() && output.stderr.is_empty());
    let output = rebond(&folder, &["run", "fall.toml", "--json", "--overwrite", "--set", "time.end=0.01"]);
    let summary: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(summary["scene"]["time"]["end"], 0.01);
    assert_eq!(summary["first_impact"], serde_json::Value::Null);
}

#[test]
fn plot_draws_again_what_a_run_left() {
    let folder = folder("plot");
    assert!(rebond(&folder, &["run", "fall.toml", "--quiet"]).status.success());
    let picture = folder.join("runs/fall/plots/history.svg");
    let first = std::fs::read(&picture).unwrap();
    std::fs::remove_file(&picture).unwrap();
    assert!(rebond(&folder, &["plot", "runs/fall"]).status.success());
    assert_eq!(std::fs::read(&picture).unwrap(), first);
    assert_fails(&rebond(&folder, &["plot", "nowhere"]), 4, &["nowhere"]);
}

#[test]
fn a_bad_scene_exits_2_and_writes_nothing() {
    let folder = folder("bad");
    let set = |key: &str| rebond(&folder, &["run", "fall.toml", "--set", key]);
    assert_fails(&set("plate.thickness=-1"), 2, &["plate.thickness", "greater than 0"]);
    assert_fails(&set("plate.thicknes=1"), 2, &["thicknes", "thickness"]);
    assert_fails(&set("support=[]"), 2, &["static_pressure", "nothing holds it"]);
    if cfg!(not(feature = "petsc")) {
        assert_fails(&set("solver.engine=petsc"), 2, &["petsc", "native"]);
    }
    assert_fails(&set("solver.vi=tao"), 2, &["tao", "condensed"]);
    assert_fails(
        &rebond(&folder, &["run", "fall.toml", "--", "-ksp_type", "cg"]),
        2,
        &["-ksp_type", "PETSc"],
    );
    assert!(!folder.join("runs").exists());
}

#[test]
fn compare_puts_solvers_side_by_side() {
    let folder = folder("compare");
    let compare = |arguments: &[&str]| rebond(&folder, &[&["compare", "fall.toml"], arguments].concat());
    let table = text(&compare(&[]).stdout);
    for words in ["a short fall: 36 dofs, 1 rank", "up to", "contact 1", "native", "contacts at ", " ms; "] {
        assert!(table.contains(words), "no {words:?} in:\n{table}");
    }
    // Modes have one contact solver.
    let of_modes = compare(&["--set", "time.mass=modal", "--set", "time.scheme=conserving"]);
    assert!(of_modes.status.success(), "{of_modes:?}");
    // A contender that cannot run has a row of its own, and the final error names it.
    let output = compare(&["--json", "--with", "native,native:snes"]);
    assert_fails(&output, 3, &["1 of 2", "native:snes", "no \"snes\""]);
    let value = comparison(&output);
    let [native, other] = value["entries"].as_array().unwrap().as_slice() else { unreachable!() };
    assert_eq!((&native["steps"], &native["difference"]), (&800.into(), &0.0.into()));
    assert_eq!(native["retries"], 0);
    assert_eq!(
        native["difference_up_to_impact"].as_array().unwrap().len(),
        value["impacts"].as_array().unwrap().len()
    );
    assert!(native["seconds"]["contact_step"].as_f64().unwrap() > 0.0);
    assert!(other["failure"].as_str().unwrap().contains("snes"), "{other}");
    // The same holds for a contender that stops on its way.
    let stopped = compare(&["--set", "solver.tolerance=1e-18", "--with", "native"]);
    assert_eq!(stopped.status.code(), Some(3), "the reference itself cannot start");
    assert!(compare(&["--quiet"]).stdout.is_empty());
    for wrong in ["abacus", "petsc:condensed:tron", "petsc:tao:tron:twice"] {
        assert_fails(&compare(&["--with", wrong]), 2, &[wrong, "petsc:snes"]);
    }
    assert_fails(&compare(&["--vi", "snes"]), 2, &["--with"]);
}

#[test]
fn a_wrong_command_line_exits_2() {
    let folder = folder("usage");
    for (arguments, words) in [
        (&["fly"][..], "'fly'; see rebond --help"),
        (&["run"], "were not provided: <SCENE>; see rebond run --help"),
        (&["modes", "fall.toml", "--count", "x"], "expected a whole number; see rebond modes --help"),
    ] {
        let wrong = rebond(&folder, arguments);
        let said = text(&wrong.stderr);
        assert_eq!((wrong.status.code(), said.lines().count()), (Some(2), 1), "{said}");
        assert!(said.starts_with("rebond: ") && said.trim_end().ends_with(words), "{said}");
    }
    assert!(rebond(&folder, &["--help"]).status.success());
    assert!(rebond(&folder, &["--version"]).status.success());
}

#[test]
fn an_impossible_tolerance_exits_3_and_keeps_what_was_written() {
    let folder = folder("tolerance");
    let output = rebond(&folder, &["run", "fall.toml", "--quiet", "--set", "solver.tolerance=1e-18"]);
    assert_fails(&output, 3, &["KKT", "1.0e-18"]);
    let output = rebond(
        &folder,
        &[
            "run",
            "fall.toml",
            "--quiet",
            "--overwrite",
            "--set",
            "solver.tolerance=1e-18",
            "--set",
            "initial.static_pressure=0",
            "--set",
            "initial.velocity=-3",
        ],
    );
    assert_fails(&output, 3, &["KKT"]);
    assert!(folder.join("runs/fall/summary.json").exists());
}

#[test]
fn what_cannot_be_read_or_written_exits_4() {
    let folder = folder("files");
    assert_fails(&rebond(&folder, &["run", "no.toml"]), 4, &["no.toml"]);
    let output = rebond(&folder, &["run", "fall.toml", "--quiet", "--out", "fall.toml/run"]);
    assert_fails(&output, 4, &["fall.toml", "a file stands where a folder is expected"]);
    std::fs::write(folder.join("fall.msh"), "$MeshFormat\n").unwrap();
    assert_fails(&rebond(&folder, &["run", "fall"]), 4, &["did you mean fall.toml?"]);
    let error = rebond(&folder, &["run", "falls.msh"]);
    assert_fails(&error, 4, &["falls.msh: there is no such file (did you mean fall.toml?)"]);
    assert_fails(&rebond(&folder, &["run", "fall.msh"]), 2, &["a mesh; expected a scene", "\"fall.msh\""]);
    for command in ["plot", "report", "resume"] {
        let output = rebond(&folder, &[command, "fall.toml"]);
        assert_fails(&output, 4, &["fall.toml: a file; expected the folder of a run"]);
    }
    std::fs::write(folder.join("fall.toml"), "version https://git-lfs.github.com/spec/v1\n").unwrap();
    assert_fails(&rebond(&folder, &["run", "fall.toml"]), 2, &["fall.toml: a pointer of Git LFS"]);
}

#[test]
fn the_guard_exits_5_and_keeps_what_was_written() {
    let folder = folder("guard");
    let output = rebond(
        &folder,
        &[
            "run",
            "fall.toml",
            "--quiet",
            "--set",
            "solver.energy_guard=1.0001",
            "--set",
            "time.restitution=1",
            "--set",
            "time.step=1e-3",
        ],
    );
    assert_fails(&output, 5, &["energy", "1.0001"]);
    let summary = std::fs::read_to_string(folder.join("runs/fall/summary.json")).unwrap();
    assert!(summary.contains("past the guard"), "{summary}");
    assert!(std::fs::read_to_string(folder.join("runs/fall/history.csv")).unwrap().lines().count() > 2);
}

#[test]
fn a_closed_pipe_is_no_panic() {
    let folder = folder("pipe");
    let shell = format!("{} check fall.toml | true", env!("CARGO_BIN_EXE_rebond"));
    let output = Command::new("sh").current_dir(&folder).args(["-c", &shell]).output().unwrap();
    assert!(!text(&output.stderr).contains("panicked"), "{}", text(&output.stderr));
}

#[test]
fn the_exact_scheme_lists_its_events() {
    let folder = folder("exact");
    let output =
        rebond(&folder, &["run", "fall.toml", "--set", "time.scheme=exact", "--out", "out", "--verbose"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    assert!(text(&output.stdout).contains("active sets"));
    assert!(text(&output.stdout).contains("support.0.name"), "how to have the force of a support");
    let events = std::fs::read_to_string(folder.join("out/events.csv")).unwrap();
    let mut rows = events.lines();
    assert_eq!(rows.next(), Some("time,node,x,y,kind,velocity,reaction"));
    let summary: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["events"].as_u64(), Some(rows.clone().count() as u64));
    assert!(summary["active_sets"].as_u64() > Some(1) && summary["cached_bytes"].as_u64() > Some(0));
    let first: Vec<&str> = rows.next().unwrap().split(',').collect();
    assert_eq!(first[0].parse::<f64>().ok(), summary["first_impact"]["time"].as_f64());
    assert_eq!(first[4], "closes");
    assert_eq!(first[5].parse::<f64>().ok(), summary["first_impact"]["velocity"].as_f64());
    // A run that follows no events removes the events file of an earlier run.
    let output = rebond(&folder, &["run", "fall.toml", "--out", "out", "--overwrite"]);
    assert!(output.status.success() && !folder.join("out/events.csv").exists());
    let output = rebond(&folder, &["check", "fall.toml", "--set", "time.scheme=exact"]);
    assert!(text(&output.stdout).contains("any: the motion between instants is exact"));
    let said = |arguments: &[&str]| text(&rebond(&folder, arguments).stdout);
    assert!(said(&["check", "fall.toml", "--scene"]).starts_with("title = \"a short fall\"\n"));
}

/// Without a terminal a run reports its progress at each tenth of its steps, which does not depend
/// on a clock.
#[test]
fn a_run_tells_its_progress_without_a_terminal() {
    let folder = folder("progress");
    let said = text(&rebond(&folder, &["run", "fall.toml"]).stderr);
    let shares: Vec<&str> =
        said.lines().filter(|line| line.contains("steps/s")).map(|line| line[..5].trim()).collect();
    assert_eq!(shares, ["10 %", "20 %", "30 %", "40 %", "50 %", "60 %", "70 %", "80 %", "90 %"], "{said}");
    let json = rebond(&folder, &["run", "fall.toml", "--json"]);
    assert!(json.status.success() && json.stderr.is_empty(), "{}", text(&json.stderr));
}

/// A wall is drawn in the phase portraits of the probes that are opposite to it, and in no others.
#[test]
fn phase_portraits_show_the_obstacles_of_their_own_probe() {
    let folder = folder("phase");
    let stop = "obstacle=[{ side = 'below', height = '-0.05*x', where = 'x > 1.1' }]";
    let drawn = |probes: &str| {
        let probes = format!("output.probes={probes}");
        let ran =
            rebond(&folder, &["run", "fall.toml", "--quiet", "--overwrite", "--set", stop, "--set", &probes]);
        command::succeeds(&ran);
        command::succeeds(&rebond(&folder, &["plot", "runs/fall"]));
        let picture = std::fs::read_to_string(folder.join("runs/fall/plots/phase.svg")).unwrap();
        picture.matches("obstacle").count()
    };
    let (tip, middle) = ("{ name = 'tip', at = [1.2, 0.2] }", "{ name = 'middle', at = [0.6, 0.2] }");
    assert_eq!(drawn(&format!("[{middle}]")), 0);
    assert_eq!(drawn(&format!("[{tip}]")), 1);
    assert_eq!(drawn(&format!("[{middle}, {tip}]")), 1);
    let opposite = &command::summary(&folder.join("runs/fall"))["opposite"];
    assert_eq!(opposite, &serde_json::json!({ "middle": [], "tip": [-0.05 * 1.2] }));
}

#[test]
fn a_picture_has_no_panel_without_data() {
    let folder = folder("no-probes");
    for (probes, panels) in [("output.probes=[]", 1), ("output.every=10", 2)] {
        command::succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet", "--overwrite", "--set", probes]));
        let picture = std::fs::read_to_string(folder.join("runs/fall/plots/history.svg")).unwrap();
        assert!(!picture.contains("no data"));
        assert_eq!(picture.contains("deflection"), panels == 2, "{probes}");
    }
}

/// The hard scenes are part of the program and need no repository.
#[test]
fn stability_has_scenes_of_its_own() {
    let folder = folder("stability");
    // The first scene is refused for its unknown key, which shows that the scenes were found.
    assert_fails(&rebond(&folder, &["stability", "--set", "time.stop=1"]), 2, &["time.stop"]);
    let none = rebond(&folder, &["stability", "nowhere.toml"]);
    assert_fails(&none, 4, &["nowhere.toml"]);
}

/// A run may start from the end of another one, with any scheme, step, loads and obstacles.
#[test]
fn a_run_starts_from_another_ones_end() {
    let folder = folder("from");
    let run = |out: &str, settings: &[&str]| {
        let settings: Vec<&str> = settings.iter().flat_map(|set| ["--set", set]).collect();
        let arguments =
            [&["run", "fall.toml", "--quiet", "--overwrite", "--out", out], &settings[..]].concat();
        rebond(&folder, &arguments)
    };
    let rows = |out: &str| command::history(&folder.join(out));
    let exact = "time.scheme=exact";
    command::succeeds(&run("whole", &[exact]));
    command::succeeds(&run("first", &[exact, "time.end=0.03"]));
    command::succeeds(&run("second", &[exact, "time.end=0.05", "initial.from=first"]));
    let (whole, second) = (rows("whole"), rows("second"));
    for row in &second {
        let same = &whole[(row[0] / 10.0) as usize + 30];
        // These columns are the deflection of the tip and the energies.
        for column in [10, 2, 3, 4] {
            let scale = whole[0][if column == 10 { 10 } else { 2 }];
            let (a, b) = (row[column], same[column]);
            assert!((a - b).abs() <= 1e-7 * scale, "t = {}: {a} or {b}", row[1]);
        }
    }
    assert!(second.iter().any(|row| row[6] > 0.0), "it touches");
    let end = rows("first").pop().unwrap();
    for settings in [
        &["time.scheme=newmark", "time.step=5e-5"][..],
        &["time.scheme=midpoint", "time.mass=consistent"],
        &["time.scheme=conserving", "load.pressure='sin(50*t)'", "obstacle.0.height=-0.2"],
    ] {
        command::succeeds(&run("other", &[settings, &["initial.from=first", "time.end=0.01"]].concat()));
        let start = &rows("other")[0];
        assert!((start[10] - end[10]).abs() <= 1e-12, "{settings:?}");
        assert!((start[4] - end[4]).abs() <= 1e-6 * end[4], "{settings:?}: {start:?} {end:?}");
    }
    for (settings, words) in [
        (&["initial.from=nowhere"][..], "initial.from: \"nowhere\" has no end.motion"),
        (&["initial.from=first", "mesh.cells=[5, 2]"], "initial.from: a run on another mesh"),
        (&["initial.from=first", "support.0.kind=guided"], "other supports"),
        (&["initial.from=first", "support.0.motion='1e-3*t^2'"], "supports that move"),
        (&["initial.from=first", "initial.velocity=1"], "contradicts initial.from"),
        (&["initial.from=first", "ball=[{ at = [1, 0.2], mass = 1, height = 1 }]"], "does not record balls"),
    ] {
        assert_fails(&run("wrong", settings), 2, &[words]);
    }
    // A damaged file is refused as a start.
    let file = folder.join("first/end.motion");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[100] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    assert_fails(&run("wrong", &["initial.from=first"]), 2, &["first/end.motion: damaged"]);
}

/// The output of a run grows with the number of rows and of impacts, not with the number of steps.
#[test]
#[ignore = "minutes"]
fn a_million_steps_write_small_files() {
    let folder = folder("million");
    let fall = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig4.toml");
    for scheme in ["newmark", "midpoint", "conserving", "exact"] {
        let scheme = format!("time.scheme={scheme}");
        let settings =
            [&scheme, "time.step=5e-6", "time.end=5", "output.every=1000", "output.checkpoint_every=1000"];
        let mut arguments = vec!["run", fall, "--quiet", "--overwrite", "--out", "long"];
        settings.iter().for_each(|setting| arguments.extend(["--set", setting]));
        let output = rebond(&folder, &arguments);
        assert!(output.status.success(), "{scheme}: {}", text(&output.stderr));
        let history = std::fs::read_to_string(folder.join("long/history.csv")).unwrap();
        assert_eq!(history.lines().count(), 1 + 1001, "{scheme}");
        let files =
            std::fs::read_dir(folder.join("long")).unwrap().map(|entry| entry.unwrap().metadata().unwrap());
        let bytes: u64 = files.filter(|file| file.is_file()).map(|file| file.len()).sum();
        assert!(bytes < 500_000, "{scheme}: {bytes} bytes");
    }
}
