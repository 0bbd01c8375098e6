//! Rules that pages and messages keep: links lead somewhere, no word stands twice, words are spelt
//! as in Britain, and a section of the README fits a screen.

use super::{Source, root, sources_in};
use std::fs;
use std::path::{Path, PathBuf};

/// Longest section of the README, in lines.
const SCREEN: usize = 45;

/// American beginnings of words that the pages and comments spell otherwise.
const AMERICAN: [&str; 18] = [
    "behavior",
    "neighbor",
    "favor",
    "centered",
    "minimiz",
    "maximiz",
    "optimiz",
    "normaliz",
    "organiz",
    "recogniz",
    "initializ",
    "discretiz",
    "modeled",
    "modeling",
    "labeled",
    "canceled",
    "millimeter",
    "fulfills",
];

/// Words that rightly stand twice, as in "all that that says".
const TWICE: [&str; 2] = ["that", "had"];

/// Page in Markdown with its path below the repository.
struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    /// Returns the numbered lines outside fenced blocks, without code between backticks.
    fn prose(&self) -> Vec<(usize, String)> {
        let mut is_fenced = false;
        let mut lines = Vec::new();
        for (index, line) in self.text.lines().enumerate() {
            if line.starts_with("```") {
                is_fenced = !is_fenced;
            } else if !is_fenced {
                let words: String = line.split('`').step_by(2).collect::<Vec<_>>().join("`");
                lines.push((index + 1, words));
            }
        }
        lines
    }

    fn place(&self, line: usize) -> String {
        format!("{}:{line}", self.path.display())
    }
}

fn pages() -> Vec<Page> {
    let folders = ["", "docs", "python"];
    let files = folders.iter().flat_map(|folder| fs::read_dir(root(folder)).unwrap());
    let mut paths: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    paths.sort();
    let base = root("");
    let page = |path: PathBuf| Page {
        text: fs::read_to_string(&path).unwrap(),
        path: path.strip_prefix(&base).unwrap().into(),
    };
    paths.into_iter().map(page).collect()
}

/// Returns the places in a page that links can name: its headings, and `<a id="name">`.
fn anchors(text: &str) -> Vec<String> {
    let headings = text.lines().filter(|line| line.starts_with('#'));
    let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
    let anchor = |line: &str| {
        let name = line.trim_start_matches('#').trim().to_lowercase();
        name.chars().filter(kept).collect::<String>().replace(' ', "-")
    };
    let named = text.split("<a id=\"").skip(1).filter_map(|rest| rest.split('"').next());
    headings.map(anchor).chain(named.map(str::to_owned)).collect()
}

/// Returns the links of a page that lead nowhere, one line each.
fn broken_links(page: &Page) -> Vec<String> {
    let folder = page.path.parent().unwrap_or(Path::new(""));
    let mut found = Vec::new();
    for (number, line) in page.prose() {
        let targets = line.split("](").skip(1).chain(line.split("src=\"").skip(1));
        for target in targets.map(|rest| rest.split([')', '"']).next().unwrap_or_default()) {
            if target.contains("://") || target.is_empty() {
                continue;
            }
            let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
            let path = root("").join(folder).join(file);
            let (exists, text) = match file {
                "" => (true, page.text.clone()),
                _ => (path.exists(), fs::read_to_string(&path).unwrap_or_default()),
            };
            let has_anchor = || anchors(&text).iter().any(|own| own == anchor);
            if !exists || !(anchor.is_empty() || has_anchor()) {
                found.push(format!("{}: {target} leads nowhere", page.place(number)));
            }
        }
    }
    found
}

/// Returns the faults of spelling in a line of prose.
fn faults(line: &str) -> Vec<String> {
    let words: Vec<String> = line.split_whitespace().map(str::to_lowercase).collect();
    let is_word =
        |word: &str| word.len() > 1 && word.chars().all(char::is_alphabetic) && !TWICE.contains(&word);
    let twice = words.windows(2).filter(|pair| pair[0] == pair[1] && is_word(&pair[0]));
    let twice = twice.map(|pair| format!("{0} {0}", pair[0]));
    let bare = words.iter().map(|word| word.trim_matches(|c: char| !c.is_alphabetic()));
    let american = bare.filter(|word| AMERICAN.iter().any(|start| word.starts_with(start)));
    twice.chain(american.map(|word| format!("{word} is American"))).collect()
}

/// Returns the comments of a source, line by line, without code between backticks.
fn comments(source: &Source) -> impl Iterator<Item = (usize, String)> {
    let comment = |(index, line): (usize, &str)| {
        let text = line.trim_start();
        let is_comment = text.starts_with("//") && !text.contains("```");
        is_comment.then(|| (index + 1, text.split('`').step_by(2).collect::<Vec<_>>().join("`")))
    };
    source.text.lines().enumerate().filter_map(comment)
}

#[test]
fn every_link_leads_somewhere() {
    let pages = pages();
    assert!(pages.len() > 15);
    let found: Vec<String> = pages.iter().flat_map(broken_links).collect();
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn words_are_spelt_as_in_britain_and_stand_once() {
    let mut found = Vec::new();
    for page in pages() {
        for (number, line) in page.prose() {
            found.extend(faults(&line).iter().map(|fault| format!("{}: {fault}", page.place(number))));
        }
    }
    for source in ["src", "tests", "benches", "examples"].into_iter().flat_map(sources_in) {
        for (number, line) in comments(&source) {
            let place = format!("{}/{}:{number}", source.folder, source.path);
            found.extend(faults(&line).iter().map(|fault| format!("{place}: {fault}")));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

#[test]
fn a_section_of_the_readme_fits_a_screen() {
    let text = fs::read_to_string(root("README.md")).unwrap();
    for section in text.split("\n## ") {
        let lines = section.lines().count();
        assert!(lines <= SCREEN, "{:?}: {lines} lines of {SCREEN}", section.lines().next());
    }
}

#[test]
fn planted_faults_of_prose_are_found() {
    let page = |text: &str| Page { path: "docs/page.md".into(), text: text.into() };
    assert_eq!(broken_links(&page("[a](runs.md), [b](../README.md#build), [c](https://a.b/c)")), [""; 0]);
    assert_eq!(
        broken_links(&page("```\n[a](gone.md)\n```\n[b](gone.md)")),
        ["docs/page.md:4: gone.md leads nowhere"]
    );
    assert_eq!(broken_links(&page("[a](../README.md#gone)")).len(), 1);
    assert_eq!(
        broken_links(&page("# A plate\n[a](#a-plate) [b](#a-shell) [c](#c)\n<a id=\"c\"></a>")).len(),
        1
    );
    assert_eq!(faults("the behaviour of the the plate"), ["the the"]);
    assert_eq!(faults("Neighboring nodes, that that is"), ["neighboring is American"]);
}
