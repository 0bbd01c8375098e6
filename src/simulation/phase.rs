//! What the set-up of a run is busy with, for whoever wants to tell.

use std::cell::RefCell;

/// Hears the name of each phase.
type Listener = Box<dyn Fn(&'static str)>;

thread_local! {
    static LISTENER: RefCell<Option<Listener>> = const { RefCell::new(None) };
}

/// Lets a listener hear, in a word or two, what the set-up of runs on this thread is busy with; another one takes its place, and
/// `None` ends it.
pub fn on_phase(listener: Option<Listener>) {
    LISTENER.with(|of| *of.borrow_mut() = listener);
}

/// Tells the listener, if there is one, that a phase begins.
pub(crate) fn phase(name: &'static str) {
    LISTENER.with(|of| {
        if let Ok(listener) = of.try_borrow()
            && let Some(listener) = &*listener
        {
            listener(name);
        }
    });
}
