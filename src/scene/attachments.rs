//! Attachments of the plate: foundations, springs, dashpots, masses and balls, objects beside the
//! plate that bear, hold, load or hit it.
//!
//! This file has the keys of all attachments and the names of their effects. The matrices are in
//! `simulation::effects::registry`.

use super::column::column;
use super::document::{Document, join};
use super::entry::{table, tables, via};
use super::given::{FieldInput, Region};
use super::kinds::{not_negative, number, positive, tag, word};
use super::obstacles::{Compliance, contact_point};
use super::place::{cells, coordinates, on_plate, place};
use super::words::Side;
use crate::error::Result;
use crate::field::Names;

table! {
    /// Attachments of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Attachments {
        /// Elastic (Winkler) foundations; their stiffnesses add up.
        foundations: Vec<Foundation> = tables("foundation", "stiffness");
        /// Springs between the plate and the ground.
        springs: Vec<Spring> = tables("spring", "at and stiffness");
        /// Dashpots between the plate and the ground.
        dashpots: Vec<Dashpot> = tables("dashpot", "at and damping");
        /// Masses fixed on the plate.
        masses: Vec<PointMass> = tables("mass", "at and mass");
        /// Beams along lines and edges of the plate.
        ribs: Vec<Rib> = tables("rib", "line or edge, and bending");
        /// Rigid bodies that move freely up and down and hit the plate.
        balls: Vec<Ball> = tables("ball", "at, mass and height");
    }
}

table! {
    /// Elastic (Winkler) foundation under the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Foundation {
        /// Stiffness, a field of x, y, at least 0; without force where the plate is flat.
        stiffness: FieldInput = not_negative("a stiffness", "N/m3").field(Names::XY);
        /// Region of the plate that rests on it.
        region: Region = cells();
    }
}

table! {
    /// Spring to the ground, relaxed where the plate is flat.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Spring {
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Stiffness of the spring between the plate and the ground; greater than 0.
        stiffness: f64 = positive("a stiffness", "N/m");
    }
}

table! {
    /// Dashpot to the ground, whose force is opposite and proportional to the velocity.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Dashpot {
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Force per velocity of the plate over the ground; greater than 0.
        damping: f64 = positive("a damping", "N s/m");
    }
}

table! {
    /// Mass fixed to the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct PointMass {
        /// Coordinates in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Mass that moves with the plate, without rotational inertia; greater than 0.
        mass: f64 = positive("a mass", "kg");
    }
}

table! {
    /// Beam along a line of the plate, with its axis in the mid-plane.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Rib {
        /// Line along which it runs.
        path: RibPath = via(path, path_keys);
        /// Bending stiffness EI; greater than 0.
        bending: f64 = positive("a bending stiffness", "N m2");
        /// Torsional stiffness GJ; at least 0.
        torsion: f64 = not_negative("a torsional stiffness", "N m2").or(0.0);
        /// Mass per length; at least 0. Its rotational inertia is neglected.
        mass: f64 = not_negative("a mass per length", "kg/m").or(0.0);
    }
}

/// Line along which a rib runs.
#[derive(Debug, Clone, PartialEq)]
pub enum RibPath {
    /// Straight line between two points, in m.
    Line([[f64; 2]; 2]),
    /// Edge of the plate or physical curve.
    Edge(String),
}

table! {
    /// Body that moves up and down and touches the plate at one point, without adhesion.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Ball {
        /// Name under which the forces of this ball are reported: columns of `history.csv`,
        /// `forces` in `summary.json`.
        name: Option<String> = column().optional();
        /// Coordinates of the contact point, in m.
        at: [f64; 2],
        /// Physical point that names the place, if the scene uses one.
        point: Option<String> = place();
        /// Side of the plate on which the ball is.
        side: Side = word().says("below | above the plate").or(Side::Above);
        /// Mass; greater than 0.
        mass: f64 = positive("a mass", "kg");
        /// Initial height of the point of the ball that touches the plate.
        height: f64 = number("a height", "m").says("m, of the point that touches");
        /// Initial velocity, upward.
        velocity: f64 = number("a velocity", "m/s").says("m/s, upward").or(0.0);
        /// Compliance of its contact point, in N/m and N s/m, or in N/m^1.5 for the law of Hertz;
        /// `None` for a rigid ball.
        compliance: Option<Compliance> = contact_point();
    }
}

impl Attachments {
    /// Returns each effect of attachments, and whether the scene has it.
    pub(super) fn effects(&self) -> [(bool, &'static str); 6] {
        [
            (!self.foundations.is_empty(), "elastic foundation"),
            (!self.springs.is_empty(), "springs"),
            (!self.dashpots.is_empty(), "dashpots"),
            (!self.masses.is_empty(), "added masses"),
            (!self.ribs.is_empty(), "ribs"),
            (!self.balls.is_empty(), "balls"),
        ]
    }

    /// Returns the indices of the balls whose contact point is a massless tip on a spring.
    pub fn balls_with_tips(&self) -> impl Iterator<Item = usize> {
        let has_tip = |ball: &usize| self.balls[*ball].compliance.is_some_and(|stop| stop.has_tip());
        (0..self.balls.len()).filter(has_tip)
    }

    /// Returns the number of dofs of balls: their gaps and their tips.
    pub fn ball_dofs(&self) -> usize {
        self.balls.len() + self.balls_with_tips().count()
    }
}

table! {
    /// Keys of the path of a rib.
    struct PathKeys {
        /// `[[x, y], [x, y]]`: a line segment, all of which lies on the plate, in any direction
        /// across the cells.
        line: Option<[[f64; 2]; 2]> = coordinates().pair(SEGMENT).optional();
        /// `"left"`, `"right"`, `"bottom"`, `"top"`, or a physical curve of `mesh.file`.
        edge: Option<String> = tag("expected the name of an edge").optional();
    } one_of {line} {edge}
}

const SEGMENT: &str = "expected [[x, y], [x, y]] in m, or edge = \"...\"";

/// Returns the path of a rib, whose line has two ends on the plate.
fn path(keys: PathKeys, doc: &Document, table: &str) -> Result<RibPath> {
    doc.only_one(table, &["line", "edge"])?;
    if let Some(name) = keys.edge {
        return Ok(RibPath::Edge(name));
    }
    let line = join(table, "line");
    let [from, to] = keys.line.ok_or_else(|| doc.missing(&line, SEGMENT))?;
    on_plate(doc, &join(&line, "0"), from)?;
    on_plate(doc, &join(&line, "1"), to)?;
    if from == to {
        return Err(doc.fault(&line, format!("both ends are {from:?}; {SEGMENT}")));
    }
    Ok(RibPath::Line([from, to]))
}

fn path_keys(path: &RibPath) -> PathKeys {
    match path {
        RibPath::Line(line) => PathKeys { line: Some(*line), edge: None },
        RibPath::Edge(edge) => PathKeys { line: None, edge: Some(edge.clone()) },
    }
}
