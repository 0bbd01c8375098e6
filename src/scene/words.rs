//! The words of every enum, as a scene writes them.

use super::typed::Choice;
use super::{Diagonal, Edge, ElementKind, EngineName, Mass, Massless, Side, SupportKind, ViName};
use std::fmt;

/// The name of a time scheme, before its parameters are known.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum SchemeName {
    Newmark,
    Midpoint,
    Conserving,
    Exact,
}

impl Choice for ElementKind {
    const WORDS: &'static [(&'static str, Self)] = &[("hct", Self::Hct), ("fvs", Self::Fvs)];
}

impl Choice for Diagonal {
    const WORDS: &'static [(&'static str, Self)] =
        &[("right", Self::Right), ("left", Self::Left), ("alternating", Self::Alternating)];
}

impl Choice for Edge {
    const WORDS: &'static [(&'static str, Self)] =
        &[("left", Self::Left), ("right", Self::Right), ("bottom", Self::Bottom), ("top", Self::Top)];
}

impl Choice for SupportKind {
    const WORDS: &'static [(&'static str, Self)] =
        &[("clamped", Self::Clamped), ("simply_supported", Self::SimplySupported), ("guided", Self::Guided)];
}

impl Choice for Side {
    const WORDS: &'static [(&'static str, Self)] = &[("below", Self::Below), ("above", Self::Above)];
}

impl Choice for SchemeName {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("newmark", Self::Newmark),
        ("midpoint", Self::Midpoint),
        ("conserving", Self::Conserving),
        ("exact", Self::Exact),
    ];
}

impl Choice for Mass {
    const WORDS: &'static [(&'static str, Self)] =
        &[("singular", Self::Singular), ("consistent", Self::Consistent)];
}

impl Choice for Massless {
    const WORDS: &'static [(&'static str, Self)] =
        &[("equilibrium", Self::Equilibrium), ("reflected", Self::Reflected)];
}

impl Choice for EngineName {
    const WORDS: &'static [(&'static str, Self)] = &[("native", Self::Native), ("petsc", Self::Petsc)];
}

impl Choice for ViName {
    const WORDS: &'static [(&'static str, Self)] =
        &[("condensed", Self::Condensed), ("snes", Self::Snes), ("tao", Self::Tao)];
}

impl fmt::Display for EngineName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.word())
    }
}

impl fmt::Display for ViName {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(self.word())
    }
}
