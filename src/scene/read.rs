//! Translation of a document into a scene: one function per table, its keys in the order of the
//! file.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::document::{Document, quote, spell};
use super::typed::{Choice, Quantity, Range};
use super::words::SchemeName;
use super::{
    Ball, ContactSolver, Damping, Diagonal, ElementKind, EngineName, FieldInput, Force, Foundation, Grid,
    HISTORY_COLUMNS, Initial, Load, Mass, Massless, MeshFile, Obstacle, Output, Part, Plate, PlateSpec,
    PointMass, Probe, Region, Scene, SchemeSpec, Side, Snapshots, Solver, Spring, StartFrom, Study, Support,
    SupportKind, SupportLocation, Time, study,
};
use crate::error::{Error, Result};
use crate::field::{MOST_LOOKS, Names};
use crate::mesh::Point;
use crate::motion::{self, Motion};
use crate::plate::Orthotropy;

/// Limit on the rectangles of a mesh after refinement.
const MOST_RECTANGLES: u64 = 4_000_000;

/// Limit on the parts into which snapshots divide an edge.
const MOST_PARTS: u64 = 64;

/// Limit on the number of steps: all smaller integers are exact floating-point numbers.
const TOO_MANY_STEPS: f64 = (1_u64 << 53) as f64;

/// Relative distance of the end from a whole number of steps that rounding of decimals explains.
const WHOLE: f64 = 1e-9;

const LENGTH: Quantity = Quantity::new("a length in m", Range::POSITIVE);
const WIDTH: Quantity = Quantity::new("a width in m", Range::POSITIVE);
const THICKNESS: Quantity = Quantity::new("a thickness in m", Range::POSITIVE);
const YOUNGS_MODULUS: Quantity = Quantity::new("Young's modulus in Pa", Range::POSITIVE);
const POISSONS_RATIO: Quantity = Quantity::new(
    "Poisson's ratio",
    Range::new(" greater than -1 and less than 0.5", "is out of range", |nu| -1.0 < nu && nu < 0.5),
);
const DENSITY: Quantity = Quantity::new("a density in kg/m3", Range::POSITIVE);
const SHEAR_MODULUS: Quantity = Quantity::new("a shear modulus in Pa", Range::POSITIVE);
const GRAIN: Quantity = Quantity::new("an angle in degrees", Range::ANY);
const DEFLECTION: Quantity = Quantity::new("a deflection in m", Range::ANY);
const FORCE: Quantity = Quantity::new("a force in N", Range::ANY);
const GRAVITY: Quantity = Quantity::new("an acceleration in m/s2, downward", Range::ANY);
const MASS: Quantity = Quantity::new("a mass in kg", Range::POSITIVE);
const SPRING: Quantity = Quantity::new("a stiffness in N/m", Range::POSITIVE);
const FOUNDATION: Quantity = Quantity::new("a stiffness in N/m3", Range::NOT_NEGATIVE);
const MASS_DAMPING: Quantity = Quantity::new("a rate in 1/s", Range::NOT_NEGATIVE);
const STIFFNESS_DAMPING: Quantity = Quantity::new("a time in s", Range::NOT_NEGATIVE);
const RATIO: Quantity = Quantity::new("a damping ratio", Range::NOT_NEGATIVE);
const HEIGHT: Quantity = Quantity::new("a height in m", Range::ANY);
const PRESSURE: Quantity = Quantity::new("a pressure in Pa", Range::ANY);
const VELOCITY: Quantity = Quantity::new("a velocity in m/s", Range::ANY);
const BETA: Quantity =
    Quantity::new("Newmark's beta", Range::new(" of at least 0.25", "is too small", |beta| beta >= 0.25));
const RESTITUTION: Quantity = Quantity::new(
    "a restitution coefficient",
    Range::new(" from 0 to 1", "is out of range", |e| (0.0..=1.0).contains(&e)),
);
const STEP: Quantity = Quantity::new("a time step in s", Range::POSITIVE);
const END: Quantity = Quantity::new("an end time in s", Range::POSITIVE);
const INSTANT: Quantity = Quantity::new("an instant in s", Range::NOT_NEGATIVE);
const TOLERANCE: Quantity = Quantity::new(
    "a relative KKT residual",
    Range::new(" greater than 0 and less than 1", "is out of range", |tolerance| {
        0.0 < tolerance && tolerance < 1.0
    }),
);
const ENERGY_GUARD: Quantity =
    Quantity::new("a ratio of energies", Range::new(" greater than 1", "is too small", |ratio| ratio > 1.0));
const SCALE: Quantity = Quantity::new("a factor that makes coordinates metres", Range::POSITIVE);
const MERGE: Quantity = Quantity::new("a distance in m", Range::POSITIVE);
const COORDINATE: Quantity = Quantity::new("a coordinate in m", Range::ANY);

/// Names of a scene's tables.
const TABLES: [&str; 17] = [
    "title",
    "plate",
    "part",
    "mesh",
    "support",
    "obstacle",
    "load",
    "foundation",
    "spring",
    "mass",
    "ball",
    "damping",
    "initial",
    "time",
    "solver",
    "output",
    "study",
];

/// Reads the whole scene; `engine` is the default.
pub(super) fn scene(doc: &Document, file_name: &str, engine: EngineName) -> Result<Scene> {
    doc.allow("", &TABLES)?;
    let title = title(doc, file_name)?;
    let file = mesh_file(doc)?;
    let plate = panel(doc, file.is_some())?;
    let (mesh, time, solver) = (grid(doc, file.is_some())?, time(doc)?, solver(doc, engine)?);
    let places = Places { plate: &plate, file: file.as_ref(), points: OnceCell::new() };
    let balls = balls(doc, &places)?;
    let scene = Scene {
        title,
        parts: parts(doc, &plate)?,
        supports: supports(doc, file.is_some())?,
        obstacles: obstacles(doc)?,
        load: load(doc, &places)?,
        foundations: foundations(doc)?,
        springs: springs(doc, &places)?,
        masses: masses(doc, &places)?,
        damping: damping(doc)?,
        initial: initial(doc)?,
        output: output(doc, &places, &mesh, &balls)?,
        balls,
        study: study(doc, &mesh, &time, &solver)?,
        plate,
        mesh,
        file,
        time,
        solver,
    };
    check_start(doc, &scene)?;
    check_from(doc, &scene)?;
    check_jumps(doc, &scene)?;
    check_scheme(doc, &scene)?;
    Ok(scene)
}

