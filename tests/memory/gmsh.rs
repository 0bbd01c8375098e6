//! Corrupted mesh files. The answer is a sound mesh or an error, within a second of processor time
//! and with memory proportional to the size of the file.

use std::path::{Path, PathBuf};

use crate::clock::processor_seconds;
use crate::{MEMORY, alone};
use proptest::prelude::*;
use proptest::sample::Index;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use rebond::Error;
use rebond::mesh::{Import, Mesh};

/// Maximum memory per byte of a file, in bytes.
const COST: usize = 64;

#[derive(Clone, Debug)]
enum Spoil {
    Truncate(Index),
    Byte(Index, u8),
    /// Number that is invalid for most counts and indices.
    Number(Index, u64),
    Remove(Index, usize),
    Repeat(Index, Index, usize),
}

fn spoil() -> impl Strategy<Value = Spoil> {
    let at = || any::<Index>();
    prop_oneof![
        1 => at().prop_map(Spoil::Truncate),
        4 => (at(), prop_oneof![any::<u8>(), b'0'..=b'9', Just(b' '), Just(b'-')]).prop_map(|(i, b)| Spoil::Byte(i, b)),
        2 => (at(), prop_oneof![Just(u64::MAX), Just(i64::MAX as u64), 0..100_000_u64]).prop_map(|(i, n)| Spoil::Number(i, n)),
        1 => (at(), 1..64_usize).prop_map(|(i, n)| Spoil::Remove(i, n)),
        1 => (at(), at(), 1..64_usize).prop_map(|(i, j, n)| Spoil::Repeat(i, j, n)),
    ]
}

fn apply(bytes: &mut Vec<u8>, spoil: &Spoil) {
    if bytes.is_empty() {
        return;
    }
    let length = bytes.len();
    match spoil {
        Spoil::Truncate(at) => bytes.truncate(at.index(length)),
        Spoil::Byte(at, byte) => *at.get_mut(bytes) = *byte,
        Spoil::Number(at, number) => {
            let at = at.index(length);
            // Replaces a whole number in text, or eight bytes of a binary file.
            let word = bytes[at..].iter().take_while(|byte| byte.is_ascii_digit()).count();
            let new = if word > 0 { number.to_string().into_bytes() } else { number.to_le_bytes().to_vec() };
            let old = if word > 0 { word } else { 8.min(length - at) };
            bytes.splice(at..at + old, new);
        }
        Spoil::Remove(at, count) => {
            let at = at.index(length);
            bytes.drain(at..length.min(at + count));
        }
        Spoil::Repeat(from, to, count) => {
            let from = from.index(length);
            let piece = bytes[from..length.min(from + count)].to_vec();
            let to = to.index(length);
            bytes.splice(to..to, piece);
        }
    }
}

fn judge(name: &str, bytes: &[u8]) -> Result<(), TestCaseError> {
    let before = MEMORY.current_usage();
    MEMORY.reset_peak_usage();
    let start = processor_seconds();
    let answer = Mesh::from_bytes(bytes, name, Import::default());
    let (seconds, memory) = (processor_seconds() - start, MEMORY.peak_usage() - before);
    prop_assert!(seconds < 1.0, "{seconds} s");
    prop_assert!(memory <= COST * bytes.len() + 4096, "{memory} bytes for a file of {}", bytes.len());
    match answer {
        Ok(mesh) => prop_assert!(mesh.check().is_ok()),
        Err(error) => prop_assert!(matches!(error, Error::Mesh(_)), "{error}"),
    }
    Ok(())
}

#[test]
fn spoilt_files_are_harmless() {
    spoilt_files(5_000, 41);
}

#[test]
#[ignore = "minutes"]
fn a_million_spoilt_files_are_harmless() {
    spoilt_files(1_000_000, 42);
}

fn spoilt_files(cases: u32, seed: u64) {
    let _alone = alone();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let folders = ["gmsh", "cards"].map(|folder| std::fs::read_dir(data.join(folder)).unwrap());
    let mut paths: Vec<_> = folders.into_iter().flatten().map(|entry| entry.unwrap().path()).collect();
    let is_mesh = |ending: &str| ["msh", "inp", "bdf"].contains(&ending);
    paths.retain(|path| path.extension().and_then(|ending| ending.to_str()).is_some_and(is_mesh));
    paths.sort();
    let read = |path: &PathBuf| (path.to_string_lossy().into_owned(), std::fs::read(path).unwrap());
    let files: Vec<(String, Vec<u8>)> = paths.iter().map(read).collect();
    let strategy = (0..files.len(), prop::collection::vec(spoil(), 0..4));
    let config =
        Config { cases, rng_seed: RngSeed::Fixed(seed), failure_persistence: None, ..Config::default() };
    let outcome = TestRunner::new(config).run(&strategy, |(file, spoils)| {
        let (name, mut bytes) = files[file].clone();
        spoils.iter().for_each(|spoil| apply(&mut bytes, spoil));
        judge(&name, &bytes)
    });
    outcome.unwrap();
}
