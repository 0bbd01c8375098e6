//! Contents of a scene.

use super::attachments::Attachments;
use super::slider::Slider;
use super::study::Study;
use super::sweep::SweepSpec;
use super::tables::{
    Damping, Grid, Initial, Load, MeshFile, Obstacle, Output, Part, PlateSpec, Solver, Support,
};
use super::time::Time;
use crate::field::Parameters;

/// Simulation input, validated and with every default filled in, in SI units.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Title, one line of text; by default the name of the file without its extension.
    pub title: String,
    /// Numbers that every formula may use.
    pub parameters: Parameters,
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
    /// Foundations, springs, masses and balls.
    pub attachments: Attachments,
    /// Dry friction at nodes.
    pub sliders: Vec<Slider>,
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
    /// Runs that `rebond sweep` makes, where the scene says so.
    pub sweep: Option<SweepSpec>,
}
