//! Reading of files that a user names: plain files only, whole, and of a bounded size; and opening
//! and writing of files of the program.

use crate::error::{Error, Result, suggestion};
use crate::memory;
use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io::{self, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Largest size of a scene file, in bytes.
const LARGEST_SCENE: u64 = 4_000_000;

/// Reads a file of at most `most` bytes. Folders, devices, pipes and sockets are refused without
/// being opened.
///
/// # Errors
/// Returns [`Error::Io`] for a file that is refused or cannot be read, and [`Error::Memory`] for
/// one larger than the memory that is left, and [`Error::Scene`] for a pointer of Git LFS
/// and for a compressed file.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>> {
    read_like(path, most, "")
}

/// Reads the file of a scene like [`read`].
///
/// # Errors
/// Returns the errors of [`read`].
pub fn read_scene(path: &Path) -> Result<Vec<u8>> {
    read_like(path, LARGEST_SCENE, ".toml")
}

/// Works as [`read`], for a file whose name usually has some ending.
fn read_like(path: &Path, most: u64, ending: &str) -> Result<Vec<u8>> {
    let refuse = |why: String| Error::io(path)(io::Error::new(io::ErrorKind::InvalidInput, why));
    let metadata = fs::metadata(path).map_err(|why| Error::io(path)(with_nearest(path, ending, why)))?;
    require_file(&metadata).map_err(Error::io(path))?;
    let too_large = |size: u64| {
        let (size, most) = (memory::size(size), memory::size(most));
        refuse(format!("the file has {size}; expected at most {most}"))
    };
    if metadata.len() > most {
        return Err(too_large(metadata.len()));
    }
    // The contents need memory twice: as bytes, and as what is read from them.
    memory::require(2 * metadata.len(), &format!("reading {}", path.display()), |_| {
        "expected a smaller file".into()
    })?;
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    // Some files grow, and some system files report a size of zero.
    let file = File::open(path).map_err(Error::io(path))?;
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 > most {
        return Err(too_large(bytes.len() as u64));
    }
    if bytes.starts_with(b"version https://git-lfs") {
        return Err(Error::Scene(format!(
            "{}: a pointer of Git LFS in place of the file; `git lfs pull` fetches the file itself",
            path.display()
        )));
    }
    let packed = PACKED.iter().find(|(begin, _)| bytes.starts_with(begin));
    if let Some((_, how)) = packed {
        let path = path.display();
        return Err(Error::Scene(format!("{path}: a compressed file; {how} unpacks it")));
    }
    Ok(bytes)
}

/// First bytes of compressed files, and what unpacks them.
const PACKED: [(&[u8], &str); 5] = [
    (b"\x1f\x8b", "`gunzip`"),
    (b"PK\x03\x04", "`unzip`"),
    (b"BZh", "`bunzip2`"),
    (b"\xfd7zXZ", "`unxz`"),
    (b"\x28\xb5\x2f\xfd", "`unzstd`"),
];

/// Adds the nearest name in its folder, of some ending where there is one, to the error of a file
/// that is not there.
fn with_nearest(path: &Path, ending: &str, why: io::Error) -> io::Error {
    if why.kind() != io::ErrorKind::NotFound {
        return why;
    }
    let hint = nearest(path, |near| near.to_string_lossy().ends_with(ending));
    io::Error::new(why.kind(), format!("there is no such file{hint}"))
}

/// Returns a hint at the nearest name in its folder that fits, for a path with nothing there; for
/// one in a folder that is not there, at the nearest folder.
pub(crate) fn nearest(path: &Path, fits: impl Fn(&Path) -> bool) -> String {
    let Some(name) = path.file_name().filter(|_| !path.exists()) else { return String::new() };
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.exists() {
        return nearest(folder, Path::is_dir);
    }
    let paths = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let names = paths
        .filter(|path| fits(path))
        .filter_map(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    let names: Vec<String> = names.collect();
    suggestion(&name.to_string_lossy(), &names.iter().map(String::as_str).collect::<Vec<_>>())
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
            if let Ok(metadata) = fs::symlink_metadata(path) {
                require_file(&metadata)?;
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

/// Creates the folder of a file if necessary.
///
/// # Errors
/// Returns [`Error::Io`] where it cannot be created.
pub fn create_parent(path: &Path) -> Result<()> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(Error::io(folder))
}

/// Refuses all that is no plain file, given what the system says about it.
///
/// # Errors
/// Returns an error of the kind [`io::ErrorKind::InvalidInput`] that says what it is.
pub fn require_file(metadata: &Metadata) -> io::Result<()> {
    let kind = match metadata.file_type() {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => "a folder",
        kind if kind.is_symlink() => "a symbolic link",
        _ => "a device, pipe or socket",
    };
    Err(io::Error::new(io::ErrorKind::InvalidInput, format!("{kind}; expected a file")))
}

/// Refuses a file in place of the folder of a run.
///
/// # Errors
/// Returns [`Error::Io`] naming the file.
pub fn refuse_file(path: &Path) -> Result<()> {
    let wrong = || Error::invalid(path, "a file; expected the folder of a run, such as runs/plate");
    if path.is_file() { Err(wrong()) } else { Ok(()) }
}

/// Returns the files of a folder with what a function reads from their names, if it reads anything;
/// none where the folder cannot be read.
pub fn files_of<T>(folder: &Path, read: impl Fn(&str) -> Option<T>) -> Vec<(T, PathBuf)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let named = |path: PathBuf| Some((read(path.file_name()?.to_str()?)?, path));
    entries.filter_map(|entry| named(entry.path())).collect()
}

/// Writes a file whole or not at all.
///
/// The bytes go to a temporary file in the same folder, are written to the disk, and take the name
/// in one atomic step. Neither a reader nor an interrupted run sees a part of the file. On failure
/// the temporary file is removed, and the file that had the name before stays.
///
/// # Errors
/// Returns [`Error::Io`] naming the file.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    write_whole(path, &mut File::options(), |file| file.write_all(bytes))
}

/// Writes a file like [`write_atomic`] piece by piece, which is created with some options.
///
/// # Errors
/// Returns [`Error::Io`] naming the file.
pub fn write_whole(
    path: &Path,
    options: &mut OpenOptions,
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<()> {
    let temporary = temporary_name(path);
    let attempt = || -> io::Result<()> {
        let file = open_plain(options.create(true).truncate(true).write(true), &temporary)?;
        let mut writer = BufWriter::new(file);
        write(&mut writer)?;
        writer.into_inner()?.sync_all()?;
        fs::rename(&temporary, path)?;
        // The new name is in the folder, which must reach the disk too. Some file systems refuse
        // this.
        let _ = path.parent().map(|folder| File::open(folder).and_then(|folder| folder.sync_all()));
        Ok(())
    };
    attempt().map_err(|error| {
        let _ = fs::remove_file(&temporary);
        Error::io(path)(error)
    })
}

/// Returns `folder/.name.<process id>.tmp` for `folder/name`: hidden, and not shared between
/// processes.
fn temporary_name(path: &Path) -> PathBuf {
    let mut name = OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(format!(".{}.tmp", std::process::id()));
    path.with_file_name(name)
}
