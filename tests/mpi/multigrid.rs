//! Geometric multigrid: its answers are those of factors, in as many iterations on every mesh.

use crate::common::command;
use crate::common::command::{
    assert_agree, assert_fails, comparison, history, on, rebond, succeeds, summary,
};
use crate::common::models::literal;
use std::path::{Path, PathBuf};

/// The paper's plate in free flight.
const FLIGHT: &str = concat!(
    "title = \"a flight\"\n",
    literal!(PAPER_PUSH),
    r#"
mesh = { element = "fvs", cells = [20, 8] }
solver = { engine = "petsc", linear = "multigrid" }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 3e-4 }
"#
);

/// A plate that is thrown flat onto an obstacle 1 mm below it, so that nearly all nodes touch.
const THROWN: &str = concat!(
    "title = \"a plate thrown flat\"\n",
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [20, 8] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = -0.001 }]
initial = { velocity = -5 }
load = { pressure = -2e5 }
solver = { engine = "petsc", linear = "multigrid" }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 1e-3 }
output = { every = 1, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

/// A plate that is thrown onto an uneven obstacle close below it. The area of contact changes by
/// hundreds of nodes from step to step, and holes open in it.
const UNEVEN: &str = concat!(
    "title = \"a plate thrown onto an uneven obstacle\"\n",
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [40, 16] }
support = [{ edge = "left", kind = "clamped" }]
obstacle = [{ side = "below", height = "-2e-4 - 1e-4*cos(7*x)*cos(11*y)" }]
initial = { velocity = "-x^2*(1 + 0.3*sin(9*y))" }
solver = { engine = "petsc", linear = "multigrid" }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 1e-3 }
output = { every = 1, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

/// A plate on a simply supported edge, an elastic one and a column, with a point mass, a falling
/// ball and a compliant stop.
const FURNISHED: &str = concat!(
    "title = \"a furnished plate\"\n",
    literal!(PAPER_PLATE),
    r#"
mesh = { element = "fvs", cells = [20, 8] }
support = [
    { edge = "left", kind = "simply_supported" },
    { edge = "top", kind = "elastic", stiffness = 1e6 },
    { at = [0.9, 0.2], kind = "simply_supported" },
]
obstacle = [{ side = "below", height = -0.001, at = [1.2, 0.0], stiffness = 1e6 }]
mass = [{ at = [0.6, 0.2], mass = 2.0 }]
ball = [{ at = [0.55, 0.15], mass = 0.1, height = 0.0005, velocity = -1.0 }]
load = { pressure = -2e3 }
solver = { engine = "petsc", linear = "multigrid" }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 5e-3 }
output = { every = 5, probes = [{ name = "corner", at = [1.2, 0.0] }, { name = "inside", at = [0.7, 0.15] }] }
"#
);

/// The paper's scenes with each element.
const FVS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig2.toml");
const HCT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/csma2013/fig1.toml");

fn folder(test: &str, scene: &str) -> PathBuf {
    command::folder(&format!("multigrid-{test}"), scene)
}

/// Runs the scene on some ranks, and returns the mean and largest number of iterations.
fn iterations(folder: &Path, ranks: usize, settings: &[&str]) -> (f64, u64) {
    let set = settings.iter().flat_map(|setting| ["--set", setting]);
    let arguments: Vec<&str> =
        ["run", "fall.toml", "--quiet", "--overwrite", "--out", "run"].into_iter().chain(set).collect();
    succeeds(&on(folder, ranks, &arguments));
    let linear = &summary(&folder.join("run"))["linear"];
    assert_eq!(linear["method"], "multigrid", "{linear}");
    (linear["iterations_mean"].as_f64().unwrap(), linear["iterations_max"].as_u64().unwrap())
}

/// Theory: the condition number of a symmetric V-cycle does not depend on the mesh. The limits are
/// the counts measured, for a reduction of the error by 1e-14.
#[test]
fn a_solve_takes_as_many_iterations_on_every_mesh() {
    let folder = folder("counts", FLIGHT);
    for (element, limit) in [("fvs", 15), ("hct", 22)] {
        for mass in ["singular", "consistent"] {
            for (step, spread) in [("1e-3", 1.25), ("1e-4", 1.25), ("1e-5", 1.5)] {
                let count = |cells: &str| {
                    let end = format!("time.end={}", 3.0 * step.parse::<f64>().unwrap());
                    let settings = [
                        &format!("mesh.element={element}"),
                        &format!("time.mass={mass}"),
                        &format!("time.step={step}"),
                        &end,
                        &format!("mesh.cells={cells}"),
                    ];
                    iterations(&folder, 1, &settings.map(String::as_str))
                };
                let counts = ["[20, 8]", "[40, 16]", "[80, 32]"].map(count);
                let means = counts.map(|(mean, _)| mean);
                let least = means.into_iter().fold(f64::INFINITY, f64::min);
                let most = means.into_iter().fold(0.0, f64::max);
                assert!(most < spread * least, "{element} {mass} {step}: {counts:?}");
                assert!(counts.iter().all(|(_, most)| *most <= limit), "{element} {mass} {step}: {counts:?}");
            }
        }
    }
}

