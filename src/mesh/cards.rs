//! Elements and sets of files that consist of cards, which may come in any order.

use std::collections::{BTreeMap, HashMap};

use super::contents::{Contents, Dialect, Shape};
use super::cursor::Cursor;
use crate::error::Result;

/// Advice for elements of higher order.
pub const CURVED: &str = "cells have straight edges: mesh with first-order elements";

/// Number of kinds of ignored cards that a note lists.
const LISTED: usize = 8;

/// Element as its card has it.
pub struct ElementCard {
    pub number: u64,
    pub place: usize,
    pub shape: Shape,
    /// Numbers of the nodes; those beyond the shape's are unused.
    pub nodes: [u64; 4],
}

/// Numbers of nodes or elements with a name.
struct Set {
    name: String,
    /// First and last number, step, and place in the file.
    ranges: Vec<([u64; 3], usize)>,
}

impl Set {
    /// Returns the indices of its members, or the place of a single number that has none.
    fn indices(&self, indices: &HashMap<u64, usize>) -> std::result::Result<Vec<usize>, (u64, usize)> {
        let mut members = Vec::new();
        for &([first, last, step], place) in &self.ranges {
            if first == last {
                members.push(*indices.get(&first).ok_or((first, place))?);
            } else if (last - first) / step <= indices.len() as u64 {
                let numbers = (0..=(last - first) / step).map(|k| first + k * step);
                members.extend(numbers.filter_map(|number| indices.get(&number)));
            } else {
                let is_within =
                    |number: u64| (first..=last).contains(&number) && (number - first).is_multiple_of(step);
                members
                    .extend(indices.iter().filter(|(number, _)| is_within(**number)).map(|(_, index)| index));
            }
        }
        Ok(members)
    }
}

/// Kind of the members of a set.
#[derive(Clone, Copy, PartialEq)]
pub enum Member {
    Node,
    Element,
}

/// Contents of a file while its cards are read.
pub struct Cards<'a> {
    pub contents: Contents<'a>,
    elements: Vec<ElementCard>,
    /// Sets of nodes and sets of elements, by their names in capitals.
    sets: [BTreeMap<String, Set>; 2],
    /// Numbers of ignored cards by name.
    ignored: BTreeMap<String, usize>,
}

impl<'a> Cards<'a> {
    pub fn new(cursor: Cursor<'a>, dialect: &'static Dialect) -> Cards<'a> {
        let contents = Contents::new(cursor, dialect);
        Cards { contents, elements: Vec::new(), sets: Default::default(), ignored: BTreeMap::new() }
    }

    pub fn add_element(&mut self, element: ElementCard) {
        self.elements.push(element);
    }

    /// Counts a card that does not concern the mesh.
    pub fn ignore(&mut self, name: &str) {
        *self.ignored.entry(name.to_owned()).or_default() += 1;
    }

    /// Adds a range of numbers (first, last, step) to a set, whose name may be in any case.
    pub fn extend_set(&mut self, members: Member, name: &str, range: [u64; 3], place: usize) {
        let sets = &mut self.sets[members as usize];
        let new = || Set { name: name.to_owned(), ranges: Vec::new() };
        let set = sets.entry(name.to_uppercase()).or_insert_with(new);
        set.ranges.push((range, place));
    }

    /// Adds the members of a set above to another. Returns whether there is such a set.
    pub fn join_sets(&mut self, members: Member, name: &str, other: &str) -> bool {
        let Some(other) = self.sets[members as usize].get(&other.to_uppercase()) else { return false };
        let ranges = other.ranges.clone();
        ranges.into_iter().for_each(|(range, place)| self.extend_set(members, name, range, place));
        true
    }

    /// Reads a whole number of a node, an element, ...
    pub fn number(&self, place: usize, field: &str, expected: &str) -> Result<u64> {
        field.parse().map_err(|_| self.contents.cursor.unexpected(place, expected, field.as_bytes()))
    }

    /// Reads a coordinate, which is 0 where its field is blank. An exponent may begin with `D`, or
    /// with its sign alone: `1.5-3`.
    pub fn coordinate(&self, place: usize, field: &str) -> Result<f64> {
        if field.is_empty() {
            return Ok(0.0);
        }
        let mut text = field.to_ascii_uppercase().replace('D', "E");
        if !text.contains('E')
            && let Some(sign) = text.rfind(['+', '-']).filter(|&sign| sign > 0)
        {
            text.insert(sign, 'E');
        }
        let is_number = |value: &f64| value.is_finite();
        let value = text.parse().ok().filter(is_number);
        let expected = "a coordinate of a node";
        value.ok_or_else(|| self.contents.cursor.unexpected(place, expected, field.as_bytes()))
    }

    /// Returns the contents, with elements in the order of the file.
    pub fn contents(self) -> Result<Contents<'a>> {
        let Cards { mut contents, elements, sets: [node_sets, element_sets], ignored } = self;
        let mut indices = HashMap::with_capacity(elements.len());
        for (index, ElementCard { number, place, .. }) in elements.iter().enumerate() {
            if indices.insert(*number, index).is_some() {
                let wrong = format!("there is an element {number} above already");
                return Err(contents.cursor.fault(*place, wrong));
            }
        }
        let mut groups = vec![Vec::new(); elements.len()];
        for (group, Set { name, ranges }) in (1..).zip(element_sets.into_values()) {
            // Elements of other kinds are not among those of the mesh.
            let is_there =
                |([first, last, _], _): &([u64; 3], usize)| first != last || indices.contains_key(first);
            let set = Set { ranges: ranges.into_iter().filter(is_there).collect(), name };
            let members = set.indices(&indices).unwrap_or_default();
            members.into_iter().for_each(|index| groups[index].push(group));
            (1..=2).for_each(|dimension| {
                contents.names.insert((dimension, group), set.name.clone());
            });
        }
        for (ElementCard { number, place, shape, nodes }, mut groups) in elements.into_iter().zip(groups) {
            groups.dedup();
            contents.begin_element(shape, &groups, number);
            nodes[..shape.nodes].iter().try_for_each(|&node| contents.add_corner(place, node))?;
        }
        for set in node_sets.into_values() {
            let members = set.indices(&contents.indices).map_err(|(number, place)| {
                let wrong = format!("node {number} of the set {:?} is not among the nodes", set.name);
                contents.cursor.fault(place, wrong)
            })?;
            contents.node_sets.insert(set.name, members);
        }
        if !ignored.is_empty() {
            let others = ignored.len().saturating_sub(LISTED);
            let mut listed: Vec<String> =
                ignored.iter().take(LISTED).map(|(name, count)| format!("{count} {name}")).collect();
            listed.extend((others > 0).then(|| format!("{others} other kinds of cards")));
            contents.notes.push(format!("ignored: {}", listed.join(", ")));
        }
        Ok(contents)
    }
}
