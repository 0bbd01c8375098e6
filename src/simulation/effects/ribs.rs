//! Ribs of this process's part of the plate.

use super::elastic_edges::own_sides;
use super::ground::{BuildContext, PointEvaluation};
use super::lumps::LumpedMass;
use crate::assembly::{self, BeamPiece, BeamStiffness, Probe};
use crate::communicator::Communicator;
use crate::dof_map::PER_NODE;
use crate::error::Result;
use crate::linalg::ElementMatrix;
use crate::mesh::Point;
use crate::partition::Partition;
use crate::scene::{Rib, RibPath};
use crate::simulation::regions::require;
use std::collections::BTreeMap;

/// Beams along lines of the plate.
#[derive(Default)]
pub(super) struct Ribs {
    /// Contributions to K, each with its cell.
    pub blocks: Vec<(usize, ElementMatrix)>,
    /// Masses at the points of a quadrature rule, for the consistent mass.
    pub points: Vec<LumpedMass>,
    /// Masses with the mean deflection of a rib over a cell, for the singular mass, each with the
    /// index of its rib.
    pub means: Vec<LumpedMass>,
    pub rib_of_mean: Vec<usize>,
}

/// Part of a rib in a cell.
#[derive(Default)]
struct PartInCell {
    /// Length, in m, and its first moments about the axes, in m2.
    length: f64,
    moments: [f64; 2],
    /// Integral of the deflection, as weights of deflections and slopes of all nodes.
    integral: BTreeMap<usize, f64>,
}

/// Distance of two places, relative to the length of a rib, below which they are one.
const SAME: f64 = 1e-9;

impl Ribs {
    /// Locates all ribs. Collective.
    pub fn new<P: Partition>(ground: &BuildContext<P>) -> Result<Ribs> {
        let mut ribs = Ribs::default();
        let mut stiff = Vec::new();
        for (number, rib) in ground.scene.attachments.ribs.iter().enumerate() {
            let pieces = pieces(ground, rib, &format!("rib.{number}"))?;
            let of = BeamStiffness { bending: rib.bending, torsion: rib.torsion };
            stiff.extend(pieces.iter().map(|piece| (*piece, of)));
            if rib.mass > 0.0 {
                ground.comm().all_ok(ribs.add_masses(ground, rib.mass, &pieces))?;
                ribs.rib_of_mean.resize(ribs.means.len(), number);
            }
        }
        ribs.blocks = ground.comm().all_ok(assembly::beams(ground.mesh, ground.cells, &stiff))?;
        Ok(ribs)
    }

    /// Adds the masses of a rib with a mass per length, in kg/m.
    fn add_masses<P: Partition>(
        &mut self,
        ground: &BuildContext<P>,
        mass: f64,
        pieces: &[BeamPiece],
    ) -> Result<()> {
        let spot = |of_shape: Probe| PointEvaluation { free: of_shape.within(ground.space), of_shape };
        let mut parts: BTreeMap<usize, PartInCell> = BTreeMap::new();
        for piece in pieces {
            for (at, weight, of_shape) in piece.deflections(ground.mesh)? {
                self.points.push(LumpedMass { amount: mass * weight, at, spot: spot(of_shape) });
            }
            let part = parts.entry(piece.cell).or_default();
            let middle = nalgebra::center(&piece.ends[0], &piece.ends[1]);
            part.length += piece.length();
            part.moments[0] += piece.length() * middle.x;
            part.moments[1] += piece.length() * middle.y;
            piece.add_integral(ground.mesh, &mut part.integral)?;
        }
        for PartInCell { length, moments: [x, y], integral } in parts.into_values() {
            let mean = integral.into_iter().map(|(dof, weight)| (dof, weight / length)).collect();
            self.means.push(LumpedMass {
                amount: mass * length,
                at: Point::new(x / length, y / length),
                spot: spot(Probe::from_terms(mean)),
            });
        }
        Ok(())
    }

