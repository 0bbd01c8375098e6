//! Reference solutions: motions of the semi-discrete problem on a mesh.
//!
//! With the singular mass this motion is unique, and every scheme converges to it with any
//! restitution. With the consistent mass it depends on the restitution law, so that each method has
//! a limit of its own.

use super::plan::{Case, EXACT_CELLS, EXACT_MODES, Method, mesh_and_space, without_remedy};
use super::trajectory::{Distance, Trajectory};
use super::{Runner, run_native};
use crate::error::Result;
use crate::scene::{Grid, Mass, Massless, Scene, SchemeSpec};
use crate::scheme::{Exact, ExactOptions};
use crate::simulation::{self, Model, Outcome};
use std::fmt;

/// First interval of the event search, in periods of the fastest mode divided by 2 pi.
///
/// The value differs from the scheme's own, so that two solutions estimate the error.
const FINE_STRIDE: f64 = 1.5;

/// Family of methods that share a limit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Family {
    /// Every method with the singular mass.
    Singular,
    /// Every method with the modal mass and this number of modes.
    Modal(usize),
    /// One scheme with the consistent mass.
    Consistent(SchemeSpec),
}

impl Family {
    /// Returns the family of a method.
    pub fn of(method: &Method) -> Family {
        match (method.mass, method.modes) {
            (Mass::Modal, Some(modes)) => Family::Modal(modes),
            (Mass::Singular | Mass::Modal, _) => Family::Singular,
            (Mass::Consistent, _) => Family::Consistent(method.scheme),
        }
    }

    /// Returns the mass of the methods.
    pub fn mass(self) -> Mass {
        match self {
            Family::Singular => Mass::Singular,
            Family::Modal(_) => Mass::Modal,
            Family::Consistent(_) => Mass::Consistent,
        }
    }

    /// Returns the methods that compute the limit on a mesh with so many cells.
    ///
    /// The first ones are tried in turn; the last one remains if they fail.
    pub(super) fn methods(self, cells: usize) -> (Vec<Method>, Method) {
        let native = |scheme, mass| Method::native(scheme, mass, None);
        let midpoint = |massless| native(SchemeSpec::Midpoint { massless }, Mass::Singular);
        match self {
            Family::Singular => {
                let exact = (cells <= EXACT_CELLS).then(|| native(SchemeSpec::Exact, Mass::Singular));
                let first = exact.into_iter().chain([midpoint(Massless::Equilibrium)]).collect();
                (first, midpoint(Massless::Reflected))
            }
            Family::Modal(modes) => {
                let modal = |scheme| Method::native(scheme, Mass::Modal, Some(modes));
                let exact = (modes <= EXACT_MODES).then(|| modal(SchemeSpec::Exact));
                (exact.into_iter().collect(), modal(SchemeSpec::Conserving))
            }
            Family::Consistent(scheme) => (vec![], native(scheme, Mass::Consistent)),
        }
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Family::Singular => f.write_str("singular"),
            Family::Modal(modes) => write!(f, "modal m={modes}"),
            Family::Consistent(scheme) => Method::native(*scheme, Mass::Consistent, None).fmt(f),
        }
    }
}

/// Specification of a [`ReferenceSolution`].
#[derive(Debug, Clone, Copy)]
pub struct ReferenceSpec {
    /// Mesh.
    pub grid: Grid,
    /// Family of methods with the limit.
    pub family: Family,
    /// Time between two instants of comparison, in s.
    pub interval: f64,
    /// Time step of the methods that need one, in s.
    pub step: f64,
    /// Time between contacts, in s, below which they belong to one impact.
    pub together: f64,
    /// Whether the motion's own error is estimated, by a second computation.
    pub is_limit: bool,
    /// Whether the displacements are kept.
    pub keep_fields: bool,
}

