//! Table `[study]`: the runs that `rebond study` compares.

use super::{ContactSolver, ElementKind, EngineName, Grid, Mass, SchemeName, Solver, Time};
use crate::modes::ModeRange;
use serde::{Deserialize, Serialize};

/// Approximate number of instants at which runs are compared.
const INSTANTS: f64 = 1000.0;

/// Least number of instants for a comparison.
const FEWEST_INSTANTS: f64 = 20.0;

/// Number of modes of the modal mass where neither the study nor the scene says it.
const MODES: usize = 200;

/// Study: every valid combination of these lists is a run.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Study {
    /// Time schemes.
    pub schemes: Vec<SchemeName>,
    /// Mass matrices.
    pub masses: Vec<Mass>,
    /// Numbers of modes that carry the inertia, for the modal mass.
    pub modes: Vec<usize>,
    /// Restitution coefficients, for schemes that have one.
    pub restitutions: Vec<f64>,
    /// Time steps, s, for schemes that have one.
    pub steps: Vec<f64>,
    /// Finite elements.
    pub elements: Vec<ElementKind>,
    /// Numbers of rectangles along x and y.
    pub cells: Vec<[usize; 2]>,
    /// Numbers of uniform refinements of each mesh.
    pub refinements: Vec<u32>,
    /// Linear algebra engines.
    pub engines: Vec<EngineName>,
    /// Contact solvers.
    pub vi: Vec<ContactSolver>,
    /// Rectangles of the mesh that measures the error in space; zeros where a file gives the mesh.
    pub reference_cells: [usize; 2],
    /// Uniform refinements of the file's mesh that measures the error in space; 0 for a rectangle.
    pub reference_refine: u32,
    /// Mass of the motion on the reference mesh: singular or modal.
    pub reference_mass: Mass,
    /// Number of modes of that motion, if its mass is modal.
    pub reference_modes: usize,
    /// Whether errors in time and in space are told apart, which needs a limit of each method on
    /// each mesh; otherwise only the whole error of a run is measured.
    pub limits: bool,
    /// Whether the distance between the best runs of different masses on the finest mesh is
    /// measured.
    pub floor: bool,
    /// Words of runs that are left out, separated by spaces.
    pub skip: Vec<String>,
    /// Instants at which errors of the whole deflection are reported, in s.
    pub at: Vec<f64>,
    /// Horizon up to which runs are ranked.
    pub until: Horizon,
    /// Number of timed repetitions of each run.
    pub repeat: u32,
}

/// Part of a run that determines its rank.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Horizon {
    /// Free motion up to the first impact.
    FirstImpact,
    /// Motion up to the second impact, which includes the effect of the first.
    SecondImpact,
    /// Whole run.
    #[default]
    End,
}

impl Study {
    /// Creates the default study: all schemes and masses on the scene's mesh, with five steps.
    ///
    /// These are the scene's own step and four coarser ones.
    pub(super) fn of(mesh: &Grid, time: &Time, solver: &Solver) -> Study {
        let fits = |step: &f64| FEWEST_INSTANTS * step <= time.end;
        let mut steps: Vec<f64> =
            [16.0, 8.0, 4.0, 2.0, 1.0].iter().map(|times| times * time.step).filter(fits).collect();
        if steps.is_empty() {
            steps.push(time.step);
        }
        let modes = match time.modes {
            Some(ModeRange::Count(count)) => count,
            _ => MODES,
        };
        Study {
            schemes: SchemeName::ALL.to_vec(),
            masses: vec![Mass::Singular, Mass::Consistent],
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
pub(super) fn finer(cells: &[[usize; 2]], refinements: &[u32]) -> [usize; 2] {
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
