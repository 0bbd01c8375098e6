//! Scenes: TOML text is read into a validated [`Scene`].
//!
//! ```
//! use rebond::scene::Scene;
//!
//! let text = r#"
//!     mesh = { element = "fvs", cells = [10, 4] }
//!     time = { scheme = "midpoint", mass = "singular", step = 1e-5, end = 0.5 }
//!     [plate]
//!     length = 1.2
//!     width = 0.4
//!     thickness = 0.01
//!     youngs_modulus = 210e9
//!     poissons_ratio = 0.3
//!     density = 7770
//! "#;
//! let scene = Scene::from_str(text, "beam.toml", &["time.step=2e-5".into()])?;
//! assert_eq!(scene.time.steps(), 25_000);
//!
//! let error = Scene::from_str(text, "beam.toml", &["plate.width=-1".into()]).unwrap_err();
//! let place = "--set plate.width=-1: plate.width";
//! let fault = "-1 is not positive; expected a width in m greater than 0";
//! assert_eq!(error.to_string(), format!("{place}: {fault}"));
//! # Ok::<(), rebond::Error>(())
//! ```

mod cross_checks;
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

pub use crate::dof_map::Support as SupportKind;
use crate::element::CellShape;
pub use crate::element::ElementKind;
use crate::error::Result;
use crate::field::Condition;
use crate::hash;
use crate::input;
pub use crate::mesh::Diagonal;
use crate::mesh::{Import, Mesh};
use crate::motion::Motion;
pub use crate::plate::Plate;
pub use crate::scheme::{Massless, SchemeName, SchemeSpec};
pub use crate::vi::ContactSolver;
use document::Document;
pub use given::{FieldInput, Region, Still, Value};
pub use study::{Horizon, Study};

/// Columns of `history.csv` before those of the probes, which cannot take these names.
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

/// Simulation input, validated and with every default filled in, in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Title, one line of text; by default the name of the file without its extension.
    pub title: String,
    /// Plate.
    pub plate: PlateSpec,
    /// Parts of the plate with another thickness or material; the last one wins where they overlap.
    pub parts: Vec<Part>,
    /// Discretisation.
    pub mesh: Grid,
    /// Gmsh file that gives shape and mesh, in place of a rectangle.
    pub file: Option<MeshFile>,
    /// Supports; edges not named are free.
    pub supports: Vec<Support>,
    /// Rigid obstacles; where several lie on one side, the nearest counts.
    pub obstacles: Vec<Obstacle>,
    /// Loads; `None` costs nothing.
    pub load: Option<Load>,
    /// Elastic foundations; their stiffnesses add up.
    pub foundations: Vec<Foundation>,
    /// Springs between the plate and the ground.
    pub springs: Vec<Spring>,
    /// Masses fixed on the plate.
    pub masses: Vec<PointMass>,
    /// Rigid bodies that move freely up and down and hit the plate.
    pub balls: Vec<Ball>,
    /// Damping; `None` costs nothing.
    pub damping: Option<Damping>,
    /// Initial state.
    pub initial: Initial,
    /// Time scheme and steps.
    pub time: Time,
    /// Linear algebra and contact solver.
    pub solver: Solver,
    /// Output files.
    pub output: Output,
    /// Runs that `rebond study` compares, where the scene says so.
    pub study: Option<Study>,
}

/// Plate: a rectangle on `[0, length] x [0, width]` unless a file gives its shape.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateSpec {
    /// Length along x, in m; 0 where a file gives the shape.
    pub length: f64,
    /// Width along y, in m; 0 where a file gives the shape.
    pub width: f64,
    /// Thickness and material.
    pub plate: Plate,
    /// Thickness in m if it varies; that of `plate` is then its value at the origin.
    pub thickness: Option<FieldInput>,
}

/// Part of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Cells of a group, or those whose centre satisfies a condition.
    pub region: Region,
    /// Thickness and material of the part.
    pub plate: Plate,
    /// Thickness in m if it varies.
    pub thickness: Option<FieldInput>,
}

/// Mesh from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshFile {
    /// File name as the scene writes it.
    pub file: String,
    /// Path where the file was found.
    pub path: String,
    /// Factor that turns coordinates into metres; `None` if they are in metres.
    pub scale: Option<f64>,
    /// Distance in m below which nodes are merged; `None` merges none.
    pub merge: Option<f64>,
    /// Number of unconnected parts that the scene declares.
    pub parts: usize,
}

impl MeshFile {
    /// Reads the mesh.
    ///
    /// # Errors
    /// Returns the errors of [`Mesh::load_gmsh_as`], and [`crate::Error::Mesh`] where the number of
    /// parts differs from the scene's.
    pub fn load(&self) -> Result<Mesh> {
        let import = Import { scale: self.scale.unwrap_or(1.0), merge: self.merge.unwrap_or(0.0) };
        let mesh = Mesh::load_gmsh_as(&self.path, import)?;
        mesh.require_parts(self.parts)?;
        Ok(mesh)
    }
}

