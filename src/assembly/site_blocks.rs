//! Weighted sums of nodal values at many sites, eight sites at a time.
//!
//! A *stencil* consists of the weights of the values at the nodes around a site. On a regular mesh
//! most sites share their stencil, and its nodes follow each other from site to site. Such sites
//! are summed side by side, in whole vector registers, with weights that stay in the processor's
//! cache. The remaining sites are summed one by one.

use crate::dof_map::PER_NODE;
use crate::hash;
use pulp::{Arch, Simd, WithSimd};
use std::collections::HashMap;

/// Number of sites per block.
const SITES: usize = 8;

/// Three components of a quantity at the sites of a block, component by component.
type SiteBlock = [[f64; SITES]; 3];

/// Weights with which the three dofs of a node enter three sums, a row per dof. The fourth entry of
/// a row is 0, so that a row fills a register of the processor.
pub(super) type NodeWeights = [[f64; 4]; PER_NODE];

/// Weights of the values at some nodes, each given relative to the node of the site.
pub(super) type Stencil = Vec<(i32, NodeWeights)>;

/// Sums over stencils at many sites.
///
/// Each sum has a *slot*: slot s is entry s % 8 of block s / 8. Slots without a sum have arbitrary
/// values.
#[derive(Clone, Debug)]
pub(super) struct StencilSums {
    stencils: Vec<Stencil>,
    /// Stencil of each block of sums, and the node of its first site. The sites of a block lie at
    /// eight consecutive nodes.
    blocks: Vec<(u32, u32)>,
    /// Stencil and node of each sum in no block, whose slots follow those of the blocks.
    singles: Vec<(u32, u32)>,
    slots: Vec<u32>,
    arch: Arch,
}

/// Smallest number of sums for which a block is worth its unused slots.
const LEAST: usize = 2;

impl StencilSums {
    /// Collects the node and the stencil of each sum.
    pub(super) fn new(sums: impl Iterator<Item = (usize, Stencil)>) -> StencilSums {
        let mut stencils: Vec<Stencil> = Vec::new();
        // Sums with each stencil: the node and the number of each.
        let mut users: Vec<Vec<(usize, usize)>> = Vec::new();
        let mut numbers: HashMap<u64, usize> = HashMap::new();
        for (number, (node, stencil)) in sums.enumerate() {
            let print = fingerprint(&stencil);
            let same = numbers.get(&print).copied().filter(|&index| stencils[index] == stencil);
            let index = same.unwrap_or_else(|| {
                numbers.insert(print, stencils.len());
                stencils.push(stencil);
                users.push(Vec::new());
                stencils.len() - 1
            });
            users[index].push((node, number));
        }
        let count = users.iter().map(Vec::len).sum();
        let mut rows = Vec::new();
        for (index, users) in users.iter_mut().enumerate() {
            users.sort_unstable();
            let mut rest = &users[..];
            while let Some((&(first, _), _)) = rest.split_first() {
                let is_next = |pair: &[(usize, usize)]| pair[0].0 < pair[1].0 && pair[1].0 < first + SITES;
                let count = 1 + rest.windows(2).take_while(|pair| is_next(pair)).count();
                rows.push((first, index, &rest[..count]));
                rest = &rest[count..];
            }
        }
        // Neighbours in the mesh share the values that they read.
        rows.sort_by_key(|&(first, index, _)| (first, index));
        let mut sums = StencilSums {
            stencils,
            blocks: Vec::new(),
            singles: Vec::new(),
            slots: vec![0; count],
            arch: Arch::new(),
        };
        let (many, few): (Vec<_>, Vec<_>) = rows.into_iter().partition(|(.., row)| row.len() >= LEAST);
        for (first, index, row) in many {
            for (node, number) in row {
                sums.slots[*number] = (SITES * sums.blocks.len() + node - first) as u32;
            }
            sums.blocks.push((index as u32, first as u32));
        }
        let start = SITES * sums.blocks.len();
        for (_, index, row) in few {
            for (node, number) in row {
                sums.slots[*number] = (start + sums.singles.len()) as u32;
                sums.singles.push((index as u32, *node as u32));
            }
        }
        sums
    }

