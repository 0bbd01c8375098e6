//! Scratch space for the products of batches.

use super::lane_values::Lanes;

/// Scratch space for the local vectors of one batch.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    lanes: Vec<Lanes>,
}

/// Scratch vectors beside the cells' own dofs.
pub(crate) struct Room<'a> {
    pub work: &'a mut [Lanes],
    pub result: &'a mut [Lanes],
    pub y: &'a mut [Lanes],
    pub m: &'a mut [Lanes],
}

impl Room<'_> {
    #[inline(always)]
    pub fn reborrow(&mut self) -> Room<'_> {
        Room { work: self.work, result: self.result, y: self.y, m: self.m }
    }
}

impl Scratch {
    /// Makes room for cells of up to `size` dofs.
    pub fn reserve(&mut self, size: usize) {
        self.lanes.resize((5 * size).max(self.lanes.len()), Lanes::default());
    }

    #[inline(always)]
    pub fn split(&mut self, size: usize) -> (&mut [Lanes], Room<'_>) {
        let (local, rest) = self.lanes[..5 * size].split_at_mut(size);
        let (work, rest) = rest.split_at_mut(size);
        let (result, rest) = rest.split_at_mut(size);
        let (y, m) = rest.split_at_mut(size);
        (local, Room { work, result, y, m })
    }
}
