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
use nalgebra::Matrix3;
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
        let mut row: BTreeMap<usize, [f64; 3]> = BTreeMap::new();
        for ([share], of) in shares.iter().zip(self.recovery.rows()).filter(|([share], _)| *share != 0.0) {
            for (dof, curvature) in of {
                let sums = row.entry(*dof).or_default();
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

/// Returns the curvatures of a shape (three values per node) in one row of a recovery.
pub(super) fn curvature_of(row: &[(usize, [f64; 3])], shape: &[f64]) -> [f64; 3] {
    debug_assert!(shape.len().is_multiple_of(PER_NODE));
    let mut sums = [0.0; 3];
    for (dof, weights) in row {
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * shape[*dof]);
    }
    sums
}

/// Quantities with three components at the sites of a recovery, linear in the curvatures: the
/// curvatures themselves, or the stresses.
pub(super) struct SiteValues {
    /// First entry of each site, and the end of the last one.
    starts: Vec<usize>,
    /// Dofs of this rank's cells with three weights each, site by site.
    entries: Vec<(u32, [f64; 3])>,
    /// Support motions with this rank's share of the values that they cause, per metre.
    lifts: Vec<(Rc<FieldInput>, Vec<[f64; 3]>)>,
    /// Sum over the ranks that share the sites; `None` on a single process.
    sum: Option<SumOverRanks>,
}

/// Sum of values at sites over the ranks that share them. Collective.
type SumOverRanks = Box<dyn Fn(&mut [[f64; 3]]) -> Result<()>>;

impl SiteValues {
    /// Prepares the values `of(site, curvature)`, linear in the curvature (w_xx, w_xy, w_yy).
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        lifts: &[Lift],
        curvatures: &PlateCurvatures,
        of: impl Fn(usize, [f64; 3]) -> [f64; 3],
    ) -> SiteValues {
        let PlateCurvatures { recovery, parts, .. } = curvatures;
        let (mut starts, mut entries) = (vec![0], Vec::new());
        for (site, row) in recovery.rows().iter().enumerate() {
            for &(of_shape, weights) in row {
                if let Some((dof, factor)) = ground.space.dof(of_shape) {
                    entries.push((dof as u32, of(site, weights.map(|weight| factor * weight))));
                }
            }
            starts.push(entries.len());
        }
        let lifted = |Lift { motion, shape, .. }: &Lift| {
            let rows = recovery.rows().iter().enumerate();
            (motion.clone(), rows.map(|(site, row)| of(site, curvature_of(row, shape))).collect())
        };
        let (sites, parts, partition) = (recovery.sites().to_vec(), *parts, ground.partition.clone());
        let sum = move |values: &mut [[f64; 3]]| assembly::sum_over_ranks(&sites, parts, &partition, values);
        let sum = P::DIVIDES.then(|| Box::new(sum) as SumOverRanks);
        SiteValues { starts, entries, lifts: lifts.iter().map(lifted).collect(), sum }
    }

    /// Returns the values for displacements over the dofs of this rank's cells at an instant (s).
    /// Collective.
    pub fn at(&self, u: &[f64], time: f64) -> Result<Vec<[f64; 3]>> {
        let of_site = |ends: &[usize]| {
            let mut sums = [0.0; 3];
            for (dof, weights) in &self.entries[ends[0]..ends[1]] {
                let value = u[*dof as usize];
                sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * value);
            }
            sums
        };
        let mut values: Vec<[f64; 3]> = self.starts.windows(2).map(of_site).collect();
        for (motion, lift) in &self.lifts {
            let moved = motion.at(Point::origin(), time)?;
            axpy(moved, lift.as_flattened(), values.as_flattened_mut());
        }
        if let Some(sum) = &self.sum {
            sum(&mut values)?;
        }
        Ok(values)
    }
}
