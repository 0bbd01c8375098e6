//! The schemes in time.

#[path = "../common/mod.rs"]
mod common;

mod balance;
mod bouncing_ball;
mod cantilever;
mod conserving;
mod continuation;
mod damping;
mod energy;
mod exact;
mod external_load;
mod following_pressure;
mod forced;
mod forces;
mod friction;
mod hertz;
mod impulses;
mod kinks;
mod modal;
mod modal_compliance;
mod modal_damped_stops;
mod modal_damping;
mod modal_hertz;
mod modal_implicit;
mod modal_limits;
mod moving;
mod period_three_bar;
mod random_sweeps;
mod restored;
mod ribs;
mod slider;
mod splitting;
mod stops;
mod stresses;
mod stretching;
mod stretching_on_mesh;
mod sweeps;
mod work;
