//! Pairs of neighbouring triangles that are multiplied as one quadrilateral.
//!
//! A rectangle of a regular mesh that is divided into two triangles has four nodes, and its
//! triangles six between them. Their products are computed together, so that each node is read and
//! written once. The assembled matrix remains that of the triangles: the joined root has the
//! rounding errors of a root, which cost half as many digits as those of a matrix.

use super::{Bending, ElementMatrix};
use nalgebra::DMatrix;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::rc::Rc;

/// Number of dofs of a triangle.
const TRIANGLE: usize = 9;

/// Smallest number of pairs of the same two classes that are joined.
const LEAST_PAIRS: usize = 8;

/// Cell of a form: its free dofs and its class. Cells of one class have the same local values.
pub(super) type Cell = (Rc<[Option<usize>]>, usize);

/// Number of each node of the second triangle of a pair in the quadrilateral, whose nodes 0, 1 and
/// 2 are those of the first.
type Nodes = [usize; 3];

/// Cell of a form, or a pair of triangles that are multiplied as one.
#[derive(Debug)]
pub(super) struct Unit {
    /// Number of the cell, or of the first triangle.
    pub cell: usize,
    /// Number of the second triangle and its nodes.
    pub second: Option<(usize, Nodes)>,
    /// Free dofs, like those of a cell.
    pub dofs: Rc<[Option<usize>]>,
    /// Classes of the two cells, of which the second is 0 for a single one. Units with equal
    /// classes, and equally many dofs, have the same local values.
    pub classes: [usize; 2],
}

impl Unit {
    pub fn single(cell: usize, (dofs, class): &Cell) -> Unit {
        Unit { cell, second: None, dofs: dofs.clone(), classes: [*class, 0] }
    }

    fn pair(cell: usize, [first, second]: [&Cell; 2], nodes: Nodes) -> Unit {
        let new = nodes.iter().position(|&node| node == 3).unwrap_or(0);
        let dofs = first.0.iter().chain(&second.0[3 * new..3 * new + 3]).copied().collect();
        let classes = [first.1, second.1 + 1];
        Unit { cell, second: Some((cell + 1, nodes)), dofs, classes }
    }

    /// Returns the local matrix, row by row, given those of all cells.
    pub fn matrix<'a>(&self, blocks: &'a [ElementMatrix]) -> Cow<'a, [f64]> {
        let own = &blocks[self.cell].matrix;
        let Some((second, nodes)) = self.second else { return Cow::Borrowed(own) };
        let size = self.dofs.len();
        let mut matrix = vec![0.0; size * size];
        for (of_cell, nodes) in [(own, [0, 1, 2]), (&blocks[second].matrix, nodes)] {
            for (at, entry) in of_cell.iter().enumerate() {
                matrix[place(nodes, at / TRIANGLE) * size + place(nodes, at % TRIANGLE)] += entry;
            }
        }
        Cow::Owned(matrix)
    }

    /// Returns the factored representation of the local matrix, given those of all cells.
    pub fn bending<'a>(&self, blocks: &'a [ElementMatrix]) -> Option<Cow<'a, Bending>> {
        let own = blocks[self.cell].bending.as_deref()?;
        let Some((second, nodes)) = self.second else { return Some(Cow::Borrowed(own)) };
        Some(Cow::Owned(joined(own, blocks[second].bending.as_deref()?, nodes)))
    }

    /// Returns the entries of one of its cells, one per local dof of that cell, at the local dofs
    /// of the unit.
    pub fn expanded<'a>(&self, cell: usize, entries: &'a [f64]) -> Cow<'a, [f64]> {
        let Some((second, nodes)) = self.second else { return Cow::Borrowed(entries) };
        let nodes = if cell == second { nodes } else { [0, 1, 2] };
        let mut expanded = vec![0.0; self.dofs.len()];
        for (dof, entry) in entries.iter().enumerate() {
            expanded[place(nodes, dof)] = *entry;
        }
        Cow::Owned(expanded)
    }
}

/// Returns the place of a local dof of a triangle with these nodes.
fn place(nodes: Nodes, dof: usize) -> usize {
    3 * nodes[dof / 3] + dof % 3
}

