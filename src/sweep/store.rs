//! Folder of a sweep: every finished run is there at once, so that a sweep that was killed goes on.
//!
//! `rows.jsonl` has a line with the hash of the scene, and one line per finished run. The state
//! from which the next run of a group starts is in `state-N.bin`, until the sweep is complete.
//! Groups of ranks write files `rows-N.jsonl` of their own, which the next opening joins to it.

use super::conduct::SweepRecord;
use super::prepared_run::CarriedState;
use super::report::{CSV, JSON};
use super::row::SweepRow;
use crate::archive;
use crate::error::{Error, Result};
use crate::input;
use crate::output::claim::refuse_foreign;
use crate::output::{if_there, plot, remove, report, write_atomic};
use serde_json::json;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Name of the file of finished runs.
const ROWS: &str = "rows.jsonl";

/// Finished runs of a sweep in its folder.
pub struct SweepStore {
    folder: PathBuf,
    file: SweepPart,
    known: BTreeMap<usize, SweepRow>,
    /// Last states, by group.
    states: BTreeMap<usize, CarriedState>,
    /// Receiver of each new row.
    told: Box<dyn FnMut(&SweepRow)>,
}

impl SweepStore {
    /// Opens the folder of a sweep of the scene with this hash; `overwrite` forgets what it holds.
    ///
    /// # Errors
    /// Returns [`Error::Usage`] for a folder with files that no sweep writes, or with the sweep of
    /// another scene, and [`Error::Io`] where it cannot be read or written.
    pub fn open(folder: &Path, hash: &str, overwrite: bool) -> Result<SweepStore> {
        let is_state = |name: &str| name.starts_with("state-") && name.ends_with(".bin");
        let is_own = |name: &str| {
            [ROWS, JSON, CSV, plot::FOLDER, report::FILE, ".lock"].contains(&name)
                || is_state(name)
                || name.starts_with("rows-") && name.ends_with(".jsonl")
        };
        refuse_foreign(folder, "sweep", "--out", is_own)?;
        let path = folder.join(ROWS);
        let read =
            |path: &Path| input::open_plain(File::options().read(true), path).and_then(io::read_to_string);
        let text = if_there(&path, read(&path))?.filter(|_| !overwrite).unwrap_or_default();
        let (head, stored) = (head(hash), rows_of(&text));
        if stored.as_ref().is_some_and(|(first, _)| *first != head) {
            return Err(Error::Usage(format!(
                "{} holds the sweep of another scene, or with other values: --out DIR names another folder, --overwrite \
                 replaces it",
                folder.display()
            )));
        }
        remove(&folder.join(report::FILE))?;
        let mut rows = stored.map(|(_, rows)| rows).unwrap_or_default();
        let parts = paths_between(folder, "rows-", ".jsonl");
        for (_, part) in parts.iter().filter(|_| !overwrite) {
            let text = read(part).map_err(Error::io(part))?;
            rows.extend(
                rows_of(&text).filter(|(first, _)| *first == head).into_iter().flat_map(|(_, rows)| rows),
            );
        }
        let rows: BTreeMap<usize, SweepRow> = rows.into_iter().map(|row| (row.index, row)).collect();
        let (folder, states, told) = (folder.to_owned(), BTreeMap::new(), Box::new(|_: &SweepRow| {}));
        // The file is written anew, without lines that a kill cut off.
        let file = SweepPart::start_with(path, &head, rows.values())?;
        let mut store = SweepStore { folder, file, known: rows, states, told };
        parts.iter().try_for_each(|(_, part)| remove(part))?;
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

    /// Returns the indices of the runs that are known.
    pub fn indices(&self) -> Vec<usize> {
        self.known.keys().copied().collect()
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
                if self.known.insert(row.index, row.clone()).is_none() {
                    self.file.add(&row)?;
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

    /// Takes the rows that are known out of the store, in the order of the plan.
    pub fn take_rows(&mut self) -> Vec<SweepRow> {
        std::mem::take(&mut self.known).into_values().collect()
    }
}

/// File of the rows of a sweep, or of those of one group of ranks.
pub struct SweepPart {
    path: PathBuf,
    file: File,
}

impl SweepPart {
    /// Starts the file of a group of ranks, for the scene with this hash.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be written.
    #[cfg(feature = "petsc")]
    pub fn start(folder: &Path, hash: &str, group: usize) -> Result<SweepPart> {
        SweepPart::start_with(folder.join(format!("rows-{group}.jsonl")), &head(hash), [])
    }

    /// Starts a file with its first line and some rows.
    fn start_with<'r>(
        path: PathBuf,
        head: &str,
        rows: impl IntoIterator<Item = &'r SweepRow>,
    ) -> Result<SweepPart> {
        let text: String =
            std::iter::once(head.to_owned() + "\n").chain(rows.into_iter().map(line)).collect();
        write_atomic(&path, text.as_bytes())?;
        let file = input::open_plain(File::options().append(true), &path).map_err(Error::io(&path))?;
        Ok(SweepPart { path, file })
    }

    /// Adds a row.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be written.
    pub fn add(&mut self, row: &SweepRow) -> Result<()> {
        self.file.write_all(line(row).as_bytes()).map_err(Error::io(&self.path))
    }
}

/// Returns the first line of a file of rows, for the scene with this hash.
fn head(hash: &str) -> String {
    json!({ "scene": hash }).to_string()
}

/// Returns the first line of a file of rows, and its rows but for a line that a kill cut off, or
/// `None` for an empty file.
fn rows_of(text: &str) -> Option<(String, Vec<SweepRow>)> {
    let mut lines = text.split_inclusive('\n').filter(|line| line.ends_with('\n'));
    let first = lines.next()?.trim_end().to_owned();
    Some((first, lines.filter_map(|line| serde_json::from_str(line).ok()).collect()))
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
        self.known.contains_key(&index)
    }

    fn state(&self, group: usize) -> Option<CarriedState> {
        self.states.get(&group).cloned()
    }

    fn done(&mut self, group: usize, row: SweepRow, state: Option<&CarriedState>) -> Result<()> {
        if let (Some(state), Some(_)) = (state, &row.measures) {
            let bytes = archive::to_bytes(&(line(&row).into_bytes(), state))?;
            write_atomic(&self.folder.join(format!("state-{group}.bin")), &bytes)?;
        }
        self.file.add(&row)?;
        (self.told)(&row);
        self.known.insert(row.index, row);
        Ok(())
    }
}
