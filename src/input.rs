//! Reading of files that a user names: plain files only, whole, and of a bounded size; and opening
//! of files that the program writes.

use crate::error::{Error, Result};
use crate::memory;
use std::fs::{self, File, Metadata, OpenOptions};
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
    require_file(&found).map_err(Error::io(path))?;
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

/// Opens a file that this program writes, or one that it wrote, by its own name.
///
/// A symbolic link is refused, so that no other file is written in its place, and so is all that is
/// no plain file, without waiting for the other end of a pipe.
///
/// # Errors
/// Returns an error of the kind [`io::ErrorKind::InvalidInput`] for what is refused, and else that
/// of the system.
pub fn open_plain(options: &mut OpenOptions, path: &Path) -> io::Result<File> {
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        options.custom_flags((OFlags::NOFOLLOW | OFlags::NONBLOCK).bits() as i32);
    }
    match options.open(path) {
        Ok(file) => {
            require_file(&file.metadata()?)?;
            Ok(file)
        }
        Err(why) => {
            if let Ok(found) = fs::symlink_metadata(path) {
                require_file(&found)?;
            }
            Err(why)
        }
    }
}

/// Reads a file that this program wrote, see [`open_plain`].
///
/// # Errors
/// Returns the errors of [`open_plain`] and of reading.
pub fn read_plain(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open_plain(File::options().read(true), path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Refuses all that is no plain file, given what the system says about it.
///
/// # Errors
/// Returns an error of the kind [`io::ErrorKind::InvalidInput`] that says what it is.
pub fn require_file(found: &Metadata) -> io::Result<()> {
    let kind = match found.file_type() {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => "a folder",
        kind if kind.is_symlink() => "a symbolic link",
        _ => "a device, pipe or socket",
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{kind}; expected a file")))
}
