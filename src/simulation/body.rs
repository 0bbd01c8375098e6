//! Mesh, sections and supports of a scene.

use super::partition::Partition;
use crate::assembly;
use crate::communicator::Communicator;
use crate::dof_map::Place;
use crate::element::adaptive::{self, Integrand, Rules};
use crate::element::quadrature::Node;
use crate::error::{Error, Result};
use crate::field::Condition;
use crate::memory;
use crate::mesh::{self, Diagonal, Made, Mark, Mesh, NEAR, Point};
use crate::plate::{Plate, Section, Sections};
use crate::scene::{
    ElementKind, EngineName, FieldInput, Grid, Part, Region, Scene, SupportKind, SupportLocation,
};

/// Peak memory of the set-up, in bytes per triangle and per quadrangle: mesh, local arrays, entries
/// of the step matrix. Measured for congruent cells, which share their arrays; others take up to
/// twice as much.
const PER_CELL: [u64; 2] = [2_400, 6_500];

/// Peak memory on PETSc, in bytes per cell; its matrices store both triangles and are built from
/// lists.
const PER_CELL_ON_PETSC: [u64; 2] = [5_000, 12_000];

/// Returns a lower bound of the memory of a run, in bytes, from the numbers of triangles and
/// quadrangles: the set-up, and the sparsest possible factor. `across` is the number of rectangles
/// along the shorter side of a grid.
fn least_memory(scene: &Scene, [triangles, quadrangles]: [u64; 2], across: u64) -> u64 {
    let cells = triangles + quadrangles;
    let dofs = 3 * (triangles / 2 + quadrangles);
    let of = if scene.solver.engine == EngineName::Petsc { PER_CELL_ON_PETSC } else { PER_CELL };
    let set_up = of[0] * triangles + of[1] * quadrangles;
    // Entries per row of the factor, by minimum degree ordering and by banded ordering.
    let row = (12.0 * (dofs.max(2) as f64).log2() - 85.0).min(3.0 * across as f64).max(9.0);
    let factors = (8.0 * row * dofs as f64) as u64 * scene.time.factors() as u64;
    let dense = scene.time.scheme.dense_memory(dofs as usize, cells as usize, 0);
    set_up + factors + dense as u64
}

/// Returns an error, before the mesh is built, where the memory is too small for a run. `cells` are
/// the numbers of triangles and quadrangles before refinement, and each of `ranks` processes has
/// its part.
///
/// # Errors
/// Returns [`Error::Memory`] with the figures and the largest mesh that would fit.
pub(super) fn require_memory(scene: &Scene, cells: [u64; 2], ranks: usize) -> Result<()> {
    let grid = &scene.mesh;
    let pieces = 4_u64.saturating_pow(grid.refine);
    let across = match &scene.file {
        Some(_) => u64::MAX >> 8,
        None => *grid.cells.iter().min().unwrap_or(&1) as u64,
    };
    let needed = |part: f64| {
        let cells = cells.map(|cells| (cells as f64 * pieces as f64 * part) as u64);
        let across = across as f64 * (pieces as f64 * part).sqrt();
        least_memory(scene, cells, across.min(1e9) as u64) / ranks as u64
    };
    let all = (cells[0] + cells[1]) * pieces;
    let what = match ranks {
        1 => format!("a run with {all} cells"),
        _ => format!("the part of a run with {all} cells on each of {ranks} ranks"),
    };
    let bytes = needed(1.0);
    memory::require_of_each(bytes, ranks.min(memory::processes_here()), &what, |part| {
        let room = (bytes as f64 * part) as u64;
        let fits = (1..=200).map(|i| 0.9_f64.powi(i)).find(|part| needed(*part) <= room).unwrap_or(0.0);
        if scene.file.is_none() && grid.refine == 0 {
            let [nx, ny] = grid.cells.map(|cells| ((cells as f64 * fits.sqrt()) as usize).max(1));
            format!("mesh.cells = [{nx}, {ny}] would fit")
        } else {
            format!("about {} cells would fit", (all as f64 * fits) as u64)
        }
    })
}

