//! Nodes and cells of the mesh in the regions of a scene, and the locations of its supports.

use crate::communicator::Communicator;
use crate::dof_map::Place;
use crate::error::{Error, Result};
use crate::field::Condition;
use crate::geometry::{self, Segment};
use crate::mesh::{self, Mesh, NEAR, Point};
use crate::partition::Partition;
use crate::scene::{Region, Scene, SupportKind, SupportLocation};
use std::collections::BTreeMap;

/// Sum of the values of all processes at each node of this process. Collective.
pub(super) type NodeSums<'p> = dyn Fn(&[f64]) -> Result<Vec<f64>> + 'p;

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
                let sides = named(&mesh.edges, "edge", edge, comm, &key)?;
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
            SupportLocation::At(point, radius) => {
                let nodes = nodes_at(mesh, *point, comm, &key)?;
                Place::Nodes(within(mesh, nodes, *radius, comm))
            }
            SupportLocation::Point(name, radius) => {
                let nodes = named(&mesh.points, "point", name, comm, &key)?.to_vec();
                Place::Nodes(within(mesh, nodes, *radius, comm))
            }
        };
        supports.push((place, support.kind));
    }
    Ok(supports)
}

/// Returns the nodes of this process up to a radius (m) around some nodes of all processes; without
/// a radius the nodes themselves. Collective.
fn within(mesh: &Mesh, nodes: Vec<usize>, radius: Option<f64>, comm: &impl Communicator) -> Vec<usize> {
    let Some(radius) = radius else { return nodes };
    let places: Vec<[f64; 2]> = nodes.iter().map(|&node| mesh.nodes[node].into()).collect();
    let centres = comm.all_gather(&places);
    let is_near = |centre: &[f64; 2], node: usize| {
        (mesh.nodes[node] - Point::from(*centre)).norm() <= (1.0 + NEAR) * radius
    };
    (0..mesh.nodes.len()).filter(|&node| centres.iter().any(|centre| is_near(centre, node))).collect()
}

/// Returns this process's members of a named list of the mesh; `what` is the word for its kind,
/// also in keys. Collective.
pub(super) fn named<'m, T>(
    lists: &'m BTreeMap<String, Vec<T>>,
    what: &str,
    name: &str,
    comm: &impl Communicator,
    key: &str,
) -> Result<&'m [T]> {
    let members = lists.get(name).map_or(&[][..], Vec::as_slice);
    require(comm, !members.is_empty(), || {
        let names: Vec<&str> = lists.keys().map(String::as_str).collect();
        format!("{key}.{what}: the mesh has no {what} named \"{name}\"; it has: {}", names.join(", "))
    })?;
    Ok(members)
}

/// Returns whether a condition of a table holds at a point.
pub(super) fn holds(condition: &Condition, point: Point, key: &str) -> Result<bool> {
    condition.holds(point, 0.0).map_err(|fault| Error::Scene(format!("{key}.where: {fault}")))
}

/// Returns an error unless `here` is true on some process. Collective.
pub(super) fn require(comm: &impl Communicator, here: bool, wrong: impl Fn() -> String) -> Result<()> {
    if comm.all_reduce_any(here) { Ok(()) } else { Err(Error::Mesh(wrong())) }
}

/// Returns the nodes of this process at a point. Collective.
fn nodes_at(mesh: &Mesh, [x, y]: [f64; 2], comm: &impl Communicator, key: &str) -> Result<Vec<usize>> {
    let point = Point::new(x, y);
    let distance = |node: usize| (mesh.nodes[node] - point).norm();
    let nearest = (0..mesh.nodes.len()).min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
    let candidate = nearest.map_or([f64::INFINITY, x, y, 0.0], |node| {
        let farthest = mesh.nodes.iter().map(|p| (p - point).norm()).fold(0.0, f64::max);
        [distance(node), mesh.nodes[node].x, mesh.nodes[node].y, farthest]
    });
    let candidates = comm.all_gather_one(candidate);
    let size = candidates.iter().map(|[.., farthest]| *farthest).fold(0.0, f64::max);
    let best = candidates.iter().min_by(|a, b| a[0].total_cmp(&b[0])).unwrap_or(&candidate);
    if best[0] > NEAR * size {
        return Err(Error::Mesh(format!(
            "{key}.at: no node lies at {}; the nearest is at {}",
            geometry::place([x, y]),
            geometry::place([best[1], best[2]])
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
    nodes_of(region, mesh, partition.comm(), &|of_nodes| partition.sum_at_nodes(of_nodes), key)
}

/// Works as [`nodes_in`], with the function that sums the values of all processes at each node.
pub(super) fn nodes_of(
    region: &Region,
    mesh: &Mesh,
    comm: &impl Communicator,
    sums: &NodeSums,
    key: &str,
) -> Result<Vec<usize>> {
    let nodes = 0..mesh.nodes.len();
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
            for &cell in named(&mesh.groups, "group", name, comm, key)? {
                mesh.cells[cell].nodes().iter().for_each(|&node| touched[node] = 1.0);
            }
            let touched = sums(&touched)?;
            Ok(nodes.filter(|&node| touched[node] > 0.0).collect())
        }
        Region::At(point) => nodes_at(mesh, *point, comm, key),
        Region::Point(name) => {
            let mut chosen = vec![0.0; mesh.nodes.len()];
            let points = named(&mesh.points, "point", name, comm, key)?;
            points.iter().for_each(|&node| chosen[node] = 1.0);
            let chosen = sums(&chosen)?;
            Ok(nodes.filter(|&node| chosen[node] > 0.0).collect())
        }
        Region::Line([from, to]) => {
            let from = Point::from(*from);
            let line = Segment::new([from, (*to).into()]);
            let near = comm.all_gather_one(mesh::nearness(&mesh.nodes, from)).into_iter().fold(0.0, f64::max);
            let chosen: Vec<usize> = nodes.filter(|&node| line.distance(mesh.nodes[node]) <= near).collect();
            require(comm, !chosen.is_empty(), || format!("{key}.line: no node lies on it"))?;
            Ok(chosen)
        }
    }
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
            let inside = |cell: usize| holds(condition, mesh.middle(cell), key);
            chosen = comm.all_ok((0..mesh.cells.len()).map(inside).collect())?;
            require(comm, chosen.contains(&true), || {
                format!("{key}.where: it holds at the centre of no cell")
            })?;
        }
        Region::Group(name) => {
            let cells = named(&mesh.groups, "group", name, comm, key)?;
            cells.iter().for_each(|&cell| chosen[cell] = true);
        }
        Region::All | Region::At(_) | Region::Point(_) | Region::Line(_) => {}
    }
    Ok(chosen)
}