fn title(doc: &Document, file_name: &str) -> Result<String> {
    let expected = "expected one line of text";
    let Some(title) = doc.optional_text("title", expected)? else {
        let stem = Path::new(file_name).file_stem().unwrap_or_default().to_string_lossy();
        return Ok(stem.replace(char::is_control, " "));
    };
    if title.contains(char::is_control) {
        return Err(doc.fault("title", format!("{} has a control character; {expected}", quote(title))));
    }
    Ok(title.to_owned())
}

/// Keys of thickness and material.
const MATERIAL: [&str; 7] = [
    "thickness",
    "youngs_modulus",
    "poissons_ratio",
    "density",
    "youngs_modulus_across",
    "shear_modulus",
    "grain",
];

fn panel(doc: &Document, has_file: bool) -> Result<PlateSpec> {
    doc.allow("plate", &[&["length", "width"], &MATERIAL[..]].concat())?;
    let side = |key: &str, quantity| {
        if has_file {
            doc.forbid(key, "contradicts mesh.file, which gives the plate its shape")?;
            return Ok(0.0);
        }
        doc.number(key, quantity)
    };
    let (length, width) = (side("plate.length", &LENGTH)?, side("plate.width", &WIDTH)?);
    let (plate, thickness) = material(doc, "plate", None)?;
    Ok(PlateSpec { length, width, plate, thickness })
}

/// Reads thickness and material of a table; missing keys take their values from `base`.
fn material(doc: &Document, table: &str, base: Option<&PlateSpec>) -> Result<(Plate, Option<FieldInput>)> {
    let number = |name: &str, quantity: &Quantity, of: fn(&Plate) -> f64| {
        let key = format!("{table}.{name}");
        match base {
            None => doc.number(&key, quantity),
            Some(base) => Ok(doc.optional_number(&key, quantity)?.unwrap_or(of(&base.plate))),
        }
    };
    let key = format!("{table}.thickness");
    let given = doc.given(&key, &THICKNESS, Names::XY)?.or(base.and_then(|base| base.thickness.clone()));
    let (thickness, field) = match given {
        Some(given) => match given.number() {
            Some(thickness) => (thickness, None),
            // The origin need not lie on the plate, so that an error there does not matter.
            None => (given.at(Point::origin(), 0.0).unwrap_or(0.0), Some(given)),
        },
        None => (number("thickness", &THICKNESS, |plate| plate.thickness)?, None),
    };
    let youngs_modulus = number("youngs_modulus", &YOUNGS_MODULUS, |plate| plate.youngs_modulus)?;
    let poissons_ratio = number("poissons_ratio", &POISSONS_RATIO, |plate| plate.poissons_ratio)?;
    let density = number("density", &DENSITY, |plate| plate.density)?;
    let orthotropy = orthotropy(doc, table, base.and_then(|base| base.plate.orthotropy))?;
    if let Some(Orthotropy { across, .. }) = orthotropy
        && poissons_ratio.powi(2) * across >= youngs_modulus
    {
        let wrong = format!("{poissons_ratio:?} is out of range for these moduli; expected nu12^2 < E1 / E2");
        return Err(doc.fault(&format!("{table}.poissons_ratio"), wrong));
    }
    Ok((Plate { thickness, youngs_modulus, poissons_ratio, density, orthotropy }, field))
}

/// Reads the second set of moduli, for an orthotropic plate.
fn orthotropy(doc: &Document, table: &str, base: Option<Orthotropy>) -> Result<Option<Orthotropy>> {
    let key = |name: &str| format!("{table}.{name}");
    let across = doc.optional_number(&key("youngs_modulus_across"), &YOUNGS_MODULUS)?;
    let Some(across) = across.or(base.map(|base| base.across)) else {
        for name in ["shear_modulus", "grain"] {
            let wrong = "has no use without youngs_modulus_across, for an isotropic plate has no grain";
            doc.forbid(&key(name), wrong)?;
        }
        return Ok(None);
    };
    let shear_modulus = match base {
        Some(base) => {
            doc.optional_number(&key("shear_modulus"), &SHEAR_MODULUS)?.unwrap_or(base.shear_modulus)
        }
        None => doc.number(&key("shear_modulus"), &SHEAR_MODULUS)?,
    };
    let grain = doc.optional_number(&key("grain"), &GRAIN)?.or(base.map(|base| base.grain)).unwrap_or(0.0);
    Ok(Some(Orthotropy { across, shear_modulus, grain }))
}

fn parts(doc: &Document, plate: &PlateSpec) -> Result<Vec<Part>> {
    let part = |index: usize| {
        let table = format!("part.{index}");
        doc.allow(&table, &[&["where", "group"], &MATERIAL[..]].concat())?;
        let region = region(doc, &table, &["where", "group"])?;
        if region == Region::All {
            return Err(doc.missing(&table, "expected where = \"...\" or group = \"...\""));
        }
        let (plate, thickness) = material(doc, &table, Some(plate))?;
        Ok(Part { region, plate, thickness })
    };
    let count =
        doc.entries("part", "expected tables [[part]] with where or group, and what differs there")?;
    (0..count).map(part).collect()
}

