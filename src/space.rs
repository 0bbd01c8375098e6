//! The space of deflections: three dofs (w, w_x, w_y) a node, those that supports hold left out.

use crate::error::{Error, Result};
use crate::linalg::Layout;
use crate::mesh::{Mesh, Point};
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Dofs of a node: the deflection and its two slopes.
pub const PER_NODE: usize = 3;

/// What a support holds along an edge.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Support {
    /// No deflection and no slope.
    Clamped,
    /// No deflection, free to turn.
    SimplySupported,
    /// No slope, free to move.
    Guided,
}

impl Support {
    /// Which of w, the slope along the edge and the slope across it are held.
    fn holds(self) -> [bool; 3] {
        match self {
            Support::Clamped => [true, true, true],
            // w = 0 all along the edge takes the slope along it with it.
            Support::SimplySupported => [true, true, false],
            Support::Guided => [false, false, true],
        }
    }
}

/// The numbering of the free dofs, node by node.
#[derive(Debug, Clone, PartialEq)]
pub struct Space {
    free: Vec<Option<usize>>,
    count: usize,
}

impl Space {
    /// All dofs of a mesh, before supports.
    pub fn unsupported(mesh: &Mesh) -> Space {
        let count = PER_NODE * mesh.nodes.len();
        Space { free: (0..count).map(Some).collect(), count }
    }

    /// The dofs that supports on named edges leave free.
    ///
    /// # Errors
    /// As [`Space::held`].
    pub fn new<'n>(mesh: &Mesh, supports: impl IntoIterator<Item = (&'n str, Support)>) -> Result<Space> {
        let mut count = 0;
        let number = |held: bool| {
            (!held).then(|| {
                count += 1;
                count - 1
            })
        };
        let free = Space::held(mesh, supports)?.into_iter().map(number).collect();
        Ok(Space { free, count })
    }

    /// Which dofs supports on named edges hold, node by node.
    ///
    /// # Errors
    /// [`Error::Mesh`] for an edge that the mesh does not have, or one not parallel to an axis with a support that
    /// distinguishes its directions.
    pub fn held<'n>(
        mesh: &Mesh,
        supports: impl IntoIterator<Item = (&'n str, Support)>,
    ) -> Result<Vec<bool>> {
        let mut held = vec![false; PER_NODE * mesh.nodes.len()];
        for (name, support) in supports {
            mesh.edge_nodes(name)?;
            let [w, along, across] = support.holds();
            for &[a, b] in &mesh.edges[name] {
                let side = mesh.nodes[b] - mesh.nodes[a];
                let slopes = if along == across {
                    [along, along]
                } else if side.y == 0.0 {
                    [along, across]
                } else if side.x == 0.0 {
                    [across, along]
                } else {
                    return Err(Error::Mesh(format!(
                        "edge \"{name}\" runs askew between ({}, {}) and ({}, {}): only clamped supports can stand there",
                        mesh.nodes[a].x, mesh.nodes[a].y, mesh.nodes[b].x, mesh.nodes[b].y
                    )));
                };
                for node in [a, b] {
                    for (dof, holds) in [w, slopes[0], slopes[1]].into_iter().enumerate() {
                        held[PER_NODE * node + dof] |= holds;
                    }
                }
            }
        }
        Ok(held)
    }

    /// Number of free dofs.
    pub fn dofs(&self) -> usize {
        self.count
    }

    /// Number of the deflection of a node, if it is free.
    pub fn deflection(&self, node: usize) -> Option<usize> {
        self.free[PER_NODE * node]
    }

    /// Numbers of all dofs of some nodes, node by node.
    pub fn dofs_of<'s>(&'s self, nodes: &'s [usize]) -> impl Iterator<Item = Option<usize>> + 's {
        nodes.iter().flat_map(|&node| self.free[PER_NODE * node..PER_NODE * (node + 1)].iter().copied())
    }

    /// Free deflection dofs and their nodes, ascending.
    pub fn deflections(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.free.len() / PER_NODE).filter_map(|node| Some((self.deflection(node)?, node)))
    }

    /// An order of the dofs for products cell by cell: kind by kind, along the lines of nodes in x.
    pub fn layout(&self, mesh: &Mesh) -> Layout {
        let nodes = mesh.nodes.len();
        let mut order: Vec<usize> = (0..nodes).collect();
        order.sort_by(|&a, &b| {
            let (a, b) = (mesh.nodes[a], mesh.nodes[b]);
            a.y.total_cmp(&b.y).then(a.x.total_cmp(&b.x))
        });
        let mut rank = vec![0; nodes];
        for (place, &node) in order.iter().enumerate() {
            rank[node] = place;
        }
        let place = |(dof, free): (usize, &Option<usize>)| {
            free.is_some().then(|| dof % PER_NODE * nodes + rank[dof / PER_NODE])
        };
        Layout::new(self.free.iter().enumerate().filter_map(place))
    }

    /// The rigid motions that the supports leave, in words; `None` where they leave none.
    pub fn mechanism(&self, mesh: &Mesh) -> Option<&'static str> {
        let centre = mesh.nodes.iter().fold(Point::origin(), |c, p| c + p.coords / mesh.nodes.len() as f64);
        let size = mesh.nodes.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
        // w = a + b (x - x_c) / size + c (y - y_c) / size, seen by each held dof.
        let mut seen = Matrix3::zeros();
        for (node, point) in mesh.nodes.iter().enumerate() {
            let arm = (point - centre) / size;
            let rows =
                [Vector3::new(1.0, arm.x, arm.y), Vector3::new(0.0, 1.0, 0.0), Vector3::new(0.0, 0.0, 1.0)];
            for (dof, row) in rows.iter().enumerate() {
                if self.free[PER_NODE * node + dof].is_none() {
                    seen += row * row.transpose();
                }
            }
        }
        let eigen = SymmetricEigen::new(seen);
        let loose = eigen.eigenvalues.iter().filter(|&&value| value < 1e-9).count();
        match loose {
            0 => None,
            1 => {
                let (which, _) = eigen.eigenvalues.argmin();
                let motion = eigen.eigenvectors.column(which);
                Some(if motion[0].abs() > 0.999 {
                    "it can move up and down"
                } else {
                    "it can turn about a line"
                })
            }
            2 => Some("it can move up and down and turn about a line"),
            _ => Some("nothing holds it"),
        }
    }
}
