//! Rules that the source keeps: the order of imports among modules, one meaning per name, and
//! comments that can be read alone.

mod circles;
mod names;
mod prose;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

#[path = "../common/models.rs"]
mod models;

/// Source file with its folder, its path below this folder, and its text.
struct Source {
    folder: &'static str,
    path: String,
    text: String,
}

impl Source {
    /// Returns the module of the crate's root that the file belongs to.
    fn room(&self) -> &str {
        let first = self.path.split('/').next().unwrap();
        first.strip_suffix(".rs").unwrap_or(first)
    }

    /// Returns the numbered lines that are no comments.
    fn code(&self) -> impl Iterator<Item = (usize, &str)> {
        let lines = self.text.lines().enumerate().map(|(index, line)| (index + 1, line));
        lines.filter(|(_, line)| !line.trim_start().starts_with("//"))
    }
}

fn root(folder: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)
}

/// Returns the source files below a folder of the repository, sorted by path.
fn sources_in(folder: &'static str) -> Vec<Source> {
    fn collect(folder: &'static str, below: &Path, sources: &mut Vec<Source>) {
        for entry in fs::read_dir(below).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(folder, &path, sources);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let text = fs::read_to_string(&path).unwrap();
                let path = path.strip_prefix(root(folder)).unwrap().to_str().unwrap().to_owned();
                sources.push(Source { folder, path, text });
            }
        }
    }
    let mut sources = Vec::new();
    collect(folder, &root(folder), &mut sources);
    sources.sort_by(|a, b| a.path.cmp(&b.path));
    sources
}

/// Returns the source files of the crate.
fn sources() -> Vec<Source> {
    let sources = sources_in("src");
    assert!(sources.len() > 100);
    sources
}

/// Returns the modules of the crate's root in the order of `lib.rs`, which is the order of their
/// imports.
fn order() -> Vec<String> {
    let text = fs::read_to_string(root("src").join("lib.rs")).unwrap();
    let module = |line: &str| {
        let rest = line.strip_prefix("pub mod ").or_else(|| line.strip_prefix("mod "))?;
        rest.strip_suffix(';').map(str::to_owned)
    };
    text.lines().filter_map(module).collect()
}

/// Returns the modules that a line names after `crate::`.
fn imports(line: &str) -> Vec<String> {
    let word = |text: &str| -> String {
        text.chars().take_while(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || *c == '_').collect()
    };
    let mut found = Vec::new();
    for rest in line.split("crate::").skip(1) {
        match rest.strip_prefix('{') {
            Some(group) => found.extend(group.split(['}', ',']).map(|part| word(part.trim_start()))),
            None => found.push(word(rest)),
        }
    }
    found
}

/// Returns the imports of modules that stand below the importer, one line each.
fn upward(source: &Source, order: &[String]) -> Vec<String> {
    let place = |room: &str| order.iter().position(|other| other == room);
    let Some(own) = place(source.room()) else { return Vec::new() };
    let mut found = Vec::new();
    for (number, line) in source.code() {
        for room in imports(line) {
            if place(&room).is_some_and(|other| other > own) {
                found.push(format!("src/{}:{number}: {} imports {room}", source.path, source.room()));
            }
        }
    }
    found
}

