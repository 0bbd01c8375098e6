//! `rebond sound`: a rigid plate on springs, whose velocity and sound have closed forms; errors.

use crate::common::command::{self, assert_fails, rebond, succeeds};
use serde_json::Value;
use std::f64::consts::PI;
use std::fs;
use std::path::{Path, PathBuf};

const AMPLITUDE: f64 = 1e-4;

/// Plate of 0.2 m x 0.1 m and 27 kg/m2 that moves up and down as a rigid body, w = A cos(omega t).
fn piston(test: &str, frequency: f64, more: &str) -> PathBuf {
    let scene = format!(
        r#"
title = "a piston"
plate = {{ length = 0.2, width = 0.1, thickness = 0.01, youngs_modulus = 7e10, poissons_ratio = 0.3, density = 2700 }}
mesh = {{ element = "fvs", cells = [2, 1] }}
foundation = [{{ stiffness = "27*(2*pi*{frequency})^2" }}]
initial = {{ deflection = {AMPLITUDE} }}
time = {{ scheme = "exact", mass = "singular", step = 5e-6, end = 0.05 }}
[output]
{more}
probes = [
  {{ name = "middle", at = [0.1, 0.05] }},
  {{ name = "speed", at = [0.1, 0.05], quantity = "velocity" }},
  {{ name = "tilt", at = [0.1, 0.05], quantity = "slope_x" }},
]
"#
    );
    let folder = command::folder(&format!("cli-sound-{test}"), &scene);
    succeeds(&rebond(&folder, &["run", "fall.toml", "--quiet"]));
    folder
}

/// Makes a sound and returns its samples in its unit, with the answer.
fn sound(folder: &Path, arguments: &[&str]) -> (Vec<f64>, Value) {
    let arguments = [&["sound", "runs/fall", "--out", "sound.wav", "--json"], arguments].concat();
    let answer: Value = serde_json::from_str(&succeeds(&rebond(folder, &arguments))).unwrap();
    let scale = answer["full_scale"].as_f64().unwrap() / 32767.0;
    (samples(&folder.join("sound.wav")).iter().map(|&sample| scale * f64::from(sample)).collect(), answer)
}

/// Reads a WAV file as the specification of the format has it.
fn samples(path: &Path) -> Vec<i16> {
    let bytes = fs::read(path).unwrap();
    let number = |i: usize| u32::from_le_bytes(bytes[i..i + 4].try_into().unwrap());
    let short = |i: usize| u16::from_le_bytes(bytes[i..i + 2].try_into().unwrap());
    assert_eq!([&bytes[..4], &bytes[8..16], &bytes[36..40]], [b"RIFF" as &[u8], b"WAVEfmt ", b"data"]);
    assert_eq!((number(4) as usize, number(40) as usize), (bytes.len() - 8, bytes.len() - 44));
    assert_eq!([number(16), number(24), number(28)], [16, 44_100, 88_200]);
    assert_eq!([20, 22, 32, 34].map(short), [1, 1, 2, 16]);
    bytes[44..].chunks(2).map(|pair| i16::from_le_bytes([pair[0], pair[1]])).collect()
}

/// Returns the frequency between the first and the last upward crossing of zero, in Hz.
fn frequency(samples: &[f64]) -> f64 {
    let crossing = |i: usize| {
        let [a, b] = [samples[i], samples[i + 1]];
        (a < 0.0 && b >= 0.0).then(|| i as f64 - a / (b - a))
    };
    let crossings: Vec<f64> = (0..samples.len() - 1).filter_map(crossing).collect();
    let span = crossings[crossings.len() - 1] - crossings[0];
    (crossings.len() - 1) as f64 * 44_100.0 / span
}

#[test]
fn the_velocity_of_a_probe_has_pitch_and_size() {
    let folder = piston("pitch", 997.0, "");
    let omega = 2.0 * PI * 997.0;
    for probe in ["middle", "speed"] {
        let (samples, answer) = sound(&folder, &["--probe", probe]);
        assert!((frequency(&samples) / 997.0 - 1.0).abs() < 1e-4, "{} Hz", frequency(&samples));
        // Velocities are mirrored at the ends, where a sine has a bend.
        for (i, sample) in samples.iter().enumerate().take(2100).skip(100) {
            let exact = -AMPLITUDE * omega * (omega * i as f64 / 44_100.0).sin();
            assert!((sample - exact).abs() < 1e-4 * AMPLITUDE * omega, "{probe}, {i}: {sample}, not {exact}");
        }
        assert_eq!((answer["unit"].as_str(), samples.len()), (Some("m/s"), 2206));
    }
    let (slow, _) = sound(&folder, &["--probe", "speed", "--slow", "3"]);
    assert!((frequency(&slow) * 3.0 / 997.0 - 1.0).abs() < 1e-4 && slow.len() == 6616, "{}", slow.len());
}

/// At 44.1 kHz a vibration of 30 kHz would sound as one of 14.1 kHz.
#[test]
fn what_nobody_hears_is_removed_unless_it_is_slowed_down() {
    let folder = piston("high", 3e4, "");
    let speed = AMPLITUDE * 2.0 * PI * 3e4;
    for probe in ["middle", "speed"] {
        let (samples, _) = sound(&folder, &["--probe", probe]);
        let most = samples[100..2100].iter().fold(0.0, |most: f64, sample| most.max(sample.abs()));
        assert!(most < 1e-3 * speed, "{probe}: {most} of {speed} m/s");
    }
    let (slow, _) = sound(&folder, &["--probe", "middle", "--slow", "10"]);
    assert!((frequency(&slow) / 3e3 - 1.0).abs() < 1e-4, "{}", frequency(&slow));
    let told = succeeds(&rebond(&folder, &["sound", "runs/fall", "--probe", "speed", "--out", "a.wav"]));
    assert!(told.contains("full scale") && !told.contains("nothing above"), "{told}");
}

