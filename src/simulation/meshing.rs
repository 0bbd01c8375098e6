//! Mesh of a scene, refused before it is built where its run would not fit into the memory.

use crate::element::CellShape;
use crate::error::Result;
use crate::memory;
use crate::mesh::{Diagonal, Made, Mark, Mesh, Point};
use crate::modes::ModeRange;
use crate::scene::{EngineName, Grid, Mass, Region, Scene, SupportLocation};

/// Peak memory of the set-up, in bytes per triangle and per quadrangle: mesh, local arrays, entries
/// of the step matrix. Measured for congruent cells, which share their arrays; others take up to
/// twice as much.
const PER_CELL: [u64; 2] = [2_400, 6_500];

/// Peak memory on PETSc, in bytes per cell; its matrices store both triangles and are built from
/// lists.
const PER_CELL_ON_PETSC: [u64; 2] = [5_000, 12_000];

/// Returns a lower bound of the memory of a run on a share of its mesh, in bytes: the set-up, and
/// the sparsest possible factors, as many as `factors`. `cells` are the numbers of triangles and
/// quadrangles before refinement.
fn least_memory(scene: &Scene, cells: [u64; 2], share: f64, factors: usize) -> u64 {
    let pieces = 4_u64.saturating_pow(scene.mesh.refine) as f64;
    let [triangles, quadrangles] = cells.map(|cells| (cells as f64 * pieces * share) as u64);
    // Rectangles along the shorter side of a grid.
    let [nx, ny] = scene.mesh.cells;
    let across = if scene.file.is_some() { f64::INFINITY } else { nx.min(ny) as f64 };
    let across = (across * (pieces * share).sqrt()).floor();
    let cells = triangles + quadrangles;
    let dofs = 3 * (triangles / 2 + quadrangles);
    let bytes = if scene.solver.engine == EngineName::Petsc { PER_CELL_ON_PETSC } else { PER_CELL };
    let set_up = bytes[0] * triangles + bytes[1] * quadrangles;
    // Entries per row of the factor, by minimum degree ordering and by banded ordering.
    let row = (12.0 * (dofs.max(2) as f64).log2() - 85.0).min(3.0 * across).max(9.0);
    let factors = (8.0 * row * dofs as f64) as u64 * factors as u64;
    let velocities = match (scene.time.mass, scene.time.modes) {
        (Mass::Modal, Some(ModeRange::Count(count))) => count,
        (Mass::Modal, _) => 0,
        _ => cells as usize,
    };
    let dense = scene.time.scheme.dense_memory(dofs as usize, velocities, 0);
    set_up + factors + dense as u64
}

/// Returns an error, before the mesh is built, where the memory is too small for a run with a
/// number of factors. `cells` are the numbers of triangles and quadrangles before refinement, and
/// each of `ranks` processes has its part.
///
/// # Errors
/// Returns [`crate::Error::Memory`] with the figures and the largest mesh that would fit.
pub(super) fn require_memory(scene: &Scene, cells: [u64; 2], ranks: usize, factors: usize) -> Result<()> {
    let grid = &scene.mesh;
    let pieces = 4_u64.saturating_pow(grid.refine);
    let needed = |share: f64| least_memory(scene, cells, share, factors) / ranks as u64;
    let count = (cells[0] + cells[1]) * pieces;
    let what = match ranks {
        1 => format!("a run with {count} cells"),
        _ => format!("the part of a run with {count} cells on each of {ranks} ranks"),
    };
    let bytes = needed(1.0);
    memory::require_of_each(bytes, memory::processes_here(), &what, |part| {
        let room = (bytes as f64 * part) as u64;
        let fits = (1..=200).map(|i| 0.9_f64.powi(i)).find(|part| needed(*part) <= room).unwrap_or(0.0);
        if scene.file.is_none() && grid.refine == 0 {
            let [nx, ny] = grid.cells.map(|cells| ((cells as f64 * fits.sqrt()) as usize).max(1));
            format!("mesh.cells = [{nx}, {ny}] would fit")
        } else {
            format!("about {} cells would fit", (count as f64 * fits) as u64)
        }
    })
}

