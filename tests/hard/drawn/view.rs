//! Ways to write a scene down, and what they do to the columns of its history.

/// Way to write a scene down, whose motion must be the same but for signs and units.
#[derive(Clone, Copy)]
pub(super) struct View {
    pub mirrored: bool,
    pub turned: bool,
    pub upside_down: bool,
    /// Units of length, time and mass: one SI unit has this many of them.
    pub units: [f64; 3],
    /// Whether attachments are written as two halves, conditions that always hold are added, tables
    /// come in another order, and numbers as formulas of a parameter.
    pub rewritten: bool,
    /// Factor of the elastic moduli, which tells how much rounding may matter.
    pub nudge: f64,
}

pub(super) const PLAIN: View = View {
    mirrored: false,
    turned: false,
    upside_down: false,
    units: [1.0; 3],
    rewritten: false,
    nudge: 1.0,
};

pub(super) const VIEWS: [(&str, View); 5] = [
    ("mirrored", View { mirrored: true, ..PLAIN }),
    ("turned", View { turned: true, ..PLAIN }),
    ("upside down", View { upside_down: true, ..PLAIN }),
    // Powers of two round alike, so that only an absolute threshold can make a difference.
    ("in other units", View { units: [1024.0, 0.125, 65536.0], ..PLAIN }),
    ("written otherwise", View { rewritten: true, ..PLAIN }),
];

/// Factors of lengths, forces, pressures and other quantities in the units of a view.
pub(super) struct Factors {
    pub length: f64,
    pub time: f64,
    pub mass: f64,
    pub force: f64,
    pub pressure: f64,
    pub sign: f64,
}

impl View {
    pub fn factors(&self) -> Factors {
        let [length, time, mass] = self.units;
        let sign = if self.upside_down { -1.0 } else { 1.0 };
        let (force, pressure) = (mass * length / time / time, mass / length / time / time);
        Factors { length, time, mass, force, pressure, sign }
    }

    /// Returns how many units a column of the history has for one in SI units, if it is compared.
    pub fn column(&self, name: &str) -> Option<(f64, Group)> {
        let Factors { length, time, force, sign, .. } = self.factors();
        match name {
            "energy" | "kinetic" | "elastic" | "work" => Some((force * length, Group::Energy)),
            "ball" => Some((sign * length, Group::Deflection)),
            "contact_force" => Some((sign * force, Group::Force)),
            _ if name.starts_with("point") => Some((sign * length, Group::Deflection)),
            _ if name.starts_with("force_") => Some((sign * force, Group::Force)),
            _ if name.starts_with("impulse_") => Some((sign * force * time, Group::Impulse)),
            _ => None,
        }
    }
}

/// Kind of a column; differences are relative to the largest value of all columns of the kind.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(super) enum Group {
    Deflection,
    Energy,
    Impulse,
    Force,
}

impl Group {
    /// Tolerance on relative differences: forces show rounding divided by the square of the step.
    pub fn tolerance(self) -> f64 {
        match self {
            Group::Deflection => 1e-6,
            Group::Energy => 1e-5,
            Group::Impulse => 3e-5,
            Group::Force => 3e-4,
        }
    }
}
