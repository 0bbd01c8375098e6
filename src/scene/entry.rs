//! Rows of a scene's tables: each key is stated once.
//!
//! A [`table!`] lists the fields of a struct, each with its documentation and an [`Entry`]. From
//! one such row follow the field, its reading with all messages, its line in a resolved scene, its
//! part of the JSON schema, and its line in `docs/scenes.md`.

#![allow(clippy::type_complexity)]

use super::document::{self, Document, Node, join};
use crate::error::{Result, cut, suggestion};
use serde_json::{Map, Value, json};
use std::rc::Rc;

/// Part of a JSON schema.
pub(super) type Schema = Map<String, Value>;

/// Key as editors and pages see it.
#[derive(Clone)]
pub(super) struct DescribedKey {
    pub name: &'static str,
    pub is_needed: bool,
    schema: Schema,
}

/// Keys of a table.
#[derive(Default)]
pub(super) struct Keys {
    pub keys: Vec<DescribedKey>,
    /// Sets of keys of which exactly one must be given; empty where all keys are independent.
    pub one_of: &'static [&'static [&'static str]],
}

impl Keys {
    /// Adds a key with its meaning and its schema.
    pub fn add(&mut self, name: &'static str, help: &str, is_needed: bool, keywords: Schema) {
        let mut schema = object([("description", help.trim_start().into())]);
        schema.extend(keywords);
        self.keys.push(DescribedKey { name, is_needed, schema });
    }

    /// Adds the keys of a struct.
    pub fn include(&mut self, other: &Keys) {
        self.keys.extend(other.keys.iter().cloned());
        if !other.one_of.is_empty() {
            self.one_of = other.one_of;
        }
    }

    /// Returns the names of all keys in their order.
    pub fn names(&self) -> Vec<&'static str> {
        self.keys.iter().map(|key| key.name).collect()
    }

    /// Returns the schema of the table.
    pub fn schema(&self) -> Schema {
        let properties = self.keys.iter().map(|key| (key.name.to_owned(), key.schema.clone().into()));
        let mut schema = object([("type", json!("object"))]);
        schema.insert("properties".into(), Value::Object(properties.collect()));
        schema.insert("additionalProperties".into(), false.into());
        let needed: Vec<&str> = self.keys.iter().filter(|key| key.is_needed).map(|key| key.name).collect();
        if !needed.is_empty() {
            schema.insert("required".into(), json!(needed));
        }
        if !self.one_of.is_empty() {
            let choices: Vec<Value> = self.one_of.iter().map(|keys| json!({ "required": keys })).collect();
            schema.insert("oneOf".into(), choices.into());
        }
        schema
    }
}

/// Collects keywords of a schema.
pub(super) fn object<const N: usize>(entries: [(&str, Value); N]) -> Schema {
    entries.into_iter().map(|(keyword, value)| (keyword.to_owned(), value)).collect()
}

/// Limits of a number, by keywords of a JSON schema.
pub(super) type Range = &'static [(&'static str, f64)];

/// Kind of value that a key takes.
pub(super) struct Kind<V> {
    /// Expected value in words, for messages.
    pub expected: String,
    pub unit: &'static str,
    /// Comment behind the value in a resolved scene.
    pub comment: String,
    pub range: Range,
    /// Keywords of a schema.
    pub schema: Box<dyn Fn() -> Schema>,
    /// Reads the value of a key that is present.
    pub read: Box<dyn Fn(&Document, &str) -> Result<V>>,
    /// Writes a value in TOML, with files by the path where they were found, or as written.
    pub write: Box<dyn Fn(&V, bool) -> String>,
}

