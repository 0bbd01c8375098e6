//! Thin elastic plates that vibrate and hit obstacles.
//!
//! A Kirchhoff-Love plate with deflection u satisfies `$M \ddot U + K U = F + G^T r$` between rigid
//! obstacles `$\alpha^- \le G U \le \alpha^+$`, which push back with the reactions r only where
//! they touch. The crate discretises it with conforming C1 elements, steps through time with the
//! schemes of Pozzolini, Renard and Salaün (CSMA 2013), and solves each step's bound-constrained
//! problem exactly.
//!
//! A module imports only modules above it:
//!
//! | module | contents |
//! |---|---|
//! | [`error`] | the error type and its exit codes |
//! | [`quantity`] | numbers and quantities as texts |
//! | [`communicator`] | collective operations over all ranks, with the verbs of MPI |
//! | [`memory`] | available memory, and refusal of work that does not fit |
//! | [`random`] | pseudo-random numbers, distributions and points, the same on every machine |
//! | [`archive`] | saving and restoring the state of a run |
//! | [`motion`] | a state from which another run starts |
//! | [`geometry`] | points and polygons |
//! | [`field`] | numbers and formulas of x, y and t; tables of time |
//! | [`element`] | reduced HCT triangles and FVS quadrilaterals |
//! | [`mesh`] | nodes, cells and their names; rectangles and mesh files |
//! | [`plate`] | element matrices from thickness and material |
//! | [`stress`] | bending moments, and stresses at the surfaces |
//! | [`kernels`] | products of cells and loops over vectors, in the processor's registers |
//! | [`linalg`] | the `Engine` trait and its native implementation |
//! | [`dof_map`] | three dofs per node, supports |
//! | [`partition`] | a rank's part of the mesh, and its relation to those of the other ranks |
//! | `petsc` | safe handles on PETSc objects (feature `petsc`) |
//! | `distributed` | the engine and the mesh over all ranks (feature `petsc`) |
//! | [`modes`] | natural frequencies and shapes |
//! | [`membrane`] | strain and force of the plate in its plane, energy of stretching |
//! | [`assembly`] | the only loop over cells |
//! | [`contact_law`] | laws of bounds that yield, one file each |
//! | [`obstacle`] | bounds on the deflections |
//! | [`vi`] | the bound-constrained problem of a step, and the check of its answers |
//! | [`energy`] | energies and the energy guard |
//! | [`scheme`] | Newmark, midpoint, conserving and exact schemes, static equilibrium |
//! | [`lock_step`] | Newmark runs of several equal systems at once |
//! | [`scene`] | validated scenes from TOML |
//! | [`simulation`] | the model, the main loop and its observers |
//! | [`output`] | csv, json, vtu, svg, png, html, progress |
//! | [`study`] | inspection, inf-sup constant, comparisons, accuracy, the paper's figures |
//! | [`sweep`] | many runs over keys of a scene, one by one or at random |
//! | [`continuation`] | branches of periodic motions, stable or not |
//! | [`cli`] | the command |
//!
//! Readers of the paper find its parts here:
//!
//! | paper | code |
//! |---|---|
//! | equation (3): coefficient of restitution e | [`scheme::NewmarkParameters::restitution`] |
//! | section 3: reduced HCT and FVS elements | [`element::hct`], [`element::fvs`] |
//! | section 3: admissible deflections `$K^h$`, matrix G | [`obstacle::Bounds`] |
//! | section 3: singular mass `$M = B^T C^{-1} B$` | [`linalg::SingularMassCell`] |
//! | equation (5): semi-discrete problem | [`scheme::System`], [`scheme::massless::potential`] |
//! | section 3: inf-sup condition | [`study::infsup`] |
//! | section 4.1: Newmark-e-beta scheme | [`scheme::newmark`] |
//! | section 4.2, equation (6): midpoint scheme | [`scheme::midpoint`] |
//! | section 5.2: energy `$E_n$` | [`energy::Energies`] |
//! | figures 1 to 6 | [`study::figures`] |
//!
//! ```
//! use rebond::{scene::Scene, simulation::Model};
//!
//! let scene = Scene::from_str(
//!     r#"
//!     mesh = { element = "fvs", cells = [4, 2] }
//!     support = [{ edge = "left", kind = "clamped" }]
//!     obstacle = [{ side = "below", height = -0.1 }]
//!     initial = { static_pressure = 14600 }
//!     time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.1 }
//!
//!     [plate]
//!     length = 1.2
//!     width = 0.4
//!     thickness = 0.01
//!     youngs_modulus = 210e9
//!     poissons_ratio = 0.3
//!     density = 7770
//!     "#,
//!     "fall.toml",
//!     &[],
//! )?;
//! let model = Model::new(&scene)?;
//! let mut scheme = model.scheme(&scene)?;
//! let start = scheme.energies()?.total();
//! for _ in 0..scene.time.steps() {
//!     scheme.advance()?;
//!     assert!(scheme.step_report().kkt < 1e-10);
//! }
//! assert!(scheme.energies()?.total() < 1.001 * start);
//! # Ok::<(), rebond::Error>(())
//! ```

pub mod quantity;
pub mod error;
pub mod communicator;
pub mod memory;
mod input;
mod hash;
pub mod random;
pub mod archive;
pub mod motion;
pub mod geometry;
pub mod field;
pub mod element;
pub mod mesh;
pub mod plate;
pub mod stress;
pub mod kernels;
pub mod linalg;
pub mod dof_map;
pub mod partition;
#[cfg(feature = "petsc")]
pub mod petsc;
#[cfg(feature = "petsc")]
pub mod distributed;
pub mod modes;
pub mod membrane;
pub mod assembly;
pub mod contact_law;
pub mod obstacle;
pub mod vi;
pub mod energy;
pub mod scheme;
pub mod lock_step;
pub mod scene;
pub mod simulation;
pub mod output;
pub mod study;
pub mod sweep;
pub mod continuation;
pub mod cli;

pub use error::{Error, Result};

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;

#[doc = include_str!("../docs/how-to.md")]
#[cfg(doctest)]
struct HowTo;
