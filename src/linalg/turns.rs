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
pub(super) enum Turn {
    /// A strip of the operand enters the work space.
    Enter(Slot),
    /// Some batches are multiplied.
    Multiply(Range<usize>),
    /// The sums of a strip are complete and leave the work space.
    Leave(Slot),
}

/// Part of the work space that a strip has for some turns.
#[derive(Debug, Clone)]
pub(super) struct Slot {
    /// Number of the strip.
    pub strip: usize,
    start: usize,
    size: usize,
}

impl Slot {
    pub fn new(strip: usize, places: Range<usize>) -> Slot {
        Slot { strip, start: places.start, size: places.len() }
    }

    /// Returns the places in the work space.
    #[inline(always)]
    pub fn places(&self) -> Range<usize> {
        self.start..self.start + self.size
    }
}

/// Turns of the products with some batches.
#[derive(Debug)]
pub(super) struct Turns {
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
        let largest = strips.iter().map(|positions| positions.len()).max().unwrap_or(0);
        let stride = (largest + LANES).next_multiple_of(LANES);
        let mut last = vec![0; strips.len()];
        for (batch, needed) in needs.iter().enumerate() {
            needed.iter().for_each(|&strip| last[strip] = batch);
        }
        let mut turns = Turns { list: Vec::new(), size: LANES };
        let (mut starts, mut has_entered) = (vec![0; strips.len()], vec![false; strips.len()]);
        let (mut present, mut free) = (Vec::<Slot>::new(), Vec::new());
        let slot_of = |strip: usize, start: usize| Slot::new(strip, start..start + strips[strip].len());
        for (batch, needed) in needs.iter().enumerate() {
            if needed.iter().any(|&strip| !has_entered[strip]) {
                present.retain(|slot| {
                    let stays = last[slot.strip] >= batch;
                    if !stays {
                        free.push(slot.start);
                        turns.list.push(Turn::Leave(slot.clone()));
                    }
                    stays
                });
            }
            for &strip in needed {
                if !std::mem::replace(&mut has_entered[strip], true) {
                    starts[strip] = free.pop().unwrap_or(turns.size);
                    turns.size = turns.size.max(starts[strip] + stride);
                    present.push(slot_of(strip, starts[strip]));
                    turns.list.extend(present.last().cloned().map(Turn::Enter));
                }
            }
            match turns.list.last_mut() {
                Some(Turn::Multiply(batches)) => batches.end = batch + 1,
                _ => turns.list.push(Turn::Multiply(batch..batch + 1)),
            }
            place(batch, &starts);
        }
        turns.list.extend(present.into_iter().map(Turn::Leave));
        // The sums of all other strips are zero.
        for strip in (0..strips.len()).filter(|&strip| !has_entered[strip]) {
            turns.size = turns.size.max(LANES + stride);
            turns.list.extend([Turn::Enter(slot_of(strip, LANES)), Turn::Leave(slot_of(strip, LANES))]);
        }
        turns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of cells between four lines need two lines at a time, one batch needs the last line
    /// alone, and nothing needs the fifth line.
    #[test]
    fn two_slots_hold_the_lines_of_a_mesh() {
        let strips = [0..20, 20..40, 40..57, 57..77, 77..80];
        let needs = [[0, 1], [0, 1], [1, 2], [2, 3], [3, 3]].map(BTreeSet::from);
        let mut places = Vec::new();
        let turns = Turns::new(&strips, &needs, |batch, starts| {
            places.push(needs[batch].iter().map(|&strip| starts[strip]).collect::<Vec<_>>());
        });
        let (first, second) = (LANES, LANES + 32);
        assert_eq!(
            places,
            [[first, second], [first, second], [second, first], [first, second]]
                .map(|of| of.to_vec())
                .into_iter()
                .chain([vec![second]])
                .collect::<Vec<_>>()
        );
        assert_eq!(turns.size, second + 32);
        let told: Vec<String> = turns
            .list
            .iter()
            .map(|turn| match turn {
                Turn::Enter(slot) => format!("+{} at {:?}", slot.strip, slot.places()),
                Turn::Multiply(batches) => format!("{batches:?}"),
                Turn::Leave(slot) => format!("-{}", slot.strip),
            })
            .collect();
        let expected = [
            "+0 at 8..28",
            "+1 at 40..60",
            "0..2",
            "-0",
            "+2 at 8..25",
            "2..3",
            "-1",
            "+3 at 40..60",
            "3..5",
            "-2",
            "-3",
            "+4 at 8..11",
            "-4",
        ];
        assert_eq!(told, expected);
    }
}
