//! Table `[damping]`: losses of the plate.

use super::document::{Document, Value};
use super::entry::{Kind, object, table};
use super::kinds::{not_negative, shortest};
use serde_json::json;

table! {
    /// Damping of the plate.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Damping {
        /// Rayleigh coefficient alpha, for a force -alpha M V; every scheme.
        mass: f64 = not_negative("a rate", "1/s").says("1/s, Rayleigh's alpha").or(0.0);
        /// Rayleigh coefficient beta, for a force -beta K V; `newmark` and `midpoint`, with the
        /// modal mass every scheme.
        stiffness: f64 = not_negative("a time", "s").says("s, Rayleigh's beta").or(0.0);
        /// Damping ratios of the lowest modes, in ascending order of frequency and without rigid
        /// motions; `newmark` and `midpoint`, with the modal mass every scheme. One number with the
        /// modal mass: the ratio of all its modes.
        modal: ModalRatios = ratios().says("damping ratios of the first modes")
            .or_silent(ModalRatios::Lowest(vec![]));
    }
}

/// Damping ratios of natural modes.
#[derive(Debug, Clone, PartialEq)]
pub enum ModalRatios {
    /// Ratios of the lowest modes; the others are not damped.
    Lowest(Vec<f64>),
    /// Ratio of all modes.
    All(f64),
}

impl ModalRatios {
    /// Returns whether no mode is damped.
    pub fn is_none(&self) -> bool {
        match self {
            ModalRatios::Lowest(ratios) => ratios.is_empty(),
            ModalRatios::All(ratio) => *ratio == 0.0,
        }
    }

    /// Returns the ratios of the lowest modes, for all of `count` modes where they have one ratio.
    pub fn of_modes(&self, count: usize) -> Vec<f64> {
        match self {
            ModalRatios::Lowest(ratios) => ratios.clone(),
            ModalRatios::All(ratio) => vec![*ratio; count],
        }
    }
}

/// Damping ratio of all modes, or an array of the ratios of the lowest ones.
fn ratios() -> Kind<ModalRatios> {
    let one = move || not_negative("a damping ratio", "");
    let list = move || {
        one().array("expected an array of the damping ratios of the first modes, or one for all modes")
    };
    let read = move |doc: &Document, key: &str| match doc.value(key) {
        Some(Value::Integer(_) | Value::Float(_)) => Ok(ModalRatios::All(doc.required(key, &one())?)),
        _ => Ok(ModalRatios::Lowest(doc.required(key, &list())?)),
    };
    let schema = move || object([("anyOf", json!([(one().schema)(), (list().schema)()]))]);
    let write = move |ratios: &ModalRatios, by_path: bool| match ratios {
        ModalRatios::Lowest(ratios) => (list().write)(ratios, by_path),
        ModalRatios::All(ratio) => shortest(*ratio),
    };
    Kind::new("expected damping ratios", schema, read, write)
}
