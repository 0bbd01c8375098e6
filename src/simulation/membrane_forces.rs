//! Forces in the plane of a scene's plate that do not depend on the deflection.

use super::plate_assembly::PlateAssembly;
use super::{refinement, regions};
use crate::dof_map::{Place, Support};
use crate::error::Result;
use crate::membrane::{
    DeadLoad, FollowingMembrane, InPlaneDisplacement, InPlaneHold, InPlaneSupport, Membrane, MembranePoint,
    Spaces,
};
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use crate::plate::Sections;
use crate::scene::{InPlane, Scene};
use std::rc::Rc;

/// Forces in the plane of the cells of this process's part of the mesh.
pub(super) struct MembraneForces<'g> {
    in_plane: Option<&'g InPlane>,
    solved: Option<SolvedForces<'g>>,
    /// Membrane of a plate that stretches.
    pub following: Option<Rc<FollowingMembrane>>,
}

/// Forces by the equilibrium in the plane.
struct SolvedForces<'g> {
    mesh: &'g Mesh,
    sections: PlateAssembly<'g>,
    displacement: InPlaneDisplacement,
}

impl<'g> MembraneForces<'g> {
    /// Determines the forces of a scene. Collective.
    ///
    /// # Errors
    /// Returns the errors of the supports, and [`Error::Scene`](crate::Error::Scene) for loads that
    /// nothing carries.
    pub fn new<P: Partition>(scene: &'g Scene, mesh: &'g Mesh, partition: &P) -> Result<MembraneForces<'g>> {
        let in_plane = scene.prestress();
        let solved = in_plane.filter(|in_plane| in_plane.is_solved());
        if !scene.stretches() && solved.is_none() {
            return Ok(MembraneForces { in_plane, solved: None, following: None });
        }
        let sections = PlateAssembly::new(scene, mesh, partition.comm())?;
        let spaces = Spaces::new(mesh, &supports(scene, mesh, partition)?, partition)?;
        let membrane = Membrane::new(mesh, &spaces, &sections, partition)?;
        let following = Rc::new(FollowingMembrane::new(membrane, spaces));
        let solve = |in_plane| SolvedForces::new(in_plane, (mesh, partition), sections, &following);
        let solved = solved.map(solve).transpose()?;
        Ok(MembraneForces { in_plane, solved, following: scene.stretches().then_some(following) })
    }

    /// Returns whether there are any forces that do not depend on the deflection.
    pub fn is_any(&self) -> bool {
        self.in_plane.is_some()
    }

    /// Returns whether these forces are given, and do not follow from an equilibrium.
    pub fn are_given(&self) -> bool {
        self.solved.is_none()
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
        let SolvedForces { mesh, sections, displacement } = solved;
        let section = sections.section(cell, point)?;
        let strain = section.expansion * temperature(in_plane, point)?;
        Ok(MembranePoint::new(mesh, cell, point, &section)?.force(displacement, strain))
    }
}

impl<'g> SolvedForces<'g> {
    /// Solves for the forces by temperature and by tractions. Collective.
    fn new<P: Partition>(
        in_plane: &InPlane,
        (mesh, partition): (&'g Mesh, &P),
        sections: PlateAssembly<'g>,
        membrane: &FollowingMembrane,
    ) -> Result<SolvedForces<'g>> {
        let comm = partition.comm();
        let strain =
            |cell, point| Ok(sections.section(cell, point)?.expansion * temperature(in_plane, point)?);
        let loads = in_plane.tractions.iter().enumerate().map(|(number, traction)| {
            let key = format!("in_plane.traction.{number}");
            let sides = regions::named(&mesh.edges, "edge", &traction.edge, comm, &key)?.to_vec();
            Ok(DeadLoad { key, sides, force: traction.force })
        });
        let loads: Vec<DeadLoad> = loads.collect::<Result<_>>()?;
        let fields = Vec::from_iter(&in_plane.temperature);
        let rules = refinement::rules_of("in_plane.temperature", mesh, &fields, comm)?;
        let displacement = membrane.equilibrium((mesh, comm), &sections, (&strain, &rules), &loads)?;
        Ok(SolvedForces { mesh, sections, displacement })
    }
}

/// Returns the temperature above the one without stress at a point, in K.
fn temperature(in_plane: &InPlane, point: Point) -> Result<f64> {
    in_plane.temperature.as_ref().map_or(Ok(0.0), |temperature| temperature.at(point, 0.0))
}

/// Returns the supports of a part of a mesh in its plane: clamped and simply supported edges hold
/// the plate unless the scene says otherwise. Collective.
///
/// # Errors
/// Returns the errors of the supports.
fn supports<P: Partition>(scene: &Scene, mesh: &Mesh, partition: &P) -> Result<Vec<InPlaneSupport>> {
    let places = regions::supports(scene, mesh, partition.comm())?;
    let places = scene.supports.iter().zip(places).enumerate();
    let held = places.filter_map(|(number, (support, (place, kind)))| {
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
    Ok(held.collect())
}
