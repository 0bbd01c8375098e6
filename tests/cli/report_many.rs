//! The pages of sweeps and studies.

use crate::common::command::{self, assert_fails, rebond, succeeds};
use std::fs;
use std::path::Path;

/// Checks that a page is whole and needs no network, and returns the rows of its last table.
fn rows(page: &str) -> Vec<Vec<String>> {
    assert!(page.starts_with("<!DOCTYPE html>") && page.trim_end().ends_with("</html>"));
    assert!(page.contains("default-src 'none'"));
    for outside in ["http://", "https://", " src=", "@import", "import(", "fetch("] {
        assert!(!page.contains(outside), "{outside}");
    }
    // The script is no module, and defines what it calls.
    assert!(page.contains("\nfunction sortable(table)") && !page.contains("export "));
    let table = page.rsplit("<tbody>").next().unwrap().split("</tbody>").next().unwrap();
    let cells = |row: &str| {
        let cells = row.split("data-v=\"").skip(1).map(|cell| cell.split('"').next().unwrap().to_owned());
        cells.collect()
    };
    table.split("</tr>").filter(|row| row.contains("<td")).map(cells).collect()
}

fn page(folder: &Path, of: &str) -> String {
    let said = succeeds(&rebond(folder, &["report", of]));
    assert!(said.starts_with(&format!("{of}/report.html (")), "{said}");
    fs::read_to_string(folder.join(of).join("report.html")).unwrap()
}

/// Returns the resolved scene of a page.
fn scene(page: &str) -> String {
    let text = page.split("<pre id=\"scene-text\">").nth(1).unwrap().split("</pre>").next().unwrap();
    text.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
}

#[test]
fn a_sweep_has_a_page_from_which_it_can_be_made_again() {
    let folder = command::folder("report-sweep", "");
    succeeds(&rebond(&folder, &["new", "shaker"]));
    let sweep = |out: &str, scene: &str, more: &[&str]| {
        rebond(&folder, &[&["sweep", scene, "--quiet", "--out", out], more].concat())
    };
    let settings =
        ["--over", "frequency=18,20,22", "--periods", "6", "--settle", "2", "--set", "time.step=1e-4"];
    succeeds(&sweep("swept", "shaker.toml", &settings));
    let text = page(&folder, "swept");
    let rows = rows(&text);
    assert_eq!(
        rows.iter().map(|row| row[0].as_str()).collect::<Vec<_>>(),
        ["18", "20", "22", "22", "20", "18"]
    );
    // The cells sort by the numbers of the table.
    let csv = fs::read_to_string(folder.join("swept/sweep.csv")).unwrap();
    let heads: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
    let column = heads.iter().position(|head| *head == "tip_max").unwrap();
    let shown = text.split(" scope=\"col\">").skip(1).position(|head| head.starts_with("tip_max<")).unwrap();
    for (line, row) in csv.lines().skip(1).zip(&rows) {
        let value: f64 = line.split(',').nth(column).unwrap().parse().unwrap();
        assert_eq!(row[shown].parse::<f64>().unwrap(), value);
    }
    assert_eq!(text.matches("<figure>").count(), 2);
    assert!(text.contains("rebond sweep shaker.toml") && !text.contains("tip_section"));

    // The scene of the page makes the same sweep.
    fs::write(folder.join("again.toml"), scene(&text)).unwrap();
    succeeds(&sweep("again", "again.toml", &[]));
    assert_eq!(fs::read(folder.join("again/sweep.csv")).unwrap(), csv.as_bytes());

    // The page goes with the sweep that it shows, and is no foreign file.
    succeeds(&sweep(
        "swept",
        "shaker.toml",
        &[&settings[..], &["--overwrite", "--set", "damping.mass=6"]].concat(),
    ));
    assert!(!folder.join("swept/report.html").exists());
}

#[test]
fn a_study_has_a_page_with_the_cheapest_runs() {
    let folder = command::folder("report-study", "");
    succeeds(&rebond(&folder, &["new", "plate"]));
    let study = |more: &[&str]| {
        let lists = [
            "--schemes",
            "newmark,conserving",
            "--masses",
            "singular",
            "--steps",
            "2e-4,1e-4",
            "--cells",
            "6x2",
        ];
        let scene = ["study", "plate.toml", "--quiet", "--out", "study", "--set", "time.end=0.02"];
        rebond(&folder, &[&scene[..], &lists[..], more].concat())
    };
    succeeds(&study(&[]));
    let text = page(&folder, "study");
    let csv = fs::read_to_string(folder.join("study/study.csv")).unwrap();
    assert_eq!(rows(&text).len(), csv.lines().count() - 1);
    for words in ["Cheapest run for each accuracy", "conserving", "work-precision", "stepping_seconds"] {
        assert!(text.contains(words), "{words}");
    }
    let pictures = fs::read_dir(folder.join("study/plots")).unwrap();
    let pictures =
        pictures.filter(|entry| entry.as_ref().unwrap().path().extension().unwrap() == "svg").count();
    assert_eq!(text.matches("<figure>").count(), pictures);
    fs::write(folder.join("again.toml"), scene(&text)).unwrap();
    succeeds(&rebond(&folder, &["check", "again.toml"]));

    // A study that begins anew removes the page, and one that is unfinished or damaged has none.
    succeeds(&study(&["--fresh"]));
    assert!(!folder.join("study/report.html").exists());
    let json = folder.join("study/study.json");
    let whole = fs::read_to_string(&json).unwrap();
    let report = || rebond(&folder, &["report", "study"]);
    fs::write(&json, whole.replace("\"complete\": true", "\"complete\": false")).unwrap();
    assert_fails(&report(), 4, &["study.json", "unfinished"]);
    fs::write(&json, &whole[..whole.len() / 2]).unwrap();
    assert_fails(&report(), 4, &["study.json"]);
    fs::write(&json, "{}").unwrap();
    assert_fails(&report(), 4, &["study.json", "not the results of a study"]);
    assert!(!folder.join("study/report.html").exists());
}