#[test]
fn a_module_imports_only_what_stands_above_it() {
    let order = order();
    assert!(order.len() > 20 && order[0] == "quantity", "{order:?}");
    let found: Vec<String> = sources().iter().flat_map(|source| upward(source, &order)).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_planted_import_is_found() {
    let planted = |path: &str, text: &str| {
        upward(&Source { folder: "src", path: path.into(), text: text.into() }, &order()).join("\n")
    };
    assert_eq!(
        planted("mesh/quality.rs", "//! crate::scene\nuse crate::scene::Scene;\n"),
        "src/mesh/quality.rs:2: mesh imports scene"
    );
    assert_eq!(
        planted("vi/kkt.rs", "use crate::{error::Result, study};"),
        "src/vi/kkt.rs:1: vi imports study"
    );
    assert_eq!(planted("cli/run.rs", "use crate::{Error, scene::Scene};"), "");
}

#[test]
fn unsafe_code_is_allowed_in_files_of_handles_only() {
    let sources = sources();
    let allowed = |source: &&Source| source.code().any(|(_, line)| line.contains("unsafe_code"));
    let allowed: Vec<&str> = sources.iter().filter(allowed).map(|source| &*source.path).collect();
    assert!(allowed.contains(&"petsc/context.rs"));
    let elsewhere = |path: &&str| !path.starts_with("petsc/") || *path == "petsc/mod.rs";
    assert_eq!(allowed.into_iter().find(elsewhere), None);
}

/// Names of types that several modules still define.
const SHARED_NAMES: &[&str] = &[
    "Axis", "Bounded", "Check", "Damping", "Entry", "Family", "Figures", "Grid", "Kind", "Line", "Method",
    "Names", "Node", "Obstacle", "Panel", "Part", "Parts", "Plan", "Probe", "Product", "Room", "Row", "Run",
    "Sample", "Search", "Seconds", "Sections", "Shape", "Solver", "State", "Study", "Support", "Table",
    "Value", "Verdict", "Window",
];

/// Returns the modules that define each type.
fn types(sources: &[Source]) -> BTreeMap<String, BTreeSet<&str>> {
    let mut types: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
    for source in sources {
        for (_, line) in source.code() {
            let mut words = line.split_whitespace().skip_while(|word| word.starts_with("pub"));
            let Some("struct" | "enum" | "trait") = words.next() else { continue };
            let name = words.next().unwrap_or_default();
            let name: String = name.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            types.entry(name).or_default().insert(source.room());
        }
    }
    types
}

#[test]
fn a_name_has_one_meaning() {
    let sources = sources();
    let types = types(&sources);
    assert!(types.len() > 300);
    let shared: BTreeMap<_, _> = types.iter().filter(|(_, rooms)| rooms.len() > 1).collect();
    let new: Vec<_> = shared.iter().filter(|(name, _)| !SHARED_NAMES.contains(&name.as_str())).collect();
    assert!(new.is_empty(), "defined in several modules: {new:?}");
    let gone: Vec<_> = SHARED_NAMES.iter().filter(|name| !shared.contains_key(&name.to_string())).collect();
    assert!(gone.is_empty(), "defined once now: {gone:?}");
}

/// Words with which no comment of an item may begin, since they need a sentence before them.
const OPENERS: [&str; 9] = ["What", "Its", "It", "As", "Of", "Those", "That", "These", "Whose"];

/// Maximum length of a comment line, in characters.
const LONGEST: usize = 100;

/// Returns the comments that break a rule, one line each.
fn riddles(source: &Source) -> Vec<String> {
    let mut found = Vec::new();
    let mut before = "";
    for (index, line) in source.text.lines().enumerate() {
        let trimmed = line.trim_start();
        let doc = trimmed.strip_prefix("///").or_else(|| trimmed.strip_prefix("//!"));
        let place = || format!("{}/{}:{}", source.folder, source.path, index + 1);
        if let Some(doc) = doc
            && !before.starts_with(&trimmed[..3])
            && let Some(first) = doc.split_whitespace().next()
            && OPENERS.contains(&first.trim_end_matches([',', ':']))
        {
            found.push(format!("{}: opens with {first:?}", place()));
        }
        // Tables, formulas and addresses cannot be broken.
        let breaks = !["|", "http", "```", "\\"].iter().any(|part| trimmed.contains(part));
        if trimmed.starts_with("//") && breaks && line.chars().count() > LONGEST {
            found.push(format!("{}: {} columns", place(), line.chars().count()));
        }
        before = trimmed;
    }
    found
}

#[test]
fn comments_can_be_read_alone() {
    let others = ["tests", "benches", "examples"].into_iter().flat_map(sources_in);
    let broken: Vec<String> =
        sources().into_iter().chain(others).flat_map(|source| riddles(&source)).collect();
    assert!(broken.is_empty(), "{}", broken.join("\n"));
}

#[test]
fn a_planted_riddle_is_found() {
    let planted =
        |text: &str| riddles(&Source { folder: "src", path: "mesh/mod.rs".into(), text: text.into() });
    assert_eq!(planted("/// What a run was.\nstruct Run;\n").len(), 1);
    assert_eq!(planted("/// Summary of a run.\n/// What follows is a second line.\nstruct Run;\n").len(), 0);
    assert_eq!(planted(&format!("// {}\n", "word ".repeat(20))).len(), 1);
}

/// Returns the words and numbers of a text.
fn tokens(text: &str) -> Vec<&str> {
    let apart = |c: char| !(c.is_alphanumeric() || "_.+-".contains(c));
    text.split(apart).filter(|token| !token.is_empty()).collect()
}

/// Returns the files that write the paper's plate, once per occurrence, as a table of a scene or in
/// Rust.
fn paper_plates(sources: &[Source]) -> Vec<String> {
    let number = |token: &str| token.parse::<f64>().ok();
    let table = tokens(models::PAPER_SECTION);
    let numbers = table.iter().copied().filter(|token| number(token).is_some());
    let call: Vec<&str> = std::iter::once("isotropic").chain(numbers).collect();
    let same = |(a, b): (&&str, &&str)| a == b || number(a).is_some_and(|a| number(b) == Some(a));
    let mut found = Vec::new();
    for source in sources {
        let words = tokens(&source.text);
        for written in [&table, &call] {
            let windows = words.windows(written.len());
            let count = windows.filter(|window| window.iter().zip(written).all(same)).count();
            found.extend(std::iter::repeat_n(format!("{}/{}", source.folder, source.path), count));
        }
    }
    found
}

/// A test, bench or example takes the plate from the test models, as a table or as a `Plate`.
#[test]
fn the_papers_plate_is_written_once() {
    let sources: Vec<Source> = ["tests", "benches", "examples"].into_iter().flat_map(sources_in).collect();
    assert_eq!(paper_plates(&sources), ["tests/common/models.rs"; 2]);
}

#[test]
fn a_planted_copy_of_the_papers_plate_is_found() {
    let planted =
        |text: String| paper_plates(&[Source { folder: "benches", path: "step.rs".into(), text }]).join("\n");
    assert_eq!(planted(format!("const PLATE: &str = \"{}\";", models::PAPER_PLATE)), "benches/step.rs");
    let table = models::PAPER_SECTION.replace(", ", "\n").replace("0.01", "1e-2");
    assert_eq!(planted(format!("r#\"\n[plate]\nlength = 1.2\n{table}\n\"#")), "benches/step.rs");
    let call = |thickness: f64| format!("Plate::isotropic({thickness}, 2.1e11, 0.3, 7770.0)");
    assert_eq!((planted(call(0.01)).as_str(), planted(call(0.02)).as_str()), ("benches/step.rs", ""));
}
