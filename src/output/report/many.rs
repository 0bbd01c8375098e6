//! Page of a sweep, a study or a branch: pictures, the table of runs, the scene, how to make it
//! again.

use super::html::{again_by, escaped, parts, section, sortable};
use super::scene_text::scene_text;
use super::{document, picture};
use crate::output::text::{grouped, significant};
use serde_json::Value;
use std::collections::BTreeSet;
use std::io;

/// Approximate limit on the length of all pictures, in bytes.
const MOST_BYTES: usize = 4_000_000;
/// Largest number of runs in the table.
const MOST_RUNS: usize = 2_000;

/// Sorts tables and saves the scene; the page has neither view nor charts.
const SORTABLE: &str = include_str!("page/table.js");
const BOOT: &str = r#"document.documentElement.classList.add("js");
for (const table of document.querySelectorAll("table.sortable")) sortable(table);
document.getElementById("save")?.addEventListener("click", () => {
  const link = document.createElement("a");
  const text = document.getElementById("scene-text").textContent;
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = "scene.toml";
  link.click();
});
document.documentElement.dataset.ready = "yes";
"#;

/// Content of the page of many runs, from the files of their folder.
#[derive(Debug)]
pub struct ManyRuns<'r> {
    /// Kind of folder: a sweep, a study or a branch.
    pub kind: &'static str,
    /// Arguments of `rebond` that make it again from its scene.
    pub again: &'r str,
    /// Title of the scene.
    pub title: &'r str,
    /// Version of the program that made the runs.
    pub version: &'r str,
    /// Command that made them.
    pub command: &'r str,
    /// Hash of the scene.
    pub hash: &'r str,
    /// Resolved scene.
    pub scene: &'r Value,
    /// Remarks, one sentence each.
    pub remarks: &'r [String],
    /// Pictures: the names of their files in `plots/`, without extension, and their texts as SVG.
    pub pictures: &'r [(String, String)],
    /// Tables: heading, name of the file, columns and rows.
    pub tables: &'r [RunTable],
}

/// Table of runs.
#[derive(Debug, Clone, PartialEq)]
pub struct RunTable {
    /// Heading.
    pub heading: String,
    /// Names of the columns.
    pub heads: Vec<String>,
    /// Cells, row by row; numbers as the file has them.
    pub rows: Vec<Vec<String>>,
}

impl RunTable {
    /// Creates a table from its heads and its rows, of whose columns only those that `is_shown`
    /// accepts are kept, and of these the ones that have a value in some row.
    pub fn new(heading: &str, lines: &[Vec<String>], is_shown: impl Fn(&str) -> bool) -> RunTable {
        let (heads, rows) = lines.split_first().unwrap_or((const { &Vec::new() }, &[]));
        let has_value = |column: usize| rows.iter().any(|row| row.get(column).is_some_and(|c| !c.is_empty()));
        let kept: Vec<usize> =
            (0..heads.len()).filter(|&column| is_shown(&heads[column]) && has_value(column)).collect();
        let taken =
            |row: &Vec<String>| kept.iter().map(|&c| row.get(c).cloned().unwrap_or_default()).collect();
        RunTable { heading: heading.to_owned(), heads: taken(heads), rows: rows.iter().map(taken).collect() }
    }

    /// Returns the table as HTML. Words sort alphabetically, and empty cells come last.
    fn html(&self, id: &str) -> String {
        let column = |column: usize| self.rows.iter().map(move |row| row[column].as_str());
        let words: Vec<Vec<&str>> = (0..self.heads.len())
            .map(|c| column(c).filter(|cell| cell.parse::<f64>().is_err()).collect::<BTreeSet<_>>())
            .map(|words| words.into_iter().collect())
            .collect();
        let cell = |(text, words): (&String, &Vec<&str>)| match text.parse::<f64>() {
            Ok(value) => format!("<td data-v=\"{value}\">{}</td>", significant(value)),
            Err(_) if text.is_empty() => "<td data-v=\"1e999\"></td>".to_owned(),
            Err(_) => {
                let rank = words.iter().position(|word| word == text).unwrap_or_default();
                format!("<td class=\"words\" data-v=\"{rank}\">{}</td>", escaped(text))
            }
        };
        let head = |(column, head): (usize, &String)| {
            let has_words = words[column].iter().any(|word| !word.is_empty());
            let class = if has_words { "class=\"words\" " } else { "" };
            format!("<th {class}scope=\"col\">{}</th>", escaped(head))
        };
        let heads: String = self.heads.iter().enumerate().map(head).collect();
        let row = |row: &Vec<String>| {
            format!("<tr>{}</tr>\n", row.iter().zip(&words).map(cell).collect::<String>())
        };
        let rows: String = self.rows.iter().take(MOST_RUNS).map(row).collect();
        let cut = match self.rows.len() > MOST_RUNS {
            true => format!("<p>The first {MOST_RUNS} of {} rows.</p>\n", grouped(self.rows.len() as u64)),
            false => String::new(),
        };
        section(id, "", &escaped(&self.heading), &(cut + &sortable(id, &heads, &rows)))
    }
}

/// Returns the page of many runs.
///
/// # Errors
/// Returns an error where the scene has no form in TOML.
pub fn page_of_many(runs: &ManyRuns) -> io::Result<String> {
    let ManyRuns { kind, again, title, version, command, hash, scene, remarks, pictures, tables } = *runs;
    let shown = if title.is_empty() { format!("A {kind} of rebond") } else { escaped(title) };
    let mut body = format!(
        "<header><h1>{shown}</h1>\n<p class=\"soft\">Report of a {kind} by rebond {}</p></header>\n<main>\n",
        escaped(version)
    );
    body +=
        "<noscript><p class=\"soft\">With JavaScript the headings of the tables sort them.</p></noscript>\n";
    remarks.iter().for_each(|remark| body += &format!("<p>{}</p>\n", escaped(remark)));
    if !pictures.is_empty() {
        body += &picture::pictures(pictures, MOST_BYTES, [""; 2], "");
    }
    for (number, table) in tables.iter().enumerate() {
        body += &table.html(&format!("runs-{number}"));
    }
    if scene.is_object() {
        body += &section("scene", "", "The scene", &parts(scene, "scene.toml"));
        let commands = format!("rebond {again} --out again\nrebond report again");
        body += &again_by(&commands, [version, hash], scene, &scene_text(scene)?);
    }
    let made = format!("<pre>{}</pre>", escaped(command));
    body += &section("made", "", "The command that made it", &made);
    let script = SORTABLE.replace("export function", "function");
    Ok(document(&shown, &body, &format!("<script>\n{script}{BOOT}</script>\n")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_keep_columns_with_values() {
        let lines = [["a", "b", "c", "failure"], ["1.5", "", "x", ""], ["2", "", "y, \"z\"", "no, really"]];
        let lines = lines.map(|line| line.map(str::to_owned).to_vec());
        let table = RunTable::new("Runs", &lines, |head| head != "failure");
        assert_eq!(table.heads, ["a", "c"]);
        assert_eq!(table.rows, [["1.5", "x"], ["2", "y, \"z\""]]);
        let html = RunTable::new("Runs", &lines, |_| true).html("t");
        assert!(html.contains("<td data-v=\"1.5\">1.5</td>"), "{html}");
        assert!(html.contains("<td class=\"words\" data-v=\"1\">y, &quot;z&quot;</td>"), "{html}");
        assert!(html.contains("<th class=\"words\" scope=\"col\">c</th>"), "{html}");
        assert!(html.contains("<td data-v=\"1e999\"></td>"), "{html}");
    }
}
