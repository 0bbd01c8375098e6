//! `rebond sweep` as a user calls it: files, messages, interruptions, jobs, pictures.

use crate::common::command::{self, assert_fails, rebond, send, succeeds, text};
use crate::common::models::literal;
use rustix::process::Signal;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

/// Driven plate over a floor that it meets under the larger loads.
pub const SCENE: &str = concat!(
    literal!(PAPER_PLATE),
    literal!(CLAMPED),
    r#"
title = "a driven plate"
parameters = { a = 100.0, gap = 5e-3 }
mesh = { element = "fvs", cells = [2, 1] }
obstacle = [{ side = "below", height = "-gap" }]
load = { pressure = "a*sin(2*pi*5*t)" }
damping = { mass = 8.0 }
time = { scheme = "newmark", mass = "singular", step = 1e-3, end = 1.0 }
output = { probes = [{ name = "corner", at = [1.2, 0.0] }] }
sweep = { over = ["a=50..350:4"], period = 0.2, periods = 12, settle = 8 }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("sweep-{test}"), SCENE)
}

fn table(folder: &Path, name: &str) -> String {
    fs::read_to_string(folder.join(name).join("sweep.csv")).unwrap()
}

#[test]
fn a_sweep_writes_its_table_its_report_and_its_pictures() {
    let folder = folder("files");
    let said = succeeds(&rebond(&folder, &["sweep", "fall.toml", "--up-and-down"]));
    assert!(said.contains("8 runs, 0 failed") && said.contains("sweeps/fall/sweep.csv"), "{said}");
    let rows = table(&folder, "sweeps/fall");
    let mut lines = rows.lines();
    let head = "a,direction,corner_section,corner_max,corner_min,corner_rms,corner_amplitude,corner_phase,period,lyapunov,\
                peak_force,impulse,impacts,impact_velocity,work,loss,failure";
    assert_eq!(lines.next(), Some(head));
    let starts: Vec<String> =
        lines.map(|line| line.split(',').take(2).collect::<Vec<_>>().join(",")).collect();
    let up = ["50.0,up", "150.0,up", "250.0,up", "350.0,up"];
    let down = ["350.0,down", "250.0,down", "150.0,down", "50.0,down"];
    assert_eq!(starts, [up, down].concat());
    let report: Value =
        serde_json::from_slice(&fs::read(folder.join("sweeps/fall/sweep.json")).unwrap()).unwrap();
    let of = |row: usize, name: &str| report["rows"][row]["measures"][name].as_f64().unwrap();
    // The smallest load does not reach the floor, the largest does.
    assert_eq!((of(0, "impacts"), of(0, "peak_force")), (0.0, 0.0));
    assert!(of(3, "impacts") >= 1.0 && of(3, "peak_force") > 0.0 && of(3, "impact_velocity") > 0.0);
    assert!(of(3, "impulse") > 0.0);
    assert_eq!(report["rows"][0]["measures"]["probes"][0]["section"].as_array().unwrap().len(), 4);
    let plots = folder.join("sweeps/fall/plots");
    let drawn = fs::read_to_string(plots.join("bifurcation.svg")).unwrap();
    assert!(drawn.contains("a driven plate"));
    fs::remove_dir_all(&plots).unwrap();
    let said = succeeds(&rebond(&folder, &["plot", "sweeps/fall"]));
    assert!(said.contains("bifurcation.svg") && said.contains("response.svg"), "{said}");
    assert!(plots.join("response.png").exists() && !folder.join("sweeps/fall/state-0.bin").exists());
    // Crosses say where a motion does not repeat.
    let repeats = |row: usize| !report["rows"][row]["measures"]["period"].is_null();
    let drawn = fs::read_to_string(plots.join("response.svg")).unwrap();
    assert_eq!(drawn.contains("does not repeat"), !(0..8).all(repeats));
}

/// Tension shifts the resonance, and a sweep over it passes through zero.
#[test]
fn a_sweep_over_a_tension_has_the_rows_of_its_runs() {
    let folder = folder("tension");
    let amplitudes = |out: &str, over: &str, set: &str| -> Vec<f64> {
        let arguments = ["sweep", "fall.toml", "--quiet", "--out", out, "--over", over, "--set", set];
        succeeds(&rebond(&folder, &arguments));
        let amplitude = |line: &str| line.split(',').nth(6).unwrap().parse().unwrap();
        table(&folder, out).lines().skip(1).map(amplitude).collect()
    };
    let swept = amplitudes("swept", "in_plane.tension.xx=-500,0,500", "parameters.a=50");
    for (amplitude, tension) in swept.iter().zip(["-500", "0", "500"]) {
        let alone =
            amplitudes(&format!("alone{tension}"), "a=50,51", &format!("in_plane.tension.xx={tension}"))[0];
        assert!((amplitude / alone - 1.0).abs() <= 1e-9, "{tension}: {amplitude}, {alone}");
    }
    let bent = amplitudes("bent", "a=50,51", "parameters.gap=5e-3")[0];
    assert!((swept[1] / bent - 1.0).abs() <= 1e-9, "{}, {bent}", swept[1]);
    assert!(swept[0] > 1.01 * bent && swept[2] < 0.99 * bent, "{swept:?}");
}

