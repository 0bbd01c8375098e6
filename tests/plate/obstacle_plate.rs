//! A plate over a parabolic dome, compared with the exact solution.
//!
//! The disc of radius 2 is clamped, has rigidity 1 (its energy is half the integral of D^2 u : D^2
//! u), and lies above psi = 1 - r^2. It touches for r <= r0. Outside, u = C1 r^2 ln r + C2 r^2 + C3
//! ln r + C4 with u, u', u'' continuous at r0 and u(2) = u'(2) = 0: these five equations are solved
//! here again. The discrete problem is the part of the disc in the square (-1/2, 1/2)^2, with w,
//! w_x, w_y given on the edge: K applied to the given dofs is the load of the others.
//!
//! The tests consider two errors: the true one |D^2 (u_h - u)|, by quadrature, and |D^2 (u_h - I
//! u)|, the distance from the interpolant, for which the numbers of an independent program are
//! known. Contact limits the smoothness of u to its second derivatives (the third ones jump), and
//! both errors decrease as h. On triangles with alternating diagonals u_h is nearer to u than to I
//! u.

use crate::common::models::unit_plate;
use nalgebra::SVector;
use rebond::element::{Element, fvs, hct, quadrature};
use rebond::linalg::{Bending, CellClass, ElementMatrix, Engine, Native};
use rebond::mesh::{Cell, Diagonal, ElementKind, Mesh, Point};
use rebond::obstacle::Bounds;
use rebond::plate::{Plate, stiffness_root};
use rebond::vi::{Answer, CheckedSolver, Condensed, Problem};

/// Number of cells per side, and the distance from the interpolant that an independent program
/// found.
const FVS: [(usize, f64); 4] = [(8, 6.33e-2), (16, 2.69e-2), (32, 1.43e-2), (64, 7.04e-3)];
const HCT: [(usize, f64); 4] = [(8, 1.74e-1), (16, 8.90e-2), (32, 4.59e-2), (64, 2.32e-2)];

/// Plate with D = 1 and nu = 0, whose energy density is D^2 u : D^2 u over 2.
const PLATE: Plate = unit_plate(0.0);

/// Radial solution outside contact.
#[derive(Debug)]
struct Exact {
    r0: f64,
    c: [f64; 4],
}

impl Exact {
    /// Solves for r0. For a given r0, four of the conditions are linear in C1 to C4; the fifth,
    /// u(2) = 0, is the equation for r0.
    fn solve() -> Exact {
        let at = |r0: f64| {
            let (r2, l, l2) = (r0 * r0, r0.ln(), 2f64.ln());
            // The expression r u'' - u' = 2 C1 r - 2 C3 / r vanishes at r0, so C3 = C1 r0^2. Then
            // u'(r0) = -2 r0 is C1 a + 2 C2 = -2, and u'(2) = 0 is C1 b + 4 C2 = 0.
            let (a, b) = (2.0 * l + 2.0, 2.0 * (2.0 * l2 + 1.0) + r2 / 2.0);
            let c1 = -4.0 / (2.0 * a - b);
            let c2 = -c1 * b / 4.0;
            let c3 = c1 * r2;
            let c4 = 1.0 - r2 - (c1 * r2 * l + c2 * r2 + c3 * l);
            (Exact { r0, c: [c1, c2, c3, c4] }, 4.0 * (c1 * l2 + c2) + c3 * l2 + c4)
        };
        let (mut low, mut high) = (0.1, 0.3);
        assert!(at(low).1 * at(high).1 < 0.0);
        for _ in 0..100 {
            let middle = 0.5 * (low + high);
            if at(middle).1 * at(low).1 > 0.0 { low = middle } else { high = middle }
        }
        at(low).0
    }

    /// Returns u, u' and u'' outside contact.
    fn radial(&self, r: f64) -> [f64; 3] {
        let (l, [c1, c2, c3, c4]) = (r.ln(), self.c);
        [
            c1 * r * r * l + c2 * r * r + c3 * l + c4,
            c1 * r * (2.0 * l + 1.0) + 2.0 * c2 * r + c3 / r,
            c1 * (2.0 * l + 3.0) + 2.0 * c2 - c3 / (r * r),
        ]
    }

    /// Returns w, w_x, w_y and w_xx, w_xy, w_yy.
    fn at(&self, p: Point) -> ([f64; 3], [f64; 3]) {
        let r = p.coords.norm();
        if r <= self.r0 {
            return ([1.0 - r * r, -2.0 * p.x, -2.0 * p.y], [-2.0, 0.0, -2.0]);
        }
        let ([u, du, ddu], x, y) = (self.radial(r), p.x / r, p.y / r);
        let around = du / r;
        (
            [u, du * x, du * y],
            [ddu * x * x + around * y * y, (ddu - around) * x * y, ddu * y * y + around * x * x],
        )
    }
}

