//! Cache of natural modes, for commands that build models.

use crate::modes;
use crate::output::kept_modes::{KeptModes, LIMIT};
use clap::Args;
use std::env;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;

/// Environment variable with the folder of the cache; empty for none.
const VARIABLE: &str = "REBOND_CACHE";

/// Whether natural modes are kept between runs.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct CacheArgs {
    /// Neither read nor keep modes and compliance in $REBOND_CACHE (default: ~/.cache/rebond)
    #[arg(long)]
    no_cache: bool,
}

/// Cache that the models of a command use, until it is dropped.
pub(super) struct ModeCache {
    kept: Option<Arc<KeptModes>>,
    is_silent: bool,
}

impl CacheArgs {
    /// Makes models keep their modes, unless the arguments or the environment forbid it.
    pub fn open(self, is_silent: bool) -> ModeCache {
        let folder = if self.no_cache { None } else { folder(|name| env::var_os(name)) };
        let kept = folder.map(|folder| Arc::new(KeptModes::new(folder, LIMIT)));
        modes::keep_in(kept.clone().map(|kept| kept as Arc<dyn modes::BasisStore>));
        ModeCache { kept, is_silent }
    }
}

impl ModeCache {
    /// Passes lines on what was read and written to `say`, unless in quiet mode.
    pub fn tell(&self, say: impl Fn(&str)) {
        let lines = self.kept.iter().flat_map(|kept| kept.take_lines());
        lines.filter(|_| !self.is_silent).for_each(|line| say(&line));
    }
}

impl Drop for ModeCache {
    fn drop(&mut self) {
        modes::keep_in(None);
        self.tell(|line| eprintln!("{line}"));
    }
}

/// Returns the folder of the cache in an environment; `None` where it is switched off, or there is
/// no place for one.
fn folder(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    if let Some(named) = variable(VARIABLE) {
        return Some(PathBuf::from(named)).filter(|folder| !folder.as_os_str().is_empty());
    }
    // A relative path in these variables is none.
    let absolute = |name: &str| variable(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let base = absolute("XDG_CACHE_HOME").or_else(|| Some(absolute("HOME")?.join(".cache")))?;
    Some(base.join("rebond"))
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
