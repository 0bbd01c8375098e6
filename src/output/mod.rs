//! What a run leaves behind and shows on its way: plain data in, files and text out.
//!
//! Nothing here knows a plate, a mesh or a scheme.
//!
//! The parts are [`history`] (`history.csv`, written as the run goes, and its reader), [`contacts`] (`contacts.csv`), [`vtu`]
//! (`fields.pvd` and its snapshots), [`summary`] (`summary.json`), [`plot`] (`plots/*.svg` and `.png`), [`matrix_market`] (`*.mtx`), [`progress`] (the moving line on a terminal) and [`text`] (the report that ends a run).

pub mod contacts;
pub mod history;
pub mod matrix_market;
pub mod plot;
pub mod progress;
pub mod summary;
pub mod text;
pub mod vtu;

use crate::error::{Error, Result};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Writes a file whole or not at all: a reader, or a run stopped halfway, never sees a part of it.
///
/// The bytes go to a temporary file in the same folder, reach the disk, and take the name in one step. On failure the
/// temporary file is removed and whatever had the name before keeps it.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let temporary = temporary_name(path);
    let attempt = || -> io::Result<()> {
        let mut file = File::create(&temporary)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        fs::rename(&temporary, path)
    };
    attempt().map_err(|error| {
        let _ = fs::remove_file(&temporary);
        Error::io(path)(error)
    })
}

/// `folder/.name.<process id>.tmp` for `folder/name`: hidden, and not shared with another process.
fn temporary_name(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    path.with_file_name(name)
}
