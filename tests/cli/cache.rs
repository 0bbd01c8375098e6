//! Natural modes, and the compliance that they leave, kept between runs.

use crate::common::command::{self, succeeds, text};
use crate::common::models::literal;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SCENE: &str = concat!(
    literal!(PAPER_FALL),
    r#"
title = "kept modes"
mesh = { element = "fvs", cells = [6, 2] }
time = { scheme = "conserving", mass = "modal", modes = 15, step = 1e-4, end = 0.08 }
output = { checkpoint_every = 100 }
"#
);

/// Returns a folder for a test with a scene, and the empty place of its cache.
fn folder(test: &str) -> PathBuf {
    command::folder(&format!("cache-{test}"), SCENE)
}

/// Calls the command with its cache in the folder `kept`.
fn rebond(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(arguments)
        .env("REBOND_CACHE", folder.join("kept"))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// Runs the scene into a folder and returns standard error.
fn run(folder: &Path, out: &str, more: &[&str]) -> String {
    let arguments = ["run", "fall.toml", "--verbose", "--out", out, "--overwrite"];
    let output = rebond(folder, &[&arguments, more].concat());
    succeeds(&output);
    text(&output.stderr)
}

/// Returns the kept files of a kind, sorted.
fn kept_of(folder: &Path, kind: &str) -> Vec<PathBuf> {
    let Ok(entries) = fs::read_dir(folder.join("kept")) else { return Vec::new() };
    let is_of_kind = |path: &PathBuf| path.file_name().unwrap().to_str().unwrap().starts_with(kind);
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).filter(is_of_kind).collect();
    files.sort();
    files
}

/// Returns the files of kept modes, sorted.
fn kept(folder: &Path) -> Vec<PathBuf> {
    kept_of(folder, "modes-")
}

/// Asserts that two runs have the same results to the byte.
fn assert_same(folder: &Path, one: &str, other: &str) {
    for file in ["history.csv", "contacts.csv", "end.motion"] {
        let bytes = |run: &str| fs::read(folder.join(run).join(file)).unwrap();
        assert_eq!(bytes(one), bytes(other), "{file} of {one} and {other}");
    }
}

#[test]
fn a_second_run_reads_the_modes_and_has_the_same_results() {
    let folder = folder("second");
    let without = run(&folder, "without", &["--no-cache"]);
    assert!(kept(&folder).is_empty() && !without.contains("modes:"), "{without}");
    let first = run(&folder, "first", &[]);
    let [file] = &kept(&folder)[..] else { panic!("{:?}", kept(&folder)) };
    assert!(first.contains("modes: 15 of 54 dofs, kept in ") && first.contains(" kB)"), "{first}");
    assert!(first.contains(file.to_str().unwrap()), "{first}");
    let second = run(&folder, "second", &[]);
    assert!(second.contains("modes: 15 of 54 dofs, read from "), "{second}");
    assert_same(&folder, "first", "second");
    assert_same(&folder, "first", "without");
    assert!(run(&folder, "quiet", &["--quiet"]).is_empty());
    let plain = rebond(&folder, &["run", "fall.toml", "--out", "plain"]);
    succeeds(&plain);
    assert!(!text(&plain.stderr).contains("modes:"), "{}", text(&plain.stderr));
    let off = Command::new(env!("CARGO_BIN_EXE_rebond"))
        .args(["run", "fall.toml", "--out", "off"])
        .env("REBOND_CACHE", "")
        .current_dir(&folder)
        .output()
        .unwrap();
    succeeds(&off);
    assert!(!text(&off.stderr).contains("modes:"), "{}", text(&off.stderr));
    assert_same(&folder, "first", "off");

    // Other commands and schemes use the same modes.
    for command in [&["check"][..], &["inspect"], &["compare", "--with", "native"]] {
        let output = rebond(&folder, &[command, &["fall.toml"]].concat());
        succeeds(&output);
        assert!(text(&output.stderr).contains("read from "), "{command:?}: {}", text(&output.stderr));
    }
    let exact = run(&folder, "exact", &["--set", "time.scheme=exact", "--set", "time.end=0.01"]);
    assert!(exact.contains("read from ") && kept(&folder).len() == 1, "{exact}");
}

