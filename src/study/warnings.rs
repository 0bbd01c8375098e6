//! Warnings about a scene, one sentence each.
//!
//! `rebond check`, `rebond inspect` and `rebond run` print the same list, and `summary.json` keeps
//! it. [`of_scene`] has the warnings that the scene's text alone causes. Warnings that depend on
//! mesh, loads and formulas go to [`Model::warnings`] while the model is built. Those that depend
//! on the matrices are computed here too, from a model on the native engine.

use super::frequencies::{Frequencies, advised_for, energy_step_for, frequencies_of, on_native_engine};
use super::{in_time, infsup, linearity, modal_figures, points};
use crate::linalg::{Engine, Form};
use crate::output::text::significant;
use crate::scene::{Mass, Scene, Time};
use crate::simulation::Model;

/// Largest number of dofs for which a run computes frequencies and the inf-sup condition.
///
/// This takes well below a second. On finer meshes `rebond check` computes them.
pub const MOST_DOFS: usize = 20_000;

/// Returns the warnings of a model on the native engine.
pub fn warnings(scene: &Scene, model: &Model) -> Vec<String> {
    let is_small = model.system.engine.dofs() <= MOST_DOFS;
    judged_with_matrices(scene, &model.warnings, is_small.then_some((scene, model)))
}

/// Returns the warnings of a model on another engine, with `dofs` dofs on all processes.
///
/// `notes` are those from building the model. The matrices are examined on the native
/// engine, in this process alone; no other process takes part.
pub fn warnings_apart(scene: &Scene, notes: &[String], dofs: usize) -> Vec<String> {
    let native = on_native_engine(scene);
    let model = (dofs <= MOST_DOFS).then(|| Model::new(&native).ok()).flatten();
    judged_with_matrices(scene, notes, model.as_ref().map(|model| (&native, model)))
}

/// Returns the warnings of a run, whose natural frequencies may fail without ending it.
fn judged_with_matrices(scene: &Scene, notes: &[String], native: Option<(&Scene, &Model)>) -> Vec<String> {
    match native.map(|(native, model)| (model, frequencies_of(native, model))) {
        None => judged(scene, notes, None),
        Some((model, Ok(frequencies))) => judged(scene, notes, Some((model, &frequencies))),
        Some((_, Err(error))) => {
            let mut warnings = judged(scene, notes, None);
            let why = match scene.stretches() && scene.prestress().is_some() {
                true => "the forces in the plane buckle the plate".into(),
                false => format!("the natural frequencies failed: {error}"),
            };
            warnings.push(format!("time.step is not judged, because {why}"));
            warnings
        }
    }
}

/// Returns the warnings of the scene, `notes` from building its model, and those of the
/// matrices where a model and its frequencies are given.
pub(super) fn judged(
    scene: &Scene,
    notes: &[String],
    matrices: Option<(&Model, &Frequencies)>,
) -> Vec<String> {
    let mut warnings = notes.to_vec();
    warnings.extend(of_units(scene));
    warnings.extend(of_scene(scene));
    warnings.extend(of_damping(scene));
    warnings.extend(in_time::warnings(scene));
    warnings.extend(points::warnings(scene));
    if let Some((model, frequencies)) = matrices {
        warnings.extend(of_step(scene, frequencies));
        warnings.extend(of_inf_sup(scene, model));
        warnings.extend(linearity::warning(scene, model));
        warnings.extend(modal_figures::warning(model));
    }
    scene.joined(&warnings)
}

/// Range of Young's moduli (Pa), from rubber to diamond, and of densities (kg/m3), from foam to
/// osmium.
const MODULI: [f64; 2] = [1e5, 2e12];
const DENSITIES: [f64; 2] = [5.0, 25e3];

/// Range of speeds of sound `$\sqrt{E / \rho}$` (m/s), from gel to diamond.
const SPEEDS: [f64; 2] = [8.0, 25e3];