/// Rows, bits and all, depend neither on the number of threads nor on the order of the values.
#[test]
fn results_are_the_same_with_any_jobs_and_order() {
    let folder = folder("jobs");
    let sweep = |out: &str, more: &[&str]| {
        let fixed = ["sweep", "fall.toml", "--quiet", "--out", out, "--over", "gap=4e-3,6e-3"];
        succeeds(&rebond(&folder, &[&fixed[..], more].concat()));
        table(&folder, out)
    };
    let one = sweep("one", &["--over", "a=50..350:4"]);
    assert_eq!(one.lines().count(), 9);
    assert_eq!(sweep("three", &["--over", "a=50..350:4", "--jobs", "3"]), one);
    let sorted = |text: &str| {
        let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
        lines.sort();
        lines
    };
    let other = sweep("other", &["--over", "a=350,50,250,150", "--jobs", "2"]);
    assert_eq!(sorted(&other), sorted(&one));
    assert!(folder.join("one/plots/map.png").exists());
    let map = fs::read_to_string(folder.join("one/plots/map.svg")).unwrap();
    assert!(map.contains("does not repeat"), "crosses at runs without a period, such as at a = 350");
    // Rows of carried runs are apart from each other too.
    let up = sweep("up", &["--over", "a=50..350:4", "--up"]);
    assert_eq!(sweep("ups", &["--over", "a=50..350:4", "--up", "--jobs", "2"]), up);
    assert_ne!(up, one);
}

/// A sweep that is killed goes on with the runs that are missing, also those that carry the state
/// of the run before, and ends with the same table.
#[test]
fn a_killed_sweep_goes_on() {
    let folder = folder("killed");
    let sweep =
        |out: &'static str| ["sweep", "fall.toml", "--quiet", "--out", out, "--up", "--over", "a=50..350:12"];
    succeeds(&rebond(&folder, &sweep("whole")));
    let mut job = Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(sweep("cut"))
        .current_dir(&folder)
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let known = || fs::read_to_string(folder.join("cut/rows.jsonl")).map_or(0, |text| text.lines().count());
    while known() < 3 && job.try_wait().unwrap().is_none() {
        sleep(Duration::from_millis(2));
    }
    job.kill().unwrap();
    job.wait().unwrap();
    // A line that the kill cut off does not count.
    let rows = fs::read_to_string(folder.join("cut/rows.jsonl")).unwrap();
    fs::write(folder.join("cut/rows.jsonl"), rows + "{\"index\":9").unwrap();
    succeeds(&rebond(&folder, &sweep("cut")));
    assert_eq!(table(&folder, "cut"), table(&folder, "whole"));
}

/// A sweep that is asked to stop says how to go on, and leaves the table of the runs that are done.
/// It has so many runs that it cannot end before, however busy the machine is.
#[cfg(unix)]
#[test]
fn a_stopped_sweep_says_how_to_go_on() {
    let folder = folder("stopped");
    let arguments = ["sweep", "fall.toml", "--quiet", "--over", "a=50..350:200000", "--periods", "12"];
    let mut job = Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(arguments)
        .current_dir(&folder)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let rows = folder.join("sweeps/fall/rows.jsonl");
    let known = || fs::read_to_string(&rows).map_or(0, |text| text.lines().count());
    while known() < 2 && job.try_wait().unwrap().is_none() {
        sleep(Duration::from_millis(2));
    }
    send(Signal::INT, job.id());
    assert_fails(&job.wait_with_output().unwrap(), 130, &["interrupted: ", "of 200000 runs", "goes on"]);
    assert_eq!(table(&folder, "sweeps/fall").lines().count(), known());
}

