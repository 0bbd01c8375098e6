//! Cache of natural modes, for commands that build models.

use super::printing;
use crate::modes::{self, Store, cache_folder};
use clap::Args;
use std::env;
use std::sync::Arc;

/// Whether natural modes are kept between runs.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct CacheArgs {
    /// Neither read nor keep modes and compliance in $REBOND_CACHE (default: ~/.cache/rebond)
    #[arg(long)]
    no_cache: bool,
}

/// Cache that the models of a command use, until it is dropped.
pub(super) struct ModeCache {
    store: Option<Arc<Store>>,
    is_silent: bool,
    /// Whether only warnings are told.
    pub is_brief: bool,
}

impl CacheArgs {
    /// Makes models keep their modes, unless the arguments or the environment forbid it.
    pub fn open(self, is_silent: bool) -> ModeCache {
        let folder = if self.no_cache { None } else { cache_folder(|name| env::var_os(name)) };
        let store = folder.map(|folder| Arc::new(Store::new(folder)));
        modes::keep_in(store.clone());
        ModeCache { store, is_silent, is_brief: false }
    }
}

impl ModeCache {
    /// Passes lines on what was read and written to `say`, unless in quiet mode.
    pub fn tell(&self, say: impl Fn(&str)) {
        let lines = self.store.iter().flat_map(|store| store.take_lines());
        for line in lines.filter(|_| !self.is_silent) {
            match line.strip_prefix("warning: ") {
                Some(text) => say(&printing::warning(text)),
                None if self.is_brief => {}
                None => say(&line),
            }
        }
    }
}

impl Drop for ModeCache {
    fn drop(&mut self) {
        modes::keep_in(None);
        self.tell(|line| eprintln!("{line}"));
    }
}