#[test]
fn what_changes_the_matrices_or_the_modes_is_not_served() {
    let folder = folder("changed");
    run(&folder, "first", &["--set", "time.end=0.01"]);
    let changes = [
        "plate.thickness=0.0100000000000001",
        "plate.density=7771",
        "plate.poissons_ratio=0.31",
        "support=[{ edge = \"left\", kind = \"simply_supported\" }, { edge = \"right\", kind = \"clamped\" }]",
        "support=[]",
        "mesh.cells=[5, 2]",
        "mesh.element=hct",
        "plate.length=1.3",
        "mass=[{ at = [0.55, 0.15], mass = 0.1 }]",
        "spring=[{ at = [0.6, 0.2], stiffness = 1e4 }]",
        "time.modes=14",
    ];
    for (number, change) in changes.iter().enumerate() {
        // A free plate cannot start from a static deflection.
        let still = if *change == "support=[]" { "initial.static_pressure=0" } else { "time.end=0.01" };
        let more = ["--set", "time.end=0.01", "--set", change, "--set", still];
        let said = run(&folder, "other", &more);
        assert!(said.contains("kept in ") && !said.contains("read from "), "{change}: {said}");
        assert_eq!(kept(&folder).len(), number + 2, "{change}");
        assert!(run(&folder, "other", &more).contains("read from "), "{change}");
    }
    // The modes do not depend on obstacles, step, start and loads.
    for change in ["obstacle=[]", "time.step=5e-5", "initial.static_pressure=100", "load.pressure=10"] {
        let said = run(&folder, "other", &["--set", "time.end=0.01", "--set", change]);
        assert!(said.contains("read from "), "{change}: {said}");
    }
}

#[test]
fn damaged_modes_are_ignored_with_a_warning_and_written_again() {
    let folder = folder("damaged");
    run(&folder, "first", &[]);
    let [file] = &kept(&folder)[..] else { panic!("{:?}", kept(&folder)) };
    let whole = fs::read(file).unwrap();
    let mut flipped = whole.clone();
    flipped[whole.len() / 2] ^= 1;
    for damaged in [&flipped[..], &whole[..whole.len() / 3], &[]] {
        fs::write(file, damaged).unwrap();
        let said = run(&folder, "again", &[]);
        assert!(said.contains("warning: ") && said.contains("damaged; the modes are computed"), "{said}");
        assert!(said.contains("kept in "), "{said}");
        assert_eq!(fs::read(file).unwrap(), whole);
        assert_same(&folder, "first", "again");
    }
}

/// A file that somebody else may have written is not read, whatever it holds, nor is a folder of
/// that kind; and modes with a right checksum that are none of the matrices are not used.
#[cfg(unix)]
#[test]
fn modes_of_others_and_wrong_ones_are_not_believed() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder("others");
    run(&folder, "first", &[]);
    let [file] = &kept(&folder)[..] else { panic!("{:?}", kept(&folder)) };
    let whole = fs::read(file).unwrap();
    let mut wrong = whole[..whole.len() - 4].to_vec();
    // The first squared frequency follows the key, two counts, the next one and a count.
    let (square, _) = wrong[16 + 2 + 8 + 1..].split_first_chunk_mut().unwrap();
    *square = (1.3 * f64::from_le_bytes(*square)).to_le_bytes();
    wrong.extend(crc32fast::hash(&wrong).to_le_bytes());
    fs::write(file, wrong).unwrap();
    let said = run(&folder, "again", &[]);
    assert!(said.contains("damaged; the modes are computed and written again"), "{said}");
    assert_eq!(fs::read(file).unwrap(), whole);
    assert_same(&folder, "first", "again");

    let place = folder.join("kept");
    for (path, mode, words) in [
        (file, 0o664, "others may write to it"),
        (file, 0o646, "others may write to it"),
        (&place, 0o775, "others may write to it"),
        (&place, 0o1777, "others may write to it"),
    ] {
        let before = fs::metadata(path).unwrap().permissions();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        let said = run(&folder, "again", &[]);
        let line = format!("warning: modes are not read from the cache: {}: {words}", path.display());
        assert!(said.contains(&line) && !said.contains("modes: 15 of 54 dofs, read"), "{said}");
        assert_same(&folder, "first", "again");
        fs::set_permissions(path, before).unwrap();
    }
    // Only the superuser can give files away.
    for path in [file, &place] {
        if std::os::unix::fs::chown(path, Some(12345), None).is_ok() {
            let said = run(&folder, "again", &[]);
            assert!(said.contains("it belongs to another user"), "{said}");
            std::os::unix::fs::chown(path, Some(0), None).unwrap();
        }
    }
}

