//! From a document to a scene: one function a table, its keys in the order of the file.

use std::path::Path;

use super::document::{Document, quote};
use super::typed::{Choice, Quantity, Range};
use super::words::SchemeName;
use super::{Diagonal, ElementKind};
use super::{
    EngineName, Grid, HISTORY_COLUMNS, Initial, Load, Mass, Massless, Obstacle, Output, Panel, Plate, Probe,
    Scene, Scheme, Side, Snapshots, Solver, Study, Support, Time, ViName, study,
};
use crate::error::{Error, Result};

/// The most rectangles of a mesh, after refinement.
const MOST_RECTANGLES: u64 = 4_000_000;

/// The most parts into which snapshots cut an edge.
const MOST_PARTS: u64 = 64;

/// From here on, not every number of steps is a floating-point number.
const TOO_MANY_STEPS: f64 = (1_u64 << 53) as f64;

const LENGTH: Quantity = Quantity::new("a length in m", Range::POSITIVE);
const WIDTH: Quantity = Quantity::new("a width in m", Range::POSITIVE);
const THICKNESS: Quantity = Quantity::new("a thickness in m", Range::POSITIVE);
const YOUNGS_MODULUS: Quantity = Quantity::new("Young's modulus in Pa", Range::POSITIVE);
const POISSONS_RATIO: Quantity = Quantity::new(
    "Poisson's ratio",
    Range::new(" greater than -1 and less than 0.5", "is out of range", |nu| -1.0 < nu && nu < 0.5),
);
const DENSITY: Quantity = Quantity::new("a density in kg/m3", Range::POSITIVE);
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
const INSTANT: Quantity =
    Quantity::new("an instant in s", Range::new(" of at least 0", "is negative", |time| time >= 0.0));
const TOLERANCE: Quantity = Quantity::new(
    "a relative KKT residual",
    Range::new(" greater than 0 and less than 1", "is out of range", |tolerance| {
        0.0 < tolerance && tolerance < 1.0
    }),
);
const ENERGY_GUARD: Quantity =
    Quantity::new("a ratio of energies", Range::new(" greater than 1", "is too small", |ratio| ratio > 1.0));
const COORDINATE: Quantity = Quantity::new("a coordinate in m", Range::ANY);

