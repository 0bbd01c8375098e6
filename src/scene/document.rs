//! Tree of a TOML text and its `--set` overrides, in which every value has its position.

use std::cell::OnceCell;
use std::collections::BTreeMap;
use std::fmt::{self, Display};
use std::path::Path;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::words::EngineName;
use crate::error::{Error, Result, cut, error_at, suggestion};
use crate::field::Parameters;
use crate::mesh::{Mesh, Point};

/// Limit on the parts of an override's key, more than any key of a scene has.
const DEEPEST_KEY: usize = 8;

/// Parsed TOML text of a scene, before its keys are read.
pub(super) struct Document<'a> {
    file: &'a str,
    text: &'a str,
    overrides: &'a [String],
    root: Node,
    /// Engine of a scene that names none.
    pub engine: EngineName,
    /// Returns the unit of a key.
    units: fn(&str) -> Option<String>,
    /// Parameters, once they are read.
    pub parameters: OnceCell<Parameters>,
    /// Named points of the mesh file, once they are read.
    pub points: OnceCell<BTreeMap<String, Vec<Point>>>,
}

/// Position at which a value was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum SourcePlace {
    /// Byte of the file.
    Byte(usize),
    /// Index of an override.
    Override(usize),
}

/// Value and the position at which it was written.
pub(super) struct Node {
    pub place: SourcePlace,
    pub value: Value,
}

/// TOML value, as far as a scene distinguishes its types.
pub(super) enum Value {
    Text(String),
    Integer(i64),
    Float(f64),
    Truth(bool),
    Array(Vec<Node>),
    /// Entries by key, each with the position of its key.
    Table(BTreeMap<String, (SourcePlace, Node)>),
    /// Name of a type that no key of a scene accepts.
    Other(&'static str),
}

impl<'a> Document<'a> {
    /// Parses the bytes of `file`, then applies the overrides in their order; `units` are those of
    /// keys, for messages.
    pub fn parse(
        bytes: &'a [u8],
        file: &'a str,
        overrides: &'a [String],
        engine: EngineName,
        units: fn(&str) -> Option<String>,
    ) -> Result<Self> {
        let unless_mesh = |error: Error| match Path::new(file).file_name() {
            Some(name) if Mesh::is_named(file) => {
                let wrong = format!("a mesh; expected a scene, which names it by mesh.file = {name:?}");
                error_at(file, &wrong)
            }
            _ => error,
        };
        let bytes = bytes.strip_prefix("\u{feff}".as_bytes()).unwrap_or(bytes);
        let text = std::str::from_utf8(bytes).map_err(|error| {
            let offset = error.valid_up_to();
            let wrong = format!("byte 0x{:02x} is not UTF-8; expected TOML text in UTF-8", bytes[offset]);
            unless_mesh(error_at(&position(file, bytes, offset), &wrong))
        })?;
        let table = DeTable::parse(text).map_err(|error| {
            let offset = error.span().map_or(text.len(), |span| span.start);
            let unit = || units(&key_before(&text[..offset]));
            unless_mesh(error_at(&position(file, bytes, offset), &syntax(&error, text, offset, unit)))
        })?;
        let root =
            Node { place: SourcePlace::Byte(0), value: Value::table(table.get_ref(), &SourcePlace::Byte) };
        let (parameters, points) = (OnceCell::new(), OnceCell::new());
        let mut document = Document { file, text, overrides, root, engine, units, parameters, points };
        for index in 0..overrides.len() {
            document.apply(index)?;
        }
        Ok(document)
    }

    /// Returns the value of a dotted key such as `obstacle.0.height`; the empty key is the whole
    /// scene.
    pub fn get(&self, key: &str) -> Option<&Node> {
        parts(key).try_fold(&self.root, |node, part| node.child(part))
    }

    /// Returns the value of a key that is present.
    pub fn value(&self, key: &str) -> Option<&Value> {
        self.get(key).map(|node| &node.value)
    }

    /// Returns a key's number as it is written, if it is one.
    pub fn figure(&self, key: &str) -> Option<f64> {
        match self.value(key)? {
            Value::Integer(integer) => Some(*integer as f64),
            Value::Float(float) => Some(*float),
            _ => None,
        }
    }

    /// Returns the name of the scene's own file without its extension.
    pub fn stem(&self) -> String {
        let stem = Path::new(self.file).file_stem().unwrap_or_default().to_string_lossy();
        stem.replace(char::is_control, " ")
    }

    /// Returns the number of entries of an array; 0 if it is absent.
    pub fn entries(&self, array: &str, expected: &str) -> Result<usize> {
        match self.value(array) {
            None => Ok(0),
            Some(Value::Array(items)) => Ok(items.len()),
            other => Err(self.unfit(array, other, expected)),
        }
    }

