//! Scene files, and what each of their effects does.

#[path = "../common/mod.rs"]
mod common;

mod documented;
mod effects;
mod field;
mod motion;
mod reading;
mod supports;
