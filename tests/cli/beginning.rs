//! The first steps: a new scene, the help, completions, manual pages, the schema, the version.

use crate::common::command::{self, assert_fails, rebond, succeeds, text};
use crate::gallery::{Run, assert_near};
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};
#[cfg(feature = "petsc")]
use std::process::Command;

const KINDS: [&str; 9] = ["plate", "gmsh", "shaker", "stop", "ball", "modal", "measured", "disc", "free"];

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("beginning-{test}"), "")
}

/// Every kind runs as it is, within the limits of its scene, and meets its obstacle if it has one.
#[test]
fn every_new_scene_runs_unchanged() {
    let folder = folder("runs");
    std::thread::scope(|scope| {
        for kind in KINDS {
            let folder = &folder;
            scope.spawn(move || {
                let said = succeeds(&rebond(folder, &["new", kind]));
                assert!(said.contains(&format!("rebond run {kind}.toml")), "{said}");
                let scene = fs::read_to_string(folder.join(format!("{kind}.toml"))).unwrap();
                let comments = scene.lines().filter(|line| line.contains("# ")).count();
                assert!(comments > 10, "{kind}: {comments} comments");
                if kind == "stop" {
                    // The key that a comment offers is taken by the scheme and the mass.
                    let damped = scene.replace("# damping", "damping");
                    fs::write(folder.join("damped.toml"), &damped).unwrap();
                    succeeds(&rebond(
                        folder,
                        &["run", "damped.toml", "--set", "time.end=0.06", "--no-cache"],
                    ));
                    assert_ne!(damped, scene);
                }
                let output = rebond(folder, &["run", &format!("{kind}.toml"), "--no-cache"]);
                succeeds(&output);
                assert!(!text(&output.stderr).contains("warning"), "{kind}: {}", text(&output.stderr));
                let summary = command::summary(&folder.join("runs").join(kind));
                assert_eq!(summary["status"], "done", "{kind}");
                let first_impact = summary["first_impact"]["time"].as_f64();
                assert!(
                    if kind == "free" { first_impact.is_none() } else { first_impact > Some(0.0) },
                    "{kind}"
                );
                assert!(summary["worst_kkt"].as_f64() < Some(1e-10), "{kind}");
            });
        }
    });
}

/// Clamped round plate under a uniform pressure: the centre starts at q a^4 / (64 D).
#[test]
fn the_new_disc_starts_from_the_deflection_of_theory() {
    let folder = folder("disc");
    succeeds(&rebond(&folder, &["new", "disc"]));
    succeeds(&rebond(&folder, &["run", "disc.toml", "--set", "time.end=1e-4", "--no-cache"]));
    let stiffness = 210e9 * 1e-3_f64.powi(3) / (12.0 * (1.0 - 0.3 * 0.3));
    let centre = 150.0 * 0.2_f64.powi(4) / (64.0 * stiffness);
    let run = Run::read(&folder.join("runs/disc"));
    assert_near(run.at(0.0, "centre"), centre, 0.02);
}

/// Simply supported plate let go from a uniform pressure: Navier's series, every mode of which
/// decays with its ratio.
#[test]
fn the_new_free_plate_rings_as_naviers_series() {
    let folder = folder("free");
    succeeds(&rebond(&folder, &["new", "free"]));
    // Two periods of the first mode.
    succeeds(&rebond(&folder, &["run", "free.toml", "--set", "time.end=0.0236", "--no-cache"]));
    let (a, b, thickness, density, ratio) = (0.4_f64, 0.3_f64, 2e-3_f64, 2700.0, 0.01_f64);
    let stiffness = 70e9 * thickness.powi(3) / (12.0 * (1.0 - 0.33 * 0.33));
    let centre = |time: f64| -> f64 {
        let odd = || (1..40).step_by(2).map(f64::from);
        let term = |m: f64, n: f64| {
            let waves = PI * PI * ((m / a).powi(2) + (n / b).powi(2));
            let amplitude = 16.0 * 500.0 / (PI * PI * m * n * stiffness * waves * waves);
            let omega = waves * (stiffness / (density * thickness)).sqrt();
            let damped = omega * (1.0 - ratio * ratio).sqrt();
            let sign = (m * PI / 2.0).sin() * (n * PI / 2.0).sin();
            let swing = (damped * time).cos() + ratio * omega / damped * (damped * time).sin();
            sign * amplitude * (-ratio * omega * time).exp() * swing
        };
        odd().flat_map(|m| odd().map(move |n| term(m, n))).sum()
    };
    let run = Run::read(&folder.join("runs/free"));
    let largest = centre(0.0);
    for (time, w) in run.column("time").into_iter().zip(run.column("centre")) {
        let expected = centre(time);
        assert!((w - expected).abs() < 0.04 * largest, "{time} s: {w} m, not {expected} m");
    }
}

