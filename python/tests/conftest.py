"""Scenes that the tests share, and the command beside which the package is held."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import rebond

ROOT = Path(__file__).resolve().parents[2]

#: The paper's plate, let go from its equilibrium under a pressure, above an obstacle.
FALL = """
mesh = { element = "fvs", cells = [6, 2] }
support = [{ edge = "left", kind = "clamped", name = "clamp" }]
obstacle = [{ side = "below", height = -0.1, name = "floor" }]
initial = { static_pressure = 14600 }
time = { scheme = "newmark", mass = "singular", step = 1e-4, end = 0.08 }
output.every = 10
output.fields_every = 400
output.probes = [{ name = "corner", at = [1.2, 0] }, { name = "middle", at = [0.55, 0.23] }]

[plate]
length = 1.2            # m
width = 0.4             # m
thickness = 0.01        # m
youngs_modulus = 210e9  # Pa
poissons_ratio = 0.3
density = 7770.0        # kg/m3
"""


@pytest.fixture(autouse=True)
def interrupts() -> Iterator[None]:
    """Let Ctrl-C raise `KeyboardInterrupt`: a shell starts jobs in the background without it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def fall() -> rebond.Scene:
    """Return the falling plate."""
    return rebond.Scene.from_text(FALL, "fall.toml")


@pytest.fixture
def fall_file(tmp_path: Path) -> Path:
    """Write the falling plate to a file, and return its path."""
    path = tmp_path / "fall.toml"
    path.write_text(FALL)
    return path


@pytest.fixture(scope="session")
def command() -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return a function that calls the command ``rebond``, which the variable REBOND names."""
    program = os.environ.get("REBOND")
    if program is None:
        pytest.skip("REBOND names no program beside which the package can be held")

    def call(*words: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [program, *map(str, words)], capture_output=True, text=True, check=False
        )

    return call
