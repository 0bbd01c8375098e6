//! Output of a run: plain data in, files and text out.
//!
//! This module does not depend on plates, meshes or schemes. Its parts are:
//!
//! - [`history`] for `history.csv`, written as the run advances, and its reader,
//! - [`contacts`] for `contacts.csv`,
//! - [`reactions`] for `reactions.csv`,
//! - [`events`] for `events.csv`,
//! - [`checkpoint`] for `checkpoint-*.bin`,
//! - [`claim`] for the exclusive right to write into a folder,
//! - [`vtu`] for `fields.pvd` and its snapshots,
//! - [`summary`] for `summary.json`, and [`resolved`] for the scene in it,
//! - [`run_files`] for the observer that writes all of these,
//! - `run_folder` for the reader of a finished run,
//! - [`plot`] for `plots/*.svg` and `.png`,
//! - [`report`] for `report.html`,
//! - [`wav`] for sound,
//! - [`matrix_market`] for `*.mtx`,
//! - [`progress`] for the progress line on a terminal,
//! - [`text`] for the report that ends a run.

pub mod answers;
pub mod checkpoint;
pub mod claim;
pub mod contacts;
pub mod events;
pub mod extremes;
pub mod history;
pub mod matrix_market;
pub mod plot;
pub mod progress;
pub mod reactions;
pub mod report;
pub mod resolved;
pub mod run_files;
pub(crate) mod run_folder;
pub mod shapes;
pub mod summary;
pub mod text;
pub mod vtu;
pub mod wav;
mod vtk_xml;

use crate::error::{Error, Result};
use crate::hash::Extent;
use crate::input;
pub use crate::input::write_atomic;
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Approximate limit on the time that a line waits before it is written.
const FLUSH_EVERY: Duration = Duration::from_secs(1);
/// Number of waiting bytes that causes an earlier write.
const FLUSH_BYTES: usize = 1 << 16;

/// Text file that grows line by line.
///
/// Lines reach the file whole, at most about a second after the line before, and when the file is
/// finished or dropped, so that an interrupted run keeps its lines.
#[derive(Debug)]
struct Lines {
    path: PathBuf,
    file: File,
    /// Length and checksum of the file, without the pending lines.
    written: Extent,
    pending: String,
    flushed: Instant,
}

impl Lines {
    /// Creates the file with its first line; the folder is created if necessary.
    fn create(folder: &Path, name: &str, head: &str) -> Result<Lines> {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let path = folder.join(name);
        let mut options = File::options();
        let file = input::open_plain(options.create(true).truncate(true).write(true), &path);
        let (file, written) = (file.map_err(Error::io(&path))?, Extent::default());
        let mut lines = Lines { path, file, written, pending: format!("{head}\n"), flushed: Instant::now() };
        lines.flush()?;
        Ok(lines)
    }

    /// Opens the file of a resumed run and truncates it to what it had at the checkpoint, which
    /// [`require_same`] has compared.
    fn resume(folder: &Path, name: &str, written: Extent) -> Result<Lines> {
        let path = folder.join(name);
        let attempt = || -> io::Result<File> {
            let mut file = input::open_plain(File::options().write(true), &path)?;
            file.set_len(written.length)?;
            file.seek(SeekFrom::End(0))?;
            Ok(file)
        };
        let file = attempt().map_err(Error::io(&path))?;
        Ok(Lines { path, file, written, pending: String::new(), flushed: Instant::now() })
    }

    /// Writes everything to the disk and returns what the file has.
    fn position(&mut self) -> Result<Extent> {
        self.flush()?;
        self.file.sync_data().map_err(Error::io(&self.path))?;
        Ok(self.written)
    }

    /// Appends a line, without its line break.
    fn push(&mut self, line: impl FnOnce(&mut String)) -> Result<()> {
        line(&mut self.pending);
        self.pending.push('\n');
        if self.pending.len() >= FLUSH_BYTES || self.flushed.elapsed() >= FLUSH_EVERY {
            self.flush()?;
        }
        Ok(())
    }

    /// Passes all lines to the operating system.
    fn flush(&mut self) -> Result<()> {
        let written = self.file.write_all(self.pending.as_bytes());
        self.written.add(self.pending.as_bytes());
        self.pending.clear();
        self.flushed = Instant::now();
        written.map_err(Error::io(&self.path))
    }
}

impl Drop for Lines {
    fn drop(&mut self) {
        // A caller that needs the error calls `flush`.
        let _ = self.flush();
    }
}

/// Refuses a file of a run that does not begin as it did at a checkpoint.
///
/// # Errors
/// Returns [`Error::Io`] naming the file, also where it cannot be read.
fn require_same(path: &Path, written: Extent) -> Result<()> {
    let file = input::open_plain(File::options().read(true), path).map_err(Error::io(path))?;
    let stored = written.read_again(file).map_err(Error::io(path))?;
    let length = written.length;
    let wrong = match stored.length {
        less if less < length => format!("it has {less} bytes, and had {length} at the checkpoint"),
        _ if stored != written => {
            format!("its first {length} bytes are not those that the run wrote before the checkpoint")
        }
        _ => return Ok(()),
    };
    Err(Error::invalid(path, wrong))
}

/// Removes the temporary files that killed processes left in a folder.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be removed.
pub fn sweep(folder: &Path) -> Result<()> {
    let is_left = |name: &str| (name.starts_with('.') && name.ends_with(".tmp")).then_some(());
    input::files_of(folder, is_left).iter().try_for_each(|((), path)| remove(path))
}

/// Removes a file, if it exists.
pub(crate) fn remove(path: &Path) -> Result<()> {
    if_there(path, fs::remove_file(path)).map(drop)
}

/// Returns the result of an operation on a file or folder; `None` where it does not exist.
pub(crate) fn if_there<T>(path: &Path, result: io::Result<T>) -> Result<Option<T>> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        result => result.map(Some).map_err(Error::io(path)),
    }
}

/// Returns the paths of what a folder holds, sorted; none where it does not exist.
pub(crate) fn paths_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = if_there(folder, fs::read_dir(folder))?.into_iter().flatten();
    let paths = entries.map(|entry| Ok(entry?.path())).collect::<io::Result<_>>();
    let mut paths: Vec<PathBuf> = paths.map_err(Error::io(folder))?;
    paths.sort();
    Ok(paths)
}
