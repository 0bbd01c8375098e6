//! Stresses in the files and pictures of a run.

use crate::common::command::{self, rebond, succeeds, summary};
use crate::common::models::PAPER_PLATE;
use rebond::output::{extremes, text, vtu};

/// The envelope has the largest stress of the summary, no snapshot exceeds it, and the pictures
/// are drawn, with a panel per quantity of the probes.
#[test]
fn envelope_snapshots_and_pictures() {
    let scene = format!(
        "{PAPER_PLATE}
        mesh = {{ element = \"hct\", cells = [6, 2] }}
        part = [{{ where = \"x > 0.6\", thickness = 0.008 }}]
        support = [{{ edge = \"left\", kind = \"clamped\" }}]
        obstacle = [{{ name = \"stop\", side = \"below\", height = -0.01, at = [1.2, 0], stiffness = 1e5 }}, {{ side = \"below\", height = -0.02, at = [0.6, 0.2] }}]
        ball = [{{ at = [0.6, 0.2], mass = 0.1, height = 0.75 }}]
        initial = {{ static_pressure = 3000 }}
        time = {{ scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 0.1 }}
        output = {{ fields_every = 20, subdivide = 1, stresses = true, extremes = true, probes = [{{ name = \"tip\", at = [1.2, 0] }}, {{ name = \"root\", at = [0, 0.2], quantity = \"von_mises_top\" }}] }}"
    );
    let folder = command::folder("stresses", &scene);
    succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet", "--out", "run"]));
    let run = folder.join("run");
    let largest = |path: &std::path::Path| {
        vtu::read(path).unwrap().von_mises.into_iter().fold(f64::NEG_INFINITY, f64::max)
    };
    let envelope = largest(&extremes::find(&run).unwrap());
    assert_eq!(summary(&run)["extremes"]["von_mises"]["value"], envelope);
    let index = vtu::read_index(&run).unwrap();
    assert_eq!(index.len(), 6);
    let snapshots = index.iter().map(|(_, path)| largest(path)).fold(0.0, f64::max);
    assert!(
        snapshots <= envelope * (1.0 + 1e-12) && snapshots > 0.5 * envelope,
        "{snapshots:e}, {envelope:e}"
    );
    succeeds(&rebond(&folder, &["plot", "run"]));
    for name in ["stresses.svg", "forces.svg", "extremes.svg", "snapshots.svg", "phase.svg"] {
        assert!(run.join("plots").join(name).is_file(), "{name}");
    }
    let history = std::fs::read_to_string(run.join("plots/history.svg")).unwrap();
    assert!(history.contains("deflection") && history.contains("stress"), "a panel per quantity");
    let spectrum = std::fs::read_to_string(run.join("plots/spectrum.svg")).unwrap();
    assert!(
        spectrum.contains("amplitude (mm)") && spectrum.contains("stress (MPa)"),
        "any probe has a spectrum"
    );
    let forces = std::fs::read_to_string(run.join("plots/forces.svg")).unwrap();
    assert!(forces.contains("gap (mm)") && forces.contains("time ("), "a compliant stop over time and gap");
    assert!(history.contains(">stop<") && !history.contains("partial obstacle"), "{history}");
    let told = ["stop: peak force", "peak of all steps", "\u{a0}N at ", "N\u{a0}s"];
    assert!(told.iter().all(|words| forces.contains(words)), "what the run tells of the stop");
    let snapshots = std::fs::read_to_string(run.join("plots/snapshots.svg")).unwrap();
    for event in [
        "start, largest deflection, tip highest at t = 0 s",
        "end at t = 100 ms",
        "first impact near t = 40 ms",
    ] {
        assert!(snapshots.contains(event), "{event}: {snapshots}");
    }
    assert_eq!(snapshots.matches(">ball 750 mm above<").count(), 6, "a ball far away in each");
    assert!(snapshots.contains("stroke-dasharray=\"1.2 0.7\""), "a stop behind the plate");
    let stresses = std::fs::read_to_string(run.join("plots/stresses.svg")).unwrap();
    assert!(stresses.contains("von Mises stress (MPa)"), "{stresses}");
    let picture = std::fs::read_to_string(run.join("plots/extremes.svg")).unwrap();
    let place = [0, 1].map(|axis| summary(&run)["extremes"]["von_mises"]["at"][axis].as_f64().unwrap());
    let time = summary(&run)["extremes"]["von_mises"]["time"].as_f64().unwrap();
    let time = text::typeset(&text::engineering(time, "s"));
    let told = format!(" at {}, {time}", text::place_in(place, 1.0, "m"));
    assert!(picture.contains(&told), "place and time of the largest stress, in the unit of the axes");
    let bar = "von Mises stress (MPa)";
    assert!(picture.contains(bar) && picture.contains("of all steps"), "{picture}");
    std::fs::remove_file(extremes::find(&run).unwrap()).unwrap();
    succeeds(&rebond(&folder, &["plot", "run"]));
    let picture = std::fs::read_to_string(run.join("plots/extremes.svg")).unwrap();
    assert!(picture.contains(bar) && picture.contains("of 6 snapshots"), "{picture}");
    let arguments = ["run", "fall.toml", "--set", "output.stresses=false", "--set", "output.extremes=false"];
    succeeds(&rebond(&folder, &[&arguments[..], &["--out", "plain"]].concat()));
    let told = succeeds(&rebond(&folder, &["plot", "plain"]));
    assert!(told.contains("no plan of stresses") && told.contains("output.extremes"), "{told}");
    let told = succeeds(&rebond(&folder, &["inspect", "fall.toml"]));
    assert!(told.contains("largest von Mises stress, start"));
}
