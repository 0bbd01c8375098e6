"""Pictures of results, by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .model import Layout, Modes
    from .runs import Run, Table

#: Prefixes of units by powers of 1000.
_PREFIXES = {-4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G"}

#: Least initial energy, relative to the largest, that the energies of a run are told from.
_LEAST_START = 0.05

#: Deflection relative to the largest that may be due to rounding.
_ROUNDING = 1e-9

#: Deflection relative to the largest up to which cells at supports have no nodal lines.
_LEAST_HEIGHT = 1e-3

#: Approximate limit on the triangles of a mode that is drawn.
_MOST_TRIANGLES = 1e5


def multiple(arrays: Iterable[NDArray[Any]]) -> tuple[float, str]:
    """Return the power of 1000 in which the largest value has one to three digits, and its prefix."""
    largest = max((float(np.max(np.abs(array), initial=0.0)) for array in arrays), default=0.0)
    if not 0.0 < largest < np.inf:
        return 1.0, ""
    power = int(np.clip(np.floor(np.log10(largest / 0.99995) / 3), -4, 3))
    return 1000.0**power, _PREFIXES[power]


def _alone(figure: Any) -> Any:
    """Return a figure that a notebook shows once: as the value of a cell, not at its end too."""
    from matplotlib import pyplot

    if "inline" in pyplot.get_backend():
        pyplot.close(figure)
    return figure


class _Panel(NamedTuple):
    """Curves over time on one axis, with the styles of some."""

    label: str
    unit: str
    curves: dict[str, NDArray[Any]]
    styles: dict[str, dict[str, Any]] = {}
    #: Heights of obstacles with their names.
    obstacles: list[tuple[float, str]] = []


def _probes(run: Run) -> list[_Panel]:
    """Return a panel per quantity of the probes, with the obstacles beside deflections."""
    curves: dict[tuple[str, str], dict[str, NDArray[Any]]] = {}
    for axis, (name, values) in zip(run.scene._native.axes, run.probes.items()):
        curves.setdefault(axis, {})[name] = values
    panels = [_Panel(*axis, of_axis) for axis, of_axis in curves.items()]
    obstacles = run.scene._native.obstacles(run.summary["opposite"])
    return [
        panel._replace(obstacles=obstacles) if panel.label == "deflection" else panel
        for panel in panels
    ]


def _energies(history: Table) -> list[_Panel]:
    """Return the panel of the energies; of a driven plate, that of what was put in and lost too."""
    energy, kinetic, elastic, work = (
        history[name] for name in ("energy", "kinetic", "elastic", "work")
    )
    driven = {"color": "tab:green", "linestyle": "-."}
    parts = {"elastic": elastic, "kinetic": kinetic}
    styles = {"kinetic": {"linestyle": "--"}, "work": driven}
    whole = {"color": "black", "linewidth": 2.0}
    largest = max(float(np.abs(values).max(initial=0.0)) for values in (energy, *parts.values()))
    if len(energy) and energy[0] > _LEAST_START * largest:
        curves = {"energy": energy, **parts, **({"work": work} if work.any() else {})}
        return [_Panel("energy", "J", curves, {"energy": whole, **styles})]
    stored = {"kinetic + elastic": kinetic + elastic, **parts}
    exchanged = {"put in": work - work[:1], "lost": energy[:1] - energy}
    return [
        _Panel("energy", "J", stored, {"kinetic + elastic": whole, **styles}),
        _Panel("since the start", "J", exchanged, {"put in": driven, "lost": {"color": "tab:red"}}),
    ]


def _is_near(height: float, curves: Iterable[NDArray[Any]]) -> bool:
    """Return whether a height can be shown without compressing the curves too much."""
    low, high = (extreme([extreme(values) for values in curves]) for extreme in (np.min, np.max))
    return bool(low == high or abs(2 * height - low - high) <= 5 * (high - low))


def history(run: Run) -> Any:
    """Draw the probes of a run and its energies over time; return the figure."""
    from matplotlib import pyplot

    panels = [*_probes(run), *_energies(run.history)]
    size = (7.2, max(2.4 * len(panels), 3.6))
    figure, axes = pyplot.subplots(
        len(panels), 1, sharex=True, squeeze=False, figsize=size, constrained_layout=True
    )
    second, prefix = multiple([run.history["time"]])
    time = run.history["time"] / second
    for axis, panel in zip(axes.flat, panels):
        one, of_unit = multiple(panel.curves.values()) if panel.unit else (1.0, "")
        for name, values in panel.curves.items():
            axis.plot(time, values / one, label=name, **panel.styles.get(name, {}))
        names: set[str] = set()
        for height, name in panel.obstacles:
            if _is_near(height, panel.curves.values()):
                label = None if name in names else name
                axis.axhline(height / one, color="gray", linestyle=":", label=label)
                names.add(name)
        axis.set_ylabel(f"{panel.label} ({of_unit}{panel.unit})" if panel.unit else panel.label)
        axis.margins(x=0)
        # Beside the panel it lies on no curve.
        axis.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    axes[-1, 0].set_xlabel(f"time ({prefix}s)")
    figure.suptitle(run.scene.title or "run")
    return _alone(figure)


def _refined(layout: Layout, shape: NDArray[np.float64]) -> tuple[Any, NDArray[np.float64], Any]:
    """Return small triangles, deflections at their corners, and the triangles of nodal lines."""
    from matplotlib.tri import (
        CubicTriInterpolator,
        LinearTriInterpolator,
        TriFinder,
        Triangulation,
        UniformTriRefiner,
    )

    x, y = layout.nodes.T
    cells = Triangulation(x, y, layout.triangles)
    deflection, *slope = layout.at_nodes(shape).T
    held = layout.node_dofs[:, 0] < 0
    largest = np.abs(deflection).max()
    # Edges with a deflection of 0 get a sign, so that the triangles on one side of them show the
    # nodal line. Where supports hold the plate there is none.
    tiny = _ROUNDING * largest
    deflection = np.where(~held & (np.abs(deflection) < tiny), tiny, deflection)
    # Points are interpolated within known triangles. A finder of triangles would refuse slits.
    finder, refiner = TriFinder(cells), UniformTriRefiner(cells)
    times = int(np.clip(np.log(_MOST_TRIANGLES / len(layout.triangles)) / np.log(4), 0, 3))
    cubic = CubicTriInterpolator(cells, deflection, "user", finder, dz=tuple(slope))
    linear = LinearTriInterpolator(cells, held.astype(float), finder)
    small, deflection = refiner.refine_field(deflection, cubic, subdiv=times)
    _, nearness = refiner.refine_field(held, linear, subdiv=times)
    corners = deflection[small.triangles]
    heights = np.abs(corners)
    least = np.where(nearness[small.triangles].any(axis=1), _LEAST_HEIGHT * largest, 0.0)
    crossed = (corners.min(axis=1) < 0.0) & (corners.max(axis=1) > 0.0)
    crossed &= (heights.min(axis=1) > 1e-3 * tiny) & (heights.max(axis=1) > least)
    lines = Triangulation(small.x, small.y, small.triangles[crossed]) if crossed.any() else None
    return small, deflection, lines


def modes(layout: Layout, shapes: Modes) -> Any:
    """Draw mode shapes with their nodal lines, seen from above; return the figure."""
    from matplotlib import pyplot

    columns = min(len(shapes), 3)
    rows = -(-len(shapes) // columns)
    length, width = np.ptp(layout.nodes, axis=0)
    size = (6.4, rows * (min(6.4 / columns * width / length, 6.4) + 0.4))
    figure, axes = pyplot.subplots(
        rows, columns, squeeze=False, figsize=size, constrained_layout=True
    )
    for axis, frequency, shape in zip(axes.flat, shapes.frequencies, shapes.shapes):
        triangles, deflection, lines = _refined(layout, shape)
        largest = float(np.abs(deflection).max())
        axis.tripcolor(triangles, deflection, shading="gouraud", vmin=-largest, vmax=largest)
        if lines is not None:
            axis.tricontour(lines, deflection, levels=[0.0], colors="black")
        axis.margins(0)
        axis.set(title=f"{frequency:.4g} Hz", aspect="equal")
    for axis in axes.flat:
        axis.set_axis_off()
    return _alone(figure)
