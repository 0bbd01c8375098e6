"""Models: mesh, matrices and natural modes of a scene."""

from __future__ import annotations

import os
import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Union

import numpy as np
from numpy.typing import NDArray

from . import _core, plots
from .errors import UsageError
from .scene import Scene

if TYPE_CHECKING:
    from scipy.sparse import csr_array  # type: ignore[import-untyped]


@dataclass(frozen=True, repr=False)
class Matrices:
    """Matrices of M U'' + K U = F + G^T r between the bounds ``lower <= G U <= upper``.

    All are ``scipy.sparse.csr_array``. Dofs are deflections w (m) and slopes w_x and w_y at nodes,
    so that entries of K are in N/m and those of M in kg, with factors of m for slopes.
    """

    #: Stiffness matrix, shape (dofs, dofs).
    K: csr_array
    #: Consistent mass matrix, shape (dofs, dofs).
    M: csr_array
    #: Singular dynamic mass matrix B^T C^-1 B, shape (dofs, dofs).
    M_singular: csr_array
    #: Momenta of the cells per velocity of the dofs, in kg, shape (cells, dofs).
    B: csr_array
    #: Masses of the cells, in kg, one per row of B.
    C: NDArray[np.float64]
    #: Rows of the constraints: deflections at nodes that face an obstacle, shape (bounds, dofs).
    G: csr_array
    #: Load of ``initial.static_pressure``, or of the constant part of ``[load]``, in N.
    load: NDArray[np.float64]
    #: Lower bounds, in m, one per row of G, -inf where there is none; None without supports.
    lower: NDArray[np.float64] | None
    #: Upper bounds, in m, one per row of G, inf where there is none; None without supports.
    upper: NDArray[np.float64] | None

    def __repr__(self) -> str:
        (bounds, dofs), cells = self.G.shape, len(self.C)
        return f"<rebond.Matrices: {dofs} dofs, {cells} cells, {bounds} bounds>"


@dataclass(frozen=True, repr=False)
class Modes:
    """Lowest natural modes, ascending."""

    #: Frequencies, in Hz, 0 for a rigid motion.
    frequencies: NDArray[np.float64]
    #: Shapes with a modal mass of 1 kg, shape (modes, dofs).
    shapes: NDArray[np.float64]

    #: Model of the modes.
    model: Model = field(repr=False, compare=False)

    def __len__(self) -> int:
        return len(self.frequencies)

    def plot(self) -> Any:
        """Draw the shapes with their nodal lines by matplotlib, and return the figure."""
        return plots.modes(self.model, self)

    def __repr__(self) -> str:
        shown = ", ".join(f"{frequency:.4g}" for frequency in self.frequencies[:6])
        dots = ", ..." if len(self) > 6 else ""
        return f"<rebond.{type(self).__name__}: {len(self)} modes, {shown}{dots} Hz>"


@dataclass(frozen=True, repr=False)
class MassModes(Modes):
    """Modes that carry the mass of a scene with ``time.mass = "modal"``, ascending.

    Its mass matrix is ``momenta.T @ momenta``.
    """

    #: Products of the consistent mass and the shapes, in kg, shape (modes, dofs).
    momenta: NDArray[np.float64]


def keep_modes(folder: str | os.PathLike[str] | None = None) -> Path | None:
    """Keep the modes of scenes with ``time.mass = "modal"`` between runs, and return the folder.

    All models and runs of this process do so from now on, in ``folder``, or by default where the
    command keeps them: in ``$REBOND_CACHE``, or in ``~/.cache/rebond``. An empty name keeps none,
    as at the start. Results are the same to the last bit.
    """
    return _core.keep_modes(None if folder is None else os.fspath(folder))


