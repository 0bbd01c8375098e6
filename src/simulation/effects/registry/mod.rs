//! Registry of the effects, and the build context with the contributions of all of them.

mod balls;
mod dashpots;
mod elastic_edges;
mod foundations;
mod loads;
mod masses;
mod prestress;
mod ribs;
mod springs;
mod stop_springs;

pub(super) use prestress::presses;

use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint};
use crate::error::Result;
use crate::mesh::Mesh;
use crate::partition::Partition;
use crate::scene::Scene;
use crate::simulation::effects::contributions::Contributions;
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::membrane_forces::MembraneForces;
use crate::simulation::phase;
use crate::simulation::plate_assembly::PlateAssembly;
use crate::simulation::stops::Stop;
use std::rc::Rc;

/// Function that adds the contributions of an effect; nothing where the scene does not have it.
/// Collective.
type Effect<P> = fn(&BuildContext<P>, &mut Contributions) -> Result<()>;

/// Returns all effects in the order of their contributions. A further effect takes a file in this
/// folder, its name and row here, and its page in `docs/scenes.md`.
fn effects<P: Partition>() -> Vec<Effect<P>> {
    vec![
        foundations::add,
        prestress::add,
        elastic_edges::add,
        ribs::add,
        springs::add,
        dashpots::add,
        masses::add,
        stop_springs::add,
        balls::add,
        loads::add,
    ]
}

impl<'g, P: Partition> BuildContext<'g, P> {
    /// Collects the cells, and the contributions of all effects. The fields describe `gaps` and
    /// `stops`. Collective.
    ///
    /// # Errors
    /// Returns the errors of the scene's formulas and regions on the mesh.
    pub fn new(
        (scene, mesh): (&'g Scene, &'g Mesh),
        partition: &'g P,
        holds: &'g [NodeConstraint],
        space: &'g DofMap,
        gaps: &'g [Option<usize>],
        stops: &'g [Stop],
    ) -> Result<BuildContext<'g, P>> {
        phase("matrices");
        let comm = partition.comm();
        let bare = comm.all_ok(assembly::cells(mesh, space, &PlateAssembly::new(scene, mesh, comm)?))?;
        let (cells, terms) = (bare.clone(), Contributions::default());
        let membrane = Rc::new(MembraneForces::new(scene, mesh, partition)?);
        let mut ground =
            BuildContext { scene, partition, mesh, holds, space, gaps, stops, membrane, cells, terms };
        let mut terms = Contributions::default();
        effects().into_iter().try_for_each(|add| add(&ground, &mut terms))?;
        ground.terms = terms;
        let mut carried = ground.terms.carried.iter();
        let add = |&(cell, point, mass)| assembly::add_point_mass(mesh, &mut ground.cells, cell, point, mass);
        comm.all_ok(carried.try_for_each(add))?;
        assembly::average_carried(&mut ground.cells, &bare);
        Ok(ground)
    }
}