impl<V: Clone + PartialEq + 'static> Kind<V> {
    /// Creates a kind without unit and comment.
    pub fn new(
        expected: impl Into<String>,
        schema: impl Fn() -> Schema + 'static,
        read: impl Fn(&Document, &str) -> Result<V> + 'static,
        write: impl Fn(&V, bool) -> String + 'static,
    ) -> Kind<V> {
        let (schema, read, write) = (Box::new(schema), Box::new(read), Box::new(write));
        let (expected, comment) = (expected.into(), String::new());
        Kind { expected, unit: "", comment, range: &[], schema, read, write }
    }

    /// Replaces the comment in a resolved scene.
    pub fn says(self, comment: impl Into<String>) -> Kind<V> {
        Kind { comment: comment.into(), ..self }
    }

    /// Makes the key one that may be absent.
    pub fn optional(self) -> Entry<Option<V>> {
        self.entry("", |kind, doc, key| doc.optional(key, kind), Option::as_ref)
    }

    /// Gives an absent key a value.
    pub fn or(self, default: V) -> Entry<V> {
        let presence = format!("default {}", (self.write)(&default, false));
        let read = move |kind: &Kind<V>, doc: &Document, key: &str| {
            Ok(doc.optional(key, kind)?.unwrap_or_else(|| default.clone()))
        };
        self.entry(presence, read, always)
    }

    /// Gives an absent key a value that a resolved scene does not mention.
    pub fn or_silent(self, default: V) -> Entry<V> {
        let usual = default.clone();
        let entry = self.or(default);
        let write = move |name: &str, value: &V, lines: &mut SceneText| {
            if *value != usual {
                (entry.write)(name, value, lines);
            }
        };
        Entry { write: Box::new(write), ..entry }
    }

    /// Gives an absent key a value that follows from other keys.
    pub fn or_else(self, default: impl Fn(&Document) -> Result<V> + 'static) -> Entry<V> {
        let read = move |kind: &Kind<V>, doc: &Document, key: &str| {
            doc.optional(key, kind)?.map_or_else(|| default(doc), Ok)
        };
        self.entry("", read, always)
    }

    /// Returns the entry of a key, given its presence in words (needed, a default, or nothing), its
    /// reader, and the value that it shows.
    pub fn entry<W: 'static>(
        self,
        presence: impl Into<String>,
        read: impl Fn(&Kind<V>, &Document, &str) -> Result<W> + 'static,
        shown: impl Fn(&W) -> Option<&V> + 'static,
    ) -> Entry<W> {
        let (kind, presence) = (Rc::new(self), presence.into());
        let (reader, writer) = (Rc::clone(&kind), Rc::clone(&kind));
        Entry::new(
            move |name, help, keys| {
                let is_needed = presence == NEEDED;
                let heads = [kind.unit, if is_needed { "" } else { &presence }];
                let head = heads.into_iter().filter(|head| !head.is_empty()).collect::<Vec<_>>().join("; ");
                let head = if head.is_empty() { head } else { format!("[{head}]") };
                keys.add(name, &(head + help), is_needed, (kind.schema)());
            },
            move |doc, table, name| read(&reader, doc, &join(table, name)),
            move |name, value, lines| {
                if let Some(value) = shown(value) {
                    lines.row(name, (writer.write)(value, lines.by_path), &writer.comment);
                }
            },
        )
    }
}

/// Shows any value.
fn always<V>(value: &V) -> Option<&V> {
    Some(value)
}

impl Document<'_> {
    /// Refuses unknown keys in a table; an absent table passes.
    pub fn allow(&self, table: &str, keys: &Keys) -> Result<()> {
        let Some(node) = self.get(table) else { return Ok(()) };
        let Node { value: document::Value::Table(entries), .. } = node else {
            return Err(self.unfit(table, Some(&node.value), "expected a table"));
        };
        let names = keys.names();
        let unknown = entries.iter().filter(|(key, _)| !names.contains(&key.as_str()));
        let Some((key, (place, _))) = unknown.min_by_key(|(_, (place, _))| *place) else { return Ok(()) };
        let hint = suggestion(key, &names);
        let wrong = format!("unknown key; expected one of {}{hint}", names.join(", "));
        Err(self.fault_at(*place, &join(table, &cut(key)), wrong))
    }

    /// Reads a key that must be present.
    pub fn required<V>(&self, key: &str, kind: &Kind<V>) -> Result<V> {
        self.optional(key, kind)?.ok_or_else(|| self.missing(key, &kind.expected))
    }

    /// Reads a key that may be absent.
    pub fn optional<V>(&self, key: &str, kind: &Kind<V>) -> Result<Option<V>> {
        self.get(key).map(|_| (kind.read)(self, key)).transpose()
    }
}

/// Row of a table: a key, or several keys that give one value.
pub(super) struct Entry<V> {
    /// Adds the keys, given a name and a meaning for a single one.
    pub describe: Box<dyn Fn(&'static str, &str, &mut Keys)>,
    /// Reads the value from a table, given the name of a single key.
    pub read: Box<dyn Fn(&Document, &str, &str) -> Result<V>>,
    pub write: Box<dyn Fn(&str, &V, &mut SceneText)>,
}

impl<V> Entry<V> {
    pub fn new(
        describe: impl Fn(&'static str, &str, &mut Keys) + 'static,
        read: impl Fn(&Document, &str, &str) -> Result<V> + 'static,
        write: impl Fn(&str, &V, &mut SceneText) + 'static,
    ) -> Entry<V> {
        Entry { describe: Box::new(describe), read: Box::new(read), write: Box::new(write) }
    }
}

/// Presence of a key that cannot be absent.
const NEEDED: &str = "needed";

/// Key that must be present.
impl<V: Clone + PartialEq + 'static> From<Kind<V>> for Entry<V> {
    fn from(kind: Kind<V>) -> Entry<V> {
        kind.entry(NEEDED, |kind, doc, key| doc.required(key, kind), always)
    }
}

/// Table of a scene.
pub(super) trait Table: Sized {
    fn keys() -> &'static Keys;