/// Above a rigid piston of any outline the Rayleigh integral is one over its edge: p = rho c (v(t -
/// z/c) - mean of v(t - R/c)), where the mean is over the directions to the points of the edge, at
/// the distances R.
#[test]
fn a_piston_sounds_as_the_closed_form_says() {
    let folder = piston("pressure", 997.0, "every = 1000");
    let (omega, c, z) = (2.0 * PI * 997.0, 343.0, 0.2);
    let (samples, answer) = sound(&folder, &["--at", "0.07,0.06,0.2"]);
    let velocity = |t: f64| if t > 0.0 { -AMPLITUDE * omega * (omega * t).sin() } else { 0.0 };
    let to_edge = |angle: f64| {
        let (y, x) = angle.sin_cos();
        let across = if x > 0.0 { 0.13 / x } else { -0.07 / x };
        f64::hypot(z, across.min(if y > 0.0 { 0.04 / y } else { -0.06 / y }))
    };
    let distances: Vec<f64> = (0..4000).map(|i| to_edge((f64::from(i) + 0.5) * PI / 2000.0)).collect();
    let exact = |t: f64| {
        let edge: f64 = distances.iter().map(|r| velocity(t - r / c)).sum();
        1.204 * c * (velocity(t - z / c) - edge / 4000.0)
    };
    let peak = answer["full_scale"].as_f64().unwrap();
    for (i, sample) in samples.iter().enumerate().step_by(5) {
        let (t, exact) = (i as f64 / 44_100.0, exact(i as f64 / 44_100.0));
        // The acceleration begins with a jump, around which the band is seen.
        let most = if (2e-3..0.049).contains(&t) { 2e-4 } else { 0.04 };
        assert!((sample - exact).abs() < most * peak, "{t} s: {sample}, not {exact} Pa");
    }
    let rms = answer["rms"].as_f64().unwrap();
    let level = 20.0 * (rms / 20e-6).log10();
    assert!((answer["level"].as_f64().unwrap() - level).abs() < 1e-9);

    let (below, _) = sound(&folder, &["--at", "[0.07, 0.06, -0.2]"]);
    let differ = |(a, b): (&f64, &f64)| (a + b).abs() > 1e-3 * peak;
    assert!(!samples.iter().zip(&below).any(differ), "the other side hears the opposite");
}

#[test]
fn what_makes_no_sound_is_refused_in_one_line() {
    let folder = piston("bad", 997.0, "every = 100");
    let fails = |arguments: &[&str], code: i32, words: &[&str]| {
        let arguments = [&["sound"], arguments].concat();
        assert_fails(&rebond(&folder, &arguments), code, words);
    };
    let probe = |name: &str, words: &[&str]| {
        fails(&["runs/fall", "--out", "a.wav", "--probe", name], 2, words);
    };
    probe("middl", &["middl", "did you mean middle?", "speed, tilt"]);
    probe("tilt", &["tilt", "slope_x", "middle, speed"]);
    fails(&["runs/fall", "--probe", "middle", "--out", "history.csv"], 2, &["history.csv", ".wav"]);
    fails(
        &["runs/fall", "--probe", "middle", "--out", "a.wav", "--slow", "0"],
        2,
        &["--slow", "greater than 0"],
    );
    fails(&["runs/fall", "--probe", "middle", "--out", "a.wav", "--slow", "1e6"], 2, &["--slow", "600 s"]);
    fails(&["runs", "--probe", "middle", "--out", "a.wav"], 4, &["runs/summary.json", "no run"]);
    fails(&["runs/fall", "--out", "a.wav"], 2, &["--probe NAME", "--at X,Y,Z"]);
    for (point, words) in [
        ("1,2", ["1,2", "x,y,z"]),
        ("0.1,0.05,0", ["0.1,0.05,0", "z other than 0"]),
        ("0.1,0.05,1e-4", ["100 um", "at least 1.562 mm"]),
        ("0.1,0.05,100", ["takes 291.5 ms", "nearer than 17.15 m"]),
    ] {
        fails(&["runs/fall", "--out", "a.wav", "--at", point], 2, &words);
    }
    assert!(!folder.join("a.wav").exists());

    let told = succeeds(&rebond(&folder, &["sound", "runs/fall", "--probe", "middle", "--out", "a.wav"]));
    assert!(told.contains("rows at 2 kHz: nothing above 1 kHz can be heard"), "{told}");
    let history = folder.join("runs/fall/history.csv");
    let text = fs::read_to_string(&history).unwrap();
    let spoil = |text: &str, words: &[&str]| {
        fs::write(&history, text).unwrap();
        fails(&["runs/fall", "--probe", "middle", "--out", "a.wav"], 4, words);
    };
    let lines: Vec<&str> = text.lines().collect();
    spoil(&(lines[..6].join("\n") + "\n"), &["history.csv", "5 evenly spaced rows", "output.every"]);
    spoil(
        &([&lines[..50], &lines[52..]].concat().join("\n") + "\n"),
        &["history.csv", "unevenly", "0.024 s"],
    );
    let mut numbers: Vec<&str> = lines[20].split(',').collect();
    numbers[10] = "NaN";
    let broken = numbers.join(",");
    spoil(
        &([&lines[..20], &[&broken], &lines[21..]].concat().join("\n") + "\n"),
        &["middle is NaN at t = 0.0095 s"],
    );
}
