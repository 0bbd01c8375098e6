//! Recovery of continuous curvatures from those of the elements.
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
use super::border;
use super::sites::{RecoverySite, sum_over_ranks};
use crate::dof_map::PER_NODE;
use crate::element::{Element, quadrature, with_element};
use crate::error::Result;
use crate::mesh::{Mesh, Point};
use crate::partition::Partition;
use nalgebra::{Matrix3, Vector2, Vector3};
use std::collections::{BTreeMap, HashMap};
use std::rc::Rc;

/// Curvatures (w_xx, w_xy, w_yy) at a site, as a sum over the dofs of this rank's cells: three
/// weights per dof.
pub type CurvatureRow = Vec<(usize, [f64; 3])>;

/// Recovery of curvatures at the nodes of each part of the plate.
///
/// A *fit* is the value (0) of the affine function at a site inside its part, or its derivative
/// along x (1) or y (2). The curvature at a site is a sum of fits.
#[derive(Clone, Debug)]
pub struct Recovery {
    sites: Vec<RecoverySite>,
    /// Sites of the nodes of each cell.
    of_cells: Vec<Vec<usize>>,
    /// Number of parts.
    parts: usize,
    /// Needed fits: site and number of the fit.
    fits: Vec<(usize, usize)>,
    /// This rank's share of each fit, over all dofs, three per node.
    rows: Vec<CurvatureRow>,
    /// Fits whose weighted sum is the curvature at each site; `true` where the site lies on the
    /// border of its part and other ranks may add to the sum.
    sums: Vec<(bool, Vec<(usize, f64)>)>,
}

/// Function that is called for each site of each cell. Its arguments are the cell, the site, the
/// vector from the site to the cell's first node (m), and the samples of the cell.
type ActOnSite<'a> = dyn FnMut(usize, usize, Vector2<f64>, &[Sample]) + 'a;

/// Point at which a cell's curvatures enter a fit.
struct Sample {
    /// Position relative to the first node of the cell, in m.
    offset: Vector2<f64>,
    /// Weight, an area in m^2.
    weight: f64,
    /// Curvatures of each basis function.
    curvatures: Vec<[f64; 3]>,
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
        let (sites, of_cells) = sites(mesh, part_of);
        let mut samples: HashMap<usize, Rc<[Sample]>> = HashMap::new();
        for (number, cell) in cells.iter().enumerate() {
            if let std::collections::hash_map::Entry::Vacant(new) = samples.entry(cell.class) {
                new.insert(with_element!(&mesh.element(number)?, element => of_element(element)));
            }
        }
        let around = |act: &mut ActOnSite| {
            for (number, own) in of_cells.iter().enumerate() {
                let nodes = mesh.cells[number].nodes();
                for (&site, &node) in own.iter().zip(nodes) {
                    let from = mesh.nodes[nodes[0]] - mesh.nodes[node];
                    act(number, site, from, &samples[&cells[number].class]);
                }
            }
        };
        let mut squares = vec![[0.0; 6]; sites.len()];
        around(&mut |_, site, from, samples| {
            for Sample { offset, weight, .. } in samples {
                let d = from + offset;
                let terms = [1.0, d.x, d.y, d.x * d.x, d.x * d.y, d.y * d.y];
                squares[site].iter_mut().zip(terms).for_each(|(sum, term)| *sum += weight * term);
            }
        });
        sum_over_ranks(&sites, parts, partition, &mut squares)?;
        let affine: Vec<Matrix3<f64>> = squares.iter().map(affine_fit).collect();
        let (fits, sums) = border::sums(mesh, &sites, &of_cells, parts, partition)?;
        let mut number_of = HashMap::new();
        for (number, (site, which)) in fits.iter().enumerate() {
            number_of.insert((*site, *which), number);
        }
        let mut rows = vec![BTreeMap::<usize, [f64; 3]>::new(); fits.len()];
        around(&mut |number, site, from, samples| {
            let wanted = [0, 1, 2].map(|which| number_of.get(&(site, which)));
            let nodes = mesh.cells[number].nodes();
            for Sample { offset, weight, curvatures } in samples {
                let d = from + offset;
                let shares = affine[site] * Vector3::new(1.0, d.x, d.y) * *weight;
                for (fit, share) in
                    wanted.iter().zip(shares.iter()).filter_map(|(fit, share)| Some(((*fit)?, share)))
                {
                    let dofs = nodes.iter().flat_map(|node| (0..PER_NODE).map(move |k| PER_NODE * node + k));
                    for (dof, curvature) in dofs.zip(curvatures) {
                        let row = rows[*fit].entry(dof).or_default();
                        row.iter_mut().zip(curvature).for_each(|(sum, term)| *sum += share * term);
                    }
                }
            }
        });
        let rows = rows.into_iter().map(|row| row.into_iter().collect()).collect();
        Ok(Recovery { sites, of_cells, parts, fits, rows, sums })
    }

    /// Returns the sites.
    pub fn sites(&self) -> &[RecoverySite] {
        &self.sites
    }

    /// Returns the sites of the nodes of a cell.
    pub fn of_cell(&self, cell: usize) -> &[usize] {
        &self.of_cells[cell]
    }

    /// Returns this rank's share of each fit, over all dofs of its nodes, three per node.
    pub fn rows(&self) -> &[CurvatureRow] {
        &self.rows
    }

    /// Returns the curvatures at the sites from this rank's shares of the fits. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn curvatures<P: Partition>(&self, fits: &mut [[f64; 3]], partition: &P) -> Result<Vec<[f64; 3]>> {
        if P::DIVIDES {
            let mut of_sites = vec![[0.0; 9]; self.sites.len()];
            for ((site, which), fit) in self.fits.iter().zip(&*fits) {
                of_sites[*site][3 * which..][..3].copy_from_slice(fit);
            }
            sum_over_ranks(&self.sites, self.parts, partition, &mut of_sites)?;
            for ((site, which), fit) in self.fits.iter().zip(&mut *fits) {
                fit.copy_from_slice(&of_sites[*site][3 * which..][..3]);
            }
        }
        let of_site = |(_, terms): &(bool, Vec<(usize, f64)>)| {
            let mut sums = [0.0; 3];
            for (fit, weight) in terms {
                sums.iter_mut().zip(fits[*fit]).for_each(|(sum, value)| *sum += weight * value);
            }
            sums
        };
        let mut curvatures: Vec<[f64; 3]> = self.sums.iter().map(of_site).collect();
        if P::DIVIDES {
            let is_shared =
                |(of, curvature): (&(bool, _), &[f64; 3])| if of.0 { *curvature } else { [0.0; 3] };
            let mut shared: Vec<[f64; 3]> = self.sums.iter().zip(&curvatures).map(is_shared).collect();
            sum_over_ranks(&self.sites, self.parts, partition, &mut shared)?;
            let pairs = curvatures.iter_mut().zip(shared).zip(&self.sums);
            pairs.filter(|(_, of)| of.0).for_each(|((curvature, shared), _)| *curvature = shared);
        }
        Ok(curvatures)
    }

    /// Returns the weights of the fits in a sum over the sites with these weights, the same on all
    /// ranks. Collective.
    ///
    /// # Errors
    /// Returns the errors of communication.
    pub fn weights_of_fits<P: Partition>(&self, weights: &[f64], partition: &P) -> Result<Vec<f64>> {
        let mut of_sites = vec![[0.0; 3]; self.sites.len()];
        for ((weight, (is_shared, terms)), _) in weights.iter().zip(&self.sums).zip(&self.sites) {
            for (fit, share) in terms.iter().filter(|_| *is_shared && *weight != 0.0) {
                let (site, which) = self.fits[*fit];
                of_sites[site][which] += weight * share;
            }
        }
        sum_over_ranks(&self.sites, self.parts, partition, &mut of_sites)?;
        let mut of_fits: Vec<f64> = self.fits.iter().map(|(site, which)| of_sites[*site][*which]).collect();
        for (weight, (is_shared, terms)) in weights.iter().zip(&self.sums) {
            terms.iter().filter(|_| !is_shared).for_each(|(fit, share)| of_fits[*fit] += weight * share);
        }
        Ok(of_fits)
    }
}

