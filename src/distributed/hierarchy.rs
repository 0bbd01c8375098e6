//! Interpolation between the meshes that a refinement has passed, for geometric multigrid.
//!
//! A deflection of the coarse mesh is evaluated at the nodes of the fine one: its value and slopes
//! there are the dofs of the interpolated deflection. Along an edge these depend on the dofs of the
//! edge's two nodes only, and at the centre of a quadrilateral on the dofs of its four corners.
//! Nodes come from points of the same rank, so that interpolation needs few messages.
//!
//! The reduced HCT triangles of a refined mesh do not contain the coarse ones, and repeated
//! interpolation by the triangles gains energy from level to level. Where two triangles form a
//! parallelogram, the middle of its diagonal therefore takes the value of the reduced FVS
//! quadrilateral on it.
//!
//! Coarse meshes are supported at the nodes that they share with the finest one. Dofs that are held
//! on a fine mesh only are left out of the interpolation, as are those in contact: the deflections
//! of a coarse mesh are truncated there.

use super::own_mesh::{Names, own_mesh, section, sum_at_nodes};
use crate::communicator::Communicator;
use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::element::{BasisFunction, CellShape, ElementKind};
use crate::error::Result;
use crate::mesh::{Cell, Mesh, Point};
use crate::petsc::{Index, Matrix, Plex, Refinement, Smoother};
use std::collections::HashMap;
use std::ops::Range;
use std::rc::Rc;

/// Distance between the midpoint of the apices of two triangles and the midpoint of their common
/// edge, relative to its length, up to which they count as a parallelogram.
const SYMMETRIC: f64 = 1e-9;

/// Interpolation from level to level of the meshes that a refinement has passed.
pub struct Hierarchy {
    /// Steps to each mesh from the next coarser one, coarsest first.
    pub(super) steps: Vec<Step>,
    /// Smoother that suits the elements of the meshes.
    pub(super) smoother: Smoother,
}

/// Step from a mesh to the next finer one.
pub(super) struct Step {
    pub interpolation: Matrix,
    /// Deflections of the nodes that both meshes have: the dof of the fine mesh and the dof of the
    /// coarse one, counted among the dofs of this rank.
    pub shared: Vec<[usize; 2]>,
}

/// Mesh with its dofs, one level of the hierarchy.
pub(super) struct Level<'l> {
    /// Distributed mesh with the section of the dofs.
    pub plex: Rc<Plex>,
    pub mesh: &'l Mesh,
    pub space: &'l DofMap,
    pub holds: &'l [NodeConstraint],
    /// Whether this rank owns each node.
    pub owns: &'l [bool],
    /// Cells of this rank with an extra dof, ascending.
    pub extra_cells: &'l [usize],
}

/// Dofs of a fine node in terms of the dofs of one coarse node: entry `[k][j]` multiplies dof j of
/// the coarse node.
type Block = [[f64; PER_NODE]; PER_NODE];

/// Block of a node that stays.
const SAME: Block = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

impl Hierarchy {
    /// Creates the interpolation to a mesh from the meshes that its refinement has passed, coarsest
    /// first. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error, and [`crate::Error::Mesh`] for
    /// a cell that cannot carry its element.
    pub(super) fn new(
        comm: &impl Communicator,
        passed: &[(Plex, Refinement)],
        finest: &Level,
    ) -> Result<Hierarchy> {
        let mut steps = Vec::new();
        add_levels(passed, finest, &mut steps)?;
        steps.reverse();
        let is_triangle = |cell: &Cell| cell.shape() == CellShape::Triangle;
        let has_triangles = comm.all_reduce_any(finest.mesh.cells.iter().any(is_triangle));
        let smoother = if has_triangles { Smoother::OfTriangles } else { Smoother::OfQuadrilaterals };
        Ok(Hierarchy { steps, smoother })
    }

    /// Returns the interpolation of two fields on the same meshes, each by itself; no dofs are
    /// shared. Collective.
    ///
    /// # Errors
    /// Returns [`crate::Error::Petsc`] where PETSc reports an error.
    pub(super) fn of_two(first: &Hierarchy, second: &Hierarchy) -> Result<Hierarchy> {
        let step = |(first, second): (&Step, &Step)| {
            let interpolation = Matrix::block_diagonal(&first.interpolation, &second.interpolation)?;
            Ok(Step { interpolation, shared: Vec::new() })
        };
        let steps = first.steps.iter().zip(&second.steps).map(step).collect::<Result<_>>()?;
        Ok(Hierarchy { steps, smoother: first.smoother })
    }

