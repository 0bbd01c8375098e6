//! Natural frequencies of a scene's model on the native engine, and the time steps that they
//! advise.

use crate::error::Result;
use crate::linalg::Form;
use crate::modes;
use crate::output::text::significant;
use crate::scene::{Attachments, Ball, ContactSolver, EngineName, Mass, PointMass, Scene, SchemeSpec};
use crate::simulation::Model;
use serde::Serialize;
use std::f64::consts::TAU;

/// Number of lowest frequencies that are computed.
const MODES: usize = 6;

/// Relative error of the period of mode [`MODES`] with the advised step in free motion.
const PERIOD_ERROR: f64 = 0.01;

/// Advised step through impacts relative to the first period; see [`advised_step`].
const PART_OF_FIRST_PERIOD: f64 = 2e-4;

/// Steps per fastest period that keep the energy through impacts to 1 %; see [`energy_step`].
const STEPS_PER_PERIOD: f64 = 20.0;

/// Natural frequencies with one of the masses, in Hz.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Frequencies {
    /// Lowest frequencies, ascending; 0 for rigid motions.
    pub lowest: Vec<f64>,
    /// Highest frequency; in a check also that with rigid balls on the plate.
    pub highest: Option<f64>,
}

/// Returns the scene with the native engine and the condensed solver.
pub(super) fn on_native_engine(scene: &Scene) -> Scene {
    let mut scene = scene.clone();
    (scene.solver.engine, scene.solver.vi) = (EngineName::Native, ContactSolver::Condensed);
    scene
}

/// Returns the frequencies with the mass of a scene for the native engine; see
/// [`with_rigid_balls`].
///
/// # Errors
/// Returns the errors of [`frequencies`].
pub(super) fn frequencies_of(scene: &Scene, model: &Model) -> Result<Frequencies> {
    let is_loose = model.mechanism.is_some() || !scene.attachments.balls.is_empty();
    Ok(with_rigid_balls(scene, frequencies(model, &model.system.mass, is_loose)?))
}

/// Raises the highest frequency to that of the plate with each rigid ball as a mass on it, which
/// the ball is while they touch.
pub(super) fn with_rigid_balls(scene: &Scene, mut frequencies: Frequencies) -> Frequencies {
    if scene.has_rigid_ball() && scene.time.mass != Mass::Modal {
        let mut scene = scene.clone();
        let Attachments { balls, masses, .. } = &mut scene.attachments;
        let rigid = balls.extract_if(.., |ball| ball.compliance.is_none());
        masses.extend(rigid.map(|Ball { at, point, mass, .. }| PointMass { at, point, mass }));
        scene.output.probes.clear();
        let pressed = Model::new(&scene).map(|model| model.system);
        let highest =
            pressed.and_then(|system| modes::highest(&system.engine, &system.stiffness, &system.mass)).ok();
        frequencies.highest = frequencies.highest.zip(highest).map(|(free, pressed)| free.max(pressed));
    }
    frequencies
}

/// Returns frequencies. The highest is `None` where a rigid motion has no mass.
///
/// # Errors
/// Returns the errors of [`modes::lowest`].
pub(super) fn frequencies(model: &Model, mass: &Form, mechanism: bool) -> Result<Frequencies> {
    let (engine, stiffness) = (&model.system.engine, &model.system.stiffness);
    let highest = match mass {
        Form::Modal { modes, .. } => modes.squares.last().map(|square| square.sqrt() / TAU),
        _ => modes::highest(engine, stiffness, mass).ok(),
    };
    Ok(Frequencies { lowest: modes::lowest(engine, [stiffness, mass], MODES, mechanism)?, highest })
}

