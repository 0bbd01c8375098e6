//! Local arrays of one cell: its stiffness, its masses and the integrals of its basis functions.

use crate::element::quadrature::{self, Rule};
use crate::element::{Element, Piece, with_element};
use crate::error::{Error, Result};
use crate::geometry::list;
use crate::linalg::Bending;
use crate::mesh::{Mesh, Point};
use crate::plate::{self, Section, Sections};
use nalgebra::{DVector, SMatrix, Vector3};
use std::cell::RefCell;
use std::rc::Rc;

/// Local arrays of a cell, shared by all cells congruent to it. The masses include the plate, the
/// ribs in the cell and what is fixed to it.
#[derive(Debug, Clone)]
pub struct Local {
    /// Stiffness K, n x n, row by row, in N/m between deflections.
    pub stiffness: Rc<[f64]>,
    /// Consistent mass M_r, n x n, row by row, in kg between deflections.
    pub mass: Rc<[f64]>,
    /// Integrals of the basis functions, n entries, in m^2 for deflections.
    pub moments: Rc<[f64]>,
    /// Integrals of density times basis function, n entries, in kg for deflections.
    pub coupling: Rc<[f64]>,
    /// Row of B, n entries, in kg for deflections: `coupling`, or with light masses a multiple of
    /// the bare plate's row.
    pub row: Rc<[f64]>,
    /// Entry of C, the mass of the cell, in kg.
    pub weight: f64,
    /// Stiffness K as the square of its root.
    pub bending: Rc<Bending>,
}

/// Returns the local arrays of a cell.
pub(super) fn arrays(mesh: &Mesh, number: usize, sections: &impl Sections) -> Result<Local> {
    let named = |error: Error| Error::Mesh(format!("cell {number}: {error}"));
    let element = mesh.element(number).map_err(named)?;
    let vertices = mesh.vertices(number);
    with_element!(&element, element => arrays_of(element, &vertices, number, sections))
}

fn arrays_of<const N: usize>(
    element: &Element<N>,
    vertices: &[Point],
    number: usize,
    sections: &impl Sections,
) -> Result<Local> {
    let flat = |matrix: SMatrix<f64, N, N>| matrix.as_slice().into();
    let moments = plate::moments(element);
    let area: f64 = element.pieces.iter().map(Piece::area).sum();
    let first = sections.section(number, vertices[0])?;
    if sections.kind(number).is_some() {
        let energies = first.bending.diagonal() * area;
        return Ok(Local {
            // The matrix is symmetric, so that column by column is row by row.
            stiffness: flat(first.stiffness(element)),
            bending: bending(element, vertices, number, (&quadrature::DEGREE_2).into(), |_| first, energies)?,
            mass: flat(first.consistent_mass(element)),
            moments: moments.as_slice().into(),
            coupling: (moments * first.density).as_slice().into(),
            row: (moments * first.density).as_slice().into(),
            weight: first.density * area,
        });
    }
    let fault = RefCell::new(None);
    let section = |point: Point| {
        sections.section(number, point).unwrap_or_else(|error| {
            fault.replace(Some(error));
            first
        })
    };
    let density = |point: Point| section(point).density;
    let rule = sections.rules(number).map_or((&quadrature::DEGREE_6).into(), Rule::Own);
    let (mut weight, mut energies) = (0.0, Vector3::zeros());
    for (piece, place, _, share) in element.nodes(rule) {
        let section = section(place);
        weight += share * piece.area() * section.density;
        energies += share * piece.area() * section.bending.diagonal();
    }
    let stiffness = plate::stiffness(element, rule, section);
    let bending = bending(element, vertices, number, rule, section, energies);
    fault.take().map_or(Ok(()), Err)?;
    let coupling: Rc<[f64]> = plate::load_by(element, rule, density).as_slice().into();
    let local = Local {
        stiffness: flat(stiffness),
        bending: bending?,
        mass: flat(plate::mass_by(element, rule, density)),
        moments: moments.as_slice().into(),
        row: coupling.clone(),
        coupling,
        weight,
    };
    fault.into_inner().map_or(Ok(local), Err)
}

/// Largest relative error of the energy of a bent cell; beyond it, its stiffness is mostly
/// rounding.
const LOST: f64 = 1e-3;

/// Returns the stiffness of a cell as the square of its root, checked on the deflections x^2/2, xy
/// and y^2/2, which every cell contains; `energies` are twice their exact energies.
///
/// A cell of aspect ratio a is a^2 times stiffer across than along, and the soft direction suffers
/// from the rounding of the stiff one.
fn bending<const N: usize>(
    element: &Element<N>,
    vertices: &[Point],
    number: usize,
    rule: Rule,
    section: impl Fn(Point) -> Section,
    energies: Vector3<f64>,
) -> Result<Rc<Bending>> {
    let Some(root) = plate::stiffness_root(element, rule, section) else {
        let what = "its stiffness against bending is not positive definite";
        return Err(Error::Mesh(format!("cell {number}: {what}")));
    };
    let arms: Vec<[f64; 2]> = vertices[1..].iter().map(|v| (v - vertices[0]).into()).collect();
    let bent = |[x, y]: [f64; 2]| [[0.5 * x * x, x, 0.0], [x * y, y, x], [0.5 * y * y, 0.0, y]];
    let error = |shape: usize| {
        let dofs = DVector::from_iterator(N - 3, arms.iter().flat_map(|&arm| bent(arm)[shape]));
        ((&root * dofs).norm_squared() / energies[shape] - 1.0).abs()
    };
    if (0..3).map(error).fold(0.0, |a: f64, b| if a > b { a } else { b }) <= LOST {
        // The transpose, column by column, is the root row by row.
        return Ok(Rc::new(Bending { arms, root: root.transpose().as_slice().into() }));
    }
    Err(Error::Mesh(format!(
        "cell {number} is too flat: its stiffness is lost to rounding; its vertices are {}",
        list(vertices)
    )))
}
