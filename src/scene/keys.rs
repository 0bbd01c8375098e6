//! Keys of the tables of a scene: their names, the values that they take, and their meaning.
//!
//! Each file of `read` declares the keys of its table. The reader refuses all others, and the JSON
//! schema for editors lists the same ones.

use crate::field::Names;

/// Physical quantity: its name with unit, and the range of its values.
pub(super) struct Quantity {
    pub what: &'static str,
    pub range: Range,
}

/// Range of a number.
pub(super) struct Range {
    pub limits: &'static str,
    pub fault: &'static str,
    pub holds: fn(f64) -> bool,
    /// Limits by the keywords of a JSON schema.
    pub keywords: &'static [(&'static str, f64)],
}

impl Range {
    pub const ANY: Range = Range::new("", "", |_| true, &[]);
    pub const POSITIVE: Range =
        Range::new(" greater than 0", "is not positive", |value| value > 0.0, &[("exclusiveMinimum", 0.0)]);
    pub const NOT_NEGATIVE: Range =
        Range::new(" of at least 0", "is negative", |value| value >= 0.0, &[("minimum", 0.0)]);

    /// Creates a range; `limits` completes the expectation and `fault` describes a violation.
    pub const fn new(
        limits: &'static str,
        fault: &'static str,
        holds: fn(f64) -> bool,
        keywords: &'static [(&'static str, f64)],
    ) -> Self {
        Range { limits, fault, holds, keywords }
    }
}

impl Quantity {
    pub const fn new(what: &'static str, range: Range) -> Self {
        Quantity { what, range }
    }

    pub fn expected(&self) -> String {
        format!("expected {}{}", self.what, self.range.limits)
    }
}

/// Enum whose variants have names in a scene.
pub(super) trait Choice: Copy + PartialEq + 'static {
    /// All variants with their words.
    const WORDS: &'static [(&'static str, Self)];

    /// Returns the word of this variant.
    fn word(self) -> &'static str {
        Self::WORDS.iter().find(|(_, case)| *case == self).map_or("", |(word, _)| word)
    }
}

/// Table: its keys, in groups, and which of them it needs.
pub(super) struct TableKeys {
    pub groups: &'static [&'static [TableKey]],
    /// Keys that cannot be absent.
    pub needed: &'static [&'static str],
    /// Sets of keys of which exactly one must be given; empty where all keys are independent.
    pub one_of: &'static [&'static [&'static str]],
}

/// Key of a table.
pub(super) struct TableKey {
    pub name: &'static str,
    pub value: ValueKind,
    /// Meaning in one line, with the unit.
    pub meaning: &'static str,
}

/// Values that a key takes.
pub(super) enum ValueKind {
    Text,
    Truth,
    Number(&'static Quantity),
    /// Number, formula of these variables, or table of time where time is one of them.
    Field(&'static Quantity, Names),
    /// Condition on x and y.
    Condition,
    /// Whole number of at least this one.
    Count(u32),
    /// One of some words.
    Word(fn() -> Vec<&'static str>),
    /// Array of any number of values.
    Array(&'static ValueKind),
    /// Array of at least one value, all different.
    List(&'static ValueKind),
    /// Array of two values.
    Pair(&'static ValueKind),
    Table(&'static TableKeys),
    /// Array of tables.
    Tables(&'static TableKeys),
    /// Table of numbers with names of their own.
    Names(&'static Quantity),
}

/// Declares a key.
pub(super) const fn key(name: &'static str, value: ValueKind, meaning: &'static str) -> TableKey {
    TableKey { name, value, meaning }
}

/// Returns the words of an enum.
pub(super) fn words<T: Choice>() -> Vec<&'static str> {
    T::WORDS.iter().map(|(word, _)| *word).collect()
}

impl TableKeys {
    /// Declares a table whose keys may all be absent.
    pub const fn optional(groups: &'static [&'static [TableKey]]) -> TableKeys {
        TableKeys { groups, needed: &[], one_of: &[] }
    }

    /// Returns all keys in their order.
    pub fn keys(&self) -> impl Iterator<Item = &'static TableKey> {
        self.groups.iter().copied().flatten()
    }

    /// Returns the names of all keys in their order.
    pub fn names(&self) -> Vec<&'static str> {
        self.keys().map(|key| key.name).collect()
    }
}
