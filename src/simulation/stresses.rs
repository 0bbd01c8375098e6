//! Recovered curvatures of a scene's plate, with its thickness and material.

use super::effects::{BuildContext, Lift};
use super::plate_assembly::PlateAssembly;
use crate::assembly::{self, Probe, Recovery};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::{Error, Result};
use crate::linalg::vectors::axpy;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::scene::{FieldInput, ProbeQuantity, Scene};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::rc::Rc;

/// Recovery of the curvatures of a scene's plate, with its sections.
pub(super) struct PlateCurvatures<'s> {
    pub body: PlateAssembly<'s>,
    pub recovery: Recovery,
    /// Number of parts of the plate, the plate outside all of them included.
    pub parts: usize,
}

/// Returns whether a scene asks for moments or stresses.
fn asks(scene: &Scene) -> bool {
    let is_moment = |of: ProbeQuantity| {
        matches!(of, ProbeQuantity::Moment(_) | ProbeQuantity::Stress(..) | ProbeQuantity::VonMises(_))
    };
    let output = &scene.output;
    output.extremes
        || output.fields.is_some_and(|fields| fields.stresses)
        || output.probes.iter().any(|probe| is_moment(probe.quantity))
}

impl<'s> PlateCurvatures<'s> {
    /// Prepares the recovery if the scene asks for moments or stresses. Collective.
    pub fn if_asked<P: Partition>(ground: &BuildContext<'s, P>) -> Result<Option<PlateCurvatures<'s>>> {
        if asks(ground.scene) { PlateCurvatures::new(ground).map(Some) } else { Ok(None) }
    }

    /// Prepares the recovery. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<'s, P>) -> Result<PlateCurvatures<'s>> {
        let BuildContext { scene, mesh, cells, partition, .. } = *ground;
        let body = PlateAssembly::new(scene, mesh, partition.comm())?;
        let parts = scene.parts.len() + 1;
        let recovery = Recovery::new(mesh, cells, &|cell| body.part(cell), parts, partition)?;
        Ok(PlateCurvatures { body, recovery, parts })
    }

    /// Returns the moments M_xx, M_yy and M_xy at a point as sums over all deflections and slopes
    /// of this rank's cells, which add up over the ranks, and the section there. Collective.
    pub fn moments_at<P: Partition>(
        &self,
        ground: &BuildContext<'s, P>,
        key: &str,
        [x, y]: [f64; 2],
    ) -> Result<([Probe; 3], Section)> {
        let BuildContext { mesh, partition, .. } = *ground;
        let comm = partition.comm();
        let at = Point::new(x, y);
        let here = mesh.locate(at);
        let first = comm.all_gather_one(here.is_some()).iter().position(|&here| here);
        let outside = || Error::Mesh(format!("{key}: the point ({x}, {y}) lies outside the plate"));
        let first = first.ok_or_else(outside)?;
        let own = here.filter(|_| comm.rank() == first);
        let mut shares = vec![[0.0]; self.recovery.sites().len()];
        let mut found = Ok([0.0; 11]);
        if let Some(cell) = own {
            found = self.body.section(cell, at).map(to_numbers);
            let weights = assembly::vertex_weights(&mesh.element(cell)?, at);
            self.recovery
                .of_cell(cell)
                .iter()
                .zip(weights)
                .for_each(|(&site, weight)| shares[site][0] += weight);
        }
        let section = from_numbers(comm.all_reduce_sum(comm.all_ok(found)?));
        assembly::sum_over_ranks(self.recovery.sites(), self.parts, partition, &mut shares)?;
        let shares: Vec<f64> = shares.into_iter().map(|[share]| share).collect();
        let weights = self.recovery.weights_of_fits(&shares, partition)?;
        let mut row: BTreeMap<usize, [f64; 3]> = BTreeMap::new();
        for (fit, share) in weights.iter().enumerate().filter(|(_, share)| **share != 0.0) {
            for (dof, curvature) in self.recovery.row(fit) {
                let sums = row.entry(dof).or_default();
                sums.iter_mut().zip(curvature).for_each(|(sum, term)| *sum += share * term);
            }
        }
        let moment = |(index, factor): (usize, f64)| {
            let of = |curvature: &[f64; 3]| {
                (0..3).map(|k| factor * section.bending[(index, k)] * curvature[k]).sum::<f64>()
            };
            Probe::from_terms(row.iter().map(|(dof, curvature)| (*dof, of(curvature))).collect())
        };
        Ok(([(0, -1.0), (2, -1.0), (1, -0.5)].map(moment), section))
    }
}