/// Reads the region that one of `keys` names (`where`, `group`, `at`, `point`, `line`).
///
/// Without any of them, the region is the whole plate.
fn region(doc: &Document, table: &str, keys: &[&str]) -> Result<Region> {
    let mut named = keys.iter().filter(|key| doc.get(&format!("{table}.{key}")).is_some());
    let Some(first) = named.next() else { return Ok(Region::All) };
    let key = format!("{table}.{first}");
    if let Some(second) = named.next() {
        let wrong = format!("contradicts {table}.{second}; expected only one of {}", keys.join(", "));
        return Err(doc.fault(&key, wrong));
    }
    Ok(match *first {
        "where" => Region::Where(doc.condition(&key)?),
        "group" => Region::Group(name(doc, &key, "expected the name of a physical group")?),
        "at" => Region::At(point(doc, &key)?),
        "point" => Region::Point(name(doc, &key, "expected the name of a physical point")?),
        _ => {
            doc.pair(&key, "expected [[x, y], [x, y]] in m")?;
            Region::Line([point(doc, &format!("{key}.0"))?, point(doc, &format!("{key}.1"))?])
        }
    })
}

/// Reads a text that is not empty.
fn name(doc: &Document, key: &str, expected: &str) -> Result<String> {
    let text = doc.optional_text(key, expected)?.ok_or_else(|| doc.missing(key, expected))?;
    if text.trim().is_empty() {
        return Err(doc.fault(key, format!("{} names nothing; {expected}", quote(text))));
    }
    Ok(text.to_owned())
}

/// Reads a point, in m.
fn point(doc: &Document, key: &str) -> Result<[f64; 2]> {
    doc.pair(key, "expected [x, y] in m")?;
    Ok([doc.number(&format!("{key}.0"), &COORDINATE)?, doc.number(&format!("{key}.1"), &COORDINATE)?])
}

/// Reads a point and checks it against the rectangle, or not at all where a file gives the shape.
fn point_on(doc: &Document, key: &str, plate: &PlateSpec) -> Result<[f64; 2]> {
    let [x, y] = point(doc, key)?;
    let PlateSpec { length, width, .. } = *plate;
    let has_sides = length > 0.0;
    if has_sides && !((0.0..=length).contains(&x) && (0.0..=width).contains(&y)) {
        let wrong = format!(
            "[{x:?}, {y:?}] is off the plate; expected x from 0 to {length:?} m, y from 0 to {width:?} m"
        );
        return Err(doc.fault(key, wrong));
    }
    Ok([x, y])
}

/// Coordinates of named points: those of the plate's mesh file.
struct Places<'p> {
    plate: &'p PlateSpec,
    file: Option<&'p MeshFile>,
    /// Points of the file, read at the first use.
    points: OnceCell<BTreeMap<String, Vec<Point>>>,
}

impl Places<'_> {
    /// Returns the coordinates of a table's `at`, or of the single node of its `point` with its
    /// name.
    fn of(&self, doc: &Document, table: &str) -> Result<([f64; 2], Option<String>)> {
        let (at, key) = (format!("{table}.at"), format!("{table}.point"));
        if doc.get(&key).is_none() {
            return Ok((point_on(doc, &at, self.plate)?, None));
        }
        doc.forbid(&at, format!("contradicts {key}; expected only one of at, point"))?;
        let name = name(doc, &key, "expected the name of a physical point")?;
        let Some(file) = self.file else {
            return Err(doc.fault(&key, "has no use without mesh.file; expected at = [x, y]"));
        };
        let points = match self.points.get() {
            Some(points) => points,
            None => {
                let mesh = file.load()?;
                let places = |nodes: &Vec<usize>| nodes.iter().map(|&node| mesh.nodes[node]).collect();
                let points = mesh.points.iter().map(|(name, nodes)| (name.clone(), places(nodes))).collect();
                self.points.get_or_init(|| points)
            }
        };
        match points.get(&name).map(Vec::as_slice) {
            Some(&[place]) => Ok((place.into(), Some(name))),
            Some(places) => {
                let wrong = format!("{} has {} nodes; expected a point with one", quote(&name), places.len());
                Err(doc.fault(&key, wrong))
            }
            None => {
                let known: Vec<&str> = points.keys().map(String::as_str).collect();
                let wrong =
                    format!("the mesh has no point named {}; it has: {}", quote(&name), known.join(", "));
                Err(doc.fault(&key, wrong))
            }
        }
    }
}

fn mesh_file(doc: &Document) -> Result<Option<MeshFile>> {
    if doc.get("mesh.file").is_none() {
        return Ok(None);
    }
    let file = name(doc, "mesh.file", "expected the name of a Gmsh mesh")?;
    let path = doc.beside(&file);
    let scale = doc.optional_number("mesh.scale", &SCALE)?;
    let merge = doc.optional_number("mesh.merge", &MERGE)?;
    let parts = doc.optional_count("mesh.parts", "a number of parts that nothing connects", 1)?.unwrap_or(1);
    Ok(Some(MeshFile { file, path, scale, merge, parts: parts as usize }))
}

fn grid(doc: &Document, has_file: bool) -> Result<Grid> {
    doc.allow("mesh", &["element", "cells", "diagonal", "refine", "file", "scale", "merge", "parts"])?;
    if !has_file {
        for key in ["mesh.scale", "mesh.merge", "mesh.parts"] {
            doc.forbid(key, "has no use without mesh.file")?;
        }
    }
    if has_file {
        let wrong = "contradicts mesh.file: its triangles are \"hct\" cells, its quadrangles \"fvs\"";
        for key in ["mesh.element", "mesh.cells", "mesh.diagonal"] {
            doc.forbid_with("mesh.file", key, wrong)?;
        }
    }
    let element = if has_file { ElementKind::Hct } else { doc.choice("mesh.element")? };
    let cells = if has_file { [0, 0] } else { cells(doc, "mesh.cells")? };
    let diagonal = if has_file { None } else { diagonal(doc, element)? };
    let refine = doc.optional_count("mesh.refine", "a number of uniform refinements", 0)?.unwrap_or(0);
    let sized = if has_file { [1, 1] } else { cells };
    let refine = refinements(sized, refine).ok_or_else(|| too_many(doc, "mesh.refine", sized, refine))?;
    Ok(Grid { element, cells, diagonal, refine })
}

fn diagonal(doc: &Document, element: ElementKind) -> Result<Option<Diagonal>> {
    match element {
        ElementKind::Hct => Ok(Some(doc.optional_choice("mesh.diagonal")?.unwrap_or(Diagonal::Right))),
        ElementKind::Fvs => {
            let wrong =
                "contradicts mesh.element = \"fvs\", which cuts no rectangle; expected only with \"hct\"";
            doc.forbid_with("mesh.element", "mesh.diagonal", wrong)?;
            Ok(None)
        }
    }
}