/// Returns the element matrix of a cell.
fn stiffness<const N: usize>(
    element: &Element<N>,
    nodes: &[usize],
    mesh: &Mesh,
    free: &[Option<usize>],
    class: usize,
) -> ElementMatrix {
    let matrix = PLATE.section().stiffness(element);
    let root = stiffness_root(element, &quadrature::DEGREE_2, |_| PLATE.section()).unwrap();
    let arm = |&node: &usize| (mesh.nodes[node] - mesh.nodes[nodes[0]]).into();
    let bending =
        Bending { arms: nodes[1..].iter().map(arm).collect(), root: root.transpose().as_slice().into() };
    let dofs = nodes.iter().flat_map(|&node| free[3 * node..3 * node + 3].to_vec()).collect();
    ElementMatrix {
        dofs,
        matrix: matrix.as_slice().into(),
        bending: Some(bending.into()),
        class: CellClass::Plate(class),
    }
}

/// Returns the square of the true error on a cell, each piece of which is cut in four.
fn error<const N: usize>(element: &Element<N>, nodes: &[usize], u: &[f64], exact: &Exact) -> f64 {
    let local = SVector::<f64, N>::from_fn(|i, _| u[3 * nodes[i / 3] + i % 3]);
    let quarters: [([f64; 3], f64); 4] =
        [([0.5, 0.0, 0.0], 0.5), ([0.0, 0.5, 0.0], 0.5), ([0.0, 0.0, 0.5], 0.5), ([0.5; 3], -0.5)];
    let mut sum = 0.0;
    for (number, piece) in element.pieces.iter().enumerate() {
        for (corner, scale) in quarters {
            for (barycentric, weight) in quadrature::DEGREE_6 {
                let at: [f64; 3] = std::array::from_fn(|i| corner[i] + scale * barycentric[i]);
                let hessian = piece.basis(at).hessian * local;
                let (_, [xx, xy, yy]) = exact.at(element.point(number, at));
                let error =
                    (hessian[0] - xx).powi(2) + 2.0 * (hessian[1] - xy).powi(2) + (hessian[2] - yy).powi(2);
                sum += error * weight * piece.area() / 4.0;
            }
        }
    }
    sum
}

