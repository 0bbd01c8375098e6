//! Folder of a sweep: every finished run is there at once, so that a sweep that was killed goes on.
//!
//! `rows.jsonl` has a line with the hash of the scene, and one line per finished run. The state
//! from which the next run of a group starts is in `state-N.bin`, until the sweep is complete.
//! Where nothing but the table needs the sections of the probes, they are in that file alone.
//! Groups of ranks write files `rows-N.jsonl` of their own, which the next opening joins to it.

use super::conduct::SweepRecord;
use super::prepared_run::CarriedState;
use super::report::{CSV, JSON};
use super::row::SweepRow;
use super::rows::SweepRows;
use crate::archive;
use crate::error::{Error, Result};
use crate::input;
use crate::output::claim::refuse_foreign;
use crate::output::{if_there, plot, remove, report, write_atomic};
use serde_json::json;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};

/// Name of the file of finished runs.
const ROWS: &str = "rows.jsonl";

/// Finished runs of a sweep in its folder.
pub struct SweepStore {
    folder: PathBuf,
    file: SweepPart,
    known: SweepRows,
    /// Last states, by group.
    states: BTreeMap<usize, CarriedState>,
    /// Receiver of each new row.
    told: Box<dyn FnMut(&SweepRow)>,
}

impl SweepStore {
    /// Opens the folder of a sweep of the scene with this hash; `overwrite` forgets what it holds,
    /// and `has_sections` keeps the sections in memory.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a folder with files that no sweep writes, or with the sweep of
    /// another scene, and [`Error::Io`] where it cannot be read or written.
    pub fn open(folder: &Path, hash: &str, overwrite: bool, has_sections: bool) -> Result<SweepStore> {
        let is_state = |name: &str| name.starts_with("state-") && name.ends_with(".bin");
        let is_own = |name: &str| {
            [ROWS, JSON, CSV, plot::FOLDER, report::FILE, ".lock"].contains(&name)
                || is_state(name)
                || name.starts_with("rows-") && name.ends_with(".jsonl")
        };
        refuse_foreign(folder, "sweep", "--out", is_own)?;
        let (path, head) = (folder.join(ROWS), head(hash));
        let mut rows = SweepRows::empty(!has_sections);
        let stored =
            if overwrite { None } else { read_rows(&path, &head, |row, place| rows.keep(row, place))? };
        if let Some(Stored { is_foreign: true, .. }) = stored {
            return Err(Error::Usage(format!(
                "{} holds the sweep of another scene, or with other values: --out DIR names another folder, --overwrite \
                 replaces it",
                folder.display()
            )));
        }
        remove(&folder.join(report::FILE))?;
        let file = match stored {
            Some(Stored { length, .. }) => SweepPart::resume(path, length)?,
            None => SweepPart::start_with(path, &head)?,
        };
        let (states, told) = (BTreeMap::new(), Box::new(|_: &SweepRow| {}));
        let mut store = SweepStore { folder: folder.to_owned(), file, known: rows, states, told };
        for (_, part) in paths_between(folder, "rows-", ".jsonl") {
            if !overwrite {
                read_rows(&part, &head, |row, _| store.add(row))?;
            }
            remove(&part)?;
        }
        if overwrite {
            store.clear_states()?;
        }
        store.read_states()?;
        Ok(store)
    }

    /// Passes each new row to a function too.
    pub fn on_row(&mut self, told: impl FnMut(&SweepRow) + 'static) {
        self.told = Box::new(told);
    }

    /// Returns the indices of the runs that are known, in ascending order.
    pub fn indices(&self) -> Vec<usize> {
        self.known.indices()
    }

    /// Returns the paths of the states by group.
    fn state_paths(&self) -> Vec<(usize, PathBuf)> {
        paths_between(&self.folder, "state-", ".bin")
    }

    /// Reads the states of the groups. A state without its row was written just before a kill.
    fn read_states(&mut self) -> Result<()> {
        for (group, path) in self.state_paths() {
            let bytes = input::read_plain(&path).map_err(Error::io(&path))?;
            // The row is JSON, which keeps its optional entries.
            let saved: (Vec<u8>, CarriedState) = archive::from_bytes(&bytes)?;
            if let Ok(row) = serde_json::from_slice::<SweepRow>(&saved.0) {
                self.states.insert(group, saved.1);
                if !self.is_known(row.index) {
                    self.add(row)?;
                }
            }
        }
        Ok(())
    }

