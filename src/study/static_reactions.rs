//! Reactions of the supports in the static start of a scene.

use super::frequencies::on_native_engine;
use crate::error::Result;
use crate::scene::{FieldInput, Load, Mass, Scene, Support};
use crate::simulation::Model;
use serde::Serialize;

/// Reaction of a support at rest.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StaticReaction {
    /// Name of the support; `support_1` and so on for those without a name.
    pub support: String,
    /// Upward force on the plate, in N.
    pub force: f64,
    /// Moments about the axes x and y through the centroid of the support, in N m.
    pub moments: [f64; 2],
}

/// Returns the reactions of all supports to the static pressure or the loads of a start at
/// equilibrium; empty for other starts, and where both a static pressure and a load act.
///
/// # Errors
/// Returns the errors of [`Model::new`].
pub(super) fn static_reactions(scene: &Scene) -> Result<Vec<StaticReaction>> {
    let Some(mut scene) = at_rest(scene) else { return Ok(Vec::new()) };
    for (number, support) in scene.supports.iter_mut().enumerate() {
        support.name.get_or_insert_with(|| format!("support_{}", number + 1));
    }
    let reactions = Model::new(&scene)?.static_reactions()?;
    let largest = |k: usize| {
        reactions.iter().flat_map(|force| &force[k..]).fold(0.0, |m: f64, force| m.max(force.abs()))
    };
    let noise = [0, 1].map(|k| ROUNDING * largest(k));
    let reaction = |(support, [force, x, y]): (&Support, &[f64; 3])| StaticReaction {
        support: support.name.clone().unwrap_or_default(),
        force: rounded(*force, noise[0]),
        moments: [x, y].map(|moment| rounded(*moment, noise[1])),
    };
    Ok(scene.supports.iter().zip(&reactions).map(reaction).collect())
}

/// Share of the largest force and moment below which another one is due to rounding.
const ROUNDING: f64 = 1e-12;

/// Returns a value, and 0 for one that is not larger than the noise.
fn rounded(value: f64, noise: f64) -> f64 {
    if value.abs() <= noise { 0.0 } else { value }
}

/// Returns the scene with the load of its static start in place of all others; `None` without one.
fn at_rest(scene: &Scene) -> Option<Scene> {
    let mut still = on_native_engine(scene);
    still.time.mass = Mass::Consistent;
    still.obstacles.iter_mut().for_each(|obstacle| obstacle.name = None);
    let pressure = scene.initial.static_pressure.clone();
    match (scene.initial.equilibrium, pressure.is_zero()) {
        (true, true) => {}
        (false, false) => {
            still.load = Some(Load::of_pressure(pressure));
            still.initial.static_pressure = FieldInput::new("initial.static_pressure", 0.0);
            still.initial.equilibrium = true;
        }
        _ => return None,
    }
    Some(still)
}