/// Reads the numbers of rectangles along x and y.
fn cells(doc: &Document, key: &str) -> Result<[usize; 2]> {
    doc.pair(key, "expected [nx, ny], the numbers of rectangles along x and y")?;
    let nx = doc.count(&format!("{key}.0"), "a number of rectangles along x", 1)?;
    let ny = doc.count(&format!("{key}.1"), "a number of rectangles along y", 1)?;
    let cells = [nx as usize, ny as usize];
    refinements(cells, 0).map(|_| cells).ok_or_else(|| too_many(doc, key, cells, 0))
}

/// Returns the refinements as a number, if the refined mesh is not too large.
fn refinements([nx, ny]: [usize; 2], refine: u64) -> Option<u32> {
    let refine = u32::try_from(refine).ok()?;
    let rectangles = (nx as u64).checked_mul(ny as u64)?.checked_mul(4_u64.checked_pow(refine)?)?;
    (rectangles <= MOST_RECTANGLES).then_some(refine)
}

/// Creates the error for a mesh that is too large.
fn too_many(doc: &Document, key: &str, [nx, ny]: [usize; 2], refine: u64) -> Error {
    let refined = if refine == 0 { String::new() } else { format!(", refined {refine} times,") };
    let wrong = format!("{nx} x {ny} rectangles{refined} are too many");
    doc.fault(key, format!("{wrong}; expected at most {MOST_RECTANGLES} in all"))
}

/// Names of the edges of a rectangle.
const EDGES: [&str; 4] = ["left", "right", "bottom", "top"];

fn supports(doc: &Document, has_file: bool) -> Result<Vec<Support>> {
    let mut supports: Vec<Support> = Vec::new();
    for index in 0..doc.entries("support", "expected tables [[support]] with edge and kind")? {
        let table = format!("support.{index}");
        doc.allow(&table, &["edge", "where", "at", "point", "kind", "motion"])?;
        let kind: SupportKind = doc.choice(&format!("{table}.kind"))?;
        let key = format!("{table}.motion");
        if !kind.holds_deflection() {
            doc.forbid(
                &key,
                format!("contradicts kind = \"{}\", which leaves the plate free to move", kind.word()),
            )?;
        }
        let support = Support { stand: stand(doc, &table, has_file)?, kind, motion: motion(doc, &key)? };
        let whole = |support: &Support| matches!(support.stand, SupportLocation::Edge { part: None, .. });
        if let Some(first) =
            supports.iter().position(|earlier| earlier.stand == support.stand && whole(&support))
        {
            let wrong = format!("support.{first} already holds this edge; expected each edge once");
            return Err(doc.fault(&format!("{table}.edge"), wrong));
        }
        supports.push(support);
    }
    Ok(supports)
}

fn stand(doc: &Document, table: &str, has_file: bool) -> Result<SupportLocation> {
    let key = |name: &str| format!("{table}.{name}");
    let named: Vec<&str> =
        ["edge", "at", "point"].into_iter().filter(|name| doc.get(&key(name)).is_some()).collect();
    if let [first, second, ..] = named[..] {
        let wrong = format!("contradicts {table}.{second}; expected only one of edge, at, point");
        return Err(doc.fault(&key(first), wrong));
    }
    let part = match doc.get(&key("where")) {
        Some(_) if named.first() != Some(&"edge") => {
            return Err(doc.fault(&key("where"), "has no use without edge, of which it takes a part"));
        }
        Some(_) => Some(doc.condition(&key("where"))?),
        None => None,
    };
    match named.first() {
        Some(&"at") => Ok(SupportLocation::At(point(doc, &key("at"))?)),
        Some(&"point") => {
            Ok(SupportLocation::Point(name(doc, &key("point"), "expected the name of a physical point")?))
        }
        _ if has_file => {
            let edge = name(doc, &key("edge"), "expected the name of a physical curve")?;
            Ok(SupportLocation::Edge { edge, part })
        }
        _ => Ok(SupportLocation::Edge { edge: doc.one_of(&key("edge"), &EDGES)?.to_owned(), part }),
    }
}

/// Reads the motion of a support; [`check_jumps`] refuses jumps.
fn motion(doc: &Document, key: &str) -> Result<Option<FieldInput>> {
    Ok(doc.given(key, &DEFLECTION, Names::T)?.filter(|motion| !motion.is_zero()))
}

fn obstacles(doc: &Document) -> Result<Vec<Obstacle>> {
    let mut obstacles: Vec<Obstacle> = Vec::new();
    for index in 0..doc.entries("obstacle", "expected tables [[obstacle]] with side and height")? {
        let table = format!("obstacle.{index}");
        doc.allow(&table, &["side", "height", "where", "group", "at", "point", "line"])?;
        let (side, height) = (format!("{table}.side"), format!("{table}.height"));
        let obstacle = Obstacle {
            side: doc.choice(&side)?,
            height: doc.needed(&height, &HEIGHT, Names::XYT)?,
            region: region(doc, &table, &["where", "group", "at", "point", "line"])?,
        };
        let same = |other: &&Obstacle| other.side == obstacle.side && other.region == Region::All;
        if obstacle.region == Region::All
            && let Some(first) = obstacles.iter().position(|other| same(&other))
        {
            let wrong = format!("obstacle.{first} already lies on this side of the whole plate");
            let expected =
                "expected where, group, at, point or line, for an obstacle opposite to a part of it";
            return Err(doc.fault(&side, format!("{wrong}; {expected}")));
        }
        if let Some([own, other]) = obstacles.iter().find_map(|other| no_room(&obstacle, other)) {
            let wrong = format!("{own:?} leaves no room beside the obstacle at {other:?} m");
            return Err(
                doc.fault(&height, format!("{wrong}; expected the one below lower than the one above"))
            );
        }
        obstacles.push(obstacle);
    }
    Ok(obstacles)
}

