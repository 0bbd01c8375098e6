//! Imports among the files of the crate, which run in one direction.
//!
//! An import leads from a file to the file that *defines* a name: re-exports are followed to their
//! end. A parent that declares its children and passes on their names imports nothing by that, and
//! a file that takes such a name from the parent imports the child. A parent that *uses* a child
//! imports it, and a child that takes what its parent defines imports the parent, so that both
//! together are a circle. Names are seen, methods are not.
//!
//! In the folders of [`HEADS`] the parent has both the words that its children share and the
//! functions that compose them. There the imports of the parent by files below it do not count.

use super::{Source, sources};
use std::collections::{BTreeMap, BTreeSet};

/// Parents that their children may import although they use their children.
const HEADS: &[&str] =
    &["field/mod.rs", "scheme/mod.rs", "scheme/newmark.rs", "study/accuracy/mod.rs", "vi/mod.rs"];

/// Names along a path, such as `["crate", "mesh", "Mesh"]`; those of a module lead from the root.
type Names = Vec<String>;

/// Imported names with one origin, by importer and origin.
type Imports<'f> = BTreeMap<&'f str, BTreeMap<&'f str, BTreeSet<String>>>;

/// Returns the text of a file without comments, strings and characters.
pub(super) fn bare(text: &str) -> String {
    let mut bare = String::new();
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let is_in_word = bare.ends_with(|c: char| c.is_alphanumeric());
        let raw = rest.strip_prefix('r').map(|rest| rest.trim_start_matches('#'));
        let end = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if let (Some(raw), false) = (raw.filter(|raw| raw.starts_with('"')), is_in_word) {
            let begin = rest.len() - raw.len() + 1;
            let close = format!("\"{}", "#".repeat(begin - 2));
            begin + rest[begin..].find(&close).unwrap() + close.len()
        } else if first == '"' {
            let mut is_escaped = false;
            let closes = |c: char| {
                let closes = c == '"' && !is_escaped;
                is_escaped = c == '\\' && !is_escaped;
                closes
            };
            2 + rest[1..].find(closes).unwrap()
        } else if rest.starts_with("'\\") {
            4 + rest[3..].find('\'').unwrap()
        } else if first == '\'' && rest.chars().nth(2) == Some('\'') {
            rest.char_indices().nth(3).map_or(rest.len(), |(end, _)| end)
        } else {
            bare.push(first);
            rest = &rest[first.len_utf8()..];
            continue;
        };
        bare.push(' ');
        rest = &rest[end..];
    }
    bare
}

/// Splits code into words, `::` and single signs.
pub(super) fn tokens(code: &str) -> Vec<&str> {
    let is_in_word = |c: char| c.is_alphanumeric() || c == '_';
    let mut tokens = Vec::new();
    let mut rest = code.trim_start();
    while let Some(first) = rest.chars().next() {
        let end = match first {
            _ if is_in_word(first) => rest.find(|c| !is_in_word(c)).unwrap_or(rest.len()),
            _ if rest.starts_with("::") => 2,
            _ => first.len_utf8(),
        };
        tokens.push(&rest[..end]);
        rest = rest[end..].trim_start();
    }
    tokens
}

/// Reads the tree of a `use` as pairs of a declared name and the path behind it, and returns the
/// tokens after the tree.
fn read_use<'t, 'c>(
    mut tokens: &'t [&'c str],
    before: &[String],
    found: &mut Vec<(String, Names)>,
) -> &'t [&'c str] {
    let mut path = before.to_vec();
    loop {
        match *tokens {
            ["{", ref rest @ ..] => {
                tokens = rest;
                while tokens[0] != "}" {
                    tokens = read_use(tokens, &path, found);
                    tokens = tokens.strip_prefix(&[","]).unwrap_or(tokens);
                }
                return &tokens[1..];
            }
            ["as", name, ref rest @ ..] => {
                found.push((name.into(), path));
                return rest;
            }
            ["," | "}" | ";", ..] => {
                found.push((path.last().unwrap().clone(), path));
                return tokens;
            }
            ["self", ref rest @ ..] if !path.is_empty() => tokens = rest,
            ["::", ref rest @ ..] => tokens = rest,
            [word, ref rest @ ..] => {
                path.push(word.into());
                tokens = rest;
            }
            [] => panic!("a use without an end"),
        }
    }
}

/// Modules, names and paths of a file.
struct File<'s> {
    path: &'s str,
    module: Names,
    children: BTreeSet<String>,
    /// Path behind each name that a `use` declares.
    uses: BTreeMap<String, Names>,
    /// Paths that the file mentions, those of re-exports apart.
    mentions: Vec<Names>,
}

