//! Material and thickness of a plate, and the element matrices that follow from them.
//!
//! The elastic energy of a deflection u, in m, is `$a(u, u)/2$` with, over the mid-plane,
//!
//! ```math
//! a(u, w) = \int D \left[(1 - \nu) \sum_{a,b \in \{x,y\}} u_{ab} w_{ab}
//!           + \nu \, \Delta u \, \Delta w \right].
//! ```
//!
//! Entry `i` of a vector and row `i` of a matrix belong to dof `i` of the cell: a force, in N, for
//! a deflection, and a couple, in N m, for a slope.

use nalgebra::{DMatrix, Matrix2, Matrix3, SMatrix, SVector};

use crate::element::Element;
use crate::element::quadrature::{self, Node, Rule};
use crate::error::Result;
use crate::mesh::Point;

/// Bending stiffness and mass per area of the plate at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Section {
    /// Symmetric matrix that maps curvatures `(u_xx, u_xy, u_yy)` to the moments per length that do
    /// work with them, in N m. Its middle row includes the twist of both `u_xy` and `u_yx`.
    pub bending: Matrix3<f64>,
    /// Mass per unit area, in kg/m^2.
    pub density: f64,
    /// Thickness, in m.
    pub thickness: f64,
    /// Coefficient of thermal expansion, in 1/K.
    pub expansion: f64,
}

/// Sections of a plate, cell by cell.
pub trait Sections {
    /// Returns the number of a cell's uniform section, which cells of the same number share; `None`
    /// where the section varies inside the cell.
    fn kind(&self, cell: usize) -> Option<usize>;

    /// Returns the number of the part of the plate to which a cell belongs. Thickness and material
    /// may jump between parts.
    fn part(&self, cell: usize) -> usize {
        let _ = cell;
        0
    }

    /// Returns the section at a point of a cell.
    ///
    /// # Errors
    /// Returns [`crate::Error::Scene`] where a formula has no valid value.
    fn section(&self, cell: usize, point: Point) -> Result<Section>;

    /// Returns the quadrature rules for the pieces of a cell whose section varies, where the rule
    /// of degree 6 does not suffice.
    fn rules(&self, cell: usize) -> Option<&[Vec<Node>]> {
        let _ = cell;
        None
    }
}

/// Orthotropic stiffness along two axes in the plane of the plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orthotropy {
    /// Young's modulus E_2 across the grain, in Pa. [`Plate::youngs_modulus`] is E_1 along it, and
    /// [`Plate::poissons_ratio`] is nu_12.
    pub across: f64,
    /// Shear modulus G_12, in Pa.
    pub shear_modulus: f64,
    /// Angle of the grain from the x axis, counter-clockwise, in degrees.
    pub grain: f64,
}

/// Homogeneous Kirchhoff-Love plate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plate {
    /// Thickness h, in m.
    pub thickness: f64,
    /// Young's modulus E, in Pa.
    pub youngs_modulus: f64,
    /// Poisson's ratio nu, dimensionless.
    pub poissons_ratio: f64,
    /// Density rho, in kg/m^3.
    pub density: f64,
    /// Orthotropic constants; `None` for an isotropic plate.
    pub orthotropy: Option<Orthotropy>,
    /// Coefficient of thermal expansion alpha, in 1/K.
    pub expansion: f64,
}

impl Plate {
    /// Creates an isotropic plate from its thickness in m, Young's modulus in Pa, Poisson's ratio,
    /// and density in kg/m^3.
    pub const fn isotropic(thickness: f64, youngs_modulus: f64, poissons_ratio: f64, density: f64) -> Plate {
        Plate { thickness, youngs_modulus, poissons_ratio, density, orthotropy: None, expansion: 0.0 }
    }

    /// Returns the bending rigidity `$D = E h^3 / (12 (1 - \nu^2))$`, for an orthotropic plate the
    /// one along the grain, in N m.
    pub fn rigidity(&self) -> f64 {
        let coupled = match self.orthotropy {
            None => self.poissons_ratio.powi(2),
            Some(Orthotropy { across, .. }) => self.poissons_ratio.powi(2) * across / self.youngs_modulus,
        };
        self.youngs_modulus * self.thickness.powi(3) / (12.0 * (1.0 - coupled))
    }

    /// Returns the mass per unit area, rho h, in kg/m^2.
    pub fn surface_density(&self) -> f64 {
        self.density * self.thickness
    }

    /// Returns the section of the plate.
    ///
    /// The orthotropic stiffness follows S. G. Lekhnitskii, *Anisotropic Plates*, 1968, chapter 9.
    /// A rotation by the angle of the grain turns the curvatures along x and y into those along and
    /// across the grain.
    pub fn section(&self) -> Section {
        let nu = self.poissons_ratio;
        let bending = match self.orthotropy {
            None => Matrix3::new(1.0, 0.0, nu, 0.0, 2.0 * (1.0 - nu), 0.0, nu, 0.0, 1.0) * self.rigidity(),
            Some(Orthotropy { across, shear_modulus, grain }) => {
                let along = self.rigidity();
                let other = along * across / self.youngs_modulus;
                let twist = shear_modulus * self.thickness.powi(3) / 3.0;
                let along_grain =
                    Matrix3::new(along, 0.0, nu * other, 0.0, twist, 0.0, nu * other, 0.0, other);
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
                turn.tr_mul(&(along_grain * turn))
            }
        };
        let Plate { thickness, expansion, .. } = *self;
        Section { bending, density: self.surface_density(), thickness, expansion }
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
    /// Returns the stiffness of a cell with this uniform section, exact up to rounding; see
    /// [`stiffness`].
    pub fn stiffness<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        stiffness(element, &quadrature::DEGREE_2, |_| *self)
    }

