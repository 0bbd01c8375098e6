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
mod effects;
mod given;
mod read;
mod resolved;
mod study;
mod typed;
mod words;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize, Serializer};

use crate::error::Result;
use crate::field::Condition;
use crate::input;
pub use crate::mesh::{Diagonal, ElementKind};
use crate::mesh::{Import, Mesh};
use crate::motion::Motion;
pub use crate::plate::Plate;
pub use crate::scheme::Massless;
pub use crate::space::Support as SupportKind;
use document::Document;
pub use given::{Given, Region, Still, Value};
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
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// One line of text; by default the name of the file without its extension.
    pub title: String,
    /// The plate.
    pub plate: Panel,
    /// Parts of it that are of other thickness or material; of several in one place the last counts.
    pub parts: Vec<Part>,
    /// Its discretisation.
    pub mesh: Grid,
    /// The Gmsh file that gives shape and mesh, in place of a rectangle.
    pub file: Option<MeshFile>,
    /// What holds it; edges not named are free.
    pub supports: Vec<Support>,
    /// Rigid obstacles; where several lie on one side, the nearest counts.
    pub obstacles: Vec<Obstacle>,
    /// What pushes the plate; `None` costs nothing.
    pub load: Option<Load>,
    /// Elastic foundations; their stiffnesses add up.
    pub foundations: Vec<Foundation>,
    /// Springs between the plate and the ground.
    pub springs: Vec<Spring>,
    /// Masses fixed on the plate.
    pub masses: Vec<PointMass>,
    /// Rigid bodies that fly free and hit the plate.
    pub balls: Vec<Ball>,
    /// What takes energy away; `None` costs nothing.
    pub damping: Option<Damping>,
    /// How it starts.
    pub initial: Initial,
    /// How it moves through time.
    pub time: Time,
    /// What solves each step.
    pub solver: Solver,
    /// What is written.
    pub output: Output,
    /// What `rebond study` compares, where the scene says so.
    pub study: Option<Study>,
}

/// The plate: a rectangle on `[0, length] x [0, width]` unless a file gives its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct Panel {
    /// Along x, m; 0 where a file gives the shape.
    pub length: f64,
    /// Along y, m; 0 where a file gives the shape.
    pub width: f64,
    /// Thickness and material.
    pub plate: Plate,
    /// A thickness that is no number, in m; then that of `plate` is its value at the origin.
    pub thickness: Option<Given>,
}

/// A part of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Which: cells of a group, or those whose centre satisfies a condition.
    pub region: Region,
    /// Its thickness and material.
    pub plate: Plate,
    /// A thickness that is no number, in m.
    pub thickness: Option<Given>,
}

/// A mesh from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// As the scene writes it.
    pub file: String,
    /// Where it was found.
    pub path: String,
    /// What its coordinates are multiplied by to be metres; `None`: they are.
    pub scale: Option<f64>,
    /// Nodes this near to each other, in m, become one; `None`: none do.
    pub merge: Option<f64>,
    /// Parts that nothing connects.
    pub parts: usize,
}

impl MeshFile {
    /// Reads the mesh.
    ///
    /// # Errors
    /// As [`Mesh::load_gmsh_as`], and where the mesh is in other parts than the scene says.
    pub fn load(&self) -> Result<Mesh> {
        let import = Import { scale: self.scale.unwrap_or(1.0), merge: self.merge.unwrap_or(0.0) };
        let mesh = Mesh::load_gmsh_as(&self.path, import)?;
        mesh.require_parts(self.parts)?;
        Ok(mesh)
    }
}

/// A grid of rectangles that carries the elements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// The finite element; in a mesh from a file each cell has its own.
    pub element: ElementKind,
    /// Rectangles along x and y, before refinement; none where a file gives the mesh.
    pub cells: [usize; 2],
    /// How each rectangle is cut into two triangles; `None` for quadrilaterals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagonal: Option<Diagonal>,
    /// Uniform refinements: each cuts a cell in four.
    pub refine: u32,
}

/// A support.
#[derive(Debug, Clone, PartialEq)]
pub struct Support {
    /// Where it stands.
    pub stand: Stand,
    /// What is held there.
    pub kind: SupportKind,
    /// How it moves up and down, w(t) in m; `None`: it stands still.
    pub motion: Option<Given>,
}

