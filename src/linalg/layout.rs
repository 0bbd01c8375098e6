//! Order of the engine's own vectors, which suits products cell by cell.
//!
//! In a vector numbered node by node the dofs of a cell lie far apart, and gathering them one at a
//! time costs more than all the arithmetic of the cell. A [`Layout`] puts the dofs of one kind side
//! by side along the lines of the mesh. Eight congruent cells in a row then read each of their
//! local dofs at once, from eight consecutive positions.

use super::lane_values::LANES;
use super::vectors::waxpy;
use super::wide::widest;
use pulp::Arch;
use std::ops::Range;

/// Position of each dof in the engine's own vectors.
///
/// A vector in *layout order* has more positions than there are dofs: some belong to dofs that
/// supports hold, and some at the end to none. An operand is zero there, and what a product writes
/// there is never read.
#[derive(Debug, Clone)]
pub struct Layout {
    /// Position of each dof.
    places: Vec<u32>,
    /// Whether each position belongs to a dof.
    taken: Vec<bool>,
    /// Whether the position of each dof is its index.
    is_identity: bool,
    /// Lines of nodes, and the dofs outside of them, each with its position.
    lines: Vec<Line>,
    others: Vec<(u32, u32)>,
    arch: Arch,
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

impl Line {
    /// Returns the longest line that begins with a dof, given the positions of all dofs; `None` if
    /// it fills no vector register.
    fn at(dof: usize, places: &[u32]) -> Option<Line> {
        let (nodes, _) = places[dof..].as_chunks::<3>();
        let first = *nodes.first()?;
        let follows = |&(k, node): &(u32, &[u32; 3])| *node == first.map(|place| place + k);
        let nodes = (0..).zip(nodes).take_while(follows).count();
        (nodes >= LANES).then_some(Line { dof: dof as u32, nodes: nodes as u32, places: first })
    }

    /// Returns the dofs of all nodes.
    fn dofs(&self) -> Range<usize> {
        self.dof as usize..(self.dof + 3 * self.nodes) as usize
    }

    /// Returns the positions of the dofs of each kind.
    fn positions(&self) -> [Range<usize>; 3] {
        self.places.map(|place| place as usize..(place + self.nodes) as usize)
    }

    /// Returns the dofs of each kind of a vector in layout order.
    #[inline(always)]
    fn of<'a>(&self, laid: &'a [f64]) -> [&'a [f64]; 3] {
        self.positions().map(|range| &laid[range])
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
        let is_identity = places.iter().enumerate().all(|(dof, &place)| dof == place as usize);
        let (mut lines, mut others) = (Vec::new(), Vec::new());
        let mut dof = 0;
        while dof < places.len() {
            if let Some(line) = Line::at(dof, &places) {
                dof = line.dofs().end;
                lines.push(line);
            } else {
                others.push((dof as u32, places[dof]));
                dof += 1;
            }
        }
        Layout { places, taken, is_identity, lines, others, arch: Arch::new() }
    }

    /// Returns the number of dofs.
    pub fn dofs(&self) -> usize {
        self.places.len()
    }

    /// Returns a vector of zeros in layout order.
    pub(super) fn zeros(&self) -> Vec<f64> {
        vec![0.0; self.taken.len() + LANES]
    }

    /// Returns the first of the free positions, one per lane, that lanes without a dof use.
    pub(super) fn nowhere(&self) -> u32 {
        self.taken.len() as u32
    }

    /// Returns whether no dof has the position.
    pub(super) fn is_free(&self, place: u32) -> bool {
        self.taken.get(place as usize).is_none_or(|taken| !taken)
    }

    /// Returns the position of each dof of a cell in the laid-out vectors; `None` for a constrained
    /// dof.
    pub(super) fn places_of(&self, dofs: &[Option<usize>]) -> impl Iterator<Item = Option<u32>> {
        dofs.iter().map(|dof| dof.map(|dof| self.places[dof]))
    }

