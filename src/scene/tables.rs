//! Tables of a scene, validated and with every default filled in.

use super::given::{FieldInput, Region};
use super::quantity::ProbeQuantity;
use crate::contact_law::{ContactLaw, Hertz};
use crate::dof_map::Support as SupportKind;
use crate::element::{CellShape, ElementKind};
use crate::error::Result;
use crate::field::Condition;
use crate::mesh::{Diagonal, Import, Mesh};
use crate::motion::Motion;
use crate::plate::Plate;
use crate::vi::ContactSolver;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

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

/// Support of the plate.
#[derive(Clone, PartialEq)]
pub struct Support {
    /// Name, under which its reactions are reported.
    pub name: Option<String>,
    /// Location.
    pub stand: SupportLocation,
    /// Constrained dofs; springs are constrained only where they do not yield.
    pub kind: SupportKind,
    /// Springs of an elastic edge.
    pub elastic: Option<ElasticEdge>,
    /// Vertical motion w(t) in m; `None` for a support at rest.
    pub motion: Option<FieldInput>,
}

/// Springs of a support along an edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ElasticEdge {
    /// Stiffness against deflection, in N/m2; `None` where the edge cannot deflect.
    pub stiffness: Option<f64>,
    /// Stiffness against rotation about the edge, in N m/rad per metre; 0 where it is free.
    pub rotation: f64,
}

impl fmt::Debug for Support {
    /// Formats what the support does, which its name does not change.
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let Support { name: _, stand, kind, elastic, motion } = self;
        let mut fields = f.debug_struct("Support");
        fields.field("stand", stand).field("kind", kind).field("elastic", elastic);
        fields.field("motion", motion).finish()
    }
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

/// Obstacle: rigid, so that the plate cannot cross it, or a compliant stop that yields.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    /// Name, under which its forces are reported.
    pub name: Option<String>,
    /// Side of the plate on which the obstacle lies.
    pub side: Side,
    /// Height in m.
    pub height: FieldInput,
    /// Region of the plate that can touch the obstacle.
    pub region: Region,
    /// Stiffness and damping of a compliant stop: per point (N/m, N s/m; N/m^1.5 for the law of
    /// Hertz), per length of a line (N/m2, N s/m2) or per area (N/m3, N s/m3); `None` for a rigid
    /// obstacle.
    pub compliance: Option<Compliance>,
    /// Position of its law, or of the table without one, for messages.
    pub position: SourcePosition,
}

/// Position in the text of a scene, in words. All positions are equal: scenes with the same content
/// are.
#[derive(Debug, Clone, Default)]
pub struct SourcePosition(pub String);

impl PartialEq for SourcePosition {
    fn eq(&self, _: &SourcePosition) -> bool {
        true
    }
}

/// Law by which the force of a compliant stop depends on its depth d.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopLaw {
    /// Spring and dashpot, `$k d + c \dot d$`, which join a massless tip to the plate.
    Linear,
    /// Contact of two elastic bodies with curved surfaces, `$k d^{3/2}$` (Hertz 1881).
    Hertz,
}

/// Law, stiffness and damping of a compliant stop, with the units of [`Obstacle::compliance`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Compliance {
    /// Law of the force.
    pub law: StopLaw,
    /// Stiffness, greater than 0.
    pub stiffness: f64,
    /// Damping beside the spring; 0 for the law of Hertz.
    pub damping: f64,
}

impl Compliance {
    /// Returns the law by which its bound yields; `None` for a linear stop, whose tip is bounded.
    pub fn contact_law(&self) -> Option<Arc<dyn ContactLaw>> {
        match self.law {
            StopLaw::Linear => None,
            StopLaw::Hertz => Some(Arc::new(Hertz(self.stiffness))),
        }
    }

    /// Returns whether a massless tip touches in place of the node or the ball.
    pub fn has_tip(&self) -> bool {
        self.law == StopLaw::Linear
    }
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

impl Load {
    /// Returns all fields of the load.
    pub fn fields(&self) -> impl Iterator<Item = &FieldInput> {
        std::iter::once(&self.pressure).chain(self.forces.iter().map(|force| &force.value))
    }
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

/// Solver of the steps and its tolerances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solver {
    /// Linear algebra engine.
    pub engine: EngineName,
    /// Solver of the linear systems on PETSc.
    pub linear: LinearSolver,
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

/// Solver of the linear systems on PETSc; the native engine factors them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum LinearSolver {
    /// Factorisation, or multigrid where the factors would not fit into memory.
    Auto,
    /// Factorisation.
    Direct,
    /// Conjugate gradients with geometric multigrid.
    Multigrid,
}

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

/// Beginnings of the columns of a named support or obstacle; the moments are those of a support.
pub const FORCE_COLUMNS: [&str; 4] = ["force", "impulse", "moment_x", "moment_y"];

/// Output settings.
#[derive(Debug, Clone, PartialEq)]
pub struct Output {
    /// Number of steps between rows of the history.
    pub every: u64,
    /// Snapshots of the plate; `None` costs nothing.
    pub fields: Option<Snapshots>,
    /// Whether the largest stress over all steps is recorded.
    pub extremes: bool,
    /// Number of steps between checkpoints; `None` writes one only on interruption.
    pub checkpoint_every: Option<u64>,
    /// Points where a quantity is recorded in a column of the history.
    pub probes: Vec<Probe>,
}

/// Frequency and resolution of the snapshots of the plate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Snapshots {
    /// Number of steps between snapshots.
    pub every: u64,
    /// Number of parts into which snapshots divide each cell edge.
    pub subdivide: usize,
    /// Whether snapshots include moments and stresses.
    pub stresses: bool,
}

/// Probe: a point where a quantity, such as the deflection, is recorded.
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
    /// Recorded quantity.
    pub quantity: ProbeQuantity,
}