    /// Returns the text of a key.
    pub fn text(&self, key: &str, expected: impl Display) -> Result<&str> {
        match self.value(key) {
            Some(Value::Text(text)) => Ok(text),
            other => Err(self.unfit(key, other, expected)),
        }
    }

    /// Reads one of these words.
    pub fn one_of<'w>(&self, key: &str, words: &[&'w str]) -> Result<&'w str> {
        let list: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
        let expected = format!("expected one of {}", list.join(", "));
        let text = self.text(key, &expected)?;
        words.iter().find(|word| **word == text).copied().ok_or_else(|| {
            self.fault(key, format!("{} is not valid; {expected}{}", quote(text), suggestion(text, words)))
        })
    }

    /// Refuses a key that another key makes meaningless.
    pub fn forbid(&self, key: &str, wrong: impl Display) -> Result<()> {
        self.get(key).map_or(Ok(()), |_| Err(self.fault(key, wrong)))
    }

    /// Works as [`Document::forbid`], for a parameter of an option that was not chosen.
    ///
    /// Where an override makes the choice, parameters of the file's choice are ignored.
    pub fn forbid_with(&self, choice: &str, key: &str, wrong: impl Display) -> Result<()> {
        let is_gone = self.is_overridden(choice) && !self.is_overridden(key);
        if is_gone { Ok(()) } else { self.forbid(key, wrong) }
    }

    /// Refuses more than one of some keys of a table.
    pub fn only_one(&self, table: &str, names: &[&str]) -> Result<()> {
        let mut given = names.iter().filter(|name| self.get(&join(table, name)).is_some());
        if let (Some(first), Some(second)) = (given.next(), given.next()) {
            let wrong = format!("contradicts {table}.{second}; expected only one of {}", names.join(", "));
            return Err(self.fault(&join(table, first), wrong));
        }
        Ok(())
    }

    /// Creates the error for a missing key.
    pub fn missing(&self, key: &str, expected: impl Display) -> Error {
        self.fault(key, format!("missing; {expected}"))
    }

    /// Creates the error for a value of the wrong type, or for a missing one.
    pub fn unfit(&self, key: &str, value: Option<&Value>, expected: impl Display) -> Error {
        match value {
            None => self.missing(key, expected),
            Some(value) => self.fault(key, format!("found {value}; {expected}")),
        }
    }

    /// Resolves a file name relative to the scene's own file.
    pub fn beside(&self, file: &str) -> String {
        let folder = Path::new(self.file).parent().unwrap_or(Path::new(""));
        folder.join(file).to_string_lossy().into_owned()
    }

    /// Returns whether an override gives the value of a key.
    pub fn is_overridden(&self, key: &str) -> bool {
        self.get(key).is_some_and(|node| matches!(node.place, SourcePlace::Override(_)))
    }

    /// Creates the error for a key, in one line: its position, the key, and what is wrong.
    ///
    /// A missing key has the position of its table.
    pub fn fault(&self, key: &str, wrong: impl Display) -> Error {
        self.fault_at(self.place(key), key, wrong)
    }

    /// Returns the position of a key in words, for messages that follow once the scene is read.
    pub fn position(&self, key: &str) -> String {
        self.describe(self.place(key))
    }

    /// Returns the position of a key, or of its table if the key is missing.
    fn place(&self, key: &str) -> SourcePlace {
        let mut node = &self.root;
        for part in parts(key) {
            let Some(child) = node.child(part) else { break };
            node = child;
        }
        node.place
    }

    /// Creates the error for a key at a known position.
    pub fn fault_at(&self, place: SourcePlace, key: &str, wrong: impl Display) -> Error {
        let key: Vec<String> = parts(key).map(cut).collect();
        error_at(&self.describe(place), &format!("{}: {wrong}", key.join(".")))
    }

    fn describe(&self, place: SourcePlace) -> String {
        match place {
            SourcePlace::Byte(offset) => position(self.file, self.text.as_bytes(), offset),
            SourcePlace::Override(index) => format!("--set {}", cut(&self.overrides[index])),
        }
    }

    /// Puts the value of one override, `key=value`, into the tree.
    ///
    /// Missing tables are added, and at most one array entry.
    fn apply(&mut self, index: usize) -> Result<()> {
        let place = SourcePlace::Override(index);
        let (key, leaf) = parse_override(&self.overrides[index], place, self.units)
            .map_err(|wrong| error_at(&self.describe(place), &wrong))?;
        let mut node = &mut self.root;
        let mut rest = parts(key).peekable();
        while let Some(part) = rest.next() {
            let blank = Node::blank(place, rest.peek().copied());
            node = match node.child_or(part, blank) {
                Ok(child) => child,
                Err(wrong) => return Err(self.fault_at(place, key, wrong)),
            };
        }
        *node = leaf;
        Ok(())
    }
}

