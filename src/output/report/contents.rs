//! Content of the page of a run.

use super::frames::Frames;
use crate::output::contacts::Contact;
use crate::output::history::Table;
use serde_json::Value;

/// Content of a page, from the files of a run folder.
#[derive(Debug)]
pub struct ReportContents<'r> {
    /// Content of `summary.json`.
    pub summary: &'r Value,
    /// Rows of `history.csv`.
    pub table: &'r Table,
    /// Contacts of nodes; `None` where the scene has no obstacles.
    pub contacts: Option<&'r [Contact]>,
    /// Frames from the snapshots, if the run wrote any.
    pub frames: Option<&'r Frames>,
    /// Pictures, shown without JavaScript too: the names of their files in `plots/`, without
    /// extension, and their texts as SVG.
    pub pictures: &'r [(String, String)],
    /// Heights of obstacles to draw beside the deflections of probes, in m.
    pub heights: &'r [f64],
}
