//! The scenes of `scenes/gallery`, run as a user runs them: each gives the number that theory
//! predicts.

use crate::common::command;
use crate::common::command::{rebond, succeeds};
use rebond::mesh::{Import, Mesh};
use rebond::output::plot::run::amplitudes;
use serde_json::Value;
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

const GALLERY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/gallery");
const G: f64 = 9.81;

/// Output of a run.
pub struct Run {
    summary: Value,
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Run {
    pub fn read(folder: &Path) -> Run {
        let text = std::fs::read_to_string(folder.join("history.csv")).unwrap();
        let names = text.lines().next().unwrap().split(',').map(str::to_owned).collect();
        Run { summary: command::summary(folder), names, rows: command::history(folder) }
    }

    pub fn column(&self, name: &str) -> Vec<f64> {
        let index = self.names.iter().position(|other| other == name).unwrap();
        self.rows.iter().map(|row| row[index]).collect()
    }

    /// Returns instants and values of a column.
    fn curve(&self, name: &str) -> Vec<(f64, f64)> {
        self.column("time").into_iter().zip(self.column(name)).collect()
    }

    /// Returns the value at an instant that has a row.
    pub fn at(&self, time: f64, name: &str) -> f64 {
        let near = |(t, value): (f64, f64)| ((t - time).abs() < 1e-9).then_some(value);
        self.curve(name).into_iter().find_map(near).unwrap()
    }

    /// Returns time and velocity of the first impact.
    fn first_impact(&self) -> [f64; 2] {
        let impact = &self.summary["first_impact"];
        ["time", "velocity"].map(|name| impact[name].as_f64().unwrap())
    }
}

fn scene(name: &str) -> String {
    format!("{GALLERY}/{name}.toml")
}

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("gallery-{test}"), "")
}

/// Runs a scene of the gallery with some settings.
fn run(name: &str, settings: &[&str]) -> Run {
    Run::read(&run_in_folder(name, settings).join("out"))
}

/// Runs a scene of the gallery with some settings, and returns the folder that has the run `out`.
fn run_in_folder(name: &str, settings: &[&str]) -> PathBuf {
    let test = [&[name], settings].concat().join("-").replace(|c: char| !c.is_ascii_alphanumeric(), "_");
    let folder = folder(&test);
    let set: Vec<String> = settings.iter().map(|setting| format!("--set={setting}")).collect();
    let scene = scene(name);
    let mut arguments = vec!["run", &scene, "--quiet", "--out", "out"];
    arguments.extend(set.iter().map(String::as_str));
    succeeds(&rebond(&folder, &arguments));
    folder
}

#[track_caller]
pub fn assert_near(value: f64, expected: f64, part: f64) {
    assert!((value / expected - 1.0).abs() <= part, "{value} is not {expected} to {part}");
}

/// Modes of a cantilever, scaled to a mean square of 1: the numbers beta L, and the frequencies in
/// rad/s.
struct Cantilever {
    length: f64,
    modes: Vec<(f64, f64)>,
}

impl Cantilever {
    /// Computes the modes; `wave` is sqrt(E I / (rho A)), in m2/s.
    fn new(length: f64, wave: f64) -> Cantilever {
        let roots =
            [1.875_104_068_711_961, 4.694_091_132_974_175, 7.854_757_438_237_613, 10.995_540_734_875_467];
        Cantilever { length, modes: roots.map(|root| (root, (root / length).powi(2) * wave)).to_vec() }
    }

    /// Returns the value of a mode at a fraction of the length.
    fn shape(root: f64, share: f64) -> f64 {
        let sigma = (root.cosh() + root.cos()) / (root.sinh() + root.sin());
        let z = root * share;
        z.cosh() - z.cos() - sigma * (z.sinh() - z.sin())
    }

    /// Returns the integral of a mode over a part of the beam, divided by the length.
    fn share(&self, root: f64, from: f64, to: f64) -> f64 {
        let parts = 2000;
        let h = (to - from) / f64::from(parts);
        let at = |i: i32| Self::shape(root, (from + (f64::from(i) + 0.5) * h) / self.length);
        (0..parts).map(at).sum::<f64>() * h / self.length
    }

    /// Returns the deflection of the tip after each step under accelerations a(t) of the part
    /// between two places. The beam starts at rest with mass-proportional damping; each mode is
    /// integrated by the central difference scheme.
    fn tip(&self, step: f64, steps: usize, damping: f64, part: [f64; 2], a: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut tip = vec![0.0; steps];
        for &(root, omega) in &self.modes {
            let (share, end) = (self.share(root, part[0], part[1]), Self::shape(root, 1.0));
            let (mut last, mut q) = (0.0, 0.0);
            for (i, tip) in tip.iter_mut().enumerate() {
                let force = share * a(i as f64 * step) - omega * omega * q;
                let next = (step * step * force + 2.0 * q - last * (1.0 - 0.5 * damping * step))
                    / (1.0 + 0.5 * damping * step);
                (last, q) = (q, next);
                *tip += end * q;
            }
        }
        tip
    }
}