/// Returns the step that keeps the motion within 1 %, in s, rounded down to 1, 2 or 5 times 10^n.
///
/// *Without impacts*, 1 % is the error of the period of the last of the `lowest` modes. The
/// relative error of the period of a mode with angular frequency w is (w dt)^2 / 12 with the
/// midpoint rule (and `conserving`, which equals it in free motion), and (beta / 2 - 1/24) (w dt)^2
/// with Newmark's scheme.
///
/// *With impacts*, 1 % is the error of the deflection up to the second impact, relative to the
/// largest deflection. On the paper's plate (10 x 4 and 20 x 8 cells of both elements,
/// `docs/accuracy.md`) this takes steps of 1e-5 to 5e-5 s with every scheme, although the fastest
/// mode of the finer mesh is much faster. The advised step is 1/5000 of the first period, but no
/// shorter than 1/20 of the fastest period.
pub fn advised_step(scheme: SchemeSpec, frequencies: &Frequencies, impacts: bool) -> Option<f64> {
    let Frequencies { lowest, highest } = frequencies;
    if impacts {
        let first = lowest.iter().find(|f| **f > 0.0)?;
        return Some(round_down((1.0 / (STEPS_PER_PERIOD * (*highest)?)).max(PART_OF_FIRST_PERIOD / first)));
    }
    let last = lowest.last().filter(|f| **f > 0.0)?;
    Some(round_down((PERIOD_ERROR / scheme.period_error()).sqrt() / (TAU * last)))
}

/// Returns the longest step that keeps the energy through impacts within 1 %, in s.
///
/// This holds for Newmark's scheme and the midpoint rule, and is 1/20 of the fastest period,
/// rounded down to 1, 2 or 5 times 10^n. At an impact, the velocity of a contact node changes
/// within the fastest period of the semi-discrete problem. With these steps and the singular mass,
/// Newmark with e = 0 loses 0.5 % in the four impacts of CSMA 2013 and the midpoint scheme 0.1 %,
/// on quadrilaterals and triangles alike, though their fastest frequencies differ by a factor of
/// seven. The fastest frequency grows as h^-3, so that on fine meshes the step is impracticably
/// small. With 1e-5 s, Newmark with e = 0 loses 0.3, 3.3, 6.5 and 7.6 % at the first impact on
/// 10x4, 20x8, 40x16 and 80x32 quadrilaterals. `conserving` keeps the energy at any step.
pub fn energy_step(frequencies: &Frequencies) -> Option<f64> {
    Some(round_down(1.0 / (STEPS_PER_PERIOD * frequencies.highest?)))
}

/// Returns the advised step of a scene, in s; `None` where every step is accurate.
///
/// A rigid ball presses into the compliance of a single node, in whose time it leaves again: what
/// it takes along needs a step as short as that for the [energy](energy_step), where the fastest
/// motion is often that of the ball on a node beside a support. On a block 5 cm thick, on 4x4 and
/// on 6x6 cells, the ball then leaves at the speed of the limit to 0.2 %.
pub(super) fn advised_for(scene: &Scene, frequencies: &Frequencies) -> Option<f64> {
    let scheme = scene.time.scheme;
    if scheme.capabilities().is_event_driven {
        return None;
    }
    let longest = advised_step(scheme, frequencies, scene.has_contact())?;
    Some(if scene.has_rigid_ball() {
        energy_step(frequencies).map_or(longest, |step| step.min(longest))
    } else {
        longest
    })
}

/// Returns the [step for the energy](energy_step) of a scene, in s.
///
/// The result is `None` where every step conserves the energy, and where none does.
pub(super) fn energy_step_for(scene: &Scene, frequencies: &Frequencies) -> Option<f64> {
    let matters = !scene.time.scheme.capabilities().keeps_energy;
    let exists = scene.time.mass.is_singular() && scene.has_contact();
    if matters && exists { energy_step(frequencies) } else { None }
}

/// Rounds a positive number down to 1, 2 or 5 times a power of ten.
fn round_down(value: f64) -> f64 {
    let exponent = value.log10().floor() as i32;
    // Parsing gives the number nearest to the decimal, such as 5e-6.
    let candidate = |digit: u32, exponent: i32| format!("{digit}e{exponent}").parse().unwrap_or(f64::NAN);
    let steps = [(5, exponent), (2, exponent), (1, exponent)].map(|(digit, e)| candidate(digit, e));
    steps.into_iter().find(|step| *step <= value).unwrap_or_else(|| candidate(5, exponent - 1))
}

/// Formats frequencies as `5.9655  37.71  38.444 Hz`.
pub(super) fn list(values: &[f64]) -> String {
    let numbers: Vec<String> = values.iter().map(|value| significant(*value)).collect();
    let why = if values.contains(&0.0) { " (0: a plate or ball that moves freely)" } else { "" };
    format!("{} Hz{why}", numbers.join("  "))
}