#[test]
fn a_folder_belongs_to_one_sweep() {
    let folder = folder("owner");
    let sweep = |more: &[&str]| rebond(&folder, &[&["sweep", "fall.toml", "--quiet"], more].concat());
    succeeds(&sweep(&[]));
    let before = table(&folder, "sweeps/fall");
    assert_fails(&sweep(&["--periods", "13"]), 2, &["another scene, or with other values", "--overwrite"]);
    assert_eq!(table(&folder, "sweeps/fall"), before);
    succeeds(&sweep(&["--periods", "13", "--overwrite"]));
    assert_ne!(table(&folder, "sweeps/fall"), before);
    fs::write(folder.join("sweeps/fall/letter.txt"), "mine").unwrap();
    assert_fails(&sweep(&["--overwrite"]), 2, &["letter.txt", "which no sweep writes"]);
}

/// A value that no run can have is a row that says why; a key that does not exist ends the sweep.
#[test]
fn a_failed_run_is_a_row() {
    let folder = folder("failed");
    let sweep = |over: &str| rebond(&folder, &["sweep", "fall.toml", "--out", over, "--over", over]);
    let output = sweep("plate.width=0.4,-1,0.5");
    succeeds(&output);
    assert!(text(&output.stderr).contains("failed at -1: "), "{}", text(&output.stderr));
    let rows = table(&folder, "plate.width=0.4,-1,0.5");
    let failed = rows.lines().nth(2).unwrap();
    assert!(failed.starts_with("-1.0,-,,,,") && failed.contains("-1 is not positive"), "{failed}");
    assert!(rows.lines().nth(3).unwrap().ends_with(','), "{rows}");
    assert_fails(&sweep("plate.widht=1,2"), 2, &["plate.widht", "did you mean width?"]);
    assert_fails(&sweep("b=1,2"), 2, &["sweep.over.0", "neither a parameter nor a key"]);
}

#[test]
fn what_a_sweep_cannot_do_is_said() {
    let folder = folder("refused");
    fs::write(folder.join("plain.toml"), SCENE.split("sweep =").next().unwrap()).unwrap();
    assert_fails(&rebond(&folder, &["sweep", "plain.toml"]), 2, &["plain.toml", "no [sweep]", "--over"]);
    let over = ["sweep", "plain.toml", "--over", "a=1,2"];
    assert_fails(&rebond(&folder, &over), 2, &["sweep.period: missing"]);
    let native = ["sweep", "fall.toml", "--ranks-per-run", "2"];
    assert_fails(&rebond(&folder, &native), 2, &["--ranks-per-run", "need --engine petsc"]);
    let ranks = Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(["sweep", "fall.toml", "--engine", "native"])
        .env("OMPI_COMM_WORLD_SIZE", "2")
        .current_dir(&folder)
        .output()
        .unwrap();
    assert_fails(&ranks, 2, &["the native engine runs in one process", "mpirun started 2"]);
}

/// Three keys give all combinations of their values, the first one fastest, each with the row of a
/// sweep over fewer keys.
#[test]
fn many_keys_give_all_combinations() {
    let folder = folder("many");
    let sweep = |out: &str, over: &[&str]| {
        let mut arguments = vec!["sweep", "fall.toml", "--quiet", "--out", out];
        over.iter().for_each(|over| arguments.extend(["--over", over]));
        succeeds(&rebond(&folder, &arguments));
        table(&folder, out)
    };
    let three = sweep("three", &["a=50,350", "gap=4e-3,6e-3", "damping.mass=8,9"]);
    let starts: Vec<String> =
        three.lines().skip(1).map(|line| line.split(',').take(3).collect::<Vec<_>>().join(",")).collect();
    let pairs = ["50.0,0.004", "350.0,0.004", "50.0,0.006", "350.0,0.006"];
    let combinations = ["8.0", "9.0"].map(|mass| pairs.map(|pair| format!("{pair},{mass}")));
    assert_eq!(starts, combinations.concat());
    let two = sweep("two", &["a=50,350", "gap=4e-3,6e-3"]);
    let without_mass = three.lines().skip(1).take(4).map(|line| line.replacen(",8.0,-", ",-", 1));
    assert_eq!(two.lines().skip(1).collect::<Vec<_>>(), without_mass.collect::<Vec<_>>());
    assert!(
        folder.join("three/plots/parallel.png").exists() && !folder.join("two/plots/parallel.png").exists()
    );
}

/// `rebond check` tells the number of runs and their time, by the first periods of some of them.
#[test]
fn check_tells_the_cost_of_a_sweep() {
    const CHAOS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery/chaos.toml");
    let folder = folder("cost");
    let said = succeeds(&rebond(&folder, &["check", CHAOS]));
    assert!(said.contains("  sweep        161 runs of 200 periods, "), "{said}");
    let told: Value = serde_json::from_str(&succeeds(&rebond(&folder, &["check", CHAOS, "--json"]))).unwrap();
    assert!(told["sweep"]["expected_seconds"].as_f64().unwrap() > 0.0, "{told}");
}
