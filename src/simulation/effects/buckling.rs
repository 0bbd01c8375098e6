//! Stability of a plate under the forces in its plane.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::registry::presses;
use crate::error::{Error, Result};
use crate::linalg::Form;
use crate::modes::buckling::{self, Buckling};
use crate::partition::Partition;
use crate::scene::InPlane;

/// Returns the forms of K without the forces in the plane, and of their geometric stiffness.
fn forms<E: OfCells, P: Partition>(ground: &BuildContext<P>, engine: &E) -> [Form; 2] {
    ground.without_prestress().map(|blocks| engine.native().form(blocks))
}

/// Returns whether the forces in the plane exceed the buckling load of a plate that stretches.
/// Collective.
///
/// # Errors
/// Returns [`Error::Scene`] with the buckling load where they exceed the one of a plate that only
/// bends, and the errors of the engine.
pub(super) fn is_buckled<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    engine: &E,
    mechanism: Option<&str>,
) -> Result<bool> {
    if !presses(ground)? {
        return Ok(false);
    }
    let key = ground.scene.prestress().map_or("", InPlane::key);
    if let Some(motion) = mechanism {
        return Err(Error::Scene(format!(
            "{key}: forces press a plate that the supports leave a mechanism: {motion}; expected supports that hold it"
        )));
    }
    let [stiffness, geometric] = forms(ground, engine);
    let bears = buckling::bears(engine, [&stiffness, &geometric])?;
    if bears || ground.scene.stretches() {
        return Ok(!bears);
    }
    let factor = buckling::lowest(engine, [&stiffness, &geometric])?.map_or(0.0, |load| load.factor);
    Err(Error::Scene(format!(
        "{key}: the plate buckles at {factor:.4} times these forces; expected less pressure, or \
         in_plane.stretching = true"
    )))
}

/// Returns the buckling load of the forces in the plane; `None` without any, or where none buckles
/// the plate. Collective.
///
/// # Errors
/// Returns the errors of [`buckling::lowest`].
pub(in crate::simulation) fn load<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    engine: &E,
) -> Result<Option<Buckling>> {
    if !ground.membrane.is_any() {
        return Ok(None);
    }
    let [stiffness, geometric] = forms(ground, engine);
    buckling::lowest(engine, [&stiffness, &geometric])
}