    /// Returns the interpolation to each mesh from the next coarser one, coarsest first.
    pub fn interpolations(&self) -> Vec<&Matrix> {
        self.steps.iter().map(|step| &step.interpolation).collect()
    }
}

/// Adds the steps to a level and to all coarser ones, finest first. Collective.
fn add_levels(passed: &[(Plex, Refinement)], fine: &Level, steps: &mut Vec<Step>) -> Result<()> {
    let Some(((plex, refinement), passed)) = passed.split_last() else { return Ok(()) };
    let owned = plex.owned()?;
    let (start, vertices) = (plex.chart().start, plex.vertices());
    let owns_point = |point: Index| owned[(point - start) as usize];
    let names = Names { elements: fine.mesh.elements, ..Names::default() };
    let mesh = own_mesh(plex, &names, owns_point)?;
    let fine_nodes = FineNodes::new(plex, refinement, fine)?;
    let holds: Vec<NodeConstraint> = fine_nodes.nodes.iter().map(|&node| fine.holds[node]).collect();
    // Extra dofs stay in the cells that contain theirs, and keep their values.
    let around = |cell: usize| mesh.locate(fine.mesh.centroid(cell)).unwrap_or_default();
    let mut extra: Vec<(usize, usize)> =
        fine.extra_cells.iter().enumerate().map(|(dof, &cell)| (around(cell), dof)).collect();
    extra.sort_unstable();
    let extra_cells: Vec<usize> = extra.iter().map(|(cell, _)| *cell).collect();
    let plex = plex.with_section(&section(plex, &holds, &extra_cells, &[])?)?;
    let coarse = Level {
        plex: Rc::new(plex),
        mesh: &mesh,
        space: &DofMap::of_all(&holds, extra.len(), &[]),
        holds: &holds,
        owns: &vertices.map(owns_point).collect::<Vec<bool>>(),
        extra_cells: &extra_cells,
    };
    let extra: Vec<usize> = extra.into_iter().map(|(_, dof)| dof).collect();
    steps.push(Step::new(&fine_nodes, &extra, &coarse, fine)?);
    add_levels(passed, &coarse, steps)
}

/// Nodes of the fine mesh that the points of the coarse one become, on this rank.
struct FineNodes {
    nodes: Vec<usize>,
    edge_nodes: Vec<usize>,
    /// Node at the centre of each cell that gets one.
    cell_nodes: Vec<Option<usize>>,
    /// Edges of each cell, and ends of each edge, from 0 on.
    edges: Vec<Vec<usize>>,
    ends: Vec<[usize; 2]>,
    /// First cell of this rank at each edge.
    cells: Vec<usize>,
}

impl FineNodes {
    fn new(plex: &Plex, refinement: &Refinement, fine: &Level) -> Result<FineNodes> {
        let (cells, edges, vertices) = (plex.cells(), plex.edges(), plex.vertices());
        let first = fine.plex.vertices().start;
        let node = |point: Index| Ok(refinement.vertex(point)?.map(|vertex| (vertex - first) as usize));
        let sure_node = |point: Index| Ok(node(point)?.unwrap_or_default());
        let number =
            |points: Vec<Index>, start: Index| points.into_iter().map(move |point| (point - start) as usize);
        let ends = |edge: Index| {
            let ends: Vec<usize> = number(plex.cone(edge)?, vertices.start).collect();
            Ok([ends[0], ends[1]])
        };
        Ok(FineNodes {
            nodes: vertices.clone().map(sure_node).collect::<Result<_>>()?,
            edge_nodes: edges.clone().map(sure_node).collect::<Result<_>>()?,
            cell_nodes: cells.clone().map(node).collect::<Result<_>>()?,
            edges: cells
                .clone()
                .map(|cell| Ok(number(plex.cone(cell)?, edges.start).collect()))
                .collect::<Result<_>>()?,
            ends: edges.clone().map(ends).collect::<Result<_>>()?,
            cells: edges
                .map(|edge| Ok((plex.support(edge)?[0] - cells.start) as usize))
                .collect::<Result<_>>()?,
        })
    }

