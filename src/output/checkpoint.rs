//! Files `checkpoint-*.bin`: the state of a run between two steps, from which it can be resumed.
//!
//! A file holds a [`Checkpoint`] in the form of all files with [one value](FileKind). It is written
//! completely or not at all, and the two newest are kept: if the disk damages one, the other
//! remains. A finished run removes its checkpoints, so that a folder with checkpoints is that of an
//! unfinished run, and leaves its last state in `end.state`, in the same format, from which a run
//! to a later end continues.

use super::vtu::SnapshotFiles;
use super::{history, paths_in, remove, require_same, write_atomic};
use crate::archive::FileKind;
use crate::error::{Error, Result};
use crate::hash::Extent;
use crate::input;
use crate::scene::{MeshFile, Scene};
use crate::simulation::RunState;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const KIND: FileKind = FileKind { name: "checkpoint", format: 17, verb: "goes on from" };

/// Name of the file with the last state of a finished run.
pub const STATE: &str = "end.state";

/// Number of checkpoints kept.
const KEPT: usize = 2;

/// Data of a checkpoint.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Checkpoint {
    /// Resolved scene, as TOML; see [`crate::scene::Scene::written`].
    pub scene: String,
    /// File of the scene; other files that it names are relative to it.
    pub scene_file: PathBuf,
    /// Identity of the scene.
    pub identity: Identity,
    /// Options for PETSc.
    pub petsc: Vec<String>,
    /// State of the run.
    pub pause: RunState,
    /// Positions of the output files.
    pub outputs: Outputs,
}

/// Identity of a scene: its hash, and the checksum of its mesh file, if it has one.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// Hash of the scene; see [`Scene::hash`].
    pub scene: String,
    /// Checksum (CRC-32) of the scene's mesh file, if it has one.
    pub mesh: Option<u32>,
}

impl Identity {
    /// Returns the identity of a scene.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the mesh file cannot be read.
    pub fn of(scene: &Scene) -> Result<Identity> {
        let sum = |file: &MeshFile| {
            input::read(Path::new(&file.path), u64::MAX).map(|bytes| crc32fast::hash(&bytes))
        };
        Ok(Identity { scene: scene.hash(), mesh: scene.file.as_ref().map(sum).transpose()? })
    }

    /// Returns the identity of the scene of a finished run, from its `summary.json`.
    pub(super) fn of_summary(summary: &serde_json::Value) -> Option<Identity> {
        let scene = summary["scene_hash"].as_str()?.to_owned();
        Some(Identity { scene, mesh: summary["mesh_checksum"].as_u64().map(|sum| sum as u32) })
    }
}

/// Lengths and checksums of the output files of a run at a checkpoint.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Outputs {
    /// `history.csv`.
    pub history: Extent,
    /// Further tables, by the names of their files.
    pub tables: BTreeMap<String, Extent>,
    /// Snapshots, by time.
    pub snapshots: Vec<SnapshotFiles>,
}

impl Outputs {
    /// Refuses a run folder whose files are not those of the checkpoint, as far as they go.
    ///
    /// # Errors
    /// Returns [`Error::Io`] naming the file.
    pub(super) fn require_same(&self, folder: &Path) -> Result<()> {
        require_same(&folder.join(history::FILE), self.history)?;
        let snapshots = self.snapshots.iter().flat_map(|snapshot| &snapshot.files);
        let files = self.tables.iter().chain(snapshots.map(|(name, written)| (name, written)));
        files.into_iter().try_for_each(|(name, written)| require_same(&folder.join(name), *written))
    }
}