/// Returns the representation of two triangles with some common nodes as one.
fn joined(first: &Bending, second: &Bending, nodes: Nodes) -> Bending {
    let [of_first, of_second] = [first, second].map(|of| [[0.0; 2], of.arms[0], of.arms[1]]);
    let new = nodes.iter().position(|&node| node == 3).unwrap_or(0);
    let common = (new + 1) % 3;
    let axis = |k: usize| of_first[nodes[common]][k] + (of_second[new][k] - of_second[common][k]);
    let arms = vec![of_first[1], of_first[2], [axis(0), axis(1)]];
    // The columns of the first node, which the deformation does not have, are omitted in the end.
    let mut strains = DMatrix::<f64>::zeros(12, 12);
    let size = TRIANGLE - 3;
    for (at, entry) in first.root.iter().enumerate() {
        strains[(at / size, 3 + at % size)] = *entry;
    }
    for (at, entry) in second.root.iter().enumerate() {
        let (row, dof) = (size + at / size, 3 + at % size);
        strains[(row, place(nodes, dof))] += entry;
        // The second triangle's own first node balances its other nodes.
        strains[(row, place(nodes, dof % 3))] -= entry;
        if dof % 3 == 0 {
            for (slope, arm) in of_second[dof / 3].into_iter().enumerate() {
                strains[(row, place(nodes, 1 + slope))] -= entry * arm;
            }
        }
    }
    let root = strains.remove_columns(0, 3).qr().r();
    Bending { arms, root: root.transpose().as_slice().into() }
}

/// Joins triangles with a triangle that follows them in the list, where many pairs of the same two
/// classes have the same two nodes in common. Cells from class `bare` on remain single.
pub(super) fn units(cells: &[Cell], bare: usize) -> Vec<Unit> {
    let is_triangle = |(dofs, class): &Cell| dofs.len() == TRIANGLE && *class < bare;
    let mut nodes_of: BTreeMap<[usize; 2], (usize, Option<Nodes>)> = BTreeMap::new();
    for pair in cells.windows(2) {
        let [first, second] = [&pair[0], &pair[1]];
        if let Some(nodes) =
            common_nodes(&first.0, &second.0).filter(|_| is_triangle(first) && is_triangle(second))
        {
            let (count, known) = nodes_of.entry([first.1, second.1]).or_insert((0, Some(nodes)));
            *count += 1;
            *known = known.filter(|known| *known == nodes);
        }
    }
    let mut units = Vec::with_capacity(cells.len());
    let mut rest = cells;
    while let [first, others @ ..] = rest {
        let number = cells.len() - rest.len();
        let joined = others.first().and_then(|second| {
            let &(count, nodes) = nodes_of.get(&[first.1, second.1])?;
            let nodes = nodes.filter(|&nodes| count >= LEAST_PAIRS && fit(&first.0, &second.0, nodes))?;
            (first.0.len() == TRIANGLE && second.0.len() == TRIANGLE)
                .then(|| Unit::pair(number, [first, second], nodes))
        });
        rest = if joined.is_some() { &others[1..] } else { others };
        units.push(joined.unwrap_or_else(|| Unit::single(number, first)));
    }
    units
}

/// Returns the nodes of the second triangle of a pair, where free dofs show that it has two nodes
/// in common with the first.
fn common_nodes(first: &[Option<usize>], second: &[Option<usize>]) -> Option<Nodes> {
    let (own, _) = first.as_chunks::<3>();
    let (others, _) = second.as_chunks::<3>();
    let others: &[_; 3] = others.try_into().ok()?;
    let nodes = others.map(|node| {
        let is_free = node.iter().any(Option::is_some);
        own.iter().position(|of_first| is_free && *of_first == node).unwrap_or(3)
    });
    (nodes.iter().filter(|&&node| node == 3).count() == 1).then_some(nodes)
}