    /// Returns the end of a triangle's longest edge that is not on it, the edge and its length.
    fn apex(&self, mesh: &Mesh, cell: usize) -> Option<(usize, usize, f64)> {
        if mesh.cells[cell].shape() != CellShape::Triangle {
            return None;
        }
        let length = |&edge: &usize| {
            let [a, b] = self.ends[edge];
            (mesh.nodes[b] - mesh.nodes[a]).norm()
        };
        let longest = self.edges[cell].iter().copied().max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let apex = mesh.cells[cell].nodes().iter().find(|node| !self.ends[longest].contains(node))?;
        Some((*apex, longest, length(&longest)))
    }

    /// Returns for each edge whether it is the diagonal of a parallelogram of two triangles.
    /// Collective.
    fn diagonals(&self, coarse: &Level, fine: &Level) -> Result<Vec<bool>> {
        let mesh = coarse.mesh;
        let mut sums = [(); 3].map(|()| vec![0.0; fine.mesh.nodes.len()]);
        let mut lengths = vec![f64::INFINITY; self.edge_nodes.len()];
        for cell in 0..mesh.cells.len() {
            let Some((apex, edge, length)) = self.apex(mesh, cell) else { continue };
            let middle = self.edge_nodes[edge];
            let arm = mesh.nodes[apex] - fine.mesh.nodes[middle];
            sums.iter_mut().zip([1.0, arm.x, arm.y]).for_each(|(sum, term)| sum[middle] += term);
            lengths[edge] = length;
        }
        let [count, x, y] = &sums;
        let sum = |nodal: &[f64]| sum_at_nodes(&fine.plex, nodal);
        let (count, x, y) = (sum(count)?, sum(x)?, sum(y)?);
        let is_diagonal = |(&node, length): (&usize, &f64)| {
            count[node] == 2.0 && x[node].hypot(y[node]) <= SYMMETRIC * length
        };
        Ok(self.edge_nodes.iter().zip(&lengths).map(is_diagonal).collect())
    }
}

impl Step {
    /// Creates the step from one level to the next finer one. `extra` is the fine dof of each extra
    /// dof of the coarse mesh. Collective.
    fn new(fine_nodes: &FineNodes, extra: &[usize], coarse: &Level, fine: &Level) -> Result<Step> {
        let mut entries = Entries::new(coarse, fine)?;
        let mut shared = Vec::new();
        extra.iter().enumerate().for_each(|(column, &row)| entries.push(row, column, 1.0));
        for (node, &same) in fine_nodes.nodes.iter().enumerate() {
            if fine.owns[same] {
                entries.add(same, node, &SAME);
                shared.extend(entries.deflections(same, node));
            }
        }
        let mesh = coarse.mesh;
        let diagonals = fine_nodes.diagonals(coarse, fine)?;
        for (cell, corners) in mesh.cells.iter().enumerate() {
            let element = mesh.element(cell)?;
            let corners = corners.nodes();
            let mut evaluate = |node: usize, ends: &[usize]| {
                let functions = element.basis_at(fine.mesh.nodes[node]);
                for (functions, corner) in functions.chunks_exact(PER_NODE).zip(corners) {
                    if ends.contains(corner) {
                        entries.add(node, *corner, &block(functions, 1.0));
                    }
                }
            };
            if let Some(centre) = fine_nodes.cell_nodes[cell] {
                evaluate(centre, corners);
            }
            for &edge in &fine_nodes.edges[cell] {
                let middle = fine_nodes.edge_nodes[edge];
                if fine.owns[middle] && fine_nodes.cells[edge] == cell && !diagonals[edge] {
                    evaluate(middle, &fine_nodes.ends[edge]);
                }
            }
            let apex = fine_nodes.apex(mesh, cell).filter(|(_, edge, _)| diagonals[*edge]);
            if let Some((apex, edge, _)) = apex {
                entries.add_diagonal(mesh, corners, [apex, fine_nodes.edge_nodes[edge]])?;
            }
        }
        Ok(Step { interpolation: entries.matrix()?, shared })
    }
}

/// Returns the values and slopes of the three functions of a node, times a weight.
fn block(functions: &[BasisFunction], weight: f64) -> Block {
    let row = |value: &dyn Fn(&BasisFunction) -> f64| [0, 1, 2].map(|j| weight * value(&functions[j]));
    [row(&|basis| basis.value), row(&|basis| basis.gradient[0]), row(&|basis| basis.gradient[1])]
}

