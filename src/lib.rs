//! Thin elastic plates that vibrate and hit rigid obstacles.

pub mod error;
pub mod mesh;
pub mod element;
pub mod plate;
pub mod space;
pub mod linalg;
pub mod assembly;
pub mod obstacle;
pub mod vi;
pub mod scheme;
pub mod energy;
pub mod scene;
pub mod simulation;
pub mod output;
pub mod study;

pub use error::{Error, Result};
