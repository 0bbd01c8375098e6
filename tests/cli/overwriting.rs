//! No command overwrites results that somebody may want to keep, unless asked to.

use crate::common::command;
use crate::common::command::{assert_fails, rebond, succeeds};
use crate::common::models::{CLAMPED, PAPER_SECTION, literal};
use rustix::fs::{CWD, Mode, mkfifoat};
use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

const SCENE: &str = concat!(
    "title = \"a short fall\"\n",
    literal!(PAPER_START),
    r#"
mesh = { element = "fvs", cells = [2, 2] }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 2e-3 }
output = { every = 10, fields_every = 10, probes = [{ name = "corner", at = [1.2, 0.0] }] }
"#
);

fn folder(test: &str) -> PathBuf {
    command::folder(&format!("overwriting-{test}"), SCENE)
}

const RUN: [&str; 5] = ["run", "fall.toml", "--quiet", "--out", "run"];

/// Returns all files of a folder with their bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    found
}

/// Asserts that a command refuses with some words, and that a folder keeps its contents.
fn assert_refused(folder: &Path, kept: &str, arguments: &[&str], code: i32, words: &[&str]) {
    let before = files(&folder.join(kept));
    assert_fails(&rebond(folder, arguments), code, words);
    assert!(files(&folder.join(kept)) == before, "{arguments:?} changed {kept}");
}

#[test]
fn only_the_same_scene_replaces_a_finished_run_unasked() {
    let folder = folder("finished");
    succeeds(&rebond(&folder, &RUN));
    succeeds(&rebond(&folder, &["plot", "run"]));
    // The same scene may overwrite its results, whatever the name of its file.
    fs::copy(folder.join("fall.toml"), folder.join("same.toml")).unwrap();
    succeeds(&rebond(&folder, &["run", "same.toml", "--quiet", "--out", "run"]));
    assert!(!folder.join("run/plots/phase.svg").exists(), "pictures of the run before are gone");
    let other = [&RUN[..], &["--set", "time.step=2e-4"]].concat();
    let words = [
        "run holds the results of another scene (time.step: 0.0001 there, 0.0002 here)",
        "--out DIR",
        "--overwrite",
    ];
    assert_refused(&folder, "run", &other, 2, &words);
    succeeds(&rebond(&folder, &[&other[..], &["--overwrite"]].concat()));
    assert_refused(&folder, "run", &RUN, 2, &["another scene"]);
    // An unreadable summary prevents overwriting too.
    fs::write(folder.join("run/summary.json"), "{").unwrap();
    assert_refused(&folder, "run", &other, 2, &["another scene", "--overwrite"]);
    // Without a summary the origin of the results is unknown.
    fs::remove_file(folder.join("run/summary.json")).unwrap();
    assert_refused(&folder, "run", &other, 2, &["results without a summary", "history.csv", "--overwrite"]);
    succeeds(&rebond(&folder, &[&other[..], &["--overwrite"]].concat()));
}

#[test]
fn a_changed_mesh_file_is_another_scene() {
    let folder = folder("mesh");
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/gmsh/square_41_text.msh");
    let mesh = fs::read_to_string(data).unwrap();
    fs::write(folder.join("plate.msh"), &mesh).unwrap();
    let scene = format!(
        "plate = {{ {PAPER_SECTION} }}\n\
         mesh.file = \"plate.msh\"\n\
         {CLAMPED}\
         time = {{ scheme = \"newmark\", mass = \"singular\", step = 1e-3, end = 2e-3 }}\n"
    );
    fs::write(folder.join("fall.toml"), scene).unwrap();
    succeeds(&rebond(&folder, &RUN));
    succeeds(&rebond(&folder, &RUN));
    fs::write(folder.join("plate.msh"), mesh + "\n").unwrap();
    assert_refused(&folder, "run", &RUN, 2, &["another scene"]);
}

#[test]
fn files_of_others_are_named_and_left_alone() {
    let folder = folder("foreign");
    fs::create_dir_all(folder.join("mine/notes")).unwrap();
    fs::write(folder.join("mine/thesis.tex"), "years").unwrap();
    fs::write(folder.join("mine/history.csv"), "of Rome").unwrap();
    for more in [&[][..], &["--overwrite"]] {
        let run = [&["run", "fall.toml", "--out", "mine"], more].concat();
        assert_refused(&folder, "mine", &run, 2, &["mine holds notes, which no run writes", "--out DIR"]);
    }
    let run = ["run", "fall.toml", "--out", "."];
    assert_refused(&folder, ".", &run, 2, &[". holds fall.toml, which no run writes"]);
    let figures = ["figures", "--out", "mine"];
    assert_refused(&folder, "mine", &figures, 2, &["mine holds history.csv, which no figure writes"]);
    let study = ["study", "fall.toml", "--out", "mine"];
    assert_refused(
        &folder,
        "mine",
        &study,
        2,
        &["mine holds history.csv, which no study writes", "--out DIR"],
    );
    let inspect = ["inspect", "fall.toml", "--matrices", "mine"];
    assert_refused(
        &folder,
        "mine",
        &inspect,
        2,
        &["mine holds history.csv, which no matrices", "--matrices DIR"],
    );
}

