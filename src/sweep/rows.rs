//! Rows of a sweep, whose sections may be in their file alone.

use super::row::SweepRow;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Seek as _, SeekFrom};
use std::ops::Deref;
use std::rc::Rc;

/// Rows of a sweep in the order of the plan.
///
/// Serialised, each row has its sections.
#[derive(Debug, Clone)]
pub struct SweepRows {
    pub(super) rows: Vec<SweepRow>,
    /// File with the sections, and the places of the rows in it by index; `None` where the rows
    /// have them.
    pub(super) file: Option<Rc<(File, BTreeMap<usize, u64>)>>,
}

impl SweepRows {
    /// Returns the rows with their sections.
    pub(super) fn whole(&self) -> impl Iterator<Item = io::Result<SweepRow>> {
        self.rows.iter().map(|row| {
            let Some((file, places)) = self.file.as_deref() else { return Ok(row.clone()) };
            let (mut file, mut line) = (BufReader::new(file), String::new());
            file.seek(SeekFrom::Start(places[&row.index]))?;
            file.read_line(&mut line)?;
            Ok(serde_json::from_str(&line)?)
        })
    }
}

impl From<Vec<SweepRow>> for SweepRows {
    fn from(rows: Vec<SweepRow>) -> SweepRows {
        SweepRows { rows, file: None }
    }
}

impl Deref for SweepRows {
    type Target = [SweepRow];

    fn deref(&self) -> &[SweepRow] {
        &self.rows
    }
}

impl PartialEq for SweepRows {
    fn eq(&self, other: &SweepRows) -> bool {
        self.rows == other.rows
    }
}

impl Serialize for SweepRows {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        use serde::ser::SerializeSeq as _;
        let mut rows = serializer.serialize_seq(Some(self.rows.len()))?;
        for row in self.whole() {
            rows.serialize_element(&row.map_err(S::Error::custom)?)?;
        }
        rows.end()
    }
}

impl<'d> Deserialize<'d> for SweepRows {
    fn deserialize<D: Deserializer<'d>>(deserializer: D) -> Result<SweepRows, D::Error> {
        Vec::deserialize(deserializer).map(SweepRows::from)
    }
}
