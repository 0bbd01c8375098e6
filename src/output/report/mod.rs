//! `report.html`: a run in one page that needs no network.
//!
//! The page begins with one sentence on the plate, the plate in motion and the answers of the run.
//! Time series, contacts, pictures, the scene and its numerics follow. All its parts are in the one
//! file: the script and the style of the folder `page`, the numbers ([`blob`]), and the pictures of
//! `rebond plot`. A policy in its head forbids it any access to a network.

pub mod blob;
mod frames;
mod html;
mod many;
mod picture;
mod scene_text;
mod sentence;
mod series;
mod side_by_side;

pub use frames::{Frames, MOST_FRAMES};
pub use many::{ManyRuns, RunTable, page_of_many};
pub(crate) use side_by_side::page_of_two;

use crate::error::{Error, Result};
use crate::input;
use crate::output::plot::{self, Figure, Obstacle, perspective};
use crate::output::run_folder::RunFolder;
use crate::output::summary;
use crate::output::text::{engineering, typeset};
use blob::PageData;
use scene_text::scene_text;
use serde_json::{Value, json};
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "report.html";

/// Approximate limit on the length of all pictures, in bytes.
const MOST_BYTES: usize = 480_000;
/// Script and style of the page; `page/build.mjs` makes them.
const SCRIPT: &str = include_str!("page/bundle.js");
const STYLE: &str = include_str!("page/bundle.css");

/// Scales by which deflections can be drawn larger than they are.
const SCALES: [f64; 16] =
    [1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1e3, 2e3, 5e3, 1e4, 1e5, 1e6, 1e7];

/// Lowest natural modes of a run's plate: their picture and their frequencies, in Hz.
type Modes = (Figure, Vec<f64>);

/// Returns the page of a run, with frames from its snapshots, if it wrote any, and natural modes,
/// where they are known.
///
/// # Errors
/// Returns an error where a file of the run cannot be read, and where the numbers cannot be
/// compressed or the scene has no form in TOML.
pub(crate) fn page(run: &RunFolder, frames: Option<&Frames>, modes: Option<&Modes>) -> Result<String> {
    let RunFolder { folder, summary, table, .. } = run;
    let (figures, _) = run.pictures(modes.map_or(&[], |(_, frequencies)| frequencies.as_slice()))?;
    let figures: Vec<(String, String)> =
        figures.into_iter().map(|(name, figure)| (name.to_owned(), figure.svg())).collect();
    let heights: Vec<f64> = run.obstacles().iter().map(Obstacle::height).collect();
    let mut data = PageData::default();
    let (charts, rows) = series::store(table, &heights, &mut data);
    let mut meta = json!({ "charts": charts });
    if let Some(frames) = frames {
        let ([low, high], [length, width]) = frames.extent();
        let drawn = perspective::relief_scale(low.min(0.0), high.max(0.0), length.max(width));
        let scales = SCALES.iter().filter(|scale| **scale <= (10.0 * drawn).max(10.0));
        meta["scale"] = json!(drawn);
        meta["scales"] = scales.copied().collect::<Vec<f64>>().into();
        meta["colors"] = frames.store(&mut data);
        meta["step"] = summary["scene"]["time"]["step"].clone();
        meta["bolts"] = json!(run.bolts());
    }
    let path = folder.join(FILE);
    let (arrays, numbers) = data.finish().map_err(Error::io(&path))?;
    meta["arrays"] = arrays;
    let title = html::escaped(summary["scene"]["title"].as_str().unwrap_or("Run of rebond"));
    let body = [
        html::head(summary, frames),
        html::trouble().to_owned(),
        "<div class=\"first\">\n".to_owned(),
        html::view(run, frames, &meta["colors"]),
        html::answers(summary),
        "</div>\n".to_owned(),
        html::charts(rows, table.rows(), &files(folder)),
        html::contacts(run.contacts.as_deref()),
        modes.map_or_else(html::no_modes, natural_modes),
        pictures(&figures),
        html::scene(summary, &run.scene_file()),
        html::numbers(summary),
        html::again(summary, &scene_text(&summary["scene"]).map_err(Error::io(&path))?),
    ]
    .concat();
    Ok(document(&title, &body, &scripts(&meta, &numbers)))
}

/// Returns the names of the tables in a run folder, and its summary.
fn files(folder: &Path) -> Vec<String> {
    let table = |name: &str| name.ends_with(".csv").then(|| name.to_owned());
    let mut files: Vec<String> = input::files_of(folder, table).into_iter().map(|(name, _)| name).collect();
    files.sort();
    files.push(summary::FILE.into());
    files
}

/// Returns the script of a page with its numbers and their description.
fn scripts(meta: &Value, numbers: &str) -> String {
    // A text in a script ends at "</script>", whatever it means.
    let meta = meta.to_string().replace('<', "\\u003c");
    format!(
        "<script type=\"application/json\" id=\"meta\">{meta}</script>\n\
         <script type=\"text/plain\" id=\"data\">{numbers}</script>\n<script>\n{SCRIPT}</script>\n"
    )
}

/// Returns the section of natural modes.
fn natural_modes((figure, frequencies): &Modes) -> String {
    let words: Vec<String> = frequencies.iter().map(|&frequency| engineering(frequency, "Hz")).collect();
    let caption = format!("Lowest mode shapes with their nodal lines: {}", typeset(&words.join(", ")));
    html::modes(&picture::figure(&picture::compact(&figure.svg(), "modes"), &caption))
}

/// Returns a page with a title, a body up to the end of its main part, and scripts.
fn document(title: &str, body: &str, scripts: &str) -> String {
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; \
         style-src 'unsafe-inline'; img-src data:\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"generator\" content=\"rebond {}\">\n<link rel=\"icon\" href=\"data:,\">\n\
         <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</main>\n\
         {scripts}</body>\n</html>\n",
        env!("CARGO_PKG_VERSION")
    )
}

/// Returns the pictures of a run that fit in a page of moderate size, in order of importance.
fn pictures(pictures: &[(String, String)]) -> String {
    let ordered = plot::PICTURES.iter();
    let ordered = ordered.filter_map(|(name, _)| pictures.iter().find(|picture| picture.0 == *name));
    let open = "<details class=\"pictures\" open><summary>Still pictures of the run</summary>\n";
    let remedy = ", in the folder plots after <code>rebond plot</code>";
    picture::pictures(ordered, MOST_BYTES, [open, "</details>"], remedy)
}
