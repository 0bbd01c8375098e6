//! Interruptions lose nothing: a resumed run leaves the files that the undisturbed run would have
//! written, byte for byte.

use crate::common::Random;
use crate::common::command;
use crate::common::command::{assert_fails, rebond, send, succeeds, summary, text};
use crate::common::models::literal;
use rebond::output::checkpoint::Checkpoint;
use rebond::output::run_files::ResumedRun;
use rustix::process::Signal;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};

/// Plate that chatters on an obstacle, with all kinds of output of a run.
const FALL: &str = concat!(
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [4, 2] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.01 }]
initial = { static_pressure = 3000, velocity = -0.5 }
time = { scheme = "newmark", mass = "singular", step = 1e-5, end = 0.2 }
output = { every = 3, fields_every = 2000, checkpoint_every = 700, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

const EXACT: [&str; 4] = ["--set", "time.scheme=exact", "--set", "time.step=2e-5"];

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("interrupted-{test}"), FALL)
}

/// Running command, which is killed if a failed test leaves it behind.
struct Job(Option<Child>);

impl Job {
    fn process(&mut self) -> &mut Child {
        self.0.as_mut().unwrap()
    }

    fn has_ended(&mut self) -> bool {
        self.process().try_wait().unwrap().is_some()
    }

    fn kill(&mut self) {
        self.process().kill().unwrap();
    }

    /// Waits for the end of the command.
    fn output(mut self) -> Output {
        self.0.take().unwrap().wait_with_output().unwrap()
    }
}

impl Drop for Job {
    fn drop(&mut self) {
        if let Some(mut process) = self.0.take() {
            let _ = process.kill();
            let _ = process.wait();
        }
    }
}

/// Starts the command.
fn start(folder: &Path, arguments: &[&str]) -> Job {
    // The tests themselves may run under `nohup`.
    let mut command = Command::new("env");
    command.args(["--default-signal=HUP", env!("CARGO_BIN_EXE_rebond")]);
    let command = command.args(arguments).arg("--quiet").current_dir(folder).stderr(Stdio::piped());
    Job(Some(command.spawn().unwrap()))
}

/// Runs the scene to its end, undisturbed, into `whole`.
fn whole(folder: &Path, overrides: &[&str]) {
    let run = ["run", "fall.toml", "--quiet", "--out", "whole"];
    succeeds(&rebond(folder, &[&run[..], overrides].concat()));
}

/// Returns names and bytes of all output of a run except pictures, and its summary without times.
fn results(run: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for part in [run, &run.join("fields")] {
        for entry in fs::read_dir(part).unwrap() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(run).unwrap().to_str().unwrap().to_owned();
            if path.is_file() && name != "summary.json" {
                found.push((name, fs::read(&path).unwrap()));
            }
        }
    }
    let mut summary = summary(run);
    summary.as_object_mut().unwrap().remove("seconds");
    found.push(("summary.json".into(), summary.to_string().into()));
    found.sort();
    found
}

fn assert_same(folder: &Path, run: &str) {
    let (whole, resumed) = (results(&folder.join("whole")), results(&folder.join(run)));
    assert!(whole.len() > 4);
    let names = |of: &[(String, Vec<u8>)]| of.iter().map(|(name, _)| name.clone()).collect::<Vec<_>>();
    assert_eq!(names(&whole), names(&resumed));
    for ((name, one), (_, other)) in whole.iter().zip(&resumed) {
        assert!(one == other, "{name} is not the same");
    }
}

fn has_checkpoint(run: &Path) -> bool {
    !checkpoints(run).is_empty()
}

/// Returns the progress of a running command: the paths of its checkpoints, and the size of its
/// history.
fn progress(run: &Path) -> (Vec<PathBuf>, u64) {
    (checkpoints(run), fs::metadata(run.join("history.csv")).map_or(0, |history| history.len()))
}