/// The whole scene, with the engine that it gets if it names none.
pub(super) fn scene(doc: &Document, file_name: &str, engine: EngineName) -> Result<Scene> {
    let tables =
        ["plate", "mesh", "support", "obstacle", "load", "initial", "time", "solver", "output", "study"];
    doc.allow("", &[&["title"], &tables[..]].concat())?;
    let title = title(doc, file_name)?;
    let plate = panel(doc)?;
    let (mesh, time, solver) = (grid(doc)?, time(doc)?, solver(doc, engine)?);
    let scene = Scene {
        title,
        plate,
        mesh,
        supports: supports(doc)?,
        obstacles: obstacles(doc)?,
        load: load(doc)?,
        initial: initial(doc)?,
        time,
        solver,
        output: output(doc, &plate, &mesh)?,
        study: study(doc, &mesh, &time, &solver)?,
    };
    check_start(doc, &scene)?;
    check_exact(doc, &scene)?;
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

fn panel(doc: &Document) -> Result<Panel> {
    doc.allow("plate", &["length", "width", "thickness", "youngs_modulus", "poissons_ratio", "density"])?;
    Ok(Panel {
        length: doc.number("plate.length", &LENGTH)?,
        width: doc.number("plate.width", &WIDTH)?,
        plate: Plate {
            thickness: doc.number("plate.thickness", &THICKNESS)?,
            youngs_modulus: doc.number("plate.youngs_modulus", &YOUNGS_MODULUS)?,
            poissons_ratio: doc.number("plate.poissons_ratio", &POISSONS_RATIO)?,
            density: doc.number("plate.density", &DENSITY)?,
        },
    })
}

fn grid(doc: &Document) -> Result<Grid> {
    doc.allow("mesh", &["element", "cells", "diagonal", "refine"])?;
    let element = doc.choice("mesh.element")?;
    let cells = cells(doc, "mesh.cells")?;
    let diagonal = diagonal(doc, element)?;
    let refine = doc.optional_count("mesh.refine", "a number of uniform refinements", 0)?.unwrap_or(0);
    let refine = refinements(cells, refine).ok_or_else(|| too_many(doc, "mesh.refine", cells, refine))?;
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

/// The numbers of rectangles along x and y.
fn cells(doc: &Document, key: &str) -> Result<[usize; 2]> {
    doc.pair(key, "expected [nx, ny], the numbers of rectangles along x and y")?;
    let nx = doc.count(&format!("{key}.0"), "a number of rectangles along x", 1)?;
    let ny = doc.count(&format!("{key}.1"), "a number of rectangles along y", 1)?;
    let cells = [nx as usize, ny as usize];
    refinements(cells, 0).map(|_| cells).ok_or_else(|| too_many(doc, key, cells, 0))
}

/// The refinements, if the mesh they lead to is not too large.
fn refinements([nx, ny]: [usize; 2], refine: u64) -> Option<u32> {
    let refine = u32::try_from(refine).ok()?;
    let rectangles = (nx as u64).checked_mul(ny as u64)?.checked_mul(4_u64.checked_pow(refine)?)?;
    (rectangles <= MOST_RECTANGLES).then_some(refine)
}

/// The error for a mesh that is too large.
fn too_many(doc: &Document, key: &str, [nx, ny]: [usize; 2], refine: u64) -> Error {
    let refined = if refine == 0 { String::new() } else { format!(", refined {refine} times,") };
    let wrong = format!("{nx} x {ny} rectangles{refined} are too many");
    doc.fault(key, format!("{wrong}; expected at most {MOST_RECTANGLES} in all"))
}

fn supports(doc: &Document) -> Result<Vec<Support>> {
    let mut supports: Vec<Support> = Vec::new();
    for index in 0..doc.entries("support", "expected tables [[support]] with edge and kind")? {
        let table = format!("support.{index}");
        doc.allow(&table, &["edge", "kind"])?;
        let key = format!("{table}.edge");
        let support = Support { edge: doc.choice(&key)?, kind: doc.choice(&format!("{table}.kind"))? };
        if let Some(first) = supports.iter().position(|earlier| earlier.edge == support.edge) {
            let wrong = format!("support.{first} already holds this edge; expected each edge once");
            return Err(doc.fault(&key, wrong));
        }
        supports.push(support);
    }
    Ok(supports)
}

fn obstacles(doc: &Document) -> Result<Vec<Obstacle>> {
    let mut obstacles: Vec<Obstacle> = Vec::new();
    for index in 0..doc.entries("obstacle", "expected tables [[obstacle]] with side and height")? {
        let table = format!("obstacle.{index}");
        doc.allow(&table, &["side", "height"])?;
        let (side, height) = (format!("{table}.side"), format!("{table}.height"));
        let obstacle = Obstacle { side: doc.choice(&side)?, height: doc.number(&height, &HEIGHT)? };
        if let Some(first) = obstacles.iter().position(|earlier| earlier.side == obstacle.side) {
            let wrong = format!("obstacle.{first} already lies on this side; expected at most one on each");
            return Err(doc.fault(&side, wrong));
        }
        if let Some(other) = obstacles.iter().find(|other| !leaves_room(other, &obstacle)) {
            let wrong =
                format!("{:?} leaves no room beside the obstacle at {:?} m", obstacle.height, other.height);
            return Err(
                doc.fault(&height, format!("{wrong}; expected the one below lower than the one above"))
            );
        }
        obstacles.push(obstacle);
    }
    Ok(obstacles)
}

/// Whether two obstacles on opposite sides have a gap between them, though it be of no width.
fn leaves_room(one: &Obstacle, other: &Obstacle) -> bool {
    match one.side {
        Side::Below => one.height <= other.height,
        Side::Above => other.height <= one.height,
    }
}

fn load(doc: &Document) -> Result<Option<Load>> {
    doc.allow("load", &["pressure"])?;
    match doc.get("load") {
        None => Ok(None),
        Some(_) => Ok(Some(Load { pressure: doc.number("load.pressure", &PRESSURE)? })),
    }
}

fn initial(doc: &Document) -> Result<Initial> {
    doc.allow("initial", &["static_pressure", "velocity"])?;
    Ok(Initial {
        static_pressure: doc.optional_number("initial.static_pressure", &PRESSURE)?.unwrap_or(0.0),
        velocity: doc.optional_number("initial.velocity", &VELOCITY)?.unwrap_or(0.0),
    })
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
    Ok(time)
}

fn scheme(doc: &Document) -> Result<Scheme> {
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
        SchemeName::Newmark => Ok(Scheme::Newmark {
            beta: doc.optional_number("time.beta", &BETA)?.unwrap_or(0.5),
            restitution: doc.optional_number("time.restitution", &RESTITUTION)?.unwrap_or(0.0),
        }),
        SchemeName::Midpoint => Ok(Scheme::Midpoint { massless: massless(doc)? }),
        SchemeName::Conserving => only_singular(
            doc,
            Scheme::Conserving,
            "with this mass velocities jump at impacts, and nothing says what energy is left",
        ),
        SchemeName::Exact => {
            only_singular(doc, Scheme::Exact, "with this mass an impact has no law of its own to follow")
        }
    }
}

/// A scheme that goes with the singular mass alone, and why.
fn only_singular(doc: &Document, scheme: Scheme, why: &str) -> Result<Scheme> {
    if doc.choice::<Mass>("time.mass")? == Mass::Consistent {
        let name = doc.choice::<SchemeName>("time.scheme")?.word();
        let wrong = format!("\"consistent\" contradicts time.scheme = \"{name}\": {why}");
        let expected = "expected \"singular\", or time.scheme = \"newmark\"";
        return Err(doc.fault("time.mass", format!("{wrong}; {expected}")));
    }
    Ok(scheme)
}

fn massless(doc: &Document) -> Result<Massless> {
    let own = doc.choice::<Mass>("time.mass")?.massless();
    let massless = doc.optional_choice("time.massless")?.unwrap_or(own);
    if (own, massless) == (Massless::Reflected, Massless::Equilibrium) {
        let wrong = "\"equilibrium\" contradicts time.mass = \"consistent\", which leaves nothing massless";
        return Err(doc.fault("time.massless", format!("{wrong}; expected \"reflected\"")));
    }
    Ok(massless)
}

/// The exact scheme has one engine.
fn check_exact(doc: &Document, scene: &Scene) -> Result<()> {
    if scene.time.scheme == Scheme::Exact && scene.solver.engine == EngineName::Petsc {
        let wrong = "time.scheme = \"exact\" runs on the native engine, in one process";
        return Err(
            doc.fault("solver.engine", format!("{wrong}; expected \"native\", or time.scheme = \"newmark\""))
        );
    }
    Ok(())
}

fn solver(doc: &Document, engine: EngineName) -> Result<Solver> {
    doc.allow("solver", &["engine", "vi", "tolerance", "energy_guard"])?;
    Ok(Solver {
        engine: doc.optional_choice("solver.engine")?.unwrap_or(engine),
        vi: doc.optional_choice("solver.vi")?.unwrap_or(ViName::Condensed),
        tolerance: doc.optional_number("solver.tolerance", &TOLERANCE)?.unwrap_or(1e-10),
        energy_guard: doc.optional_number("solver.energy_guard", &ENERGY_GUARD)?.unwrap_or(100.0),
    })
}

/// Snapshots; unless told otherwise, the finer the mesh, the less its cells are cut for them.
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

fn output(doc: &Document, plate: &Panel, mesh: &Grid) -> Result<Output> {
    doc.allow("output", &["every", "fields_every", "subdivide", "probes"])?;
    let every = doc.optional_count("output.every", "a number of steps", 1)?.unwrap_or(1);
    let mut probes: Vec<Probe> = Vec::new();
    for index in 0..doc.entries("output.probes", "expected an array of { name = \"...\", at = [x, y] }")? {
        let probe = probe(doc, &format!("output.probes.{index}"), plate)?;
        if let Some(first) = probes.iter().position(|earlier| earlier.name == probe.name) {
            let wrong =
                format!("{} is already output.probes.{first}; expected unique names", quote(&probe.name));
            return Err(doc.fault(&format!("output.probes.{index}.name"), wrong));
        }
        probes.push(probe);
    }
    Ok(Output { every, fields: snapshots(doc, mesh)?, probes })
}

fn probe(doc: &Document, table: &str, plate: &Panel) -> Result<Probe> {
    doc.allow(table, &["name", "at"])?;
    let (name, at) = (probe_name(doc, &format!("{table}.name"))?, format!("{table}.at"));
    doc.pair(&at, "expected [x, y] in m")?;
    let x = doc.number(&format!("{at}.0"), &COORDINATE)?;
    let y = doc.number(&format!("{at}.1"), &COORDINATE)?;
    let Panel { length, width, .. } = *plate;
    if !(0.0..=length).contains(&x) || !(0.0..=width).contains(&y) {
        let wrong = format!(
            "[{x:?}, {y:?}] is off the plate; expected x from 0 to {length:?} m, y from 0 to {width:?} m"
        );
        return Err(doc.fault(&at, wrong));
    }
    Ok(Probe { name, at: [x, y] })
}

/// A name that can head a column of the history.
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
    doc.allow("study", &[&keys[..], &["vi", "reference_cells", "at", "until", "repeat"]].concat())?;
    if doc.get("study").is_none() {
        return Ok(None);
    }
    let usual = Study::of(mesh, time, solver);
    let cells = doc.list("study.cells", |key| cells(doc, key))?.unwrap_or(usual.cells);
    let count = |key: &str| doc.count(key, "a number of uniform refinements", 0);
    let refinements = doc.list("study.refinements", count)?;
    let refinements =
        refinements.unwrap_or_else(|| usual.refinements.iter().copied().map(u64::from).collect());
    let most = refinements.iter().copied().max().unwrap_or(0);
    if let Some(cells) = cells.iter().find(|cells| self::refinements(**cells, most).is_none()) {
        return Err(too_many(doc, "study.refinements", *cells, most));
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

/// An instant of the run.
fn instant(doc: &Document, key: &str, time: &Time) -> Result<f64> {
    let at = doc.number(key, &INSTANT)?;
    if at > time.end {
        return Err(doc.fault(key, format!("{at:?} is after time.end = {:?} s", time.end)));
    }
    Ok(at)
}

/// A plate that starts flat must not start beyond an obstacle.
fn check_start(doc: &Document, scene: &Scene) -> Result<()> {
    if scene.initial.static_pressure != 0.0 {
        return Ok(());
    }
    for (index, Obstacle { side, height }) in scene.obstacles.iter().enumerate() {
        let (is_beyond, side, limit) = match side {
            Side::Below => (*height > 0.0, "above", "at most"),
            Side::Above => (*height < 0.0, "below", "at least"),
        };
        if is_beyond {
            let wrong = format!("{height:?} is {side} the plate, which starts flat at 0");
            let wrong = format!("{wrong}; expected {limit} 0, or a start by initial.static_pressure");
            return Err(doc.fault(&format!("obstacle.{index}.height"), wrong));
        }
    }
    Ok(())
}