#[test]
fn matrices_of_another_scene_are_kept() {
    let folder = folder("matrices");
    let inspect = ["inspect", "fall.toml", "--quiet", "--matrices", "out"];
    succeeds(&rebond(&folder, &inspect));
    succeeds(&rebond(&folder, &inspect));
    let other = [&inspect[..], &["--set", "plate.thickness=0.02"]].concat();
    assert_refused(&folder, "out", &other, 2, &["out holds the matrices of another scene", "--overwrite"]);
    succeeds(&rebond(&folder, &[&other[..], &["--overwrite"]].concat()));
}

#[test]
fn the_study_of_another_scene_is_kept() {
    let folder = folder("study");
    let more =
        ["--schemes", "newmark", "--masses", "singular", "--steps", "2e-4,1e-4", "--repeat", "1", "--quiet"];
    let study = [&["study", "fall.toml", "--out", "out", "--set", "time.end=4e-3"], &more[..]].concat();
    succeeds(&rebond(&folder, &study));
    succeeds(&rebond(&folder, &study));
    let other = [&study[..], &["--set", "plate.thickness=0.02"]].concat();
    assert_refused(&folder, "out", &other, 2, &["out holds the study of another scene", "--fresh"]);
    succeeds(&rebond(&folder, &[&other[..], &["--fresh"]].concat()));
}

#[test]
fn a_refusal_leaves_no_folder_and_resume_no_history() {
    let folder = folder("traces");
    let run = ["run", "fall.toml", "--out", "some/where", "--set", "support=[]"];
    assert_fails(&rebond(&folder, &run), 2, &["static_pressure"]);
    assert!(!folder.join("some").exists());
    assert_fails(&rebond(&folder, &["resume", "some"]), 4, &["some: no checkpoint"]);
    fs::create_dir(folder.join("empty")).unwrap();
    assert_refused(&folder, "empty", &["resume", "empty"], 4, &["empty: no checkpoint"]);
    assert!(!folder.join("some").exists() && files(&folder.join("empty")).is_empty());
}

/// A link is not followed, so that no other file is overwritten, and no pipe is waited for.
#[cfg(unix)]
#[test]
fn links_and_pipes_in_a_folder_are_refused() {
    let folder = folder("links");
    let run = folder.join("run");
    succeeds(&rebond(&folder, &RUN));
    let sweep = ["sweep", "fall.toml", "--quiet", "--over", "plate.width=0.3,0.4", "--period", "1e-3"];
    fs::create_dir_all(folder.join("sweeps/fall")).unwrap();
    fs::write(folder.join("letter.txt"), "mine").unwrap();
    let overwrite = [&RUN[..], &["--overwrite"]].concat();
    let [again, resume] = [&overwrite[..], &["resume", "run", "--until", "4e-3"]];
    for (name, command) in [
        (run.join(".lock"), again),
        (run.join(".lock"), resume),
        (run.join("history.csv"), again),
        (run.join("history.csv"), resume),
        (run.join("summary.json"), again),
        (folder.join("sweeps/fall/.lock"), &sweep),
        (folder.join("sweeps/fall/rows.jsonl"), &sweep),
    ] {
        let before = fs::read(&name);
        let _ = fs::remove_file(&name);
        let file = name.strip_prefix(&folder).unwrap().to_str().unwrap();
        mkfifoat(CWD, &name, Mode::RUSR | Mode::WUSR).unwrap();
        assert_fails(
            &rebond(&folder, command),
            4,
            &[&format!("{file}: a device, pipe or socket; expected a file")],
        );
        fs::remove_file(&name).unwrap();
        symlink(folder.join("letter.txt"), &name).unwrap();
        assert_fails(&rebond(&folder, command), 4, &[&format!("{file}: a symbolic link; expected a file")]);
        fs::remove_file(&name).unwrap();
        before.into_iter().for_each(|bytes| fs::write(&name, bytes).unwrap());
    }
    assert_eq!(fs::read(folder.join("letter.txt")).unwrap(), b"mine");
}
