//! Attachments of the plate: foundations, springs, masses and balls, objects beside the plate that
//! bear, hold, load or hit it.
//!
//! All that a scene knows of an attachment is in this file: its table, how it is read and written,
//! and the name of its effect. The matrices are in `simulation::effects`.

use super::document::Document;
use super::given::{FieldInput, Region};
use super::keys::{TableKey, TableKeys, ValueKind, key, words};
use super::read::obstacles;
use super::read::quantities::{
    BENDING, FOUNDATION, HEIGHT, LINE_MASS, MASS, POINT_DAMPING, SPRING, TORSION, VELOCITY,
};
use super::read::region::{self, AT, AT_OR_POINT, GROUP, LINE, POINT, PlaceReader, WHERE};
use super::tables::{Compliance, Side};
use super::toml_text::{self, Row, given, number, numbers, place, string, word};
use crate::error::Result;
use crate::field::Names;

/// Attachments of the plate.
#[derive(Debug, Clone, PartialEq)]
pub struct Attachments {
    /// Elastic foundations; their stiffnesses add up.
    pub foundations: Vec<Foundation>,
    /// Springs between the plate and the ground.
    pub springs: Vec<Spring>,
    /// Masses fixed on the plate.
    pub masses: Vec<PointMass>,
    /// Beams along lines of the plate.
    pub ribs: Vec<Rib>,
    /// Rigid bodies that move freely up and down and hit the plate.
    pub balls: Vec<Ball>,
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

/// Beam along a line of the plate, with its axis in the mid-plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Rib {
    /// Line along which it runs.
    pub path: RibPath,
    /// Bending stiffness EI in N m2.
    pub bending: f64,
    /// Torsional stiffness GJ in N m2.
    pub torsion: f64,
    /// Mass per length in kg/m.
    pub mass: f64,
}

/// Line along which a rib runs.
#[derive(Debug, Clone, PartialEq)]
pub enum RibPath {
    /// Straight line between two points, in m.
    Line([[f64; 2]; 2]),
    /// Edge of the plate or physical curve.
    Edge(String),
}

/// Body that moves up and down and touches the plate at one point, without adhesion.
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
    /// Compliance of its contact point, in N/m and N s/m, or in N/m^1.5 for the law of Hertz;
    /// `None` for a rigid ball.
    pub compliance: Option<Compliance>,
}

/// Tables of a scene.
pub(super) const TABLES: &[TableKey] = &[
    key("foundation", ValueKind::Tables(&FOUNDATIONS), "elastic (Winkler) foundations"),
    key("spring", ValueKind::Tables(&SPRINGS), "springs between the plate and the ground"),
    key("mass", ValueKind::Tables(&MASSES), "point masses on the plate"),
    key("rib", ValueKind::Tables(&RIBS), "beams along lines and edges of the plate"),
    key("ball", ValueKind::Tables(&BALLS), "bodies that fly and hit the plate"),
];

static FOUNDATIONS: TableKeys = TableKeys {
    groups: &[&[
        key("stiffness", ValueKind::Field(&FOUNDATION, Names::XY), "N/m3, a number or a formula of x and y"),
        WHERE,
        GROUP,
    ]],
    needed: &["stiffness"],
    one_of: &[],
};

static SPRINGS: TableKeys = TableKeys {
    groups: &[&[AT, POINT, key("stiffness", ValueKind::Number(&SPRING), "N/m")]],
    needed: &["stiffness"],
    one_of: AT_OR_POINT,
};

static MASSES: TableKeys = TableKeys {
    groups: &[&[AT, POINT, key("mass", ValueKind::Number(&MASS), "kg")]],
    needed: &["mass"],
    one_of: AT_OR_POINT,
};

static RIBS: TableKeys = TableKeys {
    groups: &[&[
        LINE,
        key("edge", ValueKind::Text, "left, right, bottom, top, or a physical curve of mesh.file"),
        key("bending", ValueKind::Number(&BENDING), "N m2, bending stiffness EI"),
        key("torsion", ValueKind::Number(&TORSION), "N m2, torsional stiffness GJ; default 0"),
        key("mass", ValueKind::Number(&LINE_MASS), "kg/m; default 0"),
    ]],
    needed: &["bending"],
    one_of: &[&["line"], &["edge"]],
};

