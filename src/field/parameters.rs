//! Parameters: numbers with names of their own, which formulas may use.

/// Named numbers that formulas use like constants.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Parameters(Vec<(String, f64)>);

impl Parameters {
    /// No parameters.
    pub const NONE: &'static Parameters = &Parameters(Vec::new());

    /// Adds a parameter, or replaces its value. The name must be one that
    /// [`check_parameter`](super::check_parameter) accepts; formulas read any other differently.
    pub fn set(&mut self, name: &str, value: f64) {
        match self.0.iter_mut().find(|(known, _)| known == name) {
            Some((_, known)) => *known = value,
            None => self.0.push((name.to_owned(), value)),
        }
    }

    /// Returns the value of a parameter, if there is one of this name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.iter().find(|(known, _)| *known == name).map(|(_, value)| value)
    }

    /// Returns names and values, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
        self.0.iter().map(|(name, value)| (name.as_str(), *value))
    }

    /// Returns the names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.iter().map(|(name, _)| name)
    }
}
