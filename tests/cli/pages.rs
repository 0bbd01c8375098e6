//! Every command and every block of the tutorial and of the recipes works as it stands.
//!
//! The words after a fence's three backticks say what a block is:
//!
//! - `sh`: commands; `sh mpi` runs where there is PETSc, `sh gmsh` where there is Gmsh, `sh python`
//!   needs the Python package, whose own tests run the tutorial's program;
//! - `toml FILE` and the like: the text of a file; `toml >> FILE` is appended to it;
//! - `text`: lines that the commands before print, among others;
//! - `rust`: code, which documentation tests run.

use crate::common::command;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

const TUTORIAL: &str = include_str!("../../docs/tutorial.md");
const RECIPES: &str = include_str!("../../docs/how-to.md");
const RUNS: &str = include_str!("../../docs/runs.md");

/// Settings of Open MPI that let root start more ranks than cores on one machine, as variables,
/// since the commands of the pages are those of a user.
const MPI: [(&str, &str); 7] = [
    ("OMPI_ALLOW_RUN_AS_ROOT", "1"),
    ("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1"),
    ("OMPI_MCA_rmaps_base_oversubscribe", "1"),
    ("PRTE_MCA_rmaps_default_mapping_policy", ":oversubscribe"),
    ("OMPI_MCA_mpi_yield_when_idle", "1"),
    ("OMPI_MCA_pml", "ob1"),
    ("OMPI_MCA_btl", "^tcp,ofi"),
];

/// Fenced block: the words of its first line, and its text.
struct Block<'p> {
    words: Vec<&'p str>,
    text: &'p str,
}

fn blocks(page: &str) -> Vec<Block<'_>> {
    let fences = page.split("\n```").skip(1).step_by(2);
    let block = |fence| {
        let (words, text) = str::split_once(fence, '\n').unwrap();
        Block { words: words.split_whitespace().collect(), text }
    };
    fences.map(block).collect()
}

/// Runs commands in a folder and returns all that they print.
fn run(folder: &Path, commands: &str) -> String {
    let program = Path::new(env!("CARGO_BIN_EXE_rebond"));
    let path = std::env::var("PATH").unwrap_or_default();
    let output = Command::new("bash")
        .args(["-e", "-c", &format!("exec 2>&1\n{commands}")])
        .env("PATH", format!("{}:{path}", program.parent().unwrap().display()))
        .env("REBOND_CACHE", folder.join("cache"))
        .env_remove("PETSC_OPTIONS")
        .envs(MPI)
        .current_dir(folder)
        .output()
        .unwrap();
    let said = command::text(&output.stdout);
    assert!(output.status.success(), "{commands}\n{said}{}", command::text(&output.stderr));
    said
}

fn squeezed(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Follows a page, or a section of one, in an empty folder. Returns the number of commands.
fn follow(page: &str, name: &str) -> usize {
    let folder: PathBuf = command::folder(&format!("page-{name}"), "");
    fs::remove_file(folder.join("fall.toml")).unwrap();
    std::os::unix::fs::symlink(Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes"), folder.join("scenes"))
        .unwrap();
    let mut count = 0;
    // Output of the last commands; `None` where they cannot run here.
    let mut said = None;
    for Block { words, text } in blocks(page) {
        match words[..] {
            ["sh"] => {
                said = Some(run(&folder, text));
                count += text.lines().count();
            }
            ["sh", "mpi"] => {
                said = cfg!(feature = "petsc").then(|| run(&folder, text));
                count += text.lines().count();
            }
            ["sh", "gmsh"] => {
                let is_there = Command::new("gmsh").arg("--version").output().is_ok();
                said = is_there.then(|| run(&folder, text));
            }
            ["sh", "python"] => said = None,
            ["text"] => {
                let Some(said) = &said else { continue };
                let all = squeezed(said);
                for line in text.lines() {
                    assert!(all.contains(&squeezed(line)), "{name}: no {line:?} in\n{said}");
                }
            }
            ["rust"] => {}
            [_, file] => fs::write(folder.join(file), text).unwrap(),
            [_, ">>", file] => {
                let mut file = OpenOptions::new().append(true).open(folder.join(file)).unwrap();
                file.write_all(text.as_bytes()).unwrap();
            }
            _ => panic!("{name}: a block of {words:?}"),
        }
    }
    count
}

#[test]
fn the_tutorial_works() {
    assert!(follow(TUTORIAL, "tutorial") > 10);
    // The drawing on the page is the one that the program has.
    let drawing = blocks(TUTORIAL).into_iter().find(|block| block.words == ["c", "bracket.geo"]).unwrap();
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/new/bracket.geo");
    assert_eq!(drawing.text.trim_end(), fs::read_to_string(own).unwrap().trim_end());
}

/// Three commands tell the largest stress at the clamp, its time, and what the stop feels.
#[test]
fn the_stress_at_the_clamp_is_as_the_page_says() {
    let section = RUNS.split("\n## ").find(|of| of.starts_with("The stress and the force in the clamp"));
    assert!(follow(section.unwrap(), "clamp") >= 3);
    let pictures = Path::new(env!("CARGO_TARGET_TMPDIR")).join("page-clamp/runs/forces/plots");
    for name in ["history.svg", "forces.svg", "extremes.svg"] {
        assert!(pictures.join(name).is_file(), "{name}");
    }
}

/// Each recipe stands alone.
#[test]
fn every_recipe_works() {
    let recipes: Vec<&str> = RECIPES.split("\n## ").skip(1).collect();
    assert!(recipes.len() >= 8);
    std::thread::scope(|scope| {
        for recipe in recipes {
            scope.spawn(move || {
                let name = recipe
                    .lines()
                    .next()
                    .unwrap()
                    .to_lowercase()
                    .replace(|c: char| !c.is_ascii_alphanumeric(), "-");
                assert!(follow(recipe, &name) > 0 || recipe.contains("```rust"), "{name}");
            });
        }
    });
}
