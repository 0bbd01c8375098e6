//! Stretching: the energy of the mid-plane, in the modes that carry the inertia.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use super::stretched_equilibrium::least_energy;
use crate::error::Result;
use crate::linalg::Form;
use crate::membrane::QuarticForm;
use crate::partition::Partition;
use crate::scheme::System;
use crate::simulation::phase;
use faer::Mat;

/// Returns the energy of stretching in the modes of the mass, with the geometric stiffness of
/// forces that buckle the plate; `None` where the scene has none.
///
/// # Errors
/// Returns the errors of the supports and of the membrane.
pub(super) fn form<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    geometric: Option<&Form>,
) -> Result<Option<QuarticForm>> {
    let space = ground.space;
    let (Some(membrane), Form::Modal { modes, .. }) = (ground.membrane.following(), &system.mass) else {
        return Ok(None);
    };
    phase("stretching");
    let shape = |k: usize| space.shape(modes.shapes.col_as_slice(k));
    let shapes: Vec<Vec<f64>> = (0..modes.count()).map(shape).collect();
    let mut form = membrane.form(&shapes, &modes.squares)?;
    if let Some(geometric) = geometric {
        let mut products = Mat::zeros(modes.shapes.nrows(), modes.count());
        for k in 0..modes.count() {
            let (shape, product) = (modes.shapes.col_as_slice(k), products.col_as_slice_mut(k));
            system.engine.multiply(geometric, shape, product)?;
        }
        form.add_geometric(&(modes.shapes.transpose() * products));
        form.count_from(least_energy(&form, modes, space)?);
    }
    Ok(Some(form))
}