/// Returns the heights of two planes on opposite sides that leave no room for the plate.
fn no_room(one: &Obstacle, other: &Obstacle) -> Option<[f64; 2]> {
    let all = one.region == Region::All && other.region == Region::All;
    let heights = [one.height.number()?, other.height.number()?];
    let crossed = match one.side {
        Side::Below => heights[0] > heights[1],
        Side::Above => heights[0] < heights[1],
    };
    (all && one.side != other.side && crossed).then_some(heights)
}

fn load(doc: &Document, places: &Places) -> Result<Option<Load>> {
    doc.allow("load", &["pressure", "gravity", "force"])?;
    if doc.get("load").is_none() {
        return Ok(None);
    }
    let gravity = doc.optional_number("load.gravity", &GRAVITY)?;
    let force = |index: usize| {
        let table = format!("load.force.{index}");
        doc.allow(&table, &["at", "point", "value"])?;
        let (at, point) = places.of(doc, &table)?;
        Ok(Force { at, point, value: doc.needed(&format!("{table}.value"), &FORCE, Names::T)? })
    };
    let count = doc.entries("load.force", "expected tables [[load.force]] with at and value")?;
    let forces: Vec<Force> = (0..count).map(force).collect::<Result<_>>()?;
    let pressure = if gravity.is_some() || !forces.is_empty() {
        doc.given("load.pressure", &PRESSURE, Names::XYT)?
            .unwrap_or(FieldInput::constant("load.pressure", 0.0))
    } else {
        doc.needed("load.pressure", &PRESSURE, Names::XYT)?
    };
    Ok(Some(Load { pressure, gravity: gravity.unwrap_or(0.0), forces }))
}

fn foundations(doc: &Document) -> Result<Vec<Foundation>> {
    let foundation = |index: usize| {
        let table = format!("foundation.{index}");
        doc.allow(&table, &["stiffness", "where", "group"])?;
        Ok(Foundation {
            stiffness: doc.needed(&format!("{table}.stiffness"), &FOUNDATION, Names::XY)?,
            region: region(doc, &table, &["where", "group"])?,
        })
    };
    let count = doc.entries("foundation", "expected tables [[foundation]] with stiffness")?;
    (0..count).map(foundation).collect()
}

fn springs(doc: &Document, places: &Places) -> Result<Vec<Spring>> {
    let spring = |index: usize| {
        let table = format!("spring.{index}");
        doc.allow(&table, &["at", "point", "stiffness"])?;
        let (at, point) = places.of(doc, &table)?;
        Ok(Spring { at, point, stiffness: doc.number(&format!("{table}.stiffness"), &SPRING)? })
    };
    (0..doc.entries("spring", "expected tables [[spring]] with at and stiffness")?).map(spring).collect()
}

fn masses(doc: &Document, places: &Places) -> Result<Vec<PointMass>> {
    let mass = |index: usize| {
        let table = format!("mass.{index}");
        doc.allow(&table, &["at", "point", "mass"])?;
        let (at, point) = places.of(doc, &table)?;
        Ok(PointMass { at, point, mass: doc.number(&format!("{table}.mass"), &MASS)? })
    };
    (0..doc.entries("mass", "expected tables [[mass]] with at and mass")?).map(mass).collect()
}

fn balls(doc: &Document, places: &Places) -> Result<Vec<Ball>> {
    let ball = |index: usize| {
        let table = format!("ball.{index}");
        doc.allow(&table, &["at", "point", "side", "mass", "height", "velocity"])?;
        let key = |name: &str| format!("{table}.{name}");
        let (at, point) = places.of(doc, &table)?;
        Ok(Ball {
            at,
            point,
            side: doc.optional_choice(&key("side"))?.unwrap_or(Side::Above),
            mass: doc.number(&key("mass"), &MASS)?,
            height: doc.number(&key("height"), &HEIGHT)?,
            velocity: doc.optional_number(&key("velocity"), &VELOCITY)?.unwrap_or(0.0),
        })
    };
    (0..doc.entries("ball", "expected tables [[ball]] with at, mass and height")?).map(ball).collect()
}

fn damping(doc: &Document) -> Result<Option<Damping>> {
    doc.allow("damping", &["mass", "stiffness", "modal"])?;
    if doc.get("damping").is_none() {
        return Ok(None);
    }
    let ratio = |index: usize| doc.number(&format!("damping.modal.{index}"), &RATIO);
    let count = doc.entries("damping.modal", "expected an array of the damping ratios of the first modes")?;
    Ok(Some(Damping {
        mass: doc.optional_number("damping.mass", &MASS_DAMPING)?.unwrap_or(0.0),
        stiffness: doc.optional_number("damping.stiffness", &STIFFNESS_DAMPING)?.unwrap_or(0.0),
        modal: (0..count).map(ratio).collect::<Result<_>>()?,
    }))
}

fn initial(doc: &Document) -> Result<Initial> {
    let others = ["static_pressure", "equilibrium", "deflection", "velocity"];
    doc.allow("initial", &[&others[..], &["from"]].concat())?;
    let from = from_run(doc)?;
    if from.is_some() {
        for name in others {
            let wrong = "contradicts initial.from: the other run gives deflection and velocity";
            doc.forbid_with("initial.from", &format!("initial.{name}"), wrong)?;
        }
    }
    let given = |name: &str, quantity| {
        let key = format!("initial.{name}");
        if from.is_some() {
            return Ok(FieldInput::constant(&key, 0.0));
        }
        Ok::<_, Error>(doc.given(&key, quantity, Names::XY)?.unwrap_or(FieldInput::constant(&key, 0.0)))
    };
    let initial = Initial {
        static_pressure: given("static_pressure", &PRESSURE)?,
        equilibrium: from.is_none() && doc.optional_truth("initial.equilibrium")?.unwrap_or(false),
        deflection: given("deflection", &DEFLECTION)?,
        velocity: given("velocity", &VELOCITY)?,
        from,
    };
    if !initial.deflection.is_zero() && (initial.equilibrium || !initial.static_pressure.is_zero()) {
        let wrong = "contradicts a static start; expected either initial.deflection";
        return Err(doc.fault(
            "initial.deflection",
            format!("{wrong}, or initial.static_pressure and initial.equilibrium"),
        ));
    }
    Ok(initial)
}

