//! Support motions and their effects in the moving frame.

use super::ground::BuildContext;
use super::of_cells::OfCells;
use crate::communicator::Communicator;
use crate::dof_map::{PER_NODE, Place, Support};
use crate::error::{Error, Result};
use crate::linalg::vectors::{add, scale, sum};
use crate::mesh::Point;
use crate::obstacle::Bounds;
use crate::partition::Partition;
use crate::scene::FieldInput;
use crate::scheme::{SupportMotion, System};
use crate::simulation::DeflectionDof;
use crate::simulation::regions::supports;
use std::rc::Rc;

/// Support motion, with the deflection and slopes that a motion of 1 m causes at each node (three
/// values per node of this process).
#[derive(Debug, Clone)]
pub(in crate::simulation) struct Lift {
    pub motion: Rc<FieldInput>,
    pub shape: Vec<f64>,
    /// Whether the plate moves rigidly; otherwise its shape is in equilibrium.
    pub(super) is_rigid: bool,
}

/// Returns each support motion with its lift. Collective.
pub(super) fn lifts<E: OfCells, P: Partition>(
    ground: &BuildContext<P>,
    system: &System<E>,
    mechanism: Option<&str>,
) -> Result<Vec<Lift>> {
    let BuildContext { scene, mesh, partition, .. } = *ground;
    let comm = partition.comm();
    // Guided edges follow the plate and do not drive it.
    let motions: Vec<Option<&FieldInput>> =
        scene.supports.iter().map(|support| support.motion.as_ref()).collect();
    let holding = || scene.supports.iter().filter(|support| support.kind.holds_deflection());
    let mut different: Vec<&FieldInput> = Vec::new();
    for motion in motions.iter().flatten() {
        if !different.iter().any(|other| same(Some(other), Some(motion))) {
            different.push(motion);
        }
    }
    if different.is_empty() {
        return Ok(Vec::new());
    }
    if let ([motion], true) = (&different[..], holding().all(|support| support.motion.is_some())) {
        let shape = [1.0, 0.0, 0.0].repeat(mesh.nodes.len());
        return Ok(vec![Lift { motion: Rc::new((*motion).clone()), shape, is_rigid: true }]);
    }
    if let Some(loose) = mechanism {
        return Err(Error::Singular(format!(
            "{}: supports that move differently must hold the plate, and it is a mechanism: {loose}",
            different[0].key
        )));
    }
    let places = supports(scene, mesh, comm)?;
    // Nodes on all processes that supports of one motion hold; for `None`, supports at rest.
    // Collective.
    let nodes_of = |motion: Option<&FieldInput>| {
        let mut nodes = vec![0.0; mesh.nodes.len()];
        let has_motion = |((_, kind), other): &(&(Place, Support), &Option<&FieldInput>)| {
            kind.holds_deflection() && same(**other, motion)
        };
        for ((place, _), _) in places.iter().zip(&motions).filter(has_motion) {
            match place {
                Place::Edges(edges) => edges.as_flattened().iter().for_each(|&node| nodes[node] = 1.0),
                Place::Nodes(held) => held.iter().for_each(|&node| nodes[node] = 1.0),
            }
        }
        partition.sum_at_nodes(&nodes)
    };
    let mut taken = nodes_of(None)?;
    let lift = |motion: &FieldInput| {
        // The plate bends statically between moving and resting held nodes.
        let moved = nodes_of(Some(motion))?;
        let torn = (0..taken.len()).find(|&node| moved[node] > 0.0 && taken[node] > 0.0);
        comm.all_ok(torn.map_or(Ok(()), |node| Err(tears(motion, mesh.nodes[node]))))?;
        add(&moved, &mut taken);
        let steps: Vec<f64> = moved.iter().flat_map(|&w| [w.min(1.0), 0.0, 0.0]).collect();
        let mut load = ground.forces(&steps, false)?;
        scale(-1.0, &mut load);
        let u = ground.equilibrium(system, &load, &Bounds::default())?;
        let bent = ground.space.shape(&system.engine.to_local(&u)?);
        Ok(Lift { motion: Rc::new(motion.clone()), shape: sum(&steps, &bent), is_rigid: false })
    };
    different.into_iter().map(lift).collect()
}

fn same(one: Option<&FieldInput>, other: Option<&FieldInput>) -> bool {
    let [one, other] = [one, other].map(|given| given.map(|given| (&given.formula, &given.table)));
    one == other
}

/// Returns the error of a node with two different motions.
fn tears(motion: &FieldInput, p: Point) -> Error {
    let wrong = format!("the node at ({}, {}) is also held by a support that moves otherwise", p.x, p.y);
    Error::Scene(format!("{}: {wrong}; expected separate nodes, as by where", motion.key))
}

impl Lift {
    /// Returns the support motion with forces and momenta of its shape on the engine's dofs, some
    /// of which are bounded. Collective.
    pub(super) fn moving<P: Partition>(
        &self,
        ground: &BuildContext<P>,
        bounded: &[DeflectionDof],
        dofs: usize,
    ) -> Result<SupportMotion> {
        let Lift { motion, shape, is_rigid } = self;
        let stiffness = is_rigid.then(|| ground.forces(shape, true));
        let any = |force: &Vec<f64>| ground.comm().all_reduce_any(force.iter().any(|f| *f != 0.0));
        let step = ground.scene.time.step;
        let [place, rate] = [(); 2].map(|()| motion.clone());
        // The gaps of balls are numbered past the nodes; no motion shifts them.
        let deflection = |site: &DeflectionDof| shape.get(PER_NODE * site.node).copied().unwrap_or(0.0);
        Ok(SupportMotion {
            place: Box::new(move |t| place.at(Point::origin(), t)),
            rate: Box::new(move |t| match rate.jet(t) {
                Ok(jet) => Ok(jet.first),
                // An infinite velocity is replaced by the mean one over the next step.
                Err(_) => Ok((rate.at(Point::origin(), t + step)? - rate.at(Point::origin(), t)?) / step),
            }),
            momentum: ground.momenta(shape)?,
            stiffness: stiffness.transpose()?.filter(any),
            at_bounds: bounded.iter().map(deflection).collect(),
            shape: ground.owned(&ground.space.interpolate(shape), dofs),
        })
    }
}
