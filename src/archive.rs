//! Saving and restoring the state of a run in a checkpoint.
//!
//! In one function, a type passes everything that its next result depends on to an [`Archive`],
//! once. An archive that saves copies each value; one that restores overwrites it with the value
//! saved at the same place. Saving and restoring thus cannot disagree about what the state is.
//!
//! Vectors over dofs, velocities or bounds are stored in an order that does not depend on the
//! number of ranks, see [`Numbering`]: each rank takes its own part, whichever rank saved it.

use crate::error::{Error, Result};
use crate::hash;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// Kind of the entries of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum VectorKind {
    /// Displacement dofs of a rank.
    Dofs,
    /// Velocity dofs of a rank: its cells, or its displacement dofs.
    Velocities,
    /// Bounded dofs of a rank.
    Bounds,
}

/// Saved item of an archive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// Value that is the same on every rank.
    Value(Vec<u8>),
    /// Vector with a fixed number of numbers per entry.
    Vector(VectorKind, Vec<f64>),
    /// Numbers of each rank, in lists of any length.
    Lists(Vec<Vec<f64>>),
}

/// Global numbers of a rank's dofs, velocities or bounds, which do not depend on the partition.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Numbers of this rank's own entries.
    pub own: Vec<usize>,
    /// Total number of entries over all ranks.
    pub total: usize,
}

/// Global numbers of everything that a rank owns.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbering {
    /// Numbers of the dofs.
    pub dofs: Numbers,
    /// Numbers of the velocities.
    pub velocities: Numbers,
    /// Numbers of the bounded dofs.
    pub bounds: Numbers,
}

impl Numbering {
    fn of(&self, over: VectorKind) -> &Numbers {
        match over {
            VectorKind::Dofs => &self.dofs,
            VectorKind::Velocities => &self.velocities,
            VectorKind::Bounds => &self.bounds,
        }
    }
}

/// Archive that saves or restores a state; see the [module page](self).
#[derive(Debug)]
pub enum Archive {
    /// Archive that copies the values passed to it.
    Saves(Vec<Entry>),
    /// Archive that returns saved values in the same order. The number of ranks may differ from
    /// that of the run which saved them.
    Restores {
        /// Entries not yet restored.
        entries: std::vec::IntoIter<Entry>,
        /// Whether the number of ranks is the same as when saving.
        same_processes: bool,
    },
}

fn unfit(what: impl std::fmt::Display) -> Error {
    Error::Checkpoint(format!("the checkpoint does not fit its scene: {what}"))
}

/// Serialises a value.
///
/// # Errors
/// Returns [`Error::Checkpoint`] for a value that cannot be serialised.
pub fn to_bytes(value: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(value).map_err(unfit)
}

/// Deserialises a value.
///
/// # Errors
/// Returns [`Error::Checkpoint`] where the bytes are not those of such a value.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok(_) => Err(unfit("too long a value")),
        Err(why) => Err(unfit(why)),
    }
}

/// Deserialises the first of several values.
///
/// # Errors
/// Returns [`Error::Checkpoint`] where the bytes do not begin with such a value.
pub fn first_of<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    postcard::take_from_bytes(bytes).map(|(value, _)| value).map_err(unfit)
}

/// Kind of a file with one value: a line of text (kind and version), the value in postcard's
/// format, and a little-endian CRC-32 of all that precedes.
#[derive(Debug)]
pub struct FileKind {
    /// Name of the kind.
    pub name: &'static str,
    /// Number of the format, which increases whenever the contents of the file or their order
    /// change.
    pub format: u32,
    /// Verb in messages, between the program and the file.
    pub verb: &'static str,
}

impl FileKind {
    /// Returns the first line of the file, without its line break.
    fn head(&self) -> String {
        format!("rebond {}, format {}, version {}", self.name, self.format, env!("CARGO_PKG_VERSION"))
    }

    /// Returns the bytes of the file of a value.
    ///
    /// # Errors
    /// Returns the errors of [`to_bytes`].
    pub fn to_bytes(&self, value: &impl Serialize) -> Result<Vec<u8>> {
        let mut bytes = (self.head() + "\n").into_bytes();
        bytes.extend(to_bytes(value)?);
        Ok(hash::seal(bytes))
    }

    /// Returns the value in the bytes of a file. Any other bytes than those written give a message
    /// that says what is wrong.
    pub fn from_bytes<T: DeserializeOwned>(&self, bytes: &[u8]) -> std::result::Result<T, String> {
        let damaged = || "damaged: not what was written".to_owned();
        let content = hash::unseal(bytes).ok_or_else(damaged)?;
        let end = content.iter().position(|&byte| byte == b'\n').ok_or_else(damaged)?;
        let (line, head) = (String::from_utf8_lossy(&content[..end]), self.head());
        if line != head {
            return Err(format!("a {line}; this program {} a {head}", self.verb));
        }
        from_bytes(&content[end + 1..]).map_err(|_| damaged())
    }
}

impl Archive {
    /// Returns whether the archive saves.
    pub fn saves(&self) -> bool {
        matches!(self, Archive::Saves(_))
    }

    /// Returns the entries saved, or those not yet restored.
    pub fn into_entries(self) -> Vec<Entry> {
        match self {
            Archive::Saves(entries) => entries,
            Archive::Restores { entries, .. } => entries.collect(),
        }
    }

