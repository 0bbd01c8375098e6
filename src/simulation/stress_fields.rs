//! Moments and stresses in snapshots.

use super::effects::{BuildContext, Lift};
use super::stresses::{PlateCurvatures, SiteValues};
use crate::assembly::{self, CellArrays};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::vectors::axpy;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::scene::FieldInput;
use crate::stress::Moments;
use std::rc::Rc;

/// Moments and stresses of a snapshot.
#[derive(Debug, Clone, Default)]
pub struct SnapshotStresses {
    /// Recovered moments M_xx, M_yy and M_xy, in N m/m, one entry per point.
    pub moment: Vec<[f64; 3]>,
    /// Largest and least principal value of the recovered moments, in N m/m, one entry per point.
    pub principal: Vec<[f64; 2]>,
    /// Recovered stresses xx, yy and xy at the upper surface, in Pa, one entry per point.
    pub stress_top: Vec<[f64; 3]>,
    /// Von Mises stress of the recovered moments, in Pa, one entry per point.
    pub von_mises: Vec<f64>,
    /// Moments of the element itself at the centre of each small cell, in N m/m.
    pub moment_raw: Vec<[f64; 3]>,
    /// Von Mises stress of the element itself at the centre of each small cell, in Pa.
    pub von_mises_raw: Vec<f64>,
}

/// Point of a cell of the mesh: which cell, the section there, and weights.
struct Sampled<W> {
    cell: usize,
    section: Section,
    weights: W,
}

/// Sampling of moments and stresses.
pub(super) struct StressFields {
    curvatures: SiteValues,
    /// Sites of the nodes of each cell.
    sites: Vec<Vec<usize>>,
    /// Weights of the sites of its cell in the curvature at each point.
    points: Vec<Sampled<Vec<f64>>>,
    /// Curvatures of the basis functions at the centre of each small cell.
    centres: Vec<Sampled<Vec<[f64; 3]>>>,
    /// Support motions with the curvatures that they cause at the centres, per metre.
    lifts: Vec<(Rc<FieldInput>, Vec<[f64; 3]>)>,
}

impl StressFields {
    /// Prepares the sampling at points, each in its cell of the mesh, and at the centres of small
    /// cells, each given by its corners and its cell. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        lifts: &[Lift],
        curvatures: &PlateCurvatures,
        points: Located<[f64; 2]>,
        small: Located<Vec<usize>>,
    ) -> Result<StressFields> {
        let own = sampled(ground, curvatures, points, small);
        let (points, centres) = ground.comm().all_ok(own)?;
        let mesh = ground.mesh;
        let lifted = |Lift { motion, shape, .. }: &Lift| {
            let of = |centre: &Sampled<Vec<[f64; 3]>>| {
                let dofs = |&node: &usize| shape[PER_NODE * node..][..PER_NODE].iter().copied();
                sum(&centre.weights, mesh.cells[centre.cell].nodes().iter().flat_map(dofs))
            };
            (motion.clone(), centres.iter().map(of).collect())
        };
        Ok(StressFields {
            curvatures: SiteValues::new(ground, lifts, curvatures, &[])?,
            sites: (0..mesh.cells.len()).map(|cell| curvatures.recovery.of_cell(cell).to_vec()).collect(),
            lifts: lifts.iter().map(lifted).collect(),
            points,
            centres,
        })
    }

    /// Returns moments and stresses for displacements over the dofs of this rank's cells at an
    /// instant (s). Collective.
    pub fn sample(&self, cells: &[CellArrays], u: &[f64], time: f64) -> Result<SnapshotStresses> {
        let mut sampled = SnapshotStresses::default();
        let curvatures = self.curvatures.at(u, time)?;
        for Sampled { cell, section, weights } in &self.points {
            let curvature = sum_of_sites(weights, self.sites[*cell].iter().map(|&site| curvatures[site]));
            let moments = Moments::of_curvature(section, curvature);
            let Moments { xx, yy, xy } = moments;
            sampled.moment.push([xx, yy, xy]);
            sampled.principal.push(moments.principal());
            sampled.stress_top.push([xx, yy, xy].map(|moment| section.stress_per_moment() * moment));
            sampled.von_mises.push(section.stress_per_moment() * moments.von_mises());
        }
        let of_dofs = |centre: &Sampled<Vec<[f64; 3]>>| {
            let cell = &cells[centre.cell];
            sum(&centre.weights, (0..centre.weights.len()).map(|local| cell.value(local, u)))
        };
        let mut raw: Vec<[f64; 3]> = self.centres.iter().map(of_dofs).collect();
        for (motion, lift) in &self.lifts {
            axpy(motion.at(Point::origin(), time)?, lift.as_flattened(), raw.as_flattened_mut());
        }
        for (Sampled { section, .. }, curvature) in self.centres.iter().zip(raw) {
            let moments = Moments::of_curvature(section, curvature);
            sampled.moment_raw.push([moments.xx, moments.yy, moments.xy]);
            sampled.von_mises_raw.push(section.stress_per_moment() * moments.von_mises());
        }
        Ok(sampled)
    }
}

/// Points or small cells, and the cell of the mesh that contains each.
pub(super) type Located<'l, T> = (&'l [T], &'l [usize]);

/// Points and centres of small cells with their sections and weights.
type SampledPlaces = (Vec<Sampled<Vec<f64>>>, Vec<Sampled<Vec<[f64; 3]>>>);

fn sampled<P: Partition>(
    ground: &BuildContext<P>,
    curvatures: &PlateCurvatures,
    (points, cell_of): Located<[f64; 2]>,
    (small, parents): Located<Vec<usize>>,
) -> Result<SampledPlaces> {
    let (mesh, body) = (ground.mesh, &curvatures.body);
    let point = |(at, &cell): (&[f64; 2], &usize)| {
        let at = Point::from(*at);
        let weights = assembly::vertex_weights(&mesh.element(cell)?, at);
        Ok(Sampled { cell, section: body.section(cell, at)?, weights })
    };
    let centre = |(corners, &cell): (&Vec<usize>, &usize)| {
        let sum = |axis: usize| corners.iter().map(|&corner| points[corner][axis]).sum::<f64>();
        let at = Point::new(sum(0), sum(1)) / corners.len() as f64;
        let weights = mesh.element(cell)?.basis_at(at).iter().map(|of| of.hessian).collect();
        Ok(Sampled { cell, section: body.section(cell, at)?, weights })
    };
    let sampled = points.iter().zip(cell_of).map(point).collect::<Result<_>>()?;
    Ok((sampled, small.iter().zip(parents).map(centre).collect::<Result<_>>()?))
}

/// Returns the sum of triples with weights.
fn sum_of_sites(weights: &[f64], values: impl Iterator<Item = [f64; 3]>) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (weight, value) in weights.iter().zip(values) {
        sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
    }
    sums
}

/// Returns the sum of triples of weights with values.
fn sum(weights: &[[f64; 3]], values: impl Iterator<Item = f64>) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (weights, value) in weights.iter().zip(values) {
        sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += weight * value);
    }
    sums
}