    /// Returns the consistent mass of a cell with this uniform section, exact up to rounding, in kg
    /// between deflections; see [`mass`].
    pub fn consistent_mass<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        mass(element, |_| self.density)
    }
}

/// Returns the stiffness of a cell, the bilinear form `a` on its basis functions, N x N and
/// symmetric to the bit, in N/m between deflections.
///
/// The rule gives the points of each piece at which `section` is evaluated; degree 2 suffices for a
/// uniform section.
pub fn stiffness<'r, const N: usize>(
    element: &Element<N>,
    rule: impl Into<Rule<'r>>,
    section: impl Fn(Point) -> Section,
) -> SMatrix<f64, N, N> {
    let rule = rule.into();
    let mut stiffness = SMatrix::zeros();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let bending = section(place).bending;
        let curvature = piece.basis(barycentric).hessian;
        stiffness += curvature.tr_mul(&(bending * (weight * piece.area()) * curvature));
    }
    (stiffness + stiffness.transpose()) / 2.0
}

/// Returns the root R of a cell's stiffness, upper triangular, (N - 3) x (N - 3), over the dofs d
/// of the nodes after the first. `None` where a section is not positive definite.
///
/// The square |R d|^2 is `d . K d` where the dofs of the first node are zero; this determines K,
/// which vanishes on rigid motions. R follows from the strains at the points of the rule by
/// Householder reflections. In a cell of aspect ratio a, rounding then causes a relative error of
/// a^2 roundings in the energy of a bent shape; the entries of K, which are squares, lose a^4.
pub fn stiffness_root<'r, const N: usize>(
    element: &Element<N>,
    rule: impl Into<Rule<'r>>,
    section: impl Fn(Point) -> Section,
) -> Option<DMatrix<f64>> {
    let rule = rule.into();
    let points: usize = (0..element.pieces.len()).map(|piece| rule.of(piece).len()).sum();
    let mut strains = DMatrix::zeros(3 * points, N - 3);
    let mut row = 0;
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let bending = section(place).bending * (weight * piece.area());
        let strain = bending.cholesky()?.l().tr_mul(&piece.basis(barycentric).hessian);
        strains.rows_mut(row, 3).copy_from(&strain.columns(3, N - 3));
        row += 3;
    }
    Some(strains.qr().r())
}

/// Returns the form `$\int d\,\phi_i\phi_j$` of a density d over the cell, N x N and symmetric
/// to the bit. It is exact up to rounding for a uniform density.
///
/// A mass per area, in kg/m^2, gives the consistent mass, in kg between deflections; a foundation's
/// stiffness per area, in N/m^3, gives its stiffness, in N/m between deflections.
pub fn mass<const N: usize>(element: &Element<N>, density: impl Fn(Point) -> f64) -> SMatrix<f64, N, N> {
    mass_by(element, (&quadrature::DEGREE_6).into(), density)
}

/// Returns the form of a density like [`mass`], by another quadrature rule.
pub fn mass_by<const N: usize>(
    element: &Element<N>,
    rule: Rule,
    density: impl Fn(Point) -> f64,
) -> SMatrix<f64, N, N> {
    let mut mass = SMatrix::zeros();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let area = piece.area() * density(place);
        let value = piece.values(barycentric);
        mass += value * (value * (weight * area)).transpose();
    }
    (mass + mass.transpose()) / 2.0
}

/// Returns the geometric stiffness `$\int N_{ab}\, \partial_a \phi_i\, \partial_b \phi_j$` of a
/// membrane force (N/m) over the cell, N x N and symmetric to the bit, in N/m between deflections.
pub fn geometric_stiffness<const N: usize>(
    element: &Element<N>,
    rule: Rule,
    force: impl Fn(Point) -> Matrix2<f64>,
) -> SMatrix<f64, N, N> {
    let mut geometric = SMatrix::zeros();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let force = force(place) * (weight * piece.area());
        let gradient = piece.basis(barycentric).gradient;
        geometric += gradient.tr_mul(&(force * gradient));
    }
    (geometric + geometric.transpose()) / 2.0
}

/// Returns the integrals `$\int \phi_i$` of the basis functions over the cell, N entries, exact up
/// to rounding, in m^2 for deflections.
///
/// Times a uniform pressure, they are its load. Times a surface density, they couple the cell's
/// constant velocity to its deflection in the singular mass.
pub fn moments<const N: usize>(element: &Element<N>) -> SVector<f64, N> {
    let mut moments = SVector::zeros();
    for (piece, _, barycentric, weight) in element.nodes((&quadrature::DEGREE_3).into()) {
        moments += piece.values(barycentric) * (weight * piece.area());
    }
    moments
}

/// Returns the load `$\int p\,\phi_i$` of an upward pressure p, in Pa, on the cell, N entries, in
/// N for deflections.
///
/// It is exact up to rounding for a pressure of degree 3.
pub fn load<const N: usize>(element: &Element<N>, pressure: impl Fn(Point) -> f64) -> SVector<f64, N> {
    load_by(element, (&quadrature::DEGREE_6).into(), pressure)
}

/// Returns the load of a pressure like [`load`], by another quadrature rule.
pub fn load_by<const N: usize>(
    element: &Element<N>,
    rule: Rule,
    pressure: impl Fn(Point) -> f64,
) -> SVector<f64, N> {
    let mut load = SVector::zeros();
    for (piece, place, barycentric, weight) in element.nodes(rule) {
        let force = pressure(place) * weight * piece.area();
        load += piece.values(barycentric) * force;
    }
    load
}
