//! Rows of a sweep, in few bytes each; their sections may be in their file alone.

use super::row::SweepRow;
use crate::archive;
use crate::error::{Error, Result};
use crate::input;
use serde::de::Error as _;
use serde::ser::Error as _;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{self, BufRead as _, BufReader, Seek as _, SeekFrom};
use std::path::Path;
use std::rc::Rc;

/// Rows of a sweep in the order of the plan.
///
/// Serialised, each row has its sections.
#[derive(Debug, Clone, Default)]
pub struct SweepRows {
    /// Rows one behind the other, each with its place in the file.
    bytes: Vec<u8>,
    /// First byte of each row, by its index.
    starts: BTreeMap<usize, usize>,
    /// Whether the rows are without sections.
    is_lean: bool,
    /// File with the sections.
    file: Option<Rc<File>>,
}

impl SweepRows {
    /// Creates the rows of some runs.
    ///
    /// # Errors
    /// Returns the error of a row that cannot be kept.
    pub fn new(rows: impl IntoIterator<Item = SweepRow>) -> Result<SweepRows> {
        let mut kept = SweepRows::default();
        rows.into_iter().try_for_each(|row| kept.keep(row, 0))?;
        Ok(kept)
    }

    /// Creates no rows yet; a lean one leaves its sections in its file alone.
    pub(super) fn empty(is_lean: bool) -> SweepRows {
        SweepRows { is_lean, ..SweepRows::default() }
    }

    /// Adds a row that is at a place of a file.
    pub(super) fn keep(&mut self, mut row: SweepRow, place: u64) -> Result<()> {
        if self.is_lean {
            let probes = row.measures.iter_mut().flat_map(|measures| &mut measures.probes);
            probes.for_each(|probe| probe.section = Vec::new());
        }
        self.starts.insert(row.index, self.bytes.len());
        self.bytes.extend(archive::to_bytes(&(place, row))?);
        Ok(())
    }

    /// Lets lean rows read their sections from their file.
    ///
    /// # Errors
    /// Returns [`Error::Io`] where it cannot be opened.
    pub(super) fn with_sections_in(self, path: &Path) -> Result<SweepRows> {
        let open = || input::open_plain(File::options().read(true), path).map_err(Error::io(path));
        let file = if self.is_lean { Some(Rc::new(open()?)) } else { None };
        Ok(SweepRows { file, ..self })
    }

    /// Returns the number of rows.
    pub fn count(&self) -> usize {
        self.starts.len()
    }

    /// Returns whether the row of a run is among them.
    pub(super) fn has(&self, index: usize) -> bool {
        self.starts.contains_key(&index)
    }

    /// Returns the indices of the runs.
    pub(super) fn indices(&self) -> Vec<usize> {
        self.starts.keys().copied().collect()
    }

    /// Returns the rows with their places in the file.
    fn placed(&self) -> impl Iterator<Item = (u64, SweepRow)> {
        // Each was encoded by `keep`.
        self.starts.values().filter_map(|start| archive::first_of(&self.bytes[*start..]).ok())
    }

    /// Returns the rows, without sections where these are in their file.
    pub fn iter(&self) -> impl Iterator<Item = SweepRow> {
        self.placed().map(|(_, row)| row)
    }

    /// Returns the rows with their sections.
    pub(super) fn whole(&self) -> impl Iterator<Item = io::Result<SweepRow>> {
        self.placed().map(|(place, row)| {
            let Some(file) = self.file.as_deref() else { return Ok(row) };
            let (mut file, mut line) = (BufReader::new(file), String::new());
            file.seek(SeekFrom::Start(place))?;
            file.read_line(&mut line)?;
            Ok(serde_json::from_str(&line)?)
        })
    }
}

impl Serialize for SweepRows {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        use serde::ser::SerializeSeq as _;
        let mut rows = serializer.serialize_seq(Some(self.count()))?;
        for row in self.whole() {
            rows.serialize_element(&row.map_err(S::Error::custom)?)?;
        }
        rows.end()
    }
}

impl<'d> Deserialize<'d> for SweepRows {
    fn deserialize<D: Deserializer<'d>>(deserializer: D) -> std::result::Result<SweepRows, D::Error> {
        SweepRows::new(Vec::deserialize(deserializer)?).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::super::measures::{Measures, ProbeMeasures};
    use super::super::plan::Direction;
    use super::super::row::SweepRow;
    use super::SweepRows;

    /// A run takes 8 bytes per number in memory, and few more, however many periods it has.
    #[test]
    fn a_lean_row_is_small() {
        let probe = ProbeMeasures {
            section: vec![0.1; 100],
            max: 1.0,
            min: -1.0,
            rms: 0.7,
            amplitude: 1.0,
            phase: 0.3,
        };
        let measures = Measures {
            probes: vec![probe],
            period: Some(1),
            lyapunov: Some(-2.0),
            peak_force: 3.0,
            impulse: 0.5,
            impacts: 1.0,
            impact_velocity: 0.2,
            work: 1e-3,
            loss: 1e-4,
        };
        let row = |index| SweepRow {
            index,
            values: vec![0.5, 2.0],
            direction: Direction::Apart,
            measures: Some(measures.clone()),
            failure: None,
        };
        let mut rows = SweepRows::empty(true);
        for index in (0..1000).rev() {
            rows.keep(row(index), 1000 * index as u64).unwrap();
        }
        let bytes = rows.bytes.len() as f64 / 1000.0;
        assert!(bytes < 8.0 * 14.0 + 20.0, "{bytes}");
        for (index, lean) in rows.iter().enumerate() {
            let mut expected = row(index);
            expected.measures.as_mut().unwrap().probes[0].section.clear();
            assert_eq!(lean, expected);
        }
    }
}