/// A run up to 0.03 s comes near no obstacle, one to the end touches with the tip, and one over a
/// high obstacle with further nodes.
#[test]
fn the_compliance_of_nodes_in_reach_is_kept_and_extended() {
    let folder = folder("compliance");
    let high = ["--set", "obstacle=[{ side = \"below\", height = -0.05 }]"];
    let without = [&high[..], &["--no-cache"]].concat();
    run(&folder, "tip-without", &["--no-cache"]);
    run(&folder, "high-without", &without);
    run(&folder, "short", &["--set", "time.end=0.03"]);
    assert!(kept_of(&folder, "compliance-").is_empty());

    let first = run(&folder, "tip", &[]);
    let [file] = &kept_of(&folder, "compliance-")[..] else { panic!("{first}") };
    assert!(first.contains("compliance: 3 of 54 dofs, kept in "), "{first}");
    assert!(first.contains(file.to_str().unwrap()), "{first}");
    let known = fs::read(file).unwrap();
    let second = run(&folder, "again", &[]);
    assert!(second.contains("compliance: 3 of 54 dofs, read from "), "{second}");
    assert!(!second.contains("kept in") && fs::read(file).unwrap() == known, "{second}");
    let more = run(&folder, "high", &high);
    assert!(more.contains("compliance: 3 of 54 dofs, read from "), "{more}");
    assert!(more.contains(" of 54 dofs, kept in ") && fs::read(file).unwrap().len() > known.len(), "{more}");
    let all = fs::read(file).unwrap();
    let last = run(&folder, "tip-of-more", &[]);
    assert!(last.contains("compliance: ") && !last.contains("compliance: 3 of"), "{last}");
    let exact = run(&folder, "exact", &["--set", "time.scheme=exact"]);
    assert!(exact.contains("compliance: ") && !exact.contains("kept in"), "{exact}");
    assert!(fs::read(file).unwrap() == all);
    run(&folder, "exact-without", &["--set", "time.scheme=exact", "--no-cache"]);
    for name in ["tip", "again", "tip-of-more"] {
        assert_same(&folder, "tip-without", name);
    }
    assert_same(&folder, "high-without", "high");
    assert_same(&folder, "exact-without", "exact");

    let mut damaged = all.clone();
    damaged[all.len() / 2] ^= 1;
    fs::write(file, &damaged).unwrap();
    let said = run(&folder, "damaged", &high);
    assert!(said.contains("damaged; the compliance is computed and written again"), "{said}");
    assert!(fs::read(file).unwrap() == all, "{said}");
    assert_same(&folder, "high-without", "damaged");
}

/// The superuser may write anywhere, so a file takes the place of the folder.
#[test]
fn a_place_that_cannot_be_written_gives_a_warning() {
    let folder = folder("place");
    fs::write(folder.join("kept"), "no folder").unwrap();
    let said = run(&folder, "first", &[]);
    assert!(said.contains("warning: modes are not written to the cache: "), "{said}");
    assert!(said.contains("warning: compliance is not written to the cache: "), "{said}");
    assert_eq!(fs::read(folder.join("kept")).unwrap(), b"no folder");
}

#[test]
fn a_run_resumes_with_and_without_kept_modes() {
    let folder = folder("resume");
    run(&folder, "whole", &[]);
    for (name, more) in [("with", &[][..]), ("without", &["--no-cache"])] {
        run(&folder, name, &["--set", "time.end=0.06"]);
        let output = rebond(&folder, &[&["resume", name, "--verbose", "--until", "0.08"], more].concat());
        succeeds(&output);
        assert_eq!(text(&output.stderr).contains("read from "), more.is_empty());
        assert_same(&folder, "whole", name);
    }
    let output = rebond(&folder, &["plot", "whole", "--no-cache"]);
    assert_fails_as_unknown(&output);
}

/// Commands that build no model have no such option.
fn assert_fails_as_unknown(output: &Output) {
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("--no-cache"), "{}", text(&output.stderr));
}

/// Cargo's settings for this repository switch the cache off, so that no test reads or writes modes
/// in the home of its user.
#[test]
fn tests_keep_no_modes() {
    let folder = folder("tests");
    let output = command::rebond(&folder, &["run", "fall.toml", "--set", "time.end=0.01"]);
    succeeds(&output);
    assert!(!text(&output.stderr).contains("modes:"), "{}", text(&output.stderr));
}

/// Two processes that start at once both end with the same results and leave one whole file.
#[test]
fn processes_share_the_cache() {
    let folder = folder("two");
    let start = |out: &str| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_rebond"));
        command.args(["run", "fall.toml", "--quiet", "--out", out]).current_dir(&folder);
        command.env("REBOND_CACHE", folder.join("kept")).spawn().unwrap()
    };
    let mut both = ["one", "other"].map(start);
    assert!(both.iter_mut().all(|process| process.wait().unwrap().success()));
    assert_same(&folder, "one", "other");
    assert_eq!(kept(&folder).len(), 1);
    assert!(run(&folder, "third", &[]).contains("read from "));
}