    /// Reads the fields of a table at its full key.
    fn read(doc: &Document, table: &str) -> Result<Self>;

    fn write(&self, lines: &mut SceneText);
}

/// Reads a table, and refuses unknown keys.
pub(super) fn read<T: Table>(doc: &Document, table: &str) -> Result<T> {
    doc.allow(table, T::keys())?;
    T::read(doc, table)
}

/// Returns the entry of a table `[name]`.
pub(super) fn section<T: Table>() -> Entry<T> {
    let is_needed = |keys: &Keys| !keys.one_of.is_empty() || keys.keys.iter().any(|key| key.is_needed);
    Entry::new(
        move |name, help, keys| keys.add(name, help, is_needed(T::keys()), T::keys().schema()),
        |doc, table, name| read(doc, &join(table, name)),
        |name, value: &T, lines| lines.table(name, ["[", "]"], |lines| value.write(lines)),
    )
}

/// Returns the entry of a table `[name]` that may be absent.
pub(super) fn if_given<T: Table>() -> Entry<Option<T>> {
    Entry::new(
        |name, help, keys| keys.add(name, help, false, T::keys().schema()),
        |doc, table, name| {
            let key = join(table, name);
            doc.get(&key).map(|_| read(doc, &key)).transpose()
        },
        |name, value: &Option<T>, lines| value.iter().for_each(|value| (section().write)(name, value, lines)),
    )
}

/// Returns the entry of tables `[[key]]` that each need some keys, in words.
pub(super) fn tables<T: Table>(key: &'static str, with: &'static str) -> Entry<Vec<T>> {
    Entry::new(
        move |_, help, keys| {
            let items = T::keys().schema().into();
            keys.add(key, help, false, object([("type", json!("array")), ("items", items)]));
        },
        move |doc, table, _| {
            let name = join(table, key);
            let count = doc.entries(&name, &format!("expected tables [[{name}]] with {with}"))?;
            (0..count).map(|index| read(doc, &format!("{name}.{index}"))).collect()
        },
        move |_, tables: &Vec<T>, lines| {
            tables.iter().for_each(|table| lines.table(key, ["[[", "]]"], |lines| table.write(lines)));
        },
    )
}

/// Returns the entry of a struct whose keys stand in the table around it.
pub(super) fn flat<T: Table + Clone + 'static>() -> Entry<T> {
    via(|value: T, _, _| Ok(value), T::clone)
}

/// Returns the entry of a value that is read and written by way of a struct of keys.
pub(super) fn via<T: Table + 'static, V: 'static>(
    read: fn(T, &Document, &str) -> Result<V>,
    write: fn(&V) -> T,
) -> Entry<V> {
    Entry::new(
        |_, _, keys| keys.include(T::keys()),
        move |doc, table, _| read(T::read(doc, table)?, doc, table),
        move |_, value, lines| write(value).write(lines),
    )
}

/// Returns the entry of a struct whose keys stand in the table around it; the first key is needed
/// for the others.
pub(super) fn flat_if<T: Table>() -> Entry<Option<T>> {
    Entry::new(
        |_, _, keys| {
            keys.include(T::keys());
            keys.keys.iter_mut().for_each(|key| key.is_needed &= key.name != T::keys().names()[0]);
        },
        |doc, table, _| {
            let names = T::keys().names();
            let first = join(table, names[0]);
            if doc.get(&first).is_some() {
                return T::read(doc, table).map(Some);
            }
            for name in &names[1..] {
                doc.forbid(&join(table, name), format!("has no use without {first}"))?;
            }
            Ok(None)
        },
        |_, value, lines| value.iter().for_each(|value: &T| value.write(lines)),
    )
}

/// Text of a table in TOML: its rows, then the tables within it.
pub(super) struct SceneText {
    /// Whether files have the path where they were found, rather than the name as written.
    pub by_path: bool,
    /// Full key of the table.
    path: String,
    rows: Vec<[String; 3]>,
    within: String,
}

impl SceneText {
    /// Creates the text of the whole scene.
    pub fn new(by_path: bool) -> SceneText {
        SceneText { by_path, path: String::new(), rows: Vec::new(), within: String::new() }
    }

    /// Adds a row: key, value, comment.
    pub fn row(&mut self, key: &str, value: String, comment: &str) {
        self.rows.push([key.to_owned(), value, comment.to_owned()]);
    }