/// Returns the sites of a mesh, and those of the nodes of each cell.
fn sites(mesh: &Mesh, part_of: &dyn Fn(usize) -> usize) -> (Vec<RecoverySite>, Vec<Vec<usize>>) {
    let (mut sites, mut numbers) = (Vec::new(), HashMap::new());
    let mut number = |site: RecoverySite| {
        *numbers.entry(site).or_insert_with(|| {
            sites.push(site);
            sites.len() - 1
        })
    };
    let of_cell = |(cell, of): (usize, &crate::mesh::Cell)| {
        let part = part_of(cell);
        of.nodes().iter().map(|&node| number(RecoverySite { node, part })).collect()
    };
    let of_cells = mesh.cells.iter().enumerate().map(of_cell).collect();
    (sites, of_cells)
}

/// Returns the sample points of an element.
fn of_element<const N: usize>(element: &Element<N>) -> Rc<[Sample]> {
    let mut samples = Vec::new();
    for (number, piece) in element.pieces.iter().enumerate() {
        for (barycentric, weight) in quadrature::DEGREE_2 {
            let hessian = piece.basis(barycentric).hessian;
            samples.push(Sample {
                offset: element.point(number, barycentric) - element.origin,
                weight: weight * piece.area(),
                curvatures: (0..N).map(|i| [0, 1, 2].map(|row| hessian[(row, i)])).collect(),
            });
        }
    }
    samples.into()
}

/// Returns the matrix that turns the sums of weight (1, x, y) value into the value at the origin
/// and the derivatives along x and y of the affine function fitted to the values. `sums` are the
/// sums of the weights times 1, x, y, x^2, x y and y^2.
fn affine_fit(sums: &[f64; 6]) -> Matrix3<f64> {
    let [one, x, y, xx, xy, yy] = *sums;
    // Lengths are measured by their root mean square, so that the matrix is well conditioned.
    let scale = ((xx + yy) / one).sqrt();
    let (x, y, square) = (x / scale, y / scale, scale * scale);
    let (xx, xy, yy) = (xx / square, xy / square, yy / square);
    let matrix = Matrix3::new(one, x, y, x, xx, xy, y, xy, yy);
    let fit = matrix.cholesky().map(|factor| factor.inverse());
    // A single flat cell may leave the slopes undetermined; the mean remains.
    let fit = fit.filter(|fit| fit.iter().all(|entry| entry.is_finite()));
    let fit = fit.unwrap_or_else(|| Matrix3::from_diagonal(&Vector3::new(1.0 / one, 0.0, 0.0)));
    let lengths = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0 / scale, 1.0 / scale));
    lengths * fit * lengths
}

/// Returns the weights of a cell's vertices in the value, at a point of the cell, of the function
/// that is linear on each piece of the cell.
///
/// The value at the centre of a quadrilateral, where its diagonals cross, is the mean of those
/// interpolated along the diagonals, and that of a triangle is the mean of its vertices.
pub fn vertex_weights(element: &crate::element::AnyElement, at: Point) -> Vec<f64> {
    fn of<const N: usize>(element: &Element<N>, at: Point) -> Vec<f64> {
        let (piece, [u, v, w]) = element.locate(at);
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
    with_element!(element, element => of(element, at))
}
