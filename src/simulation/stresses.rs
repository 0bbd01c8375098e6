//! Recovered curvatures of a scene's plate, with its thickness and material.

use super::effects::BuildContext;
use super::membrane_forces::MembraneForces;
use super::plate_assembly::PlateAssembly;
use crate::assembly::{self, Probe, Recovery};
use crate::communicator::Communicator;
use crate::error::{Error, Result};
use crate::geometry;
use crate::linalg::vectors::axpy;
use crate::membrane::{FollowingMembrane, MembranePoint};
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::scene::{ProbeQuantity, Scene};
use crate::stress::Moments;
use nalgebra::Matrix3;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Function that returns the curvatures at the sites of a recovery for deflections and slopes at
/// all nodes of this rank's cells, three per node. Collective.
pub(super) type CurvaturesOfShape = Box<dyn Fn(&[f64]) -> Result<Vec<[f64; 3]>>>;

/// Recovery of the curvatures of a scene's plate, with its sections.
pub(super) struct PlateCurvatures<'s> {
    pub membrane: Rc<MembraneForces<'s>>,
    /// Membrane of a plate that stretches.
    following: Option<Rc<FollowingMembrane>>,
    pub body: PlateAssembly<'s>,
    pub recovery: Recovery,
    /// Number of parts of the plate, the plate outside all of them included.
    pub parts: usize,
}

/// Returns whether a scene asks for moments, membrane forces or stresses.
fn asks(scene: &Scene) -> bool {
    let output = &scene.output;
    let asks = |quantity: ProbeQuantity| {
        quantity.is_of_curvature() || matches!(quantity, ProbeQuantity::Membrane(_))
    };
    output.extremes
        || output.fields.is_some_and(|fields| fields.stresses)
        || output.probes.iter().any(|probe| asks(probe.quantity))
}

/// Measure of what acts in the mid-plane.
#[derive(Clone, Copy)]
pub(super) enum Measure {
    /// Stress, in Pa.
    Stress,
    /// Force per length, in N/m.
    Force,
}

impl Measure {
    /// Returns the factor of a force per length.
    fn per_force(self, section: &Section) -> f64 {
        match self {
            Measure::Stress => 1.0 / section.thickness,
            Measure::Force => 1.0,
        }
    }
}

/// Stresses or forces of the mid-plane at some places: given ones, and by stretching.
pub(super) struct MidplaneStresses {
    /// Part that does not depend on the deflection, in Pa or N/m; empty without any.
    constant: Vec<Moments>,
    /// Membrane of a plate that stretches, and its points.
    stretched: Option<(Rc<FollowingMembrane>, Vec<MidplanePoint>)>,
}

/// Point of the membrane with the factor of the force there.
type MidplanePoint = (MembranePoint, f64);

impl MidplaneStresses {
    /// Returns the values for deflections and slopes at all nodes of this process, three per node,
    /// in Pa or N/m; empty where all are zero. Collective.
    ///
    /// # Errors
    /// Returns the errors of the membrane.
    pub fn of_shape(&self, shape: &[f64]) -> Result<Cow<'_, [Moments]>> {
        let Some((membrane, points)) = &self.stretched else { return Ok((&self.constant).into()) };
        let displacement = membrane.follow(shape)?;
        let value = |(number, (point, factor)): (usize, &MidplanePoint)| {
            let [xx, yy, xy] = point.stretching_force(&displacement, shape);
            let constant = self.constant.get(number).copied().unwrap_or_default();
            Moments { xx, yy, xy }.times(*factor).plus(constant)
        };
        Ok(points.iter().enumerate().map(value).collect::<Vec<_>>().into())
    }
}

impl<'s> PlateCurvatures<'s> {
    /// Prepares the recovery if the scene asks for it. Collective.
    pub fn if_asked<P: Partition>(ground: &BuildContext<'s, P>) -> Result<Option<PlateCurvatures<'s>>> {
        if asks(ground.scene) { PlateCurvatures::new(ground).map(Some) } else { Ok(None) }
    }

    /// Prepares the recovery. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<'s, P>) -> Result<PlateCurvatures<'s>> {
        let BuildContext { scene, mesh, partition, .. } = *ground;
        let body = PlateAssembly::new(scene, mesh, partition.comm())?;
        let parts = scene.parts.len() + 1;
        let recovery = Recovery::new(mesh, &ground.cells, &|cell| body.part(cell), parts, partition)?;
        let following = ground.membrane.following.clone();
        Ok(PlateCurvatures { membrane: ground.membrane.clone(), following, body, recovery, parts })
    }

    /// Returns a measure of the forces at a point of a cell that do not depend on the deflection.
    pub fn middle(&self, cell: usize, point: Point, measure: Measure) -> Result<Moments> {
        if !self.membrane.is_any() {
            return Ok(Moments::default());
        }
        let [xx, yy, xy] = self.membrane.at(cell, point)?;
        Ok(Moments { xx, yy, xy }.times(measure.per_force(&self.body.section(cell, point)?)))
    }