    /// Adds text behind all rows.
    pub fn behind(&mut self, text: &str) {
        self.within += text;
    }

    /// Adds a table, whose header stands between brackets.
    pub fn table(&mut self, name: &str, [open, close]: [&str; 2], write: impl FnOnce(&mut SceneText)) {
        let mut table = SceneText { path: join(&self.path, name), ..SceneText::new(self.by_path) };
        write(&mut table);
        self.within += &format!("\n{open}{}{close}\n{}", table.path, table.text());
    }

    /// Replaces the comment of a row.
    pub fn says(&mut self, key: &str, comment: &str) {
        self.rows.iter_mut().filter(|[other, ..]| other == key).for_each(|row| row[2] = comment.to_owned());
    }

    /// Takes a row out again.
    pub fn omit(&mut self, key: &str) {
        self.rows.retain(|[other, ..]| other != key);
    }

    /// Returns the rows as an inline table.
    pub fn inline(&self) -> String {
        let rows: Vec<String> = self.rows.iter().map(|[key, value, _]| format!("{key} = {value}")).collect();
        format!("{{ {} }}", rows.join(", "))
    }

    /// Returns the text, with aligned equal signs and comments.
    pub fn text(&self) -> String {
        let width = |column: usize| self.rows.iter().map(|row| row[column].len()).max().unwrap_or(0);
        let (key_width, value_width) = (width(0), width(1));
        let mut text = String::new();
        for [key, value, comment] in &self.rows {
            let hash = if comment.is_empty() { "" } else { "  # " };
            let row = format!("{key:key_width$} = {value:value_width$}{hash}{comment}");
            text += row.trim_end();
            text += "\n";
        }
        text + &self.within
    }
}

/// Declares a table of a scene: a struct whose fields have the entries of their keys.
///
/// The first field of a row names its key, unless `as "..."` does; `[...]` behind a field is an
/// attribute. Behind the struct, `one_of` lists alternatives, `then` names a function that checks
/// or completes what was read, and `omit` one that names the keys that a resolved scene omits.
macro_rules! table {
    ($(#[$meta:meta])* $vis:vis struct $name:ident {
        $($(
            $(#[doc = $help:literal])+
            $field:ident $([$attribute:meta])? $(as $key:literal)?: $type:ty
        ),+ = $entry:expr;)+
    } $(one_of $({$($one:ident),+})+)? $(then $finish:ident)? $(omit $omitted:ident)?) => {
        $(#[$meta])*
        $vis struct $name {
            $($($(#[doc = $help])+
                #[doc = concat!("\n\nRow: `", stringify!($entry), "`")]
                $(#[$attribute])?
                pub $field: $type,)+)+
        }

        #[allow(unused_parens)]
        impl crate::scene::entry::Table for $name {
            fn keys() -> &'static crate::scene::entry::Keys {
                static KEYS: std::sync::LazyLock<crate::scene::entry::Keys> = std::sync::LazyLock::new(|| {
                    let mut keys = crate::scene::entry::Keys::default();
                    $({
                        let entry: crate::scene::entry::Entry<($($type),+)> = ($entry).into();
                        let names = [$(crate::scene::entry::key_name!($field $($key)?)),+];
                        (entry.describe)(names[0], [$(concat!($($help),+)),+][0], &mut keys);
                    })+
                    $(keys.one_of = &[$(&[$(stringify!($one)),+]),+];)?
                    keys
                });
                &KEYS
            }

            fn read(doc: &crate::scene::document::Document, table: &str) -> crate::error::Result<Self> {
                $(
                    let entry: crate::scene::entry::Entry<($($type),+)> = ($entry).into();
                    let names = [$(crate::scene::entry::key_name!($field $($key)?)),+];
                    let ($($field),+) = (entry.read)(doc, table, names[0])?;
                )+
                let value = $name { $($($field),+),+ };
                $(let value = $finish(value, doc, table)?;)?
                Ok(value)
            }

            fn write(&self, lines: &mut crate::scene::entry::SceneText) {
                $(
                    let entry: crate::scene::entry::Entry<($($type),+)> = ($entry).into();
                    let names = [$(crate::scene::entry::key_name!($field $($key)?)),+];
                    (entry.write)(names[0], &($(self.$field.clone()),+), lines);
                )+
                $($omitted(self).into_iter().for_each(|key| lines.omit(key));)?
            }
        }
    };
}

/// Returns the key of a field.
macro_rules! key_name {
    ($field:ident) => {
        stringify!($field)
    };
    ($field:ident $key:literal) => {
        $key
    };
}

pub(super) use {key_name, table};