/// Returns the value of a curve with steps of 1e-5 s at an instant.
fn tip_at(curve: &[f64], time: f64) -> f64 {
    curve[(time / 1e-5).round() as usize]
}

/// Returns time and velocity where a curve first satisfies a condition.
fn passes(curve: &[f64], step: f64, is_past: impl Fn(f64) -> bool) -> [f64; 2] {
    let i = curve.iter().position(|&w| is_past(w)).unwrap();
    [i as f64 * step, (curve[i] - curve[i - 1]) / step]
}

#[test]
fn every_scene_is_told_and_pinned() {
    let pinned = [
        "ball",
        "basins",
        "chaos",
        "clearance",
        "cymbal",
        "disc",
        "drum",
        "hardening",
        "oilcan",
        "panel",
        "plywood",
        "pull_in",
        "rattle",
        "reed",
        "snare",
        "snubber",
        "squeal",
        "stack",
        "strip",
        "struck",
        "switch",
        "valve",
        "vibrating",
    ];
    let mut found = Vec::new();
    for entry in std::fs::read_dir(GALLERY).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
            let text = std::fs::read_to_string(&path).unwrap();
            assert!(text.starts_with("# "), "{name} has no story");
            assert!(
                text.contains(&format!("rebond run scenes/gallery/{name}.toml")),
                "{name} has no command"
            );
            succeeds(&rebond(&folder(&format!("check-{name}")), &["check", &scene(&name)]));
            found.push(name);
        }
    }
    found.sort();
    assert_eq!(found, pinned);
}

/// The wave grows evenly, by a factor in each of three equal times, as long as the feet hold.
#[test]
fn friction_on_a_turning_disc_makes_a_plate_squeal() {
    let energy = |friction: &str| {
        let friction = format!("obstacle.0.friction={friction}");
        let run = run("squeal", &[&friction, "time.end=0.19"]);
        let curve = run.curve("kinetic");
        [0.1, 0.13, 0.16].map(|from| {
            let rows = curve.iter().filter(|(t, _)| (from..from + 0.03).contains(t));
            rows.map(|(_, kinetic)| *kinetic).fold(0.0, f64::max)
        })
    };
    let [first, second, third] = energy("0.4");
    assert!(second > 3.0 * first && third > 3.0 * second, "{first:e}, {second:e}, {third:e}");
    assert!(((third / second) / (second / first)).ln().abs() < 0.5, "{first:e}, {second:e}, {third:e}");
    let [first, second, third] = energy("0.05");
    assert!(second < first && third < second, "{first:e}, {second:e}, {third:e}");
}

#[test]
fn a_vibrating_beam_meets_its_stop_when_its_modes_say() {
    // In the frame of the support, which starts at once at the velocity a W, each mode starts with
    // the opposite of this velocity.
    let (amplitude, drive) = (2e-3, 2.0 * PI * 5.832);
    let beam = Cantilever::new(1.2, 0.01 * (210e9_f64 / (12.0 * 7770.0)).sqrt());
    let shares: Vec<f64> = beam.modes.iter().map(|&(root, _)| beam.share(root, 0.0, 1.2)).collect();
    let tip = |t: f64| {
        let mode = |(&(root, omega), share): (&(f64, f64), &f64)| {
            let part = share * amplitude * drive;
            let forced = part * drive / (omega * omega - drive * drive);
            let free = forced * drive / omega + part / omega;
            Cantilever::shape(root, 1.0) * (forced * (drive * t).sin() - free * (omega * t).sin())
        };
        amplitude * (drive * t).sin() + beam.modes.iter().zip(&shares).map(mode).sum::<f64>()
    };
    let curve: Vec<f64> = (0..50_000).map(|i| tip(f64::from(i) * 1e-5)).collect();
    let [time, _] = passes(&curve, 1e-5, |w| w.abs() >= 0.022);

    let run = run("vibrating", &["time.end=0.45", "output.every=1"]);
    let [first, speed] = run.first_impact();
    assert!((first - time).abs() < 1e-3, "{first} s is not {time} s");
    // The sudden start of the support excites fast modes, whose phase the mesh does not resolve.
    // The mean of their velocity over 20 ms is small.
    let (step, tip) = (5e-5, run.column("tip"));
    let touched = run.column("contact_nodes").iter().position(|nodes| *nodes > 0.0).unwrap();
    let way = tip[touched] - tip[touched - 400];
    assert_near(way / 0.02, (tip_at(&curve, time) - tip_at(&curve, time - 0.02)) / 0.02, 0.01);
    // The stop stands still, so the impact velocity is that of the tip relative to the ground, not
    // to the support.
    assert_near(speed, (tip[touched] - tip[touched - 1]) / step, 1e-2);
}

