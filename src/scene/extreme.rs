//! Numbers of a scene that are far from the size of all others.

use super::Scene;
use super::document::join;
use crate::error::Error;
use serde_json::Value;

/// Magnitude, or its inverse, beyond which an error names a number of the scene.
const FAR: f64 = 1e15;

impl Scene {
    /// Adds the number of the scene that is farthest from 1, if one is far, to an error of its
    /// model that names no key. Rounding and overflow are then the cause.
    pub(crate) fn explain(&self, error: Error) -> Error {
        let error = match error {
            Error::Scene(words) => Error::Scene(self.with_ordinal(words)),
            Error::Mesh(words) => Error::Mesh(self.with_ordinal(words)),
            other => other,
        };
        let resolved = serde_json::to_value(self).unwrap_or_default();
        let Some((key, number)) = farthest(&resolved, "") else { return error };
        let far = format!("; {key} is {number:e}, far from the usual");
        let more = |words: String| if words.contains(&key) { words } else { words + &far };
        match error {
            Error::Singular(words) => Error::Singular(more(words)),
            Error::Mesh(words) => Error::Mesh(more(words)),
            other => other,
        }
    }
}

/// Returns key and value of the number farthest from 1, if one is far.
fn farthest(value: &Value, key: &str) -> Option<(String, f64)> {
    let distance = |number: f64| number.abs().ln().abs();
    let longer = |a: &(String, f64), b: &(String, f64)| distance(a.1).total_cmp(&distance(b.1));
    match value {
        Value::Number(number) => {
            let number = number.as_f64().filter(|number| *number != 0.0)?;
            (distance(number) > FAR.ln()).then(|| (key.to_owned(), number))
        }
        Value::Array(items) => {
            let items = items.iter().enumerate();
            items.filter_map(|(i, item)| farthest(item, &join(key, &i.to_string()))).max_by(longer)
        }
        Value::Object(entries) => {
            entries.iter().filter_map(|(name, entry)| farthest(entry, &join(key, name))).max_by(longer)
        }
        _ => None,
    }
}
