//! Table `[study]`: the runs that `rebond study` compares.

use super::document::Document;
use super::entry::{self, Kind, table};
use super::kinds::{count, not_negative, text, truth, word};
use super::mesh::{self, Grid, REFINEMENTS, counts};
use super::solver::Solver;
use super::time::{Time, restitution, step};
use super::{ContactSolver, ElementKind, EngineName, Horizon, Mass, SchemeName};
use crate::error::Result;
use crate::modes::ModeRange;
use serde::Serialize;

/// Approximate number of instants at which runs are compared.
const INSTANTS: f64 = 1000.0;

/// Least number of instants for a comparison.
const FEWEST_INSTANTS: f64 = 20.0;

/// Number of modes of the modal mass where neither the study nor the scene gives it.
const USUAL_MODES: usize = 200;

table! {
    /// Study: every valid combination of these lists is a run.
    #[derive(Debug, Clone, PartialEq, Serialize)]
    pub struct Study {
        /// Time schemes.
        schemes: Vec<SchemeName> = word().list().or_else(usual(|study| study.schemes));
        /// Mass matrices.
        masses: Vec<Mass> = word().list().or_else(usual(|study| study.masses));
        /// Numbers of modes that carry the inertia, with `"modal"` among the masses.
        modes: Vec<usize> =
            mode_count().list().says("numbers of modes with inertia").or_else(usual(|study| study.modes));
        /// Restitution coefficients e of Newmark's scheme.
        restitutions: Vec<f64> =
            restitution().list().says("newmark").or_else(usual(|study| study.restitutions));
        /// Time steps, which must have a short common multiple.
        steps: Vec<f64> = step().list().or_else(usual(|study| study.steps));
        /// Numbers of uniform refinements of each mesh: `[0, 1]`.
        refinements: Vec<u32> = count(REFINEMENTS, 0).list().or_else(usual(|study| study.refinements));
        /// Linear algebra engines.
        engines: Vec<EngineName> = word().list().or_else(usual(|study| study.engines));
        /// Contact solvers.
        vi: Vec<ContactSolver> = word().list().or_else(usual(|study| study.vi));
        /// For a mesh from a file, number of refinements of the mesh that measures the error in
        /// space; 0 for a rectangle.
        reference_refine: u32 =
            count(REFINEMENTS, 0).says(SPACE).or_else(usual(|study| study.reference_refine));
        /// Finite elements: `["fvs"]`; not for a mesh from a file.
        elements: Vec<ElementKind> = word().list().or_else(usual(|study| study.elements));
        /// Numbers of rectangles along x and y: `[[10, 4], [20, 8]]`; not for a mesh from a file.
        cells: Vec<[usize; 2]> = counts().list().or_else(usual(|study| study.cells));
        /// `[nx, ny]` of the mesh that measures the error in space; zeros where a file gives the
        /// mesh.
        reference_cells: [usize; 2] = counts().says(SPACE).or_else(usual(|study| study.reference_cells));
        /// Mass of the motion on that mesh: `"singular"` or `"modal"`.
        reference_mass: Mass = word().says("singular | modal").or(Mass::Singular);
        /// Number of modes of that motion with the modal mass, by default twice the largest of
        /// `modes`.
        reference_modes: usize = mode_count().or_else(usual(|study| study.reference_modes));
        /// `false` measures the whole error of each run only, instead of its errors in time and in
        /// space, which need a limit of each method on each mesh.
        limits: bool = truth().says("errors in time and in space are not told apart").or_silent(true);
        /// `true` measures by how much the best runs of all masses on the finest mesh differ.
        floor: bool = truth().says("distance between the best runs of all masses").or_silent(false);
        /// Runs that are left out, by words of their names: `["80x32 newmark 2e-6"]`.
        skip: Vec<String> = words().list().says("words of runs that are left out").or_silent(vec![]);
        /// Instants at which errors of the deflection are reported.
        at: Vec<f64> = not_negative("an instant", "s").list()
            .says("s, instants at which errors of the deflection are told").or_silent(vec![]);
        /// `"first_impact"`, `"second_impact"` or `"end"`: horizon over which the runs are ranked.
        until: Horizon = word().says("first_impact | second_impact | end: what ranks the runs")
            .or(Horizon::SecondImpact);
        /// Number of timed repetitions of each run.
        repeat: u32 = count("a number of repetitions", 1).says("timed repetitions").or(3);
    } then complete omit meaningless
}

