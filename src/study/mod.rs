//! Questions about a scene that need no run: its natural frequencies, its inf-sup constant, what a run will cost.



mod lanczos;
pub mod modes;


