"""Thin elastic plates that vibrate and hit obstacles.

A scene is a TOML text; :func:`run` simulates it, :class:`Model` has its matrices and natural
modes, and :class:`Simulation` steps it with loads that Python computes. All numbers are in SI
units.

>>> import rebond
>>> scene = rebond.Scene("fall.toml").set("time.end=0.2")
>>> run = rebond.run(scene)
>>> run.history["energy"]
"""

from . import errors
from ._core import VERSION as __version__
from .errors import (
    EnergyError,
    Error,
    FileError,
    InternalError,
    MemoryLimitError,
    SceneError,
    SolverError,
    UsageError,
)
from .model import MassModes, Matrices, Model, Modes, keep_modes
from .runs import Fields, Run, RunStep, Table, resume, run
from .scene import Scene
from .simulation import Energies, Simulation, Step

__all__ = [
    "Energies",
    "EnergyError",
    "Error",
    "Fields",
    "FileError",
    "InternalError",
    "MassModes",
    "Matrices",
    "MemoryLimitError",
    "Model",
    "Modes",
    "Run",
    "RunStep",
    "Scene",
    "SceneError",
    "Simulation",
    "SolverError",
    "Step",
    "Table",
    "UsageError",
    "__version__",
    "errors",
    "keep_modes",
    "resume",
    "run",
]
