//! Sweeps on PETSc, each run on a group of ranks.

use crate::common::command::{self, assert_fails, on, rebond, succeeds, text};
use crate::common::models::literal;
use std::fs;
use std::path::{Path, PathBuf};

/// Driven plate over a stop at its end.
const SCENE: &str = concat!(
    literal!(PAPER_PLATE),
    literal!(CLAMPED),
    r#"
title = "a driven plate"
parameters = { p = 100.0 }
mesh = { element = "fvs", cells = [8, 3] }
obstacle = [{ side = "below", height = -0.002, where = "x > 1.1" }]
load = { pressure = "p*sin(2*pi*5*t)" }
damping = { mass = 5.0 }
time = { scheme = "newmark", mass = "singular", step = 2e-3, end = 1 }
output = { probes = [{ name = "tip", at = [1.2, 0.2] }] }
sweep = { over = ["p=100..800:5"], period = 0.2, periods = 4, settle = 2 }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("ranked-sweep-{test}"), SCENE)
}

/// Returns the entries of a sweep's table, each list of numbers as one entry per number.
fn table(folder: &Path, name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(folder.join(name).join("sweep.csv")).unwrap();
    text.lines().map(|line| line.split([',', ';']).map(String::from).collect()).collect()
}

/// Asserts that two tables have the same words, and numbers that differ by less than a share of
/// them, or of some number.
fn assert_agree(folder: &Path, one: &str, other: &str, [share, of]: [f64; 2]) {
    let (one, other) = (table(folder, one), table(folder, other));
    assert_eq!(one.len(), other.len());
    for (a, b) in one.iter().zip(&other) {
        assert_eq!(a.len(), b.len(), "{a:?} {b:?}");
        for (a, b) in a.iter().zip(b) {
            match (a.parse::<f64>(), b.parse::<f64>()) {
                (Ok(a), Ok(b)) => assert!((a - b).abs() <= share * a.abs().max(of), "{a} {b}"),
                _ => assert_eq!(a, b),
            }
        }
    }
}

/// Groups of ranks share the runs, on their own or each from the end of the one before, and their
/// numbers are those of the native engine.
#[test]
fn groups_of_ranks_share_the_runs() {
    let folder = folder("groups");
    succeeds(&rebond(&folder, &["sweep", "fall.toml", "--out", "native"]));
    let said = succeeds(&on(&folder, 4, &["sweep", "fall.toml", "--out", "pairs", "--ranks-per-run", "2"]));
    assert!(said.contains("5 runs, 0 failed"), "{said}");
    assert_agree(&folder, "native", "pairs", [1e-8, 1e-3]);
    succeeds(&on(&folder, 2, &["sweep", "fall.toml", "--out", "all"]));
    assert_agree(&folder, "native", "all", [1e-8, 1e-3]);
    let compare = |name: &str, more: &[&str], within: [f64; 2]| {
        let ranked = format!("{name}-on-ranks");
        let sweep = |out| [&["sweep", "fall.toml", "--out", out], more].concat();
        succeeds(&rebond(&folder, &sweep(name)));
        succeeds(&on(&folder, 2, &[&sweep(&ranked)[..], &["--ranks-per-run", "1"]].concat()));
        assert_agree(&folder, name, &ranked, within);
    };
    compare("carried", &["--up-and-down"], [1e-8, 1e-3]);
    // The exponent, in 1/s, is that of a distance which begins at 1e-7 of the motion.
    compare("exponents", &["--lyapunov", "--over", "p=100,800"], [1e-4, 1.0]);
}

/// A sweep that ended in between goes on with the rows of all groups, but for one that a kill cut
/// off; a run that fails is a row.
#[test]
fn a_sweep_on_ranks_goes_on() {
    let folder = folder("goes-on");
    let sweep = [
        "sweep",
        "fall.toml",
        "--out",
        "cut",
        "--ranks-per-run",
        "1",
        "--over",
        "plate.width=0.4,-1,0.5,0.6",
    ];
    let said = on(&folder, 2, &sweep);
    assert!(text(&said.stderr).contains("failed at -1: "), "{}", text(&said.stderr));
    assert!(succeeds(&said).contains("4 runs, 1 failed"));
    let whole = table(&folder, "cut");
    let rows = fs::read_to_string(folder.join("cut/rows.jsonl")).unwrap();
    let lines: Vec<&str> = rows.lines().collect();
    let known = |line: &str| line.replace("\"max\":0", "\"max\":7");
    fs::write(folder.join("cut/rows.jsonl"), format!("{}\n", lines[0])).unwrap();
    let part = format!("{}\n{}\n{}", lines[0], known(lines[1]), &lines[2][..9]);
    fs::write(folder.join("cut/rows-1.jsonl"), part).unwrap();
    succeeds(&on(&folder, 2, &sweep));
    let again = table(&folder, "cut");
    assert_eq!(again.len(), whole.len());
    // The row that was known is not made again: its changed number is still there.
    assert!(again[1].iter().any(|entry| entry.starts_with("7.")), "{again:?}");
    assert_eq!(again[2..], whole[2..]);
    assert!(!folder.join("cut/rows-1.jsonl").exists());
}

#[test]
fn what_groups_of_ranks_cannot_do_is_said() {
    let folder = folder("refused");
    let refused = |ranks: usize, more: &[&str], words: &[&str]| {
        assert_fails(&on(&folder, ranks, &[&["sweep", "fall.toml"], more].concat()), 2, words);
    };
    refused(3, &["--ranks-per-run", "2"], &["--ranks-per-run 2", "the number of ranks, 3"]);
    refused(2, &["--jobs", "2"], &["--jobs", "expected --ranks-per-run"]);
    refused(2, &["--engine", "native"], &["the native engine runs in one process"]);
    refused(2, &["--ranks-per-run", "1", "--", "-ksp_tpye", "cg"], &["-ksp_tpye", "did you mean"]);
    assert!(!folder.join("sweeps/fall/sweep.csv").exists());
}
