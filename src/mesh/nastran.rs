//! Meshes in input files of Nastran: `GRID`, first-order shells, lines, and the nodes of `SPC`
//! cards; with short, long or free fields.
//!
//! Source: *MSC Nastran quick reference guide*, "Bulk data entries".

use super::cards::{CURVED, Cards, ElementCard, Member};
use super::contents::{Contents, Dialect, Node, SOLID, Shape};
use super::cursor::Cursor;
use crate::error::{Error, Result};

/// Words of the format.
const DIALECT: Dialect =
    Dialect { groups: ["node set", "property", "property"], no_cell: "expected CTRIA3 or CQUAD4 cards" };

/// Cards of elements with their numbers of nodes.
const ELEMENTS: [(&str, usize); 8] = [
    ("CTRIA3", 3),
    ("CTRIAR", 3),
    ("CQUAD4", 4),
    ("CQUADR", 4),
    ("CBAR", 2),
    ("CBEAM", 2),
    ("CROD", 2),
    ("CTUBE", 2),
];

/// Cards that are refused, with the reason and the remedy.
const REFUSED: [(&str, &str); 9] = [
    ("CTRIA6", CURVED),
    ("CQUAD8", CURVED),
    ("CQUAD", CURVED),
    ("CBEAM3", CURVED),
    ("CTETRA", SOLID),
    ("CHEXA", SOLID),
    ("CPENTA", SOLID),
    ("CPYRAM", SOLID),
    ("INCLUDE", "it reads another file: put its lines in place of the card"),
];

/// Width of the fields of a line and their number: short, and long.
const SHORT: [usize; 2] = [8, 8];
const LONG: [usize; 2] = [16, 4];

/// Reads the contents of a file.
pub fn read(cursor: Cursor) -> Result<Contents> {
    let lines = cursor.lines();
    let begins = |line: &[u8]| line.get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"BEGIN"));
    // The executive and the case control stand before the bulk data, in another form.
    let has_control = cursor.lines().any(|(_, line)| begins(line));
    let mut reader = Reader { cards: Cards::new(cursor, &DIALECT) };
    let mut card: Option<Card> = None;
    for (place, line) in lines.skip_while(|(_, line)| has_control && !begins(line)) {
        let line = String::from_utf8_lossy(line);
        let line = expanded(line.split('$').next().unwrap_or_default());
        if line.trim().is_empty() || begins(line.as_bytes()) {
            continue;
        }
        let (first, is_free) = match line.split_once(',') {
            Some((first, _)) => (first.trim().to_owned(), true),
            None => (line.chars().take(8).collect::<String>().trim().to_owned(), false),
        };
        let [width, count] = if first.contains('*') { LONG } else { SHORT };
        let fields: Vec<String> = if is_free {
            line.split(',').skip(1).map(|field| field.trim().to_owned()).collect()
        } else {
            let rest: Vec<char> = line.chars().skip(8).collect();
            rest.chunks(width).map(|field| field.iter().collect::<String>().trim().to_owned()).collect()
        };
        let fields = fields.into_iter().chain(std::iter::repeat(String::new())).take(count);
        let continues = first.is_empty() || first.starts_with(['+', '*']);
        match card.as_mut().filter(|_| continues) {
            Some(card) => card.fields.extend(fields),
            None => {
                if let Some(card) = card.take() {
                    reader.read(&card)?;
                }
                let name = first.trim_end_matches('*').trim().to_uppercase();
                if name == "ENDDATA" {
                    break;
                }
                card = Some(Card { name, place, fields: fields.collect() });
            }
        }
    }
    if let Some(card) = card {
        reader.read(&card)?;
    }
    reader.cards.contents()
}

/// Card with all of its fields, its name apart.
struct Card {
    name: String,
    place: usize,
    fields: Vec<String>,
}

impl Card {
    /// Returns a field, blank where the card has none.
    fn field(&self, index: usize) -> &str {
        self.fields.get(index).map_or("", String::as_str)
    }
}

