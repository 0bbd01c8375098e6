//! Parameters: numbers with names of their own, which formulas may use.

use std::collections::BTreeMap;

/// Named numbers that formulas use like constants.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters(BTreeMap<String, f64>);

impl Parameters {
    /// No parameters.
    pub const NONE: &'static Parameters = &Parameters(BTreeMap::new());

    /// Adds a parameter, or replaces its value. The name must be one that
    /// [`check_parameter`](super::check_parameter) accepts; formulas read any other differently.
    pub fn set(&mut self, name: &str, value: f64) {
        self.0.insert(name.to_owned(), value);
    }

    /// Returns the value of a parameter, if there is one of this name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// Returns names and values, in alphabetical order.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_str(), *value))
    }

    /// Returns the names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.iter().map(|(name, _)| name)
    }
}
