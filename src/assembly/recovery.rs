//! Recovery of continuous curvatures from the curvatures of the elements.
//!
//! The curvatures of an element are linear on each of its pieces and jump between them; they
//! converge with the size h of the cells only. At a node, an affine function fitted to them over
//! the cells around it is more accurate (O. C. Zienkiewicz and J. Z. Zhu, *The superconvergent
//! patch recovery and a posteriori error estimates*, International Journal for Numerical Methods in
//! Engineering 33, 1992). The least squares are weighted by area, at the three points of a rule of
//! degree 2 on each piece. On the border of the plate, where there are cells on one side only, the
//! value is the mean of the affine functions of the inner nodes of the cells around, continued to
//! the node. Between the nodes of a cell the recovered curvature is linear on each piece.
//!
//! Only the cells of one part of the plate take part in a fit, since curvatures jump where
//! thickness or material do. A node between parts has one recovered curvature per part.

use super::CellArrays;
use super::border::{self, SiteSums};
use super::patches::{Corners, CurvatureRow, Patches, SitePatch};
use super::samples::{ClassSamples, Sample, of_element};
use super::site_blocks::StencilSums;
use super::sites::{RecoverySite, sum_over_ranks};
use crate::dof_map::PER_NODE;
use crate::element::{Element, with_element};
use crate::error::Result;
use crate::linalg::CellClass;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use std::collections::{BTreeSet, HashMap};

/// Recovery of curvatures at the nodes of each part of the plate.
///
/// A *fit* is the value (0) of the affine function at a site inside its part, or its derivative
/// along x (1) or y (2). The curvature at a site is a sum of fits.
#[derive(Clone, Debug)]
pub struct Recovery {
    /// Sites of the fits.
    pub sites: Vec<RecoverySite>,
    /// Sites of the nodes of each cell.
    cell_sites: Vec<Vec<usize>>,
    /// Number of parts.
    parts: usize,
    /// Needed fits: site and number of the fit.
    fits: Vec<(usize, usize)>,
    /// Weights of the dofs of this rank's cells in each fit.
    patches: Patches,
    /// Fits whose weighted sum is the curvature at each site.
    sums: SiteSums,
    /// Sums over this rank's dofs: the fits where the mesh is divided among ranks, otherwise the
    /// curvatures at the sites.
    stencils: StencilSums,
}