#[test]
fn more_ranks_take_as_many_iterations() {
    let folder = folder("ranks", FLIGHT);
    let of_one = iterations(&folder, 1, &["mesh.cells=[40, 16]"]);
    for ranks in [2, 4] {
        let (mean, _) = iterations(&folder, ranks, &["mesh.cells=[40, 16]"]);
        assert!((mean - of_one.0).abs() < 3.0, "{ranks} ranks: {mean}, {of_one:?}");
    }
}

/// Sweeps of each rank over its own rows overshoot where ranks meet, the more so with triangles:
/// undamped ones gave up on six ranks.
#[test]
fn sweeps_of_many_ranks_do_not_overshoot() {
    let folder = folder("many", FLIGHT);
    let settings = ["mesh.element=hct", "mesh.cells=[40, 16]"];
    let of_one = iterations(&folder, 1, &settings);
    let (mean, _) = iterations(&folder, 6, &settings);
    assert!((mean - of_one.0).abs() < 6.0, "{mean}, {of_one:?}");
}

/// Asserts that the scene moves as on the native engine, at every step.
fn assert_native(folder: &Path, ranks: usize, scene: &str, settings: &[&str]) {
    let set = settings.iter().flat_map(|setting| ["--set", setting]);
    let arguments: Vec<&str> =
        ["compare", scene, "--with", "native,petsc", "--json"].into_iter().chain(set).collect();
    let output = on(folder, ranks, &arguments);
    succeeds(&output);
    let value = comparison(&output);
    for entry in value["entries"].as_array().unwrap() {
        assert_eq!(entry["failure"], serde_json::Value::Null, "{entry}");
        assert!(entry["difference"].as_f64().unwrap() < 1e-8, "{entry}");
        assert!(entry["worst_kkt"].as_f64().unwrap() < 1e-11, "{entry}");
    }
}

/// Tension along and pressure across, half of what buckles the plate.
#[test]
fn multigrid_moves_a_plate_under_tension_as_factors_do() {
    let folder = folder("tension", THROWN);
    for (ranks, element) in [(1, "mesh.element=hct"), (2, "mesh.element=fvs")] {
        let tension = ["in_plane.tension.xx=2e5", "in_plane.tension.xy='1e4*x'", "in_plane.tension.yy=-2e4"];
        assert_native(&folder, ranks, "fall.toml", &[&[element], &tension[..]].concat());
    }
}

/// The mid-plane stretches by multigrid too, be it held or free in its plane.
#[test]
fn multigrid_stretches_a_plate_as_factors_do() {
    let folder = folder("stretching", THROWN);
    for (ranks, element, hold) in [(1, "hct", "free"), (2, "fvs", "held"), (2, "hct", "normal")] {
        let element = format!("mesh.element={element}");
        let hold = format!("support.0.in_plane={hold}");
        let settings = [&element, &hold, "in_plane.stretching=true", "load.pressure=-2e6"];
        assert_native(&folder, ranks, "fall.toml", &settings);
    }
}

/// The problem in the plane takes as many iterations on every mesh.
#[test]
fn solves_in_the_plane_take_as_many_iterations_on_every_mesh() {
    let folder = folder("in-plane", THROWN);
    for (ranks, element, limit) in [(1, "fvs", 14), (1, "hct", 19), (2, "fvs", 19)] {
        let counts = ["[20, 8]", "[40, 16]", "[80, 32]"].map(|cells| {
            let set = [
                &format!("mesh.element={element}"),
                &format!("mesh.cells={cells}"),
                "in_plane.stretching=true",
                "time.end=2e-4",
            ];
            let run = ["run", "fall.toml", "--overwrite", "--out", "run"];
            let set = set.into_iter().flat_map(|setting| ["--set", setting]);
            let options = ["--", "-in_plane_ksp_converged_reason"];
            let said =
                succeeds(&on(&folder, ranks, &run.into_iter().chain(set).chain(options).collect::<Vec<_>>()));
            let lines = said.lines().filter(|line| line.contains("in_plane_"));
            let counts = lines.filter_map(|line| line.split(' ').next_back()?.parse::<u32>().ok());
            counts.max().unwrap()
        });
        assert!(counts.iter().all(|count| (5..=limit).contains(count)), "{ranks} {element}: {counts:?}");
    }
}

#[test]
fn multigrid_moves_the_plate_as_factors_do_up_to_the_second_impact() {
    let folder = folder("fall", FLIGHT);
    for (ranks, scene) in [(1, FVS), (1, HCT), (2, HCT)] {
        let own = ["solver.engine=petsc", "solver.linear=multigrid", "mesh.cells=[20, 8]"];
        let settings = [&own[..], &["time.step=1e-4", "time.end=0.063"]].concat();
        assert_native(&folder, ranks, scene, &settings);
    }
}

#[test]
fn a_wide_contact_is_found_by_multigrid_too() {
    let folder = folder("thrown", THROWN);
    for (ranks, element) in [(1, "mesh.element=fvs"), (1, "mesh.element=hct"), (2, "mesh.element=fvs")] {
        assert_native(&folder, ranks, "fall.toml", &[element]);
    }
}