static BALLS: TableKeys = TableKeys {
    groups: &[&[
        AT,
        POINT,
        key("side", ValueKind::Word(words::<Side>), "side of the plate on which the ball is; default above"),
        key("mass", ValueKind::Number(&MASS), "kg"),
        key("height", ValueKind::Number(&HEIGHT), "m, of the point of the ball that touches"),
        key("velocity", ValueKind::Number(&VELOCITY), "m/s, upward; default 0"),
        obstacles::LAW,
        key(
            "stiffness",
            ValueKind::Number(&SPRING),
            "N/m of a compliant contact point (N/m^1.5 by Hertz); default rigid",
        ),
        key("damping", ValueKind::Number(&POINT_DAMPING), "N s/m beside a stiffness; default 0"),
    ]],
    needed: &["mass", "height"],
    one_of: AT_OR_POINT,
};

impl Attachments {
    /// Returns each effect of attachments, and whether the scene has it.
    pub(super) fn effects(&self) -> [(bool, &'static str); 5] {
        [
            (!self.foundations.is_empty(), "elastic foundation"),
            (!self.springs.is_empty(), "springs"),
            (!self.masses.is_empty(), "added masses"),
            (!self.ribs.is_empty(), "ribs"),
            (!self.balls.is_empty(), "balls"),
        ]
    }

    /// Returns the indices of the balls whose contact point is a massless tip on a spring.
    pub fn balls_with_tips(&self) -> impl Iterator<Item = usize> {
        let has_tip = |ball: &usize| self.balls[*ball].compliance.is_some_and(|of| of.has_tip());
        (0..self.balls.len()).filter(has_tip)
    }

    /// Returns the number of dofs of balls: the gap of each, and the tips.
    pub fn ball_dofs(&self) -> usize {
        self.balls.len() + self.balls_with_tips().count()
    }

    /// Returns the tables in the order of a resolved scene, with files by the path where they were
    /// found, or as written.
    pub(super) fn tables(&self, found: bool) -> Vec<(&'static str, Vec<Row>)> {
        let foundation = |of: &Foundation| {
            let stiffness = ("stiffness", given(&of.stiffness, found), "N/m3");
            ("[[foundation]]", [vec![stiffness], toml_text::region(&of.region)].concat())
        };
        let spring = |of: &Spring| {
            let stiffness = ("stiffness", number(of.stiffness), "N/m");
            ("[[spring]]", vec![place(&of.at, of.point.as_deref()), stiffness])
        };
        let mass = |of: &PointMass| {
            let mass = ("mass", number(of.mass), "kg");
            ("[[mass]]", vec![place(&of.at, of.point.as_deref()), mass])
        };
        let rib = |of: &Rib| {
            let path = match &of.path {
                RibPath::Line([from, to]) => ("line", format!("[{}, {}]", numbers(from), numbers(to)), "m"),
                RibPath::Edge(edge) => ("edge", string(edge), ""),
            };
            let rows = vec![
                path,
                ("bending", number(of.bending), "N m2"),
                ("torsion", number(of.torsion), "N m2"),
                ("mass", number(of.mass), "kg/m"),
            ];
            ("[[rib]]", rows)
        };
        let ball = |of: &Ball| {
            let mut rows = vec![
                place(&of.at, of.point.as_deref()),
                ("side", word(of.side), "below | above the plate"),
                ("mass", number(of.mass), "kg"),
                ("height", number(of.height), "m, of the point that touches"),
                ("velocity", number(of.velocity), "m/s, upward"),
            ];
            rows.extend(toml_text::compliance(of.compliance, ["N/m", "N s/m"]));
            ("[[ball]]", rows)
        };
        let foundations = self.foundations.iter().map(foundation);
        let springs = self.springs.iter().map(spring);
        let masses = self.masses.iter().map(mass);
        let ribs = self.ribs.iter().map(rib);
        foundations.chain(springs).chain(masses).chain(ribs).chain(self.balls.iter().map(ball)).collect()
    }
}

/// Reads all attachments.
pub(super) fn read(doc: &Document, places: &PlaceReader) -> Result<Attachments> {
    Ok(Attachments {
        balls: read_balls(doc, places)?,
        foundations: read_foundations(doc)?,
        springs: read_springs(doc, places)?,
        masses: read_masses(doc, places)?,
        ribs: read_ribs(doc, places)?,
    })
}

/// Reads the tables `[[name]]`, which take these keys and need those in `needs`; `read` gets the
/// path of one table.
pub(super) fn read_tables<T>(
    doc: &Document,
    name: &str,
    needs: &str,
    keys: &TableKeys,
    read: impl Fn(&str) -> Result<T>,
) -> Result<Vec<T>> {
    let table = |index: usize| {
        let table = format!("{name}.{index}");
        doc.allow(&table, keys)?;
        read(&table)
    };
    let count = doc.entries(name, &format!("expected tables [[{name}]] with {needs}"))?;
    (0..count).map(table).collect()
}

fn read_foundations(doc: &Document) -> Result<Vec<Foundation>> {
    read_tables(doc, "foundation", "stiffness", &FOUNDATIONS, |table| {
        Ok(Foundation {
            stiffness: doc.needed(&format!("{table}.stiffness"), &FOUNDATION, Names::XY)?,
            region: region::read(doc, table, &["where", "group"])?,
        })
    })
}

fn read_springs(doc: &Document, places: &PlaceReader) -> Result<Vec<Spring>> {
    read_tables(doc, "spring", "at and stiffness", &SPRINGS, |table| {
        let (at, point) = places.read(doc, table)?;
        Ok(Spring { at, point, stiffness: doc.number(&format!("{table}.stiffness"), &SPRING)? })
    })
}

fn read_masses(doc: &Document, places: &PlaceReader) -> Result<Vec<PointMass>> {
    read_tables(doc, "mass", "at and mass", &MASSES, |table| {
        let (at, point) = places.read(doc, table)?;
        Ok(PointMass { at, point, mass: doc.number(&format!("{table}.mass"), &MASS)? })
    })
}

fn read_ribs(doc: &Document, places: &PlaceReader) -> Result<Vec<Rib>> {
    read_tables(doc, "rib", "line or edge, and bending", &RIBS, |table| {
        let key = |name: &str| format!("{table}.{name}");
        let (line, edge) = (key("line"), key("edge"));
        let path = if doc.get(&edge).is_some() {
            doc.forbid(&line, format!("contradicts {edge}; expected only one of line, edge"))?;
            RibPath::Edge(region::name(doc, &edge, "expected the name of an edge")?)
        } else {
            let expected = "expected [[x, y], [x, y]] in m, or edge = \"...\"";
            doc.pair(&line, expected)?;
            let ends =
                [places.on_plate(doc, &format!("{line}.0"))?, places.on_plate(doc, &format!("{line}.1"))?];
            if ends[0] == ends[1] {
                return Err(doc.fault(&line, format!("both ends are {:?}; {expected}", ends[0])));
            }
            RibPath::Line(ends)
        };
        Ok(Rib {
            path,
            bending: doc.number(&key("bending"), &BENDING)?,
            torsion: doc.optional_number(&key("torsion"), &TORSION)?.unwrap_or(0.0),
            mass: doc.optional_number(&key("mass"), &LINE_MASS)?.unwrap_or(0.0),
        })
    })
}

fn read_balls(doc: &Document, places: &PlaceReader) -> Result<Vec<Ball>> {
    read_tables(doc, "ball", "at, mass and height", &BALLS, |table| {
        let key = |name: &str| format!("{table}.{name}");
        let (at, point) = places.read(doc, table)?;
        Ok(Ball {
            at,
            point,
            side: doc.optional_choice(&key("side"))?.unwrap_or(Side::Above),
            mass: doc.number(&key("mass"), &MASS)?,
            height: doc.number(&key("height"), &HEIGHT)?,
            velocity: doc.optional_number(&key("velocity"), &VELOCITY)?.unwrap_or(0.0),
            compliance: obstacles::point_compliance(doc, table)?,
        })
    })
}
