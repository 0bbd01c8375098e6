//! Order of the engine's own vectors, which suits products cell by cell.
//!
//! In a vector numbered node by node the dofs of a cell lie far apart, and gathering them one at a
//! time costs more than all the arithmetic of the cell. A [`Layout`] puts the dofs of one kind side
//! by side along the lines of the mesh. Eight congruent cells in a row then read each of their
//! local dofs at once, from eight consecutive positions.
//!
//! The positions are divided into *strips*, such as the lines of nodes of a fine mesh. A product
//! holds only those strips that its next cells need, see [`super::turns`].

use super::lane_values::LANES;
use super::turns::Slot;
use pulp::Simd;
use std::array::from_mut;
use std::mem::{replace, take};
use std::ops::Range;

/// Number of nodes that are moved at once with registers of fewer than [`LANES`] numbers: the
/// compiler transposes eight of them one value at a time.
const FEW: usize = 4;

/// Position of each dof in the engine's own vectors.
///
/// A vector in *layout order* has more positions than there are dofs: some belong to dofs that
/// supports hold, and some to none. An operand is zero there, and what a product writes there is
/// never read.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Position of each dof.
    places: Vec<u32>,
    /// Whether each position belongs to a dof.
    taken: Vec<bool>,
    strips: Vec<Strip>,
}

/// Successive positions, and the dofs that have them.
#[derive(Debug, Clone, Default)]
struct Strip {
    positions: Range<u32>,
    lines: Vec<Line>,
    runs: Vec<Run>,
    /// All other dofs, each with its place in the strip.
    others: Vec<(u32, u32)>,
    /// Places without a dof.
    gaps: Vec<u32>,
}

/// Nodes with three dofs each, numbered one after the other, whose dofs of each kind lie side by
/// side in layout order.
#[derive(Debug, Clone, Copy)]
struct Line {
    dof: u32,
    nodes: u32,
    /// Places of the first node's dofs in the strip.
    places: [u32; 3],
}

/// Dofs that have the same order in the strip.
#[derive(Debug, Clone, Copy)]
struct Run {
    dof: u32,
    count: u32,
    place: u32,
}

impl Line {
    /// Returns the longest line of a strip that begins with a dof, given the positions of all dofs;
    /// `None` if it fills no vector register.
    fn at(dof: usize, places: &[u32], strip: &Range<u32>) -> Option<Line> {
        let (nodes, _) = places[dof..].as_chunks::<3>();
        let first = *nodes.first()?;
        let follows = |&(k, node): &(u32, &[u32; 3])| {
            *node == first.map(|place| place + k) && node.iter().all(|place| strip.contains(place))
        };
        let nodes = (0..).zip(nodes).take_while(follows).count();
        let places = first.map(|place| place.wrapping_sub(strip.start));
        (nodes >= LANES).then_some(Line { dof: dof as u32, nodes: nodes as u32, places })
    }

    /// Returns the dofs of all nodes.
    #[inline(always)]
    fn dofs(&self) -> Range<usize> {
        self.dof as usize..(self.dof + 3 * self.nodes) as usize
    }

    /// Returns the places of the dofs of each kind.
    #[inline(always)]
    fn places(&self) -> [Range<usize>; 3] {
        self.places.map(|place| place as usize..(place + self.nodes) as usize)
    }

