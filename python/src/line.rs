//! Line between Python's thread and a thread that does native work.
//!
//! The working thread sends events and waits for answers where it needs Python; Python's thread
//! waits for events without its lock, and looks at signals in between.

use crate::errors::{Failure, usage};
use pyo3::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Time between two looks at Python's signals.
const PATIENCE: Duration = Duration::from_millis(100);

/// Stack size of a working thread, in bytes; that of a main thread on Linux.
const STACK: usize = 8 << 20;

/// Message of the working thread.
pub enum Event {
    /// Needs the load of a Python function at a time (s).
    Load(f64),
    /// Has made a step of a run, and asks whether to go on.
    Step(StepNews),
    /// Has done what it was asked to do.
    Done(Result<Box<dyn Any + Send>, Failure>),
}

/// Step of a run, as a Python function is told of it.
pub struct StepNews {
    /// Index of the step.
    pub step: u64,
    /// Time, in s.
    pub time: f64,
    /// Number of nodes in contact.
    pub contact_nodes: usize,
    /// Row of the history, if one was due, in the order of its columns.
    pub row: Option<Vec<f64>>,
}

/// Answer of Python's thread to an event.
pub enum Answer {
    /// Load, in N, one entry per dof.
    Load(Vec<f64>),
    /// The run goes on.
    Continue,
    /// The work stops as soon as it can.
    Stop,
}

/// Python functions that the working thread asks for.
pub trait Callbacks {
    /// Returns the answer to an event.
    fn answer(&self, py: Python<'_>, event: &Event) -> PyResult<Answer>;
}

/// Absence of Python functions.
impl Callbacks for () {
    fn answer(&self, _: Python<'_>, _: &Event) -> PyResult<Answer> {
        Ok(Answer::Continue)
    }
}

/// End of the line in the working thread.
pub struct WorkerEnd {
    events: Sender<Event>,
    answers: Receiver<Answer>,
    stop: Arc<AtomicBool>,
}

impl WorkerEnd {
    /// Asks Python's thread, and waits for its answer.
    pub fn ask(&self, event: Event) -> Answer {
        let sent = self.events.send(event);
        sent.ok().and_then(|()| self.answers.recv().ok()).unwrap_or(Answer::Stop)
    }

    /// Reports work that is done; returns whether anyone listens.
    pub fn report(&self, done: Result<Box<dyn Any + Send>, Failure>) -> bool {
        self.events.send(Event::Done(done)).is_ok()
    }

    /// Returns whether the work shall stop.
    pub fn is_asked_to_stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// End of the line in Python's thread.
pub struct Line {
    events: Mutex<Receiver<Event>>,
    answers: Mutex<Sender<Answer>>,
    stop: Arc<AtomicBool>,
    is_busy: AtomicBool,
}

/// Right to use a line until it is dropped.
struct Turn<'l>(&'l AtomicBool);

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        self.0.store(false, Ordering::Release);
    }
}

impl Line {
    /// Starts a working thread. It reports its last result itself, or its panic is reported.
    pub fn start(
        work: impl FnOnce(WorkerEnd) -> Result<(), Failure> + Send + 'static,
    ) -> std::io::Result<Line> {
        let (events, received) = channel();
        let (answers, answered) = channel();
        let stop = Arc::new(AtomicBool::new(false));
        let end = WorkerEnd { events: events.clone(), answers: answered, stop: Arc::clone(&stop) };
        let run = move || {
            let ended = catch_unwind(AssertUnwindSafe(|| work(end)));
            if let Err(failure) = ended.map_err(Failure::from).flatten() {
                // Where nobody listens, the Python object is gone.
                let _ = events.send(Event::Done(Err(failure)));
            }
        };
        thread::Builder::new().name("rebond".into()).stack_size(STACK).spawn(run)?;
        let is_busy = AtomicBool::new(false);
        Ok(Line { events: Mutex::new(received), answers: Mutex::new(answers), stop, is_busy })
    }

    /// Sends what the working thread shall do, and waits until it is done.
    ///
    /// # Errors
    /// Returns the exception of a Python function or of a signal before that of the work, and a
    /// usage error where the line is in use by another thread, or by the function that is asked.
    pub fn wait<T: Send + 'static>(
        &self,
        py: Python<'_>,
        callbacks: &dyn Callbacks,
        send: impl FnOnce() -> bool,
    ) -> PyResult<T> {
        if self.is_busy.swap(true, Ordering::Acquire) {
            return Err(usage(py, "the simulation is in the midst of a step; wait for its end"));
        }
        let _turn = Turn(&self.is_busy);
        self.stop.store(false, Ordering::Relaxed);
        let gone = || Failure::Panic("the working thread has ended".into()).exception(py);
        if !send() {
            return Err(gone());
        }
        let mut raised: Option<PyErr> = None;
        loop {
            let event = py
                .detach(|| self.events.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(PATIENCE));
            match event {
                Ok(Event::Done(done)) => {
                    return match (raised, done) {
                        (Some(exception), _) => Err(exception),
                        (None, Err(failure)) => Err(failure.exception(py)),
                        (None, Ok(value)) => value.downcast::<T>().map(|value| *value).map_err(|_| gone()),
                    };
                }
                Ok(event) => {
                    let answer =
                        if raised.is_some() { Ok(Answer::Stop) } else { callbacks.answer(py, &event) };
                    let answer = answer.unwrap_or_else(|exception| {
                        raised = Some(exception);
                        Answer::Stop
                    });
                    let answers = self.answers.lock().unwrap_or_else(PoisonError::into_inner);
                    // A thread that ended has reported it.
                    let _ = answers.send(answer);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return Err(raised.unwrap_or_else(gone)),
            }
            if raised.is_none()
                && let Err(exception) = py.check_signals()
            {
                raised = Some(exception);
            }
            if raised.is_some() {
                self.stop.store(true, Ordering::Relaxed);
            }
        }
    }
}