    /// Removes the states, which a complete sweep does not need.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where a file cannot be removed.
    pub fn clear_states(&mut self) -> Result<()> {
        self.states.clear();
        self.state_paths().iter().try_for_each(|(_, path)| remove(path))
    }

    /// Adds a row to the file and to those that are known.
    fn add(&mut self, row: SweepRow) -> Result<()> {
        let place = self.file.add(&row)?;
        self.known.keep(row, place)
    }

    /// Takes the rows that are known out of the store, in the order of the plan.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where their file cannot be read.
    pub fn take_rows(&mut self) -> Result<SweepRows> {
        std::mem::take(&mut self.known).with_sections_in(&self.file.path)
    }
}

/// File of the rows of a sweep, or of those of one group of ranks.
pub struct SweepPart {
    path: PathBuf,
    file: File,
    length: u64,
}

impl SweepPart {
    /// Starts the file of a group of ranks, for the scene with this hash.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be written.
    #[cfg(feature = "petsc")]
    pub fn start(folder: &Path, hash: &str, group: usize) -> Result<SweepPart> {
        SweepPart::start_with(folder.join(format!("rows-{group}.jsonl")), &head(hash))
    }

    /// Starts a file with its first line.
    fn start_with(path: PathBuf, head: &str) -> Result<SweepPart> {
        let text = head.to_owned() + "\n";
        write_atomic(&path, text.as_bytes())?;
        SweepPart::resume(path, text.len() as u64)
    }

    /// Goes on with a file behind the length of its lines, without what a kill cut off.
    fn resume(path: PathBuf, length: u64) -> Result<SweepPart> {
        let file = input::open_plain(File::options().append(true), &path);
        let file = file.and_then(|file| file.set_len(length).map(|()| file)).map_err(Error::io(&path))?;
        Ok(SweepPart { path, file, length })
    }

    /// Adds a row. Returns its place.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be written.
    pub fn add(&mut self, row: &SweepRow) -> Result<u64> {
        let line = line(row);
        self.file.write_all(line.as_bytes()).map_err(Error::io(&self.path))?;
        let place = self.length;
        self.length += line.len() as u64;
        Ok(place)
    }
}

/// Returns the first line of a file of rows, for the scene with this hash.
fn head(hash: &str) -> String {
    json!({ "scene": hash }).to_string()
}

/// File of rows, as far as its lines are whole.
struct Stored {
    /// Whether its first line is another one than expected.
    is_foreign: bool,
    length: u64,
}

/// Reads the rows of a file that begins with a line, each with its place, but for a line that a
/// kill cut off. Returns `None` for a file that is not there, or empty.
fn read_rows(
    path: &Path,
    head: &str,
    mut take: impl FnMut(SweepRow, u64) -> Result<()>,
) -> Result<Option<Stored>> {
    let file = if_there(path, input::open_plain(File::options().read(true), path))?;
    let Some(mut file) = file.map(BufReader::new) else { return Ok(None) };
    let (mut line, mut length) = (String::new(), 0);
    loop {
        line.clear();
        let read = file.read_line(&mut line).map_err(Error::io(path))? as u64;
        if !line.ends_with('\n') {
            return Ok((length > 0).then_some(Stored { is_foreign: false, length }));
        }
        if length == 0 && line.trim_end() != head {
            return Ok(Some(Stored { is_foreign: true, length }));
        }
        if let (true, Ok(row)) = (length > 0, serde_json::from_str(&line)) {
            take(row, length)?;
        }
        length += read;
    }
}

/// Returns the paths of the files in a folder whose names are a number between two texts.
fn paths_between(folder: &Path, before: &str, after: &str) -> Vec<(usize, PathBuf)> {
    input::files_of(folder, |name| name.strip_prefix(before)?.strip_suffix(after)?.parse().ok())
}

fn line(row: &SweepRow) -> String {
    serde_json::to_string(row).unwrap_or_default() + "\n"
}

impl SweepRecord for SweepStore {
    fn is_known(&self, index: usize) -> bool {
        self.known.has(index)
    }

    fn state(&self, group: usize) -> Option<CarriedState> {
        self.states.get(&group).cloned()
    }

    fn done(&mut self, group: usize, row: SweepRow, state: Option<&CarriedState>) -> Result<()> {
        if let (Some(state), Some(_)) = (state, &row.measures) {
            let bytes = archive::to_bytes(&(line(&row).into_bytes(), state))?;
            write_atomic(&self.folder.join(format!("state-{group}.bin")), &bytes)?;
        }
        (self.told)(&row);
        self.add(row)
    }
}
