//! Material and thickness, and the matrices they give an element.
//!
//! With `u` the deflection (m), the plate's elastic energy is `a(u, u) / 2` with, over its mid-plane,
//!
//! `a(u, w) = ∫ D [(1 - nu) u_ab w_ab + nu (lap u)(lap w)]`, summed over `a, b` in `x, y`.
//!
//! Entry `i` of a vector and row `i` of a matrix belong to dof `i` of the cell: force (N) for a deflection, couple (N m)
//! for a slope.

use nalgebra::{Matrix3, SMatrix, SVector};

use crate::element::{Element, quadrature};
use crate::mesh::Point;

/// A homogeneous isotropic Kirchhoff-Love plate.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Plate {
    /// Thickness h, in m.
    pub thickness: f64,
    /// Young's modulus E, in Pa.
    pub youngs_modulus: f64,
    /// Poisson's ratio nu, dimensionless.
    pub poissons_ratio: f64,
    /// Density rho, in kg/m3.
    pub density: f64,
}

impl Plate {
    /// The bending rigidity D = E h^3 / (12 (1 - nu^2)), in N m.
    pub fn rigidity(&self) -> f64 {
        self.youngs_modulus * self.thickness.powi(3) / (12.0 * (1.0 - self.poissons_ratio.powi(2)))
    }

    /// The mass of a unit of area, rho h, in kg/m2.
    pub fn surface_density(&self) -> f64 {
        self.density * self.thickness
    }

    /// The stiffness of a cell: the bilinear form `a` on its basis functions, N by N, symmetric to the bit.
    ///
    /// In N/m between deflections; exact up to rounding.
    pub fn stiffness<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        let nu = self.poissons_ratio;
        // Rows and columns xx, xy, yy; the twist counts for u_xy and u_yx.
        let bending = Matrix3::new(1.0, 0.0, nu, 0.0, 2.0 * (1.0 - nu), 0.0, nu, 0.0, 1.0) * self.rigidity();
        let mut stiffness = SMatrix::zeros();
        for piece in &element.pieces {
            let area = piece.area();
            for (barycentric, weight) in quadrature::DEGREE_2 {
                let curvature = piece.basis(barycentric).hessian;
                stiffness += curvature.tr_mul(&(bending * (weight * area) * curvature));
            }
        }
        (stiffness + stiffness.transpose()) / 2.0
    }

    /// The consistent mass of a cell, `∫ rho h phi_i phi_j`, N by N, symmetric to the bit.
    ///
    /// In kg between deflections; exact up to rounding.
    pub fn consistent_mass<const N: usize>(&self, element: &Element<N>) -> SMatrix<f64, N, N> {
        let mut mass = SMatrix::zeros();
        for piece in &element.pieces {
            let area = piece.area() * self.surface_density();
            for (barycentric, weight) in quadrature::DEGREE_6 {
                let value = piece.values(barycentric);
                mass += value * (value * (weight * area)).transpose();
            }
        }
        (mass + mass.transpose()) / 2.0
    }

    /// The integrals of the basis functions over the cell, `∫ phi_i`, N entries; exact up to rounding.
    ///
    /// In m2 for deflections. Times a uniform pressure they are its load; times [`Plate::surface_density`] they couple
    /// the cell's velocity, a constant, to its deflection in the singular mass.
    pub fn moments<const N: usize>(&self, element: &Element<N>) -> SVector<f64, N> {
        let mut moments = SVector::zeros();
        for piece in &element.pieces {
            for (barycentric, weight) in quadrature::DEGREE_3 {
                moments += piece.values(barycentric) * (weight * piece.area());
            }
        }
        moments
    }

    /// The load of a pressure field on the cell, `∫ pressure phi_i`, N entries, in N for deflections.
    ///
    /// The pressure is in Pa, upward positive. Exact up to rounding for a pressure of degree 3.
    pub fn load<const N: usize>(
        &self,
        element: &Element<N>,
        pressure: impl Fn(Point) -> f64,
    ) -> SVector<f64, N> {
        let mut load = SVector::zeros();
        for (number, piece) in element.pieces.iter().enumerate() {
            for (barycentric, weight) in quadrature::DEGREE_6 {
                let force = pressure(element.point(number, barycentric)) * weight * piece.area();
                load += piece.values(barycentric) * force;
            }
        }
        load
    }
}
