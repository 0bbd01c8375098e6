//! `checkpoint-*.bin`: a run between two steps, to go on from.
//!
//! A checkpoint is a line of text (what it is, and of which version), what [`Checkpoint`] holds in postcard's format, and a CRC-32
//! of all that, little-endian. It is whole or not there, and the two newest are kept: should the disk damage one, there is
//! another. A run that ends removes them, so that a folder with checkpoints is that of an unfinished run, and leaves its last state
//! in `end.state`, in the same format: a run to a later end goes on from it.

use super::{remove, write_atomic};
use crate::archive;
use crate::error::{Error, Result};
use crate::input;
use crate::motion;
use crate::scene::{MeshFile, Scene};
use crate::simulation::Pause;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

/// Number of the format: one more whenever what a checkpoint holds, or in what order, changes.
const FORMAT: u32 = 3;

/// Name of the file of a finished run's last state.
pub const STATE: &str = "end.state";

/// How many are kept.
const KEPT: usize = 2;

/// What a checkpoint holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// The resolved scene, as TOML: see [`crate::scene::Scene::written`].
    pub scene: String,
    /// Its file: others that it names are beside it.
    pub scene_file: PathBuf,
    /// What tells it from others.
    pub identity: Identity,
    /// Options for PETSc.
    pub petsc: Vec<String>,
    /// Where the run was.
    pub pause: Pause,
    /// Where its files were.
    pub outputs: Outputs,
}

/// What tells a scene from others: its hash, and the check sum of its mesh, if that comes from a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    scene: String,
    mesh: Option<u32>,
}

impl Identity {
    /// That of a scene.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn of(scene: &Scene) -> Result<Identity> {
        let sum = |file: &MeshFile| {
            input::read(Path::new(&file.path), u64::MAX).map(|bytes| crc32fast::hash(&bytes))
        };
        Ok(Identity { scene: scene.hash(), mesh: scene.file.as_ref().map(sum).transpose()? })
    }

    /// That of the scene of a finished run, from its `summary.json`.
    pub(super) fn of_summary(summary: &serde_json::Value) -> Option<Identity> {
        let scene = summary["scene_hash"].as_str()?.to_owned();
        Some(Identity { scene, mesh: summary["mesh_checksum"].as_u64().map(|sum| sum as u32) })
    }

    /// Check sum (CRC-32) of the scene's mesh file, if it has one.
    pub fn mesh_checksum(&self) -> Option<u32> {
        self.mesh
    }
}

/// How far the files of a run had come.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// Bytes of `history.csv`.
    pub history: u64,
    /// Bytes of `contacts.csv`, if there is one.
    pub contacts: Option<u64>,
    /// Bytes of `events.csv`, if there is one.
    pub events: Option<u64>,
    /// Times (s) and files of the snapshots.
    pub snapshots: Vec<(f64, String)>,
}

/// The first line.
fn head() -> String {
    format!("rebond checkpoint, format {FORMAT}, version {}\n", env!("CARGO_PKG_VERSION"))
}