/// Grid of rectangles that carries the elements.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Grid {
    /// Finite element; in a mesh from a file each cell has its own.
    pub element: ElementKind,
    /// Numbers of rectangles along x and y before refinement; zeros where a file gives the mesh.
    pub cells: [usize; 2],
    /// Cut of each rectangle into two triangles; `None` for quadrilaterals.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagonal: Option<Diagonal>,
    /// Number of uniform refinements, each of which cuts a cell in four.
    pub refine: u32,
}

/// Support of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Support {
    /// Location.
    pub stand: SupportLocation,
    /// Constrained dofs.
    pub kind: SupportKind,
    /// Vertical motion w(t) in m; `None` for a support at rest.
    pub motion: Option<FieldInput>,
}

/// Location of a support.
#[derive(Debug, Clone, PartialEq)]
pub enum SupportLocation {
    /// Edge, or the cell sides on it whose two ends satisfy a condition.
    Edge {
        /// Name of the edge: `left`, `right`, `bottom`, `top`, or a physical group.
        edge: String,
        /// Condition that selects a part of the edge.
        part: Option<Condition>,
    },
    /// Node at these coordinates, in m.
    At([f64; 2]),
    /// Nodes of a physical group.
    Point(String),
}

/// Rigid obstacle that the plate cannot cross.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Side of the plate on which the obstacle lies.
    pub side: Side,
    /// Height in m.
    pub height: FieldInput,
    /// Region of the plate that can touch the obstacle.
    pub region: Region,
}

/// Side of the plate.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    /// Below the plate: the deflection stays above the obstacle's height.
    Below,
    /// Above the plate: the deflection stays under the obstacle's height.
    Above,
}

/// Loads on the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// Upward pressure in Pa.
    pub pressure: FieldInput,
    /// Downward gravity in m/s2, on the plate, on masses fixed to it, and on balls.
    pub gravity: f64,
    /// Point forces.
    pub forces: Vec<Force>,
}

/// Point force.
#[derive(Debug, Clone, PartialEq)]
pub struct Force {
    /// Coordinates in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Upward force in N.
    pub value: FieldInput,
}

/// Elastic (Winkler) foundation under the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Foundation {
    /// Stiffness in N/m3.
    pub stiffness: FieldInput,
    /// Region of the plate that rests on it.
    pub region: Region,
}

/// Spring to the ground, relaxed where the plate is flat.
#[derive(Debug, Clone, PartialEq)]
pub struct Spring {
    /// Coordinates in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Stiffness in N/m.
    pub stiffness: f64,
}

/// Mass fixed to the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct PointMass {
    /// Coordinates in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Mass in kg.
    pub mass: f64,
}

/// Rigid body that moves up and down and touches the plate at one point, without adhesion.
#[derive(Debug, Clone, PartialEq)]
pub struct Ball {
    /// Coordinates of the contact point, in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Side of the plate on which the ball is.
    pub side: Side,
    /// Mass in kg.
    pub mass: f64,
    /// Initial height of the ball's contact point, in m.
    pub height: f64,
    /// Initial upward velocity in m/s.
    pub velocity: f64,
}

/// Damping of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Damping {
    /// Rayleigh's mass coefficient alpha, in 1/s.
    pub mass: f64,
    /// Rayleigh's stiffness coefficient beta, in s.
    pub stiffness: f64,
    /// Damping ratios of the lowest modes in addition to Rayleigh's; zero for higher modes.
    pub modal: Vec<f64>,
}

/// Initial state of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Initial {
    /// Upward pressure in Pa that gives the initial static deflection.
    pub static_pressure: FieldInput,
    /// Whether the static deflection includes the loads of the first instant.
    pub equilibrium: bool,
    /// Initial deflection in m, in place of a static one.
    pub deflection: FieldInput,
    /// Initial upward velocity in m/s.
    pub velocity: FieldInput,
    /// Run whose last deflection and velocity replace all of the above.
    pub from: Option<StartFrom>,
}

/// Last state of another run.
#[derive(Debug, Clone, PartialEq)]
pub struct StartFrom {
    /// Run folder as the scene writes it.
    pub folder: String,
    /// Path where the folder was found.
    pub path: String,
    /// Deflection and velocity.
    pub motion: Arc<Motion>,
}

/// Time scheme and its steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Time {
    /// Time scheme.
    pub scheme: SchemeSpec,
    /// Mass matrix.
    pub mass: Mass,
    /// Time step in s.
    pub step: f64,
    /// End time in s.
    ///
    /// A run makes [`Time::steps`] steps, so that its last time is the multiple of the step nearest
    /// to `end`.
    pub end: f64,
}

