//! What runs are measured against: the motion of the semi-discrete problem on a mesh.
//!
//! With the singular mass that motion is unique, and every scheme with any restitution tends to it. With the consistent mass it
//! depends on the restitution law, so that each method has a limit of its own.

use super::plan::{Case, Method};
use super::trajectory::{Distance, Trajectory};
use super::{Runner, natively};
use crate::error::Result;
use crate::scene::{EngineName, Grid, Mass, Massless, Scene, Scheme, ViName};
use crate::scheme::{Exact, ExactOptions};
use crate::simulation::{self, Model, Outcome};
use std::fmt;

/// Cells up to which the exact scheme is tried: each active set costs their number cubed.
const EXACT_CELLS: usize = 320;

/// First interval of the event search of a truth, in periods of the fastest mode over 2 pi: another than the scheme's own.
const FINE_STRIDE: f64 = 1.5;

/// Which semi-discrete motion: that of the singular mass, or the limit of a scheme with the consistent one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Family {
    /// The one motion of the singular mass.
    Singular,
    /// The limit of a scheme with the consistent mass.
    Consistent(Scheme),
}

impl Family {
    /// The motion that a method tends to.
    pub fn of(method: &Method) -> Family {
        match method.mass {
            Mass::Singular => Family::Singular,
            Mass::Consistent => Family::Consistent(method.scheme),
        }
    }

    /// The methods that compute it on a mesh of so many cells: those to try first, in turn, and the one that is left.
    pub(super) fn methods(self, cells: usize) -> (Vec<Method>, Method) {
        let native =
            |scheme, mass| Method { scheme, mass, engine: EngineName::Native, vi: ViName::Condensed };
        let midpoint = |massless| native(Scheme::Midpoint { massless }, Mass::Singular);
        match self {
            Family::Singular => {
                let exact = (cells <= EXACT_CELLS).then(|| native(Scheme::Exact, Mass::Singular));
                let first = exact.into_iter().chain([midpoint(Massless::Equilibrium)]).collect();
                (first, midpoint(Massless::Reflected))
            }
            Family::Consistent(scheme) => (vec![], native(scheme, Mass::Consistent)),
        }
    }
}

/// Cells of a mesh.
pub(super) fn cells(base: &Scene, grid: Grid) -> Result<usize> {
    let scene = Scene { mesh: grid, ..base.clone() };
    Ok(simulation::mesh(&scene)?.cells.len())
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Family::Singular => f.write_str("singular"),
            Family::Consistent(scheme) => {
                let (engine, vi) = (EngineName::Native, ViName::Condensed);
                Method { scheme: *scheme, mass: Mass::Consistent, engine, vi }.fmt(f)
            }
        }
    }
}

/// A motion of the semi-discrete problem on a mesh.
pub struct Truth {
    /// The mesh.
    pub grid: Grid,
    /// Which motion.
    pub family: Family,
    /// How it was computed.
    pub source: String,
    /// What was to compute it before, and why it did not.
    pub refused: Vec<String>,
    /// Its own error, estimated: at the probes in m.
    pub error: Distance,
    /// It, at the instants of comparison.
    pub trajectory: Trajectory,
    /// When its impacts begin, in s.
    pub impacts: Vec<f64>,
    /// The first touch, located between steps, in s.
    pub first_impact: Option<f64>,
}

impl Truth {
    /// Computes a motion: exactly where that serves, else with a step.
    ///
    /// Its own error is estimated by computing it again: exactly, with another event search; else with twice the step, whose
    /// difference estimates the error of the first order that impacts leave. Contacts less than `together` seconds apart are one
    /// impact.
    ///
    /// # Errors
    /// What ends the last of the methods that compute it.
    pub fn new(
        base: &Scene,
        grid: Grid,
        family: Family,
        interval: f64,
        step: f64,
        together: f64,
        run: &Runner,
    ) -> Result<Truth> {
        let computed = |method: Method| {
            let exact = method.scheme == Scheme::Exact;
            let scene = |step| Case { grid, method, step }.scene(base, interval);
            let [(fine, outcome), (coarse, _)] = if exact {
                [exactly(&scene(interval), FINE_STRIDE)?, natively(&scene(interval), false)?]
            } else {
                [run(&scene(step), true)?, run(&scene(2.0 * step), false)?]
            };
            let source = if exact { method.to_string() } else { format!("{method}, {step:e} s") };
            Ok((source, fine, outcome, coarse))
        };
        let cells = cells(base, grid)?;
        let (first, last) = family.methods(cells);
        let mut refused = match family {
            Family::Singular if cells > EXACT_CELLS => {
                vec![format!("exact: more than {EXACT_CELLS} cells")]
            }
            _ => vec![],
        };
        let found = first.into_iter().find_map(|method| {
            let computed = computed(method);
            if let Err(error) = &computed {
                refused.push(format!("{method}: {error}"));
            }
            computed.ok()
        });
        let (source, trajectory, outcome, coarse) = match found {
            Some(found) => found,
            None => computed(last)?,
        };
        let impacts = impacts(&outcome.contacts, together);
        let error = Distance::new(&coarse, &trajectory, &impacts, None, &[]);
        Ok(Truth {
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

/// Runs the exact scheme with an event search of its own.
fn exactly(scene: &Scene, stride: f64) -> Result<(Trajectory, Outcome)> {
    let model = Model::new(scene)?;
    let options = ExactOptions { stride, ..ExactOptions::default() };
    let scheme = Exact::with_options(&model.system, scene.time.step, model.start.clone(), options)?;
    Trajectory::of(scene, &model, Box::new(scheme), true)
}

/// When impacts begin: a plate that strikes rattles for a while, which is still the same impact.
fn impacts(contacts: &[[f64; 2]], together: f64) -> Vec<f64> {
    let mut last = f64::NEG_INFINITY;
    let begins = |[begin, end]: &[f64; 2]| {
        let is_new = begin - last > together;
        last = *end;
        is_new.then_some(*begin)
    };
    contacts.iter().filter_map(begins).collect()
}