#[test]
fn a_perforated_panel_meets_its_rail_alike_with_either_mass() {
    let exact = run("panel", &["mesh.refine=0", "time.modes=100", "time.end=0.04"]);
    let consistent = ["time.scheme=\"newmark\"", "time.mass=\"consistent\"", "time.step=5e-5"];
    let consistent = run("panel", &[&["mesh.refine=0", "time.end=0.033"], &consistent[..]].concat());
    let ([time, velocity], [expected_time, expected_velocity]) =
        (exact.first_impact(), consistent.first_impact());
    assert!((time - expected_time).abs() < 2e-6, "{time} s is not {expected_time} s");
    assert_near(velocity, expected_velocity, 5e-3);
    let energy = exact.column("energy");
    let change = energy.iter().map(|now| (now / energy[0] - 1.0).abs()).fold(0.0, f64::max);
    assert!(change < 1e-11, "the energy changes by {change:e}");
}

#[test]
fn a_ball_slows_down_as_on_an_infinite_plate() {
    let run = run("ball", &["time.end=5e-4"]);
    let stiffness = 210e9 * 4e-3_f64.powi(3) / (12.0 * (1.0 - 0.3 * 0.3));
    let tau = 0.5 / (8.0 * (stiffness * 7800.0 * 4e-3).sqrt());
    // The ball touches the plate after 0.1 ms.
    let sunk = -0.626 * tau * (1.0 - (-4e-4 / tau).exp());
    let [time, velocity] = run.first_impact();
    assert!((time - 1e-4).abs() < 1e-7 && (velocity + 0.626).abs() < 1e-6, "{time} s, {velocity} m/s");
    assert_near(run.at(5e-4, "centre"), sunk, 0.02);
    assert_near(run.at(5e-4, "contact_force"), 0.626 * 0.5 / tau * (-4e-4 / tau).exp(), 0.05);
    let impulse = run.summary["forces"]["ball_1"]["impulse"].as_f64().unwrap();
    assert_near(impulse, -0.626 * 0.5 * (1.0 - (-4e-4 / tau).exp()), 0.02);
}

#[test]
fn a_disc_rests_on_its_ball_with_the_force_of_theory() {
    let stiffness = 210e9 * 2e-3_f64.powi(3) / (12.0 * (1.0 - 0.3 * 0.3));
    let free = 8000.0 * 0.2_f64.powi(4) / (64.0 * stiffness);
    let force = 16.0 * PI * stiffness * (free - 5e-4) / 0.2_f64.powi(2);
    let run = run("disc", &["time.end=8e-3"]);
    assert_near(run.at(0.0, "contact_force"), force, 0.01);
    // A release of two steps ends no contact, of the plate nor of its one stop.
    let contacts = run.summary["contacts"].as_array().unwrap().len();
    assert_eq!((contacts, run.summary["node_contacts"].as_u64()), (2, Some(3)));
    assert_eq!(run.summary["forces"]["obstacle_1"]["impacts"], contacts);
}

#[test]
fn a_loose_cover_takes_off_where_gravity_no_longer_holds_it() {
    let (a, w) = (4e-3, 2.0 * PI * 10.0);
    let floor = |t: f64| a * (1.0 - (w * t).cos());
    let off = (-G / (a * w * w)).acos() / w;
    let flight = |t: f64| {
        let t = t - off;
        floor(off) + a * w * (w * off).sin() * t - 0.5 * G * t * t
    };
    let landing = (1..).map(|i| off + 1e-5 * f64::from(i)).find(|&t| t > off + 0.01 && flight(t) <= floor(t));

    // The cover is no rigid body: it takes off and lands some milliseconds late, one side after the
    // other.
    let contacts = run("rattle", &["time.end=0.12"]).summary["contacts"].clone();
    let contacts: Vec<[f64; 2]> = serde_json::from_value(contacts).unwrap();
    let flight = contacts.windows(2).find(|pair| pair[1][0] - pair[0][1] > 0.01).unwrap();
    let (leaves, lands) = (flight[0][1], flight[1][0]);
    assert!((leaves - off).abs() < 3e-3, "leaves at {leaves} s, not {off} s");
    let landing = landing.unwrap();
    assert!((lands - landing).abs() < 5e-3, "lands at {lands} s, not {landing} s");
}

#[test]
fn a_stroke_at_a_corner_meets_a_seventh_of_the_mass() {
    let (mass, omega, duration) = (2400.0 * 0.05 * 0.36, (5e6_f64 / (2400.0 * 0.05)).sqrt(), 0.01);
    // This is the Fourier transform of half a sine of 1 kN.
    let rate = PI / duration;
    let transform = 1000.0 * rate * 2.0 * (0.5 * omega * duration).cos() / (rate * rate - omega * omega);
    let run = run("struck", &["time.end=0.03"]);
    assert_near(run.at(0.03, "work"), 3.5 * transform * transform / mass, 0.02);
}