/// Returns the true error, and the distance from the interpolant.
fn errors(kind: ElementKind, cells: usize, exact: &Exact) -> [f64; 2] {
    let mut mesh = Mesh::rectangle(1.0, 1.0, [cells, cells], kind, Diagonal::Alternating).unwrap();
    mesh.nodes.iter_mut().for_each(|p| *p -= nalgebra::Vector2::new(0.5, 0.5));
    let all = 3 * mesh.nodes.len();
    let given: Vec<usize> =
        ["left", "right", "bottom", "top"].iter().flat_map(|edge| mesh.edge_nodes(edge).unwrap()).collect();
    let mut free = vec![None; all];
    let mut size = 0;
    for node in (0..mesh.nodes.len()).filter(|node| !given.contains(node)) {
        for slot in &mut free[3 * node..3 * node + 3] {
            *slot = Some(size);
            size += 1;
        }
    }
    let everything: Vec<Option<usize>> = (0..all).map(Some).collect();
    let blocks = |dofs: &[Option<usize>]| -> Vec<ElementMatrix> {
        let element = |(class, cell): (usize, &Cell)| match cell {
            Cell::Triangle(nodes) => {
                let element = hct::element(nodes.map(|node| mesh.nodes[node])).unwrap();
                stiffness(&element, nodes, &mesh, dofs, class)
            }
            Cell::Quadrilateral(nodes) => {
                let element = fvs::element(nodes.map(|node| mesh.nodes[node])).unwrap();
                stiffness(&element, nodes, &mesh, dofs, class)
            }
        };
        mesh.cells.iter().enumerate().map(element).collect()
    };
    let interpolant: Vec<f64> = mesh.nodes.iter().flat_map(|&p| exact.at(p).0).collect();

    // The given dofs exert these forces on the free ones.
    let whole = Native::new(all);
    let whole_form = whole.form(blocks(&everything));
    let mut u: Vec<f64> =
        interpolant.iter().zip(&free).map(|(u, dof)| if dof.is_none() { *u } else { 0.0 }).collect();
    let mut forces = vec![0.0; all];
    whole.multiply(&whole_form, &u, &mut forces).unwrap();
    let mut b = vec![0.0; size];
    for (dof, force) in free.iter().zip(&forces) {
        if let Some(dof) = dof {
            b[*dof] = -force;
        }
    }

    let engine = Native::new(size);
    let form = engine.form(blocks(&free));
    let nodes = mesh.nodes.iter().zip(free.iter().step_by(3));
    let (dofs, lower): (Vec<usize>, Vec<f64>) =
        nodes.filter_map(|(p, dof)| Some(((*dof)?, 1.0 - p.coords.norm_squared()))).unzip();
    let bounds = Bounds { lower, ..Bounds::uniform(dofs, 0.0, f64::INFINITY) };
    let sum = (&form).into();
    let solver = Condensed::new(&engine, &sum, bounds.len()).unwrap();
    let mut step: CheckedSolver<Native> = CheckedSolver::new(Box::new(solver), &engine, &sum).unwrap();
    let (mut x, mut reaction) = (vec![0.0; size], vec![0.0; bounds.len()]);
    let problem = Problem { matrix: &sum, rhs: &b, bounds: &bounds, length: 1.0 };
    let mut answer = Answer { x: &mut x, reaction: &mut reaction };
    let verdict = step.solve(&engine, &problem, &mut answer).unwrap();
    assert!(verdict.kkt <= 1e-12, "{cells} cells: {:e}", verdict.kkt);
    for (u, dof) in u.iter_mut().zip(&free) {
        if let Some(dof) = dof {
            *u = x[*dof];
        }
    }

    let distance: Vec<f64> = u.iter().zip(&interpolant).map(|(u, i)| u - i).collect();
    let distance = whole.multiply(&whole_form, &distance, &mut forces).unwrap().sqrt();
    let squares = mesh.cells.iter().map(|cell| match cell {
        Cell::Triangle(nodes) => {
            error(&hct::element(nodes.map(|node| mesh.nodes[node])).unwrap(), nodes, &u, exact)
        }
        Cell::Quadrilateral(nodes) => {
            error(&fvs::element(nodes.map(|node| mesh.nodes[node])).unwrap(), nodes, &u, exact)
        }
    });
    let true_error = squares.sum::<f64>().sqrt();
    println!(
        "{kind:?} {cells}: error {true_error:.3e}, from the interpolant {distance:.3e}, {} iterations, kkt {:.1e}",
        verdict.iterations, verdict.kkt
    );
    [true_error, distance]
}

#[test]
fn the_exact_solution_meets_its_conditions() {
    let exact = Exact::solve();
    let published = [0.18134453, 0.52504063, -0.62860905, 0.01726640, 1.04674630];
    for (solved, published) in [exact.r0].iter().chain(&exact.c).zip(published) {
        assert!((solved - published).abs() <= 5.1e-9, "{exact:?}");
    }
    let r0 = exact.r0;
    let contact = [1.0 - r0 * r0, -2.0 * r0, -2.0];
    let conditions =
        exact.radial(r0).into_iter().zip(contact).chain(exact.radial(2.0).into_iter().zip([0.0; 2]));
    for (value, expected) in conditions {
        assert!((value - expected).abs() <= 1e-13, "{value} {expected}");
    }
    // Outside contact, the plate lies above the obstacle.
    assert!((1..1000).all(|i| {
        let r = r0 + (2.0 - r0) * f64::from(i) / 1000.0;
        exact.radial(r)[0] > 1.0 - r * r
    }));
}

/// Asserts that both errors decrease as h, and that the second agrees with an independent program
/// to its digits.
fn check(kind: ElementKind, table: [(usize, f64); 4], cap: f64) {
    let exact = Exact::solve();
    let computed = table.map(|(cells, _)| errors(kind, cells, &exact));
    for ((cells, expected), [_, distance]) in table.into_iter().zip(computed) {
        assert_eq!(format!("{distance:.2e}"), format!("{expected:.2e}"), "{kind:?}, {cells} cells");
    }
    for which in 0..2 {
        for pair in computed[1..].windows(2) {
            let order = (pair[0][which] / pair[1][which]).log2();
            assert!((order - 1.0).abs() <= 0.1, "{kind:?}: order {order}");
        }
    }
    assert!(computed[3][0] <= cap, "{kind:?}: {}", computed[3][0]);
}

#[test]
fn fvs_converges_to_the_exact_solution() {
    check(ElementKind::Fvs, FVS, 0.010);
}

#[test]
fn hct_converges_to_the_exact_solution() {
    check(ElementKind::Hct, HCT, 0.0145);
}
