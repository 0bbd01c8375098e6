//! Figures of the modal mass: how fast the kept modes move in contact, and what the rest bears.

use super::frequencies::list;
use crate::error::Result;
use crate::linalg::eigen::symmetric_eigen;
use crate::linalg::vectors::axpy;
use crate::linalg::{Engine, Form};
use crate::membrane::Stretch;
use crate::output::text::{Report, engineering, short, significant};
use crate::scene::Scene;
use crate::scheme::{ContactCompliance, ModalScheme, Scheme, Solution, StepRecord};
use crate::simulation::Model;
use serde::Serialize;
use std::collections::BTreeSet;
use std::f64::consts::TAU;

/// Share of the energy at the start outside the modes from which a warning tells it.
const OUTSIDE: f64 = 0.05;

/// Step of the motion that finds the nodes in contact, in periods of the highest mode, and the
/// largest number of these steps.
const STEP: f64 = 0.1;
const MOST_STEPS: f64 = 50_000.0;

/// Largest number of nodes whose compliance is computed.
const MOST_NODES: usize = 500;

/// Number of frequencies that a report lists.
const LISTED: usize = 6;

/// Figures of the modal mass.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ModalFigures {
    /// Number of modes that carry the inertia, rigid motions included.
    pub modes: usize,
    /// Highest frequency of these modes, in Hz.
    pub highest: f64,
    /// Number of bounded dofs that come into contact with the conserving scheme during the first
    /// period of the scene's motion, or until its end.
    pub touching: usize,
    /// Figures of the contact; `None` where nothing touches.
    pub contact: Option<ContactFigures>,
    /// Frequencies of small vibrations about the equilibrium at the start of a plate that
    /// stretches, in Hz; `None` without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub about_start: Option<Vec<f64>>,
    /// Share of the massless rest in the elastic energy of the start; `None` without any.
    pub rest_of_start: Option<f64>,
    /// Share of the massless rest in the elastic energy under `[load]`; `None` without load and for
    /// a mechanism.
    pub rest_under_load: Option<f64>,
}

/// Figures of the contact at all bounded dofs that touch.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ContactFigures {
    /// Highest frequency of the modes while all these dofs are in contact, in Hz: the root of the
    /// largest eigenvalue of `$\Omega^2 + A^T R^{-1} A$`.
    pub fastest: f64,
    /// Smallest and largest eigenvalue of the compliance R of the rest, in m/N.
    pub compliance: [f64; 2],
    /// Condition number of R.
    pub condition: f64,
}

/// Determines the figures of a model with the modal mass, and adds warnings; `None` for another
/// mass.
///
/// `loaded` is the displacement under the constant load.
pub(super) fn figures(
    scene: &Scene,
    model: &Model,
    loaded: Option<&[f64]>,
    warnings: &mut Vec<String>,
) -> Result<Option<ModalFigures>> {
    let Form::Modal { modes, .. } = &model.system.mass else { return Ok(None) };
    let (touching, mut doubt) = match touching(scene, model) {
        Ok(touching) => (touching, None),
        Err(why) => (model.system.bounds.dofs.to_vec(), Some(why.to_string())),
    };
    let mut contact = None;
    if (1..=MOST_NODES).contains(&touching.len()) {
        let compliance = ContactCompliance::new(&model.system, &touching)?;
        if compliance.is_definite() {
            let [least, most] = compliance.extremes()?;
            let fastest = compliance.fastest()?;
            contact = Some(ContactFigures { fastest, compliance: [least, most], condition: most / least });
        } else if model.system.bounds.laws.are_rigid() {
            // Stops that yield need no compliance of the plate.
            doubt = Some(compliance.refusal().to_string());
        }
    }
    warnings.extend(doubt);
    Ok(Some(ModalFigures {
        modes: modes.count(),
        highest: modes.squares.last().map_or(0.0, |square| square.sqrt() / TAU),
        touching: touching.len(),
        contact,
        about_start: about_start(scene, model)?,
        rest_of_start: rest_share(model, &model.start.displacement)?,
        rest_under_load: loaded.map_or(Ok(None), |u| rest_share(model, u))?,
    }))
}

/// Returns a warning where too much of the energy at the start lies outside the modes.
pub(super) fn warning(model: &Model) -> Option<String> {
    let Form::Modal { modes, .. } = &model.system.mass else { return None };
    let share = rest_share(model, &model.start.displacement).ok()??;
    let (percent, modes) = (short(100.0 * share), modes.count());
    (share > OUTSIDE).then(|| {
        format!(
            "time.modes: {percent} % of the energy at the start lie outside the {modes} modes, and follow without inertia: take \
             more modes"
        )
    })
}

