//! A state on its way into a checkpoint, or back out of it.
//!
//! A struct shows all that its next bit depends on to an [`Archive`], once, in one function; an archive that saves copies what it
//! is shown, one that restores puts back what was saved in the same place. Neither can forget what the other has.
//!
//! Vectors over dofs, velocities or bounds are kept in an order that does not depend on the number of processes, see
//! [`Numbering`]: each takes its own part, whoever had it before.

use crate::error::{Error, Result};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// What the entries of a vector belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Over {
    /// Displacement dofs of a process.
    Dofs,
    /// Velocities of a process: its cells, or its dofs.
    Velocities,
    /// Bounded dofs of a process.
    Bounds,
}

/// Something saved.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Entry {
    /// A value that is the same on every process.
    Value(Vec<u8>),
    /// As many numbers for each entry of a vector.
    Vector(Over, Vec<f64>),
    /// Any numbers of each process.
    Lists(Vec<Vec<f64>>),
}

/// The numbers of a process's dofs, velocities or bounds among those of all: the same however they are shared out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbers {
    /// Of its own.
    pub own: Vec<usize>,
    /// How many there are.
    pub total: usize,
}

/// The numbers of all that a process has.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Numbering {
    /// Of dofs.
    pub dofs: Numbers,
    /// Of velocities.
    pub velocities: Numbers,
    /// Of bounded dofs.
    pub bounds: Numbers,
}

impl Numbering {
    fn of(&self, over: Over) -> &Numbers {
        match over {
            Over::Dofs => &self.dofs,
            Over::Velocities => &self.velocities,
            Over::Bounds => &self.bounds,
        }
    }
}

/// See the [module page](self).
#[derive(Debug)]
pub enum Archive {
    /// Copies what it is shown.
    Saves(Vec<Entry>),
    /// Puts back what was saved, in the same order; the number of processes that did so is not always the present one.
    Restores {
        /// What remains.
        entries: std::vec::IntoIter<Entry>,
        /// Whether there are as many processes as saved it.
        same_processes: bool,
    },
}

fn unfit(what: impl std::fmt::Display) -> Error {
    Error::Checkpoint(format!("the checkpoint does not fit its scene: {what}"))
}

/// The bytes of a value.
///
/// # Errors
/// [`Error::Checkpoint`] for a value that has none.
pub fn to_bytes(value: &impl Serialize) -> Result<Vec<u8>> {
    postcard::to_stdvec(value).map_err(unfit)
}

/// A value from its bytes.
///
/// # Errors
/// [`Error::Checkpoint`] where they are not of such a value.
pub fn from_bytes<T: DeserializeOwned>(bytes: &[u8]) -> Result<T> {
    match postcard::take_from_bytes(bytes) {
        Ok((value, [])) => Ok(value),
        Ok(_) => Err(unfit("too long a value")),
        Err(why) => Err(unfit(why)),
    }
}

impl Archive {
    /// Whether it saves.
    pub fn saves(&self) -> bool {
        matches!(self, Archive::Saves(_))
    }

    /// What it saved; what it has not restored.
    pub fn into_entries(self) -> Vec<Entry> {
        match self {
            Archive::Saves(entries) => entries,
            Archive::Restores { entries, .. } => entries.collect(),
        }
    }

    /// A value that is the same on every process.
    ///
    /// # Errors
    /// [`Error::Checkpoint`], as of all below, where something else was saved in this place.
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

    /// A value that only as many processes as saved it can use. Returns whether the value is right now.
    ///
    /// # Errors
    /// As [`Archive::value`].
    pub fn value_of_same<T: Serialize + DeserializeOwned + Clone>(&mut self, value: &mut T) -> Result<bool> {
        let mut saved = value.clone();
        self.value(&mut saved)?;
        let use_it = !matches!(self, Archive::Restores { same_processes: false, .. });
        if use_it {
            *value = saved;
        }
        Ok(use_it)
    }

    /// A number for each dof, velocity or bound.
    ///
    /// # Errors
    /// As [`Archive::value`].
    pub fn vector(&mut self, over: Over, values: &mut [f64]) -> Result<()> {
        self.items(over, values, |&value| [value], |[value]| value)
    }

    /// An item for each dof, velocity or bound, made of N numbers and to be made of them again.
    ///
    /// # Errors
    /// As [`Archive::value`].
    pub fn items<T, const N: usize>(
        &mut self,
        over: Over,
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

    /// Any numbers of this process; where the number of processes has changed, the first has those of all.
    ///
    /// # Errors
    /// As [`Archive::value`].
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

/// Puts what each process saved, with its numbering, together in the order of the numbers.
///
/// # Errors
/// [`Error::Checkpoint`] where the processes did not save the same things.
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
                    let Numbers { own, total } = numbering.of(*over);
                    let width = (values.len() / total.max(&1)).max(1);
                    for (number, from) in own.iter().zip(vector.chunks_exact(width)) {
                        values[width * number..][..width].copy_from_slice(from);
                    }
                }
            }
        }
        joined.push(first);
    }
    Ok(joined)
}

/// What was joined, as an archive that restores one of some processes.
///
/// # Errors
/// [`Error::Checkpoint`] where there is less than the numbers say.
pub fn part(joined: Vec<Entry>, numbering: &Numbering, rank: usize, same: bool) -> Result<Archive> {
    let own = |entry| {
        Ok(match entry {
            Entry::Lists(lists) if same => Entry::Lists(lists.into_iter().skip(rank).take(1).collect()),
            Entry::Lists(lists) if rank == 0 => Entry::Lists(lists),
            Entry::Lists(_) => Entry::Lists(Vec::new()),
            Entry::Vector(over, values) => {
                let Numbers { own, total } = numbering.of(over);
                if values.len() % total.max(&1) != 0 {
                    return Err(unfit(format!("{} numbers for {total} {over:?}", values.len())));
                }
                let width = values.len() / total.max(&1);
                Entry::Vector(
                    over,
                    own.iter().flat_map(|number| &values[width * number..][..width]).copied().collect(),
                )
            }
            entry => entry,
        })
    };
    let entries = joined.into_iter().map(own).collect::<Result<Vec<_>>>()?;
    Ok(Archive::Restores { entries: entries.into_iter(), same_processes: same })
}
