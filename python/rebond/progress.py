"""Progress of a run: one line that moves, in a terminal or a notebook."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from . import _core

#: Least time between two drawings of the line, in s.
PACE = 0.1


class Line:
    """Line on standard error; a block ``with`` ends it."""

    def __init__(self, steps: int) -> None:
        self._steps = max(steps, 1)
        self._begin = time.monotonic()
        self._drawn = 0.0
        self._width = 0

    def show(self, step: int, instant: float, contact_nodes: int) -> None:
        """Draw the state after a step at an instant (s), unless the line was drawn just before."""
        now = time.monotonic()
        if now - self._drawn < PACE:
            return
        self._drawn = now
        done = step / self._steps
        left = f", {(now - self._begin) * (1 - done) / done:.0f} s left" if step else ""
        moment = _core.engineering(instant, "s")
        touch = "node touches" if contact_nodes == 1 else "nodes touch"
        self._write(f"{100 * done:3.0f} %, t = {moment}{left}, {contact_nodes} {touch}")

    def _write(self, text: str) -> None:
        # Blanks cover what is left of a longer line.
        padded = text.ljust(self._width)
        self._width = len(text)
        print(f"\r{padded}", end="", file=sys.stderr, flush=True)

    def __enter__(self) -> Line:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        how = "ended" if kind is None else "stopped"
        self._write(f"{how} after {time.monotonic() - self._begin:.1f} s")
        print(file=sys.stderr, flush=True)
