//! `summary.json`: the scene, the results and the cost of a run.

use super::write_atomic;
use crate::error::{Error, Result};
use serde::Serialize;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "summary.json";

/// Writes a value as indented JSON, whole or not at all (see [`write_atomic`]).
///
/// NaN and infinity, which JSON lacks, become `null`.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(|error| Error::io(path)(error.into()))?;
    bytes.push(b'\n');
    write_atomic(path, &bytes)
}