/// Returns a section as numbers that ranks can add.
fn to_numbers(section: Section) -> [f64; 11] {
    let mut numbers = [0.0; 11];
    numbers[..9].copy_from_slice(section.bending.as_slice());
    (numbers[9], numbers[10]) = (section.density, section.thickness);
    numbers
}

fn from_numbers(numbers: [f64; 11]) -> Section {
    let bending = Matrix3::from_column_slice(&numbers[..9]);
    Section { bending, density: numbers[9], thickness: numbers[10] }
}

/// Quantities with three components at the sites of a recovery, linear in the curvatures: the
/// curvatures themselves, or the stresses.
pub(super) struct SiteValues {
    /// Number of nodes of this rank.
    nodes: usize,
    /// Deflections and slopes that supports leave free: the node of each, its dof and the factor of
    /// the dof; first w at all nodes, then w_x, then w_y.
    free: [Vec<(u32, u32, f64)>; PER_NODE],
    /// Curvatures at the sites from w, w_x and w_y at the nodes. Collective.
    curvatures: CurvaturesOfNodes,
    /// Matrix that maps the curvatures to the values at each site.
    maps: Vec<Matrix3<f64>>,
    /// Support motions with the values that they cause, per metre.
    lifts: Vec<(Rc<FieldInput>, Vec<[f64; 3]>)>,
}

type CurvaturesOfNodes = Box<dyn Fn([&[f64]; PER_NODE]) -> Result<Vec<[f64; 3]>>>;

impl SiteValues {
    /// Prepares the values at the sites from matrices that map the curvature (w_xx, w_xy, w_yy) to
    /// them. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        lifts: &[Lift],
        curvatures: &PlateCurvatures,
        maps: Vec<Matrix3<f64>>,
    ) -> Result<SiteValues> {
        let nodes = ground.mesh.nodes.len();
        let free = [0, 1, 2].map(|k| {
            let dof = |node| {
                let (dof, factor) = ground.space.dof(PER_NODE * node + k)?;
                Some((node as u32, dof as u32, factor))
            };
            (0..nodes).filter_map(dof).collect()
        });
        let (recovery, partition) = (curvatures.recovery.clone(), ground.partition.clone());
        let of_nodes =
            move |nodal: [&[f64]; PER_NODE]| recovery.curvatures(&mut recovery.fits(nodal), &partition);
        let curvatures: CurvaturesOfNodes = Box::new(of_nodes);
        let lifted = |Lift { motion, shape, .. }: &Lift| {
            let nodal =
                [0, 1, 2].map(|k| shape.iter().skip(k).step_by(PER_NODE).copied().collect::<Vec<_>>());
            Ok((motion.clone(), mapped(&maps, curvatures(nodal.each_ref().map(Vec::as_slice))?)))
        };
        let lifts = lifts.iter().map(lifted).collect::<Result<_>>()?;
        Ok(SiteValues { nodes, free, curvatures, maps, lifts })
    }

    /// Returns the values for displacements over the dofs of this rank's cells at an instant (s).
    /// Collective.
    pub fn at(&self, u: &[f64], time: f64) -> Result<Vec<[f64; 3]>> {
        let nodal = self.free.each_ref().map(|free| {
            let mut values = vec![0.0; self.nodes];
            for (node, dof, factor) in free {
                values[*node as usize] = factor * u[*dof as usize];
            }
            values
        });
        let mut values = mapped(&self.maps, (self.curvatures)(nodal.each_ref().map(Vec::as_slice))?);
        for (motion, lift) in &self.lifts {
            let moved = motion.at(Point::origin(), time)?;
            axpy(moved, lift.as_flattened(), values.as_flattened_mut());
        }
        Ok(values)
    }
}

/// Returns the products of matrices with triples.
fn mapped(maps: &[Matrix3<f64>], values: Vec<[f64; 3]>) -> Vec<[f64; 3]> {
    maps.iter().zip(values).map(|(map, value)| (map * Vector3::from(value)).into()).collect()
}
