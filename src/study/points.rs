//! Warnings of what has no limit under refinement, because it is held or loaded at a point.
//!
//! The deflection of a plate is continuous, but its slopes are merely square integrable with their
//! derivatives: a point holds a deflection and no slope. A plate that is clamped at a point tends
//! to one that is simply supported there, if only as the logarithm of the cell size. The moments
//! beside a point force or a point support grow without end. A rigid ball meets the mass near a
//! point, which the mesh must resolve.

use crate::geometry;
use crate::mesh::{self, Mesh, Point};
use crate::output::text::engineering;
use crate::plate::Sections;
use crate::scene::{Mass, Region, Scene, Support, SupportKind, SupportLocation};
use crate::simulation;

/// Number of nodes from which a mesh shows a washer.
const WASHER: usize = 5;

/// Returns the warnings of a scene.
pub(super) fn warnings(scene: &Scene) -> Vec<String> {
    // An error here has been reported by what needs the mesh.
    let Ok(mesh) = simulation::mesh(scene) else { return Vec::new() };
    let mut warnings = held_slopes(scene, &mesh);
    warnings.extend(joints(&mesh));
    warnings.extend(stresses(scene, &mesh));
    warnings.extend(rebounds(scene, &mesh));
    warnings
}

/// Mass of a rigid ball, in masses of the cell that it hits, above which the mesh hardly matters.
///
/// The plate takes the momentum of a ball as a dashpot of 8 sqrt(D rho h) would, and the waves of
/// this time must pass some cells. On a block the speed is then that of finer meshes to 3 % of the
/// speed before; with a ball of 16 cells, to 10 %.
const RESOLVED: f64 = 100.0;

/// Warns of rigid balls that are light beside the cells that they hit.
fn rebounds(scene: &Scene, mesh: &Mesh) -> Vec<String> {
    let Ok(sections) = simulation::sections(scene, mesh) else { return Vec::new() };
    let is_light = |mass: f64, place: [f64; 2]| {
        let cell = mesh.locate(place.into())?;
        let density = sections.section(cell, place.into()).ok()?.density;
        Some(mass < RESOLVED * mesh.area(cell) * density)
    };
    let balls = scene.attachments.balls.iter().enumerate();
    balls
        .filter(|(_, ball)| ball.compliance.is_none() && scene.time.mass != Mass::Modal)
        .filter(|(_, ball)| is_light(ball.mass, ball.at) == Some(true))
        .map(|(number, _)| {
            format!(
                "ball.{number}.mass: the rebound of a rigid ball below {RESOLVED} times the mass of the cell that it hits depends on \
                 the mesh: give the ball a stiffness, or refine the mesh"
            )
        })
        .collect()
}

/// Warns of supports that hold slopes at a point, or at too few nodes for a washer.
fn held_slopes(scene: &Scene, mesh: &Mesh) -> Vec<String> {
    let slopes = |kind| match kind {
        SupportKind::Clamped => Some("clamped"),
        SupportKind::Guided => Some("guided"),
        SupportKind::SimplySupported | SupportKind::Elastic => None,
    };
    let mut warnings = Vec::new();
    for (number, support) in scene.supports.iter().enumerate() {
        let (key, radius) = match support.stand {
            SupportLocation::At(_, radius) => ("at", radius),
            SupportLocation::Point(_, radius) => ("point", radius),
            SupportLocation::Edge { .. } => continue,
        };
        if let Some(radius) = radius {
            let is_held =
                |node: &Point, centre: &Point| (node - centre).norm() <= (1.0 + mesh::NEAR) * radius;
            let is_bare =
                |centre: &Point| mesh.nodes.iter().filter(|node| is_held(node, centre)).count() < WASHER;
            if places(support, mesh).iter().any(is_bare) {
                warnings.push(format!(
                    "support.{number}.radius: fewer than {WASHER} nodes lie within {} of the point, so that the mesh does not \
                     show the washer: refine it",
                    engineering(radius, "m")
                ));
            }
        } else if let Some(kind) = slopes(support.kind) {
            warnings.push(format!(
                "support.{number}.{key}: a point cannot hold a slope, so that a plate {kind} at a point has no limit under \
                 refinement: give the support the radius of its washer, or hold several points with kind = \"simply_supported\""
            ));
        }
    }
    warnings
}

/// Warns of parts that a single node joins.
fn joints(mesh: &Mesh) -> Option<String> {
    let nodes = joining_nodes(mesh);
    let place = mesh.nodes[*nodes.first()?];
    let others = match nodes.len() - 1 {
        0 => String::new(),
        others => format!(" and at {others} other nodes"),
    };
    Some(format!(
        "the mesh holds together at ({}, {}){others} by a single node: a point passes on no slope, so that the motion has no limit \
         under refinement; join the parts along a side of their cells",
        place.x, place.y
    ))
}

