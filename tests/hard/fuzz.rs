//! Corrupted scenes. Whatever a file contains, the answer is a scene or one message, within a short
//! time; a scene of few cells runs or is refused with a reason.

use crate::common::Random;
use crate::common::clock::processor_seconds;
use rebond::scene::Scene;
use rebond::simulation::Model;
use rebond::{Error, Result};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Values that are invalid in most places of a scene.
const NASTY: &[&str] = &[
    "0",
    "-0.0",
    "-1",
    "1",
    "2",
    "0.3",
    "1e308",
    "-1e308",
    "1e-308",
    "5e-324",
    "inf",
    "nan",
    "9223372036854775807",
    "-9223372036854775808",
    "18446744073709551616",
    "true",
    "\"\"",
    "\"x\"",
    "\"t\"",
    "\"1/x\"",
    "\"sqrt(x - 1)\"",
    "\"x > 0\"",
    "\"sin(1e300*t)\"",
    "[]",
    "[0]",
    "[1, 1]",
    "[0.0, 0.0, 0.0]",
    "{}",
    "[[0, 1], [1, 0]]",
    "\"\\u0000\"",
    "1979-05-27",
    "0x7fffffff",
    "\"exact\"",
    "\"conserving\"",
    "\"midpoint\"",
    "\"consistent\"",
    "\"hct\"",
    "\"guided\"",
    "\"above\"",
    "1e-12",
    "1e12",
];

/// Number of cells up to which a scene is run.
const MOST_CELLS: usize = 24;

/// Processor time that an answer may take, in s. The slowest refusal, that of a pressure `1/x`
/// whose integral no refinement determines, takes 0.7 s, and half as much again where the other
/// threads of a core are busy.
const PATIENCE: f64 = 5.0;

fn seeds() -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files: Vec<PathBuf> = Vec::new();
    let mut folders = vec![root.join("scenes")];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "toml") {
                files.push(path);
            }
        }
    }
    files.sort();
    files.iter().map(|file| std::fs::read(file).unwrap()).collect()
}

/// Returns the positions of the values in a text: after `=`, up to the end of the line or a comma,
/// brace or bracket.
fn values(text: &str) -> Vec<std::ops::Range<usize>> {
    let mut found = Vec::new();
    let mut from = 0;
    while let Some(at) = text[from..].find('=') {
        let start = from + at + 1;
        let end = text[start..].find([',', '}', '\n', '#']).map_or(text.len(), |end| start + end);
        found.push(start..end);
        from = end.max(start);
    }
    found
}

/// Corrupts a scene in one way.
fn spoil(scene: &mut Vec<u8>, others: &[Vec<u8>], random: &mut Random) {
    if scene.is_empty() {
        return;
    }
    let at = random.below(scene.len());
    match random.below(10) {
        0 => scene.truncate(at),
        1 => scene[at] = random.below(256) as u8,
        2 => scene.insert(at, b"\"'[]{}=.,#\n\\-e0"[random.below(15)]),
        3 => drop(scene.drain(at..(at + 1 + random.below(40)).min(scene.len()))),
        // Inserts a line of this scene, or of another one, anywhere.
        4 | 5 => {
            let other =
                if random.below(2) == 0 { scene.clone() } else { others[random.below(others.len())].clone() };
            let lines: Vec<&[u8]> = other.split(|byte| *byte == b'\n').collect();
            let line = [lines[random.below(lines.len())], b"\n"].concat();
            let place = scene[..at].iter().rposition(|byte| *byte == b'\n').map_or(0, |end| end + 1);
            drop(scene.splice(place..place, line));
        }
        // Replaces a value by an unexpected one.
        _ => {
            let Ok(text) = str::from_utf8(scene) else { return };
            let values = values(text);
            if !values.is_empty() {
                let range = values[random.below(values.len())].clone();
                drop(scene.splice(range, format!(" {}", NASTY[random.below(NASTY.len())]).into_bytes()));
            }
        }
    }
}

/// Reads a scene, and runs three steps of it if it is small.
fn run_scheme(bytes: &[u8]) -> Result<()> {
    let scene = Scene::from_bytes(bytes, "spoilt.toml", &[])?;
    let resolved = scene.resolved();
    let again = Scene::from_str(&resolved, "spoilt.toml", &[])?;
    assert!(again == scene, "it does not read back:\n{resolved}");
    let cells = (scene.mesh.cells[0] * scene.mesh.cells[1]) << (2 * scene.mesh.refine.min(8));
    if scene.file.is_some() || cells > MOST_CELLS {
        return Ok(());
    }
    let model = Model::new(&scene)?;
    let mut scheme = model.scheme(&scene)?;
    for _ in 0..3 {
        scheme.advance()?;
        scheme.energies()?;
    }
    Ok(())
}

fn judge(bytes: &[u8]) {
    let start = processor_seconds();
    let answer = catch_unwind(AssertUnwindSafe(|| run_scheme(bytes)));
    let took = processor_seconds() - start;
    let shown = || String::from_utf8_lossy(bytes).into_owned();
    assert!(answer.is_ok(), "a panic for\n{}", shown());
    assert!(took < PATIENCE, "{took} s for\n{}", shown());
    if let Ok(Err(error)) = answer {
        let said = error.to_string();
        assert!(!said.is_empty() && !said.contains('\n'), "{said:?} for\n{}", shown());
        assert!((2..=5).contains(&error.exit_code()), "{said}");
        let internal = matches!(error, Error::Unfinished(_) | Error::Petsc(_));
        assert!(!internal, "{said} for\n{}", shown());
    }
}

fn spoilt_scenes(cases: usize, seed: u64) {
    let seeds = seeds();
    let mut random = Random::new(seed);
    for _ in 0..cases {
        let mut scene = seeds[random.below(seeds.len())].clone();
        for _ in 0..1 + random.below(3) {
            spoil(&mut scene, &seeds, &mut random);
        }
        judge(&scene);
    }
}

#[test]
fn spoilt_scenes_are_harmless() {
    spoilt_scenes(5_000, 1);
}

#[test]
fn more_spoilt_scenes_are_harmless() {
    spoilt_scenes(5_000, 2);
}

#[test]
#[ignore = "minutes"]
fn a_million_spoilt_scenes_are_harmless() {
    std::thread::scope(|scope| {
        for seed in 0..4 {
            scope.spawn(move || spoilt_scenes(250_000, 100 + seed));
        }
    });
}
