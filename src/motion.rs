//! Deflection and velocity of a plate at an instant, in a file from which another run can start.
//!
//! The file consists of a line of text (its kind and version), the [`Motion`] in postcard's format,
//! and a little-endian CRC-32 of all that precedes.

use crate::archive;
use crate::error::{Error, Result};
use crate::hash;
use crate::input;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "end.motion";

/// Number of the format, which increases whenever the contents of the file or their order change.
const FORMAT: u32 = 1;

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

/// Returns the first line of the file.
fn head() -> String {
    format!("rebond motion, format {FORMAT}, version {}\n", env!("CARGO_PKG_VERSION"))
}

impl Motion {
    /// Returns the bytes of the file.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`] where the motion cannot be serialised.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        let mut bytes = head().into_bytes();
        bytes.extend(archive::to_bytes(self)?);
        Ok(hash::seal(bytes))
    }

    /// Reads the motion from the bytes of a file. Any other bytes than those written give a message
    /// that says what is wrong.
    pub fn from_bytes(bytes: &[u8]) -> std::result::Result<Motion, String> {
        let damaged = || "damaged: not what was written".to_owned();
        let content = hash::unseal(bytes).ok_or_else(damaged)?;
        let end = content.iter().position(|&byte| byte == b'\n').ok_or_else(damaged)?;
        let (line, content) = content.split_at(end + 1);
        if line != head().as_bytes() {
            let (found, own) = (String::from_utf8_lossy(line), head());
            return Err(format!("a {}; this program reads a {}", found.trim_end(), own.trim_end()));
        }
        archive::from_bytes(content).map_err(|_| damaged())
    }

    /// Reads the file of a run folder.
    ///
    /// # Errors
    /// Returns [`Error::Io`] for a file that cannot be read and [`Error::Scene`] for one that does
    /// not hold a motion.
    pub fn read(folder: &Path) -> Result<Motion> {
        let path = folder.join(FILE);
        let bytes = input::read(&path, u64::MAX)?;
        Motion::from_bytes(&bytes).map_err(|why| Error::Scene(format!("{}: {why}", path.display())))
    }
}