/// Returns whether two triangles have these nodes in common, as far as their free dofs show.
fn fit(first: &[Option<usize>], second: &[Option<usize>], nodes: Nodes) -> bool {
    let (own, _) = first.as_chunks::<3>();
    let (others, _) = second.as_chunks::<3>();
    own.len() == 3
        && others.len() == 3
        && others.iter().zip(nodes).all(|(node, number)| match number {
            3 => node.iter().all(Option::is_none) || !own.contains(node),
            number => own[number] == *node,
        })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::random::number;

    /// Returns a triangle with these corners and any root.
    fn triangle(corners: [[f64; 2]; 3], seed: usize) -> Bending {
        let arm = |corner: [f64; 2]| [corner[0] - corners[0][0], corner[1] - corners[0][1]];
        let entry = |place: usize| if place / 6 > place % 6 { 0.0 } else { number(seed + place) };
        Bending { arms: vec![arm(corners[1]), arm(corners[2])], root: (0..36).map(entry).collect() }
    }

    /// Returns a cell with these nodes, those below `held` without dofs.
    fn cell(nodes: [usize; 3], held: usize, class: usize) -> Cell {
        let dofs =
            nodes.iter().flat_map(|&node| (0..3).map(move |dof| (node >= held).then_some(3 * node + dof)));
        (dofs.collect(), class)
    }

    /// However the second triangle numbers its nodes, the pair has the product of both, and its
    /// matrix and its expanded rows are those of this product.
    #[test]
    fn pairs_have_the_products_of_both_triangles() {
        let corners = [[0.3, 0.1], [1.4, 0.2], [1.2, 0.9], [0.1, 0.7]];
        for nodes in [[0, 2, 3], [2, 3, 0], [3, 0, 2], [1, 3, 2], [3, 1, 0]] {
            let bendings = [
                triangle([corners[0], corners[1], corners[2]], 0),
                triangle(nodes.map(|node| corners[node]), 40),
            ];
            let cells = [cell([0, 1, 2], 0, 5), cell(nodes, 0, 3)];
            assert_eq!(common_nodes(&cells[0].0, &cells[1].0), Some(nodes));
            let unit = Unit::pair(0, [&cells[0], &cells[1]], nodes);
            assert!(unit.dofs.iter().copied().eq((0..12).map(Some)));
            let blocks: Vec<ElementMatrix> = bendings
                .iter()
                .zip(&cells)
                .map(|(bending, (dofs, class))| {
                    let unit_product = |dof: usize| {
                        bending.product(&std::array::from_fn::<f64, 9, _>(|k| f64::from(k == dof)))
                    };
                    let matrix = (0..9).flat_map(unit_product).collect();
                    ElementMatrix {
                        dofs: dofs.clone(),
                        matrix,
                        bending: Some(Rc::new(bending.clone())),
                        class: *class,
                    }
                })
                .collect();
            let values: [f64; 12] = std::array::from_fn(|dof| number(100 + dof));
            let mut expected = vec![0.0; 12];
            for (number, nodes) in [[0, 1, 2], nodes].into_iter().enumerate() {
                let own: [f64; 9] = std::array::from_fn(|dof| values[place(nodes, dof)]);
                let forces = bendings[number].product(&own);
                let expanded = unit.expanded(number, &forces);
                expected.iter_mut().zip(&*expanded).for_each(|(sum, force)| *sum += force);
            }
            let close =
                |forces: &[f64]| forces.iter().zip(&expected).all(|(a, b)| (a - b).abs() <= 1e-13 * 20.0);
            let joined = unit.bending(&blocks).unwrap();
            assert!(joined.root.iter().enumerate().all(|(at, entry)| at / 9 <= at % 9 || *entry == 0.0));
            assert!(close(&joined.product(&values)), "{nodes:?}");
            let matrix = unit.matrix(&blocks);
            let rows = matrix.chunks_exact(12);
            let by_matrix: Vec<f64> =
                rows.map(|row| row.iter().zip(&values).map(|(a, x)| a * x).sum()).collect();
            assert!(close(&by_matrix), "{nodes:?}");
        }
    }

    /// All pairs of a regular mesh are joined, beside a support too, and cells of other kinds are
    /// not.
    #[test]
    fn regular_meshes_are_joined() {
        let (columns, rows) = (4, 3);
        let mut cells: Vec<Cell> = vec![(vec![Some(0), Some(1)].into(), 9)];
        for rectangle in 0..columns * rows {
            // Nodes are numbered along y, so that a support holds the first ones.
            let node = |i: usize, j: usize| (rectangle % columns + i) * (rows + 1) + rectangle / columns + j;
            cells.push(cell([node(0, 0), node(1, 0), node(1, 1)], rows + 1, 0));
            cells.push(cell([node(0, 0), node(1, 1), node(0, 1)], rows + 1, 1));
        }
        let pairs = units(&cells, 1 << 40);
        assert_eq!(pairs.len(), 1 + columns * rows);
        assert!(pairs[0].second.is_none());
        for (number, pair) in pairs[1..].iter().enumerate() {
            assert_eq!((pair.cell, pair.second), (2 * number + 1, Some((2 * number + 2, [0, 2, 3]))));
            assert_eq!((pair.dofs.len(), pair.classes), (12, [0, 2]));
        }
        let single = |units: Vec<Unit>| units.iter().all(|unit| unit.second.is_none());
        assert!(single(units(&cells, 0)), "no class may be joined");
        assert!(single(units(&cells[..15], 1 << 40)), "a few pairs are not worth it");
        let other: Vec<Cell> = cells.iter().enumerate().map(|(at, (dofs, _))| (dofs.clone(), at)).collect();
        assert!(single(units(&other, 1 << 40)), "no two pairs are alike");
    }
}
