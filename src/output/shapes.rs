//! `modes.pvd` and `modes/*.vtu`: shapes of natural modes for ParaView and VTK.
//!
//! The index has a grid for each mode, at the time that is its number, so that ParaView steps
//! through the modes. `displacement` is (0, 0, w) for the warp filter, with 1 as the largest |w|.
//! The grids have the format of [snapshots](super::vtu).

use super::vtk_xml::{Array, Grid, Precision, collection};
use super::vtu::Surface;
use super::write_atomic;
use crate::error::{Error, Result};
use std::fs;
use std::path::Path;

/// Name of the index.
pub const FILE: &str = "modes.pvd";
/// Folder of the shapes.
pub const FOLDER: &str = "modes";

/// Writes modes, each a frequency (Hz) and a shape.
///
/// # Errors
/// Returns [`Error::Io`] where a file cannot be written.
pub fn write<'s>(folder: &Path, modes: impl Iterator<Item = (f64, &'s Surface)>) -> Result<()> {
    let shapes = folder.join(FOLDER);
    fs::create_dir_all(&shapes).map_err(Error::io(&shapes))?;
    let mut files = Vec::new();
    for (number, (frequency, Surface { points, cells, parents, deflection, .. })) in modes.enumerate() {
        let name = format!("mode-{:03}.vtu", number + 1);
        let precision = Precision::Double;
        let displacement = deflection.iter().flat_map(|&w| [0.0, 0.0, w]);
        let point_data = vec![
            Array::floats("deflection", 1, precision, deflection.iter().copied()),
            Array::floats("displacement", 3, precision, displacement),
        ];
        let cell_data = vec![
            Array::integers("cell", parents.iter().copied()),
            Array::floats("frequency", 1, precision, parents.iter().map(|_| frequency)),
        ];
        let time = number as f64 + 1.0;
        let grid = Grid { time, points, cells, point_data, cell_data, precision, ..Grid::default() };
        write_atomic(&shapes.join(&name), &grid.file())?;
        files.push((time, format!("{FOLDER}/{name}")));
    }
    write_atomic(&folder.join(FILE), collection(files.into_iter()).as_bytes())
}