/// Warns of numbers that no plate has, which other units explain.
fn of_units(scene: &Scene) -> Vec<String> {
    let plates = scene.parts.iter().enumerate().map(|(number, part)| (format!("part.{number}"), &part.plate));
    let mut warnings = Vec::new();
    let is_in = |value: f64, [low, high]: [f64; 2]| (low..=high).contains(&value);
    let mut judge = |key: String, value: f64, unit: &str, range: [f64; 2], usual: &str| {
        if !is_in(value, range) {
            let value = significant(value);
            warnings.push(format!("{key} = {value} {unit} is the value of no material: {usual}"));
        }
    };
    for (table, plate) in std::iter::once(("plate".to_owned(), &scene.plate.plate)).chain(plates) {
        let (modulus, density) = (plate.youngs_modulus, plate.density);
        let speed = (modulus / density).sqrt();
        match is_in(modulus, MODULI) && is_in(density, DENSITIES) {
            true => judge(
                format!("the speed of sound sqrt({table}.youngs_modulus / {table}.density)"),
                speed,
                "m/s",
                SPEEDS,
                "steel has 210e9 Pa and 7850 kg/m3",
            ),
            false => {
                judge(format!("{table}.youngs_modulus"), modulus, "Pa", MODULI, "steel has 210e9 Pa");
                judge(format!("{table}.density"), density, "kg/m3", DENSITIES, "steel has 7850 kg/m3");
            }
        }
    }
    warnings
}

/// Returns the warning that depends on the scene alone.
fn of_scene(scene: &Scene) -> Option<String> {
    let is_lossy = scene.time.mass == Mass::Consistent && scene.has_contact();
    is_lossy.then(|| {
        let scheme = scene.time.scheme.capabilities();
        if scheme.bounces_with_consistent_mass {
            "with the consistent mass the energy lost at impacts does not vanish with the step: \
             set time.mass = \"singular\""
                .into()
        } else {
            format!(
                "the {} scheme is unstable in contact with the consistent mass at every step: \
                 set time.mass = \"singular\"",
                scheme.name
            )
        }
    })
}

/// Warns of modes that do not vibrate, which another unit of their damping explains.
fn of_damping(scene: &Scene) -> Option<String> {
    let ratios = scene.damping.as_ref()?.modal.of_modes(1);
    let most = ratios.into_iter().fold(0.0, f64::max);
    (most > 1.0).then(|| {
        let most = significant(most);
        format!("damping.modal = {most} is more than critical, so that its mode does not vibrate: 2 % is written 0.02")
    })
}

/// Warns of a step that is too long for the motion, or for the energy.
fn of_step(scene: &Scene, frequencies: &Frequencies) -> Vec<String> {
    let mut warnings = Vec::new();
    let Time { scheme, step, .. } = scene.time;
    let is_longer = |limit: &f64| step > *limit;
    let written = significant(step);
    if let Some(advised) = advised_for(scene, frequencies).filter(is_longer) {
        let what = if scene.has_rigid_ball() {
            "the rebound of a rigid ball"
        } else if scene.has_contact() {
            "the deflection up to the second impact"
        } else {
            "the periods of the first six modes"
        };
        let advised = significant(advised);
        warnings.push(format!(
            "time.step = {written} s is too long to keep {what} to 1 %: {advised} s is advised"
        ));
    }
    let takes_steps = !scheme.capabilities().is_event_driven;
    if scene.has_rigid_ball() && frequencies.highest.is_none() && takes_steps {
        warnings.push(
            "the rebound of a rigid ball depends on time.step, and no step is advised, because the fastest frequency is not \
             known: compare with half of it, or give the ball a stiffness"
                .into(),
        );
    }
    if let (Some(limit), Some(highest)) =
        (energy_step_for(scene, frequencies).filter(is_longer), frequencies.highest)
    {
        let (limit, highest) = (significant(limit), significant(highest));
        // A scene with dashpots or friction may have no such choice.
        let remedy = match scene.dissipates() {
            true => "",
            false => "; time.scheme = \"conserving\" keeps it at any step",
        };
        warnings.push(format!(
            "time.step = {written} s is too long for \"{}\" to keep the energy at impacts to 1 %, which takes {limit} s, because \
             the fastest mode has {highest} Hz{remedy}",
            scheme.name(),
        ));
    }
    warnings
}

/// Warns of a failed inf-sup condition, which matters with obstacles and the singular mass.
fn of_inf_sup(scene: &Scene, model: &Model) -> Option<String> {
    let Form::SingularMassCells(mass) = &model.system.mass else { return None };
    let bounded = &model.system.bounds.dofs;
    let matters = scene.has_contact() && !bounded.is_empty();
    (matters && infsup::fails(model.system.engine.dofs(), mass.rows(), bounded)).then(|| {
        "the inf-sup condition fails: some combination of bounded dofs vanishes for every massless deflection, \
         so that motion and reactions are not unique; refine the mesh or set time.mass = \"consistent\""
            .to_owned()
    })
}
