//! Files `modes-*.bin` and `compliance-*.bin` of a cache folder: natural modes, and the compliance
//! that they leave, kept between runs.
//!
//! A file is written completely or not at all, so that several processes may share the folder. Its
//! numbers become results, so that the folder and each file must belong to the user or the
//! superuser, and nobody else may write there: otherwise nothing is read, and a line says so.
//! When its files exceed a limit, those that were not used for the longest time are removed. A file
//! that cannot be read or written is a matter for a warning: its content is computed then.

use super::text::grouped;
use super::write_private;
use crate::error::Error;
use crate::input;
use crate::modes::{BasisStore, KeptKind, KeptSize};
use std::ffi::OsString;
use std::fs::{self, DirBuilder, File, Metadata};
use std::io::{self, ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

/// Limit on the total size of the files, in bytes.
pub const LIMIT: u64 = 2_000_000_000;

/// Environment variable with the folder of the cache; empty for none.
const VARIABLE: &str = "REBOND_CACHE";

/// Returns the folder of the cache in an environment; `None` where it is switched off, or there is
/// no place for one.
pub fn folder(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    if let Some(named) = variable(VARIABLE) {
        return Some(PathBuf::from(named)).filter(|folder| !folder.as_os_str().is_empty());
    }
    // A relative path in these variables is none.
    let absolute = |name: &str| variable(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(base.join("rebond"))
}

/// Folder of kept modes.
#[derive(Debug)]
pub struct KeptModes {
    folder: PathBuf,
    limit: u64,
    /// Lines on what was read and written.
    lines: Mutex<Vec<String>>,
    /// Threads write one after the other: their temporary files have the same name.
    writing: Mutex<()>,
}

impl KeptModes {
    /// Keeps modes in a folder, which is created when needed, up to a total size of `limit` bytes.
    pub fn new(folder: impl Into<PathBuf>, limit: u64) -> KeptModes {
        KeptModes { folder: folder.into(), limit, lines: Mutex::default(), writing: Mutex::default() }
    }

    /// Returns lines that say what was read and written since the last call, each only once.
    pub fn take_lines(&self) -> Vec<String> {
        std::mem::take(&mut *self.lines.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn path(&self, kind: KeptKind, name: &str) -> PathBuf {
        self.folder.join(format!("{}-{name}.bin", kind.name()))
    }

    fn say(&self, line: String) {
        let mut lines = self.lines.lock().unwrap_or_else(PoisonError::into_inner);
        if !lines.contains(&line) {
            lines.push(line);
        }
    }

    fn warn(&self, kind: KeptKind, what: &str, why: &Error) {
        let (name, verb) = match kind {
            KeptKind::Modes => (kind.name(), "are"),
            KeptKind::Compliance => (kind.name(), "is"),
        };
        self.say(format!("warning: {name} {verb} not {what} the cache: {why}"));
    }

    /// Removes files that were not used for the longest time until the others leave room for a
    /// number of bytes. Other processes may remove them at the same time.
    fn make_room(&self, bytes: u64) {
        let Ok(entries) = fs::read_dir(&self.folder) else { return };
        let ours = entries.flatten().filter(|entry| is_ours(&entry.file_name().to_string_lossy()));
        let mut files: Vec<(SystemTime, u64, PathBuf)> = ours
            .filter_map(|entry| {
                let about = entry.metadata().ok()?;
                Some((about.modified().ok()?, about.len(), entry.path()))
            })
            .collect();
        files.sort_unstable();
        let mut total = files.iter().map(|(_, size, _)| size).sum::<u64>() + bytes;
        for (_, size, path) in files {
            if total <= self.limit {
                break;
            }
            if fs::remove_file(path).is_ok() {
                total -= size;
            }
        }
    }
}

/// Refuses what another user has written, or might have.
#[cfg(unix)]
fn require_trusted(found: &Metadata) -> io::Result<()> {
    use std::os::unix::fs::MetadataExt;
    let wrong = if ![0, rustix::process::geteuid().as_raw()].contains(&found.uid()) {
        "it belongs to another user"
    } else if found.mode() & 0o022 != 0 {
        "others may write to it; `chmod go-w` changes that"
    } else {
        return Ok(());
    };
    Err(io::Error::new(ErrorKind::PermissionDenied, wrong))
}

#[cfg(not(unix))]
fn require_trusted(_: &Metadata) -> io::Result<()> {
    Ok(())
}

/// Creates a folder where it is missing, which nobody else may write to.
fn create_folder(folder: &Path) -> io::Result<()> {
    let mut builder = DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o755);
    builder.recursive(true).create(folder)
}

/// Returns whether a name is that of a kept file, or of a temporary file for one.
fn is_ours(name: &str) -> bool {
    let (name, end) = name.strip_prefix('.').map_or((name, ".bin"), |hidden| (hidden, ".tmp"));
    let kinds = [KeptKind::Modes, KeptKind::Compliance];
    name.ends_with(end) && kinds.iter().any(|kind| name.starts_with(&format!("{}-", kind.name())))
}

/// Returns a text such as `modes: 200 of 7 920 dofs, read from FILE (25 MB)`.
fn told(kind: KeptKind, size: KeptSize, what: &str, path: &Path, bytes: &[u8]) -> String {
    let length = match bytes.len() as f64 / 1e3 {
        length if length < 1e3 => format!("{length:.0} kB"),
        length => format!("{:.0} MB", length / 1e3),
    };
    format!(
        "{}: {} of {} dofs, {what} {} ({length})",
        kind.name(),
        grouped(size.columns as u64),
        grouped(size.dofs as u64),
        path.display(),
    )
}

impl BasisStore for KeptModes {
    fn read(&self, kind: KeptKind, name: &str) -> Option<Vec<u8>> {
        let path = self.path(kind, name);
        let read = |path: &Path| -> io::Result<Vec<u8>> {
            let mut file = input::open_plain(File::options().read(true), path)?;
            require_trusted(&file.metadata()?)?;
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let trusted = fs::metadata(&self.folder).and_then(|found| require_trusted(&found));
        let bytes =
            trusted.map_err(|why| (&self.folder, why)).and_then(|()| read(&path).map_err(|why| (&path, why)));
        match bytes {
            Ok(bytes) => Some(bytes),
            Err((_, why)) if matches!(why.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => None,
            Err((path, why)) => {
                self.warn(kind, "read from", &Error::io(path)(why));
                None
            }
        }
    }

    fn write(&self, kind: KeptKind, name: &str, size: KeptSize, bytes: &[u8]) {
        let (path, length) = (self.path(kind, name), bytes.len() as u64);
        if length > self.limit {
            return self.say(told(kind, size, "more than the limit of the cache for", &path, bytes));
        }
        let _alone = self.writing.lock().unwrap_or_else(PoisonError::into_inner);
        self.make_room(length);
        let created = create_folder(&self.folder).map_err(Error::io(&self.folder));
        match created.and_then(|()| write_private(&path, bytes)) {
            Ok(()) => self.say(told(kind, size, "kept in", &path, bytes)),
            Err(why) => self.warn(kind, "written to", &why),
        }
    }

    fn accept(&self, kind: KeptKind, name: &str, size: KeptSize, bytes: &[u8]) {
        let path = self.path(kind, name);
        // A folder that others own may still be read.
        let file = input::open_plain(File::options().append(true), &path);
        let _ = file.and_then(|file| file.set_modified(SystemTime::now()));
        self.say(told(kind, size, "read from", &path, bytes));
    }

    fn reject(&self, kind: KeptKind, name: &str) {
        let what = match kind {
            KeptKind::Modes => "the modes are",
            KeptKind::Compliance => "the compliance is",
        };
        let path = self.path(kind, name);
        self.say(format!("warning: {}: damaged; {what} computed and written again", path.display()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_is_the_first_that_the_environment_names() {
        let of = |set: &[(&str, &str)]| {
            let value = |name: &str| set.iter().find(|(own, _)| *own == name).map(|(_, value)| value.into());
            folder(value).map(|folder| folder.to_string_lossy().into_owned())
        };
        let home = ("HOME", "/home/ada");
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[home]).as_deref(), Some("/home/ada/.cache/rebond"));
        assert_eq!(of(&[home, ("XDG_CACHE_HOME", "here")]).as_deref(), Some("/home/ada/.cache/rebond"));
        assert_eq!(of(&[home, ("XDG_CACHE_HOME", "/var/cache")]).as_deref(), Some("/var/cache/rebond"));
        assert_eq!(of(&[home, (VARIABLE, "modes")]).as_deref(), Some("modes"));
        assert_eq!(of(&[home, (VARIABLE, "")]), None);
    }
}