    /// Returns all sums for given values of the three dofs of each node, node by node.
    pub fn compute(&self, shape: &[f64]) -> Vec<[f64; 3]> {
        let mut sums = vec![SiteBlock::default(); self.blocks.len() + self.singles.len().div_ceil(SITES)];
        // Slots without a sum read values past the last node.
        let mut nodal = [0; PER_NODE].map(|_| vec![0.0; shape.len() / PER_NODE + SITES]);
        for (node, values) in shape.as_chunks::<PER_NODE>().0.iter().enumerate() {
            nodal.iter_mut().zip(values).for_each(|(nodal, value)| nodal[node] = *value);
        }
        let nodal = nodal.each_ref().map(Vec::as_slice);
        self.arch.dispatch(SumsOfStencils { plan: self, nodal, sums: &mut sums });
        let sum = |&slot: &u32| sums[slot as usize / SITES].map(|values| values[slot as usize % SITES]);
        self.slots.iter().map(sum).collect()
    }
}

/// Returns a hash of the bits of a stencil.
fn fingerprint(stencil: &Stencil) -> u64 {
    stencil.iter().fold(0, |print, (offset, weights)| {
        let bits = weights.as_flattened().iter().map(|weight| weight.to_bits());
        // The high bits of a product reach the low ones of the next.
        bits.fold(hash::extend(print, *offset as u64), |print, bits| {
            hash::extend(print ^ (print >> 32), bits)
        })
    })
}

/// Computation of all sums, compiled for the widest vector registers.
struct SumsOfStencils<'a> {
    plan: &'a StencilSums,
    nodal: [&'a [f64]; PER_NODE],
    sums: &'a mut [SiteBlock],
}

impl WithSimd for SumsOfStencils<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let SumsOfStencils { plan: StencilSums { stencils, blocks, singles, .. }, nodal, sums } = self;
        let (whole, rest) = sums.split_at_mut(blocks.len());
        for (&(index, node), sums) in blocks.iter().zip(whole) {
            side_by_side(simd, &stencils[index as usize], node, nodal, sums);
        }
        for (singles, sums) in singles.chunks(SITES).zip(rest) {
            for (lane, &(index, node)) in singles.iter().enumerate() {
                let sum = single(simd, &stencils[index as usize], node, nodal);
                for k in 0..3 {
                    sums[k][lane] = sum[k];
                }
            }
        }
    }
}

/// Computes the sums at eight consecutive nodes from the given one on.
#[inline(always)]
fn side_by_side<S: Simd>(
    simd: S,
    stencil: &Stencil,
    node: u32,
    nodal: [&[f64]; PER_NODE],
    sums: &mut SiteBlock,
) {
    // Only the registers that eight sites fill are used.
    let count = SITES / S::F64_LANES;
    let mut registers = [[simd.splat_f64s(0.0); SITES]; 3];
    for (offset, weights) in stencil {
        let first = node.wrapping_add_signed(*offset) as usize;
        for (values, weights) in nodal.iter().zip(weights) {
            let values = S::as_simd_f64s(&values[first..][..SITES]).0;
            for (registers, weight) in registers.iter_mut().zip(weights) {
                let weight = simd.splat_f64s(*weight);
                for k in 0..count {
                    registers[k] = simd.mul_add_f64s(weight, values[k], registers[k]);
                }
            }
        }
    }
    for (sums, registers) in sums.iter_mut().zip(registers) {
        S::as_mut_simd_f64s(sums).0.copy_from_slice(&registers[..count]);
    }
}

/// Returns the sums at one node; the fourth entry does not matter.
#[inline(always)]
fn single<S: Simd>(simd: S, stencil: &Stencil, node: u32, nodal: [&[f64]; PER_NODE]) -> [f64; 4] {
    let count = 4_usize.div_ceil(S::F64_LANES);
    // Three independent sums, one per dof of a node, can be added to at the same time.
    let mut sums = [[simd.splat_f64s(0.0); 4]; PER_NODE];
    for (offset, weights) in stencil {
        let place = node.wrapping_add_signed(*offset) as usize;
        for ((sums, weights), values) in sums.iter_mut().zip(weights).zip(nodal) {
            let value = simd.splat_f64s(values[place]);
            for k in 0..count {
                let weights = match S::as_simd_f64s(weights).0.get(k) {
                    Some(weights) => *weights,
                    None => simd.partial_load_f64s(weights),
                };
                sums[k] = simd.mul_add_f64s(weights, value, sums[k]);
            }
        }
    }
    let [w, w_x, w_y] = sums;
    let mut total = [0.0; 4];
    for k in 0..count {
        let sum = simd.add_f64s(simd.add_f64s(w[k], w_x[k]), w_y[k]);
        match S::as_mut_simd_f64s(&mut total).0.get_mut(k) {
            Some(total) => *total = sum,
            None => simd.partial_store_f64s(&mut total, sum),
        }
    }
    total
}
