"""Whole runs and their results."""

from __future__ import annotations

import contextlib
import csv
import itertools
import json
import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _core, plots
from .errors import UsageError
from .model import in_triangles
from .progress import PACE, Line
from .scene import Scene

#: Columns of the history that count something.
_COUNTS = ("step", "contact_nodes", "vi_iterations")

#: Columns of ``events.csv`` that have other names in `Run.events`.
_EVENTS = {"kind": "closes", "reaction": "force"}

#: Kinds of events as numbers.
_KINDS = {"closes": "1", "opens": "0"}

#: Why there are no fields.
_NO_SNAPSHOTS = "the scene asks for no snapshots; set output.fields_every"


class Table(Mapping[str, NDArray[Any]]):
    """Columns of numbers by name, of equal length.

    ``pandas.DataFrame(dict(table))`` makes a data frame of it.
    """

    def __init__(self, columns: Mapping[str, NDArray[Any]]) -> None:
        self._columns = dict(columns)

    def __getitem__(self, name: str) -> NDArray[Any]:
        try:
            return self._columns[name]
        except KeyError:
            raise KeyError(f"no column {name!r}; there are {', '.join(self._columns)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(next(iter(self._columns.values()), ()))

    def __repr__(self) -> str:
        return f"<rebond.Table of {self.rows} rows: {', '.join(self._columns)}>"


@dataclass(frozen=True)
class RunStep:
    """Step of a run, as ``on_step`` receives it."""

    #: Index of the step; 0 at the start.
    step: int
    #: Time, in s.
    time: float
    #: Number of nodes in contact.
    contact_nodes: int
    #: Row of the history by name where one is due, every ``output.every`` steps; otherwise None.
    row: dict[str, float] | None


class Fields:
    """Snapshots of the plate, every ``output.fields_every`` steps and at the end.

    Each field is an array with one row per snapshot and one column per point. The first points are
    the nodes of the mesh, in its order; ``output.subdivide`` adds points between them.
    """

    #: Times, in s, one per snapshot.
    time: NDArray[np.float64]
    #: Indices of the steps, one per snapshot.
    step: NDArray[np.int64]
    #: Positions x and y of the points, in m, shape (points, 2).
    points: NDArray[np.float64]
    #: Corners of the small cells as indices of points, counter-clockwise, shape (cells, 3 or 4);
    #: -1 in place of the fourth corner of a triangle among quadrilaterals.
    cells: NDArray[np.int64]
    #: Cell of the mesh that contains each small cell.
    parents: NDArray[np.int64]

    #: Deflection, in m, shape (snapshots, points).
    deflection: NDArray[np.float64]
    #: Velocity, in m/s, shape (snapshots, points).
    velocity: NDArray[np.float64]
    #: Derivatives of the deflection along x and y, shape (snapshots, points, 2).
    slope: NDArray[np.float64]
    #: Mean velocity of each cell of the mesh, in m/s, shape (snapshots, cells).
    cell_velocity: NDArray[np.float64]
    #: Gap to the nearest obstacle, in m, NaN where there is none.
    gap: NDArray[np.float64]
    #: Height of the nearest obstacle below, in m.
    floor: NDArray[np.float64]
    #: Height of the nearest obstacle above, in m.
    ceiling: NDArray[np.float64]
    #: Reaction of the obstacles at each node, in N, 0 at other points.
    reaction: NDArray[np.float64]
    #: Moments M_xx, M_yy and M_xy, in N m/m, shape (snapshots, points, 3).
    moment: NDArray[np.float64]
    #: Stresses xx, yy and xy at the upper surface, in Pa, shape (snapshots, points, 3).
    stress_top: NDArray[np.float64]
    #: Von Mises stress, in Pa.
    von_mises: NDArray[np.float64]

    _NAMES = (
        "deflection",
        "velocity",
        "slope",
        "cell_velocity",
        "gap",
        "floor",
        "ceiling",
        "reaction",
        "moment",
        "stress_top",
        "von_mises",
    )

    def __init__(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        self.time = arrays.get("time", np.empty(0))
        self.step = np.asarray(arrays.get("step", ()), dtype=np.int64)
        self.points = arrays.get("points", np.empty((0, 2)))
        self.cells = arrays.get("cells", np.empty((0, 3), dtype=np.int64))
        self.parents = arrays.get("parents", np.empty(0, dtype=np.int64))
        self._arrays = {name: arrays[name] for name in self._NAMES if name in arrays}

    @property
    def names(self) -> list[str]:
        """Names of the fields that the scene has."""
        return list(self._arrays)

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        """Return a field by name, shape (snapshots, points)."""
        if name in self._arrays:
            return self._arrays[name]
        raise KeyError(self._without(name))

    if not TYPE_CHECKING:  # Types have the names above, and no others.

        def __getattr__(self, name: str) -> NDArray[np.float64]:
            if name.startswith("_"):
                raise AttributeError(name)
            if name in self._arrays:
                return self._arrays[name]
            raise AttributeError(self._without(name))

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._arrays]

    def _without(self, name: str) -> str:
        """Return why there is no field of a name."""
        if not len(self.time):
            return f"{name}: {_NO_SNAPSHOTS}"
        return f"the scene has no field {name!r}; there are {', '.join(self._arrays)}"

    @property
    def triangles(self) -> NDArray[np.int64]:
        """Small cells cut into triangles, shape (triangles, 3), as matplotlib draws them."""
        return in_triangles(self.cells)

    def to_pyvista(self, snapshot: int = -1) -> Any:
        """Return a snapshot, by default the last one, as a ``pyvista.UnstructuredGrid``.

        Its points lie in the plane z = 0; ``warp_by_scalar("deflection")`` bends it. Fields of
        points are its point arrays, and ``cell_velocity`` is a cell array. pyvista is needed.
        """
        try:
            import pyvista
        except ImportError as error:
            raise ImportError("to_pyvista needs pyvista: pip install pyvista") from error
        if not len(self.time):
            raise UsageError(f"to_pyvista: {_NO_SNAPSHOTS}")
        deflection = self.deflection[snapshot]
        counts = (self.cells >= 0).sum(axis=1)
        rows = np.column_stack([counts, self.cells])
        # Numbers of VTK: 5 is a triangle, 9 a quadrilateral.
        kinds = np.where(counts == 3, 5, 9).astype(np.uint8)
        points = np.column_stack([self.points, np.zeros(len(self.points))])
        grid = pyvista.UnstructuredGrid(rows[rows >= 0], kinds, points)
        for name, values in self._arrays.items():
            if name == "cell_velocity":
                grid.cell_data[name] = values[snapshot][self.parents]
            elif values.shape[1] == len(deflection):
                grid.point_data[name] = values[snapshot]
        return grid

    def __len__(self) -> int:
        return len(self.time)

    def __repr__(self) -> str:
        names = ", ".join(self._arrays) or "none"
        return f"<rebond.Fields: {len(self)} snapshots at {len(self.points)} points: {names}>"


class Run:
    """Results of a run."""

    #: Scene that was run.
    scene: Scene
    #: Rows of ``history.csv`` by column: step, time (s), energies (J), contact and probes.
    history: Table
    #: Columns of the probes alone, by name.
    probes: Table
    #: Contacts of single nodes: node, x, y (m), begin, end (s), impulse (N s).
    contacts: Table
    #: Events of ``time.scheme = "exact"``: time (s), node, x, y (m), closes, velocity (m/s), force (N).
    events: Table
    #: Snapshots.
    fields: Fields
    #: Contents of ``summary.json``.
    summary: dict[str, Any]
    #: Whether the run came to its end; False where ``on_step`` stopped it.
    finished: bool
    #: Run folder, or None where nothing was written.
    folder: str | None

    def __init__(self, scene: Scene, results: Mapping[str, Any], folder: str | None) -> None:
        def counts(columns: Mapping[str, NDArray[Any]], names: tuple[str, ...]) -> Table:
            whole = {name: columns[name].astype(np.int64) for name in names}
            return Table({**columns, **whole})

        self.scene = scene
        self.history = counts(results["history"], _COUNTS)
        self.probes = Table({name: self.history[name] for name in scene.probes})
        self.contacts = counts(results["contacts"], ("node",))
        events = counts(results["events"], ("node",))
        self.events = Table({**events, "closes": events["closes"].astype(bool)})
        self.fields = Fields(results["fields"])
        self.summary = json.loads(results["summary"])
        self.finished = results["finished"]
        self.folder = folder

    def plot(self) -> Any:
        """Draw the probes and the energies over time by matplotlib, and return the figure.

        The pictures are those of ``rebond plot``: deflections with the obstacles, and of a driven
        plate what was put in and lost.
        """
        return plots.history(self)

    def __repr__(self) -> str:
        state = "finished" if self.finished else self.summary["status"]
        return f"<rebond.Run of {self.scene.title or self.scene.file!r}: {state}, {self.history.rows} rows>"


def run(
    scene: Scene | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    on_step: Callable[[RunStep], Any] | None = None,
    overwrite: bool = False,
    progress: bool = False,
) -> Run:
    """Simulate a scene, or the scene of a file, to its end.

    With ``out``, the run folder is written as by ``rebond run --out``, and ``overwrite`` allows to
    replace what it holds of another scene. ``on_step`` is called after every step; a true result
    stops the run there, and an exception stops it and is raised. With ``progress`` a line on
    standard error tells how far the run is. Ctrl-C stops the run after the present step and raises
    ``KeyboardInterrupt``. Where there is a run folder, a run that is stopped leaves a checkpoint in
    it, from which :func:`resume` goes on.
    """
    folder = None if out is None else os.fspath(out)
    scene = scene if isinstance(scene, Scene) else Scene(scene)
    with Line(scene.steps) if progress else contextlib.nullcontext() as line:
        tell = _teller(on_step, scene._native.columns, line)
        pace = PACE if on_step is None else 0.0
        return Run(scene, _core.run(scene._native, folder, overwrite, tell, pace), folder)


def resume(
    folder: str | os.PathLike[str],
    until: float | None = None,
    on_step: Callable[[RunStep], Any] | None = None,
) -> Run:
    """Go on with a run from the newest checkpoint in its folder, as ``rebond resume`` does.

    It leaves the files of an undisturbed run, byte for byte but for the seconds in
    ``summary.json``. With ``until`` (s, a whole number of steps) it goes on to a later end, also
    where the run has finished. ``on_step`` is that of :func:`run`. The tables of the result are
    those of the whole run; its ``fields`` begin after the checkpoint.
    """
    place = Path(folder)
    try:
        columns = _read_table(place / "history.csv", names_only=True)
    except OSError:
        columns = {}  # The native part says what is missing.
    end = None if until is None else repr(float(until))
    tell = _teller(on_step, list(columns))
    results, scene, damaged = _core.resume(os.fspath(folder), end, tell)
    for what in damaged:
        warnings.warn(f"{what}; went on from the one before", RuntimeWarning, stacklevel=2)
    for name in ("history", "contacts", "events"):
        if (place / f"{name}.csv").exists():
            table = _read_table(place / f"{name}.csv")
            results[name] = {_EVENTS.get(column, column): table[column] for column in table}
    return Run(Scene._of(scene), results, os.fspath(folder))


def _teller(
    on_step: Callable[[RunStep], Any] | None, columns: list[str], line: Line | None = None
) -> Callable[[int, float, int, list[float] | None], Any] | None:
    """Return the function that native code calls after each step."""
    if on_step is None and line is None:
        return None

    def tell(step: int, time: float, contact_nodes: int, row: list[float] | None) -> Any:
        if line is not None:
            line.show(step, time, contact_nodes)
        if on_step is None:
            return False
        named = None if row is None else dict(zip(columns, row))
        return on_step(RunStep(step, time, contact_nodes, named))

    return tell


def _read_table(path: Path, names_only: bool = False) -> dict[str, NDArray[Any]]:
    """Return the columns of a table of numbers by name."""
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(itertools.islice(file, 1) if names_only else file)
    values = [[float(_KINDS.get(value, value)) for value in row] for row in rows]
    numbers = np.array(values).reshape(-1, len(head))
    return dict(zip(head, numbers.T.copy()))
