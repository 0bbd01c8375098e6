//! Exclusive right of a process to write into a run folder, without loss of earlier results.
//!
//! A process that writes into a run folder holds a lock on its file `.lock`, which names the
//! process and the scene. The system releases the lock however the process ends, so that a file
//! without a lock only marks a run that was interrupted there.

use super::checkpoint::{self, Identity};
use super::{contacts, events, extremes, history, plot, reactions, report, summary, vtu};
use super::{if_there, paths_in};
use crate::error::{Error, Result};
use crate::input;
use crate::motion;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::ffi::OsStr;
use std::fs::{self, File, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

/// Name of the lock file.
const LOCK: &str = ".lock";

/// Names of files and folders that runs, plots and reports write, except checkpoints.
const RESULTS: [&str; 13] = [
    history::FILE,
    checkpoint::STATE,
    motion::FILE,
    contacts::FILE,
    reactions::FILE,
    events::FILE,
    summary::FILE,
    extremes::FILE,
    extremes::PARALLEL,
    vtu::FILE,
    vtu::FOLDER,
    plot::FOLDER,
    report::FILE,
];

/// Content of the lock file.
#[derive(Debug, Serialize, Deserialize)]
struct Holder {
    process: u32,
    scene: Identity,
}

/// Exclusive claim on a run folder.
///
/// Dropping it removes the lock file, and folders that were created for it and stayed empty.
#[derive(Debug)]
pub struct RunLock {
    path: PathBuf,
    _file: File,
    /// Created folders, the innermost first.
    made: Vec<PathBuf>,
}

impl RunLock {
    /// Claims a folder for a run of a scene; the folder is created if necessary.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where the folder cannot be created or locked, or another process holds
    /// the lock.
    pub fn new(folder: &Path, scene: &Identity) -> Result<RunLock> {
        let made = folder.ancestors().take_while(|path| !path.as_os_str().is_empty() && !path.exists());
        let made = made.map(Path::to_owned).collect();
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
        let path = folder.join(LOCK);
        loop {
            let mut options = File::options();
            let mut file =
                input::open_plain(options.create(true).truncate(false).read(true).write(true), &path)
                    .map_err(Error::io(&path))?;
            // Another process that only tests the lock holds it for an instant.
            let looks = std::iter::repeat_n(Duration::from_millis(20), 5);
            let is_ours = |file: &mut File| lock(file, File::try_lock);
            if !is_ours(&mut file) && !looks.into_iter().any(|pause| (sleep(pause), is_ours(&mut file)).1) {
                return Err(taken(folder, &mut file));
            }
            // The former owner removes the file as it ends; a process that waited for the lock then
            // holds a file without a name.
            if !is_named(&file, &path) {
                continue;
            }
            let holder = Holder { process: std::process::id(), scene: scene.clone() };
            let text = serde_json::to_vec(&holder).unwrap_or_default();
            file.set_len(0)
                .and_then(|()| file.rewind())
                .and_then(|()| file.write_all(&text))
                .map_err(Error::io(&path))?;
            return Ok(RunLock { path, _file: file, made });
        }
    }
}

impl Drop for RunLock {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
        for folder in &self.made {
            // The removal fails where the folder is not empty.
            let _ = fs::remove_dir(folder);
        }
    }
}

/// Refuses a folder that another process writes into.
///
/// # Errors
/// Returns [`Error::Io`] naming that process, or a lock that is no plain file.
pub fn refuse_running(folder: &Path) -> Result<()> {
    let path = folder.join(LOCK);
    let mut file = match input::open_plain(File::options().read(true), &path) {
        Err(why) if why.kind() == io::ErrorKind::InvalidInput => return Err(Error::io(path)(why)),
        Err(_) => return Ok(()),
        Ok(file) => file,
    };
    if lock(&mut file, File::try_lock_shared) { Ok(()) } else { Err(taken(folder, &mut file)) }
}

/// Locks a file.
///
/// On a file system without locks, the lock counts as held if the process that the file names is
/// alive.
fn lock(file: &mut File, attempt: impl Fn(&File) -> std::result::Result<(), TryLockError>) -> bool {
    match attempt(file) {
        Ok(()) => true,
        Err(TryLockError::WouldBlock) => false,
        Err(TryLockError::Error(_)) => holder(file).is_none_or(|holder| {
            holder.process == std::process::id() || !Path::new(&format!("/proc/{}", holder.process)).exists()
        }),
    }
}