    /// Returns the stresses of the mid-plane at places, each a cell and a point of it.
    ///
    /// # Errors
    /// Returns the errors of the formulas and of the cells.
    pub fn middle_of(
        &self,
        mesh: &Mesh,
        places: impl Iterator<Item = (usize, Point)> + Clone,
    ) -> Result<MidplaneStresses> {
        let middle = |(cell, point)| self.middle(cell, point, Measure::Stress);
        let constant = match self.membrane.is_any() {
            true => places.clone().map(middle).collect::<Result<_>>()?,
            false => Vec::new(),
        };
        Ok(MidplaneStresses { constant, ..self.stretching_of(mesh, places, Measure::Stress)? })
    }

    /// Returns a measure of the forces by stretching alone at places.
    ///
    /// # Errors
    /// Returns the errors of the cells.
    pub fn stretching_of(
        &self,
        mesh: &Mesh,
        places: impl Iterator<Item = (usize, Point)>,
        measure: Measure,
    ) -> Result<MidplaneStresses> {
        let constant = Vec::new();
        let Some(membrane) = &self.following else {
            return Ok(MidplaneStresses { constant, stretched: None });
        };
        let point = |(cell, point)| {
            let section = self.body.section(cell, point)?;
            Ok((MembranePoint::new(mesh, cell, point, &section)?, measure.per_force(&section)))
        };
        let points = places.map(point).collect::<Result<_>>()?;
        Ok(MidplaneStresses { constant, stretched: Some((membrane.clone(), points)) })
    }

    /// Returns [`Self::middle`] at a point of the plate: the mean over all cells that contain the
    /// point. Collective.
    pub fn middle_at<P: Partition>(
        &self,
        ground: &BuildContext<P>,
        place: [f64; 2],
        measure: Measure,
    ) -> Result<Moments> {
        let (comm, point) = (ground.partition.comm(), Point::from(place));
        if !self.membrane.is_any() {
            return Ok(Moments::default());
        }
        let around = ground.mesh.cells_at(point).map(|cell| self.middle(cell, point, measure));
        let around: Vec<Moments> = comm.all_ok(around.collect())?;
        let sums = around
            .iter()
            .fold([0.0; 4], |[count, x, y, z], Moments { xx, yy, xy }| [count + 1.0, x + xx, y + yy, z + xy]);
        let sums = comm.all_reduce_sum_slice(&sums);
        Ok(Moments { xx: sums[1], yy: sums[2], xy: sums[3] }.times(1.0 / sums[0].max(1.0)))
    }

    /// Returns the function that recovers curvatures.
    pub fn of_shape<P: Partition>(&self, partition: &P) -> CurvaturesOfShape {
        let (recovery, partition) = (self.recovery.clone(), partition.clone());
        Box::new(move |shape| recovery.curvatures(shape, &partition))
    }

    /// Returns three linear functions of the curvatures (w_xx, w_xy, w_yy) at a point, given by a
    /// matrix for each section there, as sums over all deflections and slopes of this rank's cells,
    /// which add up over the ranks. Collective.
    ///
    /// Curvatures and sections jump between parts. On their border the functions are the mean over
    /// all cells that contain the point.
    pub fn mapped_at<P: Partition>(
        &self,
        ground: &BuildContext<'s, P>,
        key: &str,
        place: [f64; 2],
        map: impl Fn(&Section) -> Matrix3<f64>,
    ) -> Result<[Probe; 3]> {
        let BuildContext { mesh, partition, .. } = *ground;
        let comm = partition.comm();
        let point = Point::from(place);
        let around: Vec<usize> = mesh.cells_at(point).collect();
        let count = comm.all_reduce_sum(around.len() as f64);
        if count == 0.0 {
            let place = geometry::place(point);
            return Err(Error::Mesh(format!("{key}: the point {place} lies outside the plate")));
        }
        let mut shares = vec![[0.0; 9]; self.recovery.sites.len()];
        let mut add = |&cell: &usize| {
            let map = map(&self.body.section(cell, point)?) / count;
            let weights = assembly::vertex_weights(&mesh.element(cell)?, point);
            for (&site, weight) in self.recovery.of_cell(cell).iter().zip(weights) {
                axpy(weight, map.as_slice(), &mut shares[site]);
            }
            Ok(())
        };
        comm.all_ok(around.iter().try_for_each(&mut add))?;
        assembly::sum_over_ranks(&self.recovery.sites, self.parts, partition, &mut shares)?;
        let mut rows: [BTreeMap<usize, f64>; 3] = Default::default();
        for entry in 0..9 {
            let shares: Vec<f64> = shares.iter().map(|share| share[entry]).collect();
            let weights = self.recovery.weights_of_fits(&shares, partition)?;
            for (fit, weight) in weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0) {
                for (dof, curvature) in self.recovery.row(fit) {
                    *rows[entry % 3].entry(dof).or_default() += weight * curvature[entry / 3];
                }
            }
        }
        Ok(rows.map(|row| Probe::from_terms(row.into_iter().collect())))
    }
}