/// Reads the run whose last state is the start.
///
/// Its folder is relative to the scene's file or, failing that, to the working folder.
fn from_run(doc: &Document) -> Result<Option<StartFrom>> {
    let key = "initial.from";
    if doc.get(key).is_none() {
        return Ok(None);
    }
    let folder = name(doc, key, "expected the folder of a run that is done")?;
    let beside = doc.beside(&folder);
    let path = if Path::new(&beside).is_dir() { beside } else { folder.clone() };
    if !Path::new(&path).join(motion::FILE).is_file() {
        let wrong =
            format!("{} has no {}; expected the folder of a run that is done", quote(&path), motion::FILE);
        return Err(doc.fault(key, wrong));
    }
    let motion = Motion::read(Path::new(&path)).map_err(|why| match why {
        Error::Scene(why) => doc.fault(key, why),
        other => other,
    })?;
    Ok(Some(StartFrom { folder, path, motion: Arc::new(motion) }))
}

fn time(doc: &Document) -> Result<Time> {
    doc.allow("time", &["scheme", "mass", "beta", "restitution", "massless", "step", "end"])?;
    let time = Time {
        scheme: scheme(doc)?,
        mass: doc.choice("time.mass")?,
        step: doc.number("time.step", &STEP)?,
        end: doc.number("time.end", &END)?,
    };
    let Time { step, end, .. } = time;
    if end < step {
        let wrong = format!("{end:?} is before the first step; expected at least time.step = {step:?} s");
        return Err(doc.fault("time.end", wrong));
    }
    if end / step >= TOO_MANY_STEPS {
        let wrong = format!("{step:?} makes {:.1e} steps to {end:?} s; expected less than 2^53", end / step);
        return Err(doc.fault("time.step", wrong));
    }
    whole_steps(doc, &time)?;
    Ok(time)
}

/// Refuses an end between two steps, and suggests values that fit.
fn whole_steps(doc: &Document, time: &Time) -> Result<()> {
    let Time { step, end, .. } = *time;
    let steps = end / step;
    if (steps - steps.round()).abs() <= WHOLE * steps {
        return Ok(());
    }
    // Twelve digits pass the check and stay short for round numbers.
    let tidy = |value: f64| spell(format!("{value:.11e}").parse().unwrap_or(value));
    let counts = [steps.floor(), steps.floor() + 1.0];
    let [long, short] = counts.map(|count| tidy(end / count));
    let [before, after] = counts.map(|count| tidy(count * step));
    let is_of_step = doc.is_overridden("time.step") && !doc.is_overridden("time.end");
    let key = if is_of_step { "time.step" } else { "time.end" };
    let wrong = format!("{end:?} s is no whole number of steps of {step:?} s, but {steps:.6} of them");
    let expected = format!("expected time.step = {long} or {short}, or time.end = {before} or {after}");
    Err(doc.fault(key, format!("{wrong}; {expected}")))
}

fn scheme(doc: &Document) -> Result<SchemeSpec> {
    let name: SchemeName = doc.choice("time.scheme")?;
    for (key, of) in [
        ("time.beta", SchemeName::Newmark),
        ("time.restitution", SchemeName::Newmark),
        ("time.massless", SchemeName::Midpoint),
    ] {
        if name != of {
            let wrong = format!(
                "contradicts time.scheme = \"{}\"; expected only with \"{}\"",
                name.word(),
                of.word()
            );
            doc.forbid_with("time.scheme", key, wrong)?;
        }
    }
    match name {
        SchemeName::Newmark => Ok(SchemeSpec::Newmark {
            beta: doc.optional_number("time.beta", &BETA)?.unwrap_or(0.5),
            restitution: doc.optional_number("time.restitution", &RESTITUTION)?.unwrap_or(0.0),
        }),
        SchemeName::Midpoint => Ok(SchemeSpec::Midpoint { massless: massless(doc)? }),
        SchemeName::Conserving => only_singular(
            doc,
            SchemeSpec::Conserving,
            "with this mass velocities jump at impacts, and nothing says what energy is left",
        ),
        SchemeName::Exact => {
            only_singular(doc, SchemeSpec::Exact, "with this mass an impact has no law of its own to follow")
        }
    }
}

/// Returns a scheme after the check that the mass is singular, which it needs for the reason `why`.
fn only_singular(doc: &Document, scheme: SchemeSpec, why: &str) -> Result<SchemeSpec> {
    if doc.choice::<Mass>("time.mass")? == Mass::Consistent {
        let name = doc.choice::<SchemeName>("time.scheme")?.word();
        let wrong = format!("\"consistent\" contradicts time.scheme = \"{name}\": {why}");
        let expected = "expected \"singular\", or time.scheme = \"newmark\"";
        return Err(doc.fault("time.mass", format!("{wrong}; {expected}")));
    }
    Ok(scheme)
}

fn massless(doc: &Document) -> Result<Massless> {
    let mass: Mass = doc.choice("time.mass")?;
    let damped = doc.optional_number("damping.stiffness", &STIFFNESS_DAMPING)?.is_some_and(|beta| beta > 0.0);
    let own = if damped { Massless::Reflected } else { mass.massless() };
    let massless = doc.optional_choice("time.massless")?.unwrap_or(own);
    if (own, massless) == (Massless::Reflected, Massless::Equilibrium) {
        let why = match mass {
            Mass::Consistent => "time.mass = \"consistent\", which leaves nothing massless",
            Mass::Singular => "damping.stiffness, under which the massless part is in no equilibrium",
        };
        let wrong = format!("\"equilibrium\" contradicts {why}; expected \"reflected\"");
        return Err(doc.fault("time.massless", wrong));
    }
    Ok(massless)
}

