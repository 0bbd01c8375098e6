//! Work space of the products of one engine.

use super::batch::Batches;
use super::lane_values::LANES;
use super::layout::Layout;
use super::scratch::Scratch;
use super::turns::Slot;
use pulp::Simd;

/// Strips of vectors in layout order, where [`super::turns`] have their slots, and scratch space
/// for the local vectors of the cells.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    x: Vec<f64>,
    sums: [Vec<f64>; 2],
    scratch: Scratch,
}

/// The operand x of a product and up to two sums y and z. Between products the sums are zero.
pub(crate) struct Strips<'a> {
    pub x: &'a mut [f64],
    pub y: &'a mut [f64],
    pub z: &'a mut [f64],
    pub scratch: &'a mut Scratch,
}

impl Workspace {
    /// Makes room for products with some batches.
    pub fn reserve(&mut self, batches: &Batches) {
        self.scratch.reserve(batches.width);
        let size = batches.turns.size + LANES;
        let [y, z] = &mut self.sums;
        for vector in [&mut self.x, y, z] {
            if vector.len() < size {
                // Lines of the cache may begin at another entry of a longer vector. Entries copied
                // into it could then lie at places that must be zero.
                *vector = vec![0.0; size];
            }
        }
    }

    /// Returns all strips.
    #[inline(always)]
    pub fn strips(&mut self) -> Strips<'_> {
        let [y, z] = &mut self.sums;
        Strips { x: aligned(&mut self.x), y: aligned(y), z: aligned(z), scratch: &mut self.scratch }
    }
}

impl Strips<'_> {
    /// Moves the sums y and z of a strip to two vectors, or adds them there, and leaves zeros.
    #[inline(always)]
    pub fn take_both<S: Simd>(
        &mut self,
        simd: S,
        layout: &Layout,
        slot: &Slot,
        is_first: bool,
        to: (&mut [f64], &mut [f64]),
    ) {
        if is_first {
            layout.take::<_, false>(simd, slot, self.y, to.0);
            layout.take::<_, false>(simd, slot, self.z, to.1);
        } else {
            layout.take::<_, true>(simd, slot, self.y, to.0);
            layout.take::<_, true>(simd, slot, self.z, to.1);
        }
    }
}

/// Returns a vector from where a line of the cache begins, so that [`LANES`] numbers fill it.
#[inline(always)]
fn aligned(vector: &mut [f64]) -> &mut [f64] {
    let skipped = vector.as_ptr().align_offset(size_of::<f64>() * LANES).min(LANES);
    vector.get_mut(skipped..).unwrap_or_default()
}