#[test]
fn a_machine_on_springs_meets_its_stops_as_a_rigid_body() {
    let (mass, stiffness) = (40.0 + 0.8 * 0.6 * 0.02 * 2700.0, 8e4_f64);
    let (sag, omega) = (mass * G / stiffness, (stiffness / mass).sqrt());
    let phase = (1.0 - 0.015 / sag).acos();
    let run = run("stack", &["time.end=0.3"]);
    let [time, velocity] = run.first_impact();
    assert_near(time, phase / omega, 0.02);
    assert_near(velocity, -sag * omega * phase.sin(), 0.05);
    assert!(run.summary["contact_steps"].as_u64().unwrap() > 100);
    let most = run.column("elastic").into_iter().fold(0.0, f64::max);
    assert!(run.column("energy").into_iter().all(|energy| energy.abs() < 1e-9 * most));
}

/// One mass between springs, and a stop on spring and dashpot that never pulls, by Euler's
/// semi-implicit steps.
#[test]
fn snubbers_catch_an_instrument_as_a_single_mass() {
    let (mass, spring, stop, damping) = (0.4 * 0.3 * 0.02 * 7800.0, 1.6e5, 4e6, 2e3);
    let (step, mut x, mut v) = (1e-7_f64, 0.0_f64, -1.5_f64);
    let (mut deepest, mut most) = (0.0_f64, 0.0_f64);
    for _ in 0..200_000 {
        let depth = -8e-3 - x;
        let force = if depth > 0.0 { (stop * depth - damping * v).max(0.0) } else { 0.0 };
        v += step * (force - spring * x) / mass;
        x += step * v;
        (deepest, most) = (deepest.min(x), most.max(force));
    }
    let run = run("snubber", &["time.end=0.02"]);
    assert_near(run.column("centre").into_iter().fold(0.0, f64::min), deepest, 2e-3);
    assert_near(run.column("contact_force").into_iter().fold(0.0, f64::max), most, 5e-3);
    assert_near(run.at(0.02, "centre"), x, 0.01);
}

/// Bending makes the plate of the valve a little softer than a rigid disc on its seat. The disc and
/// its seat have the areas of the mesh.
#[test]
fn a_valve_meets_its_seat_as_a_rigid_disc() {
    let mesh = Mesh::load(format!("{GALLERY}/disc.msh"), Import::default()).unwrap();
    let (mut whole, mut ring) = (0.0, 0.0);
    for cell in 0..mesh.cells.len() {
        let [a, b, c] = mesh.vertices(cell)[..] else { panic!("a triangle") };
        let area = 0.01 * 0.5 * (b - a).perp(&(c - a)).abs();
        whole += area;
        ring += if mesh.centroid(cell).coords.norm() > 0.165 { area } else { 0.0 };
    }
    let (mass, stop, damping, gas) = (7800.0 * 2e-3 * whole, 5e9 * ring, 1e5 * ring, 5e3 * whole);
    let speed = (2.0 * gas / mass * 2e-3_f64).sqrt();
    let (step, mut x, mut v, mut most, mut impulse) = (1e-8, 0.0, -speed, 0.0_f64, 0.0);
    loop {
        let force = -stop * x - damping * v;
        if force < 0.0 {
            break;
        }
        v += step * (force - gas) / mass;
        x += step * v;
        impulse += step * force;
        most = most.max(force);
    }
    let run = run("valve", &["time.end=0.005"]);
    let [time, velocity] = run.first_impact();
    assert_near(time, mass * speed / gas, 1e-3);
    assert_near(velocity, -speed, 1e-3);
    let seat = &run.summary["forces"]["seat"];
    assert_near(seat["peak"].as_f64().unwrap(), most, 0.02);
    assert_near(seat["impulse"].as_f64().unwrap(), impulse, 0.01);
    assert_eq!(seat["impacts"], 1);
    let largest = &run.summary["extremes"]["von_mises"];
    assert!((1.5e7..2.5e7).contains(&largest["value"].as_f64().unwrap()), "{largest}");
}