#[test]
fn the_help_lists_every_kind() {
    let help = succeeds(&rebond(&folder("kinds"), &["new", "--help"]));
    for kind in KINDS {
        assert!(help.contains(&format!("- {kind}:")), "{kind}: {help}");
    }
}

#[test]
fn nothing_is_overwritten_unasked() {
    let folder = folder("overwrite");
    let new = |arguments: &[&str]| rebond(&folder, &[&["new"], arguments].concat());
    fs::write(folder.join("plate.toml"), "mine").unwrap();
    assert_fails(&new(&[]), 2, &["plate.toml is there already", "--out", "--overwrite"]);
    assert_eq!(fs::read_to_string(folder.join("plate.toml")).unwrap(), "mine");
    // A file beside the scene counts too, and nothing of the scene is written then.
    fs::write(folder.join("bracket.msh"), "mine").unwrap();
    assert_fails(&new(&["gmsh"]), 2, &["bracket.msh is there already"]);
    assert!(!folder.join("gmsh.toml").exists());
    assert_fails(&new(&["--out", ".."]), 2, &["..", "names no file"]);

    succeeds(&new(&["--overwrite"]));
    assert!(fs::read_to_string(folder.join("plate.toml")).unwrap().contains("[plate]"));
    succeeds(&new(&["--out", "rig/first.toml"]));
    let own = fs::read_to_string(folder.join("rig/first.toml")).unwrap();
    assert!(
        own.contains("rebond run first.toml") && own.contains("runs/first") && !own.contains("plate.toml")
    );
    assert_fails(&new(&["--out", "plate.toml/first.toml"]), 4, &["plate.toml"]);
    assert_eq!(new(&["spaceship"]).status.code(), Some(2));
}

#[test]
fn the_version_names_the_engines() {
    let folder = folder("version");
    let said = succeeds(&rebond(&folder, &["--version"]));
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], concat!("rebond ", env!("CARGO_PKG_VERSION")));
    if cfg!(feature = "petsc") {
        assert_eq!(lines[1..3], ["features: petsc", "engines: native, petsc"]);
        let number = lines[3].strip_prefix("PETSc ").unwrap();
        assert_eq!(number.split('.').filter(|part| part.parse::<u32>().is_ok()).count(), 3, "{said}");
        assert!(lines[4].contains("MPI") || lines[4].contains("MPICH"), "{said}");
    } else {
        assert_eq!(lines[2], "engines: native");
    }
    assert_eq!(lines.len(), if cfg!(feature = "petsc") { 5 } else { 3 });
    let short = succeeds(&rebond(&folder, &["-V"]));
    assert_eq!(short, concat!("rebond ", env!("CARGO_PKG_VERSION"), "\n"));
}