    /// Returns the dofs of each kind of a strip, some nodes at a time and the rest one by one.
    #[inline(always)]
    fn kinds<'a, const NODES: usize>(
        &self,
        strip: &'a mut [f64],
    ) -> [(&'a mut [[f64; NODES]], &'a mut [f64]); 3] {
        // The places are those of different dofs.
        let kinds = strip.get_disjoint_mut(self.places()).unwrap_or_default();
        kinds.map(<[f64]>::as_chunks_mut)
    }

    /// Copies the dofs from x to their places in a strip, some nodes at a time.
    #[inline(always)]
    fn lay_out<const NODES: usize>(&self, x: &[f64], laid: &mut [f64]) {
        let (nodes, _) = x[self.dofs()].as_chunks::<3>();
        let ((nodes, last), [w, w_x, w_y]) = (nodes.as_chunks::<NODES>(), self.kinds(laid));
        for (((node, w), w_x), w_y) in nodes.iter().zip(w.0).zip(w_x.0).zip(w_y.0) {
            [*w, *w_x, *w_y] = by_kind(*node);
        }
        for (((node, w), w_x), w_y) in last.iter().zip(w.1).zip(w_x.1).zip(w_y.1) {
            [*w, *w_x, *w_y] = *node;
        }
    }

    /// Moves the dofs from their places in a strip to x, or adds them there, some nodes at a time,
    /// and leaves zeros.
    #[inline(always)]
    fn take<const ADDS: bool, const NODES: usize>(&self, laid: &mut [f64], x: &mut [f64]) {
        let (nodes, _) = x[self.dofs()].as_chunks_mut::<3>();
        let ((nodes, last), [w, w_x, w_y]) = (nodes.as_chunks_mut::<NODES>(), self.kinds(laid));
        for (((node, w), w_x), w_y) in nodes.iter_mut().zip(w.0).zip(w_x.0).zip(w_y.0) {
            let kinds = [zeroed(w), zeroed(w_x), zeroed(w_y)];
            put::<ADDS, 3, NODES>(by_node(kinds), node);
        }
        for (((node, w), w_x), w_y) in last.iter_mut().zip(w.1).zip(w_x.1).zip(w_y.1) {
            put::<ADDS, 3, 1>([[take(w), take(w_x), take(w_y)]], from_mut(node));
        }
    }
}

impl Run {
    /// Returns the longest run of a strip that begins with a dof, given the positions of all dofs;
    /// `None` if it fills no vector register.
    fn at(dof: usize, places: &[u32], strip: &Range<u32>) -> Option<Run> {
        let first = places[dof];
        let follows = |&(k, place): &(u32, &u32)| *place == first + k && strip.contains(place);
        let count = (0..).zip(&places[dof..]).take_while(follows).count();
        (count >= LANES).then_some(Run { dof: dof as u32, count: count as u32, place: first - strip.start })
    }

    #[inline(always)]
    fn dofs(&self) -> Range<usize> {
        self.dof as usize..(self.dof + self.count) as usize
    }

    #[inline(always)]
    fn places(&self) -> Range<usize> {
        self.place as usize..(self.place + self.count) as usize
    }
}

impl Layout {
    /// Creates a layout of one strip with the given position for each dof; no two dofs share one.
    pub fn new(places: impl IntoIterator<Item = usize>) -> Layout {
        Layout::in_strips(places, [])
    }

    /// Creates a layout with the given position for each dof; no two dofs share one. Strips end at
    /// the given positions, ascending, and what follows them is one more.
    pub fn in_strips(
        places: impl IntoIterator<Item = usize>,
        ends: impl IntoIterator<Item = usize>,
    ) -> Layout {
        let places: Vec<u32> = places.into_iter().map(|place| place as u32).collect();
        let mut ends: Vec<usize> = ends.into_iter().collect();
        let last = places.iter().max().map_or(0, |&last| last as usize + 1);
        if ends.last().is_none_or(|&end| end < last) {
            ends.push(last);
        }
        let mut taken = vec![false; ends[ends.len() - 1]];
        for &place in &places {
            debug_assert!(!taken[place as usize], "two dofs at place {place}");
            taken[place as usize] = true;
        }
        let mut strips = Vec::new();
        let mut start = 0;
        for end in ends.into_iter().map(|end| end as u32) {
            let gaps = (start..end).filter(|&place| !taken[place as usize]).map(|place| place - start);
            strips.push(Strip { positions: start..end, gaps: gaps.collect(), ..Strip::default() });
            start = end;
        }
        let mut layout = Layout { places, taken, strips };
        let mut dof = 0;
        while dof < layout.places.len() {
            let number = layout.strip_of(layout.places[dof]);
            let (places, strip) = (&layout.places, &mut layout.strips[number]);
            if let Some(line) = Line::at(dof, places, &strip.positions) {
                dof = line.dofs().end;
                strip.lines.push(line);
            } else if let Some(run) = Run::at(dof, places, &strip.positions) {
                dof = run.dofs().end;
                strip.runs.push(run);
            } else {
                strip.others.push((dof as u32, places[dof] - strip.positions.start));
                dof += 1;
            }
        }
        layout
    }

