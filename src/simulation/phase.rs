//! Phases of the set-up of a run, for progress reports.

use std::cell::RefCell;

/// Callback that receives the name of each phase.
type Listener = Box<dyn Fn(&'static str)>;

thread_local! {
    static LISTENER: RefCell<Option<Listener>> = const { RefCell::new(None) };
}

/// Sets the listener that receives the phases of set-ups on this thread, in a word or two. It
/// replaces any other; `None` removes it.
pub fn on_phase(listener: Option<Listener>) {
    LISTENER.with(|cell| *cell.borrow_mut() = listener);
}

/// Reports the beginning of a phase to the listener, if there is one.
pub(crate) fn phase(name: &'static str) {
    LISTENER.with(|cell| {
        if let Ok(listener) = cell.try_borrow()
            && let Some(listener) = &*listener
        {
            listener(name);
        }
    });
}
