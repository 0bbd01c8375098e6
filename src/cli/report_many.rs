//! Reports of the folders of sweeps, studies and branches.

use super::printing::print;
use crate::continuation::BranchReport;
use crate::error::{Error, Result};
use crate::geometry::range;
use crate::output::report::{self, ManyRuns, RunTable};
use crate::output::summary::read_json;
use crate::output::text::{grouped, significant};
use crate::output::{paths_in, plot, write_atomic};
use crate::sweep::{self, SweepReport, SweepStatistics};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::{fs, io};

/// Name of the file that makes a folder that of a study.
pub(super) const STUDY: &str = "study.json";

/// Columns of `study.csv` in the table of a page.
const STUDY_COLUMNS: &str = "mesh scheme mass modes restitution engine vi step dofs steps contact_steps \
                             stepping_seconds time_error space_error whole_error largest_energy_drift on_front";

/// Writes the page of a sweep to a path.
pub(super) fn of_sweep(folder: &Path, page: &Path) -> Result<()> {
    let sweep = SweepReport::read(folder)?;
    let figures = sweep::figures(&sweep).into_iter();
    let pictures: Vec<(String, String)> =
        figures.map(|(name, figure)| (name.to_owned(), figure.svg())).collect();
    let (runs, failed) = (sweep.rows.count(), sweep.failures());
    let criteria = sweep.statistics.iter().flat_map(|statistics| &statistics.criteria);
    let mut remarks: Vec<String> = criteria.map(|criterion| format!("{criterion}.")).collect();
    remarks.push(format!("{} runs over {}.", grouped(runs as u64), sweep.keys.join(" and ")));
    if failed > 0 {
        remarks.push(format!("{failed} of them failed; the last column says why."));
    }
    let is_shown = |head: &str| !head.ends_with("_section");
    let heading = format!("Runs ({} has their sections too)", sweep::CSV);
    let tables = sweep.statistics.iter().flat_map(SweepStatistics::tables);
    let mut tables: Vec<RunTable> =
        tables.map(|(name, lines)| RunTable::new(name, &lines, |_| true)).collect();
    let lines: Vec<_> = sweep.lines().collect::<io::Result<_>>().map_err(Error::io(folder))?;
    tables.push(RunTable::new(&heading, &lines, is_shown));
    write(
        page,
        &ManyRuns {
            kind: "sweep",
            again: "sweep scene.toml",
            title: &sweep.title,
            version: &sweep.version,
            command: &sweep.command,
            hash: &sweep.scene_hash,
            scene: &sweep.scene,
            remarks: &remarks,
            pictures: &pictures,
            tables: &tables,
        },
    )
}

/// Writes the page of a branch of periodic motions to a path.
pub(super) fn of_branch(folder: &Path, page: &Path) -> Result<()> {
    let branch = BranchReport::read(folder)?;
    let lines: Vec<Vec<String>> = branch.lines().collect();
    let is_special = |line: &&Vec<String>| line.last().is_some_and(|point| !point.is_empty());
    let special: Vec<Vec<String>> = lines.iter().filter(is_special).cloned().collect();
    let [low, high] = range(branch.rows.iter().map(|row| row.parameter));
    let over = if branch.is_free() { "--energy ".to_owned() } else { format!("--over {}=", branch.key) };
    let remarks = [format!("Motions: {}; {}.", branch.stability(), branch.ending)];
    write(
        page,
        &ManyRuns {
            kind: "branch",
            again: &format!("continue scene.toml {over}{low}..{high}"),
            title: &branch.title,
            version: &branch.version,
            command: &branch.command,
            hash: &branch.scene_hash,
            scene: &branch.scene,
            remarks: &remarks,
            pictures: &pictures(&folder.join(plot::FOLDER))?,
            tables: &[
                RunTable::new("Special motions", &special, |_| true),
                RunTable::new("Motions (branch.csv)", &lines, |_| true),
            ],
        },
    )
}

/// Writes the page of a study to a path.
pub(super) fn of_study(folder: &Path, page: &Path) -> Result<()> {
    let path = folder.join(STUDY);
    let invalid = |what: &str| Error::invalid(&path, what);
    let study: Value = read_json(&path)?;
    if study["program"] != env!("CARGO_PKG_NAME") || !study["runs"].is_array() {
        return Err(invalid("not the results of a study of rebond"));
    }
    if study["complete"] != true {
        return Err(invalid("the study is unfinished: `rebond study` goes on with it"));
    }
    let csv = folder.join("study.csv");
    let csv = fs::read_to_string(&csv).map_err(Error::io(&csv))?;
    let is_shown = |head: &str| STUDY_COLUMNS.split(' ').any(|column| column == head);
    let lines: Vec<Vec<String>> =
        csv.lines().map(|line| line.split(',').map(str::to_owned).collect()).collect();
    let mut tables = vec![RunTable::new("Runs (study.csv has more columns)", &lines, is_shown)];
    let failures = study["failures"].as_array().map_or(0, Vec::len);
    let mut remarks = vec![format!("{} runs, {failures} failed.", tables[0].rows.len())];
    if study["resolved"].is_null() {
        remarks.push("The version that made this study did not keep its scene.".to_owned());
    }
    tables.insert(0, cheapest(&study));
    let text = |value: &'_ Value| value.as_str().unwrap_or_default().to_owned();
    write(
        page,
        &ManyRuns {
            kind: "study",
            again: "study scene.toml",
            title: &text(&study["resolved"]["title"]),
            version: &text(&study["version"]),
            command: &text(&study["command"]),
            hash: &text(&study["scene"]),
            scene: &study["resolved"],
            remarks: &remarks,
            pictures: &pictures(&folder.join(plot::FOLDER))?,
            tables: &tables,
        },
    )
}

/// Returns the table of the cheapest run for each accuracy.
fn cheapest(study: &Value) -> RunTable {
    let heads = ["among", "relative accuracy", "run", "seconds", "relative error"];
    let cell = |value: &Value| match value {
        Value::String(text) => text.clone(),
        Value::Number(number) => number.to_string(),
        _ => String::new(),
    };
    let row =
        |run: &Value| ["among", "accuracy", "run", "seconds", "error"].map(|key| cell(&run[key])).to_vec();
    RunTable {
        heading: "Cheapest run for each accuracy".to_owned(),
        heads: heads.map(str::to_owned).to_vec(),
        rows: study["cheapest"].as_array().into_iter().flatten().map(row).collect(),
    }
}

/// Reads the pictures of a folder, in the order of their names; none where there is no folder.
fn pictures(folder: &Path) -> Result<Vec<(String, String)>> {
    let mut paths = paths_in(folder)?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "svg"));
    let read = |path: PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        Ok((name, fs::read_to_string(&path).map_err(Error::io(path))?))
    };
    paths.into_iter().map(read).collect()
}

fn write(path: &Path, runs: &ManyRuns) -> Result<()> {
    let page = report::page_of_many(runs).map_err(Error::io(path))?;
    write_atomic(path, page.as_bytes())?;
    let rows: usize = runs.tables.last().map_or(0, |table| table.rows.len());
    let size = significant((page.len() / 1000) as f64);
    print(&format!("{} ({rows} rows, {} pictures, {size} kB)\n", path.display(), runs.pictures.len()))
}
