//! Largest stresses and accelerations of a run, with every scheme.

use crate::common::models::{PAPER_PLATE, UNIT};
use crate::common::scenes::{self, close, run_to_end};

/// Schemes and masses with a time table each.
const CASES: [(&str, &str); 7] = [
    ("newmark singular", "scheme = \"newmark\", mass = \"singular\", restitution = 0.5"),
    ("newmark consistent", "scheme = \"newmark\", mass = \"consistent\""),
    ("midpoint singular", "scheme = \"midpoint\", mass = \"singular\""),
    ("conserving singular", "scheme = \"conserving\", mass = \"singular\""),
    ("exact singular", "scheme = \"exact\", mass = \"singular\""),
    ("conserving modal", "scheme = \"conserving\", mass = \"modal\", modes = 8"),
    ("exact modal", "scheme = \"exact\", mass = \"modal\", modes = 8"),
];

/// Returns a scene that falls on an obstacle close below it, with the supports at rest or moving.
fn fall(time: &str, moves: bool, output: &str) -> String {
    let motion = if moves { ", motion = \"0.003*sin(50*t)\"" } else { "" };
    format!(
        "{PAPER_PLATE}
        mesh = {{ element = \"fvs\", cells = [4, 2] }}
        part = [{{ where = \"x > 0.6\", thickness = 0.008 }}]
        support = [{{ edge = \"left\", kind = \"clamped\"{motion} }}, {{ edge = \"right\", kind = \"simply_supported\" }}]
        obstacle = [{{ side = \"below\", height = -0.004 }}]
        initial = {{ static_pressure = 3000, velocity = \"-2*x*(1.2 - x)\" }}
        time = {{ {time}, step = 1e-4, end = 0.03 }}
        output = {{ {output} }}"
    )
}

/// The largest stress of a run is that of a probe at its place, recorded at every step, with every
/// scheme, and with a support that moves.
#[test]
fn extremes_are_those_of_a_probe_at_every_step() {
    let moving = [("conserving, moving", CASES[3].1)];
    for (name, time) in CASES.into_iter().chain(moving) {
        let moves = name.ends_with("moving");
        let (_, outcome) = run_to_end(&fall(time, moves, "every = 50, extremes = true"));
        let peak = outcome.extremes.unwrap().von_mises;
        let [x, y] = peak.at;
        // The node between the parts belongs to both; a probe beside it reads one of them.
        let x = if x == 0.6 { 0.6 + 1e-9 } else { x };
        let probe = format!(
            "every = 1, probes = [{{ name = \"peak\", at = [{x}, {y}], quantity = \"von_mises_top\" }}, {{ name = \"other\", at = [{}, {y}], quantity = \"von_mises_bottom\" }}]",
            if x > 0.6 && x < 0.6 + 1e-6 { 0.6 - 1e-9 } else { x }
        );
        let rows = run_to_end(&fall(time, moves, &probe)).0;
        let largest = rows.iter().map(|row| row.probes[0].max(row.probes[1])).fold(0.0, f64::max);
        let at = rows.iter().find(|row| row.probes[0].max(row.probes[1]) == largest).unwrap().time;
        close(name, peak.value, largest, 1e-6);
        assert_eq!(peak.time, at, "{name}");
        assert!(outcome.extremes.unwrap().von_mises.value > 1e6, "{name}: {peak:?}");
    }
}

/// A free plate under a uniform pressure p moves as a rigid body, with an acceleration of p over
/// its mass per area. The recorded acceleration is the mean over the step before, from the recorded
/// velocities.
#[test]
fn accelerations_are_means_over_the_last_step() {
    for (scheme, mass) in [("newmark", "consistent"), ("midpoint", "consistent"), ("conserving", "modal")] {
        let modes = if mass == "modal" { ", modes = 8" } else { "" };
        let text = format!(
            "{UNIT}mesh = {{ element = \"fvs\", cells = [4, 4] }}
             load = {{ pressure = 5 }}
             time = {{ scheme = \"{scheme}\", mass = \"{mass}\"{modes}, step = 1e-3, end = 0.05 }}
             output = {{ probes = [{{ name = \"v\", at = [0.3, 0.5], quantity = \"velocity\" }}, {{ name = \"a\", at = [0.3, 0.5], quantity = \"acceleration\" }}] }}",
        );
        let rows = scenes::run(&text);
        assert_eq!(rows[0].probes[1], 0.0);
        for pair in rows.windows(2) {
            let ([v, a], time) = ([pair[1].probes[0], pair[1].probes[1]], pair[1].time);
            let mean = (v - pair[0].probes[0]) / 1e-3;
            assert!((a - mean).abs() <= 1e-9 * a.abs(), "{scheme} {mass}: {a:e}, {mean:e}");
            assert!(
                (v - 5.0 * time).abs() <= 1e-8 && (a - 5.0).abs() <= 1e-6,
                "{scheme} {mass} {time}: {v}, {a}"
            );
        }
    }
}