impl Checkpoint {
    /// Serialises the checkpoint to the bytes of the file.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the data cannot be serialised.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        KIND.to_bytes(self)
    }

    /// Parses the bytes of a file. Damaged bytes give an error, never other data.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the bytes are not those of a checkpoint of this version.
    pub fn from_bytes(bytes: &[u8]) -> Result<Checkpoint> {
        KIND.from_bytes(bytes).map_err(Error::Checkpoint)
    }

    /// Reads the scene of the run in a folder, which must have the files that it had.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where a file that the scene names has changed.
    pub fn read_scene(&self, folder: &Path) -> Result<Scene> {
        let scene = Scene::from_str(&self.scene, &self.scene_file.to_string_lossy(), &[])?;
        if Identity::of(&scene)? != self.identity {
            return Err(Error::Checkpoint(format!(
                "{}: a mesh, table or start that the scene names has changed since the run began",
                folder.display()
            )));
        }
        Ok(scene)
    }

    /// Writes the checkpoint to a run folder, then removes all but it and the previous one.
    ///
    /// # Errors
    /// Returns [`Error::Io`] on a failure to write; earlier checkpoints are then still there.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let step = self.pause.step;
        write_atomic(&folder.join(format!("checkpoint-{step:012}.bin")), &self.to_bytes()?)?;
        // Checkpoints of later steps are damaged, otherwise the run would have resumed from them.
        let (earlier, later): (Vec<_>, Vec<_>) =
            list(folder)?.into_iter().partition(|(number, _)| *number <= step);
        earlier.iter().rev().skip(KEPT).chain(&later).try_for_each(|(_, path)| remove(path))
    }

    /// Returns the newest undamaged checkpoint of a run folder, and the errors of newer ones; with
    /// `or_last`, the last state of a finished run where there is no checkpoint.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where there is none, and [`Error::Io`] where the folder cannot
    /// be read.
    pub fn newest(folder: &Path, or_last: bool) -> Result<(Checkpoint, Vec<Error>)> {
        input::refuse_file(folder)?;
        let (name, state) = (folder.display(), folder.join(STATE));
        let paths = list(folder)?.into_iter().rev().map(|(_, path)| path);
        let mut damaged = Vec::new();
        for path in paths.chain((or_last && state.is_file()).then(|| state.clone())) {
            let read = input::read(&path, u64::MAX).and_then(|bytes| {
                Checkpoint::from_bytes(&bytes)
                    .map_err(|why| Error::Checkpoint(format!("{}: {why}", path.display())))
            });
            match read {
                Ok(checkpoint) => return Ok((checkpoint, damaged)),
                Err(why) => damaged.push(why),
            }
        }
        Err(Error::Checkpoint(match damaged.first() {
            Some(why) => format!("{name}: no checkpoint to go on from; {why}"),
            None if state.is_file() => {
                format!(
                    "{name}: the run is done; `rebond resume {name} --until T` goes on to a later end, in s"
                )
            }
            None => {
                let near = input::nearest(folder, Path::is_dir);
                format!("{name}: no checkpoint to go on from: not the folder of an unfinished run{near}")
            }
        }))
    }
}

/// Returns whether a folder has checkpoints, i.e. belongs to an unfinished run.
///
/// # Errors
/// Returns [`Error::Io`] where the folder cannot be read.
pub fn any(folder: &Path) -> Result<bool> {
    Ok(!list(folder)?.is_empty())
}

/// Removes all checkpoints of a folder, the oldest first.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    list(folder)?.iter().try_for_each(|(_, path)| remove(path))
}

/// Returns the step in the file name of a checkpoint; `None` for another file.
pub(super) fn step_of(name: &str) -> Option<u64> {
    name.strip_prefix("checkpoint-")?.strip_suffix(".bin")?.parse().ok()
}

/// Returns steps and files of a folder's checkpoints, ascending; none where the folder does not
/// exist.
fn list(folder: &Path) -> Result<Vec<(u64, PathBuf)>> {
    let numbered = |path: PathBuf| Some((step_of(path.file_name()?.to_str()?)?, path));
    let mut checkpoints: Vec<_> = paths_in(folder)?.into_iter().filter_map(numbered).collect();
    checkpoints.sort_unstable();
    Ok(checkpoints)
}
