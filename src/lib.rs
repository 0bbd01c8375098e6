//! Thin elastic plates that vibrate and hit rigid obstacles.

pub mod error;
pub mod output;

pub use error::{Error, Result};
