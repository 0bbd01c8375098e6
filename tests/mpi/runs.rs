//! The command under mpirun: the numbers equal those of one process, one rank reports, and an error
//! ends all ranks.

use crate::common::command;
use crate::common::command::{
    assert_agree, assert_fails, comparison, history, mpirun, mpirun_program, on, rebond, send, succeeds,
    summary, text,
};
use crate::common::models::literal;
use rustix::process::Signal;
use std::path::{Path, PathBuf};
use std::process::{Output, Stdio};
use std::time::Duration;

/// The paper's plate on a coarse mesh, bent down by its own pressure and pushed further onto an
/// obstacle just below it, which it touches at once.
const PUSHED: &str = concat!(
    "title = \"a short push\"\n",
    literal!(PAPER_PUSH),
    r#"
mesh = { element = "fvs", cells = [4, 2] }
obstacle = [{ side = "below", height = -0.211 }]
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.01 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "inside", at = [0.7, 0.15] }] }
"#
);

/// The paper's scenes with each element.
const FVS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig2.toml");
const HCT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig1.toml");

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("mpirun-{test}"), PUSHED)
}

/// Runs natively in one process, and returns its history.
fn run_native(folder: &Path, arguments: &[&str]) -> Vec<Vec<f64>> {
    let arguments =
        [&["run"], arguments, &["--quiet", "--overwrite", "--engine", "native", "--out", "native"]].concat();
    succeeds(&rebond(folder, &arguments));
    history(&folder.join("native"))
}

/// Returns whether a node is in contact in some row.
fn touches(history: &[Vec<f64>]) -> bool {
    history.iter().any(|row| row[6] > 0.0)
}

/// Runs on some ranks, and returns the history.
fn run_on(folder: &Path, ranks: usize, arguments: &[&str]) -> Vec<Vec<f64>> {
    let out = format!("on-{ranks}");
    let arguments =
        [&["run"], arguments, &["--quiet", "--overwrite", "--engine", "petsc", "--out", &out]].concat();
    succeeds(&on(folder, ranks, &arguments));
    history(&folder.join(out))
}

/// Asserts that the numbers on some ranks equal those of the native engine.
fn assert_same_on(folder: &Path, ranks: usize, arguments: &[&str]) {
    assert_agree(
        &run_on(folder, ranks, arguments),
        &run_native(folder, arguments),
        &format!("{ranks} ranks"),
    );
}

/// Asserts the agreement up to the second impact, past 0.06 s.
fn any_number_of_ranks(test: &str, scene: &str) {
    let folder = folder(test);
    let arguments = [scene, "--set", "time.step=1e-4", "--set", "time.end=0.063", "--set", "output.every=5"];
    let native = run_native(&folder, &arguments);
    assert!(touches(&native));
    for ranks in [2, 3, 5] {
        assert_agree(&run_on(&folder, ranks, &arguments), &native, &format!("{ranks} ranks"));
    }
}

#[test]
fn quadrilaterals_move_the_same_on_any_number_of_ranks() {
    any_number_of_ranks("fvs", FVS);
}

#[test]
fn triangles_move_the_same_on_any_number_of_ranks() {
    any_number_of_ranks("hct", HCT);
}

#[test]
fn the_energy_is_kept_on_any_number_of_ranks() {
    let folder = folder("conserving");
    for (ranks, element) in [(2, "mesh.element=fvs"), (2, "mesh.element=hct"), (3, "mesh.element=hct")] {
        let arguments =
            ["fall.toml", "--set", "time.scheme=conserving", "--set", "time.step=1e-3", "--set", element];
        let rows = run_on(&folder, ranks, &[&arguments[..], &["--set", "output.every=1"]].concat());
        assert!(touches(&rows));
        for row in &rows {
            assert!((row[2] / rows[0][2] - 1.0).abs() <= 1e-9, "t = {}: {} J", row[1], row[2]);
        }
        let summary = summary(&folder.join(format!("on-{ranks}")));
        assert!(summary["relaxation"]["relaxed_steps"].as_u64().unwrap() > 0, "{summary}");
    }
}

