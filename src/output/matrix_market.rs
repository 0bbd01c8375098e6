//! Export of sparse matrices as Matrix Market files (`*.mtx`).

use super::write_atomic;
use crate::error::Result;
use std::fmt::Write;
use std::path::Path;

/// Writes a real general matrix in coordinate format, whole or not at all (see [`write_atomic`]).
///
/// `entries` are (row, column, value) from 0; entries with the same row and column are summed in
/// their order. The file counts from 1, goes column by column, and has 17 significant digits, so
/// that it reads back bitwise. Sums of zero are kept.
pub fn write(path: &Path, [rows, columns]: [usize; 2], mut entries: Vec<(usize, usize, f64)>) -> Result<()> {
    entries.sort_by_key(|&(row, column, _)| (column, row));
    entries.dedup_by(|next, kept| {
        let same = (next.0, next.1) == (kept.0, kept.1);
        if same {
            kept.2 += next.2;
        }
        same
    });
    let mut text =
        format!("%%MatrixMarket matrix coordinate real general\n{rows} {columns} {}\n", entries.len());
    for (row, column, value) in entries {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{} {} {value:.16e}", row + 1, column + 1);
    }
    write_atomic(path, text.as_bytes())
}
