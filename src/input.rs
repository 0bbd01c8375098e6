//! Reading of files that a user names: plain files only, whole, and of a bounded size.

use crate::error::{Error, Result};
use crate::memory;
use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

/// Largest size of a scene file, in bytes.
pub const LARGEST_SCENE: u64 = 4_000_000;

/// Reads a file of at most `most` bytes. Folders, devices, pipes and sockets are refused without
/// being opened.
///
/// # Errors
/// Returns [`Error::Io`] for a file that is refused or cannot be read, and [`Error::Memory`] for
/// one larger than the memory that is left.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    let refuse = |why: String| Error::io(path)(io::Error::new(io::ErrorKind::InvalidInput, why));
    let found = fs::metadata(path).map_err(Error::io(path))?;
    if found.is_dir() {
        return Err(refuse("a folder; expected a file".into()));
    }
    if !found.is_file() {
        return Err(refuse("a device, pipe or socket; expected a file".into()));
    }
    let too_large = |size: u64| {
        let (size, most) = (memory::size(size), memory::size(most));
        refuse(format!("the file has {size}; expected at most {most}"))
    };
    if found.len() > most {
        return Err(too_large(found.len()));
    }
    // The contents need memory twice: as bytes, and as what is read from them.
    memory::require(2 * found.len(), &format!("reading {}", path.display()), |_| {
        "expected a smaller file".into()
    })?;
    let mut bytes = Vec::with_capacity(found.len() as usize);
    // Some files grow, and some system files report a size of zero.
    let file = File::open(path).map_err(Error::io(path))?;
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > most {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}