/// Scenes of the modal mass: the fall to the first impacts, everything that moves or changes in
/// time with damping, and a plate with attachments above a tilted obstacle.
const MODAL_FALL: &str = concat!(
    literal!(PAPER_FALL),
    r#"
mesh = { element = "fvs", cells = [10, 4] }
time = { scheme = "conserving", mass = "modal", modes = 50, step = 2e-5, end = 0.063 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);
const MODAL_SHAKEN: &str = concat!(
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "hct", cells = [8, 3] }
support = [{ edge = "left", kind = "clamped", motion = "0.002*sin(80*t)" }]
obstacle = [{ side = "below", height = "-0.1 + 0.02*sin(60*t)" }]
initial = { static_pressure = 14600 }
load = { pressure = "1000*sin(75*t)*(1+x*t)" }
damping = { mass = 2, modal = [0.02, 0.01] }
time = { scheme = "conserving", mass = "modal", modes = 40, step = 5e-5, end = 0.07 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);
const MODAL_FREE: &str = concat!(
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [8, 4] }
obstacle = [{ side = "below", height = "-0.01 - 0.02*x" }]
initial = { velocity = "-1 + 0.3*y" }
load = { pressure = -2000 }
mass = [{ at = [0.31, 0.12], mass = 2 }]
spring = [{ at = [1.0, 0.2], stiffness = 1e4 }]
foundation = [{ stiffness = 1e5, where = "x > 0.5" }]
ball = [{ at = [0.7, 0.2], mass = 1, height = 0.05, velocity = -2 }]
time = { scheme = "conserving", mass = "modal", modes = 30, step = 2e-5, end = 0.02 }
output = { every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

#[test]
fn the_modal_mass_moves_the_same_on_any_number_of_ranks() {
    for (name, scene, ranks, keeps_energy) in [
        ("fall", MODAL_FALL, &[1, 3][..], true),
        ("shaken", MODAL_SHAKEN, &[2], false),
        ("free", MODAL_FREE, &[3], true),
    ] {
        let folder = command::folder(&format!("mpirun-modal-{name}"), scene);
        let native = run_native(&folder, &["fall.toml"]);
        assert!(touches(&native));
        let expected = summary(&folder.join("native"));
        for &ranks in ranks {
            let rows = run_on(&folder, ranks, &["fall.toml"]);
            assert_agree(&rows, &native, &format!("{name}, {ranks} ranks"));
            for (row, other) in rows.iter().zip(&native) {
                assert!((row[10] - other[10]).abs() <= 1e-9, "{name}: {} or {} m", row[10], other[10]);
                let change = (row[2] / rows[0][2] - 1.0).abs();
                assert!(!keeps_energy || change <= 1e-11, "{name}, t = {}: {change:e}", row[1]);
            }
            let found = summary(&folder.join(format!("on-{ranks}")));
            for key in ["most_contact_nodes", "contact_steps", "node_contacts", "factorisations"] {
                assert_eq!(found[key], expected[key], "{name}, {ranks} ranks: {key}");
            }
        }
    }
}

#[test]
fn the_modal_mass_refuses_contact_solvers_of_petsc() {
    let folder = command::folder("mpirun-modal-vi", MODAL_FALL);
    let output = on(&folder, 2, &["run", "fall.toml", "--engine", "petsc", "--vi", "tao"]);
    assert_fails(&output, 2, &["time.mass = \"modal\"", "not by \"tao\"", "expected \"condensed\""]);
}

/// The modes of another number of ranks have other signs, and the rigid motions mix.
#[test]
fn the_modal_mass_goes_on_with_the_modes_of_any_number_of_ranks() {
    let scene = MODAL_FREE.replace("spring =", "# spring =").replace("foundation =", "# foundation =");
    let folder = command::folder("mpirun-modal-resumed", &scene);
    let run = |out: &str, end: &str| {
        let run = ["run", "fall.toml", "--quiet", "--engine", "petsc", "--out", out, "--set", end];
        succeeds(&on(&folder, 2, &run));
    };
    run("whole", "time.end=0.016");
    let whole = history(&folder.join("whole"));
    for (ranks, out) in [(2, "same"), (1, "fewer"), (3, "more")] {
        run(out, "time.end=0.011");
        assert!(touches(&history(&folder.join(out))));
        succeeds(&on(&folder, ranks, &["resume", out, "--until", "0.016", "--quiet"]));
        let resumed = history(&folder.join(out));
        assert_agree(&resumed, &whole, &format!("{ranks} ranks"));
        for row in &resumed {
            let change = (row[2] / resumed[0][2] - 1.0).abs();
            assert!(change <= 1e-11, "{ranks} ranks, t = {}: {change:e}", row[1]);
        }
    }
    for file in ["history.csv", "contacts.csv"] {
        let read = |run: &str| std::fs::read(folder.join(run).join(file)).unwrap();
        assert!(read("same") == read("whole"), "{file}");
    }
}

#[test]
fn one_rank_twice_writes_the_same_bytes() {
    let folder = folder("twice");
    let bytes = || {
        run_on(&folder, 1, &["fall.toml"]);
        std::fs::read(folder.join("on-1/history.csv")).unwrap()
    };
    assert_eq!(bytes(), bytes());
}

#[test]
fn rank_0_speaks_and_writes_alone() {
    let folder = folder("voice");
    // A scene that names no engine runs on PETSc where there are several processes.
    let said = succeeds(&on(&folder, 2, &["run", "fall.toml"]));
    for words in ["a short push", "engine: petsc, 2 ranks", "effects:", "first impact", "rebond report"] {
        assert_eq!(said.matches(words).count(), 1, "{words:?} in:\n{said}");
    }
    let native = run_native(&folder, &["fall.toml"]);
    assert!(touches(&native));
    assert_agree(&history(&folder.join("runs/fall")), &native, "2 ranks");
    let summary = command::summary(&folder.join("runs/fall"));
    assert_eq!((&summary["status"], &summary["dofs"]), (&"done".into(), &36.into()));
}

/// An interface too large for each rank goes to MUMPS, and eight ranks are no different from two.
#[test]
fn large_interfaces_and_many_ranks_move_the_same() {
    let folder = folder("interface");
    let finer = ["fall.toml", "--set", "mesh.cells=[10, 4]"];
    assert_same_on(&folder, 8, &finer);
    let limit = ["--", "-rebond_interface_entries", "0"];
    let run = ["run", "fall.toml", "--engine", "petsc", "--overwrite", "--out", "limited"];
    let said = succeeds(&on(&folder, 3, &[&run[..], &finer[1..], &limit].concat()));
    assert!(said.contains("first impact"), "{said}");
    let native = run_native(&folder, &finer);
    assert!(touches(&native));
    assert_agree(&history(&folder.join("limited")), &native, "MUMPS on 3 ranks");
    let wrong = on(&folder, 2, &[&run[..], &["--", "-rebond_interface_entries", "few"]].concat());
    assert_fails(&wrong, 2, &["-rebond_interface_entries few", "expected a whole number"]);
}

#[test]
fn some_ranks_may_have_nothing() {
    let folder = folder("nothing");
    for cells in ["mesh.cells=[1, 1]", "mesh.cells=[2, 1]"] {
        for element in ["mesh.element=fvs", "mesh.element=hct"] {
            let arguments = ["fall.toml", "--set", cells, "--set", element];
            assert_same_on(&folder, 4, &arguments);
        }
    }
    let free = ["fall.toml", "--set", "obstacle=[]"];
    assert_same_on(&folder, 4, &free);
}

#[test]
fn meshes_refined_in_parallel_move_the_same() {
    let folder = folder("refined");
    for element in ["mesh.element=fvs", "mesh.element=hct"] {
        let arguments = ["fall.toml", "--set", "mesh.refine=1", "--set", element];
        assert_same_on(&folder, 2, &arguments);
    }
}

#[test]
fn compare_measures_the_difference_on_any_number_of_ranks() {
    let folder = folder("compare");
    for ranks in [1, 2, 4] {
        let arguments = ["compare", "fall.toml", "--with", "native,petsc", "--json"];
        let output = on(&folder, ranks, &arguments);
        succeeds(&output);
        let value = comparison(&output);
        assert_eq!(value["ranks"], ranks);
        for entry in value["entries"].as_array().unwrap() {
            assert_eq!((&entry["steps"], &entry["failure"]), (&100.into(), &serde_json::Value::Null));
            assert!(entry["difference"].as_f64().unwrap() < 1e-12, "{entry}");
            assert_eq!(
                entry["difference_up_to_impact"].as_array().unwrap().len(),
                value["impacts"].as_array().unwrap().len()
            );
            assert!(entry["worst_kkt"].as_f64().unwrap() < 1e-10, "{entry}");
        }
    }
    // A contender that fails has a row with the reason, and the final error names it.
    let arguments = ["compare", "fall.toml", "--with", "native,petsc", "--", "-pc_type", "nosuch"];
    let output = on(&folder, 2, &arguments);
    let reason = "PCSetType(): Unable to find requested PC type nosuch";
    assert_fails(&output, 3, &["1 of 2", "petsc (", reason]);
    assert!(text(&output.stdout).contains(reason), "{}", text(&output.stdout));
}

#[test]
fn what_all_ranks_find_wrong_is_said_once() {
    let folder = folder("wrong");
    let run = |ranks, arguments: &[&str]| {
        on(&folder, ranks, &[&["run", "fall.toml", "--overwrite"], arguments].concat())
    };
    let nothing_holds = ["--set", "support=[]", "--set", "obstacle=[]"];
    assert_fails(&run(2, &["--set", "plate.thickness=-1"]), 2, &["plate.thickness", "greater than 0"]);
    assert_fails(&run(4, &nothing_holds), 2, &["static_pressure", "mechanism"]);
    assert_fails(&run(2, &["--engine", "native"]), 2, &["one process", "--engine petsc"]);
    assert_fails(&run(2, &["--", "-pc_typ", "lu"]), 2, &["`-pc_typ`", "did you mean `-pc_type`?"]);
    assert_fails(&run(4, &["--", "-pc_type", "nosuch"]), 3, &["PCSetType()", "nosuch"]);
    assert_fails(&run(2, &["--set", "solver.tolerance=1e-18"]), 3, &["KKT", "1.0e-18"]);
    for repeated in [&["check", "fall.toml"][..], &["schema"]] {
        assert_fails(&on(&folder, 2, repeated), 2, &[repeated[0], "one process"]);
    }
    let wrong = on(&folder, 2, &["run"]);
    assert_eq!(
        (wrong.status.code(), text(&wrong.stderr).matches("see rebond run --help").count()),
        (Some(2), 1)
    );
    for (asked, words) in [("--version", "features:"), ("--help", "Exit codes:")] {
        let told = on(&folder, 2, &[asked]);
        assert_eq!((told.status.code(), text(&told.stdout).matches(words).count()), (Some(0), 1));
    }
    // Ranks with different work would compute parts of different plates, or wait without end.
    std::fs::write(folder.join("light.toml"), PUSHED.replace("7770", "3885")).unwrap();
    for (other, part) in [("run light.toml", "scene"), ("run fall.toml --quiet", "command line")] {
        assert_fails(&beside(&folder, other, "."), 2, &["rank 1", part, "rank 0"]);
    }
    assert_fails(&beside(&folder, "--help", "."), 2, &["rank 1", "scene", "rank 0"]);
    // Only rank 0 writes, so only rank 0 can fail to write.
    assert_fails(&run(2, &["--out", "fall.toml/run"]), 4, &["fall.toml"]);
}

/// Scenes of the same text mean other plates where their table or their mesh differs.
#[test]
fn ranks_with_other_files_are_refused() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let cells = "mesh = { element = \"fvs\", cells = [4, 2] }";
    let shaken = "pressure = { table = \"other.csv\", interpolation = \"linear\" }";
    for (file, scene, from, [old, new], part) in [
        ("other.csv", PUSHED.replace("pressure = -1e5", shaken), "pulse.csv", ["0.01,1", "0.01,2"], "scene"),
        (
            "other.msh",
            PUSHED.replace(cells, "mesh.file = \"other.msh\"").replace("length = 1.2, width = 0.4, ", ""),
            "hard/one-node-joint.msh",
            ["6 2 2 0", "6 2 3 0"],
            "mesh file",
        ),
    ] {
        let folder = command::folder(&format!("mpirun-{file}"), &scene);
        std::fs::create_dir(folder.join("elsewhere")).unwrap();
        std::fs::copy(folder.join("fall.toml"), folder.join("elsewhere/fall.toml")).unwrap();
        let text = std::fs::read_to_string(data.join(from)).unwrap();
        assert!(text.contains(old), "{text}");
        std::fs::write(folder.join(file), &text).unwrap();
        std::fs::write(folder.join("elsewhere").join(file), text.replace(old, new)).unwrap();
        assert_fails(&beside(&folder, "run fall.toml", "elsewhere"), 2, &["rank 1", part, "rank 0"]);
    }
}

/// Calls the command on two ranks, of which the second is given other words in another folder.
///
/// A shell tells the ranks apart: the mpirun of Debian 13 crashes at a colon between two programs.
fn beside(folder: &Path, other: &str, place: &str) -> Output {
    let choice = "if [ \"$OMPI_COMM_WORLD_RANK\" = 1 ]; then cd \"$3\"; shift; fi; exec \"$0\" $1";
    let program = env!("CARGO_BIN_EXE_rebond");
    mpirun_program(folder, 2, "sh")
        .args(["-c", choice, program, "run fall.toml", other, place])
        .env("OMPI_MCA_odls_base_sigkill_timeout", "0")
        .output()
        .unwrap()
}

#[test]
fn a_killed_rank_ends_all() {
    let folder = folder("killed");
    let mut job =
        mpirun(&folder, 2, &["run", "fall.toml", "--quiet", "--set", "time.end=1000"]).spawn().unwrap();
    // The rows of the history are buffered; the existence of the file shows that the run has begun.
    while !folder.join("runs/fall/history.csv").exists() {
        assert!(job.try_wait().unwrap().is_none(), "it has ended");
        std::thread::sleep(PAUSE);
    }
    let ranks = children(job.id());
    assert_eq!(ranks.len(), 2);
    send(Signal::KILL, ranks[1]);
    // The run is far from its end, and the time limit of the launcher ends one that hangs.
    assert!(!job.wait().unwrap().success());
    while runs(ranks[0]) {
        std::thread::sleep(PAUSE);
    }
}

/// Interval at which a running job is observed.
const PAUSE: Duration = Duration::from_millis(1);

/// Starts a job, asks its ranks to stop once it has written the checkpoint of a step, and returns
/// its output. A job that ended before it received the signal is started again, since this test may
/// be delayed on a busy machine.
fn stopped(
    folder: &Path,
    ranks: usize,
    arguments: &[&str],
    run: &str,
    checkpoint: &str,
) -> std::process::Output {
    loop {
        let _ = std::fs::remove_dir_all(folder.join(run));
        let mut job = mpirun(folder, ranks, arguments);
        let mut job = job.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
        while !folder.join(run).join(checkpoint).exists() && job.try_wait().unwrap().is_none() {
            std::thread::sleep(PAUSE);
        }
        // One rank is asked, and informs the others.
        if let Some(&rank) = children(job.id()).last() {
            send(Signal::TERM, rank);
        }
        let output = job.wait_with_output().unwrap();
        if !output.status.success() {
            return output;
        }
    }
}

/// Copies a folder with all that it holds.
fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let (path, copy) = entry.map(|entry| (entry.path(), to.join(entry.file_name()))).unwrap();
        if path.is_dir() {
            copy_folder(&path, &copy);
        } else {
            std::fs::copy(path, copy).unwrap();
        }
    }
}

