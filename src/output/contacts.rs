//! `contacts.csv`: when each node touches an obstacle, and how hard; a row a contact, written when it ends.

use super::history::{malformed, number};
use crate::error::{Error, Result};
pub use crate::simulation::Contact;
use std::fs::{self, File};
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

/// Name of the file in the run folder.
pub const FILE: &str = "contacts.csv";
/// Number of the node; its position, m; first and last instant, s; sum of reaction times step, N s, upward.
const HEADER: &str = "node,x,y,begin,end,impulse";

/// Writes `contacts.csv`.
#[derive(Debug)]
pub struct Contacts {
    path: PathBuf,
    file: File,
}

impl Contacts {
    /// Starts `contacts.csv` afresh in a folder that exists.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn create(folder: &Path) -> Result<Contacts> {
        let path = folder.join(FILE);
        let mut file = File::create(&path).map_err(Error::io(&path))?;
        writeln!(file, "{HEADER}").map_err(Error::io(&path))?;
        Ok(Contacts { path, file })
    }

    /// Adds rows, whole.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub fn push(&mut self, contacts: &[Contact]) -> Result<()> {
        let mut rows = String::new();
        for &Contact { node, at: [x, y], begin, end, impulse } in contacts {
            rows += &node.to_string();
            for value in [x, y, begin, end, impulse] {
                rows.push(',');
                number(&mut rows, value);
            }
            rows.push('\n');
        }
        self.file.write_all(rows.as_bytes()).map_err(Error::io(&self.path))
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
    let path = folder.join(FILE);
    match fs::remove_file(&path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(Error::io(path)(error)),
        _ => Ok(()),
    }
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