/// Where a support stands.
#[derive(Debug, Clone, PartialEq)]
pub enum Stand {
    /// On an edge, or the part of it where a condition holds at both ends of a cell's side.
    Edge {
        /// `left`, `right`, `bottom`, `top`, or a physical group.
        edge: String,
        /// The part, if not all of it.
        part: Option<Condition>,
    },
    /// At a node, m.
    At([f64; 2]),
    /// At the nodes of a physical group.
    Point(String),
}

/// A rigid obstacle that the plate cannot cross.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// The side of the plate on which it lies.
    pub side: Side,
    /// Its height, m.
    pub height: Given,
    /// Which part of the plate it is opposite to.
    pub region: Region,
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

/// What pushes the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Upward pressure, Pa.
    pub pressure: Given,
    /// Gravity, m/s2, downward: on the plate, on masses fixed on it, and on balls.
    pub gravity: f64,
    /// Point forces.
    pub forces: Vec<Force>,
}

/// A force at a point.
#[derive(Debug, Clone, PartialEq)]
pub struct Force {
    /// Where, m.
    pub at: [f64; 2],
    /// The physical point there, if that is how the scene names the place.
    pub point: Option<String>,
    /// Upward, N.
    pub value: Given,
}

/// Springs side by side under the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Foundation {
    /// N/m3.
    pub stiffness: Given,
    /// Which part of the plate rests on it.
    pub region: Region,
}

/// A spring to the ground, relaxed where the plate is flat.
#[derive(Debug, Clone, PartialEq)]
pub struct Spring {
    /// Where, m.
    pub at: [f64; 2],
    /// The physical point there, if that is how the scene names the place.
    pub point: Option<String>,
    /// N/m.
    pub stiffness: f64,
}

/// A mass fixed on the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMass {
    /// Where, m.
    pub at: [f64; 2],
    /// The physical point there, if that is how the scene names the place.
    pub point: Option<String>,
    /// kg.
    pub mass: f64,
}

/// A rigid body that moves up and down and touches the plate at one point, without sticking.
#[derive(Debug, Clone, PartialEq)]
pub struct Ball {
    /// Above or below which point of the plate, m.
    pub at: [f64; 2],
    /// The physical point there, if that is how the scene names the place.
    pub point: Option<String>,
    /// The side of the plate on which it is.
    pub side: Side,
    /// kg.
    pub mass: f64,
    /// Height of the point that will touch, at the start, m.
    pub height: f64,
    /// Velocity at the start, upward, m/s.
    pub velocity: f64,
}

/// What takes energy away.
#[derive(Debug, Clone, PartialEq)]
pub struct Damping {
    /// Rayleigh's alpha, 1/s.
    pub mass: f64,
    /// Rayleigh's beta, s.
    pub stiffness: f64,
    /// Damping ratios of the first modes, the lowest first; the others have none beside Rayleigh's.
    pub modal: Vec<f64>,
}

/// The start.
#[derive(Debug, Clone, PartialEq)]
pub struct Initial {
    /// Upward pressure whose static deflection the plate starts from, Pa.
    pub static_pressure: Given,
    /// Whether the loads of the first instant belong to that static start.
    pub equilibrium: bool,
    /// Deflection that the plate starts from instead, m.
    pub deflection: Given,
    /// Upward velocity, m/s.
    pub velocity: Given,
    /// Another run whose last deflection and velocity the plate starts with instead of all these.
    pub from: Option<StartFrom>,
}

/// The last state of another run.
#[derive(Debug, Clone, PartialEq)]
pub struct StartFrom {
    /// The run folder, as the scene writes it.
    pub folder: String,
    /// Where it was found.
    pub path: String,
    /// The state.
    pub motion: Arc<Motion>,
}

/// The scheme and its steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Time {
    /// The time scheme.
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
#[derive(Debug, Clone, Copy, PartialEq)]
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
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Steps between rows of the history.
    pub every: u64,
    /// Snapshots of the plate; `None` costs nothing.
    pub fields: Option<Snapshots>,
    /// Steps between checkpoints; `None`: only where a run is interrupted.
    pub checkpoint_every: Option<u64>,
    /// Points whose deflection is a column of the history.
    pub probes: Vec<Probe>,
}

