//! Receivers of the results of a run.

use super::{Contact, Envelope, NodeReaction, RunState, Snapshot};
use crate::error::Result;
use crate::hash::Extent;
use crate::motion::Motion;
pub use crate::scene::HistoryRow as Row;
use crate::scheme::{Event, Solution};

/// Receiver of the results of a run; a closure that takes a [`Row`] is one.
pub trait Observer {
    /// Receives the energy at the start of the run, in J, before all else; also where the run is
    /// resumed.
    fn begin(&mut self, energy: f64) {
        let _ = energy;
    }

    /// Receives a row of the history, every `output.every` steps and at the end.
    ///
    /// # Errors
    /// Returns any error that must stop the run.
    fn row(&mut self, row: &Row) -> Result<()>;

    /// Receives the contacts that ended since the last row, or at the end of the run.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn contacts(&mut self, ended: &[Contact]) -> Result<()> {
        let _ = ended;
        Ok(())
    }

    /// Receives force and moments at each node of the named supports at a step and its time (s), in
    /// the order of the supports; with each snapshot, or at the start where there are none, and at
    /// the end. All processes receive all nodes.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn reactions(&mut self, step: u64, time: f64, rows: &[NodeReaction]) -> Result<()> {
        let _ = (step, time, rows);
        Ok(())
    }

    /// Receives this process's part of a snapshot, every `output.fields_every` steps and at the
    /// end.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn fields(&mut self, snapshot: &Snapshot) -> Result<()> {
        let _ = snapshot;
        Ok(())
    }

    /// Returns what this process wrote of the last snapshot.
    fn piece(&self) -> Extent {
        Extent::default()
    }

    /// Receives the notice that every process has received its part of the snapshot of that step
    /// and time (s), with the extent that each wrote.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn fields_complete(&mut self, step: u64, time: f64, pieces: &[Extent]) -> Result<()> {
        let _ = (step, time, pieces);
        Ok(())
    }

    /// Receives this process's part of the envelope of the von Mises stress, at the end of a run
    /// whose scene asks for extremes.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn envelope(&mut self, envelope: &Envelope) -> Result<()> {
        let _ = envelope;
        Ok(())
    }

    /// Receives the closing or opening of a gap at a node, before the row of its step. Only
    /// event-driven schemes report these.
    ///
    /// # Errors
    /// Returns any error that must stop the run.
    fn event(&mut self, event: &NodeEvent) -> Result<()> {
        let _ = event;
        Ok(())
    }

    /// Receives the scheme itself, after each row.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn state(&mut self, scheme: &dyn Solution) -> Result<()> {
        let _ = scheme;
        Ok(())
    }

    /// Receives the whole state of the run, every `output.checkpoint_every` steps and before an
    /// interruption; on the first process only.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn pause(&mut self, state: RunState) -> Result<()> {
        let _ = state;
        Ok(())
    }

    /// Returns whether [`Observer::end`] needs the state at the last step; the same on all
    /// processes.
    fn keeps_end(&self) -> bool {
        false
    }

    /// Receives the whole state of the run at its last step, and the motion at that instant, from
    /// which another run may start; on the first process only. The state is taken before the
    /// additions to the files that mark the end, so that a run to a later end continues from it as
    /// if there had been no end.
    ///
    /// # Errors
    /// Returns the same errors as [`Observer::row`].
    fn end(&mut self, state: RunState, motion: Motion) -> Result<()> {
        let _ = (state, motion);
        Ok(())
    }

    /// Returns whether the run shall stop after this step. The call is frequent and must be cheap.
    fn interrupts(&self) -> bool {
        false
    }

    /// Receives the end of a step. The call is frequent and must be cheap.
    fn step(&mut self, step: u64, contact_nodes: usize) {
        let _ = (step, contact_nodes);
    }
}

impl<F: FnMut(&Row) -> Result<()>> Observer for F {
    fn row(&mut self, row: &Row) -> Result<()> {
        self(row)
    }
}

/// Passes what a method receives on to both observers of a pair.
macro_rules! both_receive {
    ($($method:ident($($name:ident: $kind:ty),*);)*) => { $(
        fn $method(&mut self, $($name: $kind),*) -> Result<()> {
            self.0.$method($($name),*)?;
            self.1.$method($($name),*)
        }
    )* };
}

/// Pair of observers. Both receive everything, the first one first; after an error of the first the
/// second receives nothing. Only the second may write snapshots.
pub struct Both<A, B>(pub A, pub B);

impl<A: Observer, B: Observer> Observer for Both<A, B> {
    both_receive! {
        row(row: &Row);
        contacts(ended: &[Contact]);
        reactions(step: u64, time: f64, rows: &[NodeReaction]);
        fields(snapshot: &Snapshot);
        fields_complete(step: u64, time: f64, pieces: &[Extent]);
        envelope(envelope: &Envelope);
        event(event: &NodeEvent);
        state(scheme: &dyn Solution);
    }

    fn begin(&mut self, energy: f64) {
        self.0.begin(energy);
        self.1.begin(energy);
    }

    fn piece(&self) -> Extent {
        self.1.piece()
    }

    fn pause(&mut self, state: RunState) -> Result<()> {
        self.0.pause(state.clone())?;
        self.1.pause(state)
    }

    fn keeps_end(&self) -> bool {
        self.0.keeps_end() || self.1.keeps_end()
    }

    fn end(&mut self, state: RunState, motion: Motion) -> Result<()> {
        self.0.end(state.clone(), motion.clone())?;
        self.1.end(state, motion)
    }

    fn interrupts(&self) -> bool {
        self.0.interrupts() || self.1.interrupts()
    }

    fn step(&mut self, step: u64, contact_nodes: usize) {
        self.0.step(step, contact_nodes);
        self.1.step(step, contact_nodes);
    }
}

/// Closing or opening of the gap at a node.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeEvent {
    /// Index of the node.
    pub node: usize,
    /// Position of the node, in m.
    pub at: [f64; 2],
    /// Time, direction and velocity of the event.
    pub event: Event,
}