/// Entries of an interpolation matrix on their way into PETSc.
struct Entries<'e> {
    coarse: &'e Level<'e>,
    fine: &'e Level<'e>,
    /// Position of each local dof in global vectors of the fine and of the coarse mesh, and
    /// positions of the dofs of this rank.
    positions: [Vec<Index>; 2],
    owned: [Range<Index>; 2],
    /// Dofs of tips of compliant stops, by node of the fine mesh: they move with their nodes.
    tips: HashMap<usize, Vec<usize>>,
    rows: Vec<Index>,
    columns: Vec<Index>,
    values: Vec<f64>,
}

impl<'e> Entries<'e> {
    fn new(coarse: &'e Level, fine: &'e Level) -> Result<Self> {
        let mut tips = HashMap::<usize, Vec<usize>>::new();
        fine.space.tips.iter().for_each(|&(dof, node)| tips.entry(node).or_default().push(dof));
        Ok(Entries {
            positions: [fine.plex.global_dofs()?, coarse.plex.global_dofs()?],
            owned: [fine.plex.global_vector()?.range(), coarse.plex.global_vector()?.range()],
            coarse,
            fine,
            tips,
            rows: Vec::new(),
            columns: Vec::new(),
            values: Vec::new(),
        })
    }

    /// Returns the positions among the dofs of this rank, fine and coarse, of the deflection of a
    /// node that both meshes have.
    fn deflections(&self, node: usize, coarse_node: usize) -> Option<[usize; 2]> {
        let (fine, _) = self.fine.space.dof(PER_NODE * node)?;
        let (coarse, _) = self.coarse.space.dof(PER_NODE * coarse_node)?;
        let place = |level: usize, dof: usize| {
            let position = self.positions[level][dof];
            let owned = &self.owned[level];
            owned.contains(&position).then(|| (position - owned.start) as usize)
        };
        Some([place(0, fine)?, place(1, coarse)?])
    }

    /// Adds an entry that is not zero, given by its local dofs of the fine and of the coarse mesh.
    fn push(&mut self, row: usize, column: usize, value: f64) {
        if value == 0.0 {
            return;
        }
        self.rows.push(self.positions[0][row]);
        self.columns.push(self.positions[1][column]);
        self.values.push(value);
    }

    /// Adds the share of a coarse node in the dofs of a fine node.
    fn add(&mut self, node: usize, coarse_node: usize, block: &Block) {
        for (k, row) in block.iter().enumerate() {
            let Some(to) = self.fine.space.dof(PER_NODE * node + k) else { continue };
            for (j, entry) in row.iter().enumerate() {
                let Some((column, share)) = self.coarse.space.dof(PER_NODE * coarse_node + j) else {
                    continue;
                };
                let tips = self.tips.get(&node).filter(|_| k == 0).into_iter().flatten();
                let rows: Vec<(usize, f64)> =
                    std::iter::once(to).chain(tips.map(|&tip| (tip, 1.0))).collect();
                for (row, factor) in rows {
                    self.push(row, column, factor * entry * share);
                }
            }
        }
    }

    /// Adds the share of a triangle in the middle of its longest edge, the diagonal of a
    /// parallelogram: the share of its apex, and half of the share of the edge's ends.
    fn add_diagonal(&mut self, mesh: &Mesh, corners: &[usize], [apex, middle]: [usize; 2]) -> Result<()> {
        let first = corners.iter().position(|&node| node == apex).unwrap_or_default();
        let [apex, a, b] = [0, 1, 2].map(|k| corners[(first + k) % 3]);
        let centre = self.fine.mesh.nodes[middle];
        let [p, q, r] = [apex, a, b].map(|node| mesh.nodes[node]);
        let opposite = Point::from(q.coords + r.coords - p.coords);
        let functions = ElementKind::Fvs.on(&[p, q, opposite, r])?.basis_at(centre);
        for (node, place, weight) in [(apex, 0, 1.0), (a, 1, 0.5), (b, 3, 0.5)] {
            self.add(middle, node, &block(&functions[PER_NODE * place..], weight));
        }
        Ok(())
    }

    /// Creates the matrix. Collective.
    fn matrix(self) -> Result<Matrix> {
        let context = self.fine.plex.context();
        let size = |level: &Level| Ok(level.plex.global_vector()?.local_size());
        let sizes = [size(self.fine)?, size(self.coarse)?];
        let mut matrix = Matrix::from_pattern(context, sizes, [self.rows, self.columns], None)?;
        matrix.set_values(&self.values)?;
        matrix.without_triplets()
    }
}