/// Returns the least memory of a run with factors on all of `ranks` processes, in bytes, and the
/// memory left to them. `cells` are the numbers of triangles and quadrangles before refinement.
pub(super) fn memory_with_factors(scene: &Scene, cells: [u64; 2], ranks: usize) -> Option<[u64; 2]> {
    let needed = least_memory(scene, cells, 1.0, scene.time.factors());
    let room = memory::room(memory::processes_here())?;
    Some([needed, room.bytes.saturating_mul(ranks as u64)])
}

/// Builds the mesh of a scene, with nodes at the points and along the lines of its obstacles and
/// supports.
///
/// # Errors
/// Returns [`crate::Error::Mesh`] for a mesh that cannot carry the elements and for a point that
/// cannot be a node, [`crate::Error::Memory`] for a mesh that is too large, and the errors of
/// reading its file.
pub fn mesh(scene: &Scene) -> Result<Mesh> {
    mesh_and_made(scene).map(|(mesh, _)| mesh)
}

/// Builds the mesh of a scene and returns also the nodes moved or created for its obstacles and
/// supports.
///
/// # Errors
/// Returns the same errors as [`mesh()`].
pub fn mesh_and_made(scene: &Scene) -> Result<(Mesh, Vec<Made>)> {
    plain_mesh(scene)?.with_nodes(&marks(scene))
}

/// Returns the points and lines where obstacles and supports need nodes, by key.
pub(super) fn marks(scene: &Scene) -> Vec<(String, Mark)> {
    let obstacles = scene.obstacles.iter().enumerate().filter_map(|(number, obstacle)| {
        let key = format!("obstacle.{number}");
        match obstacle.region {
            Region::At(point) => Some((format!("{key}.at"), Mark::At(point.into()))),
            Region::Line(ends) => Some((format!("{key}.line"), Mark::Line(ends.map(Point::from)))),
            _ => None,
        }
    });
    let supports = scene.supports.iter().enumerate().filter_map(|(number, support)| match support.stand {
        SupportLocation::At(point, _) => Some((format!("support.{number}.at"), Mark::At(point.into()))),
        _ => None,
    });
    obstacles.chain(supports).collect()
}

/// Builds the mesh that the scene describes, before nodes are created.
fn plain_mesh(scene: &Scene) -> Result<Mesh> {
    let grid = &scene.mesh;
    let ranks = if scene.solver.engine == EngineName::Petsc { memory::processes() } else { 1 };
    let mut mesh = match &scene.file {
        Some(file) => {
            let mesh = file.load()?;
            require_memory(scene, kinds(&mesh), ranks, scene.time.factors())?;
            mesh
        }
        None => {
            require_memory(scene, rectangles(grid), ranks, scene.time.factors())?;
            let diagonal = grid.diagonal.unwrap_or(Diagonal::Right);
            Mesh::rectangle(scene.plate.length, scene.plate.width, grid.cells, grid.element, diagonal)?
        }
    };
    for _ in 0..grid.refine {
        mesh = mesh.refine();
    }
    mesh.check()?;
    Ok(mesh)
}

/// Returns the numbers of triangles and quadrangles of a mesh.
pub(super) fn kinds(mesh: &Mesh) -> [u64; 2] {
    let triangles = mesh.cells.iter().filter(|cell| cell.shape() == CellShape::Triangle).count();
    [triangles, mesh.cells.len() - triangles].map(|count| count as u64)
}

/// Returns the numbers of triangles and quadrangles of a grid before refinement.
pub(super) fn rectangles(grid: &Grid) -> [u64; 2] {
    let rectangles: u64 = grid.cells.map(|cells| cells as u64).iter().product();
    let shape = grid.element.shape();
    let cells = rectangles * shape.per_rectangle() as u64;
    match shape {
        CellShape::Triangle => [cells, 0],
        CellShape::Quadrilateral => [0, cells],
    }
}
