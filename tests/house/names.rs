//! Names of locals are nouns: words that tell nothing about a value name none.

use super::circles::{bare, tokens};
use super::{Source, sources};
use std::collections::BTreeSet;

/// Words that name no local. In a file that speaks of `right`, `left` is a side.
const VAGUE: [&str; 7] = ["all", "at", "found", "known", "left", "of", "own"];

/// Returns the vague names of locals in a file.
///
/// Fields, functions and the parts of a path may have these names.
fn vague_names(source: &Source) -> BTreeSet<&'static str> {
    let code = bare(&source.text);
    let tokens = tokens(&code);
    let token = |i: Option<usize>| i.and_then(|i| tokens.get(i)).copied().unwrap_or_default();
    let mut open = Vec::new();
    let mut vague = BTreeSet::new();
    for i in 0..tokens.len() {
        let [before, word, after] = [token(i.checked_sub(1)), tokens[i], token(Some(i + 1))];
        match word {
            "(" | "[" | "{" => open.push(word),
            ")" | "]" | "}" => drop(open.pop()),
            _ => {}
        }
        let Some(name) = VAGUE.iter().find(|name| **name == word) else { continue };
        let is_in_braces = open.last() == Some(&"{");
        let is_bound = ["let", "mut", "|"].contains(&before);
        let is_part = [".", "::", "fn"].contains(&before) || after == "::";
        let is_called = after == "(" && !is_bound;
        let is_field = after == ":" && is_in_braces && !is_bound;
        let is_short_field = is_in_braces && ["{", ","].contains(&before) && [",", "}"].contains(&after);
        let is_side = word == "left" && tokens.contains(&"right");
        if !(is_part || is_called || is_field || is_short_field || is_side) {
            vague.insert(*name);
        }
    }
    vague
}

#[test]
fn locals_have_names_that_tell_what_they_are() {
    let place = |source: &Source, name| format!("src/{}: {name}", source.path);
    let vague = sources()
        .into_iter()
        .flat_map(|source| vague_names(&source).into_iter().map(move |name| place(&source, name)));
    let vague: Vec<String> = vague.collect();
    assert!(vague.is_empty(), "expected nouns in place of these names of locals:\n{}", vague.join("\n"));
}

#[test]
fn planted_vague_names_are_found() {
    let planted = |text: &str| {
        let source = Source { folder: "src", path: "mesh/mod.rs".into(), text: text.into() };
        vague_names(&source).into_iter().collect::<Vec<_>>().join(" ")
    };
    assert_eq!(planted("let own = 1;"), "own");
    assert_eq!(planted("fn value(at: f64) -> f64 { at }"), "at");
    assert_eq!(planted("texts.map(|of| of.len())"), "of");
    assert_eq!(planted("for (known, _) in pairs { push(known) }"), "known");
    assert_eq!(planted("let left = total - done;"), "left");
    assert_eq!(planted("let [left, right] = ends;"), "");
    assert_eq!(planted("let own = Family::of(self.known.at(0)); // all that is found"), "own");
    assert_eq!(planted("Probe { at: [0.0; 2], own, text: \"of all\" }"), "");
}
