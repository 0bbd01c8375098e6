//! Table `[study]`: the runs that a study compares.

use super::mesh;
use super::quantities::{INSTANT, RESTITUTION, STEP};
use crate::error::Result;
use crate::scene::document::Document;
use crate::scene::keys::{TableKeys, ValueKind, key, words};
use crate::scene::study::finer;
use crate::scene::{
    ContactSolver, ElementKind, EngineName, Grid, Horizon, Mass, SchemeName, Solver, Study, Time,
};

const CELLS: ValueKind = ValueKind::Pair(&ValueKind::Count(1));

pub(super) static STUDY: TableKeys = TableKeys::optional(&[&[
    key("schemes", ValueKind::List(&ValueKind::Word(words::<SchemeName>)), "time schemes"),
    key("masses", ValueKind::List(&ValueKind::Word(words::<Mass>)), "masses"),
    key(
        "restitutions",
        ValueKind::List(&ValueKind::Number(&RESTITUTION)),
        "restitution coefficients of Newmark's scheme",
    ),
    key("steps", ValueKind::List(&ValueKind::Number(&STEP)), "time steps in s, with a short common multiple"),
    key("elements", ValueKind::List(&ValueKind::Word(words::<ElementKind>)), "elements"),
    key("cells", ValueKind::List(&CELLS), "meshes, [nx, ny] each"),
    key("refinements", ValueKind::List(&ValueKind::Count(0)), "numbers of uniform refinements"),
    key("engines", ValueKind::List(&ValueKind::Word(words::<EngineName>)), "engines"),
    key("vi", ValueKind::List(&ValueKind::Word(words::<ContactSolver>)), "contact solvers"),
    key("reference_cells", CELLS, "mesh that measures the error in space"),
    key(
        "reference_refine",
        ValueKind::Count(0),
        "with mesh.file: refinements of the mesh that measures the error in space",
    ),
    key("at", ValueKind::List(&ValueKind::Number(&INSTANT)), "instants in s at which errors are reported"),
    key("until", ValueKind::Word(words::<Horizon>), "horizon over which the runs are ranked"),
    key("repeat", ValueKind::Count(1), "number of timed repetitions"),
    key("modes", ValueKind::List(&ValueKind::Count(1)), "numbers of modes, with \"modal\" among the masses"),
    key(
        "reference_mass",
        ValueKind::Word(words::<Mass>),
        "mass of the motion on the reference mesh: singular or modal",
    ),
    key("reference_modes", ValueKind::Count(1), "number of its modes; default: twice the largest of modes"),
    key("limits", ValueKind::Truth, "false: measure the whole error of each run only"),
    key("floor", ValueKind::Truth, "true: measure by how much the best runs differ"),
    key("skip", ValueKind::List(&ValueKind::Text), "runs that are left out, by words of their names"),
]]);

pub(super) fn read(doc: &Document, grid: &Grid, time: &Time, solver: &Solver) -> Result<Option<Study>> {
    doc.allow("study", &STUDY)?;
    if doc.get("study").is_none() {
        return Ok(None);
    }
    let is_of_file = grid.is_of_file();
    if is_of_file {
        for key in ["study.elements", "study.cells", "study.reference_cells"] {
            doc.forbid(key, "contradicts mesh.file, whose cells are given; expected study.refinements")?;
        }
    } else {
        doc.forbid("study.reference_refine", "is for a mesh from a file; expected study.reference_cells")?;
    }
    let usual = Study::of(grid, time, solver);
    let cells = doc.list("study.cells", |key| mesh::cells(doc, key))?.unwrap_or(usual.cells);
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
        if let Some(cells) = cells.iter().map(sized).find(|cells| mesh::refinements(*cells, times).is_none())
        {
            return Err(mesh::too_many(doc, key, cells, times));
        }
    }
    let refinements: Vec<u32> = refinements.into_iter().map(|refine| refine as u32).collect();
    let reference_cells = match doc.get("study.reference_cells") {
        Some(_) => mesh::cells(doc, "study.reference_cells")?,
        None => finer(&cells, &refinements),
    };
    let masses = doc.list("study.masses", |key| doc.choice(key))?.unwrap_or(usual.masses);
    let modes = modes(doc, &masses)?.unwrap_or(usual.modes);
    let (reference_mass, reference_modes) = reference_mass(doc, &modes)?;
    let study = Study {
        schemes: doc.list("study.schemes", |key| doc.choice(key))?.unwrap_or(usual.schemes),
        masses,
        modes,
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
        reference_mass,
        reference_modes,
        limits: doc.optional_truth("study.limits")?.unwrap_or(usual.limits),
        floor: doc.optional_truth("study.floor")?.unwrap_or(usual.floor),
        skip: doc.list("study.skip", |key| words_of_run(doc, key))?.unwrap_or(usual.skip),
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

/// Reads the numbers of modes, which only the modal mass takes.
fn modes(doc: &Document, masses: &[Mass]) -> Result<Option<Vec<usize>>> {
    if !masses.contains(&Mass::Modal) {
        let wrong = "contradicts study.masses; expected \"modal\" among them";
        doc.forbid_with("study.masses", "study.modes", wrong)?;
    }
    doc.list("study.modes", |key| number_of_modes(doc, key))
}

fn number_of_modes(doc: &Document, key: &str) -> Result<usize> {
    Ok(usize::try_from(doc.count(key, "a number of modes", 1)?).unwrap_or(usize::MAX))
}

/// Reads the mass of the motion on the reference mesh, and its number of modes.
fn reference_mass(doc: &Document, modes: &[usize]) -> Result<(Mass, usize)> {
    let mass = doc.optional_choice("study.reference_mass")?.unwrap_or(Mass::Singular);
    if mass == Mass::Consistent {
        let wrong = "\"consistent\" leaves the motion to the restitution law of each scheme";
        let expected = "expected \"singular\" or \"modal\"";
        return Err(doc.fault("study.reference_mass", format!("{wrong}; {expected}")));
    }
    if mass != Mass::Modal {
        let wrong = "contradicts study.reference_mass; expected only with \"modal\"";
        doc.forbid_with("study.reference_mass", "study.reference_modes", wrong)?;
    }
    let most = modes.iter().copied().max().unwrap_or(1);
    let count = match doc.get("study.reference_modes") {
        Some(_) => number_of_modes(doc, "study.reference_modes")?,
        None => most.saturating_mul(2),
    };
    Ok((mass, count))
}

/// Reads words of runs.
fn words_of_run(doc: &Document, key: &str) -> Result<String> {
    let expected = "expected words of a run's name, such as \"80x32 newmark 2e-6\"";
    match doc.optional_text(key, expected)? {
        Some(words) if !words.trim().is_empty() => Ok(words.to_owned()),
        _ => Err(doc.fault(key, format!("no words; {expected}"))),
    }
}

/// Reads an instant of the run.
fn instant(doc: &Document, key: &str, time: &Time) -> Result<f64> {
    let at = doc.number(key, &INSTANT)?;
    if at > time.end {
        return Err(doc.fault(key, format!("{at:?} is after time.end = {:?} s", time.end)));
    }
    Ok(at)
}
