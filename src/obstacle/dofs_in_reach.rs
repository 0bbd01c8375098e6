//! Dofs with bounds, and loops over the values that vectors have there.

use crate::kernels::wide::widest;
use pulp::Arch;
use std::ops::{Deref, Range};

/// Number of dofs of a node of the plate, of which the deflection is the first.
const NODE: usize = 3;

/// Fewest nodes of a line, which fill a vector register.
const LEAST_LINE: usize = 8;

/// Dofs with bounds, ascending: the rows of G.
///
/// Most of them are the deflections of nodes that are numbered one after the other. Loops over
/// their values read such lines without an index for each dof.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct DofsInReach {
    dofs: Vec<usize>,
    lines: Vec<Line>,
    /// Numbers of the dofs outside of lines.
    others: Vec<usize>,
}

/// Deflections of successive nodes, each followed by the other dofs of its node.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    /// Index of the first deflection among the bounded dofs, and its dof.
    bound: usize,
    dof: usize,
    nodes: usize,
}

impl Line {
    /// Returns the longest line that begins with a bounded dof; `None` if it is too short.
    fn at(bound: usize, dofs: &[usize]) -> Option<Line> {
        let pairs = dofs[bound..].windows(2);
        // A node counts once the next one shows that all its dofs are there.
        let nodes = pairs.take_while(|pair| pair[1] == pair[0] + NODE).count();
        (nodes >= LEAST_LINE).then(|| Line { bound, dof: dofs[bound], nodes })
    }

    /// Returns the numbers of the nodes among the bounded dofs.
    fn bounds(&self) -> Range<usize> {
        self.bound..self.bound + self.nodes
    }

    /// Returns the values that a vector over all dofs has at the nodes.
    #[inline(always)]
    fn nodes_of<'a>(&self, values: &'a [f64]) -> &'a [[f64; NODE]] {
        let (nodes, _) = values[self.dof..].as_chunks();
        &nodes[..self.nodes]
    }
}

impl FromIterator<usize> for DofsInReach {
    fn from_iter<I: IntoIterator<Item = usize>>(dofs: I) -> DofsInReach {
        let dofs: Vec<usize> = dofs.into_iter().collect();
        let (mut lines, mut others) = (Vec::new(), Vec::new());
        let mut bound = 0;
        while bound < dofs.len() {
            if let Some(line) = Line::at(bound, &dofs) {
                bound = line.bounds().end;
                lines.push(line);
            } else {
                others.push(bound);
                bound += 1;
            }
        }
        DofsInReach { dofs, lines, others }
    }
}

impl Deref for DofsInReach {
    type Target = [usize];

    fn deref(&self) -> &[usize] {
        &self.dofs
    }
}

impl<'a> IntoIterator for &'a DofsInReach {
    type Item = &'a usize;
    type IntoIter = std::slice::Iter<'a, usize>;

    fn into_iter(self) -> Self::IntoIter {
        self.dofs.iter()
    }
}

impl DofsInReach {
    /// Sets vectors over the bounds to a function of the values of other vectors, over all dofs and
    /// over the bounds. The function must be marked `#[inline(always)]`.
    #[inline(always)]
    pub(crate) fn map<const N: usize, const M: usize, const W: usize>(
        &self,
        of_dofs: [&[f64]; N],
        of_bounds: [&[f64]; M],
        mut to: [&mut [f64]; W],
        function: impl Fn([f64; N], [f64; M]) -> [f64; W],
    ) {
        for line in &self.lines {
            let nodes = of_dofs.map(|values| line.nodes_of(values));
            let bounds = of_bounds.map(|values| &values[line.bounds()]);
            let to = to.each_mut().map(|values| &mut values[line.bounds()]);
            for k in 0..line.nodes {
                let values = function(deflections(nodes, k), entries(bounds, k));
                for j in 0..W {
                    to[j][k] = values[j];
                }
            }
        }
        for &bound in &self.others {
            let values = function(entries(of_dofs, self.dofs[bound]), entries(of_bounds, bound));
            for j in 0..W {
                to[j][bound] = values[j];
            }
        }
    }

    /// Calls `visit` with the values at each bound of a vector over all dofs, and of some vectors
    /// over the bounds. The function must be marked `#[inline(always)]`.
    pub(crate) fn for_each<const M: usize>(
        &self,
        of_dofs: &[f64],
        of_bounds: [&[f64]; M],
        mut visit: impl FnMut(f64, [f64; M]),
    ) {
        widest(
            Arch::new(),
            #[inline(always)]
            || {
                for line in &self.lines {
                    let nodes = line.nodes_of(of_dofs);
                    let bounds = of_bounds.map(|values| &values[line.bounds()]);
                    for k in 0..line.nodes {
                        visit(nodes[k][0], entries(bounds, k));
                    }
                }
            },
        );
        for &bound in &self.others {
            visit(of_dofs[self.dofs[bound]], entries(of_bounds, bound));
        }
    }
}

/// Returns one entry of each vector.
#[inline(always)]
fn entries<const N: usize>(vectors: [&[f64]; N], index: usize) -> [f64; N] {
    let mut entries = [0.0; N];
    for j in 0..N {
        entries[j] = vectors[j][index];
    }
    entries
}

/// Returns the deflection of one node in each vector.
#[inline(always)]
fn deflections<const N: usize>(vectors: [&[[f64; NODE]]; N], node: usize) -> [f64; N] {
    let mut deflections = [0.0; N];
    for j in 0..N {
        deflections[j] = vectors[j][node][0];
    }
    deflections
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lines, dofs outside of them and the last dof of a vector are read and written where they
    /// belong.
    #[test]
    fn loops_reach_each_bound_once() {
        let dofs = [1, 2, 7].into_iter().chain((10..64).step_by(3)).chain([70, 73]);
        let dofs: DofsInReach = dofs.collect();
        assert_eq!((dofs.lines.len(), dofs.others.len()), (1, 5));
        let x: Vec<f64> = (0..74).map(f64::from).collect();
        let heights: Vec<f64> = (0..dofs.len()).map(|bound| 100.0 * bound as f64).collect();
        let expected: Vec<f64> = dofs.iter().zip(&heights).map(|(dof, height)| x[*dof] + height).collect();
        let mut sums = vec![0.0; dofs.len()];
        dofs.map(
            [&x],
            [&heights],
            [&mut sums],
            #[inline(always)]
            |[x], [height]| [x + height],
        );
        assert_eq!(sums, expected);
        let mut visited = Vec::new();
        dofs.for_each(
            &x,
            [&heights],
            #[inline(always)]
            |x, [height]| visited.push(x + height),
        );
        visited.sort_by(f64::total_cmp);
        assert_eq!(visited, expected);
    }
}
