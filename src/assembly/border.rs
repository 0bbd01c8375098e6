//! Nodes on the border of a part of the plate, and the inner nodes beside them.

use super::sites::{RecoverySite, sum_over_ranks};
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use nalgebra::Vector2;
use std::collections::{BTreeMap, BTreeSet, HashMap};

/// Site and number of a fit: value (0), derivative along x (1) or y (2).
pub(super) type Fit = (usize, usize);

/// Fits whose weighted sum is the curvature at each site.
#[derive(Clone, Debug)]
pub(super) struct SiteSums {
    /// Indices of fits and their weights, site by site.
    terms: Vec<(usize, f64)>,
    /// First term of each site, and the end of the last one.
    starts: Vec<usize>,
    /// Whether a site lies on the border of its part, so that other ranks may add to its sum.
    is_shared: Vec<bool>,
}

impl SiteSums {
    /// Returns the indices and weights of the fits of a site.
    pub fn terms(&self, site: usize) -> &[(usize, f64)] {
        &self.terms[self.starts[site]..self.starts[site + 1]]
    }

    /// Returns whether a site lies on the border of its part.
    pub fn is_shared(&self, site: usize) -> bool {
        self.is_shared[site]
    }
}

/// Part of a full turn that the angles of the cells around an inner node reach.
const TURN: f64 = 1.0 - 1e-6;

/// Returns the fits that the curvatures at the sites of a mesh need, by number and site, and their
/// sums. `arm` returns the vector from one corner of a cell to another. Collective.
///
/// # Errors
/// Returns the errors of communication.
pub(super) fn sums<P: Partition>(
    mesh: &Mesh,
    sites: &[RecoverySite],
    cell_sites: &[Vec<usize>],
    arm: &dyn Fn(usize, [usize; 2]) -> Vector2<f64>,
    parts: usize,
    partition: &P,
) -> Result<(Vec<Fit>, SiteSums)> {
    let mut turns = vec![[0.0]; sites.len()];
    for (cell, corners) in cell_sites.iter().enumerate() {
        let vertices = mesh.vertices(cell);
        corners.iter().enumerate().for_each(|(corner, &site)| turns[site][0] += turn(&vertices, corner));
    }
    sum_over_ranks(sites, parts, partition, &mut turns)?;
    let is_inner = |site: usize| turns[site][0] > TURN;
    // Pairs of a site on the border and an inner one: the number of cells that have both, and the
    // vector from the inner site to the other.
    let mut pairs: Vec<BTreeMap<usize, (f64, Vector2<f64>)>> = vec![BTreeMap::new(); sites.len()];
    let mut counts = vec![[0.0]; sites.len()];
    for (cell, cell_sites) in cell_sites.iter().enumerate() {
        let corners = || cell_sites.iter().copied().enumerate();
        for (corner, site) in corners().filter(|&(_, site)| !is_inner(site)) {
            for (from, inner) in corners().filter(|&(_, inner)| is_inner(inner)) {
                pairs[site].entry(inner).or_insert_with(|| (0.0, arm(cell, [from, corner]))).0 += 1.0;
                counts[site][0] += 1.0;
            }
        }
    }
    sum_over_ranks(sites, parts, partition, &mut counts)?;
    // A rank may have cells around an inner site whose neighbour on the border is on another rank.
    let mut needed = vec![[0.0]; sites.len()];
    pairs.iter().flatten().for_each(|(inner, _)| needed[*inner][0] = 1.0);
    sum_over_ranks(sites, parts, partition, &mut needed)?;
    let is_alone = |site: usize| is_inner(site) || counts[site][0] == 0.0;
    // A site without inner neighbours keeps its own fit.
    let alone = (0..sites.len()).filter(|&site| is_alone(site)).map(|site| (0, site));
    let inner = (0..sites.len()).filter(|&site| needed[site][0] > 0.0);
    let fits: BTreeSet<(usize, usize)> =
        alone.chain(inner.flat_map(|site| (0..3).map(move |which| (which, site)))).collect();
    let number_of: HashMap<(usize, usize), usize> = fits.iter().copied().zip(0..).collect();
    let mut sums = SiteSums { terms: Vec::new(), starts: vec![0], is_shared: Vec::new() };
    for site in 0..sites.len() {
        sums.is_shared.push(!is_alone(site));
        if is_alone(site) {
            sums.terms.push((number_of[&(0, site)], 1.0));
        } else {
            for (&inner, (count, away)) in &pairs[site] {
                let weight = count / counts[site][0];
                let weights = [weight, weight * away.x, weight * away.y];
                sums.terms.extend((0..3).map(|which| (number_of[&(which, inner)], weights[which])));
            }
        }
        sums.starts.push(sums.terms.len());
    }
    let fits = fits.into_iter().map(|(which, site)| (site, which)).collect();
    Ok((fits, sums))
}

/// Returns the angle of a corner of a polygon, as a part of a full turn.
fn turn(vertices: &[Point], corner: usize) -> f64 {
    let count = vertices.len();
    let forth = vertices[(corner + 1) % count] - vertices[corner];
    let back = vertices[(corner + count - 1) % count] - vertices[corner];
    forth.perp(&back).atan2(forth.dot(&back)) / std::f64::consts::TAU
}