/// Kills a run again and again as it progresses, and resumes it from the files that it left.
///
/// No clock determines the kills, so that a busy machine kills as often. A run is killed once it
/// has progressed, either at once or after some more looks at it, which may be anywhere up to the
/// next checkpoint. One run in five is killed as soon as its files exist.
fn survives_kills(test: &str, overrides: &[&str], kills: usize) {
    let folder = folder(test);
    whole(&folder, overrides);
    let run = [&["run", "fall.toml", "--overwrite", "--out", "killed"], overrides].concat();
    let (resume, killed_run) = (["resume", "killed"], folder.join("killed"));
    let mut random = Random::new(kills as u64);
    let (mut killed, mut resumed) = (0, 0);
    loop {
        let goes_on = has_checkpoint(&killed_run);
        resumed += usize::from(goes_on);
        let before = progress(&killed_run);
        let mut job = start(&folder, if goes_on { &resume } else { &run });
        if killed < kills {
            let is_early = random.unit() < 0.2;
            let gets_on = |now: (Vec<PathBuf>, u64)| {
                if is_early { now.1 != before.1 } else { !now.0.is_empty() && now.0 != before.0 }
            };
            while !gets_on(progress(&killed_run)) && !job.has_ended() {}
            for _ in 0..(200.0 * random.unit().powi(3)) as usize {
                progress(&killed_run);
            }
            job.kill();
        }
        let Output { status, stderr, .. } = job.output();
        killed += usize::from(!status.success());
        if status.success() {
            assert_same(&folder, "killed");
            if killed >= kills {
                break;
            }
        } else {
            assert!(status.code().is_none(), "{status}: {}", text(&stderr));
        }
    }
    // Most kills wait for a checkpoint, and each of these leaves one.
    assert!(2 * resumed > kills, "{resumed} of {killed}");
}

#[test]
fn a_run_survives_twenty_kills() {
    survives_kills("kills", &[], 20);
}

#[test]
#[ignore = "minutes"]
fn runs_of_every_scheme_survive_two_hundred_kills() {
    for scheme in ["newmark", "midpoint", "conserving"] {
        survives_kills(&format!("kills-{scheme}"), &["--set", &format!("time.scheme={scheme}")], 200);
    }
    survives_kills("kills-exact", &EXACT, 200);
}

/// Starts a run, sends a signal once it writes, and waits for its end. A run that ended before is
/// started again, since this test may be delayed on a busy machine.
fn signalled(folder: &Path, signal: Signal, arguments: &[&str]) -> (ExitStatus, String) {
    loop {
        let _ = fs::remove_dir_all(folder.join("run"));
        let mut job = start(folder, arguments);
        while !folder.join("run/history.csv").exists() && !job.has_ended() {}
        send(signal, job.process().id());
        let output = job.output();
        if !output.status.success() {
            return (output.status, text(&output.stderr));
        }
    }
}

#[test]
fn a_signal_finishes_the_step_and_leaves_a_checkpoint() {
    for (signal, overrides) in [(Signal::INT, &[][..]), (Signal::TERM, &EXACT), (Signal::HUP, &[])] {
        let folder = folder(&format!("signal-{}", signal.as_raw()));
        whole(&folder, overrides);
        // The signal also works without periodic checkpoints.
        let run = ["run", "fall.toml", "--out", "run", "--set", "output.checkpoint_every=100000000"];
        let (status, said) = signalled(&folder, signal, &[&run[..], overrides].concat());
        assert_eq!(status.code(), Some(130), "{said}");
        assert!(said.starts_with("rebond: interrupted at step ") && said.lines().count() == 1, "{said}");
        let before = summary(&folder.join("run"));
        assert!(before["status"].as_str().unwrap().starts_with("interrupted at step"), "{before}");
        assert!(
            before["steps"].as_u64().unwrap() < summary(&folder.join("whole"))["steps"].as_u64().unwrap()
        );
        succeeds(&rebond(&folder, &["resume", "run", "--quiet"]));
        assert_eq!(summary(&folder.join("run"))["status"], "done");
        let files = ["history.csv", "contacts.csv", "fields.pvd"];
        for file in files.iter().chain(if overrides.is_empty() { &[][..] } else { &["events.csv"] }) {
            let read = |run: &str| fs::read(folder.join(run).join(file)).unwrap();
            assert!(read("whole") == read("run"), "{file} is not the same");
        }
        assert!(!has_checkpoint(&folder.join("run")));
    }
}

