//! Turns of a product cell by cell.
//!
//! The batches of a regular mesh read and write its vectors line by line. A strip of the vectors,
//! see [`super::layout`], enters a small work space before the first batch that needs it, and
//! leaves after the last one: what a product works on stays in the first cache, however fine the
//! mesh is.

use super::lane_values::LANES;
use std::collections::BTreeSet;
use std::ops::Range;

/// Part of a product.
#[derive(Debug)]
pub(crate) enum Turn {
    /// A strip of the operand enters the work space.
    Enter(Slot),
    /// Some batches are multiplied.
    Multiply(Range<usize>),
    /// The sums of a strip are complete and leave the work space.
    Leave(Slot),
}

/// Part of the work space that a strip has for some turns.
#[derive(Debug, Clone)]
pub(crate) struct Slot {
    /// Number of the strip.
    pub strip: usize,
    start: usize,
    size: usize,
    /// Number of places up to those of the next slot.
    room: usize,
}

impl Slot {
    /// Creates a slot with these places.
    pub fn new(strip: usize, places: Range<usize>) -> Slot {
        let size = places.len();
        Slot { strip, start: places.start, size, room: (size + LANES).next_multiple_of(LANES) }
    }

    /// Returns the places in the work space.
    #[inline(always)]
    pub fn places(&self) -> Range<usize> {
        self.start..self.start + self.size
    }
}

/// Turns of the products with some batches.
#[derive(Debug)]
pub(crate) struct Turns {
    pub list: Vec<Turn>,
    /// Number of places in the work space.
    pub size: usize,
}

impl Turns {
    /// Plans the turns of some batches, given the positions of each strip and the strips that each
    /// batch needs. Calls `place(batch, starts)` with the first place of each strip in the work
    /// space, which holds for the strips that the batch needs.
    ///
    /// The first [`LANES`] places are those of lanes without a dof, and as many follow each strip,
    /// because unused lanes of a batch may lie beyond its end.
    pub fn new(
        strips: &[Range<u32>],
        needs: &[BTreeSet<usize>],
        mut place: impl FnMut(usize, &[usize]),
    ) -> Turns {
        let mut last = vec![0; strips.len()];
        for (batch, needed) in needs.iter().enumerate() {
            needed.iter().for_each(|&strip| last[strip] = batch);
        }
        let turns = Turns { list: Vec::new(), size: LANES };
        let mut planner = Planner { strips, turns, present: Vec::new(), free: BTreeSet::new() };
        let (mut starts, mut has_entered) = (vec![0; strips.len()], vec![false; strips.len()]);
        for (batch, needed) in needs.iter().enumerate() {
            let new: Vec<usize> = needed.iter().copied().filter(|&strip| !has_entered[strip]).collect();
            if !new.is_empty() {
                planner.leave(|strip| last[strip] < batch);
            }
            for strip in new {
                (starts[strip], has_entered[strip]) = (planner.enter(strip), true);
            }
            planner.multiply(batch);
            place(batch, &starts);
        }
        planner.leave(|_| true);
        // The sums of all other strips are zero.
        for strip in (0..strips.len()).filter(|&strip| !has_entered[strip]) {
            planner.enter(strip);
            planner.leave(|_| true);
        }
        planner.turns
    }
}

/// Turns so far, and the slots in the work space.
struct Planner<'a> {
    strips: &'a [Range<u32>],
    turns: Turns,
    /// Slots in use.
    present: Vec<Slot>,
    /// Room and first place of each slot that is free again.
    free: BTreeSet<(usize, usize)>,
}

impl Planner<'_> {
    /// Lets a strip enter, and returns its first place.
    fn enter(&mut self, strip: usize) -> usize {
        let size = self.strips[strip].len();
        let mut slot = Slot::new(strip, self.turns.size..self.turns.size + size);
        match self.free.range((slot.room, 0)..).next().copied() {
            Some(free) => {
                self.free.remove(&free);
                (slot.room, slot.start) = free;
            }
            None => self.turns.size += slot.room,
        }
        let start = slot.start;
        self.present.push(slot.clone());
        self.turns.list.push(Turn::Enter(slot));
        start
    }

    /// Adds a batch to those that are multiplied.
    fn multiply(&mut self, batch: usize) {
        match self.turns.list.last_mut() {
            Some(Turn::Multiply(batches)) => batches.end = batch + 1,
            _ => self.turns.list.push(Turn::Multiply(batch..batch + 1)),
        }
    }

    /// Lets all strips leave for which this is true.
    fn leave(&mut self, is_done: impl Fn(usize) -> bool) {
        self.present.retain(|slot| {
            let stays = !is_done(slot.strip);
            if !stays {
                self.free.insert((slot.room, slot.start));
                self.turns.list.push(Turn::Leave(slot.clone()));
            }
            stays
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of cells need two of four lines at a time, and the last batch one alone. The fourth
    /// line is longer than the slots of the others, and nothing needs a fifth one.
    #[test]
    fn lines_share_the_slots_that_they_fit_into() {
        let strips = [0..20, 20..40, 40..57, 57..97, 97..100];
        let needs = [[0, 1], [0, 1], [1, 2], [2, 3], [3, 3]].map(BTreeSet::from);
        let mut places = Vec::new();
        let turns = Turns::new(&strips, &needs, |batch, starts| {
            places.push(needs[batch].iter().map(|&strip| starts[strip]).collect::<Vec<_>>());
        });
        assert_eq!(places, [vec![8, 40], vec![8, 40], vec![40, 8], vec![8, 72], vec![72]]);
        assert_eq!(turns.size, 72 + 48);
        let told = turns.list.iter().map(|turn| match turn {
            Turn::Enter(slot) => format!("+{} at {:?}", slot.strip, slot.places()),
            Turn::Multiply(batches) => format!("{batches:?}"),
            Turn::Leave(slot) => format!("-{}", slot.strip),
        });
        let expected = [
            "+0 at 8..28, +1 at 40..60, 0..2, -0, +2 at 8..25, 2..3, -1, +3 at 72..112, 3..5",
            "-2, -3, +4 at 8..11, -4",
        ];
        assert_eq!(told.collect::<Vec<_>>().join(", "), expected.join(", "));
    }
}