/// A run of the native engine does not need PETSc; whoever asks for it hears what is missing.
#[cfg(feature = "petsc")]
#[test]
fn petsc_is_loaded_where_it_is_needed() {
    let folder = folder("library");
    succeeds(&rebond(&folder, &["new", "plate"]));
    let with = |library: &str, arguments: &[&str]| {
        Command::new(env!("CARGO_BIN_EXE_rebond"))
            .args(arguments)
            .env("REBOND_PETSC_LIBRARY", library)
            .current_dir(&folder)
            .output()
            .unwrap()
    };
    let run = ["run", "plate.toml", "--set", "time.end=1e-4", "--overwrite"];
    let on_petsc = [&run[..], &["--engine", "petsc"]].concat();
    succeeds(&with("/nowhere/libpetsc.so", &run));
    let words = ["PETSc", "/nowhere/libpetsc.so", "install", "REBOND_PETSC_LIBRARY"];
    assert_fails(&with("/nowhere/libpetsc.so", &on_petsc), 3, &words);
    assert_fails(&with("libm.so.6", &on_petsc), 3, &["libm.so.6", "undefined symbol"]);
    let version = succeeds(&with("/nowhere/libpetsc.so", &["--version"]));
    assert!(version.lines().nth(3).unwrap().contains("cannot be loaded"), "{version}");
    // Nothing in the variable is as no variable.
    succeeds(&with("", &on_petsc));
}

/// Citation and change log speak of the version that the program has.
#[test]
fn the_version_is_the_same_everywhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let read = |name: &str| fs::read_to_string(root.join(name)).unwrap();
    let version = env!("CARGO_PKG_VERSION");
    assert!(read("CITATION.cff").lines().any(|line| line == format!("version: {version}")));
    let log = read("CHANGELOG.md");
    let newest = log.lines().find_map(|line| line.strip_prefix("## ")).unwrap();
    assert_eq!(newest.split([',', ' ']).next(), Some(version));
}

/// Bash takes the completions, and they know commands and options.
#[test]
fn completions_are_scripts() {
    let folder = folder("completions");
    for shell in ["bash", "zsh", "fish"] {
        let script = succeeds(&rebond(&folder, &["completions", shell]));
        for word in ["rebond", "sweep", "inspect", "overwrite"] {
            assert!(script.contains(word), "{shell}: {word}");
        }
        fs::write(folder.join(shell), script).unwrap();
    }
    let complete = "source ./bash && COMP_WORDS=(rebond sw) COMP_CWORD=1 && _rebond rebond sw rebond && echo ${COMPREPLY[@]}";
    let bash = std::process::Command::new("bash").current_dir(&folder).args(["-c", complete]).output();
    assert_eq!(succeeds(&bash.unwrap()), "sweep\n");
    assert_eq!(rebond(&folder, &["completions", "dos"]).status.code(), Some(2));
}

#[test]
fn every_command_has_a_manual_page() {
    let folder = folder("man");
    let said = succeeds(&rebond(&folder, &["man", "--out", "pages"]));
    let pages: Vec<&str> = said.lines().collect();
    assert!(pages.contains(&"pages/rebond.1") && pages.contains(&"pages/rebond-sweep.1"), "{said}");
    let help = succeeds(&rebond(&folder, &["--help"]));
    let commands =
        help.lines().skip_while(|line| *line != "Commands:").skip(1).take_while(|line| !line.is_empty());
    let names = commands.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let count = names.filter(|line| line.split_whitespace().next() != Some("help")).count();
    assert_eq!(pages.len(), count + 1, "{said}{help}");
    for page in pages {
        let text = fs::read_to_string(folder.join(page)).unwrap();
        assert!(text.contains(".TH rebond") && text.contains(".SH SYNOPSIS"), "{page}: {text}");
    }
    let page = succeeds(&rebond(&folder, &["man", "run"]));
    assert_eq!(page, fs::read_to_string(folder.join("pages/rebond-run.1")).unwrap());
    assert!(page.contains("rebond run plate.toml"), "{page}");
    assert_fails(&rebond(&folder, &["man", "rum"]), 2, &["\"rum\"", "did you mean", "run"]);
}

#[test]
fn the_schema_is_printed_as_it_is_kept() {
    let printed = succeeds(&rebond(&folder("schema"), &["schema"]));
    let kept = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/scene.schema.json");
    assert_eq!(printed, fs::read_to_string(kept).unwrap());
}
