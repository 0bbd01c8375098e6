//! Deflection and velocity of a plate at an instant, in a file that another run may start from.
//!
//! The file is a line of text (what it is, and of which version), the [`Motion`] in postcard's format, and a CRC-32 of all that,
//! little-endian.

use crate::archive;
use crate::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "end.motion";

/// Number of the format: one more whenever what a file holds, or in what order, changes.
const FORMAT: u32 = 1;

/// Displacement and velocity of all dofs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Motion {
    /// Number of the step.
    pub step: u64,
    /// Its time, in s.
    pub time: f64,
    /// The supports, in a text that is the same for the same ones.
    pub supports: String,
    /// For each dof its place (x and y in m, and which dof of its node), its displacement (m, or 1) and its rate (m/s, or 1/s); by
    /// line, column and dof.
    pub dofs: Vec<[f64; 5]>,
}

/// The first line.
fn head() -> String {
    format!("rebond motion, format {FORMAT}, version {}\n", env!("CARGO_PKG_VERSION"))
}

impl Motion {
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

    /// The motion that the bytes of a file hold. Whatever they are, the answer is what was written, or words for what is wrong.
    pub fn from_bytes(bytes: &[u8]) -> std::result::Result<Motion, String> {
        let damaged = || "damaged: not what was written".to_owned();
        let (content, sum) = bytes.split_last_chunk().ok_or_else(damaged)?;
        if crc32fast::hash(content) != u32::from_le_bytes(*sum) {
            return Err(damaged());
        }
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
    /// [`Error::Io`] for a file that cannot be read, [`Error::Scene`] for one that holds no motion.
    pub fn read(folder: &Path) -> Result<Motion> {
        let path = folder.join(FILE);
        let bytes = std::fs::read(&path).map_err(Error::io(&path))?;
        Motion::from_bytes(&bytes).map_err(|why| Error::Scene(format!("{}: {why}", path.display())))
    }
}
