//! Damping of the plate.

use super::ground::BuildContext;
use crate::error::Result;
use crate::linalg::{Engine, Form};
use crate::modes;
use crate::partition::Partition;
use crate::scene::Scene;
use crate::scheme::{Damping, ModalDamping, System};

/// Returns the coefficients of Rayleigh damping.
pub(super) fn rayleigh(scene: &Scene) -> Damping {
    let given = scene.damping.as_ref();
    given.map_or(Damping::default(), |given| Damping { mass: given.mass, stiffness: given.stiffness })
}

/// Returns the damping of single modes, `None` where the scene has none; `mechanism` tells whether
/// the plate can move rigidly. Collective.
///
/// # Errors
/// Returns the errors of [`modes::shapes`].
pub(super) fn modal<E: Engine, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    mechanism: bool,
) -> Result<Option<ModalDamping>> {
    let damping = ground.scene.damping.as_ref().map(|damping| &damping.modal);
    let Some(given) = damping.filter(|ratios| !ratios.is_none()) else { return Ok(None) };
    let System { engine, stiffness, mass, .. } = system;
    if let Form::Modal { modes, .. } = mass {
        let elastic = modes.squares.iter().filter(|square| **square > 0.0);
        let ratios = given.of_modes(modes.count());
        let rates = elastic.zip(ratios).map(|(square, ratio)| 2.0 * ratio * square.sqrt());
        return Ok(Some(ModalDamping::of_rates(rates.collect())));
    }
    let ratios = given.of_modes(0);
    // Rigid motions come first and do not count.
    let bodies = ground.bodies();
    let is_loose = mechanism || bodies > 0;
    let rigid = if is_loose { 3 + bodies } else { 0 };
    let mut modes = modes::shapes(engine, [stiffness, mass], ratios.len() + rigid, is_loose)?;
    modes.retain(|mode| mode.frequency > 0.0);
    ModalDamping::new(engine, mass, &modes, &ratios).map(Some)
}
