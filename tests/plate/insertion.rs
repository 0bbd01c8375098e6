//! Nodes made at points and along lines: the result is a mesh of the same plate with well-shaped
//! cells, on which quadratics are exact.

use crate::common::Random;
use crate::common::models::unit_plate;
use crate::common::plates::Matrices;
use rebond::linalg::Engine;
use rebond::mesh::{Diagonal, ElementKind, Mark, Mesh, Point};
use std::collections::BTreeMap;

const SIDES: [f64; 2] = [1.5, 1.0];

/// Returns a rectangle in two groups, whose inner nodes are displaced at random.
fn random_mesh(random: &mut Random) -> Mesh {
    let cells = [2 + random.below(6), 2 + random.below(5)];
    let kind = [ElementKind::Fvs, ElementKind::Hct][random.below(2)];
    let diagonal = [Diagonal::Right, Diagonal::Left, Diagonal::Alternating][random.below(3)];
    let mut mesh = Mesh::rectangle(SIDES[0], SIDES[1], cells, kind, diagonal).unwrap();
    let play = 0.2 * random.unit();
    for node in &mut mesh.nodes {
        for axis in 0..2 {
            if node[axis] > 0.0 && node[axis] < SIDES[axis] {
                node[axis] += play * random.signed() * SIDES[axis] / cells[axis] as f64;
            }
        }
    }
    // Nodes of the boundary stay on it, since each moved along it only.
    mesh.check().unwrap();
    let split = random.below(mesh.cells.len());
    mesh.groups.insert("first".into(), (0..split).collect());
    mesh.groups.insert("last".into(), (split..mesh.cells.len()).collect());
    mesh.points.insert("kept".into(), vec![random.below(mesh.nodes.len())]);
    mesh
}

/// Returns a point of the plate, often near an edge, a node or a cell's side, or on one.
fn place(mesh: &Mesh, random: &mut Random) -> Point {
    let anywhere = Point::new(SIDES[0] * random.unit(), SIDES[1] * random.unit());
    let node = mesh.nodes[random.below(mesh.nodes.len())];
    let near = 10.0_f64.powf(-4.0 * random.unit());
    match random.below(6) {
        0 => Point::new(anywhere.x, [0.0, SIDES[1]][random.below(2)]),
        1 => Point::new(SIDES[0] * near, anywhere.y),
        2 => node,
        3 => {
            let at = node + near * (anywhere - node);
            Point::new(at.x.clamp(0.0, SIDES[0]), at.y.clamp(0.0, SIDES[1]))
        }
        4 => {
            let nodes = mesh.cells[random.below(mesh.cells.len())].nodes();
            mesh.nodes[nodes[0]] + random.unit() * (mesh.nodes[nodes[1]] - mesh.nodes[nodes[0]])
        }
        _ => anywhere,
    }
}

fn area(mesh: &Mesh, group: Option<&str>) -> f64 {
    let cells = group.map_or_else(|| (0..mesh.cells.len()).collect(), |group| mesh.groups[group].clone());
    cells.iter().map(|&cell| mesh.area(cell)).sum()
}

fn lengths(mesh: &Mesh) -> BTreeMap<&str, f64> {
    let length = |sides: &Vec<[usize; 2]>| {
        sides.iter().map(|[a, b]| (mesh.nodes[*a] - mesh.nodes[*b]).norm()).sum::<f64>()
    };
    mesh.edges.iter().map(|(name, sides)| (name.as_str(), length(sides))).collect()
}

/// Returns the least angle of a mesh, and the least difference of an angle from 180 degrees.
fn angles(mesh: &Mesh) -> [f64; 2] {
    let mut least = [f64::INFINITY; 2];
    for cell in 0..mesh.cells.len() {
        let vertices = mesh.vertices(cell);
        let count = vertices.len();
        for i in 0..count {
            let (next, last) =
                (vertices[(i + 1) % count] - vertices[i], vertices[(i + count - 1) % count] - vertices[i]);
            let angle = next.perp(&last).atan2(next.dot(&last));
            least = [least[0].min(angle), least[1].min(std::f64::consts::PI - angle)];
        }
    }
    least.map(f64::to_degrees)
}

/// Returns the largest force of a quadratic shape at inner nodes, over the largest entry of K; it
/// is 0 if quadratics are exact.
fn patch(mesh: Mesh) -> f64 {
    let on_rim = |p: &Point| (0..2).any(|axis| p[axis] == 0.0 || p[axis] == SIDES[axis]);
    let rim: Vec<bool> = mesh.nodes.iter().map(on_rim).collect();
    let plate = Matrices::new(mesh, unit_plate(0.3), &[]);
    let mut stiffest = 0.0_f64;
    plate.stiffness.for_each_lower(|_, _, entry| stiffest = stiffest.max(entry.abs()));
    let shape = |p: &Point| [p.x * p.x - 0.7 * p.x * p.y, 2.0 * p.x - 0.7 * p.y, -0.7 * p.x];
    let u: Vec<f64> = plate.mesh.nodes.iter().flat_map(shape).collect();
    let mut forces = vec![0.0; u.len()];
    plate.engine.multiply(&plate.stiffness, &u, &mut forces).unwrap();
    let inner = forces.iter().enumerate().filter(|(dof, _)| !rim[dof / 3]);
    inner.fold(0.0, |most: f64, (_, force)| most.max(force.abs())) / stiffest
}