impl Checkpoint {
    /// The bytes of the file.
    ///
    /// # Errors
    /// [`Error::Checkpoint`].
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = head().into_bytes();
        bytes.extend(archive::to_bytes(self)?);
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        Ok(bytes)
    }

    /// What the bytes of a file hold. Whatever they are, the answer is what was written, or an error.
    ///
    /// # Errors
    /// [`Error::Checkpoint`].
    pub fn from_bytes(bytes: &[u8]) -> Result<Checkpoint> {
        let damaged = || Error::Checkpoint("damaged: not what was written".into());
        let (content, sum) = bytes.split_last_chunk().ok_or_else(damaged)?;
        if crc32fast::hash(content) != u32::from_le_bytes(*sum) {
            return Err(damaged());
        }
        let end = content.iter().position(|&byte| byte == b'\n').ok_or_else(damaged)?;
        let (line, content) = content.split_at(end + 1);
        if line != head().as_bytes() {
            return Err(Error::Checkpoint(format!(
                "a {}; this program goes on from a {}",
                String::from_utf8_lossy(line).trim_end(),
                head().trim_end()
            )));
        }
        archive::from_bytes(content)
    }

    /// Writes the checkpoint of a run folder, then removes all but it and the one before.
    ///
    /// # Errors
    /// [`Error::Io`]: the earlier ones are still there.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let step = self.pause.step;
        write_atomic(&folder.join(format!("checkpoint-{step:012}.bin")), &self.to_bytes()?)?;
        // Later ones are damaged: the run would have gone on from them.
        let (earlier, later): (Vec<_>, Vec<_>) = list(folder)?.into_iter().partition(|(of, _)| *of <= step);
        earlier.iter().rev().skip(KEPT).chain(&later).try_for_each(|(_, path)| remove(path))
    }

    /// Writes the last state of a run that ends.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn write_state(&self, folder: &Path) -> Result<()> {
        write_atomic(&folder.join(STATE), &self.to_bytes()?)
    }

    /// The newest checkpoint of a run folder that is whole, and what is wrong with those after it.
    ///
    /// # Errors
    /// [`Error::Checkpoint`] where there is none, [`Error::Io`].
    pub fn newest(folder: &Path) -> Result<(Checkpoint, Vec<Error>)> {
        let paths = list(folder)?.into_iter().rev().map(|(_, path)| path);
        Checkpoint::first_whole(folder, paths)
    }

    /// As [`Checkpoint::newest`], or the last state of a finished run where there is no checkpoint.
    ///
    /// # Errors
    /// As [`Checkpoint::newest`].
    pub fn newest_or_last(folder: &Path) -> Result<(Checkpoint, Vec<Error>)> {
        let paths = list(folder)?.into_iter().rev().map(|(_, path)| path);
        let last = Some(folder.join(STATE)).filter(|path| path.is_file());
        Checkpoint::first_whole(folder, paths.chain(last))
    }

    /// The first of some files that is whole, and what is wrong with those before it.
    fn first_whole(folder: &Path, paths: impl Iterator<Item = PathBuf>) -> Result<(Checkpoint, Vec<Error>)> {
        let mut damaged = Vec::new();
        for path in paths {
            let read = fs::read(&path).map_err(Error::io(&path)).and_then(|bytes| {
                Checkpoint::from_bytes(&bytes)
                    .map_err(|why| Error::Checkpoint(format!("{}: {why}", path.display())))
            });
            match read {
                Ok(checkpoint) => return Ok((checkpoint, damaged)),
                Err(why) => damaged.push(why),
            }
        }
        let (name, state) = (folder.display(), folder.join(STATE));
        Err(Error::Checkpoint(match damaged.first() {
            Some(why) => format!("{name}: no checkpoint to go on from; {why}"),
            None if state.is_file() => {
                format!(
                    "{name}: the run is done; `rebond resume {name} --until T` goes on to a later end, in s"
                )
            }
            None => format!("{name}: no checkpoint to go on from: not the folder of an unfinished run"),
        }))
    }
}

/// Whether a folder has checkpoints: that of an unfinished run.
///
/// # Errors
/// [`Error::Io`].
pub fn any(folder: &Path) -> Result<bool> {
    Ok(!list(folder)?.is_empty())
}

/// Removes all checkpoints of a folder, the oldest first.
///
/// # Errors
/// [`Error::Io`].
pub fn clear(folder: &Path) -> Result<()> {
    list(folder)?.iter().try_for_each(|(_, path)| remove(path))
}

/// Removes the last state and motion of a finished run, if there are any.
///
/// # Errors
/// [`Error::Io`].
pub fn clear_state(folder: &Path) -> Result<()> {
    remove(&folder.join(motion::FILE))?;
    remove(&folder.join(STATE))
}

/// Whether a file's name is that of a checkpoint.
pub(super) fn is_one(name: &str) -> bool {
    step_of(name).is_some()
}

/// Step of the checkpoint with that name.
fn step_of(name: &str) -> Option<u64> {
    name.strip_prefix("checkpoint-")?.strip_suffix(".bin")?.parse().ok()
}

/// Steps and files of a folder's checkpoints, ascending; none where there is no such folder.
fn list(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let entries = match fs::read_dir(folder) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(Error::io(folder))?,
    };
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(Error::io(folder))?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if let Some(step) = step_of(&name) {
            found.push((step, path));
        }
    }
    found.sort_unstable();
    Ok(found)
}
