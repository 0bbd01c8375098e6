//! Commands as rows of their registry.

use crate::error::Result;
use clap::{ArgMatches, Args};

/// Function that describes the program with all its commands.
pub(super) type Program = fn() -> clap::Command;

/// Command with its options.
pub(super) trait Execute {
    fn execute(&self, program: Program) -> Result<()>;
}

/// Row of the registry of commands.
pub(super) struct Entry {
    pub name: &'static str,
    /// Whether several processes take part, each of which would else repeat the command.
    pub is_on_ranks: bool,
    pub declare: fn(clap::Command) -> clap::Command,
    pub parse: fn(&ArgMatches) -> std::result::Result<Box<dyn Execute>, clap::Error>,
}

impl Entry {
    pub const fn new<C: Args + Execute + 'static>(name: &'static str) -> Entry {
        let parse = |matches: &ArgMatches| Ok(Box::new(C::from_arg_matches(matches)?) as Box<dyn Execute>);
        Entry { name, is_on_ranks: false, declare: C::augment_args, parse }
    }

    pub const fn on_ranks(self) -> Entry {
        Entry { is_on_ranks: true, ..self }
    }
}
