//! Scene files, and what each of their effects does.

#[path = "../common/mod.rs"]
mod common;

mod bearing;
mod breaks;
mod documented;
mod effects;
mod field;
mod files;
mod in_time;
mod motion;
mod patches;
mod points;
mod reading;
mod supports;
