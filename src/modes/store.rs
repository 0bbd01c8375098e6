//! Results kept between runs, in files `modes-*.bin` and `compliance-*.bin` of a cache folder.
//!
//! A [`Store`] keeps each result under a key: a hash of 128 bits of all data that determine the
//! result. A result that is read has the bits of the one that was computed. Without [`keep_in`]
//! nothing is kept.
//!
//! A file is written completely or not at all, so that several processes may share the folder. Its
//! numbers become results, so that the folder and each file must belong to the user or the
//! superuser, and nobody else may write there: otherwise nothing is read, and a line says so.
//! When its files exceed a limit, those that were not used for the longest time are removed. A file
//! that cannot be read or written is a matter for a warning: its content is computed then.

use crate::error::{Error, Result};
use crate::memory::grouped;
use crate::{archive, hash, input};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::ffi::OsString;
use std::fs::{self, DirBuilder, File, Metadata};
use std::io::Write as _;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::SystemTime;

/// Limit on the total size of the files, in bytes.
const LIMIT: usize = 2_000_000_000;

/// Environment variable with the folder of the cache; empty for none.
const VARIABLE: &str = "REBOND_CACHE";

/// Name of a kind of results in files and messages, and the verb that follows it.
pub(super) type Kind = [&'static str; 2];
pub(super) const MODES: Kind = ["modes", "are"];
pub(super) const COMPLIANCE: Kind = ["compliance", "is"];

/// Store of the process: studies build their models in several threads.
static STORE: RwLock<Option<Arc<Store>>> = RwLock::new(None);

/// Sets where all models of this process that are built from now on keep their modes; `None`, as at
/// the start, keeps none.
pub fn keep_in(store: Option<Arc<Store>>) {
    *STORE.write().unwrap_or_else(PoisonError::into_inner) = store;
}

/// Returns the store of the process.
pub(crate) fn current_store() -> Option<Arc<Store>> {
    STORE.read().unwrap_or_else(PoisonError::into_inner).clone()
}

/// Returns the folder of the cache in an environment; `None` where it is switched off, or there is
/// no place for one.
pub fn cache_folder(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    if let Some(named) = variable(VARIABLE) {
        return Some(PathBuf::from(named)).filter(|folder| !folder.as_os_str().is_empty());
    }
    // A relative path in these variables is none.
    let absolute = |name: &str| variable(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(base.join("rebond"))
}

/// Folder of kept results.
#[derive(Debug)]
pub struct Store {
    folder: PathBuf,
    /// Limit on the total size of the files, in bytes.
    limit: usize,
    /// Lines on what was read and written. Threads write one after the other under this lock: their
    /// temporary files have the same name.
    lines: Mutex<Vec<String>>,
}

impl Store {
    /// Keeps results in a folder, which is created when needed, up to a total size of 2 GB.
    pub fn new(folder: impl Into<PathBuf>) -> Store {
        Store { folder: folder.into(), limit: LIMIT, lines: Mutex::default() }
    }

    /// Returns lines that say what was read and written since the last call, each only once.
    pub fn take_lines(&self) -> Vec<String> {
        std::mem::take(&mut *self.lines())
    }

    fn lines(&self) -> MutexGuard<'_, Vec<String>> {
        self.lines.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn path(&self, [name, _]: Kind, key: u128) -> PathBuf {
        self.folder.join(format!("{name}-{key:032x}.bin"))
    }

    /// Returns the result that is kept under a key, if it is there, whole and passes a check.
    pub(super) fn get<T: DeserializeOwned>(
        &self,
        kind: Kind,
        key: u128,
        holds: impl FnOnce(&T) -> bool,
    ) -> Option<T> {
        let ([name, verb], path) = (kind, self.path(kind, key));
        let (kept, line) = match self.read(&path) {
            Err(Error::Io { source, .. })
                if matches!(source.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) =>
            {
                return None;
            }
            Err(why) => (None, format!("warning: {name} {verb} not read from the cache: {why}")),
            Ok(bytes) => match parse(&bytes, key).filter(|(_, kept)| holds(kept)) {
                Some((size, kept)) => {
                    // A folder that others own may still be read.
                    let file = input::open_plain(File::options().append(true), &path);
                    let _ = file.and_then(|file| file.set_modified(SystemTime::now()));
                    (Some(kept), told(name, size, "read from", &path, bytes.len()))
                }
                None => {
                    let computed = format!("the {name} {verb} computed and written again");
                    (None, format!("warning: {}: damaged; {computed}", path.display()))
                }
            },
        };
        push(&mut self.lines(), line);
        kept
    }

    /// Keeps a result, given its numbers of columns and dofs.
    pub(super) fn put(&self, kind: Kind, key: u128, size: [usize; 2], result: &impl Serialize) {
        let ([name, verb], path) = (kind, self.path(kind, key));
        let mut lines = self.lines();
        let write = || -> Result<String> {
            let bytes = hash::seal(archive::to_bytes(&(key.to_le_bytes(), size, result))?);
            if bytes.len() > self.limit {
                return Ok(told(name, size, "more than the limit of the cache for", &path, bytes.len()));
            }
            self.make_room(bytes.len() as u64);
            create_folder(&self.folder).map_err(Error::io(&self.folder))?;
            let mut options = File::options();
            #[cfg(unix)]
            std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o644);
            input::write_whole(&path, &mut options, |file| file.write_all(&bytes))?;
            Ok(told(name, size, "kept in", &path, bytes.len()))
        };
        let warning = |why| format!("warning: {name} {verb} not written to the cache: {why}");
        push(&mut lines, write().unwrap_or_else(warning));
    }

    /// Reads a file, if nobody else may have written it.
    fn read(&self, path: &Path) -> Result<Vec<u8>> {
        // Nobody else can exchange the files of a folder that passes.
        for place in [&*self.folder, path] {
            fs::metadata(place).and_then(|metadata| require_trusted(&metadata)).map_err(Error::io(place))?;
        }
        input::read_plain(path).map_err(Error::io(path))
    }

    /// Removes files that were not used for the longest time until the others leave room for a
    /// number of bytes. Other processes may remove them at the same time.
    fn make_room(&self, bytes: u64) {
        let ours = input::files_of(&self.folder, |name| is_ours(name).then_some(()));
        let about = |((), path): ((), PathBuf)| {
            let about = fs::symlink_metadata(&path).ok()?;
            Some((about.modified().ok()?, about.len(), path))
        };
        let mut files: Vec<(SystemTime, u64, PathBuf)> = ours.into_iter().filter_map(about).collect();
        files.sort_unstable();
        let mut total = files.iter().map(|(_, size, _)| size).sum::<u64>() + bytes;
        for (_, size, path) in files {
            if total > self.limit as u64 && fs::remove_file(path).is_ok() {
                total -= size;
            }
        }
    }
}

/// Returns the numbers of columns and dofs in the bytes of a file, and its content; `None` where
/// they are damaged or have another key.
fn parse<T: DeserializeOwned>(bytes: &[u8], key: u128) -> Option<([usize; 2], T)> {
    let (stored, size, content) = archive::from_bytes::<([u8; 16], _, _)>(hash::unseal(bytes)?).ok()?;
    (stored == key.to_le_bytes()).then_some((size, content))
}

/// Adds a line that is not there.
fn push(lines: &mut Vec<String>, line: String) {
    if !lines.contains(&line) {
        lines.push(line);
    }
}

/// Refuses what another user has written, or might have.
#[cfg_attr(not(unix), allow(unused_variables))]
fn require_trusted(metadata: &Metadata) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        let refuse = |why: &str| Err(io::Error::new(ErrorKind::PermissionDenied, why));
        if ![0, rustix::process::geteuid().as_raw()].contains(&metadata.uid()) {
            return refuse("it belongs to another user");
        }
        if metadata.mode() & 0o022 != 0 {
            return refuse("others may write to it; `chmod go-w` changes that");
        }
    }
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
    name.ends_with(end) && [MODES, COMPLIANCE].iter().any(|[kind, _]| name.starts_with(&format!("{kind}-")))
}

