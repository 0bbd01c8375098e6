//! `summary.json`: the scene, the results and the cost of a run.

use crate::error::{Error, Result};
use crate::input::{read_plain, write_whole};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::fs::File;
use std::io::Write as _;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "summary.json";

/// Writes a value as indented JSON, whole or not at all (see [`super::write_atomic`]).
///
/// NaN and infinity, which JSON lacks, become `null`.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    write_whole(path, &mut File::options(), |file| {
        serde_json::to_writer_pretty(&mut *file, value)?;
        file.write_all(b"\n")
    })
}

/// Reads what [`write_json`] wrote.
///
/// # Errors
/// Returns [`Error::Io`] where the file cannot be read or contains something else.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let bytes = read_plain(path).map_err(Error::io(path))?;
    serde_json::from_slice(&bytes).map_err(|why| Error::invalid(path, why.to_string()))
}
