//! `extremes.vtu`: the largest von Mises stress of a run at each node, for ParaView and VTK.
//!
//! The grid is the mesh itself; a node between parts of the plate occurs once per part. The file
//! has the format of [snapshots](super::vtu). With several ranks each writes its own piece beside
//! the snapshots, and `extremes.pvtu` lists them.
//!
//! | point data | meaning |
//! |---|---|
//! | `von_mises` | largest von Mises stress over all steps, in Pa |
//! | `time` | time of that stress, in s |

use super::vtk_xml::{Array, Grid, Precision, parallel};
use super::{remove, vtu, write_atomic};
use crate::error::{Error, Result};
use crate::input;
use crate::simulation::Envelope;
use std::fs;
use std::path::{Path, PathBuf};

/// Name of the file of a run of one process.
pub const FILE: &str = "extremes.vtu";
/// Name of the file that lists the pieces of several ranks.
pub const PARALLEL: &str = "extremes.pvtu";

fn piece(rank: usize, ranks: usize) -> String {
    if ranks == 1 { FILE.to_owned() } else { format!("{}/extremes-{rank}.vtu", vtu::FOLDER) }
}

/// Writes this rank's piece of the envelope of a run to its end (s); the first rank also writes the
/// list of pieces.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be written.
pub fn write(folder: &Path, envelope: &Envelope, end: f64, [rank, ranks]: [usize; 2]) -> Result<()> {
    let Envelope { points, cells, von_mises, time } = envelope;
    let point_data = vec![
        Array::floats("von_mises", 1, Precision::Double, von_mises.iter().copied()),
        Array::floats("time", 1, Precision::Double, time.iter().copied()),
    ];
    let arrays = [point_data.iter().map(Array::kind).collect(), Vec::new()];
    let precision = Precision::Double;
    let grid = Grid { time: end, points, cells, point_data, precision, ..Grid::default() };
    if ranks > 1 {
        let pieces = folder.join(vtu::FOLDER);
        fs::create_dir_all(&pieces).map_err(Error::io(&pieces))?;
    }
    write_atomic(&folder.join(piece(rank, ranks)), &grid.file())?;
    if rank > 0 || ranks == 1 {
        return Ok(());
    }
    let pieces: Vec<String> = (0..ranks).map(|rank| piece(rank, ranks)).collect();
    write_atomic(&folder.join(PARALLEL), parallel(&pieces, &arrays, precision).as_bytes())
}

/// Removes the files of an earlier run.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be removed.
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))?;
    remove(&folder.join(PARALLEL))?;
    let is_piece = |name: &str| (name.starts_with("extremes-") && name.ends_with(".vtu")).then_some(());
    let pieces = input::files_of(&folder.join(vtu::FOLDER), is_piece);
    pieces.iter().try_for_each(|((), path)| remove(path))
}

/// Returns the file of the envelope in a run folder, if it has one.
pub fn find(folder: &Path) -> Option<PathBuf> {
    [FILE, PARALLEL].into_iter().map(|name| folder.join(name)).find(|path| path.is_file())
}
