//! The built command, called as a user calls it: in a folder of its own, in one process or under
//! mpirun.

use rustix::io::Errno;
use rustix::process::{Pid, Signal, kill_process};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Mutex, PoisonError};

/// Makes an empty folder for a test and writes the scene `fall.toml` into it.
pub fn folder(test: &str, scene: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(test);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("fall.toml"), scene).unwrap();
    folder
}

/// Calls the command in one process.
pub fn rebond(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(arguments)
        .env_remove("PETSC_OPTIONS")
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Options of mpirun that start ranks on one machine with any release. There may be more ranks than
/// cores, waiting ranks yield their cores, and messages go through memory. Without a network Open
/// MPI 5 complains otherwise, and the search for one takes Open MPI 4 a second per job.
pub const ON_ONE_MACHINE: &str =
    "--oversubscribe --mca mpi_yield_when_idle 1 --mca pml ob1 --mca btl ^tcp,ofi";

/// Returns the command under mpirun, which root may call too, as in a container. Its time limit
/// allows for a busy machine that takes minutes for seconds of work.
pub fn mpirun(folder: &Path, ranks: usize, arguments: &[&str]) -> Command {
    let mut command = mpirun_program(folder, ranks, env!("CARGO_BIN_EXE_rebond"));
    command.args(arguments);
    command
}

/// Returns the command that starts any program under mpirun.
pub fn mpirun_program(folder: &Path, ranks: usize, program: &str) -> Command {
    let mut command = Command::new("mpirun");
    command
        .args(ON_ONE_MACHINE.split(' '))
        .args(["--timeout", "2700", "-n"])
        .arg(ranks.to_string())
        .arg(program)
        .env("OMPI_ALLOW_RUN_AS_ROOT", "1")
        .env("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")
        .env_remove("PETSC_OPTIONS")
        .current_dir(folder);
    command
}

/// Held by the job that runs. Ranks wait for each other, and two jobs at once, each with the cores
/// that the other waits for, take up to three times as long as in turns.
static TURN: Mutex<()> = Mutex::new(());

/// Calls the command on several ranks, one job of a test program after the other.
///
/// Where one rank exits with an error, Open MPI asks the others to end, and waits a second or two
/// before it kills them. They have nothing left to do, so that it does not wait here.
pub fn on(folder: &Path, ranks: usize, arguments: &[&str]) -> Output {
    let _turn = TURN.lock().unwrap_or_else(PoisonError::into_inner);
    mpirun(folder, ranks, arguments).env("OMPI_MCA_odls_base_sigkill_timeout", "0").output().unwrap()
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Sends a signal to a process, unless it has ended.
///
/// No program `kill` is called: a bare system has none.
pub fn send(signal: Signal, process: u32) {
    let process = i32::try_from(process).ok().and_then(Pid::from_raw).unwrap();
    assert!(matches!(kill_process(process, signal), Ok(()) | Err(Errno::SRCH)));
}

/// Asserts success and returns the standard output.
pub fn succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// Asserts an exit code and a message of one line that contains some words. Where mpirun adds its
/// own lines, the message is the line that begins with the command's name.
pub fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{}{said}", text(&output.stdout));
    let ours: Vec<&str> = said.lines().filter(|line| line.starts_with("rebond: ")).collect();
    assert_eq!(ours.len(), 1, "{said}");
    for word in words {
        assert!(ours[0].contains(word), "no {word:?} in: {said}");
    }
    assert!(!said.contains("panicked"), "{said}");
}

/// Returns the rows of a run's history.
pub fn history(run: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(run.join("history.csv")).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(|number| number.parse().unwrap()).collect()).collect()
}

/// Returns a run's summary.
pub fn summary(run: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(run.join("summary.json")).unwrap()).unwrap()
}

/// Returns the JSON output of a comparison.
pub fn comparison(output: &Output) -> serde_json::Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Asserts that two histories agree: deflections (from column 10 on) to 1e-8 m and energies to 1e-8
/// of the initial energy.
pub fn assert_agree(one: &[Vec<f64>], other: &[Vec<f64>], name: &str) {
    assert_eq!(one.len(), other.len(), "{name}");
    for (a, b) in one.iter().zip(other) {
        assert_eq!((a[0], a[1], a[6]), (b[0], b[1], b[6]), "{name}: step, time, nodes in contact");
        assert!((a[2] - b[2]).abs() <= 1e-8 * one[0][2].abs(), "{name}: energy {} or {}", a[2], b[2]);
        for (a, b) in a[10..].iter().zip(&b[10..]) {
            assert!((a - b).abs() <= 1e-8, "{name}: {a} or {b} m");
        }
    }
}