/// The tip of the beam meets the contact where its modes say, and rests on it with the force of a
/// beam on a spring. Bending across the beam, which Poisson's ratio causes, stiffens it by some per
/// cent.
#[test]
fn a_switch_closes_and_makes_contact() {
    let (length, gap, pressure, thickness) = (200e-6_f64, 1e-6, 3600.0, 3e-6_f64);
    let beam = Cantilever::new(length, thickness * (80e9_f64 / (12.0 * 19300.0)).sqrt());
    let tip = beam.tip(1e-10, 100_000, 1e5, [0.0, length], |_| -pressure / (19300.0 * thickness));
    let [time, velocity] = passes(&tip, 1e-10, |w| w <= -gap);
    let run = run("switch", &[]);
    let [found_time, found_velocity] = run.first_impact();
    assert_near(found_time, time, 0.02);
    assert_near(found_velocity, velocity, 0.03);
    let bending = 80e9 * thickness.powi(3) / 12.0;
    let free = pressure * length.powi(4) / (8.0 * bending);
    let force = (free - gap) / (length.powi(3) / (3.0 * bending * 40e-6) + 1e-4);
    assert_near(*run.column("contact_force").last().unwrap(), force, 0.04);
    let bounces = run.summary["contacts"].as_array().unwrap().len();
    assert!(bounces > 1, "{bounces} contacts");
}

#[test]
fn a_strip_bounces_as_one_with_half_its_period() {
    let omega = PI * PI * 2e-3 * (210e9_f64 / (12.0 * 7800.0)).sqrt();
    for (t, w) in run("strip", &[]).curve("middle") {
        let exact = 1e-2 * (omega * t).cos().abs();
        assert!((w - exact).abs() < 2e-4, "{t} s: {w} m, not {exact} m");
    }
}

#[test]
fn plywood_rings_and_dies_away() {
    let output = succeeds(&rebond(&folder("plywood-inspect"), &["inspect", &scene("plywood"), "--json"]));
    let inspection: Value = serde_json::from_str(&output).unwrap();
    let (h, nu) = (0.012_f64, 0.1);
    let plate = h.powi(3) / (12.0 * (1.0 - nu * nu * 0.4));
    let [d1, d2, d66] = [10e9 * plate, 4e9 * plate, 0.7e9 * h.powi(3) / 12.0];
    let exact = |m: f64, n: f64| {
        let (x, y) = (m / 1.2, n / 0.8);
        let sum = d1 * x.powi(4) + 2.0 * (nu * d2 + 2.0 * d66) * (x * y).powi(2) + d2 * y.powi(4);
        0.5 * PI * (sum / (600.0 * h)).sqrt()
    };
    for (i, (m, n)) in [(1.0, 1.0), (2.0, 1.0), (1.0, 2.0)].into_iter().enumerate() {
        let found = inspection["consistent"]["lowest"][i].as_f64().unwrap();
        assert!((1.0..1.01).contains(&(found / exact(m, n))), "{found} Hz, not {} Hz", exact(m, n));
    }
    let energies = run("plywood", &[]).column("energy");
    let left = energies.last().unwrap() / energies[0];
    assert_near(left.ln(), -5.0 * 0.5, 0.03);
}

#[test]
fn a_reed_meets_its_stop_as_a_beam_does() {
    let beam = Cantilever::new(0.03, 3e-4 * (210e9_f64 / (12.0 * 7700.0)).sqrt());
    let pressure = |t: f64| 4e4 * (100.0 * PI * t).sin() - 2e3;
    // Until the pressure changes sign, the seat holds the reed.
    let a = |t: f64| pressure(t).max(0.0) / (7700.0 * 3e-4);
    let tip = beam.tip(1e-7, 20_000, 50.0, [0.018, 0.027], a);
    let [time, velocity] = passes(&tip, 1e-7, |w| w >= 1.5e-3);
    let short = run("reed", &["time.end=2e-3", "output.every=1"]);
    let curve = short.curve("tip");
    let i = curve.iter().position(|(_, w)| *w >= 1.5e-3).unwrap();
    assert_near(curve[i].0, time, 0.03);
    let speed = (curve[i - 1].1 - curve[i - 11].1) / (curve[i - 1].0 - curve[i - 11].0);
    assert_near(speed, velocity, 0.05);
}

#[test]
fn a_reed_closes_alike_with_two_schemes() {
    let closes = |settings: &[&str]| {
        let contacts = run("reed", &[settings, &["time.end=0.011"]].concat()).summary["contacts"].clone();
        let mut begins = contacts.as_array().unwrap().iter().map(|contact| contact[0].as_f64().unwrap());
        begins.find(|&begin| begin > 9e-3).unwrap()
    };
    let [newmark, conserving] = [closes(&[]), closes(&["time.scheme=conserving"])];
    assert_near(conserving, newmark, 0.01);
}

