//! Thin elastic plates that vibrate and hit rigid obstacles.

pub mod assembly;
pub mod cli;
pub mod element;
pub mod energy;
pub mod error;
pub mod linalg;
pub mod mesh;
pub mod obstacle;
pub mod output;
pub mod plate;
pub mod scene;
pub mod scheme;
pub mod simulation;
pub mod space;
pub mod vi;

pub use error::{Error, Result};
