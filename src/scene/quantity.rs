//! Quantities that a probe can record.

use super::words::Choice;
use crate::stress::PlateSurface;
use PlateSurface::{Bottom, Top};

/// Quantity that a probe records.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ProbeQuantity {
    /// Deflection, in m.
    #[default]
    Deflection,
    /// Velocity, in m/s.
    Velocity,
    /// Mean acceleration over the last step, in m/s2.
    Acceleration,
    /// Derivative of the deflection along x.
    SlopeX,
    /// Derivative of the deflection along y.
    SlopeY,
    /// Bending moment, in N m/m.
    Moment(StressComponent),
    /// Membrane force, in N/m.
    Membrane(StressComponent),
    /// Stress at a surface, in Pa.
    Stress(StressComponent, PlateSurface),
    /// Von Mises stress at a surface, in Pa.
    VonMises(PlateSurface),
    /// Moment of the friction of an obstacle on the slope along x (0) or y (1) of a node, in N m.
    FrictionMoment(usize),
    /// Velocity of the face of the plate relative to an obstacle with friction, along x (0) or y
    /// (1), in m/s.
    SlipVelocity(usize),
}

impl ProbeQuantity {
    /// Returns whether the quantity follows from the second derivatives of the deflection.
    pub fn is_of_curvature(self) -> bool {
        matches!(self, Self::Moment(_) | Self::Stress(..) | Self::VonMises(_))
    }

    /// Returns whether the quantity belongs to the friction of an obstacle.
    pub fn is_of_friction(self) -> bool {
        matches!(self, Self::FrictionMoment(_) | Self::SlipVelocity(_))
    }

    /// Quantities that a ball has too.
    pub(super) const OF_BALLS: [ProbeQuantity; 3] = [Self::Deflection, Self::Velocity, Self::Acceleration];

    /// Returns the name in a scene.
    pub fn name(self) -> &'static str {
        self.word()
    }

    /// Returns the name and the unit on the axis of a figure.
    pub const fn axis(self) -> (&'static str, &'static str) {
        match self {
            Self::Deflection => ("deflection", "m"),
            Self::Velocity => ("velocity", "m/s"),
            Self::Acceleration => ("acceleration", "m/s2"),
            Self::SlopeX | Self::SlopeY => ("slope", ""),
            Self::Moment(_) => ("moment", "N m/m"),
            Self::Membrane(_) => ("membrane force", "N/m"),
            Self::Stress(..) | Self::VonMises(_) => ("stress", "Pa"),
            Self::FrictionMoment(_) => ("moment of friction", "N m"),
            Self::SlipVelocity(_) => ("slip velocity", "m/s"),
        }
    }

    /// Returns the quantity with a name in a scene.
    pub fn named(name: &str) -> Option<ProbeQuantity> {
        Self::WORDS.iter().find(|(word, _)| *word == name).map(|(_, quantity)| *quantity)
    }
}

/// Component of moments or of stresses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StressComponent {
    /// Component xx.
    Xx,
    /// Component yy.
    Yy,
    /// Component xy.
    Xy,
    /// Largest principal value.
    Max,
    /// Least principal value.
    Min,
}

use StressComponent::{Max, Min, Xx, Xy, Yy};

impl Choice for ProbeQuantity {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("deflection", Self::Deflection),
        ("velocity", Self::Velocity),
        ("acceleration", Self::Acceleration),
        ("slope_x", Self::SlopeX),
        ("slope_y", Self::SlopeY),
        ("moment_xx", Self::Moment(Xx)),
        ("moment_yy", Self::Moment(Yy)),
        ("moment_xy", Self::Moment(Xy)),
        ("moment_max", Self::Moment(Max)),
        ("moment_min", Self::Moment(Min)),
        ("membrane_xx", Self::Membrane(Xx)),
        ("membrane_yy", Self::Membrane(Yy)),
        ("membrane_xy", Self::Membrane(Xy)),
        ("stress_xx_top", Self::Stress(Xx, Top)),
        ("stress_yy_top", Self::Stress(Yy, Top)),
        ("stress_xy_top", Self::Stress(Xy, Top)),
        ("stress_max_top", Self::Stress(Max, Top)),
        ("stress_min_top", Self::Stress(Min, Top)),
        ("stress_xx_bottom", Self::Stress(Xx, Bottom)),
        ("stress_yy_bottom", Self::Stress(Yy, Bottom)),
        ("stress_xy_bottom", Self::Stress(Xy, Bottom)),
        ("stress_max_bottom", Self::Stress(Max, Bottom)),
        ("stress_min_bottom", Self::Stress(Min, Bottom)),
        ("von_mises_top", Self::VonMises(Top)),
        ("von_mises_bottom", Self::VonMises(Bottom)),
        ("friction_moment_x", Self::FrictionMoment(0)),
        ("friction_moment_y", Self::FrictionMoment(1)),
        ("slip_velocity_x", Self::SlipVelocity(0)),
        ("slip_velocity_y", Self::SlipVelocity(1)),
    ];
}
