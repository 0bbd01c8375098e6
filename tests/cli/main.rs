//! The command as a user calls it, and what it writes.

#[path = "../common/mod.rs"]
mod common;

mod commands;
mod fields;
mod gallery;
mod inspect;
mod interrupted;
mod limits;
mod output;
mod overwriting;
mod resume;
mod study;
