//! Weights of the dofs around the sites of a recovery in its fits.
//!
//! The *patch* of a site consists of the cells around it. Sites with congruent patches share one
//! set of weights.

use super::samples::ClassSamples;
use super::site_blocks::{NodeWeights, Stencil};
use crate::dof_map::PER_NODE;
use crate::linalg::CellClass;
use nalgebra::{Matrix3, Vector3};
use std::collections::{BTreeMap, HashMap};

/// Curvatures (w_xx, w_xy, w_yy) at a site, as a sum over the dofs of this rank's cells: three
/// weights per dof.
pub type CurvatureRow = Vec<(usize, [f64; 3])>;

/// Cells around a site: the number of each cell and which of its corners the site is.
pub(super) type Corners = Vec<(usize, usize)>;

/// Weights of the dofs of this rank's cells in the fits of a recovery.
#[derive(Clone, Debug)]
pub(super) struct Patches {
    /// Weights of each node of each distinct patch, one list per fit that differs from all others.
    weights: Vec<Vec<NodeWeights>>,
    /// List of weights of each fit, and the place in `nodes` where its nodes begin.
    fits: Vec<(usize, usize)>,
    /// Nodes of the fits' patches, one after the other.
    nodes: Vec<u32>,
}

/// Identity of the weights of a fit: which fit, the sums of its least squares to the bit, the class
/// and corner of each cell of the patch, and the number within the patch of each cell's nodes.
type Key = (usize, [u64; 6], Vec<(CellClass, usize)>, Vec<usize>);

/// Site with what its fits depend on.
pub(super) struct SitePatch<'p> {
    pub corners: &'p Corners,
    /// Sums of the least squares, see [`affine_fit`].
    pub squares: [f64; 6],
}

impl Patches {
    /// Collects the weights of fits, each a site and the number of the fit, from the sites, the
    /// nodes and class of each cell, and the samples of the classes.
    pub fn new<'p>(
        fits: &[(usize, usize)],
        sites: &[SitePatch],
        cell: &dyn Fn(usize) -> (&'p [usize], CellClass),
        samples: &HashMap<CellClass, ClassSamples>,
    ) -> Patches {
        let mut patches = Patches { weights: Vec::new(), fits: Vec::new(), nodes: Vec::new() };
        let mut numbers: HashMap<Key, usize> = HashMap::new();
        for &(site, which) in fits {
            let SitePatch { corners, squares } = &sites[site];
            let (nodes, places) = nodes_of(corners, cell);
            let classes: Vec<_> = corners.iter().map(|&(number, corner)| (cell(number).1, corner)).collect();
            let key = (which, squares.map(f64::to_bits), classes, places);
            let next = numbers.len();
            let number = *numbers.entry(key).or_insert_with_key(|(_, _, classes, places)| {
                let row = affine_fit(squares).row(which).transpose();
                patches.weights.push(weights_of(row, classes, places, samples));
                next
            });
            patches.fits.push((number, patches.nodes.len()));
            patches.nodes.extend(nodes.into_iter().map(|node| node as u32));
        }
        patches
    }

    /// Returns the weights of a fit and the nodes that they belong to.
    fn fit(&self, fit: usize) -> (&[NodeWeights], &[u32]) {
        let (number, start) = self.fits[fit];
        let weights = &self.weights[number];
        (weights, &self.nodes[start..][..weights.len()])
    }

    /// Returns the weights of a fit over all dofs, three per node.
    pub fn row(&self, fit: usize) -> CurvatureRow {
        let (weights, nodes) = self.fit(fit);
        let of_node = |(node, weights): (&u32, &NodeWeights)| {
            let first = PER_NODE * *node as usize;
            let weights = *weights;
            (0..PER_NODE).map(move |k| (first + k, [weights[k][0], weights[k][1], weights[k][2]]))
        };
        nodes.iter().zip(weights).flat_map(of_node).collect()
    }

    /// Returns the weights of the nodes in a sum of fits, each with a factor, relative to the node
    /// of a site.
    pub fn stencil(&self, node: usize, terms: &[(usize, f64)]) -> Stencil {
        let mut stencil: BTreeMap<i32, NodeWeights> = BTreeMap::new();
        for &(fit, factor) in terms {
            let (weights, nodes) = self.fit(fit);
            for (weights, &neighbour) in weights.iter().zip(nodes) {
                let sums = stencil.entry(neighbour.wrapping_sub(node as u32) as i32).or_default();
                let pairs = sums.as_flattened_mut().iter_mut().zip(weights.as_flattened());
                pairs.for_each(|(sum, weight)| *sum += factor * weight);
            }
        }
        stencil.into_iter().collect()
    }
}

/// Returns the nodes of a patch, each once, and the number among them of each node of each cell.
fn nodes_of<'p>(
    corners: &Corners,
    cell: &dyn Fn(usize) -> (&'p [usize], CellClass),
) -> (Vec<usize>, Vec<usize>) {
    let (mut nodes, mut places) = (Vec::new(), Vec::new());
    for &(number, _) in corners {
        for &node in cell(number).0 {
            let place = nodes.iter().position(|&other| other == node).unwrap_or_else(|| {
                nodes.push(node);
                nodes.len() - 1
            });
            places.push(place);
        }
    }
    (nodes, places)
}

/// Returns the weights of the nodes of a patch in the fit with a row of the affine fit, given the
/// class and corner of each cell and the number within the patch of each cell's nodes.
fn weights_of(
    row: Vector3<f64>,
    classes: &[(CellClass, usize)],
    places: &[usize],
    samples: &HashMap<CellClass, ClassSamples>,
) -> Vec<NodeWeights> {
    let count = places.iter().max().map_or(0, |most| most + 1);
    let mut weights = vec![NodeWeights::default(); count];
    let mut rest = places;
    for (class, corner) in classes {
        let ClassSamples { corners, samples } = &samples[class];
        let (places, others) = rest.split_at(corners.len());
        rest = others;
        for sample in samples {
            let d = sample.offset - corners[*corner];
            let share = row.dot(&Vector3::new(1.0, d.x, d.y)) * sample.weight;
            for (place, curvatures) in places.iter().zip(sample.curvatures.as_chunks::<PER_NODE>().0) {
                for (sums, curvature) in weights[*place].iter_mut().zip(curvatures) {
                    sums.iter_mut().zip(curvature).for_each(|(sum, term)| *sum += share * term);
                }
            }
        }
    }
    weights
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
