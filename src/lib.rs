//! Thin elastic plates that vibrate and hit rigid obstacles.
//!
//! A Kirchhoff-Love plate with deflection u moves by \( M \ddot U + K U = F + G^T r \) between rigid obstacles
//! \( \alpha^- \le G U \le \alpha^+ \) that push back with the reactions r, and only where they touch. The crate
//! discretises it with conforming C1 elements, steps through time with the schemes of Pozzolini, Renard and Salaün
//! (CSMA 2013), and solves each step's bound-constrained problem exactly.
//!
//! A module imports only what stands above it:
//!
//! | module | is |
//! |---|---|
//! | [`error`] | the one error type and its exit codes |
//! | [`memory`] | what the machine leaves, and what does not fit |
//! | [`archive`] | a state on its way into a checkpoint and back |
//! | [`motion`] | a state that another run starts from |
//! | [`mesh`] | nodes, cells, their names; rectangles and Gmsh's files |
//! | [`field`] | numbers and formulas of x, y and t; tables of time |
//! | [`element`] | reduced HCT triangles and FVS quadrilaterals |
//! | [`plate`] | thickness and material to element matrices |
//! | [`linalg`] | the `Engine` trait and its native implementation |
//! | [`space`] | three dofs a node, supports |
//! | `petsc` | safe handles on PETSc's objects, the engine over all ranks (feature `petsc`) |
//! | [`modes`] | natural frequencies and shapes |
//! | [`assembly`] | the only loop over cells |
//! | [`obstacle`] | bounds on the deflections |
//! | [`vi`] | the bound-constrained problem of a step, and its judge |
//! | [`energy`] | the ledger and the guard |
//! | [`scheme`] | Newmark with restitution, midpoint, the conserving and the exact scheme, static equilibrium |
//! | [`scene`] | TOML to a validated scene |
//! | [`simulation`] | model, main loop, observer |
//! | [`output`] | csv, json, vtu, svg, png, progress |
//! | [`study`] | a look at a scene, the inf-sup constant, engines and solvers compared, what accuracy costs, the paper's figures |
//! | [`cli`] | the command |
//!
//! ```
//! use rebond::{scene::Scene, simulation::Model};
//!
//! let scene = Scene::from_str(
//!     r#"
//!     plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
//!     mesh = { element = "fvs", cells = [4, 2] }
//!     support = [{ edge = "left", kind = "clamped" }]
//!     obstacle = [{ side = "below", height = -0.1 }]
//!     initial = { static_pressure = 14600 }
//!     time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.1 }
//!     "#,
//!     "fall.toml",
//!     &[],
//! )?;
//! let model = Model::new(&scene)?;
//! let mut scheme = model.scheme(&scene)?;
//! let start = scheme.energies()?.total();
//! for _ in 0..scene.time.steps() {
//!     scheme.advance()?;
//!     assert!(scheme.verdict().kkt < 1e-10);
//! }
//! assert!(scheme.energies()?.total() < 1.001 * start);
//! # Ok::<(), rebond::Error>(())
//! ```

pub mod error;
pub mod memory;
mod input;
pub mod archive;
pub mod motion;
pub mod mesh;
pub mod field;
pub mod element;
pub mod plate;
pub mod linalg;
pub mod space;
#[cfg(feature = "petsc")]
pub mod petsc;
pub mod modes;
pub mod assembly;
pub mod obstacle;
pub mod vi;
pub mod energy;
pub mod scheme;
pub mod scene;
pub mod simulation;
pub mod output;
pub mod study;
pub mod cli;

pub use error::{Error, Result};

#[doc = include_str!("../README.md")]
#[cfg(doctest)]
struct Readme;
