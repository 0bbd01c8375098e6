//! Nodes of sliders, and their dry friction in the steps.

use super::ground::BuildContext;
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::partition::Partition;
use crate::scene::{Region, ordinal};
use crate::scheme;
use crate::simulation::DeflectionDof;
use crate::simulation::regions::nodes_in;

/// Slider of the scene at a deflection that this process owns.
#[derive(Clone, Copy)]
pub(super) struct SliderDof {
    /// Number of the slider in the scene.
    pub number: usize,
    pub dof: usize,
}

/// Returns the sliders at the nodes of this process, given the dofs opposite to each obstacle.
/// Collective.
///
/// # Errors
/// Returns [`Error::Scene`] for a node that a support holds or another slider or obstacle faces.
pub(super) fn find<P: Partition>(
    ground: &BuildContext<P>,
    opposite: &[Vec<usize>],
) -> Result<Vec<SliderDof>> {
    let mut sliders: Vec<SliderDof> = Vec::new();
    for (number, slider) in ground.scene.sliders.iter().enumerate() {
        let key = format!("slider.{number}");
        let nodes = nodes_in(&Region::At(slider.at), ground.mesh, ground.partition, &key)?;
        let dofs: Vec<usize> = nodes.iter().filter_map(|&node| ground.space.deflection(node)).collect();
        let is_free = ground.comm().all_reduce_any(!dofs.is_empty());
        let dof = dofs.into_iter().find_map(|dof| ground.partition.own_dof(dof));
        let obstacle = dof.and_then(|dof| opposite.iter().position(|dofs| dofs.contains(&dof)));
        let other = dof.and_then(|dof| sliders.iter().find(|other| other.dof == dof));
        let wrong = if !is_free {
            Err("a support holds its node; expected another place".to_owned())
        } else if let Some(obstacle) = obstacle {
            let name = ground.scene.obstacles.get(obstacle).and_then(|obstacle| obstacle.name.as_deref());
            let obstacle = ordinal("obstacle", obstacle, name);
            Err(format!("{obstacle} faces its node; expected another place, or `where` beside the obstacle"))
        } else if let Some(other) = other {
            let name = ground.scene.sliders[other.number].name.as_deref();
            let other = ordinal("slider", other.number, name);
            Err(format!("{other} is at its node; expected a node to itself"))
        } else {
            Ok(())
        };
        ground.comm().all_ok(wrong.map_err(|wrong| Error::Scene(format!("{key}.at: {wrong}"))))?;
        sliders.extend(dof.map(|dof| SliderDof { number, dof }));
    }
    Ok(sliders)
}

/// Returns the sliders with their bounds; `None` where the scene has none.
pub(super) fn bounded<P: Partition>(
    ground: &BuildContext<P>,
    sliders: &[SliderDof],
    bounded: &[DeflectionDof],
) -> Option<Vec<scheme::BoundSlider>> {
    let given = &ground.scene.sliders;
    let slider = |&SliderDof { number, dof }: &SliderDof| {
        let bound = bounded.binary_search_by_key(&dof, |site| site.dof).ok()?;
        Some(scheme::BoundSlider { number, bound, stiffness: given[number].law().stiffness })
    };
    (!given.is_empty()).then(|| sliders.iter().filter_map(slider).collect())
}
