//! Work space of the products of one engine.

use super::batch::Batches;
use super::lane_values::{LANES, Lanes};
use super::layout::Layout;

/// Vectors in layout order, and scratch space for the local vectors of a batch.
#[derive(Debug)]
pub(crate) struct Workspace {
    x: Vec<f64>,
    sums: [Vec<f64>; 2],
    lanes: Vec<Lanes>,
}

/// The operand x of a product and up to two sums y and z. Between products the sums are zero at all
/// dofs; the operand is always zero at positions without a dof.
pub(crate) struct Space<'a> {
    pub x: &'a mut [f64],
    pub y: &'a mut [f64],
    pub z: &'a mut [f64],
    pub scratch: Scratch<'a>,
}

/// Scratch space for the local vectors of one batch.
pub(crate) struct Scratch<'a>(&'a mut [Lanes]);

/// Scratch vectors beside the cells' own dofs.
pub(crate) struct Room<'a> {
    pub work: &'a mut [Lanes],
    pub result: &'a mut [Lanes],
    pub y: &'a mut [Lanes],
    pub m: &'a mut [Lanes],
}

impl Workspace {
    /// Creates the work space for vectors of a layout.
    pub fn new(layout: &Layout) -> Workspace {
        // Rows use up to nine positions from the first one that no dof has; others align them.
        let zeros = || vec![0.0; layout.nowhere() as usize + 3 * LANES];
        Workspace { x: zeros(), sums: [zeros(), zeros()], lanes: Vec::new() }
    }

    /// Makes room for products with some batches.
    pub fn reserve(&mut self, batches: &Batches) {
        self.lanes.resize((5 * batches.width).max(self.lanes.len()), Lanes::default());
    }

    /// Returns all vectors.
    #[inline(always)]
    pub fn space(&mut self) -> Space<'_> {
        let [y, z] = &mut self.sums;
        Space { x: aligned(&mut self.x), y: aligned(y), z: aligned(z), scratch: Scratch(&mut self.lanes) }
    }
}

impl Room<'_> {
    #[inline(always)]
    pub fn reborrow(&mut self) -> Room<'_> {
        Room { work: self.work, result: self.result, y: self.y, m: self.m }
    }
}

impl Scratch<'_> {
    /// Returns the cells' own dofs and the other vectors, of `size` dofs each.
    #[inline(always)]
    pub fn split(&mut self, size: usize) -> (&mut [Lanes], Room<'_>) {
        let (local, rest) = self.0[..5 * size].split_at_mut(size);
        let (work, rest) = rest.split_at_mut(size);
        let (result, rest) = rest.split_at_mut(size);
        let (y, m) = rest.split_at_mut(size);
        (local, Room { work, result, y, m })
    }
}

/// Returns a vector from where a line of the cache begins, so that [`LANES`] numbers fill it.
#[inline(always)]
fn aligned(vector: &mut [f64]) -> &mut [f64] {
    let skipped = vector.as_ptr().align_offset(size_of::<f64>() * LANES).min(LANES);
    vector.get_mut(skipped..).unwrap_or_default()
}