    /// Adds the forces of the ribs under a shape (three values per node) to `force`, in N.
    pub fn add_forces<P: Partition>(&self, ground: &BuildContext<P>, shape: &[f64], force: &mut [f64]) {
        add_forces(self.blocks.iter(), ground, shape, force);
    }
}

/// Adds the forces of matrices on cells under a shape (three values per node) to `force`, in N.
pub(super) fn add_forces<'b, P: Partition>(
    blocks: impl Iterator<Item = &'b (usize, ElementMatrix)>,
    ground: &BuildContext<P>,
    shape: &[f64],
    force: &mut [f64],
) {
    for (cell, block) in blocks {
        let nodes = ground.mesh.cells[*cell].nodes();
        let values = nodes.iter().flat_map(|&node| &shape[PER_NODE * node..][..PER_NODE]);
        let values: Vec<f64> = values.copied().collect();
        ground.cells[*cell].add_product(&block.matrix, &values, force);
    }
}

/// Returns the pieces of a rib on this process: each belongs to one process only. Collective.
fn pieces<P: Partition>(ground: &BuildContext<P>, rib: &Rib, key: &str) -> Result<Vec<BeamPiece>> {
    match &rib.path {
        RibPath::Line(ends) => along_line(ground, ends.map(Point::from), key),
        RibPath::Edge(edge) => {
            let sides = ground.mesh.edges.get(edge).map_or(&[][..], Vec::as_slice);
            require(ground.comm(), !sides.is_empty(), || {
                let known: Vec<&str> = ground.mesh.edges.keys().map(String::as_str).collect();
                format!("{key}.edge: the mesh has no edge named \"{edge}\"; it has: {}", known.join(", "))
            })?;
            let sides = own_sides(ground.mesh, sides.to_vec(), ground.comm());
            let cell_at = assembly::cells_at_sides(ground.mesh);
            let piece = |[a, b]: [usize; 2]| {
                let &cell = cell_at.get(&[a.min(b), a.max(b)])?;
                Some(BeamPiece { cell, ends: [a, b].map(|node| ground.mesh.nodes[node]) })
            };
            Ok(sides.into_iter().filter_map(piece).collect())
        }
    }
}

/// Returns the pieces of a line on this process, cut at the borders of all sub-cells. Collective.
fn along_line<P: Partition>(ground: &BuildContext<P>, ends: [Point; 2], key: &str) -> Result<Vec<BeamPiece>> {
    let comm = ground.comm();
    let own = comm.all_ok(assembly::line_in_cells(ground.mesh, ends))?;
    let spans: Vec<[f64; 2]> = own.iter().map(|(_, span)| *span).collect();
    let (all, first) = comm.all_gather_with_offset(&spans);
    let mut cuts: Vec<f64> = all.as_flattened().iter().copied().chain([0.0, 1.0]).collect();
    cuts.sort_by(f64::total_cmp);
    cuts.dedup_by(|next, last| *next - *last <= SAME);
    // The ends stay where they are, whatever cut is next to them.
    if let [first, .., last] = &mut cuts[..] {
        (*first, *last) = (0.0, 1.0);
    }
    let at = |share: f64| ends[0] + share * (ends[1] - ends[0]);
    let mut pieces = Vec::new();
    for cut in cuts.windows(2) {
        let middle = 0.5 * (cut[0] + cut[1]);
        // A border belongs to several cells, of which the first counts.
        let holder = all.iter().position(|[from, to]| (*from..=*to).contains(&middle));
        require(comm, holder.is_some(), || {
            let [from, to] = [cut[0], cut[1]].map(at);
            format!(
                "{key}.line: it leaves the plate between ({:.6}, {:.6}) and ({:.6}, {:.6})",
                from.x, from.y, to.x, to.y
            )
        })?;
        let is_own = |holder: usize| holder.checked_sub(first).and_then(|k| own.get(k));
        if let Some((cell, _)) = holder.and_then(is_own) {
            pieces.push(BeamPiece { cell: *cell, ends: [cut[0], cut[1]].map(at) });
        }
    }
    Ok(pieces)
}