    /// Returns the number of dofs.
    pub fn dofs(&self) -> usize {
        self.places.len()
    }

    /// Returns the positions of each strip.
    pub(crate) fn strips(&self) -> impl ExactSizeIterator<Item = Range<u32>> {
        self.strips.iter().map(|strip| strip.positions.clone())
    }

    /// Returns whether two positions belong to one strip.
    pub(crate) fn are_in_one_strip(&self, first: u32, second: u32) -> bool {
        let positions = &self.strips[self.strip_of(first)].positions;
        positions.contains(&first) && positions.contains(&second)
    }

    /// Returns the number of the strip that has a position, or of the last one if none has.
    pub(crate) fn strip_of(&self, place: u32) -> usize {
        let number = self.strips.partition_point(|strip| strip.positions.end <= place);
        number.min(self.strips.len() - 1)
    }

    /// Returns the first of the free positions, one per lane, that lanes without a dof use.
    pub(crate) fn nowhere(&self) -> u32 {
        self.taken.len() as u32
    }

    /// Returns whether no dof has the position.
    pub(crate) fn is_free(&self, place: u32) -> bool {
        self.taken.get(place as usize).is_none_or(|taken| !taken)
    }

    /// Returns the position of each dof of a cell in the laid-out vectors; `None` for a constrained
    /// dof.
    pub(crate) fn places_of(&self, dofs: &[Option<usize>]) -> impl Iterator<Item = Option<u32>> {
        dofs.iter().map(|dof| dof.map(|dof| self.places[dof]))
    }

    /// Copies the dofs of a strip from x into its slot of a work space, with zero at places without
    /// a dof.
    #[inline(always)]
    pub(crate) fn lay_out<S: Simd>(&self, _: S, slot: &Slot, x: &[f64], laid: &mut [f64]) {
        let laid = &mut laid[slot.places()];
        let Strip { lines, runs, others, .. } = &self.strips[slot.strip];
        for line in lines {
            if S::F64_LANES == LANES {
                line.lay_out::<LANES>(x, laid);
            } else {
                line.lay_out::<FEW>(x, laid);
            }
        }
        for run in runs {
            laid[run.places()].copy_from_slice(&x[run.dofs()]);
        }
        for &(dof, place) in others {
            laid[place as usize] = x[dof as usize];
        }
        self.clear_gaps(slot, laid);
    }

    /// Sets the places of a slot to zero that have no dof.
    #[inline(always)]
    fn clear_gaps(&self, slot: &Slot, laid: &mut [f64]) {
        for &place in &self.strips[slot.strip].gaps {
            laid[place as usize] = 0.0;
        }
    }

    /// Moves the dofs of a strip from its slot to x, or adds them there, and leaves zeros.
    #[inline(always)]
    pub(crate) fn take<S: Simd, const ADDS: bool>(&self, _: S, slot: &Slot, laid: &mut [f64], x: &mut [f64]) {
        let laid = &mut laid[slot.places()];
        let Strip { lines, runs, others, .. } = &self.strips[slot.strip];
        for line in lines {
            if S::F64_LANES == LANES {
                line.take::<ADDS, LANES>(laid, x);
            } else {
                line.take::<ADDS, FEW>(laid, x);
            }
        }
        let in_runs = runs.iter().flat_map(|run| run.dofs().zip(run.places()));
        let others = others.iter().map(|&(dof, place)| (dof as usize, place as usize));
        for (dof, place) in in_runs.chain(others) {
            put::<ADDS, 1, 1>([[take(&mut laid[place])]], from_mut(from_mut(&mut x[dof])));
        }
        self.clear_gaps(slot, laid);
    }
}