def in_triangles(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return cells of 3 or 4 corners cut into triangles, shape (triangles, 3)."""
    if cells.shape[1] == 3:
        return cells
    quadrilaterals = cells[:, 3] >= 0
    return np.concatenate([cells[:, :3], cells[quadrilaterals][:, [0, 2, 3]]])


class _Numbers(TypedDict):
    """Numbers that native code gives of a layout."""

    nodes: NDArray[np.float64]
    cells: NDArray[np.int64]
    dofs: NDArray[np.int64]
    factors: NDArray[np.float64]
    bounded_dofs: NDArray[np.int64]
    bounded_nodes: NDArray[np.int64]
    count: int


class Layout:
    """Mesh, dofs and bounds of a model."""

    _native: Union[_core.Model, _core.Simulation]

    @cached_property
    def _layout(self) -> _Numbers:
        numbers: _Numbers = self._native.layout()
        return numbers

    @property
    def dofs(self) -> int:
        """Number of dofs that the supports leave free, the length of a displacement."""
        return self._layout["count"]

    @property
    def nodes(self) -> NDArray[np.float64]:
        """Positions x and y of the nodes, in m, shape (nodes, 2)."""
        return self._layout["nodes"]

    @property
    def cells(self) -> NDArray[np.int64]:
        """Nodes of the cells, counter-clockwise, shape (cells, 3 or 4).

        -1 stands in place of the fourth node of a triangle among quadrilaterals.
        """
        return self._layout["cells"]

    @property
    def triangles(self) -> NDArray[np.int64]:
        """Cells cut into triangles, shape (triangles, 3), as matplotlib draws them."""
        return in_triangles(self.cells)

    @property
    def node_dofs(self) -> NDArray[np.int64]:
        """Dofs of w, w_x and w_y at the nodes, shape (nodes, 3); -1 where a support holds them."""
        return self._layout["dofs"]

    @property
    def bounded_dofs(self) -> NDArray[np.int64]:
        """Dofs that face an obstacle, one per bound: the rows of G."""
        return self._layout["bounded_dofs"]

    @property
    def bounded_nodes(self) -> NDArray[np.int64]:
        """Nodes that face an obstacle, one per bound."""
        return self._layout["bounded_nodes"]

    @property
    def warnings(self) -> list[str]:
        """Warnings on the scene, one sentence each."""
        return self._native.warnings()

    def at_nodes(self, u: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return w, w_x and w_y at the nodes of displacements ``u``, shape (..., nodes, 3).

        ``u`` has the shape (..., dofs). Held values are 0; where supports move, values are
        relative to the motion that the supports give the plate.
        """
        u = np.asarray(u, dtype=np.float64)
        if u.ndim == 0 or u.shape[-1] != self.dofs:
            raise UsageError(f"u: found the shape {u.shape}; expected (..., {self.dofs})")
        held = self.node_dofs < 0
        values = u[..., np.where(held, 0, self.node_dofs)] * self._layout["factors"]
        shape: NDArray[np.float64] = np.where(held, 0.0, values)
        return shape

    def at_point(self, x: float, y: float) -> NDArray[np.float64]:
        """Return the weights a of the dofs in the deflection at a point (m), shape (dofs,).

        ``a @ u`` is the deflection at the point, and ``f * a`` the load of a force f (N) there.
        """
        return self._native.at_point(x, y)


class Model(Layout):
    """Semi-discrete model of a scene."""

    _native: _core.Model

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self._native = _core.Model(scene._native)

    def matrices(self, supported: bool = True) -> Matrices:
        """Assemble the matrices.

        They are those over the dofs that supports leave free, or, with ``supported=False``, over
        all dofs, three per node in the order of the nodes.
        """
        from scipy.sparse import csr_array

        found = self._native.matrices(supported)

        def sparse(name: str) -> csr_array:
            values, rows, columns, shape = found[name]
            matrix = csr_array((values, (rows, columns)), shape=shape)
            matrix.sum_duplicates()
            return matrix

        names = ("K", "M", "M_singular", "B", "G")
        return Matrices(
            **{name: sparse(name) for name in names},
            C=found["C"],
            load=found["load"],
            lower=found.get("lower"),
            upper=found.get("upper"),
        )

    def modes(self, count: int, mass: str = "scene") -> Modes:
        """Return the ``count`` lowest natural modes, or fewer if there are no more.

        ``mass`` is ``"consistent"``, ``"singular"``, or ``"scene"`` for that of ``time.mass``. A
        modal mass has no more modes than the scene gives it: asking for more is warned of.
        """
        if count < 1:
            raise UsageError(f"modes: found {count}; expected a count of at least 1")
        frequencies, shapes = self._native.modes(count, mass)
        carriers = len(frequencies)
        is_modal = mass == "scene" and self.scene.to_dict()["time"]["mass"] == "modal"
        if carriers < count and is_modal:
            what = f"modes({count}): the modal mass of the scene has {carriers} modes"
            warnings.warn(f'{what}; mass="consistent" gives more', UserWarning, stacklevel=2)
        return Modes(frequencies, shapes, self)

    def mass_modes(self) -> MassModes:
        """Return the modes that carry the mass of the scene, whose ``time.mass`` is ``"modal"``."""
        frequencies, shapes, momenta = self._native.mass_modes()
        return MassModes(frequencies, shapes, self, momenta)

    def __repr__(self) -> str:
        return f"<rebond.Model of {self.scene.title or self.scene.file!r}: {self.dofs} dofs>"