fn random_marks(tries: u64) {
    let (mut made_any, mut refused) = (0, 0);
    for seed in 0..tries {
        let mut random = Random::new(seed);
        let mesh = random_mesh(&mut random);
        let mut marks: Vec<(String, Mark)> = Vec::new();
        for number in 0..1 + random.below(3) {
            marks.push((format!("at {number}"), Mark::At(place(&mesh, &mut random))));
        }
        if random.below(3) == 0 {
            let ends = [place(&mesh, &mut random), place(&mesh, &mut random)];
            marks.push(("line".into(), Mark::Line(ends)));
        }
        let (found, made) = match mesh.clone().with_nodes(&marks) {
            Ok(found) => found,
            Err(error) => {
                refused += 1;
                let error = error.to_string();
                assert!(error.contains("angles near 0 or 180 degrees"), "seed {seed}: {error}");
                continue;
            }
        };
        made_any += usize::from(!made.is_empty());
        assert_eq!(made.is_empty(), found == mesh, "seed {seed}");
        found.check().unwrap();
        for (_, mark) in &marks {
            let Mark::At(at) = mark else { continue };
            let nearest = found.nodes.iter().map(|node| (node - at).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest <= 2e-6, "seed {seed}: {nearest}");
        }
        for group in [None, Some("first"), Some("last")] {
            let (now, then) = (area(&found, group), area(&mesh, group));
            assert!((now - then).abs() <= 1e-5, "seed {seed}, {group:?}: {now}, {then}");
        }
        assert!((area(&found, None) - 1.5).abs() <= 1e-13, "seed {seed}");
        for ((name, now), (_, then)) in lengths(&found).into_iter().zip(lengths(&mesh)) {
            assert!((now - then).abs() <= 1e-13, "seed {seed}, {name}: {now}, {then}");
        }
        assert_eq!(found.nodes[found.points["kept"][0]], mesh.nodes[mesh.points["kept"][0]]);
        let [small, large] = angles(&found);
        assert!(small >= 0.029 && large >= 2.6, "seed {seed}: {small}, 180 - {large} degrees");
        if seed % 8 == 0 {
            let error = patch(found);
            assert!(error <= 1e-13, "seed {seed}: {error:e}");
        }
    }
    assert!(made_any * 2 > tries as usize && refused * 5 < tries as usize, "{made_any}, {refused}");
}

#[test]
fn random_points_and_lines() {
    random_marks(400);
}

#[test]
#[ignore = "10,000 meshes"]
fn ten_thousand_random_points_and_lines() {
    random_marks(10_000);
}

/// A line gets a node wherever it crosses a side of a cell, and at those of its ends that lie in
/// the plate.
#[test]
fn a_line_has_nodes_at_its_crossings() {
    for (kind, most) in [(ElementKind::Fvs, 30), (ElementKind::Hct, 40)] {
        let mesh = Mesh::rectangle(1.5, 1.0, [8, 6], kind, Diagonal::Right).unwrap();
        let ends = [Point::new(-0.2, 0.13), Point::new(1.21, 0.77)];
        let (found, made) = mesh.with_nodes(&[("line".into(), Mark::Line(ends))]).unwrap();
        let along = (ends[1] - ends[0]).normalize();
        let off = |p: &Point| along.perp(&(p - ends[0]));
        let mut places: Vec<f64> =
            (found.nodes.iter().filter(|p| off(p).abs() < 1e-6)).map(|p| along.dot(&(p - ends[0]))).collect();
        places.sort_by(f64::total_cmp);
        assert!((places.last().unwrap() - (ends[1] - ends[0]).norm()).abs() < 1e-9);
        assert!(places.windows(2).all(|pair| pair[1] - pair[0] < 0.26), "{places:?}");
        assert!(made.len() < most, "{}", made.len());
        for cell in &found.cells {
            for [a, b] in cell.edges() {
                let (left, right) = (off(&found.nodes[a]), off(&found.nodes[b]));
                let at = found.nodes[a] + (found.nodes[b] - found.nodes[a]) * (left / (left - right));
                let crosses = left * right < 0.0 && left.abs() > 2e-6 && right.abs() > 2e-6;
                assert!(!crosses || along.dot(&(at - ends[1])) > 0.0, "{at}");
            }
        }
    }
}

/// Points that need no new node change nothing, and points that cannot have one are refused.
#[test]
fn nodes_that_are_there_and_that_cannot_be() {
    let mesh = Mesh::rectangle(1.5, 1.0, [3, 2], ElementKind::Hct, Diagonal::Alternating).unwrap().refine();
    let marks = [
        ("a".into(), Mark::At(Point::new(0.25, 0.75))),
        ("b".into(), Mark::Line([Point::new(0.5, -1.0), Point::new(0.5, 2.0)])),
        ("c".into(), Mark::Line([Point::new(0.25, 0.25), Point::new(1.0, 0.25)])),
    ];
    let (same, made) = mesh.clone().with_nodes(&marks).unwrap();
    assert!(made.is_empty() && same == mesh);
    let refusal = |at: [f64; 2]| mesh.clone().with_nodes(&[("key".into(), Mark::At(at.into()))]).unwrap_err();
    let error = refusal([2.0, 0.5]).to_string();
    assert!(error.starts_with("key: the point (2, 0.5) lies outside the plate"), "{error}");
    let error = refusal([1.49995, 0.25]).to_string();
    assert!(error.starts_with("key: a node at (1.49995, 0.25) would make"), "{error}");
    assert!(error.ends_with("such as (1.5, 0.25)"), "{error}");
}
