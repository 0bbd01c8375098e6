//! Meshes over the ranks and the dofs on them.

use super::{close, share};
use crate::common::ranks::{Case, case};
use rebond::Result;
use rebond::communicator::Communicator;
use rebond::petsc::{Context, Dofs, Index, Matrix, Plex, Refinement, Section};
use std::rc::Rc;

pub const CASES: &[Case] = &[
    case("meshes_of_triangles", &[1, 2, 3, 4], |_| meshes(3)),
    case("meshes_of_quadrilaterals", &[1, 2, 3, 4], |_| meshes(4)),
    case("more_ranks_than_cells", &[4], |_| mesh(4, [1, 1], 0)),
    case("dofs", &[1, 2, 4], dofs),
];

/// Returns a rectangle of 1.2 by 0.4 cut into cells. Cells and vertices are distributed over the
/// ranks independently of each other.
fn rectangle(context: &Rc<Context>, corners: usize, [nx, ny]: [usize; 2]) -> Result<Plex> {
    let vertex = |i: usize, j: usize| (j * (nx + 1) + i) as Index;
    let mut cells = Vec::new();
    for c in share(context, nx * ny) {
        let (i, j) = (c % nx, c / nx);
        let [a, b, c, d] = [vertex(i, j), vertex(i + 1, j), vertex(i + 1, j + 1), vertex(i, j + 1)];
        if corners == 4 {
            cells.extend([a, b, c, d]);
        } else {
            cells.extend([a, b, c, a, c, d]);
        }
    }
    let vertices: Vec<_> = share(context, (nx + 1) * (ny + 1))
        .map(|v| [1.2 * (v % (nx + 1)) as f64 / nx as f64, 0.4 * (v / (nx + 1)) as f64 / ny as f64])
        .collect();
    Plex::from_cells(context, corners, &cells, &vertices)
}

/// Returns the edges that lie on x = 0, of some edges.
fn at_left(mesh: &Plex, mut edges: Vec<Index>) -> Result<Vec<Index>> {
    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let corners = edges.iter().map(|&edge| mesh.corners(edge)).collect::<Result<Vec<_>>>()?;
    let mut lies = corners.iter().map(|ends| ends.iter().all(|v| positions[(v - first) as usize][0] == 0.0));
    edges.retain(|_| lies.next() == Some(true));
    Ok(edges)
}

/// Returns a mesh with equally many cells on every rank, in their order.
fn distributed(mesh: Plex) -> Result<Plex> {
    let (context, count) = (mesh.context().clone(), mesh.cells().len());
    let counts = context.comm().all_gather_one(count);
    let before: usize = counts[..context.rank()].iter().sum();
    let rank = |cell: usize| (before + cell) * context.size() / counts.iter().sum::<usize>();
    mesh.distribute(&(0..count).map(rank).collect::<Vec<_>>())
}

fn meshes(corners: usize) -> Result<()> {
    mesh(corners, [5, 3], 2)
}

