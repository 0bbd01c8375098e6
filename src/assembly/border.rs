//! Nodes on the border of a part of the plate, and the inner nodes beside them.

use super::sites::{RecoverySite, sum_over_ranks};
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use std::collections::{BTreeMap, HashMap};

/// Fits that a recovery needs, each a site and the number of a fit (value, derivatives along x and
/// y), and the fits whose weighted sum is the curvature at each site, with whether ranks share it.
pub(super) type Sums = (Vec<(usize, usize)>, Vec<(bool, Vec<(usize, f64)>)>);

/// Part of a full turn that the angles of the cells around an inner node reach.
const TURN: f64 = 1.0 - 1e-6;

/// Returns the fits that the curvatures at the sites of a mesh need. Collective.
///
/// # Errors
/// Returns the errors of communication.
pub(super) fn sums<P: Partition>(
    mesh: &Mesh,
    sites: &[RecoverySite],
    of_cells: &[Vec<usize>],
    parts: usize,
    partition: &P,
) -> Result<Sums> {
    let mut turns = vec![[0.0]; sites.len()];
    for (cell, own) in of_cells.iter().enumerate() {
        let vertices = mesh.vertices(cell);
        own.iter().enumerate().for_each(|(corner, &site)| turns[site][0] += turn(&vertices, corner));
    }
    sum_over_ranks(sites, parts, partition, &mut turns)?;
    let is_inner = |site: usize| turns[site][0] > TURN;
    // Pairs of a site on the border and an inner one, once per cell that has both.
    let mut pairs: Vec<BTreeMap<usize, f64>> = vec![BTreeMap::new(); sites.len()];
    let mut counts = vec![[0.0]; sites.len()];
    for own in of_cells {
        for &site in own.iter().filter(|&&site| !is_inner(site)) {
            for &inner in own.iter().filter(|&&inner| is_inner(inner)) {
                *pairs[site].entry(inner).or_default() += 1.0;
                counts[site][0] += 1.0;
            }
        }
    }
    sum_over_ranks(sites, parts, partition, &mut counts)?;
    // A rank may have cells around an inner site whose neighbour on the border is on another rank.
    let mut needed = vec![[0.0]; sites.len()];
    pairs.iter().flatten().for_each(|(inner, _)| needed[*inner][0] = 1.0);
    sum_over_ranks(sites, parts, partition, &mut needed)?;
    let (mut fits, mut numbers) = (Vec::new(), HashMap::new());
    let mut number = |fit: (usize, usize)| {
        *numbers.entry(fit).or_insert_with(|| {
            fits.push(fit);
            fits.len() - 1
        })
    };
    let mut sums = Vec::with_capacity(sites.len());
    for (site, of) in sites.iter().enumerate() {
        // A site without inner neighbours keeps its own fit.
        if is_inner(site) || counts[site][0] == 0.0 {
            sums.push((false, vec![(number((site, 0)), 1.0)]));
            (1..3).filter(|_| needed[site][0] > 0.0).for_each(|which| _ = number((site, which)));
            continue;
        }
        let mut terms = Vec::new();
        for (&inner, count) in &pairs[site] {
            let weight = count / counts[site][0];
            let away = mesh.nodes[of.node] - mesh.nodes[sites[inner].node];
            let weights = [weight, weight * away.x, weight * away.y];
            (0..3).for_each(|which| terms.push((number((inner, which)), weights[which])));
        }
        sums.push((true, terms));
    }
    Ok((fits, sums))
}

/// Returns the angle of a corner of a polygon, as a part of a full turn.
fn turn(vertices: &[Point], corner: usize) -> f64 {
    let count = vertices.len();
    let forth = vertices[(corner + 1) % count] - vertices[corner];
    let back = vertices[(corner + count - 1) % count] - vertices[corner];
    forth.perp(&back).atan2(forth.dot(&back)) / std::f64::consts::TAU
}