/// Returns the values of some nodes kind by kind. The compiler keeps whole arrays in registers and
/// transposes them there.
#[inline(always)]
fn by_kind<const NODES: usize>(nodes: [[f64; 3]; NODES]) -> [[f64; NODES]; 3] {
    let mut kinds = [[0.0; NODES]; 3];
    for node in 0..NODES {
        for kind in 0..3 {
            kinds[kind][node] = nodes[node][kind];
        }
    }
    kinds
}

/// Returns the values of some nodes node by node.
#[inline(always)]
fn by_node<const NODES: usize>(kinds: [[f64; NODES]; 3]) -> [[f64; 3]; NODES] {
    let mut nodes = [[0.0; 3]; NODES];
    for node in 0..NODES {
        for kind in 0..3 {
            nodes[node][kind] = kinds[kind][node];
        }
    }
    nodes
}

/// Returns some values and leaves zeros.
#[inline(always)]
fn zeroed<const NODES: usize>(values: &mut [f64; NODES]) -> [f64; NODES] {
    replace(values, [0.0; NODES])
}

/// Sets some values, or adds to them.
#[inline(always)]
fn put<const ADDS: bool, const N: usize, const M: usize>(values: [[f64; N]; M], to: &mut [[f64; N]; M]) {
    if !ADDS {
        *to = values;
        return;
    }
    for (to, values) in to.iter_mut().zip(values) {
        for k in 0..N {
            to[k] += values[k];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Dofs in two strips come back as they were, from the positions that the layout gives them:
    /// lines of nodes, one of them cut in two, a run, and dofs between supports.
    #[test]
    fn vectors_come_back_from_layout_order() {
        let dofs = |nodes: Range<usize>, first: usize| {
            nodes.flat_map(move |node| [first + node, first + 40 + node, first + 80 + node])
        };
        let places: Vec<usize> = [41, 2]
            .into_iter()
            .chain(dofs(5..15, 0))
            .chain([16])
            .chain(dofs(20..30, 0))
            .chain(dofs(0..18, 130))
            .chain(300..320)
            .collect();
        let layout = Layout::in_strips(places.iter().copied(), [130]);
        let count = |strip: usize| {
            let Strip { lines, runs, others, .. } = &layout.strips[strip];
            [lines.len(), runs.len(), others.len()]
        };
        assert_eq!([count(0), count(1)], [[2, 0, 3], [1, 1, 0]]);
        let x: Vec<f64> = (0..places.len()).map(|dof| 1.0 + dof as f64).collect();
        // The second strip comes first in the work space.
        let slots = [Slot::new(0, 200..330), Slot::new(1, 0..190)];
        let simd = pulp::Scalar::new();
        let mut laid = vec![7.0; 330];
        slots.iter().for_each(|slot| layout.lay_out(simd, slot, &x, &mut laid));
        let address = |place: usize| if place < 130 { place + 200 } else { place - 130 };
        assert!(places.iter().zip(&x).all(|(place, value)| laid[address(*place)] == *value));
        assert!(
            (0..320).filter(|place| layout.is_free(*place as u32)).all(|place| laid[address(place)] == 0.0)
        );
        let mut back = vec![0.0; x.len()];
        let mut left = laid.clone();
        slots.iter().for_each(|slot| layout.take::<_, false>(simd, slot, &mut left, &mut back));
        assert!(back == x && slots.iter().all(|slot| left[slot.places()].iter().all(|left| *left == 0.0)));
        slots.iter().for_each(|slot| layout.take::<_, true>(simd, slot, &mut laid, &mut back));
        assert!(back.iter().zip(&x).all(|(back, x)| *back == 2.0 * x));
    }
}
