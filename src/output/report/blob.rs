//! Numbers of the page in one stream: quantised or rounded, shuffled, compressed, and in base64.
//!
//! An array is stored by bytes: the first bytes of all its numbers, then their second bytes, and so
//! on, because similar bytes in a row compress well. All numbers are little-endian.
//!
//! Fields over several frames are arrays of *levels*. Level n > 0 is the value
//!
//! ```math
//! v = \text{low} + (n - 1)\,\text{quantum}
//! ```
//!
//! and level 0 stands for a missing value. With `$d(f, p)$` the level of point p in frame f, the
//! array has, modulo `$2^{16}$`, the differences `$d(f, p) - d(f, p-1) - d(f-1, p) + d(f-1, p-1)$`,
//! where levels outside are 0. They are signed numbers of 16 bits, mapped to 0, -1, 1, -2, ... ->
//! 0, 1, 2, 3, ...

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use std::io::Write;

/// Number of levels that stand for values.
const LEVELS: f64 = 65535.0;

/// Arrays of the page, with a description of each.
#[derive(Debug, Default)]
pub struct PageData {
    bytes: Vec<u8>,
    arrays: Vec<Value>,
}

impl PageData {
    /// Adds numbers without loss.
    pub fn doubles(&mut self, name: &str, values: &[f64]) {
        self.push(name, "f64", values.iter().map(|value| value.to_le_bytes()), json!({}));
    }

    /// Adds numbers with seven digits.
    pub fn floats(&mut self, name: &str, values: impl ExactSizeIterator<Item = f64>) {
        self.push(name, "f32", values.map(|value| (value as f32).to_le_bytes()), json!({}));
    }

    /// Adds indices.
    pub fn indices(&mut self, name: &str, values: &[u32]) {
        self.push(name, "u32", values.iter().map(|value| value.to_le_bytes()), json!({}));
    }

    /// Adds frames of equal length in levels, and returns the quantum.
    ///
    /// A value and its level differ by at most half a quantum; a value that is not finite is
    /// missing.
    pub fn levels(&mut self, name: &str, frames: &[Vec<f64>]) -> f64 {
        let finite = || frames.iter().flatten().copied().filter(|value| value.is_finite());
        let low = finite().reduce(f64::min).unwrap_or(0.0);
        let high = finite().reduce(f64::max).unwrap_or(0.0);
        let quantum = (high - low) / (LEVELS - 1.0);
        let level = |value: f64| match value.is_finite() {
            true if quantum > 0.0 => 1 + ((value - low) / quantum).round() as u16,
            is_finite => u16::from(is_finite),
        };
        let mut before: Vec<u16> = vec![0; frames.first().map_or(0, Vec::len)];
        let mut residuals = Vec::with_capacity(frames.len() * before.len());
        for frame in frames {
            let levels: Vec<u16> = frame.iter().map(|&value| level(value)).collect();
            let mut previous = 0;
            for (level, before) in levels.iter().zip(&before) {
                let change = level.wrapping_sub(*before);
                residuals.push(zigzag(change.wrapping_sub(previous)));
                previous = change;
            }
            before = levels;
        }
        let more = json!({ "frames": frames.len(), "low": low, "quantum": quantum });
        self.push(name, "levels", residuals.iter().map(|residual| residual.to_le_bytes()), more);
        quantum
    }

    fn push<const N: usize>(
        &mut self,
        name: &str,
        kind: &str,
        numbers: impl ExactSizeIterator<Item = [u8; N]>,
        mut more: Value,
    ) {
        let (count, begin) = (numbers.len(), self.bytes.len());
        self.bytes.resize(begin + N * count, 0);
        for (i, bytes) in numbers.enumerate() {
            for (plane, byte) in bytes.into_iter().enumerate() {
                self.bytes[begin + plane * count + i] = byte;
            }
        }
        more["name"] = name.into();
        more["kind"] = kind.into();
        more["count"] = count.into();
        self.arrays.push(more);
    }

    /// Returns the descriptions of the arrays, and their numbers compressed by gzip in base64.
    ///
    /// # Errors
    /// Returns the error of the compression.
    pub fn finish(self) -> std::io::Result<(Value, String)> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(&self.bytes)?;
        Ok((self.arrays.into(), STANDARD.encode(encoder.finish()?)))
    }
}

/// Maps a signed number of 16 bits, given by its bits, to a small one without sign.
fn zigzag(bits: u16) -> u16 {
    let signed = bits as i16;
    ((signed << 1) ^ (signed >> 15)) as u16
}