    /// Copies a vector into layout order; positions without dofs stay unchanged.
    pub(super) fn lay_out(&self, x: &[f64], laid: &mut [f64]) {
        if self.is_identity {
            return laid[..x.len()].copy_from_slice(x);
        }
        widest(
            self.arch,
            #[inline(always)]
            || {
                for line in &self.lines {
                    // The positions are those of different dofs.
                    if let Ok([w, w_x, w_y]) = laid.get_disjoint_mut(line.positions()) {
                        let (nodes, _) = x[line.dofs()].as_chunks::<3>();
                        for (((value, w), w_x), w_y) in nodes.iter().zip(w).zip(w_x).zip(w_y) {
                            [*w, *w_x, *w_y] = *value;
                        }
                    }
                }
            },
        );
        for &(dof, place) in &self.others {
            laid[place as usize] = x[dof as usize];
        }
    }

    /// Copies a vector in layout order back into x.
    pub(super) fn collect(&self, laid: &[f64], x: &mut [f64]) {
        if self.is_identity {
            return x.copy_from_slice(&laid[..x.len()]);
        }
        widest(
            self.arch,
            #[inline(always)]
            || {
                for line in &self.lines {
                    let [w, w_x, w_y] = line.of(laid);
                    let (nodes, _) = x[line.dofs()].as_chunks_mut::<3>();
                    for (((value, w), w_x), w_y) in nodes.iter_mut().zip(w).zip(w_x).zip(w_y) {
                        *value = [*w, *w_x, *w_y];
                    }
                }
            },
        );
        for &(dof, place) in &self.others {
            x[dof as usize] = laid[place as usize];
        }
    }

    /// Copies a vector `part` in layout order back into z, and sets y to `rest` + weight `part`.
    pub(super) fn collect_with_part(
        &self,
        weight: f64,
        part: &[f64],
        rest: &[f64],
        (y, z): (&mut [f64], &mut [f64]),
    ) {
        if self.is_identity {
            z.copy_from_slice(&part[..z.len()]);
            return waxpy(weight, z, &rest[..z.len()], y);
        }
        widest(
            self.arch,
            #[inline(always)]
            || {
                for line in &self.lines {
                    let (y, _) = y[line.dofs()].as_chunks_mut::<3>();
                    let (z, _) = z[line.dofs()].as_chunks_mut::<3>();
                    let [w, w_x, w_y] = line.of(part);
                    let [rest_w, rest_x, rest_y] = line.of(rest);
                    let parts = w.iter().zip(w_x).zip(w_y);
                    let rests = rest_w.iter().zip(rest_x).zip(rest_y);
                    for (((y, z), ((w, w_x), w_y)), ((rest_w, rest_x), rest_y)) in
                        y.iter_mut().zip(z).zip(parts).zip(rests)
                    {
                        *z = [*w, *w_x, *w_y];
                        *y = [rest_w + weight * w, rest_x + weight * w_x, rest_y + weight * w_y];
                    }
                }
            },
        );
        for &(dof, place) in &self.others {
            let (dof, place) = (dof as usize, place as usize);
            z[dof] = part[place];
            y[dof] = rest[place] + weight * part[place];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two lines of ten nodes, before and between which supports hold some dofs, come back as they
    /// were, from the positions that the layout gives them.
    #[test]
    fn vectors_come_back_from_layout_order() {
        let dofs = |nodes: Range<usize>| nodes.flat_map(|node| [node, 40 + node, 80 + node]);
        let places: Vec<usize> =
            [41, 2].into_iter().chain(dofs(5..15)).chain([16]).chain(dofs(20..30)).collect();
        let layout = Layout::new(places.iter().copied());
        assert_eq!((layout.lines.len(), layout.others.len()), (2, 3));
        let x: Vec<f64> = (0..places.len()).map(|dof| 1.0 + dof as f64).collect();
        let mut laid = layout.zeros();
        layout.lay_out(&x, &mut laid);
        assert!(places.iter().zip(&x).all(|(place, value)| laid[*place] == *value));
        let mut back = vec![0.0; x.len()];
        layout.collect(&laid, &mut back);
        assert_eq!(back, x);
        let mut sum = vec![0.0; x.len()];
        let twice: Vec<f64> = laid.iter().map(|value| 2.0 * value).collect();
        layout.collect_with_part(-0.5, &laid, &twice, (&mut sum, &mut back));
        assert!(back == x && sum.iter().zip(&x).all(|(sum, x)| *sum == 1.5 * x));
    }
}
