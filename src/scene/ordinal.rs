//! Entries of lists of tables, counted and named as people do.

use super::Scene;
use serde_json::Value;

/// Returns how people call an entry of a list of tables: `support 2 ("bolt")`.
pub(crate) fn ordinal(table: &str, index: usize, name: Option<&str>) -> String {
    format!("{table} {}", counted(index, name))
}

fn counted(index: usize, name: Option<&str>) -> String {
    let name = name.map_or(String::new(), |name| format!(" ({name:?})"));
    format!("{}{name}", index + 1)
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

    /// Joins messages that are equal but for the entry or probe that they begin with, such as
    /// `support 1 and 2 ("bolt"): at: ...`, and completes the others by [`Self::with_ordinal`].
    pub(crate) fn joined(&self, messages: &[String]) -> Vec<String> {
        let resolved = serde_json::to_value(self).unwrap_or_default();
        let mut groups: Vec<(&String, Vec<String>)> = Vec::new();
        for message in messages {
            let (around, label) = parts(message, &resolved).unzip();
            let is_like = |first| around.is_some() && parts(first, &resolved).unzip().0 == around;
            match groups.iter_mut().find(|(first, _)| is_like(first)) {
                Some((_, labels)) => labels.extend(label),
                None => groups.push((message, Vec::from_iter(label))),
            }
        }
        let words =
            |(first, labels): (&String, Vec<String>)| match (parts(first, &resolved), labels.split_last()) {
                (Some(([kind, rest], _)), Some((last, others))) if !others.is_empty() => {
                    format!("{kind} {} and {last}: {rest}", others.join(", "))
                }
                _ => self.with_ordinal(first.clone()),
            };
        groups.into_iter().map(words).collect()
    }
}

/// Returns the words around the name of the entry or probe that a message begins with, and that
/// name, as people say it.
fn parts<'m>(message: &'m str, scene: &Value) -> Option<([&'m str; 2], String)> {
    if let Some((name, rest)) = message.strip_prefix("probe ").and_then(|words| words.split_once(": ")) {
        return Some((["probe", rest], name.to_owned()));
    }
    let (table, words) = message.split_once('.')?;
    let (index, rest) = words.split_once('.')?;
    let index: usize = index.parse().ok()?;
    Some(([table, rest], counted(index, scene[table][index]["name"].as_str())))
}