/// On the finest mesh alone, exchanges move the edge of a contact area by a few rows of nodes, so
/// that a step of 1e-3 s took 7, 16 and 43 of them on these meshes of quadrilaterals. From the
/// answers of coarser meshes it takes 8 at most.
#[test]
fn wide_contact_takes_no_more_exchanges_on_finer_meshes() {
    let folder = folder("uneven", UNEVEN);
    let cases = [("fvs", "[20, 8]"), ("fvs", "[40, 16]"), ("hct", "[40, 16]"), ("fvs", "[80, 32]")];
    for (element, cells) in cases {
        for step in [1e-4, 1e-3] {
            let settings = [
                format!("mesh.element={element}"),
                format!("mesh.cells={cells}"),
                format!("time.step={step}"),
                format!("time.end={}", 5.0 * step),
            ];
            iterations(&folder, 1, &settings.each_ref().map(String::as_str));
            // The ninth column has the exchanges of each step.
            let exchanges: Vec<f64> = history(&folder.join("run")).iter().map(|row| row[8]).collect();
            let most = exchanges.iter().fold(0.0, |most: f64, own| most.max(*own));
            assert!((3.0..=12.0).contains(&most), "{element} {cells} {step}: {exchanges:?}");
        }
    }
}

#[test]
fn wide_contact_found_on_coarse_meshes_is_that_of_factors() {
    let folder = folder("uneven-native", UNEVEN);
    for (ranks, element) in [(1, "mesh.element=hct"), (2, "mesh.element=fvs")] {
        assert_native(&folder, ranks, "fall.toml", &[element]);
    }
}

/// The limits are the counts measured. The mean is that of all solves, of which those that only
/// find the active dofs have two digits.
#[test]
fn a_new_active_set_takes_no_more_iterations() {
    let folder = folder("sets", THROWN);
    for (element, limit) in [("fvs", 14_u32), ("hct", 22)] {
        for cells in ["[20, 8]", "[40, 16]", "[80, 32]"] {
            let [element, cells] = [format!("mesh.element={element}"), format!("mesh.cells={cells}")];
            let (mean, most) = iterations(&folder, 1, &[&element, &cells]);
            assert!(
                most <= u64::from(limit) && mean < 0.3 * f64::from(limit),
                "{element} {cells}: {mean}, {most}"
            );
        }
    }
}

#[test]
fn supports_and_attachments_keep_multigrid_fast() {
    let folder = folder("furnished", FURNISHED);
    let run = |engine: &[&str], out: &str| {
        let arguments = [&["run", "fall.toml", "--quiet", "--out", out], engine].concat();
        succeeds(&on(&folder, 1, &arguments));
        history(&folder.join(out))
    };
    let native = run(&["--set", "solver.linear=auto", "--engine", "native"], "native");
    let (mean, most) = iterations(&folder, 2, &[]);
    assert!(mean < 20.0 && most <= 40, "{mean}, {most}");
    assert_agree(&history(&folder.join("run")), &native, "2 ranks");
}

#[test]
fn a_resumed_run_is_the_same_to_the_bit() {
    let folder = folder("resumed", THROWN);
    let run = |end: &str, out: &str| {
        succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet", "--out", out, "--set", end]));
    };
    run("time.end=1e-3", "whole");
    run("time.end=5e-4", "part");
    succeeds(&rebond(&folder, &["resume", "part", "--until", "1e-3", "--quiet"]));
    let read = |out: &str| std::fs::read_to_string(folder.join(out).join("history.csv")).unwrap();
    assert_eq!(read("part"), read("whole"));
}

#[test]
fn what_multigrid_cannot_do_is_said() {
    let folder = folder("refused", FLIGHT);
    let run =
        |arguments: &[&str]| rebond(&folder, &[&["run", "fall.toml", "--overwrite"], arguments].concat());
    assert_fails(
        &run(&["--set", "mesh.cells=[21, 8]"]),
        2,
        &["solver.linear", "even numbers", "mesh.refine"],
    );
    assert_fails(&run(&["--set", "solver.vi=snes"]), 2, &["fall.toml:", "solver.linear", "\"condensed\""]);
    assert_fails(&run(&["--engine", "native"]), 2, &["solver.linear", "solver.engine = \"petsc\""]);
    let with_option = ["--set", "solver.linear=auto", "--set", "solver.vi=tao", "--", "-pc_type", "mg"];
    assert_fails(&run(&with_option), 2, &["-pc_type mg", "TAO"]);
}

#[test]
fn check_tells_the_linear_solver_and_why() {
    let folder = folder("check", FLIGHT);
    let check = |linear: &str| {
        let setting = format!("solver.linear={linear}");
        let output = rebond(&folder, &["check", "fall.toml", "--json", "--set", &setting]);
        succeeds(&output);
        let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        (value["linear"]["method"].to_string(), value["linear"]["reason"].to_string())
    };
    assert_eq!(check("multigrid").0, "\"multigrid\"");
    let (method, reason) = check("auto");
    assert!(method == "\"direct\"" && reason.contains("less than half"), "{method} {reason}");
}