    /// Saves or restores a value that is the same on every rank.
    ///
    /// # Errors
    /// Returns [`Error::Checkpoint`], like all methods below, where something else was saved at
    /// this place.
    pub fn value<T: Serialize + DeserializeOwned>(&mut self, value: &mut T) -> Result<()> {
        match self {
            Archive::Saves(entries) => entries.push(Entry::Value(to_bytes(value)?)),
            Archive::Restores { entries, .. } => match entries.next() {
                Some(Entry::Value(bytes)) => *value = from_bytes(&bytes)?,
                _ => return Err(unfit("no value")),
            },
        }
        Ok(())
    }

    /// Saves or restores one number per dof, velocity or bound.
    ///
    /// # Errors
    /// Returns the errors of [`Archive::value`].
    pub fn vector(&mut self, over: VectorKind, values: &mut [f64]) -> Result<()> {
        self.items(over, values, |&value| [value], |[value]| value)
    }

    /// Saves or restores one item per dof, velocity or bound, converted to N numbers and back.
    ///
    /// # Errors
    /// Returns the errors of [`Archive::value`].
    pub fn items<T, const N: usize>(
        &mut self,
        over: VectorKind,
        items: &mut [T],
        numbers: impl FnMut(&T) -> [f64; N],
        mut item: impl FnMut([f64; N]) -> T,
    ) -> Result<()> {
        match self {
            Archive::Saves(entries) => {
                entries.push(Entry::Vector(over, items.iter().flat_map(numbers).collect()));
            }
            Archive::Restores { entries, .. } => match entries.next() {
                Some(Entry::Vector(saved, values)) if saved == over && values.len() == N * items.len() => {
                    for (to, numbers) in items.iter_mut().zip(values.as_chunks().0) {
                        *to = item(*numbers);
                    }
                }
                _ => return Err(unfit(format!("{} {over:?}", items.len()))),
            },
        }
        Ok(())
    }

    /// Saves or restores any numbers of this rank. Where the number of ranks has changed, the first
    /// rank gets the numbers of all.
    ///
    /// # Errors
    /// Returns the errors of [`Archive::value`].
    pub fn list(&mut self, values: &mut Vec<f64>) -> Result<()> {
        match self {
            Archive::Saves(entries) => entries.push(Entry::Lists(vec![values.clone()])),
            Archive::Restores { entries, .. } => match entries.next() {
                Some(Entry::Lists(saved)) => *values = saved.concat(),
                _ => return Err(unfit("no list")),
            },
        }
        Ok(())
    }
}

/// Joins what each rank saved, with its numbering, in the order of the global numbers.
///
/// # Errors
/// Returns [`Error::Checkpoint`] where the ranks did not save the same things.
pub fn join(parts: Vec<(Vec<Entry>, Numbering)>) -> Result<Vec<Entry>> {
    let (mut parts, numberings): (Vec<_>, Vec<_>) =
        parts.into_iter().map(|(entries, numbering)| (entries.into_iter(), numbering)).unzip();
    let mut joined = Vec::new();
    while let Some(mut first) = parts.first_mut().and_then(Iterator::next) {
        let mut others = parts.iter_mut().skip(1).filter_map(Iterator::next);
        match &mut first {
            Entry::Value(_) => others.by_ref().for_each(drop),
            Entry::Lists(lists) => {
                for other in others {
                    let Entry::Lists(more) = other else { return Err(unfit("no list")) };
                    lists.extend(more);
                }
            }
            Entry::Vector(over, values) => {
                let mut vectors = vec![std::mem::take(values)];
                for other in others {
                    let Entry::Vector(_, values) = other else { return Err(unfit("no vector")) };
                    vectors.push(values);
                }
                *values = vec![0.0; vectors.iter().map(Vec::len).sum()];
                for (numbering, vector) in numberings.iter().zip(&vectors) {
                    let Numbers { own: numbers, total } = numbering.of(*over);
                    let width = (values.len() / total.max(&1)).max(1);
                    for (number, from) in numbers.iter().zip(vector.chunks_exact(width)) {
                        values[width * number..][..width].copy_from_slice(from);
                    }
                }
            }
        }
        joined.push(first);
    }
    Ok(joined)
}

/// Returns the archive from which one rank restores its part of what was joined.
///
/// # Errors
/// Returns [`Error::Checkpoint`] where there are fewer values than the numbering requires.
pub fn part(joined: Vec<Entry>, numbering: &Numbering, rank: usize, same: bool) -> Result<Archive> {
    let piece = |entry| {
        Ok(match entry {
            Entry::Lists(lists) if same => Entry::Lists(lists.into_iter().skip(rank).take(1).collect()),
            Entry::Lists(lists) if rank == 0 => Entry::Lists(lists),
            Entry::Lists(_) => Entry::Lists(Vec::new()),
            Entry::Vector(over, values) => {
                let Numbers { own: numbers, total } = numbering.of(over);
                if values.len() % total.max(&1) != 0 {
                    return Err(unfit(format!("{} numbers for {total} {over:?}", values.len())));
                }
                let width = values.len() / total.max(&1);
                Entry::Vector(
                    over,
                    numbers.iter().flat_map(|number| &values[width * number..][..width]).copied().collect(),
                )
            }
            entry => entry,
        })
    };
    let entries = joined.into_iter().map(piece).collect::<Result<Vec<_>>>()?;
    Ok(Archive::Restores { entries: entries.into_iter(), same_processes: same })
}
