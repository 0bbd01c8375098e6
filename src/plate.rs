//! Material and thickness, and the matrices they give an element.
//!
//! With `u` the deflection (m), the plate's elastic energy is `a(u, u) / 2` with, over its mid-plane,
//!
//! `a(u, w) = ∫ D [(1 - nu) u_ab w_ab + nu (lap u)(lap w)]`, summed over `a, b` in `x, y`.
//!
//! Entry `i` of a vector and row `i` of a matrix belong to dof `i` of the cell: force (N) for a deflection, couple (N m)
//! for a slope.

use nalgebra::{DMatrix, Matrix3, SMatrix, SVector};

use crate::element::Element;
use crate::element::quadrature::{self, Node, Rule};
use crate::error::Result;
use crate::mesh::Point;

/// What a plate is at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Moments per length that curvatures `(u_xx, u_xy, u_yy)` do work with, in N m; symmetric. Its middle row counts the twist
    /// for `u_xy` and `u_yx`.
    pub bending: Matrix3<f64>,
    /// Mass of a unit of area, in kg/m2.
    pub density: f64,
}

/// The sections of a plate, cell by cell.
pub trait Sections {
    /// Cells of one number share one uniform section; `None` where it changes inside the cell.
    fn kind(&self, cell: usize) -> Option<usize>;

    /// The section at a point of a cell.
    ///
    /// # Errors
    /// [`crate::Error::Scene`] where a formula has no sense there.
    fn section(&self, cell: usize, at: Point) -> Result<Section>;

    /// The rules for the pieces of a cell whose section changes inside it, where that of degree 6 does not do.
    fn rules(&self, cell: usize) -> Option<&[Vec<Node>]> {
        let _ = cell;
        None
    }
}

/// Stiffness along two axes in the plate's plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orthotropy {
    /// Young's modulus across the grain, E_2, in Pa; [`Plate::youngs_modulus`] is E_1 along it, [`Plate::poissons_ratio`] nu_12.
    pub across: f64,
    /// Shear modulus G_12, in Pa.
    pub shear_modulus: f64,
    /// Angle of the grain from x, counter-clockwise, in degrees.
    pub grain: f64,
}

/// A homogeneous Kirchhoff-Love plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// Thickness h, in m.
    pub thickness: f64,
    /// Young's modulus E, in Pa.
    pub youngs_modulus: f64,
    /// Poisson's ratio nu, dimensionless.
    pub poissons_ratio: f64,
    /// Density rho, in kg/m3.
    pub density: f64,
    /// `None`: isotropic.
    pub orthotropy: Option<Orthotropy>,
}

impl Plate {
    /// An isotropic plate: thickness in m, Young's modulus in Pa, Poisson's ratio, density in kg/m3.
    pub const fn isotropic(thickness: f64, youngs_modulus: f64, poissons_ratio: f64, density: f64) -> Plate {
        Plate { thickness, youngs_modulus, poissons_ratio, density, orthotropy: None }
    }

    /// The bending rigidity D = E h^3 / (12 (1 - nu^2)), in N m; of an orthotropic plate that along the grain.
    pub fn rigidity(&self) -> f64 {
        let coupled = match self.orthotropy {
            None => self.poissons_ratio.powi(2),
            Some(Orthotropy { across, .. }) => self.poissons_ratio.powi(2) * across / self.youngs_modulus,
        };
        self.youngs_modulus * self.thickness.powi(3) / (12.0 * (1.0 - coupled))
    }

    /// The mass of a unit of area, rho h, in kg/m2.
    pub fn surface_density(&self) -> f64 {
        self.density * self.thickness
    }

    /// The section.
    ///
    /// Orthotropic: S. G. Lekhnitskii, *Anisotropic Plates*, 1968, chapter 9; a rotation by the angle of the grain makes
    /// the curvatures along and across it of those along x and y.
    pub fn section(&self) -> Section {
        let nu = self.poissons_ratio;
        let bending = match self.orthotropy {
            None => Matrix3::new(1.0, 0.0, nu, 0.0, 2.0 * (1.0 - nu), 0.0, nu, 0.0, 1.0) * self.rigidity(),
            Some(Orthotropy { across, shear_modulus, grain }) => {
                let along = self.rigidity();
                let other = along * across / self.youngs_modulus;
                let twist = shear_modulus * self.thickness.powi(3) / 3.0;
                let own = Matrix3::new(along, 0.0, nu * other, 0.0, twist, 0.0, nu * other, 0.0, other);
                let (s, c) = grain.to_radians().sin_cos();
                let turn = Matrix3::new(
                    c * c,
                    2.0 * s * c,
                    s * s,
                    -s * c,
                    c * c - s * s,
                    s * c,
                    s * s,
                    -2.0 * s * c,
                    c * c,
                );
                turn.tr_mul(&(own * turn))
            }
        };
        Section { bending, density: self.surface_density() }
    }
}

impl Sections for Plate {
    fn kind(&self, _: usize) -> Option<usize> {
        Some(0)
    }

    fn section(&self, _: usize, _: Point) -> Result<Section> {
        Ok(Plate::section(self))
    }
}

