//! Division of a mesh among ranks by recursive bisection, with short interfaces.
//!
//! A part is cut in proportion to the numbers of parts that its two sides shall have. A grid is cut
//! across its longer side, any other mesh along a straight line: of four directions the one that
//! shares the fewest nodes between both sides. Long plates so become strips, compact ones blocks.

use super::{Grid, Mesh};
use std::ops::Range;

/// Angles of the normals of the lines that may cut a part, in degrees.
const NORMALS: [f64; 4] = [0.0, 90.0, 45.0, 135.0];

impl Grid {
    /// Returns the ranges of rectangles along x and y of each of `parts` parts. With more parts
    /// than rectangles, some are empty.
    pub fn blocks(&self, parts: usize) -> Vec<[Range<usize>; 2]> {
        let mut blocks = Vec::with_capacity(parts);
        let [nx, ny] = self.cells;
        divide([0..nx, 0..ny], parts, &mut blocks);
        blocks
    }
}

/// Adds the blocks of a part of a grid that is to have `parts` of them.
fn divide(block: [Range<usize>; 2], parts: usize, blocks: &mut Vec<[Range<usize>; 2]>) {
    if parts <= 1 {
        blocks.extend((parts == 1).then_some(block));
        return;
    }
    let axis = usize::from(block[1].len() > block[0].len());
    let cut = block[axis].start + share(block[axis].len(), parts);
    let [mut before, mut after] = [block.clone(), block];
    (before[axis].end, after[axis].start) = (cut, cut);
    divide(before, first_parts(parts), blocks);
    divide(after, parts - first_parts(parts), blocks);
}

/// Returns how many of some parts lie before a cut.
fn first_parts(parts: usize) -> usize {
    parts.div_ceil(2)
}

/// Returns how many of some items lie before the cut of a part that is to have `parts` parts.
fn share(items: usize, parts: usize) -> usize {
    (2 * items * first_parts(parts) + parts) / (2 * parts)
}

impl Mesh {
    /// Returns the part of each cell, of `parts` parts that are equally large to one cell.
    pub fn bisect(&self, parts: usize) -> Vec<usize> {
        let (part_of, last_mark) = (vec![0; self.cells.len()], vec![0; self.nodes.len()]);
        let mut bisection = Bisection { mesh: self, part_of, last_mark, marks: 0 };
        bisection.divide((0..self.cells.len()).collect(), 0, parts);
        bisection.part_of
    }
}

/// Bisection of a mesh under way.
struct Bisection<'m> {
    mesh: &'m Mesh,
    part_of: Vec<usize>,
    /// Last mark of each node, and the number of marks given so far.
    last_mark: Vec<usize>,
    marks: usize,
}

impl Bisection<'_> {
    /// Divides cells among the parts from `first` on.
    fn divide(&mut self, cells: Vec<usize>, first: usize, parts: usize) {
        if parts <= 1 {
            cells.into_iter().for_each(|cell| self.part_of[cell] = first);
            return;
        }
        let count = share(cells.len(), parts);
        let orders = NORMALS.map(|angle| self.along(&cells, angle));
        let shortest = orders.into_iter().min_by_key(|order| self.count_shared(order.split_at(count)));
        let mut before = shortest.unwrap_or_default();
        let after = before.split_off(count);
        self.divide(before, first, first_parts(parts));
        self.divide(after, first + first_parts(parts), parts - first_parts(parts));
    }

    /// Returns cells in the order of their centres along a direction, given by its angle to x in
    /// degrees.
    fn along(&self, cells: &[usize], angle: f64) -> Vec<usize> {
        let (sin, cos) = angle.to_radians().sin_cos();
        let place = |cell: usize| {
            let center = self.mesh.centroid(cell);
            cos * center.x + sin * center.y
        };
        let mut order: Vec<(f64, usize)> = cells.iter().map(|&cell| (place(cell), cell)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        order.into_iter().map(|(_, cell)| cell).collect()
    }

    /// Counts the nodes that cells on two sides share.
    fn count_shared(&mut self, (before, after): (&[usize], &[usize])) -> usize {
        let Bisection { mesh, last_mark, marks, .. } = self;
        *marks += 2;
        for &cell in before {
            mesh.cells[cell].nodes().iter().for_each(|&node| last_mark[node] = *marks - 1);
        }
        let nodes = after.iter().flat_map(|&cell| mesh.cells[cell].nodes());
        nodes.filter(|&&node| std::mem::replace(&mut last_mark[node], *marks) == *marks - 1).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Diagonal, ElementKind};

    fn grid(cells: [usize; 2]) -> Grid {
        Grid::new([1.2, 0.4], cells, ElementKind::Fvs, Diagonal::Right).unwrap()
    }

    /// Returns the number of rectangles of each block, after a check that blocks are disjoint.
    fn sizes(cells: [usize; 2], parts: usize) -> Vec<usize> {
        let blocks = grid(cells).blocks(parts);
        let mut count = vec![0; cells[0] * cells[1]];
        for [x, y] in &blocks {
            y.clone().for_each(|j| x.clone().for_each(|i| count[j * cells[0] + i] += 1));
        }
        assert!(count.iter().all(|count| *count == 1), "{cells:?} in {parts}: {count:?}");
        blocks.iter().map(|[x, y]| x.len() * y.len()).collect()
    }

    #[test]
    fn blocks_of_a_grid_are_strips_of_long_plates_and_squares_of_square_ones() {
        assert_eq!(grid([12, 4]).blocks(3), [[0..4, 0..4], [4..8, 0..4], [8..12, 0..4]]);
        assert_eq!(grid([8, 8]).blocks(4), [[0..4, 0..4], [0..4, 4..8], [4..8, 0..4], [4..8, 4..8]]);
        assert_eq!(sizes([320, 128], 5).into_iter().max(), Some(8192));
        assert_eq!(sizes([1, 1], 3).into_iter().sum::<usize>(), 1);
        assert_eq!(sizes([2, 3], 7).len(), 7);
    }

    #[test]
    fn a_mesh_is_cut_where_few_nodes_are_shared() {
        let mesh = Mesh::rectangle(1.2, 0.4, [12, 5], ElementKind::Hct, Diagonal::Right).unwrap();
        for parts in [2, 3, 4, 7] {
            let part_of = mesh.bisect(parts);
            let mut parts_at = vec![Vec::new(); mesh.nodes.len()];
            for (cell, &part) in part_of.iter().enumerate() {
                mesh.cells[cell].nodes().iter().for_each(|&node| parts_at[node].push(part));
            }
            parts_at.iter_mut().for_each(|parts| (parts.sort_unstable(), parts.dedup()).1);
            let shared = parts_at.iter().filter(|parts| parts.len() > 1).count();
            assert!(shared <= 6 * (parts - 1), "{parts} parts share {shared} nodes");
            let size = |part: usize| part_of.iter().filter(|other| **other == part).count();
            let sizes: Vec<usize> = (0..parts).map(size).collect();
            assert!(sizes.iter().max().unwrap() - sizes.iter().min().unwrap() <= 2, "{sizes:?}");
        }
        assert_eq!(mesh.bisect(1), vec![0; mesh.cells.len()]);
    }
}
