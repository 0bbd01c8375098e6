//! Order of the engine's own vectors, which suits products cell by cell.
//!
//! In a vector numbered node by node the dofs of a cell lie far apart, and gathering them one at a
//! time costs more than all the arithmetic of the cell. A [`Layout`] puts the dofs of one kind side
//! by side along the lines of the mesh. Eight congruent cells in a row then read each of their
//! local dofs at once, from eight consecutive positions.

use super::lane_values::LANES;
use pulp::Simd;
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
    lines: Vec<Line>,
    runs: Vec<Run>,
    /// Dof and position of all others.
    others: Vec<(u32, u32)>,
}

/// Nodes with three dofs each, numbered one after the other, whose dofs of each kind lie side by
/// side in layout order.
#[derive(Debug, Clone, Copy)]
struct Line {
    dof: u32,
    nodes: u32,
    /// Positions of the first node's dofs.
    places: [u32; 3],
}

/// Dofs that have the same order in both.
#[derive(Debug, Clone, Copy)]
struct Run {
    dof: u32,
    count: u32,
    place: u32,
}

impl Line {
    /// Returns the longest line that begins with a dof, given the positions of all dofs; `None` if
    /// it fills no vector register.
    fn at(dof: usize, places: &[u32]) -> Option<Line> {
        let (nodes, _) = places[dof..].as_chunks::<3>();
        let places = *nodes.first()?;
        let follows = |&(k, node): &(u32, &[u32; 3])| *node == places.map(|place| place + k);
        let nodes = (0..).zip(nodes).take_while(follows).count();
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

    /// Returns the dofs of each kind, some nodes at a time and the rest one by one.
    #[inline(always)]
    fn kinds<'a, const NODES: usize>(
        &self,
        laid: &'a mut [f64],
    ) -> [(&'a mut [[f64; NODES]], &'a mut [f64]); 3] {
        // Different dofs have different places.
        let kinds = laid.get_disjoint_mut(self.places()).unwrap_or_default();
        kinds.map(<[f64]>::as_chunks_mut)
    }

    /// Copies the dofs from x to their positions, some nodes at a time.
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

    /// Moves the dofs from their positions to x, some nodes at a time, and leaves zeros.
    #[inline(always)]
    fn take<const NODES: usize>(&self, laid: &mut [f64], x: &mut [f64]) {
        let (nodes, _) = x[self.dofs()].as_chunks_mut::<3>();
        let ((nodes, last), [w, w_x, w_y]) = (nodes.as_chunks_mut::<NODES>(), self.kinds(laid));
        for (((node, w), w_x), w_y) in nodes.iter_mut().zip(w.0).zip(w_x.0).zip(w_y.0) {
            *node = by_node([w, w_x, w_y].map(|kind| replace(kind, [0.0; NODES])));
        }
        for (((node, w), w_x), w_y) in last.iter_mut().zip(w.1).zip(w_x.1).zip(w_y.1) {
            *node = [take(w), take(w_x), take(w_y)];
        }
    }
}

impl Run {
    /// Returns the longest run that begins with a dof, given the positions of all dofs; `None` if
    /// it fills no vector register.
    fn at(dof: usize, places: &[u32]) -> Option<Run> {
        let place = places[dof];
        let count = (place..).zip(&places[dof..]).take_while(|(next, place)| next == *place).count();
        (count >= LANES).then_some(Run { dof: dof as u32, count: count as u32, place })
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
    /// Creates a layout with the given position for each dof; no two dofs share one.
    pub fn new(places: impl IntoIterator<Item = usize>) -> Layout {
        let places: Vec<u32> = places.into_iter().map(|place| place as u32).collect();
        let mut taken = vec![false; places.iter().max().map_or(0, |&last| last as usize + 1)];
        for &place in &places {
            debug_assert!(!taken[place as usize], "two dofs at place {place}");
            taken[place as usize] = true;
        }
        let (mut lines, mut runs, mut others) = (Vec::new(), Vec::new(), Vec::new());
        let mut dof = 0;
        while dof < places.len() {
            if let Some(line) = Line::at(dof, &places) {
                dof = line.dofs().end;
                lines.push(line);
            } else if let Some(run) = Run::at(dof, &places) {
                dof = run.dofs().end;
                runs.push(run);
            } else {
                others.push((dof as u32, places[dof]));
                dof += 1;
            }
        }
        Layout { places, taken, lines, runs, others }
    }

    /// Returns the number of dofs.
    pub fn dofs(&self) -> usize {
        self.places.len()
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

    /// Copies the dofs from x to their positions.
    #[inline(always)]
    pub(crate) fn lay_out<S: Simd>(&self, _: S, x: &[f64], laid: &mut [f64]) {
        for line in &self.lines {
            if S::F64_LANES == LANES {
                line.lay_out::<LANES>(x, laid);
            } else {
                line.lay_out::<FEW>(x, laid);
            }
        }
        for run in &self.runs {
            laid[run.places()].copy_from_slice(&x[run.dofs()]);
        }
        for &(dof, place) in &self.others {
            laid[place as usize] = x[dof as usize];
        }
    }

    /// Moves the dofs from their positions to x, and leaves zeros.
    #[inline(always)]
    pub(crate) fn take<S: Simd>(&self, _: S, laid: &mut [f64], x: &mut [f64]) {
        for line in &self.lines {
            if S::F64_LANES == LANES {
                line.take::<LANES>(laid, x);
            } else {
                line.take::<FEW>(laid, x);
            }
        }
        for run in &self.runs {
            x[run.dofs()].copy_from_slice(&laid[run.places()]);
            laid[run.places()].fill(0.0);
        }
        for &(dof, place) in &self.others {
            x[dof as usize] = take(&mut laid[place as usize]);
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Dofs come back as they were, from the positions that the layout gives them: lines of nodes,
    /// a run, and dofs between supports.
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
        let layout = Layout::new(places.iter().copied());
        assert_eq!([layout.lines.len(), layout.runs.len(), layout.others.len()], [3, 1, 3]);
        let x: Vec<f64> = (0..places.len()).map(|dof| 1.0 + dof as f64).collect();
        let simd = pulp::Scalar::new();
        let mut laid = vec![0.0; 330];
        layout.lay_out(simd, &x, &mut laid);
        assert!(places.iter().zip(&x).all(|(place, value)| laid[*place] == *value));
        let mut back = vec![0.0; x.len()];
        layout.take(simd, &mut laid, &mut back);
        assert!(back == x && laid.iter().all(|value| *value == 0.0));
    }
}
