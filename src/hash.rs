//! Hash of texts and states, and checksum of files: one of each for the whole program.

use serde::{Deserialize, Serialize};
use std::io::{self, Read, Write};

/// Start and factor of the 64-bit FNV-1a hash.
const START: u64 = 0xcbf2_9ce4_8422_2325;
const FACTOR: u64 = 0x100_0000_01b3;

/// Returns the 64-bit FNV-1a hash of some bytes.
pub fn fnv1a(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(START, |hash, byte| extend(hash, byte.into()))
}

/// Extends an FNV-1a hash by a number.
pub fn extend(hash: u64, number: u64) -> u64 {
    (hash ^ number).wrapping_mul(FACTOR)
}

/// Start and factor of the 128-bit FNV-1a hash.
const LONG_START: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
const LONG_FACTOR: u128 = 0x100_0000_0000_0000_0000_013b;

/// 128-bit FNV-1a hash of numbers, for names that must never collide.
#[derive(Debug, Clone, Copy)]
pub struct LongHash(pub u128);

impl LongHash {
    /// Creates the hash of nothing.
    pub fn new() -> LongHash {
        LongHash(LONG_START)
    }

    /// Adds bytes.
    pub fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u128::from(byte)).wrapping_mul(LONG_FACTOR);
        }
    }

    /// Adds the bits of numbers, after their count.
    pub fn add_numbers(&mut self, numbers: &[f64]) {
        self.add(&(numbers.len() as u64).to_le_bytes());
        numbers.iter().for_each(|number| self.add(&number.to_bits().to_le_bytes()));
    }
}

/// Appends the checksum to the bytes of a file.
pub fn seal(mut bytes: Vec<u8>) -> Vec<u8> {
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    bytes
}

/// Returns the bytes that [`seal`] was given; `None` where these or the checksum have changed.
pub fn unseal(bytes: &[u8]) -> Option<&[u8]> {
    let (content, sum) = bytes.split_last_chunk()?;
    (crc32fast::hash(content) == u32::from_le_bytes(*sum)).then_some(content)
}

/// Beginning of a file: its length in bytes, and the CRC-32 checksum of these bytes. Bytes that are
/// written to it extend it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Extent {
    /// Length, in bytes.
    pub length: u64,
    /// CRC-32 checksum.
    pub checksum: u32,
}

impl Extent {
    /// Extends the beginning by the bytes that follow.
    pub fn add(&mut self, bytes: &[u8]) {
        let mut hasher = crc32fast::Hasher::new_with_initial_len(self.checksum, self.length);
        hasher.update(bytes);
        *self = Extent { length: self.length + bytes.len() as u64, checksum: hasher.finalize() };
    }

    /// Reads the beginning of a file, of the same length or the whole file if it is shorter.
    ///
    /// # Errors
    /// Returns the errors of reading.
    pub fn read_again(self, file: impl Read) -> io::Result<Extent> {
        let mut extent = Extent::default();
        io::copy(&mut file.take(self.length), &mut extent)?;
        Ok(extent)
    }
}

impl Write for Extent {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.add(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Published values for "a", "foobar" and "123456789".
    #[test]
    fn hashes_are_the_published_ones() {
        assert_eq!(fnv1a([]), START);
        assert_eq!(fnv1a(*b"a"), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(fnv1a(*b"foobar"), 0x8594_4171_f739_67e8);
        assert_eq!(crc32fast::hash(b"123456789"), 0xcbf4_3926);
        let long = |bytes: &[u8]| {
            let mut hash = LongHash::new();
            hash.add(bytes);
            hash.0
        };
        assert_eq!(long(b"a"), 0xd228_cb69_6f1a_8caf_7891_2b70_4e4a_8964);
        assert_eq!(long(b"foobar"), 0x343e_1662_793c_64bf_6f0d_3597_ba44_6f18);
    }

    #[test]
    fn a_file_that_grows_has_the_checksum_of_the_whole() {
        let mut extent = Extent::default();
        [&b"1234"[..], b"", b"56789"].into_iter().for_each(|bytes| extent.add(bytes));
        assert_eq!(extent, Extent { length: 9, checksum: 0xcbf4_3926 });
        assert_eq!(extent.read_again(&b"123456789 and more"[..]).unwrap(), extent);
        assert_eq!(extent.read_again(&b"1234"[..]).unwrap().length, 4);
    }

    #[test]
    fn a_flipped_bit_breaks_the_seal() {
        let sealed = seal(b"content".to_vec());
        assert_eq!(unseal(&sealed), Some(&b"content"[..]));
        for bit in 0..8 * sealed.len() {
            let mut damaged = sealed.clone();
            damaged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(unseal(&damaged), None);
        }
        assert_eq!(unseal(&sealed[..3]), None);
    }
}