/// Refuses keys that a start from another run excludes.
fn check_from(doc: &Document, scene: &Scene) -> Result<()> {
    let Some(StartFrom { folder, motion, .. }) = &scene.initial.from else { return Ok(()) };
    let refuse = |what: &str| Err(doc.fault("initial.from", format!("{} {what}", quote(folder))));
    if !scene.balls.is_empty() {
        return refuse("does not record balls; expected a scene without [[ball]]");
    }
    if scene.motions().next().is_some() {
        return refuse("does not record supports that move; expected a scene whose supports stand still");
    }
    if motion.supports != scene.supports_in_words() {
        return refuse("is a run with other supports; expected the same [[support]]");
    }
    Ok(())
}

/// Refuses combinations that the scheme does not support.
fn check_scheme(doc: &Document, scene: &Scene) -> Result<()> {
    let name = scene.time.scheme.name();
    let damping = scene.damping.as_ref();
    let refuse = |key: &str, what: &str, others: &str| {
        Err(doc.fault(key, format!("time.scheme = \"{name}\" {what}; expected {others}")))
    };
    if scene.time.scheme == SchemeSpec::Exact {
        if scene.solver.engine == EngineName::Petsc {
            let others = "\"native\", or time.scheme = \"newmark\"";
            return refuse("solver.engine", "runs on the native engine, in one process", others);
        }
        if let Some(key) = scene.changes() {
            let what = "takes only what does not change with time";
            return refuse(&key, what, "time.scheme = \"conserving\" or \"newmark\"");
        }
    }
    if matches!(scene.time.scheme, SchemeSpec::Exact | SchemeSpec::Conserving) {
        for (key, is_on) in [
            ("damping.stiffness", damping.is_some_and(|damping| damping.stiffness > 0.0)),
            ("damping.modal", damping.is_some_and(|damping| !damping.modal.is_empty())),
        ] {
            if is_on {
                let others = "damping.mass alone, or time.scheme = \"newmark\" or \"midpoint\"";
                return refuse(key, "knows damping by mass only", others);
            }
        }
    }
    Ok(())
}

fn solver(doc: &Document, engine: EngineName) -> Result<Solver> {
    doc.allow("solver", &["engine", "vi", "tolerance", "energy_guard"])?;
    Ok(Solver {
        engine: doc.optional_choice("solver.engine")?.unwrap_or(engine),
        vi: doc.optional_choice("solver.vi")?.unwrap_or(ContactSolver::Condensed),
        tolerance: doc.optional_number("solver.tolerance", &TOLERANCE)?.unwrap_or(1e-10),
        energy_guard: doc.optional_number("solver.energy_guard", &ENERGY_GUARD)?.unwrap_or(100.0),
    })
}

/// Reads the settings of snapshots; by default finer meshes divide their cells less.
fn snapshots(doc: &Document, mesh: &Grid) -> Result<Option<Snapshots>> {
    let Some(every) = doc.optional_count("output.fields_every", "a number of steps", 1)? else {
        doc.forbid("output.subdivide", "has no use without output.fields_every")?;
        return Ok(None);
    };
    let rectangles = (mesh.cells[0] * mesh.cells[1]) << (2 * mesh.refine);
    let parts = match rectangles {
        0..=2_000 => 4,
        2_001..=20_000 => 2,
        _ => 1,
    };
    let subdivide =
        doc.optional_count("output.subdivide", "a number of parts of each edge", 1)?.unwrap_or(parts);
    if subdivide > MOST_PARTS {
        let wrong = format!("{subdivide} parts are too many; expected at most {MOST_PARTS}");
        return Err(doc.fault("output.subdivide", wrong));
    }
    Ok(Some(Snapshots { every, subdivide: subdivide as usize }))
}

fn output(doc: &Document, places: &Places, mesh: &Grid, balls: &[Ball]) -> Result<Output> {
    doc.allow("output", &["every", "fields_every", "subdivide", "checkpoint_every", "probes"])?;
    let every = doc.optional_count("output.every", "a number of steps", 1)?.unwrap_or(1);
    let mut probes: Vec<Probe> = Vec::new();
    for index in 0..doc.entries("output.probes", "expected an array of { name = \"...\", at = [x, y] }")? {
        let probe = probe(doc, &format!("output.probes.{index}"), places, balls)?;
        if let Some(first) = probes.iter().position(|earlier| earlier.name == probe.name) {
            let wrong =
                format!("{} is already output.probes.{first}; expected unique names", quote(&probe.name));
            return Err(doc.fault(&format!("output.probes.{index}.name"), wrong));
        }
        probes.push(probe);
    }
    let checkpoint_every = doc.optional_count("output.checkpoint_every", "a number of steps", 1)?;
    Ok(Output { every, checkpoint_every, fields: snapshots(doc, mesh)?, probes })
}

fn probe(doc: &Document, table: &str, places: &Places, balls: &[Ball]) -> Result<Probe> {
    doc.allow(table, &["name", "at", "point", "ball"])?;
    let name = probe_name(doc, &format!("{table}.name"))?;
    let key = format!("{table}.ball");
    let Some(number) = doc.optional_count(&key, "the number of a ball, from 0,", 0)? else {
        let (at, point) = places.of(doc, table)?;
        return Ok(Probe { name, at, point, ball: None });
    };
    for place in ["at", "point"] {
        doc.forbid(
            &format!("{table}.{place}"),
            format!("contradicts {key}: a ball is where its own table says"),
        )?;
    }
    let number = usize::try_from(number).unwrap_or(usize::MAX);
    let ball = balls.get(number).ok_or_else(|| {
        doc.fault(&key, format!("{number} is no ball; the scene has {} of them, counted from 0", balls.len()))
    })?;
    Ok(Probe { name, at: ball.at, point: None, ball: Some(number) })
}

/// Reads a name that is valid as a column of the history.
fn probe_name(doc: &Document, key: &str) -> Result<String> {
    let expected = "expected a name without commas, quotes and control characters";
    let name = doc.optional_text(key, expected)?.ok_or_else(|| doc.missing(key, expected))?;
    if HISTORY_COLUMNS.contains(&name) {
        return Err(
            doc.fault(key, format!("{} is a column of history.csv; expected another name", quote(name)))
        );
    }
    let is_bad = |c: char| matches!(c, ',' | '"' | '\'') || c.is_control();
    if name.trim().is_empty() || name.contains(is_bad) {
        return Err(doc.fault(key, format!("{} cannot head a column; {expected}", quote(name))));
    }
    Ok(name.to_owned())
}