fn goes_on(cases: &[(usize, &str)]) {
    for &(ranks, scheme) in cases {
        let folder = folder(&format!("resumed-{ranks}-{scheme}"));
        let scheme = format!("time.scheme={scheme}");
        let run = |out| {
            let run = ["run", "fall.toml", "--quiet", "--engine", "petsc", "--out", out, "--set", &scheme];
            let output = [
                "--set",
                "output={ every = 7, fields_every = 200, checkpoint_every = 21, extremes = true, \
                probes = [{ name = 'corner', at = [1.2, 0.0] }, { name = 'inside', at = [0.7, 0.15] }] }",
            ];
            [&run[..], &output, &["--set", "time.end=0.03"]].concat()
        };
        succeeds(&on(&folder, ranks, &run("whole")));
        let whole = history(&folder.join("whole"));
        assert!(touches(&whole));
        let output = stopped(&folder, ranks, &run("same"), "same", "checkpoint-000000000042.bin");
        assert_fails(&output, 130, &["interrupted at step"]);
        for copy in ["fewer", "more"] {
            copy_folder(&folder.join("same"), &folder.join(copy));
        }
        succeeds(&on(&folder, ranks, &["resume", "same", "--quiet"]));
        let mut files = vec!["history.csv".to_owned(), "contacts.csv".into(), "fields.pvd".into()];
        files.extend((0..ranks).map(|rank| format!("fields/step-000000300-{rank}.vtu")));
        files.extend((0..ranks).map(|rank| format!("fields/extremes-{rank}.vtu")));
        for file in files {
            let read = |run: &str| std::fs::read(folder.join(run).join(&file)).unwrap();
            assert!(read("same") == read("whole"), "{ranks} ranks, {scheme}: {file}");
        }
        let peak = |run: &str| summary(&folder.join(run))["extremes"]["von_mises"].clone();
        assert_eq!(peak("same"), peak("whole"));
        for (run, ranks) in [("fewer", ranks - 1), ("more", ranks + 1)] {
            succeeds(&on(&folder, ranks, &["resume", run, "--quiet"]));
            assert_agree(&history(&folder.join(run)), &whole, &format!("{scheme} on {ranks} ranks"));
            let (one, other) = (peak("whole"), peak(run));
            let [a, b] = [&one, &other].map(|of| of["value"].as_f64().unwrap());
            assert!(a > 0.0 && (a - b).abs() <= 1e-7 * a, "{scheme} on {ranks} ranks: {one}, {other}");
            assert_eq!(one["time"], other["time"], "{scheme} on {ranks} ranks");
        }
    }
}

