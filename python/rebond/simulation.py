"""Simulations that Python steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _core
from .errors import UsageError
from .model import Layout
from .scene import Scene

#: Load: one number per dof (N), one for all, or a function of time (s) that returns them.
Force = Union[ArrayLike, Callable[[float], ArrayLike]]


@dataclass(frozen=True)
class Step:
    """Step that a simulation has made."""

    #: Index of the step; 0 at the start.
    step: int
    #: Time, in s.
    time: float
    #: Number of nodes in contact.
    contact_nodes: int
    #: Sum of the reactions of the obstacles, in N, positive upwards.
    contact_force: float
    #: Relative KKT residual of the step.
    kkt: float
    #: Iterations of the contact solver.
    iterations: int
    #: Quantities at the probes by name, such as deflections in m.
    probes: dict[str, float]


@dataclass(frozen=True)
class Energies:
    """Energies of a simulation at an instant, in J."""

    #: Kinetic energy.
    kinetic: float
    #: Elastic energy.
    elastic: float
    #: Work of loads and moving obstacles.
    work: float

    @property
    def total(self) -> float:
        """Energy that an undamped plate keeps in free motion: kinetic + elastic - work."""
        return self.kinetic + self.elastic - self.work


class Simulation(Layout):
    """Scheme of a scene at an instant, which Python steps.

    ``for step in Simulation(scene)`` goes to the end of the scene; :meth:`step` goes on at will.

    ``force`` adds a load to those of the scene, in N, one entry per dof: a function of time (s)
    that returns it, which the scheme calls at the instants that it needs; or numbers, which hold
    until others are written into :attr:`force`. Linear in time between the instants of the steps,
    a load that is set counts from the instant :attr:`force_time` on.
    """

    _native: _core.Simulation

    def __init__(self, scene: Scene, force: Force | None = None) -> None:
        self.scene = scene
        self._force: NDArray[np.float64] | None = None
        if callable(force):
            self._native = _core.Simulation(scene._native, _returns_array(force), None)
        elif force is None:
            self._native = _core.Simulation(scene._native, None, None)
        else:
            self._native = _core.Simulation(scene._native, None, _array(force))
            self._force = np.broadcast_to(_array(force), (self.dofs,)).copy()
        self._last = self._read(0)

    def _read(self, count: int) -> Step:
        step, time, nodes, total, kkt, iterations, probes = self._native.step(count, self._force)
        named = dict(zip(self.scene.probes, probes))
        return Step(step, time, nodes, total, kkt, iterations, named)

    def step(self, count: int = 1) -> Step:
        """Make ``count`` steps and return the last one."""
        if count < 1:
            raise UsageError(f"step: found {count}; expected a count of at least 1")
        self._last = self._read(count)
        return self._last

    def __iter__(self) -> Iterator[Step]:
        while self._last.step < self.scene.steps:
            yield self.step()

    @property
    def force(self) -> NDArray[np.float64]:
        """Added load from :attr:`force_time` on, in N, one entry per dof; write into it."""
        if self._force is None:
            raise UsageError("force: the simulation was started without; expected force=0.0")
        return self._force

    @force.setter
    def force(self, force: ArrayLike) -> None:
        self.force[:] = force

    @property
    def force_time(self) -> float:
        """Time from which on the present :attr:`force` counts, in s.

        This is the end of the next step; for Newmark's scheme, which computes the displacement of
        the next instant as it arrives at one, it is the end of the step after that. The load of
        the first step is the one that the simulation starts with.
        """
        time = self._native.force_time()
        return self.time if time is None else time

    @property
    def last(self) -> Step:
        """Last step made; that of the start before the first one."""
        return self._last

    @property
    def time(self) -> float:
        """Time, in s."""
        return self._last.time

    @property
    def displacement(self) -> NDArray[np.float64]:
        """Displacement U, in m (1 for slopes), a copy with one entry per dof."""
        return self._native.vector("displacement")

    @property
    def velocity(self) -> NDArray[np.float64]:
        """Rate of U, in m/s (1/s for slopes), a copy with one entry per dof."""
        return self._native.vector("velocity")

    @property
    def reactions(self) -> NDArray[np.float64]:
        """Reactions of the obstacles, in N, positive upwards, a copy with one entry per bound."""
        return self._native.vector("reactions")

    @property
    def lower(self) -> NDArray[np.float64]:
        """Lower bounds of the present step, in m, one entry per bound."""
        return self._native.vector("lower")

    @property
    def upper(self) -> NDArray[np.float64]:
        """Upper bounds of the present step, in m, one entry per bound."""
        return self._native.vector("upper")

    @property
    def energies(self) -> Energies:
        """Energies at the present instant, in J."""
        return Energies(*self._native.energies())

    def __repr__(self) -> str:
        title = self.scene.title or repr(self.scene.file)
        return f"<rebond.Simulation of {title}: step {self._last.step}, t = {self.time:.6g} s>"


def _array(force: ArrayLike) -> NDArray[np.float64]:
    """Return a load as an array of one dimension."""
    array = np.atleast_1d(np.asarray(force, dtype=np.float64))
    if array.ndim != 1:
        raise UsageError(f"force: found {array.ndim} dimensions; expected one entry per dof")
    return array


def _returns_array(force: Callable[[float], ArrayLike]) -> Callable[[float], NDArray[np.float64]]:
    """Return the function with results that native code reads."""
    return lambda time: _array(force(time))
