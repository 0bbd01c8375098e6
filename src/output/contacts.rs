//! `contacts.csv`: when each node touches an obstacle, and how hard; one row per contact, written when it ends.

use super::history::{malformed, number};
use super::{Lines, remove};
use crate::error::{Error, Result};
pub use crate::simulation::Contact;
use std::fmt::Write as _;
use std::fs;
use std::io;
use std::path::Path;

/// Name of the file in the run folder.
pub const FILE: &str = "contacts.csv";
/// Number of the node; its position, m; first and last instant, s; impulse of the obstacle, N s, upward.
const HEADER: &str = "node,x,y,begin,end,impulse";

/// Writes `contacts.csv`.
#[derive(Debug)]
pub struct Contacts {
    lines: Lines,
}

impl Contacts {
    /// Starts `contacts.csv` afresh in `folder`, which is created if need be.
    ///
    /// # Errors
    /// [`Error::Io`], as all below.
    pub fn create(folder: &Path) -> Result<Contacts> {
        Ok(Contacts { lines: Lines::create(folder, FILE, HEADER)? })
    }

    /// Goes on with the first `length` bytes of what is there.
    pub fn resume(folder: &Path, length: u64) -> Result<Contacts> {
        Ok(Contacts { lines: Lines::resume(folder, FILE, length)? })
    }

    /// How many bytes have reached the disk: all.
    pub fn position(&mut self) -> Result<u64> {
        self.lines.position()
    }

    /// Adds rows.
    pub fn push(&mut self, contacts: &[Contact]) -> Result<()> {
        contacts.iter().try_for_each(|&Contact { node, at: [x, y], begin, end, impulse }| {
            self.lines.push(|line| {
                write!(line, "{node}").expect("a string takes everything");
                for value in [x, y, begin, end, impulse] {
                    line.push(',');
                    number(line, value);
                }
            })
        })
    }

    /// Ends the file; unlike a mere drop, says when the last rows could not be written.
    pub fn finish(mut self) -> Result<()> {
        self.lines.flush()
    }
}

/// Reads the contacts of a run folder; `None` where there is no such file.
///
/// # Errors
/// [`Error::Io`]; of a malformed file it names the line.
pub fn read(folder: &Path) -> Result<Option<Vec<Contact>>> {
    let path = folder.join(FILE);
    match fs::read_to_string(&path) {
        Ok(text) => parse(&text).map(Some).map_err(Error::io(path)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(Error::io(path)(error)),
    }
}

/// Removes the file of an earlier run.
///
/// # Errors
/// [`Error::Io`].
pub fn clear(folder: &Path) -> Result<()> {
    remove(&folder.join(FILE))
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