fn mesh(corners: usize, cells: [usize; 2], refinements: u32) -> Result<()> {
    let context = Context::start(&[])?;
    let mut mesh = distributed(rectangle(&context, corners, cells)?)?;
    let boundary = mesh.boundary_edges()?;
    let edges = at_left(&mesh, boundary)?;
    mesh.label("support", 1, &edges)?;
    for _ in 0..refinements {
        mesh = Refinement::new(&mesh)?.fine()?;
    }

    let [nx, ny] = cells.map(|n| n << refinements);
    let per_rectangle = if corners == 3 { 2 } else { 1 };
    let owned = mesh.owned()?;
    let count = |points: std::ops::Range<Index>| {
        context.comm().all_reduce_sum(points.filter(|&p| owned[(p - mesh.chart().start) as usize]).count())
    };
    assert!(mesh.cells().all(|cell| owned[cell as usize]), "each cell is on one rank");
    assert_eq!(context.comm().all_reduce_sum(mesh.cells().len()), per_rectangle * nx * ny);
    assert_eq!(count(mesh.vertices()), (nx + 1) * (ny + 1));
    let diagonals = if corners == 3 { nx * ny } else { 0 };
    assert_eq!(count(mesh.edges()), nx * (ny + 1) + ny * (nx + 1) + diagonals);

    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let mut area = 0.0;
    for cell in mesh.cells() {
        assert_eq!(mesh.cone(cell)?.len(), corners);
        let at: Vec<_> = mesh.corners(cell)?.iter().map(|v| positions[(v - first) as usize]).collect();
        assert_eq!(at.len(), corners);
        let twice: f64 =
            (0..corners).map(|k| (at[k], at[(k + 1) % corners])).map(|([x, y], [u, v])| x * v - u * y).sum();
        assert!(twice > 0.0, "counterclockwise");
        area += 0.5 * twice;
    }
    close(context.comm().all_reduce_sum(area), 0.48, 1e-13);
    if context.size() > 1 && refinements > 0 {
        let share = context.comm().all_reduce_max(mesh.cells().len() as f64) * context.size() as f64;
        assert!(share <= 1.5 * (per_rectangle * nx * ny) as f64, "an even partition");
    }

    let boundary = mesh.boundary_edges()?;
    assert_eq!(context.comm().all_reduce_sum(boundary.len()), 2 * (nx + ny));
    let mut expected = at_left(&mesh, boundary)?;
    // The label contains the refined edges and the new vertices between them.
    let mut labelled: Vec<_> =
        mesh.labelled("support", 1)?.into_iter().filter(|point| mesh.edges().contains(point)).collect();
    labelled.sort_unstable();
    expected.sort_unstable();
    assert_eq!(context.comm().all_reduce_sum(expected.len()), ny);
    assert_eq!(labelled, expected);
    assert!(mesh.labelled("nothing", 1)?.is_empty());
    Ok(())
}

/// Three dofs per vertex with the left edge held: scatters, numbering, and assembly of a matrix
/// like that of the string.
fn dofs(arguments: &[String]) -> Result<()> {
    let context = Context::start(arguments)?;
    let mesh = distributed(rectangle(&context, 4, [4, 2])?)?;
    let mesh = Refinement::new(&mesh)?.fine()?;
    let (positions, first) = (mesh.coordinates()?, mesh.vertices().start);
    let vertices = mesh.vertices();
    let section = Section::new(&context, mesh.chart(), |point| {
        if !vertices.contains(&point) {
            return Dofs::default();
        }
        let held = if positions[(point - first) as usize][0] == 0.0 { vec![0, 2] } else { vec![] };
        Dofs { count: 3, held }
    })?;
    let mesh = mesh.with_section(&section)?;
    let (nodes, held) = (9 * 5, 2 * 5);
    let (mut global, mut local) = (mesh.global_vector()?, mesh.local_vector()?);
    assert_eq!(context.comm().all_reduce_sum(global.local_size()), 3 * nodes - held);
    assert_eq!(local.local_size(), 3 * vertices.len());

    // The number of each dof reaches the ranks that share it.
    let numbers: Vec<_> = global.range().map(f64::from).collect();
    global.set_local(&numbers)?;
    local.fill(-1.0)?;
    mesh.to_local(&global, &mut local)?;
    let map = mesh.global_dofs()?;
    for (dof, value) in map.iter().zip(local.to_vec()?) {
        assert_eq!(f64::from((*dof).max(-1)), value);
    }
    for vertex in vertices.clone() {
        let first = section.offset(vertex)? as usize;
        let free = map[first..first + 3].iter().copied().filter(|&dof| dof >= 0).collect::<Vec<_>>();
        assert_eq!(free, (free[0]..free[0] + free.len() as Index).collect::<Vec<_>>());
    }

    // Sums over cells, by vector and by matrix, count the cells that touch each dof.
    global.fill(0.0)?;
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    let mut counts = vec![0.0; local.local_size()];
    for cell in mesh.cells() {
        for vertex in mesh.corners(cell)? {
            let first = section.offset(vertex)? as usize;
            for dof in first..first + 3 {
                counts[dof] += 1.0;
                rows.push(map[dof]);
                values.push(1.0);
            }
        }
    }
    local.set_local(&counts)?;
    mesh.add_to_global(&local, &mut global)?;
    let most = global.to_vec()?.into_iter().fold(0.0, f64::max);
    assert_eq!(context.comm().all_reduce_max(most), 4.0);
    let matrix = Matrix::from_triplets(&context, global.local_size(), &rows, &rows, &values)?;
    let mut diagonal = matrix.vector()?;
    matrix.diagonal(&mut diagonal)?;
    assert_eq!(diagonal.to_vec()?, global.to_vec()?);
    Ok(())
}