/// Returns the amplitude (m) of the tip of the steel strip of 0.2 m and 1 mm under an even pressure
/// of 1 Pa at a frequency (Hz), with Rayleigh's coefficients of damping, by the modes of a beam.
fn swing(frequency: f64, [mass, stiffness]: [f64; 2]) -> f64 {
    let beam = Cantilever::new(0.2, 1e-3 * (210e9_f64 / (12.0 * 7800.0)).sqrt());
    let drive = 2.0 * PI * frequency;
    let (mut re, mut im) = (0.0, 0.0);
    for &(root, omega) in &beam.modes {
        let force = beam.share(root, 0.0, 0.2) * Cantilever::shape(root, 1.0) / (7800.0 * 1e-3);
        let (stiff, damped) = (omega * omega - drive * drive, drive * (mass + stiffness * omega * omega));
        let size = stiff * stiff + damped * damped;
        re += force * stiff / size;
        im -= force * damped / size;
    }
    f64::hypot(re, im)
}

/// The tip swings by 0.8 of the clearance as drawn, by the modes of a beam to 5 per cent, since a
/// wide strip is stiffer than a beam. A strip rattles where its clearance is less, which has the
/// probability Phi(-0.2 / (0.5 / 3)).
#[test]
fn strips_rattle_as_often_as_their_clearances_are_too_small() {
    assert_near(57.573 * swing(10.0, [40.0, 0.0]), 0.8e-3, 0.05);
    let folder = folder("clearance");
    succeeds(&rebond(&folder, &["sweep", &scene("clearance"), "--quiet", "--out", "out", "--runs", "512"]));
    let report = std::fs::read(folder.join("out/sweep.json")).unwrap();
    let report: Value = serde_json::from_slice(&report).unwrap();
    for row in report["rows"].as_array().unwrap() {
        let (gap, impacts) =
            (row["values"][0].as_f64().unwrap(), row["measures"]["impacts"].as_f64().unwrap());
        // At grazing the step decides.
        assert!((gap < 0.8e-3) == (impacts > 0.0) || (gap / 0.8e-3 - 1.0).abs() < 1e-4, "{gap} {impacts}");
    }
    let probability = |criterion: usize| report["criteria"][criterion]["probability"].as_f64().unwrap();
    // Each 512th part of the clearances has one strip.
    assert!((probability(0) - 0.115070).abs() <= 1.0 / 512.0, "{}", probability(0));
    assert!(probability(1) > 0.0 && probability(1) < probability(0));
}

#[test]
fn a_driven_cantilever_grazes_its_walls_where_its_modes_say() {
    let grazing = 1e-3 / swing(40.0, [8.0, 1e-5]);
    // The amplitude of the drive increases slowly, so that the start causes no contact.
    let touches = |pressure: f64| {
        let load = format!("load.pressure=\"{pressure}*min(1, t)*sin(2*pi*40*t)\"");
        let run = run("chaos", &[&load, "time.end=2.5"]);
        run.summary["contact_steps"].as_u64().unwrap() > 0
    };
    assert!(!touches(0.96 * grazing), "touches below {grazing} Pa");
    assert!(touches(1.04 * grazing), "does not touch above {grazing} Pa");
}

/// Makes a run of a scene heard and returns the frequencies (Hz) and amplitudes (m/s) of a probe.
fn heard(name: &str, settings: &[&str], probe: &str) -> Vec<[f64; 2]> {
    let folder = run_in_folder(name, settings);
    let arguments = ["sound", "out", "--probe", probe, "--out", "sound.wav", "--json"];
    let answer: Value = serde_json::from_str(&succeeds(&rebond(&folder, &arguments))).unwrap();
    let scale = answer["full_scale"].as_f64().unwrap() / 32767.0;
    let bytes = std::fs::read(folder.join("sound.wav")).unwrap();
    let samples = bytes[44..].chunks(2).map(|pair| f64::from(i16::from_le_bytes([pair[0], pair[1]])));
    let samples: Vec<f64> = samples.map(|sample| scale * sample).collect();
    let times: Vec<f64> = (0..samples.len()).map(|i| i as f64 / 44_100.0).collect();
    amplitudes(&times, &samples)
}

/// Returns the lowest frequencies of a scene, in Hz.
fn frequencies(name: &str, count: &str) -> Vec<f64> {
    let arguments = ["modes", &scene(name), "--count", count, "--json"];
    let modes: Value =
        serde_json::from_str(&succeeds(&rebond(&folder(&format!("{name}-modes")), &arguments))).unwrap();
    serde_json::from_value(modes["frequencies"].clone()).unwrap()
}

/// Square root of D over rho h, divided by 2 pi a^2, of a disc with the radius 0.2 m and a
/// Poisson's ratio of 0.33.
fn disc_unit(thickness: f64, youngs_modulus: f64, density: f64) -> f64 {
    let speed = thickness * (youngs_modulus / (12.0 * (1.0 - 0.33 * 0.33) * density)).sqrt();
    speed / (2.0 * PI * 0.2 * 0.2)
}

