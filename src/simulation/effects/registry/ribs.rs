//! Ribs: beams along lines of the plate.

use crate::assembly::{self, BeamPiece, BeamStiffness};
use crate::communicator::Communicator;
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use crate::scene::{Rib, RibPath};
use crate::simulation::effects::contributions::Contributions;
use crate::simulation::effects::ground::BuildContext;
use crate::simulation::regions::{named, require};
use std::collections::HashSet;

/// Distance of two places, relative to the length of a rib, below which they are one.
const SAME: f64 = 1e-9;

/// Adds all ribs, whose masses the cells carry. Collective.
pub(super) fn add<P: Partition>(ground: &BuildContext<P>, sum: &mut Contributions) -> Result<()> {
    let (mesh, comm) = (ground.mesh, ground.comm());
    let mut stiff = Vec::new();
    for (number, rib) in ground.scene.attachments.ribs.iter().enumerate() {
        let stiffness = BeamStiffness { bending: rib.bending, torsion: rib.torsion };
        for piece in pieces(mesh, comm, rib, number)? {
            if rib.mass > 0.0 {
                sum.carried.extend(piece.masses(rib.mass).map(|(point, mass)| (piece.cell, point, mass)));
            }
            stiff.push((piece, stiffness));
        }
    }
    sum.add_stiffness(comm.all_ok(assembly::beams(mesh, &stiff))?, false, None);
    Ok(())
}

/// Returns the pieces of a rib on this process; cells on both sides of a line share it. Collective.
fn pieces(mesh: &Mesh, comm: &impl Communicator, rib: &Rib, number: usize) -> Result<Vec<BeamPiece>> {
    match &rib.path {
        RibPath::Line(ends) => along_line(mesh, comm, ends.map(Point::from), &format!("rib.{number}")),
        RibPath::Edge(edge) => {
            let sides = named(&mesh.edges, "edge", edge, comm, &format!("rib.{number}"))?;
            Ok(along_sides(mesh, comm, sides))
        }
    }
}

/// Returns the pieces of sides of this process. Collective.
fn along_sides(mesh: &Mesh, comm: &impl Communicator, sides: &[[usize; 2]]) -> Vec<BeamPiece> {
    let sorted = |[a, b]: [usize; 2]| [a.min(b), a.max(b)];
    let sides: HashSet<[usize; 2]> = sides.iter().copied().map(sorted).collect();
    let mut pairs: Vec<(usize, [usize; 2])> = Vec::new();
    for (number, cell) in mesh.cells.iter().enumerate() {
        let along = cell.edges().map(sorted).filter(|side| sides.contains(side));
        pairs.extend(along.map(|side| (number, side)));
    }
    let middle = |[a, b]: [usize; 2]| -> [f64; 2] { nalgebra::center(&mesh.nodes[a], &mesh.nodes[b]).into() };
    let middles: Vec<[f64; 2]> = pairs.iter().map(|(_, side)| middle(*side)).collect();
    let (middles, first) = comm.all_gather_with_offset(&middles);
    let others = [&middles[..first], &middles[first + pairs.len()..]].concat();
    let piece = |&(cell, side): &(usize, [usize; 2])| {
        let here = pairs.iter().filter(|(_, other)| *other == side).count();
        let there = others.iter().filter(|other| **other == middle(side)).count();
        BeamPiece { cell, ends: side.map(|node| mesh.nodes[node]), share: 1.0 / (here + there) as f64 }
    };
    pairs.iter().map(piece).collect()
}

/// Returns the pieces of a line on this process, cut at the borders of all sub-cells. Collective.
fn along_line(mesh: &Mesh, comm: &impl Communicator, ends: [Point; 2], key: &str) -> Result<Vec<BeamPiece>> {
    let crossed = comm.all_ok(assembly::line_in_cells(mesh, ends))?;
    let spans: Vec<[f64; 2]> = crossed.iter().map(|(_, span)| *span).collect();
    let (spans, _) = comm.all_gather_with_offset(&spans);
    let mut cuts: Vec<f64> = spans.as_flattened().iter().copied().chain([0.0, 1.0]).collect();
    cuts.sort_by(f64::total_cmp);
    cuts.dedup_by(|next, last| *next - *last <= SAME);
    // The ends stay where they are, whatever cut is next to them.
    if let [first, .., last] = &mut cuts[..] {
        (*first, *last) = (0.0, 1.0);
    }
    let point = |share: f64| ends[0] + share * (ends[1] - ends[0]);
    let mut pieces = Vec::new();
    for cut in cuts.windows(2) {
        let middle = 0.5 * (cut[0] + cut[1]);
        // The sub-cells on both sides of a border share it.
        let is_holder = |[from, to]: &[f64; 2]| (*from..=*to).contains(&middle);
        let holders = spans.iter().filter(|span| is_holder(span)).count();
        require(comm, holders > 0, || {
            let [from, to] = [cut[0], cut[1]].map(point);
            format!(
                "{key}.line: it leaves the plate between ({:.6}, {:.6}) and ({:.6}, {:.6})",
                from.x, from.y, to.x, to.y
            )
        })?;
        let (ends, share) = ([cut[0], cut[1]].map(point), 1.0 / holders as f64);
        let held = crossed.iter().filter(|(_, span)| is_holder(span));
        pieces.extend(held.map(|&(cell, _)| BeamPiece { cell, ends, share }));
    }
    Ok(pieces)
}
