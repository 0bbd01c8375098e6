//! Triangles and quadrilaterals in one mesh, both unstructured: C1 across every edge, exact for
//! quadratics, convergent.

use crate::common::models::unit_plate;
use crate::common::plates::{Matrices, all_round};
use nalgebra::SVector;
use rebond::dof_map::Support;
use rebond::element::{Basis, fvs, hct};
use rebond::linalg::Engine;
use rebond::mesh::{Cell, Import, Mesh, Point};
use std::collections::HashMap;

/// Returns Gmsh's unit square: quadrilaterals on the left, triangles on the right.
fn square() -> Mesh {
    let bytes = include_bytes!("../data/gmsh/square_41_binary.msh");
    Mesh::from_bytes(bytes, "square.msh", Import::default()).unwrap()
}

/// Returns w, w_x and w_y on the `edge`-th edge of a cell, at the fraction `s` of it.
fn trace(mesh: &Mesh, cell: usize, edge: usize, s: f64, u: &[f64]) -> [f64; 3] {
    fn combine<const N: usize>(basis: Basis<N>, nodes: &[usize], u: &[f64]) -> [f64; 3] {
        let dofs = SVector::<f64, N>::from_fn(|i, _| u[3 * nodes[i / 3] + i % 3]);
        let slopes = basis.gradient * dofs;
        [basis.value.dot(&dofs), slopes.x, slopes.y]
    }
    let barycentric = [1.0 - s, s, 0.0];
    match mesh.cells[cell] {
        Cell::Triangle(nodes) => {
            let element = hct::element(nodes.map(|node| mesh.nodes[node])).unwrap();
            combine(element.pieces[edge].basis(barycentric), &nodes, u)
        }
        Cell::Quadrilateral(nodes) => {
            let element = fvs::element(nodes.map(|node| mesh.nodes[node])).unwrap();
            combine(element.pieces[edge].basis(barycentric), &nodes, u)
        }
    }
}

#[test]
fn deflections_and_slopes_are_continuous_across_every_edge() {
    let mesh = square();
    let mut sides = HashMap::new();
    for (number, cell) in mesh.cells.iter().enumerate() {
        for (edge, nodes) in cell.edges().enumerate() {
            sides.insert(nodes, (number, edge));
        }
    }
    // Any values will do: deflections are of order one, slopes of order one over the length of an
    // edge.
    let u: Vec<f64> = (0..3 * mesh.nodes.len())
        .map(|dof| (1.0 + dof as f64 * 0.7548776662).fract() * if dof % 3 == 0 { 1.0 } else { 10.0 } - 0.5)
        .collect();
    let mut mixed = 0;
    for (&[a, b], &(left, i)) in &sides {
        let Some(&(right, j)) = sides.get(&[b, a]) else { continue };
        mixed += usize::from(mesh.cells[left].nodes().len() > mesh.cells[right].nodes().len());
        let length = (mesh.nodes[b] - mesh.nodes[a]).norm();
        for s in [0.0, 0.17, 0.5, 0.83, 1.0] {
            let (here, there) = (trace(&mesh, left, i, s, &u), trace(&mesh, right, j, 1.0 - s, &u));
            for (row, unit) in [1.0, length, length].into_iter().enumerate() {
                let jump = (here[row] - there[row]).abs() * unit;
                assert!(jump <= 1e-12, "row {row} across {a}-{b}: {jump:e}");
            }
        }
    }
    assert_eq!(mixed, mesh.edges["joint"].len());
}

/// With D = 1 and nu = 0.3 the energies of x^2, xy, y^2 on the unit square are 2, 1 - nu and 2, and
/// their inner forces vanish.
#[test]
fn quadratics_are_exact() {
    type Field = fn(Point) -> [f64; 3];
    let fields: [(Field, f64); 3] = [
        (|p| [p.x * p.x, 2.0 * p.x, 0.0], 2.0),
        (|p| [p.x * p.y, p.y, p.x], 0.7),
        (|p| [p.y * p.y, 0.0, 2.0 * p.y], 2.0),
    ];
    for mesh in [square(), square().refine()] {
        let plate = Matrices::new(mesh, unit_plate(0.3), &[]);
        let rim = all_round(Support::Clamped).map(|(edge, _)| plate.mesh.edge_nodes(edge).unwrap()).concat();
        let mut stiffest = 0.0_f64;
        plate.stiffness.for_each_lower(|_, _, entry| stiffest = stiffest.max(entry.abs()));
        for (field, energy) in fields {
            let u: Vec<f64> = plate.mesh.nodes.iter().flat_map(|&node| field(node)).collect();
            let mut forces = vec![0.0; u.len()];
            let found = 0.5 * plate.engine.multiply(&plate.stiffness, &u, &mut forces).unwrap();
            assert!((found - energy).abs() <= 1e-13, "{found}, not {energy}");
            for (dof, force) in forces.iter().enumerate().filter(|(dof, _)| !rim.contains(&(dof / 3))) {
                assert!(force.abs() <= 1e-15 * stiffest, "dof {dof}: {force:e}");
            }
            for cell in 0..plate.mesh.cells.len() {
                let vertices = plate.mesh.vertices(cell);
                let sum = vertices.iter().fold(Point::origin(), |sum, v| sum + v.coords);
                let middle = sum / vertices.len() as f64;
                assert!((plate.at(&u, middle.x, middle.y) - field(middle)[0]).abs() <= 1e-14);
            }
        }
    }
}

/// A rigid motion at unit velocity has the kinetic energy of the whole plate, with either mass.
#[test]
fn no_mass_is_lost() {
    let plate = Matrices::new(square(), unit_plate(0.3), &[]);
    let u: Vec<f64> = plate.mesh.nodes.iter().flat_map(|_| [1.0, 0.0, 0.0]).collect();
    for mass in [&plate.consistent, &plate.singular] {
        let total = plate.engine.multiply(mass, &u, &mut vec![0.0; u.len()]).unwrap();
        assert!((total - 1.0).abs() <= 1e-13, "{total}");
    }
}

/// The value w D / (q a^4) at the centre, nu = 0.3, approaches published values from below, and
/// each refinement brings it at least 2.5 times nearer.
#[test]
fn published_deflections_of_the_square() {
    for (support, expected, bound) in
        [(Support::SimplySupported, 0.00406235, 4e-4), (Support::Clamped, 0.00126532, 2e-3)]
    {
        let (mut mesh, mut before) = (square(), f64::INFINITY);
        for level in 0..4 {
            let plate = Matrices::new(mesh.clone(), unit_plate(0.3), &all_round(support));
            let error = 1.0 - plate.at(&plate.statics(1.0), 0.5, 0.5) / expected;
            assert!(
                error > 0.0 && error < before / 2.5,
                "{support:?}, level {level}: {error:e} after {before:e}"
            );
            (mesh, before) = (mesh.refine(), error);
        }
        assert!(before < bound, "{support:?}: {before:e}");
    }
}
