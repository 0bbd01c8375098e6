//! Scene files, and the effect of each of their tables.

#[path = "../common/mod.rs"]
mod common;

mod bearing;
mod breaks;
mod documented;
mod effects;
mod field;
mod files;
mod friction;
mod hertz;
mod in_time;
mod motion;
mod parameters;
mod patches;
mod points;
mod reading;
mod schema;
mod stops;
mod supports;
