//! Words by which a scene names the variants of every enum.

use super::{ContactSolver, Diagonal, ElementKind, InPlaneHold, Massless, SchemeName, SupportKind};
use crate::contact_law::StopLaw;
use crate::field::Interpolation;
use crate::random::PointSet;
use serde::{Deserialize, Serialize};
use std::fmt;

/// Enum whose variants have names in a scene.
pub(super) trait Choice: Copy + PartialEq + 'static {
    /// All variants with their words.
    const WORDS: &'static [(&'static str, Self)];

    /// Returns the word of this variant.
    fn word(self) -> &'static str {
        Self::WORDS.iter().find(|(_, case)| *case == self).map_or("", |(word, _)| word)
    }
}

/// Implements `Choice` for enums of other modules.
macro_rules! choice {
    ($($name:ty { $($case:ident = $word:literal),+ })+) => {$(
        impl Choice for $name {
            const WORDS: &'static [(&'static str, Self)] = &[$(($word, Self::$case)),+];
        }
    )+};
}

/// Implements `Display` with the words of a scene.
macro_rules! shown_as_words {
    ($($name:ty),+) => {$(
        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(self.word())
            }
        }
    )+};
}

/// Declares enums whose variants have words, which serde uses too.
macro_rules! words {
    ($($(#[$meta:meta])* pub enum $name:ident {
        $($(#[$case_meta:meta])* $case:ident = $word:literal,)+
    })+) => {
        $($(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)] pub enum $name { $($(#[$case_meta])* #[serde(rename = $word)] $case,)+ })+
        choice! { $($name { $($case = $word),+ })+ }
        shown_as_words!($($name),+);
    };
}

words! {
    /// Side of the plate.
    pub enum Side {
        /// Below the plate: the deflection stays above the obstacle's height.
        Below = "below",
        /// Above the plate: the deflection stays under the obstacle's height.
        Above = "above",
    }

    /// Axis of the plane of the plate.
    pub enum RotationAxis {
        /// Axis along x.
        X = "x",
        /// Axis along y.
        Y = "y",
    }

    /// Mass matrix.
    pub enum Mass {
        /// Singular mass, from velocities that are constant on each cell.
        Singular = "singular",
        /// Consistent mass.
        Consistent = "consistent",
        /// Singular mass of the lowest modes of the consistent mass.
        Modal = "modal",
    }

    /// Linear algebra engine; a build without it refuses it later, not the scene.
    pub enum EngineName {
        /// Engine in Rust alone, on one process.
        Native = "native",
        /// Engine of PETSc, on any number of ranks.
        Petsc = "petsc",
    }

    /// Solver of the linear systems on PETSc; the native engine factors them.
    pub enum LinearSolver {
        /// Factorisation, or multigrid where the factors would not fit into memory.
        Auto = "auto",
        /// Factorisation.
        Direct = "direct",
        /// Conjugate gradients with geometric multigrid.
        Multigrid = "multigrid",
    }

    /// Part of a run that determines its rank.
    #[derive(Default)]
    pub enum Horizon {
        /// Free motion up to the first impact.
        FirstImpact = "first_impact",
        /// Motion up to the second impact, which includes the effect of the first.
        SecondImpact = "second_impact",
        /// Whole run.
        #[default]
        End = "end",
    }

    /// Order of the values of the first key of a sweep, and start of each run.
    pub enum SweepOrder {
        /// Each run starts as the scene says.
        Apart = "apart",
        /// Each run starts where the run of the value before ended.
        Up = "up",
        /// Each run starts where the run of the value after ended.
        Down = "down",
        /// All values up, then all values down.
        UpAndDown = "up_and_down",
    }
}

choice! {
    Diagonal { Right = "right", Left = "left", Alternating = "alternating" }
    Interpolation { Linear = "linear", Spline = "spline" }
    SupportKind {
        Clamped = "clamped",
        SimplySupported = "simply_supported",
        Guided = "guided",
        Elastic = "elastic"
    }
    InPlaneHold { Held = "held", Normal = "normal", Free = "free" }
    Massless { Equilibrium = "equilibrium", Reflected = "reflected" }
    PointSet { Plain = "plain", Latin = "latin", Sobol = "sobol", Saltelli = "saltelli" }
}

/// Implements `Choice` with the names of a registry.
macro_rules! named_by_registry {
    ($name:ty, $variant:ident => $word:expr) => {
        impl Choice for $name {
            const WORDS: &'static [(&'static str, Self)] = &{
                let mut words = [("", <$name>::ALL[0]); <$name>::ALL.len()];
                let mut i = 0;
                while i < words.len() {
                    let $variant = <$name>::ALL[i];
                    words[i] = ($word, $variant);
                    i += 1;
                }
                words
            };
        }
    };
}

named_by_registry!(ElementKind, element => element.name());
named_by_registry!(SchemeName, scheme => scheme.capabilities().name);
named_by_registry!(ContactSolver, solver => solver.name());
named_by_registry!(StopLaw, law => law.spec().name);

shown_as_words!(ElementKind, SchemeName, ContactSolver, StopLaw);