/// Runs until the run is killed after a few checkpoints, and returns its folder.
fn unfinished(folder: &Path) -> PathBuf {
    let run = folder.join("run");
    let mut job = start(folder, &["run", "fall.toml", "--out", "run", "--set", "time.end=1000"]);
    // The run keeps only its last two checkpoints, and may write many while this test is delayed.
    let second = run.join("checkpoint-000000001400.bin");
    while checkpoints(&run).first().is_none_or(|newest| *newest < second) {
        assert!(!job.has_ended(), "it has ended");
    }
    job.kill();
    job.output();
    run
}

/// Returns the paths of a run's checkpoints, the newest first.
fn checkpoints(run: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(run).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut found: Vec<PathBuf> =
        entries.filter(|path| path.extension().is_some_and(|extension| extension == "bin")).collect();
    found.sort();
    found.reverse();
    found
}

#[test]
fn damage_is_never_taken_for_a_checkpoint() {
    let folder = folder("damage");
    let run = unfinished(&folder);
    let [newest, before, ..] = &checkpoints(&run)[..] else { unreachable!("two are kept") };
    let bytes = fs::read(before).unwrap();
    let content = bytes.len() - 4;
    assert!(bytes.starts_with(b"rebond checkpoint, format ") && Checkpoint::from_bytes(&bytes).is_ok());
    for i in 0..bytes.len() {
        assert!(Checkpoint::from_bytes(&bytes[..i]).is_err(), "cut at {i}");
        for mask in [1 << (i % 8), 0xff] {
            let mut flipped = bytes.clone();
            flipped[i] ^= mask;
            assert!(Checkpoint::from_bytes(&flipped).is_err(), "byte {i}");
            // Damaged bytes with a correct check sum are read without a panic.
            let sum = crc32fast::hash(&flipped[..content]);
            flipped[content..].copy_from_slice(&sum.to_le_bytes());
            let _ = Checkpoint::from_bytes(&flipped);
        }
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(Checkpoint::from_bytes(&longer).is_err());

    // The checkpoint before is used.
    fs::write(newest, &bytes[..bytes.len() / 2]).unwrap();
    let (read, damaged) = Checkpoint::newest(&run, false).unwrap();
    assert_eq!((read, damaged.len()), (Checkpoint::from_bytes(&bytes).unwrap(), 1));
    let mut resumed = start(&folder, &["resume", "run"]);
    // The run writes this checkpoint again, and later removes it in favour of newer ones.
    while newest.metadata().is_ok_and(|newest| newest.len() <= bytes.len() as u64 / 2) {
        assert!(!resumed.has_ended(), "it has ended");
    }
    send(Signal::INT, resumed.process().id());
    let said = text(&resumed.output().stderr);
    let name = newest.file_name().unwrap().to_str().unwrap();
    assert!(
        said.contains(&format!("{name}: damaged")) && said.contains("going on from the one before"),
        "{said}"
    );

    // Without checkpoints a run cannot be resumed, and nothing is changed.
    for path in checkpoints(&run) {
        fs::write(path, b"").unwrap();
    }
    let files = results(&run);
    assert_fails(&rebond(&folder, &["resume", "run"]), 4, &["run: no checkpoint to go on from", "damaged"]);
    assert_eq!(results(&run), files);
    fs::remove_dir_all(&run).unwrap();
    assert_fails(
        &rebond(&folder, &["resume", "run"]),
        4,
        &["run: no checkpoint", "not the folder of an unfinished run"],
    );
    fs::create_dir_all(folder.join("runs/fall")).unwrap();
    assert_fails(&rebond(&folder, &["resume", "runs/fal"]), 4, &["unfinished run (did you mean fall?)"]);
}

#[test]
fn a_checkpoint_of_another_version_is_named() {
    let folder = folder("version");
    let run = unfinished(&folder);
    for path in checkpoints(&run) {
        let bytes = fs::read(&path).unwrap();
        let end = bytes.iter().position(|&byte| byte == b'\n').unwrap();
        let mut other = b"rebond checkpoint, format 0, version 0.0.1\n".to_vec();
        other.extend(&bytes[end + 1..bytes.len() - 4]);
        other.extend(crc32fast::hash(&other).to_le_bytes());
        fs::write(path, other).unwrap();
    }
    let output = rebond(&folder, &["resume", "run"]);
    assert_fails(
        &output,
        4,
        &["format 0, version 0.0.1", "this program goes on from", env!("CARGO_PKG_VERSION")],
    );
}

#[test]
fn outputs_that_have_lost_bytes_are_not_gone_on_with() {
    let folder = folder("outputs");
    let run = unfinished(&folder);
    let before = checkpoints(&run);
    fs::write(run.join("history.csv"), "step,time\n").unwrap();
    assert_fails(&rebond(&folder, &["resume", "run"]), 4, &["history.csv: it has 10 bytes, and had "]);
    assert_eq!(checkpoints(&run), before);
}

/// Whatever has changed before the checkpoint is noticed: a digit, a letter, a file that is gone.
#[test]
fn results_before_the_checkpoint_are_those_of_the_run() {
    let folder = folder("changed");
    let run = unfinished(&folder);
    let snapshot = "fields/step-000000000.vtu";
    let refuses = |name: &str, words: &str| {
        let said = ResumedRun::new(run.clone(), None).unwrap_err().to_string();
        assert!(said.contains(&format!("{name}: ")) && said.contains(words), "{said}");
    };
    for name in ["history.csv", "contacts.csv", snapshot] {
        let bytes = fs::read(run.join(name)).unwrap();
        let mut changed = bytes.clone();
        changed[20] ^= 1;
        fs::write(run.join(name), changed).unwrap();
        refuses(name, "bytes are not those that the run wrote before the checkpoint");
        fs::write(run.join(name), bytes).unwrap();
    }
    ResumedRun::new(run.clone(), None).unwrap();
    fs::remove_file(run.join(snapshot)).unwrap();
    refuses(snapshot, "No such file");
    assert_fails(&rebond(&folder, &["resume", "run"]), 4, &[snapshot]);
}

#[test]
fn files_that_a_scene_names_are_found_again_unless_they_changed() {
    let folder = folder("files");
    fs::create_dir_all(folder.join("scenes")).unwrap();
    fs::rename(folder.join("fall.toml"), folder.join("scenes/fall.toml")).unwrap();
    let table = folder.join("scenes/push.csv");
    fs::write(&table, "time,pressure\n0,0\n0.1,-400\n0.2,300\n").unwrap();
    let arguments = [
        "run",
        "scenes/fall.toml",
        "--quiet",
        "--set",
        "load.pressure={ table = 'push.csv', interpolation = 'spline' }",
        "--out",
    ];
    succeeds(&rebond(&folder, &[&arguments[..], &["whole"]].concat()));
    let limited = [&arguments[..], &["run", "--set", "output.fields_every=100000"]].concat();
    assert_fails(&with_little_room(&folder, 300, &limited), 4, &["history.csv: File too large"]);
    let resume = ["resume", "../run", "--quiet"];
    let before = fs::read(&table).unwrap();
    fs::write(&table, "time,pressure\n0,0\n0.1,-401\n0.2,300\n").unwrap();
    assert_fails(
        &rebond(&folder.join("scenes"), &resume),
        4,
        &["../run: ", "has changed since the run began"],
    );
    fs::write(&table, before).unwrap();
    succeeds(&rebond(&folder.join("scenes"), &resume));
    let history = |run: &str| fs::read(folder.join(run).join("history.csv")).unwrap();
    assert!(history("whole") == history("run"));
}

#[test]
fn an_unfinished_run_is_not_overwritten_unasked() {
    let folder = folder("overwrite");
    let run = unfinished(&folder);
    let arguments = ["run", "fall.toml", "--out", "run", "--quiet", "--set", "time.end=1e-3"];
    let files = checkpoints(&run);
    assert_fails(&rebond(&folder, &arguments), 2, &["unfinished run", "`rebond resume run`", "--overwrite"]);
    assert_eq!(checkpoints(&run), files);
    succeeds(&rebond(&folder, &[&arguments[..], &["--overwrite"]].concat()));
    assert!(!has_checkpoint(&run));
    // A finished run of the same scene may be overwritten.
    succeeds(&rebond(&folder, &arguments));
}

#[test]
fn two_runs_never_write_into_one_folder() {
    let folder = folder("claimed");
    let arguments = ["run", "fall.toml", "--out", "run"];
    let mut first = start(&folder, &[&arguments[..], &["--set", "time.end=1000"]].concat());
    while checkpoints(&folder.join("run")).is_empty() {
        assert!(!first.has_ended(), "it has ended");
    }
    let words = format!("run: another run writes here (process {})", first.process().id());
    for second in [&arguments[..], &[&arguments[..], &["--overwrite"]].concat(), &["resume", "run"]] {
        assert_fails(&rebond(&folder, second), 4, &[&words]);
    }
    first.kill();
    first.output();
    assert!(folder.join("run/.lock").exists(), "left behind, and no hindrance");
    assert!(!checkpoints(&folder.join("run")).is_empty());
    succeeds(&rebond(&folder, &[&arguments[..], &["--overwrite", "--quiet"]].concat()));
}

/// Calls the command with a limit on the size of files, in KiB, which acts like a full disk.
fn with_little_room(folder: &Path, kib: usize, arguments: &[&str]) -> std::process::Output {
    // The shell counts in units of half a KiB.
    let script = format!("ulimit -f {}; exec \"$@\"", 2 * kib);
    Command::new("sh")
        .args(["-c", &script, "sh", env!("CARGO_BIN_EXE_rebond")])
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Damped stop, which the plate presses at each of the later ends.
const DAMPED: [&str; 8] = [
    "--set",
    "time.scheme=conserving",
    "--set",
    "time.mass=modal",
    "--set",
    "time.modes=6",
    "--set",
    "obstacle=[{ side = \"below\", height = 0.05, at = [1.2, 0.3], stiffness = 1e4, damping = 20 }]",
];

/// A finished run continues to a later end, and leaves the files of a run to that end.
#[test]
fn a_run_that_is_done_goes_on_to_a_later_end() {
    for (name, overrides) in [("newmark", &[][..]), ("exact", &EXACT), ("damped", &DAMPED)] {
        let folder = folder(&format!("until-{name}"));
        whole(&folder, overrides);
        let run = ["run", "fall.toml", "--quiet", "--out", "run", "--set", "time.end=0.05"];
        succeeds(&rebond(&folder, &[&run[..], overrides].concat()));
        assert_fails(&rebond(&folder, &["resume", "run"]), 4, &["run: the run is done", "--until T"]);
        let until = |end: &str| rebond(&folder, &["resume", "run", "--quiet", "--until", end]);
        assert_fails(&until("0.05"), 2, &["--until 0.05", "to 0.050000000 s", "expected a later end"]);
        assert_fails(&until("0.100001"), 2, &["--until 0.100001: 0.100001 s is no whole number of steps"]);
        assert_fails(&until("soon"), 2, &["--until soon", "an end time in s"]);
        succeeds(&until("0.1"));
        succeeds(&until("0.2"));
        assert_same(&folder, "run");
    }
}

#[test]
fn a_full_disk_loses_nothing() {
    let folder = folder("full");
    whole(&folder, &[]);
    let run = folder.join("run");
    let arguments = ["run", "fall.toml", "--quiet", "--out", "run"];
    // The history grows beyond the limit.
    assert_fails(&with_little_room(&folder, 300, &arguments), 4, &["history.csv: File too large"]);
    let kept = checkpoints(&run);
    assert_eq!(kept.len(), 2);
    // The limit leaves no room for anything.
    assert_fails(&with_little_room(&folder, 1, &["resume", "run", "--quiet"]), 4, &["File too large"]);
    assert_eq!(checkpoints(&run), kept);
    let names = fs::read_dir(&run).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    assert!(names.into_iter().all(|name| !name.ends_with(".tmp")), "no temporary file stays");
    succeeds(&rebond(&folder, &["resume", "run", "--quiet"]));
    assert_same(&folder, "run");

    // The checkpoint is the first file that does not fit.
    let large = ["--set", "mesh.cells=[10, 4]", "--set", "output={ every = 1000, checkpoint_every = 700 }"];
    let output = with_little_room(&folder, 4, &[&arguments[..], &large, &["--overwrite"]].concat());
    assert_fails(&output, 4, &["checkpoint-000000000700.bin: File too large"]);
    assert!(!has_checkpoint(&run));
    // A folder cannot be made below a file.
    assert_fails(&rebond(&folder, &["run", "fall.toml", "--out", "fall.toml/run"]), 4, &["fall.toml"]);
}
