//! `rebond modes`: frequencies, shapes for ParaView, and their picture.

use crate::common::command::{self, assert_fails, rebond, succeeds};
use rebond::output::vtu;
use serde_json::Value;
use std::f64::consts::PI;
use std::fs;

/// Simply supported square: the shapes are sin(k pi x) sin(l pi y).
const SQUARE: &str = r#"
title = "a square"
plate = { length = 1, width = 1, thickness = 0.01, youngs_modulus = 2e11, poissons_ratio = 0.3, density = 7800 }
mesh = { element = "fvs", cells = [8, 8] }
time = { scheme = "newmark", mass = "singular", step = 1e-5, end = 1e-3 }

[[support]]
edge = "left"
kind = "simply_supported"
[[support]]
edge = "right"
kind = "simply_supported"
[[support]]
edge = "bottom"
kind = "simply_supported"
[[support]]
edge = "top"
kind = "simply_supported"
"#;

#[test]
fn modes_have_the_shapes_and_frequencies_of_a_square() {
    let folder = command::folder("cli-modes", SQUARE);
    let json = |arguments: &[&str]| -> Value {
        serde_json::from_str(&succeeds(&rebond(&folder, arguments))).unwrap()
    };
    let modes = json(&["modes", "fall.toml", "--count", "5", "--json"]);
    let frequencies: Vec<f64> = serde_json::from_value(modes["frequencies"].clone()).unwrap();
    assert_eq!(frequencies.len(), 5);
    let inspected = json(&["inspect", "fall.toml", "--json"]);
    let lowest: Vec<f64> = serde_json::from_value(inspected["consistent"]["lowest"].clone()).unwrap();
    frequencies.iter().zip(lowest).for_each(|(a, b)| assert!((a - b).abs() < 1e-9 * b, "{a} for {b}"));

    let folder = folder.join("modes/fall");
    let table = fs::read_to_string(folder.join("modes.csv")).unwrap();
    assert_eq!(table.lines().next(), Some("mode,frequency"));
    assert_eq!(table.lines().nth(1).unwrap(), format!("1,{}", frequencies[0]));
    // The fourth mode has two half waves each way, whose largest value is 1.
    let surface = vtu::read(&folder.join("modes/mode-004.vtu")).unwrap();
    let sign = surface.deflection[surface.points.iter().position(|p| p == &[0.25, 0.25]).unwrap()].signum();
    for ([x, y], w) in surface.points.iter().zip(&surface.deflection) {
        let exact = sign * (2.0 * PI * x).sin() * (2.0 * PI * y).sin();
        assert!((w - exact).abs() < 0.02, "({x}, {y}): {w}, not {exact}");
    }
    assert!((surface.deflection.iter().fold(0.0, |most: f64, w| most.max(w.abs())) - 1.0).abs() < 1e-12);
    let index = fs::read_to_string(folder.join("modes.pvd")).unwrap();
    assert_eq!(index.matches("<DataSet").count(), 5);
    let picture = fs::read_to_string(folder.join("plots/modes.svg")).unwrap();
    assert!(picture.contains("mode shape") && picture.contains(">5: "), "{picture}");
    let of_fifth = picture.split(">4: ").nth(1).unwrap();
    let line = "<polyline fill=\"none\" stroke=\"#000000\" stroke-width=\"0.7\"";
    let lines = of_fifth.find(line).unwrap();
    let of_fourth = picture.split(">3: ").nth(1).unwrap().split(">4: ").next().unwrap();
    assert!(of_fourth.matches(line).count() >= 64, "two nodal lines of 32 cells each, without a gap");
    assert!(lines > of_fifth.rfind("<polygon").unwrap(), "nodal lines over all faces");
}

/// A picture of all modes of a fine mesh would be too large to draw.
#[test]
fn a_picture_has_the_first_hundred_modes() {
    let folder = command::folder("cli-modes-many", SQUARE);
    let said = succeeds(&rebond(&folder, &["modes", "fall.toml", "--count", "101"]));
    assert!(
        said.contains("\n  101") && said.contains("the picture has the first 100 of these 101 modes\n"),
        "{said}"
    );
    let folder = folder.join("modes/fall");
    let picture = fs::read_to_string(folder.join("plots/modes.svg")).unwrap();
    assert!(picture.contains(">100: ") && !picture.contains(">101: "));
    assert_eq!(fs::read_to_string(folder.join("modes.csv")).unwrap().lines().count(), 102);
    assert!(folder.join("modes/mode-101.vtu").exists());
}

#[test]
fn what_is_no_folder_of_modes_is_refused() {
    let folder = command::folder("cli-modes-bad", SQUARE);
    let none = rebond(&folder, &["modes", "fall.toml", "--count", "0"]);
    assert!(none.status.code() == Some(2) && command::text(&none.stderr).contains("--count"));
    fs::create_dir_all(folder.join("mine")).unwrap();
    fs::write(folder.join("mine/thesis.tex"), "").unwrap();
    assert_fails(&rebond(&folder, &["modes", "fall.toml", "--out", "mine"]), 2, &["thesis.tex", "--out"]);
}
