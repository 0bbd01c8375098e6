//! Bending moments of a plate and the stresses at its surfaces.
//!
//! With z upward from the mid-plane, like the deflection w, the moments per unit length are
//!
//! ```math
//! M_{ab} = \int_{-h/2}^{h/2} z \, \sigma_{ab} \, dz, \qquad
//! M_{xx} = -D (w_{xx} + \nu w_{yy}), \quad
//! M_{yy} = -D (w_{yy} + \nu w_{xx}), \quad
//! M_{xy} = -D (1 - \nu) w_{xy},
//! ```
//!
//! for an isotropic plate. A positive moment puts the upper surface in tension. The stresses are
//! linear across the thickness, with `$\sigma_{ab} = 6 M_{ab} / h^2$` at the upper surface and the
//! opposite at the lower one.
//!
//! Forces N in the plane add `$N_{ab} / h$` at both surfaces.
//!
//! Source: S. P. Timoshenko and S. Woinowsky-Krieger, *Theory of Plates and Shells*, 1959, chapter
//! 4, where z, deflection and load point downward together. Its moments are those above for loads
//! that point upward.

use crate::plate::Section;
use nalgebra::{Matrix3, Vector3};

/// Surface of the plate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PlateSurface {
    /// Upper surface, z = h/2.
    Top,
    /// Lower surface, z = -h/2.
    Bottom,
}

impl PlateSurface {
    /// Returns the sign of z at the surface.
    pub const fn sign(self) -> f64 {
        match self {
            PlateSurface::Top => 1.0,
            PlateSurface::Bottom => -1.0,
        }
    }

    /// Returns the surface at which the principal stress of larger magnitude is tensile, given the
    /// sum of the normal stresses at the upper surface and the von Mises stress: the upper one
    /// where both are alike up to rounding.
    pub fn in_tension(trace: f64, von_mises: f64) -> PlateSurface {
        if trace < -1e-9 * von_mises { PlateSurface::Bottom } else { PlateSurface::Top }
    }
}

/// Bending moments per unit length at a point, in N m/m; stresses have the same components, in Pa.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// Moment of the stresses along x, M_xx.
    pub xx: f64,
    /// Moment of the stresses along y, M_yy.
    pub yy: f64,
    /// Twisting moment M_xy.
    pub xy: f64,
}

impl Moments {
    /// Returns the moments of the curvatures (w_xx, w_xy, w_yy), in 1/m, at a point with a section.
    pub fn of_curvature(section: &Section, curvature: [f64; 3]) -> Moments {
        let [xx, yy, xy] = (section.moment_per_curvature() * Vector3::from(curvature)).into();
        Moments { xx, yy, xy }
    }

    /// Returns the stresses at a surface (Pa), given stresses by bending at the upper surface and
    /// those of the mid-plane.
    pub fn at(self, surface: PlateSurface, middle: Moments) -> Moments {
        let sign = surface.sign();
        Moments {
            xx: sign * self.xx + middle.xx,
            yy: sign * self.yy + middle.yy,
            xy: sign * self.xy + middle.xy,
        }
    }

    /// Returns the sum with other moments.
    pub fn plus(self, other: Moments) -> Moments {
        Moments { xx: self.xx + other.xx, yy: self.yy + other.yy, xy: self.xy + other.xy }
    }

    /// Returns the moments times a factor.
    pub fn times(self, factor: f64) -> Moments {
        Moments { xx: factor * self.xx, yy: factor * self.yy, xy: factor * self.xy }
    }

    /// Returns the surface with the larger von Mises stress and that stress (Pa), given stresses by
    /// bending at the upper surface and those of the mid-plane; the upper one where both are alike.
    pub fn larger(self, middle: Moments) -> (PlateSurface, f64) {
        let [top, bottom] =
            [PlateSurface::Top, PlateSurface::Bottom].map(|surface| self.at(surface, middle).von_mises());
        if bottom > top { (PlateSurface::Bottom, bottom) } else { (PlateSurface::Top, top) }
    }

    /// Returns the largest and the least moment over all directions.
    pub fn principal(&self) -> [f64; 2] {
        let (mean, radius) = (0.5 * (self.xx + self.yy), (0.5 * (self.xx - self.yy)).hypot(self.xy));
        [mean + radius, mean - radius]
    }

    /// Returns the moment whose stress is the von Mises stress, which is the same at both surfaces:
    /// `$\sqrt{M_{xx}^2 - M_{xx} M_{yy} + M_{yy}^2 + 3 M_{xy}^2}$`.
    pub fn von_mises(&self) -> f64 {
        self.von_mises_square().sqrt()
    }

    /// Returns the square of [`Moments::von_mises`].
    #[inline]
    pub fn von_mises_square(&self) -> f64 {
        let Moments { xx, yy, xy } = *self;
        // This form is a sum of squares, which rounding cannot make negative.
        0.25 * (xx + yy).powi(2) + 0.75 * (xx - yy).powi(2) + 3.0 * xy * xy
    }
}

impl Section {
    /// Returns the moments M_xx, M_yy and M_xy per curvature w_xx, w_xy and w_yy, in N m.
    pub fn moment_per_curvature(&self) -> Matrix3<f64> {
        let [xx, xy, yy] = [0, 1, 2].map(|row| self.bending.row(row));
        Matrix3::from_rows(&[-xx, -yy, -0.5 * xy])
    }

    /// Returns the stress at the upper surface per moment, 6/h^2, in 1/m^2.
    pub fn stress_per_moment(&self) -> f64 {
        6.0 / self.thickness.powi(2)
    }
}
