//! File `contacts.csv`: intervals and impulses of the contacts of single nodes; one row per
//! contact, written when the contact ends.

use super::history::{malformed, numbers};
use super::{Lines, if_there};
use crate::error::{Error, Result};
use crate::input;
pub use crate::simulation::Contact;
use std::fmt::Write as _;
use std::fs::File;
use std::io;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "contacts.csv";
/// Columns: index of the node; its position, m; first and last instant, s; impulse of the obstacle,
/// N s, positive upwards.
pub(super) const HEADER: &str = "node,x,y,begin,end,impulse";

/// Appends the rows of contacts.
pub(super) fn push(file: &mut Lines, contacts: &[Contact]) -> Result<()> {
    contacts.iter().try_for_each(|&Contact { node, at: [x, y], begin, end, impulse }| {
        file.push(|line| {
            write!(line, "{node}").expect("a string takes everything");
            numbers(line, [x, y, begin, end, impulse]);
        })
    })
}

/// Reads the contacts of a run folder; `None` where there is no such file.
///
/// # Errors
/// Returns [`Error::Io`] where the file cannot be read or is malformed, with the line.
pub fn read(folder: &Path) -> Result<Option<Vec<Contact>>> {
    let path = folder.join(FILE);
    let text = input::open_plain(File::options().read(true), &path).and_then(io::read_to_string);
    if_there(&path, text)?.map(|text| parse(&text).map_err(Error::io(path))).transpose()
}

fn parse(text: &str) -> io::Result<Vec<Contact>> {
    let mut lines = text.lines();
    if lines.next() != Some(HEADER) {
        return Err(malformed(1, &format!("expected the header {HEADER}")));
    }
    let contact = |(number, line): (usize, &str)| {
        let values: Option<Vec<f64>> = line.split(',').map(|text| text.parse().ok()).collect();
        match values.as_deref() {
            Some(&[node, x, y, begin, end, impulse]) => {
                Ok(Contact { node: node as usize, at: [x, y], begin, end, impulse })
            }
            _ => Err(malformed(number + 2, &format!("expected numbers {HEADER}"))),
        }
    };
    lines.enumerate().map(contact).collect()
}
