//! Moments and stresses in snapshots.

use super::effects::BuildContext;
use super::stresses::{CurvaturesOfShape, MidplaneStresses, PlateCurvatures};
use crate::assembly::{self, CellArrays};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::plate::{Section, Sections};
use crate::stress::{Moments, PlateSurface};

/// Moments and stresses of a snapshot.
#[derive(Debug, Clone, Default)]
pub struct SnapshotStresses {
    /// Recovered moments M_xx, M_yy and M_xy, in N m/m, one entry per point.
    pub moment: Vec<[f64; 3]>,
    /// Largest and least principal value of the recovered moments, in N m/m, one entry per point.
    pub principal: Vec<[f64; 2]>,
    /// Recovered stresses xx, yy and xy at the upper surface, in Pa, one entry per point.
    pub stress_top: Vec<[f64; 3]>,
    /// Von Mises stress of the recovered moments, in Pa, one entry per point; the larger of both
    /// surfaces where there are forces in the plane.
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
    curvatures: CurvaturesOfShape,
    /// Sites of the nodes of each cell.
    sites: Vec<Vec<usize>>,
    /// Weights of the sites of its cell in the curvature at each point.
    points: Vec<Sampled<Vec<f64>>>,
    /// Curvatures of the basis functions at the centre of each small cell.
    centres: Vec<Sampled<Vec<[f64; 3]>>>,
    /// Stresses of the mid-plane at the points, then at the centres.
    middle: MidplaneStresses,
}

impl StressFields {
    /// Prepares the sampling at points, each in its cell of the mesh, and at the centres of small
    /// cells, each given by its corners and its cell. Collective.
    pub fn new<P: Partition>(
        ground: &BuildContext<P>,
        curvatures: &PlateCurvatures,
        points: Located<[f64; 2]>,
        small: Located<Vec<usize>>,
    ) -> Result<StressFields> {
        let part = sampled(ground, curvatures, points, small);
        let (points, centres, middle) = ground.comm().all_ok(part)?;
        let of_cell = |cell: usize| curvatures.recovery.of_cell(cell).to_vec();
        Ok(StressFields {
            curvatures: curvatures.of_shape(ground.partition),
            sites: (0..ground.mesh.cells.len()).map(of_cell).collect(),
            points,
            centres,
            middle,
        })
    }

    /// Returns moments and stresses for deflections and slopes at all nodes, three per node, with
    /// the cells over these. Collective.
    pub fn sample(&self, cells: &[CellArrays], shape: &[f64]) -> Result<SnapshotStresses> {
        let mut sampled = SnapshotStresses::default();
        let curvatures = (self.curvatures)(shape)?;
        let middle = self.middle.of_shape(shape)?;
        let middle_of = |place: usize| middle.get(place).copied().unwrap_or_default();
        for (place, Sampled { cell, section, weights }) in self.points.iter().enumerate() {
            let curvature =
                sum(weights.iter().copied().zip(self.sites[*cell].iter().map(|&site| curvatures[site])));
            let moments = Moments::of_curvature(section, curvature);
            let Moments { xx, yy, xy } = moments;
            sampled.moment.push([xx, yy, xy]);
            sampled.principal.push(moments.principal());
            let bending = moments.times(section.stress_per_moment());
            let Moments { xx, yy, xy } = bending.at(PlateSurface::Top, middle_of(place));
            sampled.stress_top.push([xx, yy, xy]);
            sampled.von_mises.push(bending.larger(middle_of(place)).1);
        }
        for (centre, Sampled { cell, section, weights }) in self.centres.iter().enumerate() {
            let curvature = sum(cells[*cell].values(shape).into_iter().zip(weights.iter().copied()));
            let moments = Moments::of_curvature(section, curvature);
            sampled.moment_raw.push([moments.xx, moments.yy, moments.xy]);
            let bending = moments.times(section.stress_per_moment());
            sampled.von_mises_raw.push(bending.larger(middle_of(self.points.len() + centre)).1);
        }
        Ok(sampled)
    }
}

/// Points or small cells, and the cell of the mesh that contains each.
pub(super) type Located<'l, T> = (&'l [T], &'l [usize]);

/// Points and centres of small cells with their sections and weights, and the stresses of the
/// mid-plane at both.
type SampledPlaces = (Vec<Sampled<Vec<f64>>>, Vec<Sampled<Vec<[f64; 3]>>>, MidplaneStresses);

fn sampled<P: Partition>(
    ground: &BuildContext<P>,
    curvatures: &PlateCurvatures,
    (points, cell_of): Located<[f64; 2]>,
    (small, parents): Located<Vec<usize>>,
) -> Result<SampledPlaces> {
    let (mesh, body) = (ground.mesh, &curvatures.body);
    let centre_of = |corners: &Vec<usize>| {
        let sum = |axis: usize| corners.iter().map(|&corner| points[corner][axis]).sum::<f64>();
        Point::new(sum(0), sum(1)) / corners.len() as f64
    };
    let point = |(place, &cell): (&[f64; 2], &usize)| {
        let place = Point::from(*place);
        let weights = assembly::vertex_weights(&mesh.element(cell)?, place);
        Ok(Sampled { cell, section: body.section(cell, place)?, weights })
    };
    let centre = |(corners, &cell): (&Vec<usize>, &usize)| {
        let place = centre_of(corners);
        let weights = mesh.element(cell)?.basis_at(place).iter().map(|basis| basis.hessian).collect();
        Ok(Sampled { cell, section: body.section(cell, place)?, weights })
    };
    let at_points = cell_of.iter().zip(points).map(|(&cell, &place)| (cell, Point::from(place)));
    let at_centres = parents.iter().zip(small).map(|(&cell, corners)| (cell, centre_of(corners)));
    let middle = curvatures.middle_of(mesh, at_points.chain(at_centres))?;
    let sampled = points.iter().zip(cell_of).map(point).collect::<Result<_>>()?;
    Ok((sampled, small.iter().zip(parents).map(centre).collect::<Result<_>>()?, middle))
}

/// Returns the sum of triples with factors.
fn sum(terms: impl Iterator<Item = (f64, [f64; 3])>) -> [f64; 3] {
    terms.fold([0.0; 3], |mut sums, (factor, triple)| {
        sums.iter_mut().zip(triple).for_each(|(sum, value)| *sum += factor * value);
        sums
    })
}