/// Reference solution: a motion of the semi-discrete problem on a mesh.
pub struct ReferenceSolution {
    /// Mesh.
    pub grid: Grid,
    /// Family of methods with this limit.
    pub family: Family,
    /// Method by which the motion was computed.
    pub source: String,
    /// Methods that were tried before, and why they failed.
    pub refused: Vec<String>,
    /// Estimate of the motion's own error, at the probes in m.
    pub error: Distance,
    /// Motion at the instants of comparison.
    pub trajectory: Trajectory,
    /// Starts and ends of the impacts, in s.
    pub impacts: Vec<[f64; 2]>,
    /// Time of the first contact, located between steps, in s.
    pub first_impact: Option<f64>,
}

impl ReferenceSolution {
    /// Computes the motion, exactly where possible, otherwise with a time step.
    ///
    /// A second computation estimates the error: exact with another event search, or with twice the
    /// step. The latter difference estimates the first-order error that impacts cause.
    ///
    /// # Errors
    /// Returns the error of the last method that was tried.
    pub fn new(base: &Scene, spec: ReferenceSpec, run: &Runner) -> Result<ReferenceSolution> {
        let ReferenceSpec { grid, family, interval, step, together, is_limit, keep_fields } = spec;
        let computed = |method: Method| -> Result<_> {
            let exact = method.scheme == SchemeSpec::Exact;
            let scene = |step| Case { grid, method, step }.scene(base, interval);
            let (fine, outcome) = if exact {
                exactly(&scene(interval), FINE_STRIDE, keep_fields)?
            } else {
                run(&scene(step), keep_fields)?
            };
            let coarse = match (is_limit, exact) {
                (false, _) => Trajectory::default(),
                (true, true) => run_native(&scene(interval), false)?.0,
                (true, false) => run(&scene(2.0 * step), false)?.0,
            };
            let source = if exact { method.to_string() } else { format!("{method}, {step:e} s") };
            Ok((source, fine, outcome, coarse))
        };
        let cells = mesh_and_space(base, grid)?.0.cells.len();
        let (mut first, last) = family.methods(cells);
        first.retain(|method| base.is_friction_taken(method.scheme, method.mass));
        let mut refused = match family {
            Family::Singular if cells > EXACT_CELLS => {
                vec![format!("exact: more than {EXACT_CELLS} cells")]
            }
            Family::Modal(modes) if modes > EXACT_MODES => {
                vec![format!("exact: more than {EXACT_MODES} modes")]
            }
            _ => vec![],
        };
        let exact = first.into_iter().find_map(|method| {
            let computed = computed(method);
            if let Err(error) = &computed {
                refused.push(format!("{method}: {}", without_remedy(&error.to_string())));
            }
            computed.ok()
        });
        let (source, trajectory, outcome, coarse) = match exact {
            Some(exact) => exact,
            None => computed(last)?,
        };
        let impacts = impacts(&outcome.contacts, together);
        let error = Distance::new(&coarse, &trajectory, &starts(&impacts), None, &[]);
        Ok(ReferenceSolution {
            grid,
            family,
            source,
            refused,
            error,
            trajectory,
            impacts,
            first_impact: outcome.first_impact.map(|impact| impact.time),
        })
    }
}

/// Runs the exact scheme with the given interval of its event search.
fn exactly(scene: &Scene, stride: f64, keep_fields: bool) -> Result<(Trajectory, Outcome)> {
    let model = Model::new(scene)?;
    let options = ExactOptions { stride, ..ExactOptions::default() };
    let mut scheme = Exact::with_options(&model.system, scene.time.step, model.start.clone(), options)?;
    Trajectory::record(scene, keep_fields, |trajectory| {
        simulation::run_scheme(scene, &model, &mut scheme, 0.0, trajectory)
    })
}

/// Returns the starts and ends of impacts: repeated contacts at short intervals belong to one
/// impact.
fn impacts(contacts: &[[f64; 2]], together: f64) -> Vec<[f64; 2]> {
    let mut impacts: Vec<[f64; 2]> = Vec::new();
    for &[begin, end] in contacts {
        match impacts.last_mut() {
            Some(last) if begin - last[1] <= together => last[1] = end,
            _ => impacts.push([begin, end]),
        }
    }
    impacts
}

/// Returns the starts of impacts.
pub(super) fn starts(impacts: &[[f64; 2]]) -> Vec<f64> {
    impacts.iter().map(|[start, _]| *start).collect()
}