impl Section {
    /// The stiffness of a cell of this section; see [`stiffness`]. Exact up to rounding.
    pub fn stiffness<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        stiffness(element, &quadrature::DEGREE_2, |_| *self)
    }

    /// The consistent mass of a cell of this section, in kg between deflections; see [`mass`]. Exact up to rounding.
    pub fn consistent_mass<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        mass(element, |_| self.density)
    }
}

/// The stiffness of a cell: the bilinear form `a` on its basis functions, N by N, symmetric to the bit.
///
/// In N/m between deflections. The rule gives the points of each piece at which `section` is asked: degree 2 will do for a uniform one.
pub fn stiffness<'r, const N: usize>(
    element: &Element<N>,
    rule: impl Into<Rule<'r>>,
    section: impl Fn(Point) -> Section,
) -> SMatrix<f64, N, N> {
    let rule = rule.into();
    let mut stiffness = SMatrix::zeros();
    for (number, piece) in element.pieces.iter().enumerate() {
        let area = piece.area();
        for &(barycentric, weight) in rule.of(number) {
            let bending = section(element.point(number, barycentric)).bending;
            let curvature = piece.basis(barycentric).hessian;
            stiffness += curvature.tr_mul(&(bending * (weight * area) * curvature));
        }
    }
    (stiffness + stiffness.transpose()) / 2.0
}

/// The root of the stiffness of a cell: R, upper triangular, (N - 3) x (N - 3), over the dofs d of the nodes after the first. |R d|^2 is
/// `d . K d` where the first node's are zero, which fixes K, for it vanishes on rigid motions.
///
/// R comes from the strains at the points of the rule by Householder's reflections. In a cell of aspect ratio a rounding then takes a^2
/// roundings of the energy of a bent shape; the entries of K, squares, lose a^4. `None` where a section is not positive definite.
pub fn stiffness_root<'r, const N: usize>(
    element: &Element<N>,
    rule: impl Into<Rule<'r>>,
    section: impl Fn(Point) -> Section,
) -> Option<DMatrix<f64>> {
    let rule = rule.into();
    let points: usize = (0..element.pieces.len()).map(|piece| rule.of(piece).len()).sum();
    let mut strains = DMatrix::zeros(3 * points, N - 3);
    let mut row = 0;
    for (number, piece) in element.pieces.iter().enumerate() {
        for &(barycentric, weight) in rule.of(number) {
            let bending = section(element.point(number, barycentric)).bending * (weight * piece.area());
            let strain = bending.cholesky()?.l().tr_mul(&piece.basis(barycentric).hessian);
            strains.rows_mut(row, 3).copy_from(&strain.columns(3, N - 3));
            row += 3;
        }
    }
    Some(strains.qr().r())
}

/// The form of a density d over the cell, `∫ d phi_i phi_j`, N by N, symmetric to the bit: of a mass per area the consistent mass; of
/// a foundation's stiffness per area (N/m3) its stiffness, in N/m between deflections. Exact up to rounding for a uniform density.
pub fn mass<const N: usize>(element: &Element<N>, density: impl Fn(Point) -> f64) -> SMatrix<f64, N, N> {
    mass_by(element, (&quadrature::DEGREE_6).into(), density)
}

/// As [`mass`], by other rules.
pub fn mass_by<const N: usize>(
    element: &Element<N>,
    rule: Rule,
    density: impl Fn(Point) -> f64,
) -> SMatrix<f64, N, N> {
    let mut mass = SMatrix::zeros();
    for (number, piece) in element.pieces.iter().enumerate() {
        for &(barycentric, weight) in rule.of(number) {
            let area = piece.area() * density(element.point(number, barycentric));
            let value = piece.values(barycentric);
            mass += value * (value * (weight * area)).transpose();
        }
    }
    (mass + mass.transpose()) / 2.0
}

/// The integrals of the basis functions over the cell, `∫ phi_i`, N entries; exact up to rounding.
///
/// In m2 for deflections. Times a uniform pressure they are its load; times a surface density they couple the cell's velocity, a
/// constant, to its deflection in the singular mass.
pub fn moments<const N: usize>(element: &Element<N>) -> SVector<f64, N> {
    let mut moments = SVector::zeros();
    for piece in &element.pieces {
        for (barycentric, weight) in quadrature::DEGREE_3 {
            moments += piece.values(barycentric) * (weight * piece.area());
        }
    }
    moments
}

/// The load of a pressure on the cell, `∫ pressure phi_i`, N entries, in N for deflections.
///
/// The pressure is in Pa, upward positive. Exact up to rounding for a pressure of degree 3.
pub fn load<const N: usize>(element: &Element<N>, pressure: impl Fn(Point) -> f64) -> SVector<f64, N> {
    load_by(element, (&quadrature::DEGREE_6).into(), pressure)
}

/// As [`load`], by other rules.
pub fn load_by<const N: usize>(
    element: &Element<N>,
    rule: Rule,
    pressure: impl Fn(Point) -> f64,
) -> SVector<f64, N> {
    let mut load = SVector::zeros();
    for (number, piece) in element.pieces.iter().enumerate() {
        for &(barycentric, weight) in rule.of(number) {
            let force = pressure(element.point(number, barycentric)) * weight * piece.area();
            load += piece.values(barycentric) * force;
        }
    }
    load
}