/// Use of the reference meshes, in words.
const SPACE: &str = "mesh that measures the error in space";

/// Number of modes.
fn mode_count() -> Kind<usize> {
    count("a number of modes", 1)
}

/// Words of a run's name.
fn words() -> Kind<String> {
    text("expected words of a run's name, such as \"80x32 newmark 2e-6\"", |words, expected| {
        words.trim().is_empty().then(|| format!("no words; {expected}"))
    })
}

/// Returns the default of a key: its value in the default study of the scene.
fn usual<V: 'static>(value: fn(Study) -> V) -> impl Fn(&Document) -> Result<V> {
    move |doc| {
        let (mesh, time, solver) = (mesh::grid(doc)?, entry::read(doc, "time")?, entry::read(doc, "solver")?);
        Ok(value(Study::usual(&mesh, &time, &solver)))
    }
}

/// Completes a study by defaults that follow from other keys, and refuses contradictions.
fn complete(mut study: Study, doc: &Document, _: &str) -> Result<Study> {
    let is_of_file = doc.get("mesh.file").is_some();
    if is_of_file {
        for key in ["study.elements", "study.cells", "study.reference_cells"] {
            doc.forbid(key, "contradicts mesh.file, whose cells are given; expected study.refinements")?;
        }
    } else {
        doc.forbid("study.reference_refine", "is for a mesh from a file; expected study.reference_cells")?;
    }
    let most = study.refinements.iter().copied().max().unwrap_or(0);
    if is_of_file && doc.get("study.reference_refine").is_none() {
        study.reference_refine = most.saturating_add(1);
    }
    for (key, times) in [("study.refinements", most), ("study.reference_refine", study.reference_refine)] {
        study.cells.iter().try_for_each(|cells| mesh::fits(doc, key, *cells, times))?;
    }
    if doc.get("study.reference_cells").is_none() {
        study.reference_cells = finer(&study.cells, &study.refinements);
    }
    if !study.masses.contains(&Mass::Modal) {
        let wrong = "contradicts study.masses; expected \"modal\" among them";
        doc.forbid_with("study.masses", "study.modes", wrong)?;
    }
    if study.reference_mass == Mass::Consistent {
        let wrong = "\"consistent\" leaves the motion to the restitution law of each scheme";
        let expected = "expected \"singular\" or \"modal\"";
        return Err(doc.fault("study.reference_mass", format!("{wrong}; {expected}")));
    }
    if study.reference_mass != Mass::Modal {
        let wrong = "contradicts study.reference_mass; expected only with \"modal\"";
        doc.forbid_with("study.reference_mass", "study.reference_modes", wrong)?;
    }
    if doc.get("study.reference_modes").is_none() {
        study.reference_modes = study.modes.iter().copied().max().unwrap_or(1).saturating_mul(2);
    }
    let end = doc.figure("time.end").unwrap_or(0.0);
    if let Some(index) = study.at.iter().position(|instant| *instant > end) {
        let wrong = format!("{:?} is after time.end = {end:?} s", study.at[index]);
        return Err(doc.fault(&format!("study.at.{index}"), wrong));
    }
    if study.interval(end).is_none() {
        let wrong = "no instants are common to these steps, or fewer than 20 of them";
        let expected = "expected steps with a short common multiple, such as 1e-3, 5e-4, 2e-4, 1e-4";
        return Err(doc.fault("study.steps", format!("{wrong} up to time.end = {end:?} s; {expected}")));
    }
    Ok(study)
}

/// Returns the keys that a resolved scene omits, because others make them meaningless.
fn meaningless(study: &Study) -> Vec<&'static str> {
    let is_of_file = study.reference_cells == [0, 0];
    let mut keys =
        if is_of_file { vec!["elements", "cells", "reference_cells"] } else { vec!["reference_refine"] };
    if !study.masses.contains(&Mass::Modal) {
        keys.push("modes");
    }
    if study.reference_mass != Mass::Modal {
        keys.extend(["reference_mass", "reference_modes"]);
    }
    keys
}