#[test]
fn interrupted_ranks_go_on_to_the_same_bytes_and_others_to_the_same_numbers() {
    goes_on(&[(2, "newmark"), (2, "conserving")]);
}

#[test]
#[ignore = "two more, a minute"]
fn three_ranks_and_the_midpoint_scheme_go_on() {
    goes_on(&[(3, "newmark"), (2, "midpoint")]);
}

#[test]
fn petscs_contact_solvers_go_on_to_the_same_bytes() {
    let folder = folder("resumed-vi");
    for vi in ["snes", "tao"] {
        let run = |out| {
            let run = ["run", "fall.toml", "--quiet", "--engine", "petsc", "--vi", vi, "--out", out];
            [&run[..], &["--set", "output.checkpoint_every=20", "--set", "time.end=0.05"]].concat()
        };
        let (whole, part) = (format!("{vi}-whole"), format!("{vi}-part"));
        succeeds(&on(&folder, 1, &run(&whole)));
        assert!(touches(&history(&folder.join(&whole))));
        let output = stopped(&folder, 1, &run(&part), &part, "checkpoint-000000000020.bin");
        assert_fails(&output, 130, &["interrupted at step"]);
        succeeds(&on(&folder, 1, &["resume", &part, "--quiet"]));
        let read = |run: &str| std::fs::read(folder.join(run).join("history.csv")).unwrap();
        assert!(read(&whole) == read(&part), "{vi}");
    }
}