fn holder(file: &mut File) -> Option<Holder> {
    let mut text = String::new();
    file.read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

/// Returns whether a file still has its name.
#[cfg(unix)]
fn is_named(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    matches!((file.metadata(), fs::metadata(path)), (Ok(one), Ok(other)) if one.ino() == other.ino() && one.dev() == other.dev())
}

#[cfg(not(unix))]
fn is_named(_: &File, path: &Path) -> bool {
    path.exists()
}

fn taken(folder: &Path, file: &mut File) -> Error {
    let process = holder(file).map_or(String::new(), |holder| format!(" (process {})", holder.process));
    let words = format!("another run writes here{process}: wait for its end, or choose another folder");
    Error::io(folder)(io::Error::new(io::ErrorKind::WouldBlock, words))
}

/// Refuses to start a run that would overwrite something.
///
/// Refused are a run in progress, files that no run writes, an unfinished run, and results of
/// another scene; `overwrite` permits the last two. The same scene may replace its own results.
///
/// # Errors
/// Returns [`Error::Usage`] with the remedy, or [`Error::Io`] where the folder cannot be read.
pub fn refuse_results(folder: &Path, scene: &Identity, resolved: &Value, overwrite: bool) -> Result<()> {
    refuse_running(folder)?;
    let is_own = |name: &str| name == LOCK || RESULTS.contains(&name) || checkpoint::step_of(name).is_some();
    refuse_foreign(folder, "run", "--out", is_own)?;
    if overwrite {
        return Ok(());
    }
    let shown = folder.display();
    if checkpoint::any(folder)? {
        return Err(Error::Usage(format!(
            "{shown} has checkpoints of an unfinished run: `rebond resume {shown}` goes on with it, \
             --overwrite starts over"
        )));
    }
    let remedy = "--out DIR names another folder, --overwrite replaces them";
    let path = folder.join(summary::FILE);
    let wrong = if let Some(bytes) = if_there(&path, input::read_plain(&path))? {
        let summary: Value = serde_json::from_slice(&bytes).unwrap_or_default();
        if Identity::of_summary(&summary).is_some_and(|identity| identity == *scene) {
            return Ok(());
        }
        let told = difference("", &summary["scene"], resolved).filter(|_| summary["scene"].is_object());
        let difference = told.map_or(String::new(), |difference| format!(" ({difference})"));
        format!("the results of another scene{difference}")
    } else {
        let lock = input::open_plain(File::options().read(true), &folder.join(LOCK));
        let cut_off = lock.ok().and_then(|mut file| holder(&mut file));
        let is_same = cut_off.is_some_and(|holder| holder.scene == *scene);
        let Some(name) = RESULTS.iter().find(|name| !is_same && folder.join(name).exists()) else {
            return Ok(());
        };
        format!("results without a summary that would tell their scene ({name})")
    };
    Err(Error::Usage(format!("{shown} holds {wrong}: {remedy}")))
}

/// Refuses a folder with files that the command does not write there, or with links, pipes and
/// devices under the names of those that it writes; a missing folder passes, and a link to a folder
/// counts as one.
///
/// # Errors
/// Returns [`Error::Usage`] naming the first foreign file and the option for another folder, or
/// [`Error::Io`] where the folder cannot be read, or for what is no plain file.
pub fn refuse_foreign(
    folder: &Path,
    command: &str,
    option: &str,
    is_own: impl Fn(&str) -> bool,
) -> Result<()> {
    let paths = paths_in(folder)?;
    for path in paths.iter().filter(|path| !path.is_dir()) {
        let metadata = path.symlink_metadata();
        metadata.and_then(|metadata| input::require_file(&metadata)).map_err(Error::io(path))?;
    }
    let mut names = paths.iter().filter_map(|path| path.file_name()).map(OsStr::to_string_lossy);
    names.find(|name| !is_own(name) && !is_passing(name)).map_or(Ok(()), |name| {
        Err(Error::Usage(format!(
            "{} holds {name}, which no {command} writes: {option} DIR names another folder",
            folder.display()
        )))
    })
}

/// Returns whether a name is that of a temporary file.
///
/// These are the files of [`super::write_atomic`], and those that a network file system keeps for
/// deleted files that are open.
fn is_passing(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".tmp") || name.starts_with(".nfs")
}

/// Describes the first difference of two values below a key: `time.step: 1e-5 there, 5e-6 here`.
fn difference(key: &str, there: &Value, here: &Value) -> Option<String> {
    let below = |name: &str| if key.is_empty() { name.to_owned() } else { format!("{key}.{name}") };
    match (there, here) {
        _ if there == here => None,
        (Value::Object(a), Value::Object(b)) => {
            let alone = |a: &serde_json::Map<String, Value>, b: &serde_json::Map<String, Value>| {
                a.keys().find(|name| !b.contains_key(*name)).map(|name| below(name))
            };
            let only_here = alone(b, a).map(|name| name + " only here");
            let only = only_here.or_else(|| Some(alone(a, b)? + " only there"));
            only.or_else(|| a.iter().find_map(|(name, a)| difference(&below(name), a, &b[name])))
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            let mut pairs = a.iter().zip(b).enumerate();
            pairs.find_map(|(i, (a, b))| difference(&below(&i.to_string()), a, b))
        }
        _ => {
            let texts = [there, here].map(Value::to_string);
            let [there, here] = texts.each_ref().map(|text| if text.len() > 40 { "other" } else { text });
            Some(if there == here { key.to_owned() } else { format!("{key}: {there} there, {here} here") })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn the_first_key_that_differs_is_named() {
        let one = json!({ "a": { "b": [1, 2.5] }, "c": "x" });
        let said = |other: Value| difference("", &one, &other);
        assert_eq!(said(one.clone()), None);
        assert_eq!(
            said(json!({ "a": { "b": [1, 2.5] }, "c": "y", "d": [{}] })).as_deref(),
            Some("d only here")
        );
        assert_eq!(said(json!({ "a": {}, "c": "x" })).as_deref(), Some("a.b only there"));
        assert_eq!(
            said(json!({ "a": { "b": [1, 3] }, "c": "x" })).as_deref(),
            Some("a.b.1: 2.5 there, 3 here")
        );
        assert_eq!(
            said(json!({ "a": { "b": [1] }, "c": "x" })).as_deref(),
            Some("a.b: [1,2.5] there, [1] here")
        );
        assert_eq!(
            said(json!({ "a": { "b": [1, 2.5] }, "c": "y" })).as_deref(),
            Some("c: \"x\" there, \"y\" here")
        );
    }
}