/// Modes come in pairs, except the one that keeps the symmetry. The washer stiffens those with two
/// nodal diameters by some per cent.
#[test]
fn a_cymbal_rings_as_a_free_disc() {
    let unit = disc_unit(1e-3, 110e9, 8800.0);
    let modes = frequencies("cymbal", "9");
    for (pair, lambda2, most) in [(3, 5.253, 1.05), (5, 12.23, 1.01), (7, 21.6, 1.01)] {
        for mode in &modes[pair..pair + 2] {
            assert!(
                (0.99..most).contains(&(mode / (lambda2 * unit))),
                "{mode} Hz, not {} Hz",
                lambda2 * unit
            );
        }
    }
    let spectrum = heard("cymbal", &["time.end=0.2", "time.modes=60"], "rim");
    let near = spectrum.iter().filter(|[frequency, _]| (40.0..75.0).contains(frequency));
    let loudest = near.max_by(|a, b| a[1].total_cmp(&b[1])).unwrap()[0];
    // Frequencies are 5 Hz apart.
    assert!((loudest - 12.23 * unit).abs() < 5.0, "{loudest} Hz");
}

/// Mean frequency at which a column passes zero upwards, in Hz.
fn pitch(run: &Run, column: &str) -> f64 {
    let [times, values] = ["time", column].map(|name| run.column(name));
    let passes = |i: &usize| values[*i] < 0.0 && values[i + 1] >= 0.0;
    let passes: Vec<usize> = (0..values.len() - 1).filter(passes).collect();
    let [first, last] = [passes[0], passes[passes.len() - 1]];
    (passes.len() - 1) as f64 / (times[last] - times[first])
}

/// A stroke that deflects the head by ten of its thicknesses stretches it.
#[test]
fn a_drumhead_rings_as_a_membrane_and_higher_when_struck_hard() {
    let modes = frequencies("drum", "4");
    let lowest = 2.404826 / (2.0 * PI * 0.2) * (2000.0_f64 / (1390.0 * 0.25e-3)).sqrt();
    for (mode, root) in [(0, 2.404826), (1, 3.831706), (2, 3.831706), (3, 5.135622)] {
        assert_near(modes[mode], root / 2.404826 * lowest, 0.005);
    }
    let struck = |stretching: &str| {
        let settings =
            ["time.end=0.06", "obstacle.0.height=-0.1", "damping.mass=0", "output.fields_every=100000"];
        pitch(&run("drum", &[&settings[..], &[stretching]].concat()), "centre")
    };
    let ratio = struck("in_plane.stretching=true") / struck("in_plane.stretching=false");
    assert!((1.01..1.04).contains(&ratio), "{ratio}");
}

/// The panel buckles at 2.282 K, by the load of a clamped square under equal pressure along both
/// axes; 10x10 cells are 1.8 per cent stiffer.
#[test]
fn a_heated_panel_snaps_under_a_strong_breeze_alone() {
    let inspection = succeeds(&rebond(&folder("oilcan-inspect"), &["inspect", &scene("oilcan"), "--json"]));
    let inspection: Value = serde_json::from_str(&inspection).unwrap();
    let factor = inspection["buckling_factor"].as_f64().unwrap();
    let exact = 5.3036261 * PI * PI * 1e-6 / (12.0 * 1.33 * 23e-6 * 0.0625);
    assert!((1.0..1.03).contains(&(5.0 * factor / exact)), "{factor}");
    let sides = |breeze: &str, start: &str| {
        let settings = [&format!("parameters.breeze={breeze}")[..], start, "time.end=0.2"];
        let run = run("oilcan", &settings);
        let centre = run.column("centre");
        let changes = centre.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
        (centre[0], changes, run.summary["contact_steps"].as_u64().unwrap())
    };
    let flat = "initial.deflection=0";
    let (above, changes, contact) = sides("400", flat);
    assert!(above > 1.4e-3 && changes == 0 && contact == 0, "{above}, {changes}, {contact}");
    let (_, changes, contact) = sides("1500", flat);
    assert!(changes > 8 && contact > 100, "{changes}, {contact}");
    // From below the stop carries the panel.
    let (below, changes, contact) = sides("0", "initial.deflection=-1e5*(x*y*(x-0.25)*(y-0.25))^2");
    assert!(
        (-1e-3..-0.8e-3).contains(&below) && changes == 0 && contact > 100,
        "{below}, {changes}, {contact}"
    );
}

