//! Forces in the plane of a scene's plate that do not depend on the deflection.

use super::plate_assembly::PlateAssembly;
use super::{meshing, refinement, regions};
use crate::communicator::{Communicator, SelfComm};
use crate::dof_map::{PER_NODE, Place, Support};
use crate::error::{Error, Result};
use crate::membrane::{
    self, DeadLoad, FollowingMembrane, InPlaneDisplacement, InPlaneHold, InPlaneSupport, Membrane,
    MembranePoint, Spaces,
};
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use crate::plate::Sections;
use crate::scene::{InPlane, Scene};
use std::borrow::Cow;
use std::rc::Rc;

/// Forces in the plane of the cells of this process's part of the mesh.
pub(super) struct MembraneForces<'g> {
    in_plane: Option<&'g InPlane>,
    solved: Option<SolvedForces<'g>>,
    following: Option<PlateMembrane>,
}

/// Membrane of a plate that stretches, on this process's part of the mesh.
#[derive(Clone)]
pub(super) struct PlateMembrane {
    /// Membrane of the whole plate.
    pub membrane: Rc<FollowingMembrane>,
    /// Cell and node of the whole mesh of each cell and node of the part.
    pub cells: Vec<usize>,
    pub nodes: Vec<usize>,
    /// Number of nodes of the whole mesh.
    pub count: usize,
}

impl PlateMembrane {
    /// Returns deflections and slopes of the whole plate, three per node, given those of the nodes
    /// of this process. Collective.
    pub fn whole<P: Partition>(&self, partition: &P, part: &[f64]) -> Vec<f64> {
        if !P::DIVIDES {
            return part.to_vec();
        }
        let mut shape = vec![0.0; PER_NODE * self.count];
        for (node, values) in
            part.chunks_exact(PER_NODE).enumerate().filter(|(node, _)| partition.owns_node(*node))
        {
            shape[PER_NODE * self.nodes[node]..][..PER_NODE].copy_from_slice(values);
        }
        partition.comm().all_reduce_sum_slice(&shape)
    }
}

/// Forces by the equilibrium in the plane of the whole plate, which every process solves.
struct SolvedForces<'g> {
    mesh: Cow<'g, Mesh>,
    sections: PlateAssembly<'g>,
    displacement: InPlaneDisplacement,
    /// Cell of the whole mesh of each cell of the part.
    cells: Vec<usize>,
}

