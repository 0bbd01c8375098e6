//! The scene: TOML text to a validated [`Scene`].
//!
//! ```
//! use rebond::scene::Scene;
//!
//! let text = r#"
//!     plate = { length = 1.2, width = 0.4, thickness = 0.01, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7770 }
//!     mesh = { element = "fvs", cells = [10, 4] }
//!     time = { scheme = "midpoint", mass = "singular", step = 1e-5, end = 0.5 }
//! "#;
//! let scene = Scene::from_str(text, "beam.toml", &["time.step=2e-5".into()])?;
//! assert_eq!(scene.time.steps(), 25_000);
//!
//! let error = Scene::from_str(text, "beam.toml", &["plate.width=-1".into()]).unwrap_err();
//! assert_eq!(
//!     error.to_string(),
//!     "--set plate.width=-1: plate.width: -1 is not positive; expected a width in m greater than 0"
//! );
//! # Ok::<(), rebond::Error>(())
//! ```

mod document;
mod read;
mod resolved;
mod study;
mod typed;
mod words;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
pub use crate::mesh::{Diagonal, ElementKind};
pub use crate::plate::Plate;
pub use crate::scheme::Massless;
pub use crate::space::Support as SupportKind;
use document::Document;
pub use study::{Horizon, Study};
pub use words::SchemeName;

/// The columns of `history.csv` before those of the probes; no probe may take their names.
pub const HISTORY_COLUMNS: [&str; 10] = [
    "step",
    "time",
    "energy",
    "kinetic",
    "elastic",
    "work",
    "contact_nodes",
    "contact_force",
    "vi_iterations",
    "kkt",
];

/// A simulation, validated and with every default filled in. All quantities are in SI units.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Scene {
    /// One line of text; by default the name of the file without its extension.
    pub title: String,
    /// The plate.
    pub plate: Panel,
    /// Its discretisation.
    pub mesh: Grid,
    /// Supported edges, each at most once; the others are free.
    #[serde(rename = "support")]
    pub supports: Vec<Support>,
    /// Rigid obstacles, at most one on each side.
    #[serde(rename = "obstacle")]
    pub obstacles: Vec<Obstacle>,
    /// What presses on the plate; `None` costs nothing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub load: Option<Load>,
    /// How it starts.
    pub initial: Initial,
    /// How it moves through time.
    pub time: Time,
    /// What solves each step.
    pub solver: Solver,
    /// What is written.
    pub output: Output,
    /// What `rebond study` compares, where the scene says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub study: Option<Study>,
}

/// A rectangular plate on `[0, length] x [0, width]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Panel {
    /// Along x, m.
    pub length: f64,
    /// Along y, m.
    pub width: f64,
    /// Thickness and material.
    #[serde(flatten)]
    pub plate: Plate,
}

/// A grid of rectangles that carries the elements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// The finite element.
    pub element: ElementKind,
    /// Rectangles along x and y, before refinement.
    pub cells: [usize; 2],
    /// How each rectangle is cut into two triangles; `None` for quadrilaterals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagonal: Option<Diagonal>,
    /// Uniform refinements: each cuts a cell in four.
    pub refine: u32,
}

/// A supported edge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Support {
    /// The edge.
    pub edge: Edge,
    /// What is held there.
    pub kind: SupportKind,
}

/// An edge of the rectangle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Edge {
    /// x = 0.
    Left,
    /// x = length.
    Right,
    /// y = 0.
    Bottom,
    /// y = width.
    Top,
}

/// A rigid plane that the plate cannot cross.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Obstacle {
    /// The side of the plate on which it lies.
    pub side: Side,
    /// Its height, m.
    pub height: f64,
}

/// A side of the plate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// The deflection stays above the height.
    Below,
    /// The deflection stays under the height.
    Above,
}

/// What presses on the plate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Load {
    /// Upward pressure, Pa.
    pub pressure: f64,
}

/// The start: the equilibrium under a pressure, with a velocity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Initial {
    /// Upward pressure whose static deflection the plate starts from, Pa.
    pub static_pressure: f64,
    /// Upward velocity of the whole plate, m/s.
    pub velocity: f64,
}

/// The scheme and its steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Time {
    /// The time scheme.
    #[serde(flatten)]
    pub scheme: Scheme,
    /// The mass matrix.
    pub mass: Mass,
    /// The time step, s.
    pub step: f64,
    /// The end, s. A run makes [`Time::steps`] steps: its last time is the multiple of the step nearest to `end`.
    pub end: f64,
}

/// A time scheme.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(tag = "scheme", rename_all = "snake_case")]
pub enum Scheme {
    /// Newmark-e-beta.
    Newmark {
        /// Newmark's beta, at least 1/4.
        beta: f64,
        /// Paoli and Schatzman's restitution coefficient e, from 0 to 1.
        restitution: f64,
    },
    /// Implicit midpoint.
    Midpoint {
        /// What becomes of the massless part of the displacement.
        massless: Massless,
    },
    /// Implicit midpoint, relaxed so that it keeps the energy; with the singular mass only.
    Conserving,
    /// Event-driven, without any error of the step; with the singular mass only.
    Exact,
}

/// A mass matrix.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mass {
    /// The singular one, of velocities constant on each cell.
    Singular,
    /// The consistent one.
    Consistent,
}