/// Two ranks start from the end of a run on one, and one starts from the end of a run on two.
#[test]
fn a_start_from_another_run_holds_on_any_number_of_ranks() {
    let folder = folder("from");
    let run = |ranks: usize, out: &str, from: &str| {
        let from = format!("initial={{ {from} }}");
        let arguments =
            ["run", "fall.toml", "--quiet", "--out", out, "--set", &from, "--set", "time.end=0.02"];
        succeeds(&on(&folder, ranks, &arguments));
    };
    run(1, "one", "static_pressure = 3000, velocity = '-0.5*x^2'");
    run(1, "one-one", "from = 'one'");
    run(2, "one-two", "from = 'one'");
    run(2, "two", "static_pressure = 3000, velocity = '-0.5*x^2'");
    run(1, "two-one", "from = 'two'");
    let whole = history(&folder.join("one-one"));
    for other in ["one-two", "two-one"] {
        assert_agree(&history(&folder.join(other)), &whole, other);
    }
    // A run that finished on two ranks continues to a later end on one.
    let resumed = on(&folder, 1, &["resume", "two", "--quiet", "--until", "0.03"]);
    succeeds(&resumed);
    let start = "initial={ static_pressure = 3000, velocity = '-0.5*x^2' }";
    let long = ["run", "fall.toml", "--quiet", "--out", "long", "--set", start, "--set", "time.end=0.03"];
    succeeds(&on(&folder, 1, &long));
    assert_agree(&history(&folder.join("two")), &history(&folder.join("long")), "until");
}

/// Returns state and parent of a process.
fn state(process: u32) -> Option<(String, u32)> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    // State and parent follow the name in parentheses.
    let mut words = stat.rsplit(')').next()?.split_whitespace();
    Some((words.next()?.into(), words.next()?.parse().ok()?))
}

/// Returns whether a process exists and is not a zombie.
fn runs(process: u32) -> bool {
    state(process).is_some_and(|(state, _)| state != "Z" && state != "X")
}

/// Returns the processes that a process started.
fn children(parent: u32) -> Vec<u32> {
    let is_child = |&process: &u32| state(process).is_some_and(|(_, of)| of == parent);
    let all = std::fs::read_dir("/proc").unwrap();
    let mut found: Vec<u32> =
        all.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok()).filter(is_child).collect();
    found.sort_unstable();
    found
}