impl<'g> MembraneForces<'g> {
    /// Determines the forces of a scene. Collective.
    ///
    /// # Errors
    /// Returns the errors of the supports, and [`Error::Scene`] for loads that nothing carries.
    pub fn new<P: Partition>(scene: &'g Scene, mesh: &'g Mesh, partition: &P) -> Result<MembraneForces<'g>> {
        let in_plane = scene.prestress();
        let none = MembraneForces { in_plane, solved: None, following: None };
        if !scene.stretches() && !in_plane.is_some_and(InPlane::is_solved) {
            return Ok(none);
        }
        let built = MembraneForces::build::<P>(scene, in_plane, mesh);
        let (solved, following) = partition.comm().all_ok(built)?;
        Ok(MembraneForces { solved, following: scene.stretches().then_some(following), ..none })
    }

    /// Builds the membrane of the whole plate, and solves for the forces in it if there are any.
    fn build<P: Partition>(
        scene: &'g Scene,
        in_plane: Option<&'g InPlane>,
        part: &'g Mesh,
    ) -> Result<(Option<SolvedForces<'g>>, PlateMembrane)> {
        let mesh = if P::DIVIDES { Cow::Owned(meshing::mesh(scene)?) } else { Cow::Borrowed(part) };
        let sections = PlateAssembly::new(scene, &mesh, &SelfComm)?;
        let spaces = spaces(scene, &mesh)?;
        let membrane = Membrane::new(&mesh, &spaces, &sections)?;
        let cells = if P::DIVIDES { cells_of(part, &mesh)? } else { (0..mesh.cells.len()).collect() };
        let nodes = if P::DIVIDES { nodes_of(part, &mesh, &cells) } else { (0..mesh.nodes.len()).collect() };
        let membrane = Rc::new(FollowingMembrane::new(membrane, spaces));
        let following = PlateMembrane { membrane, cells, nodes, count: mesh.nodes.len() };
        let Some(in_plane) = in_plane.filter(|in_plane| in_plane.is_solved()) else {
            return Ok((None, following));
        };
        let strain =
            |cell, point| Ok(sections.section(cell, point)?.expansion * temperature(in_plane, point)?);
        let loads = in_plane.tractions.iter().enumerate().map(|(number, traction)| {
            let key = format!("in_plane.traction.{number}");
            let sides = regions::named(&mesh.edges, "edge", &traction.edge, &SelfComm, &key)?.to_vec();
            Ok(DeadLoad { key, sides, force: traction.force })
        });
        let loads: Vec<DeadLoad> = loads.collect::<Result<_>>()?;
        let fields = Vec::from_iter(&in_plane.temperature);
        let rules = refinement::rules_of("in_plane.temperature", &mesh, &fields, &SelfComm)?;
        let cells = following.cells.clone();
        let displacement = following.membrane.equilibrium(&mesh, &sections, (&strain, &rules), &loads)?;
        Ok((Some(SolvedForces { mesh, sections, displacement, cells }), following))
    }

    /// Returns whether there are any forces that do not depend on the deflection.
    pub fn is_any(&self) -> bool {
        self.in_plane.is_some()
    }

    /// Returns whether these forces are given, and do not follow from an equilibrium.
    pub fn are_given(&self) -> bool {
        self.solved.is_none()
    }

    /// Returns the membrane of a plate that stretches.
    pub fn following(&self) -> Option<&PlateMembrane> {
        self.following.as_ref()
    }

    /// Returns the components xx, yy and xy at a point of a cell of this process, in N/m.
    ///
    /// # Errors
    /// Returns the errors of the formulas.
    pub fn at(&self, cell: usize, point: Point) -> Result<[f64; 3]> {
        let (given, solved) = (self.given(point)?, self.solved(cell, point)?);
        Ok([0, 1, 2].map(|k| given[k] + solved[k]))
    }

    /// Returns the part that is given, at a point.
    ///
    /// # Errors
    /// Returns the errors of the formulas.
    pub fn given(&self, point: Point) -> Result<[f64; 3]> {
        let Some(in_plane) = self.in_plane else { return Ok([0.0; 3]) };
        let [xx, yy, xy] = in_plane.tension.components().map(|component| component.at(point, 0.0));
        Ok([xx?, yy?, xy?])
    }

    /// Returns the part that follows from the equilibrium, at a point of a cell of this process.
    ///
    /// # Errors
    /// Returns the errors of the formulas.
    pub fn solved(&self, cell: usize, point: Point) -> Result<[f64; 3]> {
        let (Some(in_plane), Some(solved)) = (self.in_plane, &self.solved) else { return Ok([0.0; 3]) };
        let SolvedForces { mesh, sections, displacement, cells } = solved;
        let cell = cells[cell];
        let section = sections.section(cell, point)?;
        let strain = section.expansion * temperature(in_plane, point)?;
        Ok(MembranePoint::new(mesh, cell, point, &section)?.force(displacement, strain))
    }
}

/// Returns the cell of the whole mesh of each cell of a part.
fn cells_of(part: &Mesh, whole: &Mesh) -> Result<Vec<usize>> {
    let cell_of = |cell| {
        let centre = part.centroid(cell);
        let missing = || Error::Mesh(format!("no cell of the whole mesh at {centre}"));
        whole.locate(centre).ok_or_else(missing)
    };
    (0..part.cells.len()).map(cell_of).collect()
}

/// Returns the node of the whole mesh of each node of a part, given the cells.
fn nodes_of(part: &Mesh, whole: &Mesh, cells: &[usize]) -> Vec<usize> {
    let mut nodes = vec![0; part.nodes.len()];
    for (cell, &number) in part.cells.iter().zip(cells) {
        for &node in cell.nodes() {
            let distance = |other: &&usize| (whole.nodes[**other] - part.nodes[node]).norm();
            let nearest =
                whole.cells[number].nodes().iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            nodes[node] = nearest.copied().unwrap_or_default();
        }
    }
    nodes
}

/// Returns the temperature above the one without stress at a point, in K.
fn temperature(in_plane: &InPlane, point: Point) -> Result<f64> {
    in_plane.temperature.as_ref().map_or(Ok(0.0), |temperature| temperature.at(point, 0.0))
}

/// Returns the spaces of the displacement in the plane of a whole mesh: clamped and simply
/// supported edges hold the plate unless the scene says otherwise.
///
/// # Errors
/// Returns the errors of the supports.
fn spaces(scene: &Scene, mesh: &Mesh) -> Result<Spaces> {
    let supports = regions::supports(scene, mesh, &SelfComm)?;
    let held =
        scene.supports.iter().zip(supports).enumerate().filter_map(|(number, (support, (place, kind)))| {
            let usual = match kind {
                Support::Clamped | Support::SimplySupported => InPlaneHold::Held,
                Support::Guided | Support::Elastic => InPlaneHold::Free,
            };
            match place {
                Place::Edges(sides) => {
                    let (key, hold) = (format!("support.{number}"), support.in_plane.unwrap_or(usual));
                    Some(InPlaneSupport { key, sides, hold })
                }
                Place::Nodes(_) => None,
            }
        });
    membrane::spaces(mesh, &held.collect::<Vec<_>>())
}