impl File<'_> {
    fn read(source: &Source) -> File<'_> {
        let stem = source.path.trim_end_matches(".rs").trim_end_matches("/mod");
        let module = if stem == "lib" { Vec::new() } else { stem.split('/').map(str::to_owned).collect() };
        let (children, uses) = (BTreeSet::new(), BTreeMap::new());
        let mut file = File { path: &source.path, module, children, uses, mentions: Vec::new() };
        let code = bare(&source.text);
        let tokens = tokens(&code);
        let mut rest = &tokens[..];
        let mut before = "";
        // Open braces, each with whether it begins a module within the file.
        let mut braces = Vec::new();
        while let [token, after @ ..] = rest {
            let here = tokens.len() - rest.len();
            rest = after;
            let inner = braces.iter().filter(|is_module| **is_module).count();
            match (*token, after) {
                ("{", _) => braces.push(here > 1 && tokens[here - 2] == "mod"),
                ("}", _) => drop(braces.pop()),
                ("mod", [name, ";", ..]) => drop(file.children.insert((*name).into())),
                ("use", [next, ..]) if *next != "<" => {
                    let mut found = Vec::new();
                    rest = read_use(after, &[], &mut found);
                    for (name, path) in found {
                        let path = leave(inner, path);
                        if !matches!(before, "pub" | ")") {
                            file.mentions.push(path.clone());
                        }
                        if inner == 0 {
                            file.uses.insert(name, path);
                        }
                    }
                }
                (word, ["::", ..]) if is_name(word) && before != "." => {
                    let mut path = vec![word.to_owned()];
                    while let ["::", word, after @ ..] = rest
                        && is_name(word)
                    {
                        path.push((*word).into());
                        rest = after;
                    }
                    file.mentions.push(leave(inner, path));
                }
                // Names that the file re-exports and uses itself are mentioned as bare words.
                (word, _) if is_name(word) && !matches!(before, "." | "::" | "fn") => {
                    let is_called = after.first() == Some(&"(");
                    if is_called || word.starts_with(char::is_uppercase) {
                        file.mentions.push(vec![word.to_owned()]);
                    }
                }
                _ => {}
            }
            before = token;
        }
        file
    }
}

/// Returns whether a token is a name rather than a sign or a number.
fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Rewrites a path in a module within a file, so many modules deep, as one of the file.
fn leave(inner: usize, mut path: Names) -> Names {
    for _ in 0..inner {
        if path[0] == "super" {
            let is_next = path.get(1).is_some_and(|next| next == "super");
            if is_next { drop(path.remove(0)) } else { path[0] = "self".into() }
        }
    }
    path
}

/// Crate as a tree of modules.
struct Tree<'s>(BTreeMap<Names, File<'s>>);

impl<'s> Tree<'s> {
    fn read(sources: &'s [Source]) -> Tree<'s> {
        let of_crate = sources.iter().filter(|source| source.path != "main.rs");
        Tree(of_crate.map(File::read).map(|file| (file.module.clone(), file)).collect())
    }

    /// Returns the file that defines what a path in a file names, and its name there; `None` for a
    /// module and for names from outside.
    fn origin(&self, file: &File, path: &[String], depth: usize) -> Option<(&'s str, String)> {
        let ups = path.iter().take_while(|name| *name == "super").count();
        let (module, rest) = match path.first()?.as_str() {
            "crate" => (Vec::new(), &path[1..]),
            "self" => (file.module.clone(), &path[1..]),
            "super" => (file.module[..file.module.len() - ups].to_vec(), &path[ups..]),
            name if file.children.contains(name) || file.uses.contains_key(name) => {
                (file.module.clone(), path)
            }
            _ => return None,
        };
        let file = self.0.get(&module)?;
        let name = rest.first()?;
        if file.children.contains(name) {
            let child = self.0.get(&[&module[..], std::slice::from_ref(name)].concat())?;
            return self.origin(child, &[&["self".to_owned()], &rest[1..]].concat(), depth);
        }
        match file.uses.get(name) {
            // A name may be that of a crate, which a path of itself declares.
            Some(behind) if depth < 20 => {
                let path = [&behind[..], &rest[1..]].concat();
                (behind[0] != *name).then(|| self.origin(file, &path, depth + 1)).flatten()
            }
            Some(_) => panic!("{path:?} leads to no end"),
            None => Some((file.path, name.clone())),
        }
    }

    /// Returns all imports but those of the given heads by files below them.
    fn imports(&self, heads: &[&str]) -> Imports<'s> {
        let mut imports = Imports::new();
        for file in self.0.values() {
            for path in &file.mentions {
                let Some((origin, name)) = self.origin(file, path, 0) else { continue };
                let folder = origin.trim_end_matches(".rs").trim_end_matches("mod").trim_end_matches('/');
                let is_below = file.path.strip_prefix(folder).is_some_and(|rest| rest.starts_with('/'));
                if origin != file.path && !(is_below && heads.contains(&origin)) {
                    imports.entry(file.path).or_default().entry(origin).or_default().insert(name);
                }
            }
        }
        imports
    }
}

