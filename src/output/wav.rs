//! WAV files: sound of one channel, 44,100 samples a second of 16 bits.

use super::write_atomic;
use crate::error::Result;
use std::path::Path;

/// Number of samples per second.
pub const RATE: u32 = 44_100;

/// Size of a sample, in bytes.
const SAMPLE: u32 = 2;

/// Writes samples, of which those of magnitude `full_scale` become the largest numbers.
///
/// # Errors
/// Returns [`crate::Error::Io`] where the file cannot be written.
///
/// # Panics
/// Panics for more samples than the format can count, 2^31 - 19.
pub fn write(path: &Path, samples: &[f64], full_scale: f64) -> Result<()> {
    let length = u32::try_from(samples.len() * SAMPLE as usize).expect("WAV counts its bytes in 32 bits");
    let mut bytes = Vec::with_capacity(44 + samples.len() * SAMPLE as usize);
    let chunk = |bytes: &mut Vec<u8>, name: &[u8; 4], length: u32| {
        bytes.extend(name);
        bytes.extend(length.to_le_bytes());
    };
    chunk(&mut bytes, b"RIFF", 36 + length);
    bytes.extend(b"WAVE");
    chunk(&mut bytes, b"fmt ", 16);
    // Uncompressed, and one channel.
    bytes.extend([1_u16, 1].into_iter().flat_map(u16::to_le_bytes));
    bytes.extend([RATE, RATE * SAMPLE].into_iter().flat_map(u32::to_le_bytes));
    bytes.extend([SAMPLE as u16, 8 * SAMPLE as u16].into_iter().flat_map(u16::to_le_bytes));
    chunk(&mut bytes, b"data", length);
    let scale = if full_scale > 0.0 { f64::from(i16::MAX) / full_scale } else { 0.0 };
    bytes.extend(samples.iter().flat_map(|sample| ((scale * sample).round() as i16).to_le_bytes()));
    write_atomic(path, &bytes)
}
