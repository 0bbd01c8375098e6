//! Entries of lists of tables, counted and named as people do.

use super::Scene;

/// Returns how people call an entry of a list of tables: `support 2 ("bolt")`.
pub(crate) fn ordinal(table: &str, index: usize, name: Option<&str>) -> String {
    let name = name.map_or(String::new(), |name| format!(" ({name:?})"));
    format!("{table} {}{name}", index + 1)
}

impl Scene {
    /// Adds to a message that begins with a key such as `support.1.at` how people call that entry,
    /// unless it has no name and is the only one of its table.
    pub(crate) fn with_ordinal(&self, message: String) -> String {
        let mut words = message.split('.');
        let (Some(table), Some(Ok(index))) = (words.next(), words.next().map(str::parse::<usize>)) else {
            return message;
        };
        let resolved = serde_json::to_value(self).unwrap_or_default();
        let entries = resolved[table].as_array().map_or(&[][..], Vec::as_slice);
        let name = entries.get(index).and_then(|entry| entry["name"].as_str());
        let is_clear = index >= entries.len() || entries.len() == 1 && name.is_none();
        if is_clear { message } else { format!("{message}; this is {}", ordinal(table, index, name)) }
    }
}