impl Node {
    /// Creates an empty array if the name of its child is a number, otherwise an empty table.
    fn blank(place: SourcePlace, child: Option<&str>) -> Self {
        let is_array = child.is_some_and(|part| part.parse::<usize>().is_ok());
        let value = if is_array { Value::Array(Vec::new()) } else { Value::Table(BTreeMap::new()) };
        Node { place, value }
    }

    fn child(&self, part: &str) -> Option<&Node> {
        match &self.value {
            Value::Table(entries) => entries.get(part).map(|(_, node)| node),
            Value::Array(items) => items.get(part.parse::<usize>().ok()?),
            _ => None,
        }
    }

    /// Returns the child of that name, and inserts `blank` if there is none.
    fn child_or(&mut self, part: &str, blank: Node) -> std::result::Result<&mut Node, String> {
        match &mut self.value {
            Value::Table(entries) => {
                Ok(&mut entries.entry(part.to_owned()).or_insert((blank.place, blank)).1)
            }
            Value::Array(items) => {
                let end = items.len();
                let wrong =
                    || format!("{part:?} is no entry; expected an index from 0 to {end}, {end} to add one");
                let index = part.parse::<usize>().ok().filter(|&index| index <= end).ok_or_else(wrong)?;
                if index == end {
                    items.push(blank);
                }
                Ok(&mut items[index])
            }
            other => Err(format!("found {other} before {part:?}; expected a table or an array")),
        }
    }

    fn new(value: &Spanned<DeValue>, place: &impl Fn(usize) -> SourcePlace) -> Self {
        Node { place: place(value.span().start), value: Value::new(value.get_ref(), place) }
    }
}

impl Value {
    fn new(value: &DeValue, place: &impl Fn(usize) -> SourcePlace) -> Self {
        match value {
            DeValue::String(text) => Value::Text(text.to_string()),
            DeValue::Integer(integer) => i64::from_str_radix(integer.as_str(), integer.radix())
                .map_or(Value::Other("an integer of more than 64 bits"), Value::Integer),
            DeValue::Float(float) => Value::Float(float.as_str().parse().unwrap_or(f64::NAN)),
            DeValue::Boolean(truth) => Value::Truth(*truth),
            DeValue::Datetime(_) => Value::Other("a date or time"),
            DeValue::Array(items) => Value::Array(items.iter().map(|item| Node::new(item, place)).collect()),
            DeValue::Table(entries) => Value::table(entries, place),
        }
    }

    fn table(entries: &DeTable, place: &impl Fn(usize) -> SourcePlace) -> Self {
        let entry = |(key, value): (&Spanned<_>, &Spanned<_>)| {
            let name: &std::borrow::Cow<str> = key.get_ref();
            (name.to_string(), (place(key.span().start), Node::new(value, place)))
        };
        Value::Table(entries.iter().map(entry).collect())
    }
}

impl Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Text(text) => write!(f, "the string {}", quote(text)),
            Value::Integer(integer) => write!(f, "the integer {integer}"),
            Value::Float(float) => write!(f, "the number {}", spell(*float)),
            Value::Truth(_) => write!(f, "a boolean"),
            Value::Array(items) => write!(f, "an array of length {}", items.len()),
            Value::Table(_) => write!(f, "a table"),
            Value::Other(name) => write!(f, "{name}"),
        }
    }
}

/// Quotes a string, shortened if it is long.
pub(super) fn quote(text: &str) -> String {
    format!("{:?}", cut(text))
}

/// Formats a number in TOML's notation.
pub(super) fn spell(number: f64) -> String {
    format!("{number:?}").to_lowercase()
}

/// Appends a name to the key of a table; the key of the whole scene is empty.
pub(super) fn join(table: &str, name: &str) -> String {
    if table.is_empty() { name.to_owned() } else { format!("{table}.{name}") }
}

/// Splits a dotted key into its parts; the empty key has none.
fn parts(key: &str) -> impl Iterator<Item = &str> {
    key.split('.').filter(|_| !key.is_empty())
}

/// Parses `key=value`. A word or a formula, which is no TOML value without quotes, counts as a
/// string.
fn parse_override(
    text: &str,
    place: SourcePlace,
    units: fn(&str) -> Option<String>,
) -> std::result::Result<(&str, Node), String> {
    let form = "expected --set key=value, such as --set time.step=1e-6";
    let (key, value) = text.split_once('=').ok_or_else(|| format!("there is no \"=\"; {form}"))?;
    let (key, value) = (key.trim(), value.trim());
    if key.split('.').any(str::is_empty) || parts(key).count() > DEEPEST_KEY {
        return Err(format!("{} is no key; {form}", quote(key)));
    }
    let parsed = DeValue::parse(value);
    if parsed.is_err()
        && let Some(second) = second_key(value)
    {
        let wrong = format!("the value goes on with another key, {}", quote(second));
        return Err(format!("{key}: {wrong}; expected one --set per key"));
    }
    let value = match parsed {
        Ok(parsed) => Value::new(parsed.get_ref(), &|_| place),
        Err(_) if value.starts_with(char::is_alphabetic) || is_like_formula(value) => {
            Value::Text(value.to_owned())
        }
        Err(error) => {
            let offset = error.span().map_or(0, |span| span.start);
            return Err(format!("{key}: {}", syntax(&error, value, offset, || units(key))));
        }
    };
    Ok((key, Node { place, value }))
}

