//! Words by which a scene names the variants of every enum.

use super::typed::Choice;
use super::{
    ContactSolver, Diagonal, ElementKind, EngineName, Horizon, LinearSolver, Mass, Massless, SchemeName,
    Side, StopLaw, SupportKind, SweepOrder,
};
use crate::field::Interpolation;
use std::fmt;

impl Choice for Diagonal {
    const WORDS: &'static [(&'static str, Self)] =
        &[("right", Self::Right), ("left", Self::Left), ("alternating", Self::Alternating)];
}

impl Choice for Interpolation {
    const WORDS: &'static [(&'static str, Self)] = &[("linear", Self::Linear), ("spline", Self::Spline)];
}

impl Choice for SupportKind {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("clamped", Self::Clamped),
        ("simply_supported", Self::SimplySupported),
        ("guided", Self::Guided),
        ("elastic", Self::Elastic),
    ];
}

impl Choice for Side {
    const WORDS: &'static [(&'static str, Self)] = &[("below", Self::Below), ("above", Self::Above)];
}

impl Choice for StopLaw {
    const WORDS: &'static [(&'static str, Self)] = &[("linear", Self::Linear), ("hertz", Self::Hertz)];
}

impl Choice for Mass {
    const WORDS: &'static [(&'static str, Self)] =
        &[("singular", Self::Singular), ("consistent", Self::Consistent), ("modal", Self::Modal)];
}

impl Choice for Massless {
    const WORDS: &'static [(&'static str, Self)] =
        &[("equilibrium", Self::Equilibrium), ("reflected", Self::Reflected)];
}

impl Choice for EngineName {
    const WORDS: &'static [(&'static str, Self)] = &[("native", Self::Native), ("petsc", Self::Petsc)];
}

impl Choice for LinearSolver {
    const WORDS: &'static [(&'static str, Self)] =
        &[("auto", Self::Auto), ("direct", Self::Direct), ("multigrid", Self::Multigrid)];
}

impl Choice for Horizon {
    const WORDS: &'static [(&'static str, Self)] =
        &[("first_impact", Self::FirstImpact), ("second_impact", Self::SecondImpact), ("end", Self::End)];
}

impl Choice for SweepOrder {
    const WORDS: &'static [(&'static str, Self)] =
        &[("apart", Self::Apart), ("up", Self::Up), ("down", Self::Down), ("up_and_down", Self::UpAndDown)];
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

/// Implements `Display` with the words of a scene.
macro_rules! shown_as_words {
    ($($name:ty),*) => {
        $(impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str(self.word())
            }
        })*
    };
}

shown_as_words!(ElementKind, SchemeName, Mass, EngineName, LinearSolver, ContactSolver, SweepOrder);
