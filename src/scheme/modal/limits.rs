//! Limits of the bounded deflections.

/// Deflections of bounded dofs from the loads alone, and their bounds.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct Limits {
    /// Deflections by the response to the loads, in m.
    pub shift: Vec<f64>,
    /// Bounds, in m, relative to the supports.
    pub lower: Vec<f64>,
    pub upper: Vec<f64>,
}

impl Limits {
    /// Returns the entries of some bounds.
    pub fn select(&self, which: &[usize]) -> Limits {
        let each = |values: &[f64]| which.iter().map(|&i| values[i]).collect();
        Limits { shift: each(&self.shift), lower: each(&self.lower), upper: each(&self.upper) }
    }

    /// Sets the entries to the differences of two instants; absent obstacles stay.
    pub fn difference(&mut self, from: &Limits, to: &Limits) {
        let each = |difference: &mut Vec<f64>, from: &[f64], to: &[f64]| {
            difference.clear();
            difference.extend(from.iter().zip(to).map(|(a, b)| if a.is_finite() { b - a } else { 0.0 }));
        };
        each(&mut self.shift, &from.shift, &to.shift);
        each(&mut self.lower, &from.lower, &to.lower);
        each(&mut self.upper, &from.upper, &to.upper);
    }

    /// Sets the entries to those at the fraction `share` of the way from one instant to another.
    pub fn between(&mut self, from: &Limits, to: &Limits, share: f64) {
        mix(&mut self.shift, &from.shift, &to.shift, share);
        mix(&mut self.lower, &from.lower, &to.lower, share);
        mix(&mut self.upper, &from.upper, &to.upper, share);
    }
}

/// Sets values to those at the fraction `share` of the way from one instant to another.
pub(crate) fn mix(mixed: &mut [f64], from: &[f64], to: &[f64], share: f64) {
    for (mixed, (from, to)) in mixed.iter_mut().zip(from.iter().zip(to)) {
        // Absent obstacles have infinite bounds.
        *mixed = if from.is_finite() { from + share * (to - from) } else { *from };
    }
}