/// Mass matrix.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mass {
    /// Singular mass, from velocities that are constant on each cell.
    Singular,
    /// Consistent mass.
    Consistent,
}

impl Mass {
    /// Returns the midpoint scheme's default treatment of the massless part of the displacement.
    pub fn massless(self) -> Massless {
        match self {
            Mass::Singular => Massless::Equilibrium,
            Mass::Consistent => Massless::Reflected,
        }
    }
}

/// Solver of the steps and its tolerances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solver {
    /// Linear algebra engine.
    pub engine: EngineName,
    /// Contact solver.
    pub vi: ContactSolver,
    /// Limit on the relative KKT residual of every step.
    pub tolerance: f64,
    /// Ratio of the energy to its start beyond which a run stops.
    pub energy_guard: f64,
}

/// Linear algebra engine; a build without it refuses it later, not the scene.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EngineName {
    /// Engine in Rust alone, on one process.
    Native,
    /// Engine of PETSc, on any number of ranks.
    Petsc,
}

/// Output settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Number of steps between rows of the history.
    pub every: u64,
    /// Snapshots of the plate; `None` costs nothing.
    pub fields: Option<Snapshots>,
    /// Number of steps between checkpoints; `None` writes one only on interruption.
    pub checkpoint_every: Option<u64>,
    /// Points whose deflection is a column of the history.
    pub probes: Vec<Probe>,
}

/// Frequency and resolution of the snapshots of the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshots {
    /// Number of steps between snapshots.
    pub every: u64,
    /// Number of parts into which snapshots divide each cell edge.
    pub subdivide: usize,
}

/// Probe: a point whose deflection is recorded.
#[derive(Debug, Clone, PartialEq)]
pub struct Probe {
    /// Name of the column.
    pub name: String,
    /// Coordinates x and y in m.
    pub at: [f64; 2],
    /// Physical point that names the place, if the scene uses one.
    pub point: Option<String>,
    /// Index of a ball whose height is recorded in place of the plate's.
    pub ball: Option<usize>,
}

impl Serialize for Scene {
    /// Serialises the table of [`Scene::resolved`].
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

    /// Works as [`Scene::load`], with the default engine for a scene that names none.
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

    /// Reads a scene from the bytes of a file.
    ///
    /// Any bytes give a scene or [`crate::Error::Scene`]. A scene that names points of a mesh file
    /// can also give the errors of reading that mesh.
    pub fn from_bytes(bytes: &[u8], file_name: &str, overrides: &[String]) -> Result<Scene> {
        read::scene(&Document::parse(bytes, file_name, overrides)?, file_name, EngineName::Native)
    }

    /// Returns the scene as TOML with every default filled in, which reads back as an equal scene.
    pub fn resolved(&self) -> String {
        resolved::text(self, true)
    }

    /// Works as [`Scene::resolved`], with file names as they were written.
    ///
    /// The text reads back as an equal scene in the folder of the scene's file.
    pub fn written(&self) -> String {
        resolved::text(self, false)
    }

    /// Returns a text that is equal for equal supports.
    pub fn supports_in_words(&self) -> String {
        format!("{:?}", self.supports)
    }

    /// Returns the study of the scene, or the default one.
    pub fn study(&self) -> Study {
        self.study.clone().unwrap_or_else(|| Study::of(&self.mesh, &self.time, &self.solver))
    }

    /// Returns the FNV-1a hash of the scene and of the values in its tables, in 16 hexadecimal
    /// digits.
    ///
    /// The hash covers [`Scene::resolved`] with file names as written, and is the same on every
    /// machine.
    pub fn hash(&self) -> String {
        format!("{:016x}", hash::fnv1a(resolved::identity(self).into_bytes()))
    }
}

impl Load {
    /// Returns all fields of the load.
    pub fn fields(&self) -> impl Iterator<Item = &FieldInput> {
        std::iter::once(&self.pressure).chain(self.forces.iter().map(|force| &force.value))
    }
}

impl Grid {
    /// Returns whether a file gives the mesh before refinement.
    pub fn is_of_file(&self) -> bool {
        self.cells == [0, 0]
    }

    /// Returns a mesh of the same kind with other cells.
    pub fn with(&self, element: ElementKind, cells: [usize; 2], refine: u32) -> Grid {
        let diagonal = (element.shape() == CellShape::Triangle && cells != [0, 0])
            .then(|| self.diagonal.unwrap_or_default());
        Grid { element, cells, diagonal, refine }
    }
}

impl Time {
    /// Returns the number of factors, all of the same size, that the scheme holds at once.
    pub fn factors(&self) -> usize {
        let [singular, consistent] = self.scheme.capabilities().factors;
        if self.mass == Mass::Singular { singular } else { consistent }
    }

    /// Returns the number of steps, `end / step` rounded to the nearest integer.
    pub fn steps(&self) -> u64 {
        (self.end / self.step).round() as u64
    }
}