/// Returns the frequencies of small vibrations about the equilibrium of a plate that stretches, in
/// Hz; `None` without an equilibrium at the start.
fn about_start(scene: &Scene, model: &Model) -> Result<Option<Vec<f64>>> {
    let system = &model.system;
    let (Some(form), Form::Modal { modes, .. }) = (&system.drive.stretching, &system.mass) else {
        return Ok(None);
    };
    if !scene.initial.is_static() {
        return Ok(None);
    }
    let mut stretch = Stretch::default();
    form.evaluate(&system.projected(&model.start.displacement)?, &mut stretch);
    let mut tangent = form.hessian(&stretch);
    modes.squares.iter().enumerate().for_each(|(k, square)| tangent[(k, k)] += square);
    let (values, _) = symmetric_eigen(tangent.as_ref())?;
    Ok(Some(values.into_iter().map(|value| value.max(0.0).sqrt() / TAU).collect()))
}

/// Returns the bounded dofs that come into contact during the first period.
fn touching(scene: &Scene, model: &Model) -> Result<Vec<usize>> {
    let Model { system, start, .. } = model;
    let Form::Modal { modes, .. } = &system.mass else { return Ok(Vec::new()) };
    let periods = |square: &f64| TAU / square.sqrt();
    let first = modes.squares.iter().find(|square| **square > 0.0).map_or(0.0, periods);
    let step = STEP * modes.squares.last().map_or(0.0, periods);
    if system.bounds.is_empty() || !(step > 0.0 && step.is_finite()) {
        return Ok(Vec::new());
    }
    let steps = (first.min(scene.time.end) / step).ceil().min(MOST_STEPS) as u64;
    let mut scheme = ModalScheme::conserving(system, step, start.clone())?;
    let mut touching = BTreeSet::new();
    let add = |touching: &mut BTreeSet<usize>, record: &StepRecord| {
        let touches = record.candidates().filter(|&bound| record.reaction[bound] != 0.0);
        touching.extend(touches.map(|bound| system.bounds.dofs[bound]));
    };
    add(&mut touching, scheme.record());
    for _ in 0..steps {
        scheme.advance()?;
        add(&mut touching, scheme.record());
    }
    Ok(touching.into_iter().collect())
}

/// Returns the share of the massless rest in the elastic energy of a displacement (m); `None` where
/// there is no energy.
fn rest_share(model: &Model, u: &[f64]) -> Result<Option<f64>> {
    let system = &model.system;
    let (engine, Form::Modal { modes, .. }) = (&system.engine, &system.mass) else { return Ok(None) };
    let mut rest = u.to_vec();
    for (k, q) in system.projected(u)?.iter().enumerate() {
        axpy(-q, modes.shapes.col_as_slice(k), &mut rest);
    }
    let mut force = vec![0.0; u.len()];
    let whole = engine.multiply(&system.stiffness, u, &mut force)?;
    let of_rest = engine.multiply(&system.stiffness, &rest, &mut force)?;
    Ok((whole > 0.0).then(|| of_rest / whole))
}

impl ModalFigures {
    /// Adds rows to a report.
    pub(super) fn report(&self, report: &mut Report) {
        report.text("modes", format!("{}, up to {}", self.modes, engineering(self.highest, "Hz")));
        if let Some(frequencies) = &self.about_start {
            let lowest = &frequencies[..frequencies.len().min(LISTED)];
            report.text("  about the start", format!("{} Hz", list(lowest)));
        }
        if let Some(ContactFigures { fastest, compliance: [least, most], condition }) = &self.contact {
            report.text(
                "  in contact",
                format!(
                    "{} {}, the fastest motion has {}",
                    self.touching,
                    if self.touching == 1 { "dof touches" } else { "dofs touch" },
                    engineering(*fastest, "Hz")
                ),
            );
            let [least, most] = [least, most].map(|value| engineering(*value, "m/N"));
            let condition = significant(*condition);
            report.text("  compliance of the rest", format!("{least} to {most}, condition {condition}"));
        }
        let outside = |share: Option<f64>, when: &str| Some(format!("{} % {when}", short(100.0 * share?)));
        let outside: Vec<String> = outside(self.rest_of_start, "at the start")
            .into_iter()
            .chain(outside(self.rest_under_load, "under load"))
            .collect();
        if !outside.is_empty() {
            report.text("  energy outside them", outside.join(", "));
        }
    }
}