/// A strip that only bends is pulled in at `$\varepsilon V^2 L^4 / (2 D g^3) = 70.095$`.
#[test]
fn a_switch_is_pulled_in_beyond_its_voltage() {
    let inspection = rebond(
        &folder("pull-in-inspect"),
        &["inspect", &scene("pull_in"), "--json", "--set", "parameters.v=20"],
    );
    let inspection: Value = serde_json::from_str(&succeeds(&inspection)).unwrap();
    let factor = inspection["pull_in_factor"].as_f64().unwrap();
    let check = |volts: &str| {
        let given = ["check", &scene("pull_in"), "--set", &format!("parameters.v={volts}")];
        succeeds(&rebond(&folder("pull-in-check"), &given))
    };
    assert!(check("50").contains("times load.pressure; beyond it only an obstacle"));
    assert!(!check("20").contains("pull-in"));
    let bends = 70.095 * 2.0 * (160e9 * 1e-18 / 12.0) * 8e-18 / (8.854e-12 * 200e-6_f64.powi(4));
    let ratio = 400.0 * factor / bends;
    assert!((1.0..1.6).contains(&ratio), "{ratio}");
    let middle = |volts: &str| {
        let run = run("pull_in", &[&format!("parameters.v={volts}")]);
        (run.column("middle").into_iter().fold(0.0, f64::min), run.summary["contact_steps"].as_u64().unwrap())
    };
    let (lowest, contact) = middle("20");
    assert!(lowest > -2e-6 / 3.0 && contact == 0, "{lowest}, {contact}");
    let (lowest, contact) = middle("50");
    assert!((lowest / -1.5e-6 - 1.0).abs() < 1e-6 && contact > 1000, "{lowest}, {contact}");
}

#[test]
fn a_snare_adds_what_the_drum_alone_has_not() {
    assert_near(frequencies("snare", "1")[0], 10.216 * disc_unit(1.5e-3, 70e9, 2700.0), 0.01);
    let high = |height: &str| {
        let settings = ["time.end=0.1", height];
        let spectrum = heard("snare", &settings, "head");
        let square = |from: f64| -> f64 {
            spectrum.iter().filter(|[frequency, _]| *frequency > from).map(|[_, a]| a * a).sum()
        };
        square(2000.0) / square(0.0)
    };
    let [on, off] = [high("obstacle.0.height=-1e-5"), high("obstacle.0.height=-0.1")];
    assert!(on > 5.0 * off, "a part of {on} with the wire, {off} without");
}

#[test]
fn all_commands_take_meshes_from_files_and_balls() {
    let folder = folder("commands");
    for (name, settings, rigid) in [
        ("rattle", ["time.end=0.02", "output.fields_every=100"], 3),
        ("ball", ["time.end=4e-4", "mesh.cells=[8, 8]"], 1),
    ] {
        let scene = scene(name);
        let [one, other] = settings.map(|setting| format!("--set={setting}"));
        let call = |command: &str, more: &[&str]| {
            succeeds(&rebond(&folder, &[&[command, &scene, &one, &other], more].concat()))
        };
        let inspection: Value = serde_json::from_str(&call("inspect", &["--json"])).unwrap();
        let lowest = inspection["singular"]["lowest"].as_array().unwrap();
        assert_eq!(lowest.iter().filter(|f| **f == 0.0).count(), rigid, "{name}: {lowest:?}");
        let comparison: Value =
            serde_json::from_str(&call("compare", &["--with", "native", "--json"])).unwrap();
        assert_eq!(comparison["entries"][0]["difference"], 0.0, "{name}: {comparison}");
        call("run", &["--quiet", "--out", name]);
        let said = succeeds(&rebond(&folder, &["plot", name]));
        for picture in ["history", "contacts", "snapshots"] {
            assert!(said.contains(picture), "{name}: {said}");
            assert!(folder.join(name).join("plots").join(picture).with_extension("svg").exists());
        }
    }
}

/// Asserts that the deflections of all rows agree, relative to the largest one.
#[cfg(feature = "petsc")]
fn same_on_two_ranks(name: &str, settings: &[&str]) {
    let native = run(name, settings);
    let folder = folder(&format!("petsc-{name}"));
    let set: Vec<String> = settings.iter().map(|setting| format!("--set={setting}")).collect();
    let scene = scene(name);
    let mut arguments = vec!["run", &scene, "--quiet", "--out", "out"];
    arguments.extend(set.iter().map(String::as_str));
    succeeds(&command::on(&folder, 2, &arguments));
    let petsc = Run::read(&folder.join("out"));
    assert_eq!((petsc.rows.len(), &petsc.names), (native.rows.len(), &native.names));
    let largest = native.rows.iter().flat_map(|row| &row[10..]).fold(0.0, |most: f64, w| most.max(w.abs()));
    for (a, b) in native.rows.iter().zip(&petsc.rows) {
        for (a, b) in a[10..].iter().zip(&b[10..]) {
            assert!((a - b).abs() <= 1e-7 * largest, "{name}: {a} or {b} m");
        }
    }
}

#[test]
#[cfg(feature = "petsc")]
fn scenes_move_the_same_on_two_ranks() {
    same_on_two_ranks("rattle", &["time.end=4e-3"]);
    same_on_two_ranks("struck", &["time.end=5e-3"]);
    same_on_two_ranks("ball", &["time.end=2e-4", "mesh.cells=[12, 12]"]);
}
