//! Cells and nodes of one rank as a mesh of its own, and the layout of their dofs.

use crate::dof_map::{DofMap, NodeConstraint, PER_NODE};
use crate::element::ElementByShape;
use crate::error::{Error, Result};
use crate::mesh::{Cell, Mesh, Point};
use crate::petsc::{Dofs, Index, Plex, Section};
use std::ops::Range;

/// Labels of named edges, groups and points; the value is the number of the name, from 1.
pub(super) const EDGE: &str = "edge";
pub(super) const GROUP: &str = "group";
pub(super) const POINT: &str = "point";

/// Names of a mesh, in the order of their label values, the elements of its cells, and its notes.
#[derive(Default, serde::Serialize, serde::Deserialize)]
pub(super) struct Names {
    pub edges: Vec<String>,
    pub groups: Vec<String>,
    pub points: Vec<String>,
    pub elements: ElementByShape,
    pub notes: Vec<String>,
}

impl Names {
    pub fn of(mesh: &Mesh) -> Names {
        Names {
            edges: mesh.edges.keys().cloned().collect(),
            groups: mesh.groups.keys().cloned().collect(),
            points: mesh.points.keys().cloned().collect(),
            elements: mesh.elements,
            notes: mesh.notes.clone(),
        }
    }
}

/// Returns the cells of this rank as a mesh.
///
/// A named edge, cell or node is only on the rank that owns it, so that sums over all ranks count
/// it once.
pub(super) fn own_mesh(plex: &Plex, names: &Names, owns: impl Fn(Index) -> bool) -> Result<Mesh> {
    let (cells, edges, vertices) = (plex.cells(), plex.edges(), plex.vertices());
    let number = |vertex: Index| (vertex - vertices.start) as usize;
    let nodes = plex.coordinates()?.into_iter().map(Point::from).collect();
    let notes = names.notes.clone();
    let mut mesh = Mesh { nodes, elements: names.elements, notes, ..Mesh::default() };
    for cell in cells.clone() {
        let corners: Vec<usize> = plex.corners(cell)?.into_iter().map(number).collect();
        mesh.cells.push(match corners[..] {
            [a, b, c] => Cell::Triangle([a, b, c]),
            [a, b, c, d] => Cell::Quadrilateral([a, b, c, d]),
            _ => return Err(Error::Mesh(format!("a cell of {} corners", corners.len()))),
        });
        let last = mesh.cells.len() - 1;
        if mesh.area(last) < 0.0 {
            mesh.cells[last] = match mesh.cells[last] {
                Cell::Triangle([a, b, c]) => Cell::Triangle([a, c, b]),
                Cell::Quadrilateral([a, b, c, d]) => Cell::Quadrilateral([a, d, c, b]),
            };
        }
    }
    let labelled = |label: &str, value: Index, kind: &Range<Index>| -> Result<Vec<Index>> {
        let points = plex.labelled(label, value)?.into_iter();
        Ok(points.filter(|&point| kind.contains(&point) && owns(point)).collect())
    };
    for (value, name) in (1..).zip(&names.edges) {
        let sides = labelled(EDGE, value, &edges)?.into_iter().map(|edge| {
            let ends = plex.cone(edge)?;
            let [a, b] = [number(ends[0]), number(ends[1])];
            // The cell lies on the left, as along the boundary of the whole mesh.
            let cell = &mesh.cells[(plex.support(edge)?[0] - cells.start) as usize];
            Ok(if cell.edges().any(|side| side == [a, b]) { [a, b] } else { [b, a] })
        });
        let sides = sides.collect::<Result<_>>()?;
        mesh.edges.insert(name.clone(), sides);
    }
    for (value, name) in (1..).zip(&names.groups) {
        let members = labelled(GROUP, value, &cells)?;
        mesh.groups.insert(name.clone(), members.iter().map(|cell| (cell - cells.start) as usize).collect());
    }
    for (value, name) in (1..).zip(&names.points) {
        let members = labelled(POINT, value, &vertices)?;
        mesh.points.insert(name.clone(), members.into_iter().map(number).collect());
    }
    Ok(mesh)
}

/// Returns the layout of the dofs of a mesh: the extra dofs of `extra_cells`, ascending, then the
/// dofs of the nodes with their tips of compliant stops. An empty `tips_at` has no tips.
/// Collective.
pub(super) fn section(
    plex: &Plex,
    holds: &[NodeConstraint],
    extra_cells: &[usize],
    tips_at: &[usize],
) -> Result<Section> {
    let (cells, vertices) = (plex.cells(), plex.vertices());
    // Cells come before vertices, and so do their dofs.
    Section::new(plex.context(), plex.chart(), |point| {
        if cells.contains(&point) {
            let cell = (point - cells.start) as usize;
            return Dofs {
                count: extra_cells.iter().filter(|other| **other == cell).count(),
                held: Vec::new(),
            };
        }
        if !vertices.contains(&point) {
            return Dofs::default();
        }
        let node = (point - vertices.start) as usize;
        let held = DofMap::held(&holds[node]);
        Dofs {
            count: PER_NODE + tips_at.get(node).copied().unwrap_or_default(),
            held: (0..PER_NODE).filter(|k| held[*k]).map(|k| k as Index).collect(),
        }
    })
}

/// Sums the contributions of all ranks at each node. Collective.
///
/// # Errors
/// Returns [`Error::Petsc`] where PETSc reports an error.
pub fn sum_at_nodes(plex: &Plex, nodal: &[f64]) -> Result<Vec<f64>> {
    let vertices = plex.vertices();
    let one_each = Section::new(plex.context(), plex.chart(), |point| Dofs {
        count: usize::from(vertices.contains(&point)),
        held: Vec::new(),
    })?;
    let plex = plex.with_section(&one_each)?;
    let (mut global, mut local) = (plex.global_vector()?, plex.local_vector()?);
    local.set_local(nodal)?;
    plex.add_to_global(&local, &mut global)?;
    plex.to_local(&global, &mut local)?;
    local.with_local(|sums| sums.to_vec())
}