/// Returns a circle of imports, one line per import; `None` where there is none.
fn circle(mut imports: Imports) -> Option<Vec<String>> {
    // Files that import nothing but files without a circle are in none themselves.
    loop {
        let left: BTreeSet<&str> = imports.keys().copied().collect();
        imports.values_mut().for_each(|of| of.retain(|origin, _| left.contains(origin)));
        imports.retain(|_, of| !of.is_empty());
        if imports.len() == left.len() {
            break;
        }
    }
    let mut way = vec![*imports.keys().next()?];
    let begin = loop {
        let (next, _) = imports[way.last()?].first_key_value()?;
        if let Some(begin) = way.iter().position(|file| file == next) {
            way.push(next);
            break begin;
        }
        way.push(next);
    };
    let line = |pair: &[&str]| {
        let names: Vec<&str> = imports[pair[0]][pair[1]].iter().map(String::as_str).collect();
        format!("{} imports {} from {}", pair[0], names.join(", "), pair[1])
    };
    Some(way[begin..].windows(2).map(line).collect())
}

#[test]
fn files_import_each_other_in_one_direction() {
    let sources = sources();
    let tree = Tree::read(&sources);
    let imports = tree.imports(HEADS);
    assert!(imports.values().map(BTreeMap::len).sum::<usize>() > 500);
    assert_eq!(circle(imports), None);
    for head in HEADS {
        let others: Vec<&str> = HEADS.iter().copied().filter(|other| other != head).collect();
        assert!(circle(tree.imports(&others)).is_some(), "{head} is in no circle now: take it out of HEADS");
    }
}

#[test]
fn a_planted_circle_is_found() {
    let circle_of = |files: &[(&str, &str)], heads: &[&str]| {
        let source = |&(path, text): &(&str, &str)| Source {
            folder: "src",
            path: path.to_owned(),
            text: text.to_owned(),
        };
        let sources: Vec<Source> = files.iter().map(source).collect();
        circle(Tree::read(&sources).imports(heads)).map(|lines| lines.join("\n"))
    };
    let root = ("lib.rs", "pub mod mesh; pub mod field; pub use mesh::Mesh;");
    // By way of a re-export, a module's name and a group.
    let planted = [
        root,
        ("mesh/mod.rs", "mod cells; mod names; pub use cells::Cell; pub use names::Name; pub struct Mesh;"),
        ("mesh/cells.rs", "use super::names; pub struct Cell(names::Name);"),
        ("mesh/names.rs", "use crate::{mesh::{Cell, Mesh as Of}}; pub struct Name(Cell, Of);"),
        ("field.rs", "use crate::Mesh; pub struct Field(Mesh);"),
    ];
    assert_eq!(
        circle_of(&planted, &[]).as_deref(),
        Some("mesh/cells.rs imports Name from mesh/names.rs\nmesh/names.rs imports Cell from mesh/cells.rs")
    );
    // Neither comments, strings nor re-exports import, and a module within a file is the file.
    let straight = [
        root,
        ("mesh/mod.rs", "mod cells; pub use cells::Cell; pub struct Mesh; /* no */ // use cells::Cell;"),
        ("mesh/cells.rs", "use super::Mesh; pub struct Cell(Mesh); mod tests { use super::*; }"),
        ("field.rs", "const ONE: &str = \"\\\"crate::mesh::Cell\"; fn f() -> usize { crate::Mesh::size() }"),
    ];
    assert_eq!(circle_of(&straight, &[]), None);
    // A parent that uses its child is a circle, unless it is known as a head.
    for parent in [
        "mod cells; pub struct Mesh; fn all() { cells::count() }",
        "mod cells; pub use cells::count; pub struct Mesh; fn all() { count() }",
    ] {
        let head = [
            root,
            ("mesh/mod.rs", parent),
            ("mesh/cells.rs", "use super::Mesh; pub fn count() {}"),
            ("field.rs", ""),
        ];
        assert_eq!(
            circle_of(&head, &[]).as_deref(),
            Some("mesh/cells.rs imports Mesh from mesh/mod.rs\nmesh/mod.rs imports count from mesh/cells.rs")
        );
        assert_eq!(circle_of(&head, &["mesh/mod.rs"]), None);
    }
}
