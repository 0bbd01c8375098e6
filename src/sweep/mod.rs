//! Sweeps: many runs of one scene over some of its keys.
//!
//! Every run lasts whole periods of the drive and is measured over the periods after the settling
//! ones: its section once per period, extremes, forces, impacts, the number of periods after which
//! it repeats, and the rate at which neighbouring motions part. Runs start as the scene says, or
//! each where the one before ended, which follows an attractor up and down and so finds hysteresis.
//! Keys may have random values too: then probabilities, distributions and sensitivities are told.
//! `docs/sweeps.md` defines every measure and tells how to read the pictures.

mod basins;
mod conduct;
pub mod lyapunov;
mod measures;
#[cfg(feature = "petsc")]
mod on_ranks;
mod one_run;
mod parallel;
mod periodic_mode_runs;
mod pictures;
mod plan;
mod prepared_run;
mod quantities;
mod random_pictures;
mod report;
mod row;
mod rows;
mod statistics;
mod store;

pub use basins::{Attractor, Basins};
pub use conduct::{Loader, SweepRecord, conduct, conduct_one, expected_time, scene_at, spell};
pub use measures::{Measures, ProbeMeasures, repetition};
#[cfg(feature = "petsc")]
pub use on_ranks::RankedSweep;
pub use pictures::{PICTURES, figures};
pub use plan::{Direction, Plan, PlannedRun};
pub use prepared_run::CarriedState;
pub use report::{CSV, JSON, SweepReport};
pub use row::{ProbeHead, SweepRow};
pub use rows::SweepRows;
pub use statistics::{Criterion, MeasureStatistics, Sensitivity, SweepStatistics, check_criteria};
#[cfg(feature = "petsc")]
pub use store::SweepPart;
pub use store::SweepStore;