/// Returns the nodes around which the cells do not all hang together by their sides.
fn joining_nodes(mesh: &Mesh) -> Vec<usize> {
    let mut free_sides = vec![0; mesh.nodes.len()];
    mesh.border().as_flattened().iter().for_each(|&node| free_sides[node] += 1);
    // A row of cells around a node has two free sides, at its ends. Every further row meets it by
    // the node alone.
    (0..mesh.nodes.len()).filter(|&node| free_sides[node] > 2).collect()
}

/// Warns of stresses and moments beside a point that is held or loaded.
fn stresses(scene: &Scene, mesh: &Mesh) -> Vec<String> {
    let points = points(scene, mesh);
    let mut warnings = Vec::new();
    for probe in scene.output.probes.iter().filter(|probe| probe.quantity.is_of_curvature()) {
        let around: Vec<_> = mesh.cells_at(probe.at.into()).map(|cell| mesh.vertices(cell)).collect();
        let is_corner = |point: &Point| {
            around.iter().any(|corners| {
                let near = mesh::NEAR * geometry::longest_edge(corners);
                corners.iter().any(|corner| (corner - point).norm() <= near)
            })
        };
        if let Some((what, _)) = points.iter().find(|(_, point)| is_corner(point)) {
            warnings.push(format!(
                "probe \"{}\": beside a point that is held or loaded ({what}) the {} has no limit under refinement: spread the force \
                 over an area, or measure at some distance",
                probe.name,
                probe.quantity.axis().0
            ));
        }
    }
    let Scene { output, .. } = scene;
    let keys = [
        ("extremes", output.extremes),
        ("stresses", output.fields.is_some_and(|snapshots| snapshots.stresses)),
    ];
    if let Some((key, _)) = keys.into_iter().find(|(_, is_on)| *is_on)
        && let Some((what, _)) = points.first()
    {
        warnings.push(format!(
            "output.{key}: beside a point that is held or loaded ({what}) the stress has no limit under refinement, so that the \
             largest may grow with every finer mesh: give a support the radius of its washer, spread a force over an area"
        ));
    }
    warnings
}

/// Returns the points at which a support holds the plate.
fn places(support: &Support, mesh: &Mesh) -> Vec<Point> {
    match &support.stand {
        SupportLocation::At(place, _) => vec![Point::from(*place)],
        SupportLocation::Point(name, _) => group(name, mesh),
        SupportLocation::Edge { .. } => Vec::new(),
    }
}

/// Returns the points of a physical group.
fn group(name: &str, mesh: &Mesh) -> Vec<Point> {
    mesh.points.get(name).into_iter().flatten().map(|&node| mesh.nodes[node]).collect()
}

/// Returns the points at which forces act on the plate, each with its table.
fn points(scene: &Scene, mesh: &Mesh) -> Vec<(String, Point)> {
    let is_bare = |support: &Support| {
        use SupportLocation::{At, Edge, Point};
        matches!(support.stand, At(_, None) | Point(_, None) | Edge { .. })
    };
    let held = |support| if is_bare(support) { places(support, mesh) } else { Vec::new() };
    let supports = scene.supports.iter().map(held);
    let obstacles = scene.obstacles.iter().map(|obstacle| match &obstacle.region {
        Region::At(place) => vec![Point::from(*place)],
        Region::Point(name) => group(name, mesh),
        _ => Vec::new(),
    });
    let mut points = Vec::new();
    let mut add = |table: &str, places: &mut dyn Iterator<Item = Vec<Point>>| {
        for (number, places) in places.enumerate() {
            points.extend(places.into_iter().map(|place| (format!("{table}.{number}"), place)));
        }
    };
    add("support", &mut supports.into_iter());
    add("obstacle", &mut obstacles.into_iter());
    let attachments = &scene.attachments;
    let forces = scene.load.iter().flat_map(|load| &load.forces);
    let single = |place: [f64; 2]| vec![Point::from(place)];
    add("load.force", &mut forces.map(|force| single(force.at)));
    add("spring", &mut attachments.springs.iter().map(|spring| single(spring.at)));
    add("mass", &mut attachments.masses.iter().map(|mass| single(mass.at)));
    add("ball", &mut attachments.balls.iter().map(|ball| single(ball.at)));
    add("slider", &mut scene.sliders.iter().map(|slider| single(slider.at)));
    points
}