impl Mass {
    /// What the midpoint scheme makes of the massless part of the displacement unless told otherwise.
    pub fn massless(self) -> Massless {
        match self {
            Mass::Singular => Massless::Equilibrium,
            Mass::Consistent => Massless::Reflected,
        }
    }
}

/// What solves each step, and how well.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Solver {
    /// Linear algebra.
    pub engine: EngineName,
    /// The solver of the contact problem.
    pub vi: ViName,
    /// Relative KKT residual that every step must meet.
    pub tolerance: f64,
    /// Energy over its start past which a run stops.
    pub energy_guard: f64,
}

/// An engine's name. Whether this build has it is not the scene's to judge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineName {
    /// Rust alone, on one process.
    Native,
    /// PETSc, on any number of ranks.
    Petsc,
}

/// A contact solver's name. Whether this build has it is not the scene's to judge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ViName {
    /// Active sets on the Schur complement of the contact candidates.
    Condensed,
    /// PETSc's SNES.
    Snes,
    /// PETSc's TAO.
    Tao,
}

/// What is written.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Output {
    /// Steps between rows of the history.
    pub every: u64,
    /// Snapshots of the plate; `None` costs nothing.
    #[serde(flatten)]
    pub fields: Option<Snapshots>,
    /// Points whose deflection is a column of the history.
    pub probes: Vec<Probe>,
}

/// When and how finely snapshots of the plate are taken.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Snapshots {
    /// Steps between them.
    #[serde(rename = "fields_every")]
    pub every: u64,
    /// Small cells along each edge of a cell.
    pub subdivide: usize,
}

/// A point to watch.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Probe {
    /// The name of its column.
    pub name: String,
    /// Its x and y, m.
    pub at: [f64; 2],
}

impl Scene {
    /// Reads a scene file and applies overrides such as `time.step=1e-6`.
    pub fn load(path: impl AsRef<Path>, overrides: &[String]) -> Result<Scene> {
        Scene::load_for(path, overrides, EngineName::Native)
    }

    /// As [`Scene::load`], with the engine of a scene that names none.
    pub fn load_for(path: impl AsRef<Path>, overrides: &[String], engine: EngineName) -> Result<Scene> {
        let path = path.as_ref();
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        let name = path.to_string_lossy();
        read::scene(&Document::parse(&bytes, &name, overrides)?, &name, engine)
    }

    /// Reads a scene from text; messages call it `file_name`.
    pub fn from_str(text: &str, file_name: &str, overrides: &[String]) -> Result<Scene> {
        Scene::from_bytes(text.as_bytes(), file_name, overrides)
    }

    /// Reads a scene from a file's bytes. Whatever they are, the answer is a scene or [`Error::Scene`].
    pub fn from_bytes(bytes: &[u8], file_name: &str, overrides: &[String]) -> Result<Scene> {
        read::scene(&Document::parse(bytes, file_name, overrides)?, file_name, EngineName::Native)
    }

    /// The scene as TOML with every default filled in. It reads back to an equal scene.
    pub fn resolved(&self) -> String {
        resolved::text(self)
    }

    /// What `rebond study` compares.
    pub fn study(&self) -> Study {
        self.study.clone().unwrap_or_else(|| Study::of(&self.mesh, &self.time, &self.solver))
    }

    /// The FNV-1a hash of [`Scene::resolved`], 64 bits in 16 hexadecimal digits: the same on every machine.
    pub fn hash(&self) -> String {
        format!("{:016x}", resolved::fnv1a(self.resolved().as_bytes()))
    }

    /// The height of the obstacle on a side.
    pub fn obstacle(&self, side: Side) -> Option<f64> {
        self.obstacles.iter().find(|obstacle| obstacle.side == side).map(|obstacle| obstacle.height)
    }

    /// What acts on the plate beyond its own elasticity and inertia, in words.
    pub fn effects(&self) -> Vec<String> {
        let effect = |is_on: bool, name: &str| is_on.then(|| name.to_owned());
        let restitution = match self.time.scheme {
            Scheme::Newmark { restitution, .. } if restitution > 0.0 => Some(restitution),
            _ => None,
        };
        [
            effect(self.obstacle(Side::Below).is_some(), "contact below"),
            effect(self.obstacle(Side::Above).is_some(), "contact above"),
            effect(self.load.is_some_and(|load| load.pressure != 0.0), "constant load"),
            effect(self.initial.static_pressure != 0.0, "initial static deflection"),
            effect(self.initial.velocity != 0.0, "initial velocity"),
            restitution.map(|e| format!("restitution e = {e}")),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

impl Grid {
    /// A mesh of the same kind with other cells.
    pub fn with(&self, element: ElementKind, cells: [usize; 2], refine: u32) -> Grid {
        let diagonal = (element == ElementKind::Hct).then(|| self.diagonal.unwrap_or_default());
        Grid { element, cells, diagonal, refine }
    }
}

impl Scheme {
    /// Its name.
    pub fn name(&self) -> SchemeName {
        match self {
            Scheme::Newmark { .. } => SchemeName::Newmark,
            Scheme::Midpoint { .. } => SchemeName::Midpoint,
            Scheme::Conserving => SchemeName::Conserving,
            Scheme::Exact => SchemeName::Exact,
        }
    }
}

impl Time {
    /// The number of steps: `end / step`, rounded to the nearest.
    pub fn steps(&self) -> u64 {
        (self.end / self.step).round() as u64
    }
}
