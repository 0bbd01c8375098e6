"""Pictures of results, by matplotlib."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .model import Layout, Modes
    from .runs import Run

#: Prefixes of units by powers of 1000.
_PREFIXES = {-4: "p", -3: "n", -2: "µ", -1: "m", 0: "", 1: "k", 2: "M", 3: "G"}

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


def history(run: Run) -> Any:
    """Draw the probes of a run and its energies over time; return the figure."""
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(2, 1, sharex=True, constrained_layout=True)
    second, prefix = multiple([run.history["time"]])
    time = run.history["time"] / second
    energies = {name: run.history[name] for name in ("energy", "kinetic", "elastic")}
    for axis, label, unit, curves in zip(
        axes, ("probes", "energy"), ("m", "J"), (dict(run.probes), energies)
    ):
        one, of_unit = multiple(curves.values())
        for name, values in curves.items():
            axis.plot(time, values / one, label=name)
        axis.set_ylabel(f"{label} ({of_unit}{unit})")
        if curves:
            axis.legend(frameon=False)
    axes[-1].set_xlabel(f"time ({prefix}s)")
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