/// Returns whether an invalid value looks like a formula.
///
/// A formula calculates, and is no list, table or string that was left open.
fn is_like_formula(value: &str) -> bool {
    value.contains(['(', '*', '^', '/']) && !value.starts_with(['[', '{', '"', '\''])
}

/// Finds a second key after a comma in an invalid value, as in `1,time.end=2`.
///
/// Comparisons in formulas do not count.
fn second_key(value: &str) -> Option<&str> {
    let is_name = |part: &str| !part.is_empty() && part.chars().all(|c| c.is_alphanumeric() || c == '_');
    value.split(',').skip(1).find_map(|piece| {
        let (key, rest) = piece.split_once('=')?;
        let key = key.trim();
        let is_key = key.starts_with(char::is_alphabetic) && key.split('.').all(is_name);
        (is_key && !rest.starts_with('=')).then_some(key)
    })
}

/// Formats an error of the TOML parser in the style of this program. It says where a number has a
/// unit, given the key's, or a comma among its digits.
fn syntax(error: &toml::de::Error, text: &str, offset: usize, unit: impl Fn() -> Option<String>) -> String {
    let message =
        error.message().replacen(", expected nothing", "", 1).replacen(", expected ", "; expected ", 1);
    let message = format!("invalid TOML: {message}");
    let Some((before, after)) = text.split_at_checked(offset) else { return message };
    let is_part = |c: char| c.is_ascii_digit() || "+-._eE".contains(c);
    let number = &text[before.trim_end_matches(is_part).len()..];
    let rest = number.trim_start_matches(is_part);
    let has_unit = rest.len() < number.len() && rest.trim_start_matches(' ').starts_with(char::is_alphabetic);
    if has_unit && let Some(unit) = unit() {
        return format!("found a number with a unit; expected the number alone, in {unit}");
    }
    let before = before.trim_end().as_bytes();
    let decimals = before.iter().rev().take_while(|byte| is_part(**byte as char)).count();
    // In a table on one line the comma after the decimals is the one that is too many, or its end.
    let is_second = decimals > 0 && ends_in_comma(&before[..before.len() - decimals]);
    let is_comma = matches!(after.as_bytes(), [b',', b'0'..=b'9', ..])
        || is_second && after.trim_start().starts_with([',', '}'])
        || ends_in_comma(before) && matches!(after.as_bytes(), [b'0', b'0'..=b'9', ..]);
    if is_comma { message + "; a decimal point is written ." } else { message }
}

/// Returns whether a text ends in a digit and a comma.
fn ends_in_comma(text: &[u8]) -> bool {
    matches!(text, [.., b'0'..=b'9', b','])
}

/// Returns the key whose value begins at the end of a text: in a table on one line, or below the
/// head of a table.
fn key_before(text: &str) -> String {
    let name = |text: &str| text.trim().rsplit([' ', ',', '{', '[']).next().unwrap_or_default().to_owned();
    let line = text.lines().next_back().unwrap_or_default();
    let key = line.rsplit_once('=').map_or(String::new(), |(head, _)| name(head));
    let heads = text.lines().rev().find(|line| line.trim_start().starts_with('['));
    let table = match line.split_once('{') {
        Some((head, _)) => name(head.trim().trim_end_matches(['=', ' ', '['])),
        None => heads.map_or(String::new(), |head| {
            head.split('#').next().unwrap_or_default().trim().trim_matches(['[', ']']).to_owned()
        }),
    };
    join(&table, &key)
}

/// Formats the position of a byte as `FILE:LINE:COLUMN`, counted from 1, columns in characters.
fn position(file: &str, text: &[u8], offset: usize) -> String {
    let before = &text[..offset.min(text.len())];
    let line_start = before.iter().rposition(|&byte| byte == b'\n').map_or(0, |newline| newline + 1);
    let line = before.iter().filter(|&&byte| byte == b'\n').count() + 1;
    let is_first_byte = |byte: &&u8| **byte & 0xc0 != 0x80;
    let column = before[line_start..].iter().filter(is_first_byte).count() + 1;
    format!("{file}:{line}:{column}")
}
