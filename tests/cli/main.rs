//! The command as a user calls it, and its output.

#[path = "../common/mod.rs"]
mod common;

mod animate;
mod beginning;
mod cache;
mod commands;
mod continuation;
mod fields;
mod gallery;
mod inspect;
mod interrupted;
mod limits;
mod modes;
mod output;
mod overwriting;
mod pages;
mod random_sweeps;
mod report;
mod report_many;
mod resume;
mod sound;
mod stresses;
mod study;
mod study_modal;
mod sweep;