/// Builds the mesh of a scene, with nodes at the points and along the lines of its obstacles and
/// supports.
///
/// # Errors
/// Returns [`Error::Mesh`] for a mesh that cannot carry the elements and for a point that cannot be
/// a node, [`Error::Memory`] for a mesh that is too large, and the errors of reading its file.
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
            Region::At(at) => Some((format!("{key}.at"), Mark::At(at.into()))),
            Region::Line(ends) => Some((format!("{key}.line"), Mark::Line(ends.map(Point::from)))),
            _ => None,
        }
    });
    let supports = scene.supports.iter().enumerate().filter_map(|(number, support)| match support.stand {
        SupportLocation::At(at) => Some((format!("support.{number}.at"), Mark::At(at.into()))),
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
            require_memory(scene, kinds(&mesh), ranks)?;
            mesh
        }
        None => {
            require_memory(scene, rectangles(grid), ranks)?;
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
    let triangles = mesh.cells.iter().filter(|cell| cell.nodes().len() == 3).count();
    [triangles, mesh.cells.len() - triangles].map(|count| count as u64)
}

/// Returns the numbers of triangles and quadrangles of a grid before refinement.
pub(super) fn rectangles(grid: &Grid) -> [u64; 2] {
    let rectangles = grid.cells.map(|cells| cells as u64).iter().product();
    match grid.element {
        ElementKind::Hct => [2 * rectangles, 0],
        ElementKind::Fvs => [0, rectangles],
    }
}

/// Returns the locations of the supports on this process's part of the mesh. Collective.
pub(super) fn supports(
    scene: &Scene,
    mesh: &Mesh,
    comm: &impl Communicator,
) -> Result<Vec<(Place, SupportKind)>> {
    let mut supports = Vec::new();
    for (number, support) in scene.supports.iter().enumerate() {
        let key = format!("support.{number}");
        let place = match &support.stand {
            SupportLocation::Edge { edge, part } => {
                let sides = mesh.edges.get(edge).map_or(&[][..], Vec::as_slice);
                require(comm, !sides.is_empty(), || {
                    let known: Vec<&str> = mesh.edges.keys().map(String::as_str).collect();
                    format!("{key}.edge: the mesh has no edge named \"{edge}\"; it has: {}", known.join(", "))
                })?;
                let inside =
                    |node: usize| part.as_ref().map_or(Ok(true), |part| holds(part, mesh.nodes[node], &key));
                let choose = |&[a, b]: &[usize; 2]| {
                    Ok(inside(a)? && inside(b)?).map(|chosen| chosen.then_some([a, b]))
                };
                let chosen: Result<Vec<_>> = sides.iter().map(choose).filter_map(Result::transpose).collect();
                let chosen = comm.all_ok(chosen)?;
                require(comm, !chosen.is_empty(), || {
                    format!("{key}.where: it holds at both ends of no cell's side on edge \"{edge}\"")
                })?;
                Place::Edges(chosen)
            }
            SupportLocation::At(at) => Place::Nodes(nodes_at(mesh, *at, comm, &key)?),
            SupportLocation::Point(name) => Place::Nodes(nodes_of_point(mesh, name, comm, &key)?),
        };
        supports.push((place, support.kind));
    }
    Ok(supports)
}

/// Returns the nodes of a physical point that this process owns. Collective.
fn nodes_of_point(mesh: &Mesh, name: &str, comm: &impl Communicator, key: &str) -> Result<Vec<usize>> {
    let nodes = mesh.points.get(name).cloned().unwrap_or_default();
    require(comm, !nodes.is_empty(), || {
        let known: Vec<&str> = mesh.points.keys().map(String::as_str).collect();
        format!("{key}.point: the mesh has no point named \"{name}\"; it has: {}", known.join(", "))
    })?;
    Ok(nodes)
}

/// Returns whether a condition of a table holds at a point.
pub(super) fn holds(condition: &Condition, at: Point, key: &str) -> Result<bool> {
    condition.holds(at, 0.0).map_err(|fault| Error::Scene(format!("{key}.where: {fault}")))
}

/// Returns an error unless `here` is true on some process. Collective.
fn require(comm: &impl Communicator, here: bool, wrong: impl Fn() -> String) -> Result<()> {
    if comm.all_reduce_any(here) { Ok(()) } else { Err(Error::Mesh(wrong())) }
}

/// Returns the nodes of this process at a point. Collective.
fn nodes_at(mesh: &Mesh, [x, y]: [f64; 2], comm: &impl Communicator, key: &str) -> Result<Vec<usize>> {
    let at = Point::new(x, y);
    let distance = |node: usize| (mesh.nodes[node] - at).norm();
    let nearest = (0..mesh.nodes.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let own = nearest.map_or([f64::INFINITY, x, y, 0.0], |node| {
        let farthest = mesh.nodes.iter().map(|p| (p - at).norm()).fold(0.0, f64::max);
        [distance(node), mesh.nodes[node].x, mesh.nodes[node].y, farthest]
    });
    let all = comm.all_gather_one(own);
    let size = all.iter().map(|of| of[3]).fold(0.0, f64::max);
    let best = all.iter().min_by(|a, b| a[0].total_cmp(&b[0])).unwrap_or(&own);
    if best[0] > NEAR * size {
        return Err(Error::Mesh(format!(
            "{key}.at: no node lies at ({x}, {y}); the nearest is at ({}, {})",
            best[1], best[2]
        )));
    }
    Ok((0..mesh.nodes.len()).filter(|&node| distance(node) <= NEAR * size).collect())
}

/// Returns the nodes of this process in a region of the plate. Collective.
pub(super) fn nodes_in(
    region: &Region,
    mesh: &Mesh,
    partition: &impl Partition,
    key: &str,
) -> Result<Vec<usize>> {
    let (comm, nodes) = (partition.comm(), 0..mesh.nodes.len());
    match region {
        Region::All => Ok(nodes.collect()),
        Region::Where(condition) => {
            let choose = |node: usize| Ok(holds(condition, mesh.nodes[node], key)?.then_some(node));
            let chosen: Vec<usize> =
                comm.all_ok(nodes.map(choose).filter_map(Result::transpose).collect())?;
            require(comm, !chosen.is_empty(), || format!("{key}.where: it holds at no node"))?;
            Ok(chosen)
        }
        Region::Group(name) => {
            let mut touched = vec![0.0; mesh.nodes.len()];
            for cell in group(mesh, name, comm, key)? {
                mesh.cells[cell].nodes().iter().for_each(|&node| touched[node] = 1.0);
            }
            let touched = partition.sum_at_nodes(&touched)?;
            Ok(nodes.filter(|&node| touched[node] > 0.0).collect())
        }
        Region::At(at) => nodes_at(mesh, *at, comm, key),
        Region::Point(name) => {
            let mut named = vec![0.0; mesh.nodes.len()];
            nodes_of_point(mesh, name, comm, key)?.into_iter().for_each(|node| named[node] = 1.0);
            let named = partition.sum_at_nodes(&named)?;
            Ok(nodes.filter(|&node| named[node] > 0.0).collect())
        }
        Region::Line([from, to]) => {
            let (from, to) = (Point::from(*from), Point::from(*to));
            let side = to - from;
            let distance = |p: Point| {
                let share =
                    ((p - from).dot(&side) / side.norm_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
                (p - (from + side * share)).norm()
            };
            let near = comm.all_gather_one(mesh::nearness(&mesh.nodes, from)).into_iter().fold(0.0, f64::max);
            let chosen: Vec<usize> = nodes.filter(|&node| distance(mesh.nodes[node]) <= near).collect();
            require(comm, !chosen.is_empty(), || format!("{key}.line: no node lies on it"))?;
            Ok(chosen)
        }
    }
}

/// Returns the cells of this process in a group. Collective.
fn group(mesh: &Mesh, name: &str, comm: &impl Communicator, key: &str) -> Result<Vec<usize>> {
    let cells = mesh.groups.get(name).cloned().unwrap_or_default();
    require(comm, !cells.is_empty(), || {
        let known: Vec<&str> = mesh.groups.keys().map(String::as_str).collect();
        format!("{key}.group: the mesh has no group named \"{name}\"; it has: {}", known.join(", "))
    })?;
    Ok(cells)
}

/// Returns a flag per cell of this process, set for those in a region of the plate: cells of its
/// group, or cells whose centre satisfies its condition. Collective.
pub(super) fn cells_in(
    region: &Region,
    mesh: &Mesh,
    comm: &impl Communicator,
    key: &str,
) -> Result<Vec<bool>> {
    let mut chosen = vec![matches!(region, Region::All); mesh.cells.len()];
    match region {
        Region::Where(condition) => {
            let inside = |cell: usize| {
                let vertices = mesh.vertices(cell);
                let sum = vertices.iter().fold(Point::origin(), |sum, p| sum + p.coords);
                holds(condition, sum / vertices.len() as f64, key)
            };
            chosen = comm.all_ok((0..mesh.cells.len()).map(inside).collect())?;
            require(comm, chosen.contains(&true), || {
                format!("{key}.where: it holds at the centre of no cell")
            })?;
        }
        Region::Group(name) => group(mesh, name, comm, key)?.into_iter().for_each(|cell| chosen[cell] = true),
        Region::All | Region::At(_) | Region::Point(_) | Region::Line(_) => {}
    }
    Ok(chosen)
}

/// Thickness and material of a scene's plate, cell by cell.
pub(super) struct PlateAssembly<'s> {
    scene: &'s Scene,
    /// Index of the part of each cell, from 1 on; 0 for none.
    part_of: Vec<usize>,
    /// Special quadrature rules on the cells where the thickness needs them.
    rules: Rules,
}

impl<'s> PlateAssembly<'s> {
    /// Determines the part of each cell. Collective.
    pub fn new(scene: &'s Scene, mesh: &Mesh, comm: &impl Communicator) -> Result<PlateAssembly<'s>> {
        let mut part_of = vec![0; mesh.cells.len()];
        for (number, part) in scene.parts.iter().enumerate() {
            let inside = cells_in(&part.region, mesh, comm, &format!("part.{number}"))?;
            part_of.iter_mut().zip(inside).filter(|(_, inside)| *inside).for_each(|(of, _)| *of = number + 1);
        }
        let mut body = PlateAssembly { scene, part_of, rules: Rules::new() };
        body.rules = body.find_rules(mesh, comm)?;
        Ok(body)
    }

    /// Determines special quadrature rules for cells in which the thickness jumps, or varies too
    /// fast for the usual rule. Collective.
    fn find_rules(&self, mesh: &Mesh, comm: &impl Communicator) -> Result<Rules> {
        let rough = |given: &&FieldInput| !given.is_polynomial();
        let of_parts = self.scene.parts.iter().map(|part| part.thickness.as_ref());
        let thicknesses = std::iter::once(self.scene.plate.thickness.as_ref()).chain(of_parts);
        let rough: Vec<_> =
            thicknesses.map(|given| given.filter(rough).map(|given| given.still(0.0))).collect();
        if rough.iter().all(Option::is_none) {
            return Ok(Rules::new());
        }
        let function = |cell: usize| rough[self.part_of[cell]].as_ref().map(|still| still as &dyn Integrand);
        let pieces = comm.all_ok(assembly::pieces(mesh))?;
        let refined = adaptive::refine(&pieces, &function, adaptive::ONCE, comm);
        super::effects::seen("plate.thickness", comm.all_ok(refined)?)
    }

    /// Returns the plate of a cell, and its thickness field where it is no constant.
    fn plate(&self, cell: usize) -> (&'s Plate, Option<&'s FieldInput>) {
        match self.part_of[cell].checked_sub(1).map(|part| &self.scene.parts[part]) {
            Some(Part { plate, thickness, .. }) => (plate, thickness.as_ref()),
            None => (&self.scene.plate.plate, self.scene.plate.thickness.as_ref()),
        }
    }
}

impl Sections for PlateAssembly<'_> {
    fn kind(&self, cell: usize) -> Option<usize> {
        self.plate(cell).1.is_none().then(|| self.part_of[cell])
    }

    fn section(&self, cell: usize, at: Point) -> Result<Section> {
        let (plate, thickness) = self.plate(cell);
        let Some(given) = thickness else { return Ok(plate.section()) };
        let thickness = given.at(at, 0.0)?;
        if thickness <= 0.0 {
            let wrong =
                format!("{thickness:?} m at ({}, {}); expected a thickness greater than 0", at.x, at.y);
            return Err(Error::Scene(format!("{}: {wrong}", given.key)));
        }
        Ok(Plate { thickness, ..*plate }.section())
    }

    fn rules(&self, cell: usize) -> Option<&[Vec<Node>]> {
        self.rules.get(&cell).map(Vec::as_slice)
    }
}
