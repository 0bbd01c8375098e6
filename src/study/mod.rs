//! Questions about a scene that need no run: its natural frequencies, its inf-sup constant, what a run will cost.

pub mod infsup;
mod lanczos;
pub mod modes;