impl Recovery {
    /// Prepares the recovery for cells that belong to `parts` parts. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn new<P: Partition>(
        mesh: &Mesh,
        cells: &[CellArrays],
        part_of: &dyn Fn(usize) -> usize,
        parts: usize,
        partition: &P,
    ) -> Result<Recovery> {
        let (sites, cell_sites) = sites(mesh, part_of);
        let mut samples: HashMap<CellClass, ClassSamples> = HashMap::new();
        for (number, cell) in cells.iter().enumerate() {
            if let std::collections::hash_map::Entry::Vacant(new) = samples.entry(cell.class) {
                new.insert(with_element!(&mesh.element(number)?, element => of_element(element)));
            }
        }
        let mut corners: Vec<Corners> = vec![Vec::new(); sites.len()];
        for (number, cell_sites) in cell_sites.iter().enumerate() {
            cell_sites.iter().enumerate().for_each(|(corner, &site)| corners[site].push((number, corner)));
        }
        let squares = |corners: &Corners| {
            let mut sums = [0.0; 6];
            for (number, corner) in corners {
                let class = &samples[&cells[*number].class];
                for Sample { offset, weight, .. } in &class.samples {
                    let d = offset - class.corners[*corner];
                    let terms = [1.0, d.x, d.y, d.x * d.x, d.x * d.y, d.y * d.y];
                    sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
                }
            }
            sums
        };
        let mut squares: Vec<[f64; 6]> = corners.iter().map(squares).collect();
        sum_over_ranks(&sites, parts, partition, &mut squares)?;
        let arm = |cell: usize, [from, to]: [usize; 2]| {
            let corners = &samples[&cells[cell].class].corners;
            corners[to] - corners[from]
        };
        let (fits, sums) = border::sums(mesh, &sites, &cell_sites, &arm, parts, partition)?;
        let patch = |(corners, squares)| SitePatch { corners, squares };
        let site_patches: Vec<SitePatch> = corners.iter().zip(squares).map(patch).collect();
        let cell = |number: usize| (mesh.cells[number].nodes(), cells[number].class);
        let patches = Patches::new(&fits, &site_patches, &cell, &samples);
        let stencil = |site: usize, terms: &[(usize, f64)]| {
            let RecoverySite { node, .. } = sites[site];
            (node, patches.stencil(node, terms))
        };
        let stencils = if P::DIVIDES {
            StencilSums::new((0..fits.len()).map(|number| stencil(fits[number].0, &[(number, 1.0)])))
        } else {
            StencilSums::new((0..sites.len()).map(|site| stencil(site, sums.terms(site))))
        };
        Ok(Recovery { sites, cell_sites, parts, fits, patches, sums, stencils })
    }

    /// Returns the sites of the nodes of a cell.
    pub fn of_cell(&self, cell: usize) -> &[usize] {
        &self.cell_sites[cell]
    }

    /// Returns the weights in a fit of the dofs of this rank's cells, three dofs per node.
    pub fn row(&self, fit: usize) -> CurvatureRow {
        self.patches.row(fit)
    }

    /// Returns the curvatures at the sites for a deflection given by w, w_x and w_y at all nodes of
    /// this rank's cells, three values per node. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn curvatures<P: Partition>(&self, shape: &[f64], partition: &P) -> Result<Vec<[f64; 3]>> {
        let sums = self.stencils.compute(shape);
        if P::DIVIDES { self.sum_fits(&sums, partition) } else { Ok(sums) }
    }

    /// Returns the curvatures at the sites from this rank's shares of the fits. Collective.
    fn sum_fits<P: Partition>(&self, shares: &[[f64; 3]], partition: &P) -> Result<Vec<[f64; 3]>> {
        let mut site_fits = vec![[0.0; 9]; self.sites.len()];
        for ((site, which), share) in self.fits.iter().zip(shares) {
            site_fits[*site][3 * which..][..3].copy_from_slice(share);
        }
        sum_over_ranks(&self.sites, self.parts, partition, &mut site_fits)?;
        let sum = |site: usize| {
            let mut sums = [0.0; 3];
            for (fit, weight) in self.sums.terms(site) {
                let (inner, which) = self.fits[*fit];
                let fit = &site_fits[inner][3 * which..][..3];
                sums.iter_mut().zip(fit).for_each(|(sum, value)| *sum += weight * value);
            }
            sums
        };
        let mut sums: Vec<[f64; 3]> = (0..self.sites.len()).map(sum).collect();
        let mut shared = sums.clone();
        let is_inner = |site: usize| !self.sums.is_shared(site);
        (0..shared.len()).filter(|&site| is_inner(site)).for_each(|site| shared[site] = [0.0; 3]);
        sum_over_ranks(&self.sites, self.parts, partition, &mut shared)?;
        (0..sums.len()).filter(|&site| !is_inner(site)).for_each(|site| sums[site] = shared[site]);
        Ok(sums)
    }

    /// Returns the weights of the fits in a sum over the sites with these weights, the same on all
    /// ranks. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn weights_of_fits<P: Partition>(&self, weights: &[f64], partition: &P) -> Result<Vec<f64>> {
        let mut site_weights = vec![[0.0; 3]; self.sites.len()];
        let weighted = || weights.iter().enumerate().filter(|(_, weight)| **weight != 0.0);
        for (site, weight) in weighted().filter(|(site, _)| self.sums.is_shared(*site)) {
            for (fit, share) in self.sums.terms(site) {
                let (site, which) = self.fits[*fit];
                site_weights[site][which] += weight * share;
            }
        }
        sum_over_ranks(&self.sites, self.parts, partition, &mut site_weights)?;
        let mut fit_weights: Vec<f64> =
            self.fits.iter().map(|(site, which)| site_weights[*site][*which]).collect();
        for (site, weight) in weighted().filter(|(site, _)| !self.sums.is_shared(*site)) {
            self.sums.terms(site).iter().for_each(|(fit, share)| fit_weights[*fit] += weight * share);
        }
        Ok(fit_weights)
    }
}

/// Returns the sites of a mesh, by part and node, and the sites of the nodes of each cell.
fn sites(mesh: &Mesh, part_of: &dyn Fn(usize) -> usize) -> (Vec<RecoverySite>, Vec<Vec<usize>>) {
    let site = |cell: usize| {
        let part = part_of(cell);
        mesh.cells[cell].nodes().iter().map(move |&node| RecoverySite { part, node })
    };
    let ordered: BTreeSet<RecoverySite> = (0..mesh.cells.len()).flat_map(site).collect();
    let sites: Vec<RecoverySite> = ordered.into_iter().collect();
    let numbers: HashMap<RecoverySite, usize> = sites.iter().copied().zip(0..).collect();
    let cell_sites =
        (0..mesh.cells.len()).map(|cell| site(cell).map(|site| numbers[&site]).collect()).collect();
    (sites, cell_sites)
}

/// Returns the weights of a cell's vertices in the value, at a point of the cell, of the function
/// that is linear on each piece of the cell.
///
/// The value at the centre of a quadrilateral, where its diagonals cross, is the mean of the values
/// interpolated along the diagonals. At the centre of a triangle it is the mean of its vertices.
pub fn vertex_weights(element: &crate::element::AnyElement, point: Point) -> Vec<f64> {
    fn weights_of<const N: usize>(element: &Element<N>, point: Point) -> Vec<f64> {
        let (piece, [u, v, w]) = element.locate(point);
        let count = N / PER_NODE;
        let mut weights = vec![0.0; count];
        weights[piece] += u;
        weights[(piece + 1) % count] += v;
        if count == 3 {
            weights.iter_mut().for_each(|weight| *weight += w / 3.0);
            return weights;
        }
        let vertex = |i: usize| element.pieces[i].vertices[0];
        let centre = element.pieces[0].vertices[2];
        for start in 0..2 {
            let side = vertex(start + 2) - vertex(start);
            let along = (centre - vertex(start)).dot(&side) / side.norm_squared();
            weights[start] += 0.5 * w * (1.0 - along);
            weights[start + 2] += 0.5 * w * along;
        }
        weights
    }
    with_element!(element, element => weights_of(element, point))
}
