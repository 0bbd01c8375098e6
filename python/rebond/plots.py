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


def modes(layout: Layout, shapes: Modes) -> Any:
    """Draw mode shapes with their nodal lines, seen from above; return the figure."""
    from matplotlib import pyplot
    from matplotlib.tri import Triangulation

    columns = min(len(shapes), 3)
    rows = -(-len(shapes) // columns)
    figure, axes = pyplot.subplots(rows, columns, squeeze=False, constrained_layout=True)
    cells = Triangulation(*layout.nodes.T, layout.triangles)
    for axis, frequency, shape in zip(axes.flat, shapes.frequencies, shapes.shapes):
        deflection = layout.at_nodes(shape)[:, 0]
        largest = float(np.abs(deflection).max())
        axis.tripcolor(cells, deflection, shading="gouraud", vmin=-largest, vmax=largest)
        if deflection.min() < 0.0 < deflection.max():
            axis.tricontour(cells, deflection, levels=[0.0], colors="black")
        axis.set(title=f"{frequency:.4g} Hz", aspect="equal")
    for axis in axes.flat:
        axis.set_axis_off()
    return _alone(figure)