/// Returns a text such as `modes: 200 of 7 920 dofs, read from FILE (25 MB)`.
fn told(name: &str, size: [usize; 2], what: &str, path: &Path, bytes: usize) -> String {
    let ([columns, dofs], path) = (size.map(|count| grouped(count as u64)), path.display());
    let (unit, length) = if bytes < 1_000_000 { ("kB", 1e3) } else { ("MB", 1e6) };
    format!("{name}: {columns} of {dofs} dofs, {what} {path} ({:.0} {unit})", bytes as f64 / length)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use std::time::Duration;

    /// Store in an empty folder of its own, which is removed with it.
    pub struct Shelf(pub Arc<Store>);

    impl Shelf {
        pub fn new(name: &str) -> Shelf {
            let folder = std::env::temp_dir().join(format!("rebond-store-{name}-{}", std::process::id()));
            let _ = fs::remove_dir_all(&folder);
            Shelf(Arc::new(Store::new(folder)))
        }

        /// Returns the bytes of the only file, and its path.
        pub fn file(&self) -> (Vec<u8>, PathBuf) {
            let mut paths = fs::read_dir(&self.0.folder).unwrap().map(|entry| entry.unwrap().path());
            let path = paths.next().unwrap();
            assert!(paths.next().is_none());
            (fs::read(&path).unwrap(), path)
        }

        /// Returns whether the lines since the last call contain such words, in this order.
        pub fn said(&self, words: &[&str]) -> bool {
            let lines = self.0.take_lines();
            lines.len() == words.len() && lines.iter().zip(words).all(|(line, word)| line.contains(word))
        }
    }

    impl Drop for Shelf {
        fn drop(&mut self) {
            let _ = fs::remove_dir_all(&self.0.folder);
        }
    }

    #[test]
    fn the_folder_is_the_first_that_the_environment_names() {
        let place = |set: &[(&str, &str)]| {
            let value = |name: &str| {
                set.iter().find(|(variable, _)| *variable == name).map(|(_, value)| value.into())
            };
            cache_folder(value).map(|folder| folder.to_string_lossy().into_owned())
        };
        let home = ("HOME", "/home/ada");
        assert_eq!(place(&[]), None);
        assert_eq!(place(&[home]).as_deref(), Some("/home/ada/.cache/rebond"));
        assert_eq!(place(&[home, ("XDG_CACHE_HOME", "here")]).as_deref(), Some("/home/ada/.cache/rebond"));
        assert_eq!(place(&[home, ("XDG_CACHE_HOME", "/var/cache")]).as_deref(), Some("/var/cache/rebond"));
        assert_eq!(place(&[home, (VARIABLE, "modes")]).as_deref(), Some("modes"));
        assert_eq!(place(&[home, (VARIABLE, "")]), None);
    }

    #[test]
    fn any_flipped_bit_and_any_missing_end_is_noticed() {
        let shelf = Shelf::new("bits");
        let numbers = vec![1.0, -0.0, f64::MIN_POSITIVE];
        shelf.0.put(MODES, 7, [1, 3], &numbers);
        let (bytes, _) = shelf.file();
        let content = |bytes: &[u8], key| parse::<Vec<f64>>(bytes, key).map(|(_, kept)| kept);
        assert_eq!(content(&bytes, 7), Some(numbers));
        assert!(content(&bytes, 8).is_none(), "of another key");
        for bit in 0..8 * bytes.len() {
            let mut damaged = bytes.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert!(content(&damaged, 7).is_none(), "bit {bit}");
        }
        assert!((0..bytes.len()).all(|end| content(&bytes[..end], 7).is_none()));
    }

    #[test]
    fn the_files_that_were_used_last_stay_within_the_limit() {
        let Store { folder, lines, .. } = Store::new(Shelf::new("limit").0.folder.clone());
        let shelf = Shelf(Arc::new(Store { folder, lines, limit: 2000 }));
        let put = |key, length| shelf.0.put(MODES, key, [1, length], &vec![1.0; length]);
        let get = |key| shelf.0.get(MODES, key, |kept: &Vec<f64>| kept.len() == 100).is_some();
        put(1, 100);
        put(2, 100);
        let foreign = shelf.0.folder.join("modes-of-others.csv");
        fs::write(&foreign, vec![0; 3000]).unwrap();
        let hour_ago = SystemTime::now() - Duration::from_secs(3600);
        for key in [1, 2] {
            let file = File::options().append(true).open(shelf.0.path(MODES, key)).unwrap();
            file.set_modified(hour_ago + Duration::from_secs(key as u64)).unwrap();
        }
        assert!(get(1));
        put(3, 100);
        assert!(get(1) && !get(2) && get(3) && foreign.exists());
        assert!(!shelf.0.take_lines().iter().any(|line| line.contains("warning")));
        put(4, 1000);
        assert!(shelf.said(&["1 of 1 000 dofs, more than the limit of the cache for"]));
        assert!(get(1) && !get(4) && get(3));
    }
}
