//! Thin elastic plates that vibrate and hit rigid obstacles.

pub mod element;
pub mod error;
pub mod mesh;
pub mod plate;

pub use error::{Error, Result};
