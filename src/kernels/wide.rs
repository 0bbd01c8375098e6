//! Loops in the widest registers of the processor.

use pulp::{Arch, NullaryFnOnce};

/// Runs a closure, which must be marked `#[inline(always)]`, with all instructions that the
/// processor has. `Arch::dispatch` itself calls a long closure as a function of its own, which is
/// compiled for the oldest processors.
pub(crate) fn widest<R>(arch: Arch, work: impl FnMut() -> R) -> R {
    arch.dispatch(Included(work))
}

struct Included<F>(F);

impl<R, F: FnMut() -> R> NullaryFnOnce for Included<F> {
    type Output = R;

    #[inline(always)]
    fn call(mut self) -> R {
        (self.0)()
    }
}