impl Study {
    /// Creates the default study: all schemes on the scene's mesh, with the paper's masses and the
    /// scene's own, and with five steps, the scene's own and four coarser ones.
    pub(super) fn usual(mesh: &Grid, time: &Time, solver: &Solver) -> Study {
        let fits = |step: &f64| FEWEST_INSTANTS * step <= time.end;
        let mut steps: Vec<f64> =
            [16.0, 8.0, 4.0, 2.0, 1.0].iter().map(|times| times * time.step).filter(fits).collect();
        if steps.is_empty() {
            steps.push(time.step);
        }
        let modes = match time.modes {
            Some(ModeRange::Count(count)) => count,
            _ => USUAL_MODES,
        };
        let modal = (time.mass == Mass::Modal).then_some(Mass::Modal);
        Study {
            schemes: SchemeName::ALL.to_vec(),
            masses: [Mass::Singular, Mass::Consistent].into_iter().chain(modal).collect(),
            modes: vec![modes],
            restitutions: vec![0.0, 1.0],
            steps,
            elements: vec![mesh.element],
            cells: vec![mesh.cells],
            refinements: vec![mesh.refine],
            engines: vec![solver.engine],
            vi: vec![solver.vi],
            reference_cells: finer(&[mesh.cells], &[mesh.refine]),
            reference_refine: if mesh.is_of_file() { mesh.refine.saturating_add(1) } else { 0 },
            reference_mass: Mass::Singular,
            reference_modes: 2 * modes,
            limits: true,
            floor: false,
            skip: vec![],
            at: vec![],
            until: Horizon::SecondImpact,
            repeat: 3,
        }
    }

    /// Returns the time between two instants of comparison, in s.
    ///
    /// The time is a multiple of every step, so that no run is interpolated. `None` means that the
    /// steps have no common multiple short enough for a comparison.
    pub fn interval(&self, end: f64) -> Option<f64> {
        let common = common_multiple(&self.steps)?;
        let interval = common * (end / INSTANTS / common).ceil().max(1.0);
        (FEWEST_INSTANTS * interval <= end * (1.0 + 1e-9)).then_some(interval)
    }
}

/// Returns twice the numbers of rectangles of the finest mesh along each side.
fn finer(cells: &[[usize; 2]], refinements: &[u32]) -> [usize; 2] {
    let times = 2_usize.saturating_pow(refinements.iter().copied().max().unwrap_or(0)).saturating_mul(2);
    let finest = cells.iter().max_by_key(|[nx, ny]| nx.saturating_mul(*ny)).copied().unwrap_or([1, 1]);
    finest.map(|count| count.saturating_mul(times))
}

/// Returns the least common multiple of decimals, if its digits fit into an integer.
fn common_multiple(steps: &[f64]) -> Option<f64> {
    // Each step becomes the integer digits of its shortest decimal and a power of ten.
    let decimals: Vec<(u128, i32)> = steps
        .iter()
        .map(|step| {
            let text = format!("{step:e}");
            let (digits, exponent) = text.split_once('e')?;
            let fraction = digits.split_once('.').map_or(0, |(_, fraction)| fraction.len() as i32);
            Some((digits.replace('.', "").parse().ok()?, exponent.parse::<i32>().ok()? - fraction))
        })
        .collect::<Option<_>>()?;
    let unit = decimals.iter().map(|(_, exponent)| *exponent).min()?;
    let multiple = decimals.iter().try_fold(1_u128, |multiple, &(digits, exponent)| {
        let count = digits.checked_mul(10_u128.checked_pow((exponent - unit).unsigned_abs())?)?;
        multiple.checked_mul(count / gcd(multiple, count))
    })?;
    format!("{multiple}e{unit}").parse().ok()
}

fn gcd(a: u128, b: u128) -> u128 {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::common_multiple;

    #[test]
    fn steps_meet_at_their_common_multiple() {
        assert_eq!(common_multiple(&[1e-3, 5e-4, 1e-4, 5e-6]), Some(1e-3));
        assert_eq!(common_multiple(&[2e-5, 5e-5]), Some(1e-4));
        assert_eq!(common_multiple(&[1.5, 1e-1]), Some(1.5));
        assert_eq!(common_multiple(&[0.3, 0.2, 7.0]), Some(21.0));
        assert_eq!(common_multiple(&[1e300, 1e-300]), None);
    }
}
