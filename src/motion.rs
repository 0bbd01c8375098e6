//! Deflection and velocity of a plate at an instant, in a file from which another run can start.
//!
//! The file holds the [`Motion`] in the form of all files with [one value](FileKind).

use crate::archive::FileKind;
use crate::error::{Error, Result};
use crate::input;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "end.motion";

const KIND: FileKind = FileKind { name: "motion", format: 1, verb: "reads" };

/// Displacement and velocity of all dofs at an instant.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Number of the step.
    pub step: u64,
    /// Time of the step, in s.
    pub time: f64,
    /// Supports as text, which is equal for equal supports.
    pub supports: String,
    /// Position (x and y in m, and the number of the dof at its node), displacement (in m, or 1 for
    /// slopes) and its rate (in m/s, or 1/s) per dof, ordered by line, column and dof.
    pub dofs: Vec<[f64; 5]>,
}

impl Motion {
    /// Returns the bytes of the file.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the motion cannot be serialised.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        KIND.to_bytes(self)
    }

    /// Reads the file of a run folder.
    ///
    /// # Errors
    /// Returns [`Error::Io`] for a file that cannot be read and [`Error::Scene`] for one that does
    /// not hold a motion.
    pub fn read(folder: &Path) -> Result<Motion> {
        let path = folder.join(FILE);
        let bytes = input::read(&path, u64::MAX)?;
        KIND.from_bytes(&bytes).map_err(|why| Error::Scene(format!("{}: {why}", path.display())))
    }
}