/// Returns a line with tabulators replaced by the blanks to the next field.
fn expanded(line: &str) -> String {
    let mut text = String::new();
    for part in line.split_inclusive('\t') {
        text += part.trim_end_matches('\t');
        let length = text.chars().count();
        let blanks = if part.ends_with('\t') { 8 - length % 8 } else { 0 };
        text.extend(std::iter::repeat_n(' ', blanks));
    }
    text
}

struct Reader<'a> {
    cards: Cards<'a>,
}

impl Reader<'_> {
    fn fault(&self, place: usize, wrong: impl std::fmt::Display) -> Error {
        self.cards.contents.cursor.fault(place, wrong)
    }

    fn read(&mut self, card: &Card) -> Result<()> {
        let Card { name, place, fields } = card;
        let place = *place;
        if name.is_empty() || !name.chars().all(|c| c.is_ascii_alphanumeric()) {
            let expected = "a card such as GRID or CQUAD4";
            let shown = if name.is_empty() { "a line that goes on, without one" } else { name };
            return Err(self.cards.contents.cursor.unexpected(place, expected, shown.as_bytes()));
        }
        if let Some((_, why)) = REFUSED.iter().find(|(refused, _)| refused == name) {
            return Err(self.fault(place, format_args!("found {name}; {why}")));
        }
        if let Some((_, nodes)) = ELEMENTS.iter().find(|(element, _)| element == name) {
            return self.element(card, *nodes);
        }
        let number = |field: &str, expected: &str| self.cards.number(place, field, expected);
        match &**name {
            "GRID" | "GRDSET" => {
                if !matches!(card.field(1), "" | "0") {
                    let wrong =
                        format!("{name} with the coordinate system {}: expected system 0", card.field(1));
                    return Err(self.fault(place, wrong));
                }
                if name == "GRID" {
                    let number = number(card.field(0), "the number of a node")?;
                    let mut position = [0.0; 3];
                    for (index, x) in position.iter_mut().enumerate() {
                        *x = self.cards.coordinate(place, card.field(2 + index))?;
                    }
                    self.cards.contents.add_node(Node { number, place, position })?;
                }
            }
            "SPC" => {
                let set = format!("spc_{}", number(card.field(0), "the number of a set")?);
                for field in fields[1..].iter().step_by(3).take(2).filter(|field| !field.is_empty()) {
                    let node = self.cards.number(place, field, "the number of a node")?;
                    self.cards.extend_set(Member::Node, &set, [node, node, 1], place);
                }
            }
            "SPC1" => {
                let set = format!("spc_{}", number(card.field(0), "the number of a set")?);
                let mut nodes = fields[2..].iter().filter(|field| !field.is_empty()).peekable();
                while let Some(field) = nodes.next() {
                    let first = self.cards.number(place, field, "the number of a node")?;
                    let mut last = first;
                    if nodes.next_if(|field| field.eq_ignore_ascii_case("THRU")).is_some() {
                        let field = nodes.next().map_or("", String::as_str);
                        last = self.cards.number(place, field, "the number of a node after THRU")?;
                    }
                    if last < first {
                        let wrong = format!("{first} THRU {last}: expected a range that rises");
                        return Err(self.fault(place, wrong));
                    }
                    self.cards.extend_set(Member::Node, &set, [first, last, 1], place);
                }
            }
            _ => self.cards.ignore(name),
        }
        Ok(())
    }

    /// Reads the card of an element, whose property numbers its own where it has none.
    fn element(&mut self, card: &Card, nodes: usize) -> Result<()> {
        let place = card.place;
        let number = self.cards.number(place, card.field(0), "the number of an element")?;
        let property = match card.field(1) {
            "" => number,
            field => self.cards.number(place, field, "the number of a property")?,
        };
        let mut corners = [0; 4];
        for (index, corner) in corners.iter_mut().enumerate().take(nodes) {
            *corner = self.cards.number(place, card.field(2 + index), "the number of a node")?;
        }
        let shape = Shape { dimension: if nodes == 2 { 1 } else { 2 }, nodes };
        self.cards.extend_set(Member::Element, &format!("pid_{property}"), [number, number, 1], place);
        self.cards.add_element(ElementCard { number, place, shape, nodes: corners });
        Ok(())
    }
}
