//! Connected parts of a mesh.

use super::{Mesh, Point};
use crate::error::{Error, Result};
use crate::geometry;

/// Disjoint sets of numbers that can be united (union-find).
#[derive(Debug, Clone)]
pub(crate) struct Unions(Vec<usize>);

impl Unions {
    /// Creates one set per number.
    pub fn new(count: usize) -> Unions {
        Unions((0..count).collect())
    }

    /// Returns the least number of a set.
    pub fn first(&mut self, mut number: usize) -> usize {
        while self.0[number] != number {
            self.0[number] = self.0[self.0[number]];
            number = self.0[number];
        }
        number
    }

    /// Unites the sets of two numbers.
    pub fn unite(&mut self, one: usize, other: usize) {
        let (a, b) = (self.first(one), self.first(other));
        self.0[a.max(b)] = a.min(b);
    }

    /// Returns the index of each number's set, ordered by their least numbers, and the number of
    /// sets.
    pub fn sets(mut self) -> (Vec<usize>, usize) {
        let mut count = 0;
        let mut sets = vec![0; self.0.len()];
        for number in 0..self.0.len() {
            let first = self.first(number);
            if first == number {
                sets[number] = count;
                count += 1;
            } else {
                sets[number] = sets[first];
            }
        }
        (sets, count)
    }
}

/// Part of a mesh that shares no node with the rest.
#[derive(Debug, Clone, PartialEq)]
pub struct Part {
    /// Numbers of the cells.
    pub cells: Vec<usize>,
    /// Corners of the bounding rectangle, in m.
    pub corners: [Point; 2],
}

impl Mesh {
    /// Returns the index of the part to which each node belongs, and the number of parts.
    pub fn part_of_nodes(&self) -> (Vec<usize>, usize) {
        let mut unions = Unions::new(self.nodes.len());
        for cell in &self.cells {
            let nodes = cell.nodes();
            nodes[1..].iter().for_each(|&node| unions.unite(nodes[0], node));
        }
        unions.sets()
    }

    /// Returns the connected parts, in the order of their first nodes.
    pub fn parts(&self) -> Vec<Part> {
        let (of_node, count) = self.part_of_nodes();
        let corners =
            [Point::new(f64::INFINITY, f64::INFINITY), Point::new(f64::NEG_INFINITY, f64::NEG_INFINITY)];
        let mut parts = vec![Part { cells: Vec::new(), corners }; count];
        for (number, cell) in self.cells.iter().enumerate() {
            parts[of_node[cell.nodes()[0]]].cells.push(number);
        }
        for (node, &part) in self.nodes.iter().zip(&of_node) {
            let [low, high] = &mut parts[part].corners;
            *low = low.inf(node);
            *high = high.sup(node);
        }
        parts
    }

    /// Checks that the mesh consists of `expected` parts.
    ///
    /// # Errors
    /// Returns [`Error::Mesh`] with the number, sizes and positions of the parts.
    pub fn require_parts(&self, expected: usize) -> Result<()> {
        let (_, count) = self.part_of_nodes();
        if count == expected {
            return Ok(());
        }
        if count == 1 {
            return Err(Error::Mesh(format!("mesh.parts: the mesh is in one part; expected {expected}")));
        }
        let describe = |Part { cells, corners: [low, high] }: &Part| {
            let count = if cells.len() == 1 { "1 cell".into() } else { format!("{} cells", cells.len()) };
            format!("{count} from {} to {}", geometry::place(*low), geometry::place(*high))
        };
        let listed: Vec<String> = self.parts().iter().take(LISTED).map(describe).collect();
        let more = if count > LISTED { format!("; and {} more", count - LISTED) } else { String::new() };
        Err(Error::Mesh(format!(
            "the mesh is in {count} parts that nothing connects: {}{more}; set mesh.merge to a distance in m within which \
             nodes become one, or mesh.parts = {count} if the parts are meant to be separate",
            listed.join("; ")
        )))
    }
}

/// Number of parts that a message lists.
const LISTED: usize = 4;