fn study(doc: &Document, mesh: &Grid, time: &Time, solver: &Solver) -> Result<Option<Study>> {
    let keys = ["schemes", "masses", "restitutions", "steps", "elements", "cells", "refinements", "engines"];
    let others = ["vi", "reference_cells", "reference_refine", "at", "until", "repeat"];
    doc.allow("study", &[&keys[..], &others].concat())?;
    if doc.get("study").is_none() {
        return Ok(None);
    }
    let is_of_file = mesh.is_of_file();
    if is_of_file {
        for key in ["study.elements", "study.cells", "study.reference_cells"] {
            doc.forbid(key, "contradicts mesh.file, whose cells are given; expected study.refinements")?;
        }
    } else {
        doc.forbid("study.reference_refine", "is for a mesh from a file; expected study.reference_cells")?;
    }
    let usual = Study::of(mesh, time, solver);
    let cells = doc.list("study.cells", |key| cells(doc, key))?.unwrap_or(usual.cells);
    let count = |key: &str| doc.count(key, "a number of uniform refinements", 0);
    let refinements = doc.list("study.refinements", count)?;
    let refinements =
        refinements.unwrap_or_else(|| usual.refinements.iter().copied().map(u64::from).collect());
    let most = refinements.iter().copied().max().unwrap_or(0);
    let reference_refine =
        doc.optional_count("study.reference_refine", "a number of uniform refinements", 0)?;
    let reference_refine = reference_refine.unwrap_or(if is_of_file { most.saturating_add(1) } else { 0 });
    let sized = |cells: &[usize; 2]| if is_of_file { [1, 1] } else { *cells };
    for (key, times) in [("study.refinements", most), ("study.reference_refine", reference_refine)] {
        if let Some(cells) = cells.iter().map(sized).find(|cells| self::refinements(*cells, times).is_none())
        {
            return Err(too_many(doc, key, cells, times));
        }
    }
    let refinements: Vec<u32> = refinements.into_iter().map(|refine| refine as u32).collect();
    let reference_cells = match doc.get("study.reference_cells") {
        Some(_) => self::cells(doc, "study.reference_cells")?,
        None => study::finer(&cells, &refinements),
    };
    let study = Study {
        schemes: doc.list("study.schemes", |key| doc.choice(key))?.unwrap_or(usual.schemes),
        masses: doc.list("study.masses", |key| doc.choice(key))?.unwrap_or(usual.masses),
        restitutions: doc
            .list("study.restitutions", |key| doc.number(key, &RESTITUTION))?
            .unwrap_or(usual.restitutions),
        steps: doc.list("study.steps", |key| doc.number(key, &STEP))?.unwrap_or(usual.steps),
        elements: doc.list("study.elements", |key| doc.choice(key))?.unwrap_or(usual.elements),
        cells,
        refinements,
        engines: doc.list("study.engines", |key| doc.choice(key))?.unwrap_or(usual.engines),
        vi: doc.list("study.vi", |key| doc.choice(key))?.unwrap_or(usual.vi),
        reference_cells,
        reference_refine: reference_refine as u32,
        at: doc.list("study.at", |key| instant(doc, key, time))?.unwrap_or(usual.at),
        until: doc.optional_choice("study.until")?.unwrap_or(usual.until),
        repeat: doc
            .optional_count("study.repeat", "a number of repetitions", 1)?
            .map_or(usual.repeat, |n| u32::try_from(n).unwrap_or(u32::MAX)),
    };
    if study.interval(time.end).is_none() {
        let wrong = "no instants are common to these steps, or fewer than 20 of them";
        let expected = "expected steps with a short common multiple, such as 1e-3, 5e-4, 2e-4, 1e-4";
        return Err(
            doc.fault("study.steps", format!("{wrong} up to time.end = {:?} s; {expected}", time.end))
        );
    }
    Ok(Some(study))
}

/// Reads an instant of the run.
fn instant(doc: &Document, key: &str, time: &Time) -> Result<f64> {
    let at = doc.number(key, &INSTANT)?;
    if at > time.end {
        return Err(doc.fault(key, format!("{at:?} is after time.end = {:?} s", time.end)));
    }
    Ok(at)
}

/// Refuses jumps of obstacles and supports, as far as they can be found without a mesh.
fn check_jumps(doc: &Document, scene: &Scene) -> Result<()> {
    let heights = scene.obstacles.iter().map(|obstacle| &obstacle.height);
    for given in scene.motions().chain(heights).filter(|given| given.is_even() && given.changes()) {
        if let Some(wrong) = given.jump(Point::origin(), &scene.time, MOST_LOOKS) {
            return Err(doc.fault(&given.key, wrong));
        }
    }
    Ok(())
}

/// Refuses a flat start beyond an obstacle.
fn check_start(doc: &Document, scene: &Scene) -> Result<()> {
    let Initial { static_pressure, equilibrium, deflection, from, .. } = &scene.initial;
    let moves = scene.supports.iter().any(|support| support.motion.is_some());
    if moves || from.is_some() || *equilibrium || !static_pressure.is_zero() || !deflection.is_zero() {
        return Ok(());
    }
    for (index, Obstacle { side, height, .. }) in scene.obstacles.iter().enumerate() {
        let Some(height) = height.number() else { continue };
        let (is_beyond, side, limit) = match side {
            Side::Below => (height > 0.0, "above", "at most"),
            Side::Above => (height < 0.0, "below", "at least"),
        };
        if is_beyond {
            let wrong = format!("{height:?} is {side} the plate, which starts flat at 0");
            let wrong = format!("{wrong}; expected {limit} 0, or a start by initial.static_pressure");
            return Err(doc.fault(&format!("obstacle.{index}.height"), wrong));
        }
    }
    Ok(())
}