/// When and how finely snapshots of the plate are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshots {
    /// Steps between them.
    pub every: u64,
    /// Small cells along each edge of a cell.
    pub subdivide: usize,
}

/// A point to watch.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// The name of its column.
    pub name: String,
    /// Its x and y, m.
    pub at: [f64; 2],
    /// The physical point there, if that is how the scene names the place.
    pub point: Option<String>,
    /// The ball there, by its number, whose height is told in place of the plate's.
    pub ball: Option<usize>,
}

impl Serialize for Scene {
    /// As [`Scene::resolved`].
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let table: toml::Table = toml::from_str(&self.resolved()).map_err(serde::ser::Error::custom)?;
        table.serialize(serializer)
    }
}

impl Scene {
    /// Reads a scene file and applies overrides such as `time.step=1e-6`.
    pub fn load(path: impl AsRef<Path>, overrides: &[String]) -> Result<Scene> {
        Scene::load_for(path, overrides, EngineName::Native)
    }

    /// As [`Scene::load`], with the engine of a scene that names none.
    pub fn load_for(path: impl AsRef<Path>, overrides: &[String], engine: EngineName) -> Result<Scene> {
        let path = path.as_ref();
        let bytes = input::read(path, input::LARGEST_SCENE)?;
        let name = path.to_string_lossy();
        read::scene(&Document::parse(&bytes, &name, overrides)?, &name, engine)
    }

    /// Reads a scene from text; messages call it `file_name`.
    pub fn from_str(text: &str, file_name: &str, overrides: &[String]) -> Result<Scene> {
        Scene::from_bytes(text.as_bytes(), file_name, overrides)
    }

    /// Reads a scene from a file's bytes. Whatever they are, the answer is a scene or [`crate::Error::Scene`]; where it names points of a
    /// mesh, also what reading that mesh says.
    pub fn from_bytes(bytes: &[u8], file_name: &str, overrides: &[String]) -> Result<Scene> {
        read::scene(&Document::parse(bytes, file_name, overrides)?, file_name, EngineName::Native)
    }

    /// The scene as TOML with every default filled in. It reads back to an equal scene.
    pub fn resolved(&self) -> String {
        resolved::text(self, true)
    }

    /// As [`Scene::resolved`], with files named as they were written: it reads back as an equal scene where the scene's file is.
    pub fn written(&self) -> String {
        resolved::text(self, false)
    }

    /// The supports in a text that is the same for the same ones.
    pub fn supports_in_words(&self) -> String {
        format!("{:?}", self.supports)
    }

    /// What `rebond study` compares.
    pub fn study(&self) -> Study {
        self.study.clone().unwrap_or_else(|| Study::of(&self.mesh, &self.time, &self.solver))
    }

    /// The FNV-1a hash of [`Scene::resolved`] with the names of files as they were written, and of the values in its tables: 64 bits in
    /// 16 hexadecimal digits, the same on every machine.
    pub fn hash(&self) -> String {
        format!("{:016x}", resolved::fnv1a(resolved::identity(self).as_bytes()))
    }
}

impl Load {
    /// Its fields.
    pub fn fields(&self) -> impl Iterator<Item = &Given> {
        std::iter::once(&self.pressure).chain(self.forces.iter().map(|force| &force.value))
    }
}

impl Grid {
    /// Whether a file gives the mesh that is refined.
    pub fn is_of_file(&self) -> bool {
        self.cells == [0, 0]
    }

    /// A mesh of the same kind with other cells.
    pub fn with(&self, element: ElementKind, cells: [usize; 2], refine: u32) -> Grid {
        let diagonal =
            (element == ElementKind::Hct && cells != [0, 0]).then(|| self.diagonal.unwrap_or_default());
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
    /// Number of factors, as large as each other, that the scheme holds at once. With the singular mass `midpoint` needs a second
    /// one for its velocities, if for nothing else.
    pub fn factors(&self) -> usize {
        match (self.scheme, self.mass) {
            (Scheme::Conserving, _) | (Scheme::Midpoint { .. }, Mass::Singular) => 2,
            (Scheme::Newmark { .. } | Scheme::Exact, _) | (Scheme::Midpoint { .. }, Mass::Consistent) => 1,
        }
    }

    /// The number of steps: `end / step`, rounded to the nearest.
    pub fn steps(&self) -> u64 {
        (self.end / self.step).round() as u64
    }
}
