//! Uniform refinement of a mesh.

use std::collections::HashMap;

use super::{Cell, Mesh, Point};

impl Mesh {
    /// Returns the mesh with every cell divided into four by the midpoints of its edges. Named
    /// parts keep their names.
    ///
    /// The old nodes keep their numbers. Cell `k` becomes cells `4k` to `4k + 3`: first the one at
    /// each of its corners, in order (for a triangle, then the middle one).
    pub fn refine(&self) -> Mesh {
        let mut nodes = self.nodes.clone();
        let mut midpoints = HashMap::new();
        let mut midpoint = |nodes: &mut Vec<Point>, a: usize, b: usize| {
            *midpoints.entry([a.min(b), a.max(b)]).or_insert_with(|| {
                nodes.push(nalgebra::center(&nodes[a], &nodes[b]));
                nodes.len() - 1
            })
        };

        let mut cells = Vec::with_capacity(4 * self.cells.len());
        for cell in &self.cells {
            match *cell {
                Cell::Triangle([a, b, c]) => {
                    let [ab, bc, ca] = [[a, b], [b, c], [c, a]].map(|[i, j]| midpoint(&mut nodes, i, j));
                    cells.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]].map(Cell::Triangle));
                }
                Cell::Quadrilateral([a, b, c, d]) => {
                    let [ab, bc, cd, da] =
                        [[a, b], [b, c], [c, d], [d, a]].map(|[i, j]| midpoint(&mut nodes, i, j));
                    nodes.push(nalgebra::center(
                        &nalgebra::center(&nodes[a], &nodes[c]),
                        &nalgebra::center(&nodes[b], &nodes[d]),
                    ));
                    let m = nodes.len() - 1;
                    cells.extend(
                        [[a, ab, m, da], [b, bc, m, ab], [c, cd, m, bc], [d, da, m, cd]]
                            .map(Cell::Quadrilateral),
                    );
                }
            }
        }

        let mut halves = |edges: &Vec<[usize; 2]>| {
            let mut fine = Vec::with_capacity(2 * edges.len());
            for &[a, b] in edges {
                let m = midpoint(&mut nodes, a, b);
                fine.extend([[a, m], [m, b]]);
            }
            fine
        };
        let edges = self.edges.iter().map(|(name, edges)| (name.clone(), halves(edges))).collect();
        let quarters = |cells: &Vec<usize>| cells.iter().flat_map(|cell| 4 * cell..4 * cell + 4).collect();
        let groups = self.groups.iter().map(|(name, cells)| (name.clone(), quarters(cells))).collect();
        let (points, notes) = (self.points.clone(), self.notes.clone());
        Mesh { nodes, cells, elements: self.elements, edges, groups, points, slits: self.slits, notes }
    }
}
