"""Matrices and modes beside exact numbers and another program's eigenvalues."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array, diags_array
from scipy.sparse.linalg import eigsh, spsolve

import rebond


def supported(cells: tuple[int, int], element: str = "fvs") -> rebond.Scene:
    """Return a steel plate whose edges are all simply supported."""
    edges = ("left", "right", "bottom", "top")
    supports = ", ".join(f'{{ edge = "{edge}", kind = "simply_supported" }}' for edge in edges)
    return rebond.Scene.from_text(
        f"""
        support = [{supports}]
        mesh = {{ element = "{element}", cells = {list(cells)} }}
        time = {{ scheme = "newmark", mass = "consistent", step = 1e-5, end = 1e-3 }}
        plate = {{ length = 0.6, width = 0.4, thickness = 2e-3, youngs_modulus = 210e9, poissons_ratio = 0.3, density = 7800 }}
        """,
        "supported.toml",
    )


def exact(count: int) -> np.ndarray:
    """Return the lowest frequencies (Hz) of the supported plate by Navier's solution."""
    rigidity = 210e9 * 2e-3**3 / (12 * (1 - 0.3**2))
    m, n = np.meshgrid(np.arange(1, 9), np.arange(1, 9))
    squares = (m / 0.6) ** 2 + (n / 0.4) ** 2
    return np.sort(np.pi / 2 * squares.ravel() * np.sqrt(rigidity / (7800 * 2e-3)))[:count]


@pytest.mark.parametrize("element", ["fvs", "hct"])
def test_frequencies_of_a_supported_plate(element: str) -> None:
    errors = []
    for cells in ((6, 4), (12, 8), (24, 16)):
        modes = rebond.Model(supported(cells, element)).modes(5)
        errors.append(modes.frequencies / exact(5) - 1)
    # Frequencies of conforming elements with their own mass are upper bounds.
    assert (np.array(errors) > 0).all()
    assert errors[-1].max() < 6e-3
    orders = np.log2(errors[1] / errors[2])
    assert (orders > 1.7).all(), orders


@pytest.mark.parametrize("mass", ["consistent", "singular"])
def test_matrices_have_the_modes_of_the_model(mass: str) -> None:
    model = rebond.Model(supported((6, 4)))
    matrices = model.matrices()
    m = matrices.M if mass == "consistent" else matrices.M_singular
    assert isinstance(matrices.K, csr_array) and matrices.K.shape == (model.dofs, model.dofs)
    modes = model.modes(4, mass)
    # With K = L L^T, the matrix L^-1 M L^-T has the inverse squares; the mass may be singular.
    lower = np.linalg.cholesky(matrices.K.toarray())
    half = np.linalg.solve(lower, m.toarray())
    squares = np.linalg.eigvalsh(np.linalg.solve(lower, half.T))
    frequencies = 1 / (2 * np.pi * np.sqrt(squares[::-1][:4]))
    assert modes.frequencies == pytest.approx(frequencies, rel=1e-8)
    if mass == "consistent":
        squares = eigsh(matrices.K, 4, M=m, sigma=0, return_eigenvectors=False)
        assert modes.frequencies == pytest.approx(np.sqrt(np.sort(squares)) / (2 * np.pi), rel=1e-8)
    for shape, frequency in zip(modes.shapes, modes.frequencies):
        assert shape @ (m @ shape) == pytest.approx(1, rel=1e-9)
        residual = matrices.K @ shape - (2 * np.pi * frequency) ** 2 * (m @ shape)
        assert np.abs(residual).max() < 1e-6 * np.abs(matrices.K @ shape).max()


def test_the_singular_mass_is_that_of_its_cells(fall: rebond.Scene) -> None:
    matrices = rebond.Model(fall).matrices(supported=False)
    product = matrices.B.T @ diags_array(1 / matrices.C) @ matrices.B
    assert np.abs((product - matrices.M_singular).toarray()).max() < 1e-12
    # A plate that rises as one has its whole mass, with both matrices; its slopes have none.
    mass = 1.2 * 0.4 * 0.01 * 7770.0
    rise = np.zeros(matrices.K.shape[0])
    rise[::3] = 1
    for m in (matrices.M, matrices.M_singular):
        assert rise @ (m @ rise) == pytest.approx(mass, rel=1e-13)
    assert matrices.C.sum() == pytest.approx(mass, rel=1e-13)
    assert np.abs(matrices.K @ rise).max() < 1e-4
    assert matrices.load[::3].sum() == pytest.approx(14600 * 1.2 * 0.4, rel=1e-13)
    assert matrices.lower is None and matrices.upper is None


def test_constraints_are_those_of_the_obstacle(fall: rebond.Scene) -> None:
    model = rebond.Model(fall)
    matrices = model.matrices()
    assert matrices.G.shape == (len(model.bounded_dofs), model.dofs)
    assert (matrices.G @ np.arange(model.dofs)).tolist() == model.bounded_dofs.tolist()
    assert matrices.lower is not None and (matrices.lower == -0.1).all()
    assert matrices.upper is not None and np.isinf(matrices.upper).all()
    assert repr(matrices) == "<rebond.Matrices: 54 dofs, 12 cells, 18 bounds>"
    # The clamped nodes are in no reach of the floor.
    free = np.flatnonzero(model.node_dofs[:, 0] >= 0)
    assert model.bounded_nodes.tolist() == free.tolist()
    assert model.cells.shape == (12, 4) and model.nodes.max(axis=0).tolist() == [1.2, 0.4]
    assert any("mass" in warning or "step" in warning for warning in model.warnings) or model.warnings == []


def test_the_static_start_is_in_equilibrium(fall: rebond.Scene) -> None:
    matrices = rebond.Model(fall).matrices()
    simulation = rebond.Simulation(fall.set("obstacle.0.height=-10"))
    u = spsolve(matrices.K.tocsc(), matrices.load)
    assert simulation.displacement == pytest.approx(u, rel=1e-7)
    corner = simulation.at_point(1.2, 0.0)
    assert corner @ u == pytest.approx(simulation.last.probes["corner"], rel=1e-7)
    assert simulation.at_nodes(u)[6, 0] == pytest.approx(corner @ u, rel=1e-13)


def test_wrong_calls_are_told(fall: rebond.Scene) -> None:
    model = rebond.Model(fall)
    with pytest.raises(rebond.SceneError, match=r"the point \(2, 0\) lies outside the plate"):
        model.at_point(2.0, 0.0)
    with pytest.raises(rebond.UsageError, match='mass: found "light"'):
        model.modes(3, "light")
    with pytest.raises(rebond.UsageError, match="modes: found 0; expected a count of at least 1"):
        model.modes(0)
    with pytest.raises(rebond.UsageError, match=r"found the shape \(3,\); expected \(\.\.\., 54\)"):
        model.at_nodes(np.zeros(3))
    assert "dofs" in repr(model)


def test_the_modes_that_carry_a_modal_mass() -> None:
    scene = supported((12, 8)).set("time.mass=modal", "time.modes=9", "time.scheme=conserving")
    model = rebond.Model(scene)
    modes = model.mass_modes()
    assert len(modes) == 9 and modes.shapes.shape == modes.momenta.shape == (9, model.dofs)
    assert modes.frequencies == pytest.approx(exact(9), rel=3e-2)
    consistent = model.modes(9, mass="consistent")
    assert modes.frequencies == pytest.approx(consistent.frequencies, rel=1e-9)
    matrices = model.matrices()
    assert modes.momenta == pytest.approx((matrices.M @ modes.shapes.T).T, abs=1e-9)
    assert modes.momenta @ modes.shapes.T == pytest.approx(np.eye(9), abs=1e-10)
    stiffness = modes.shapes @ (matrices.K @ modes.shapes.T)
    squares = (2 * np.pi * modes.frequencies) ** 2
    assert stiffness == pytest.approx(np.diag(squares), abs=1e-7 * squares[-1])
    # No others have inertia.
    words = r'^modes\(100\): the modal mass of the scene has 9 modes; mass="consistent" gives more$'
    with pytest.warns(UserWarning, match=words):
        assert model.modes(100).frequencies.tolist() == modes.frequencies.tolist()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(model.modes(9)) == 9 and len(model.modes(12, "consistent")) == 12
    assert model.modes(2).shapes.tolist() == modes.shapes[:2].tolist()
    with pytest.raises(rebond.UsageError, match="mass_modes: .*; expected time.mass=modal"):
        rebond.Model(supported((4, 4))).mass_modes()


def test_kept_modes_come_back_to_the_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = supported((12, 8)).set("time.mass=modal", "time.modes=9", "time.scheme=conserving")
    before = rebond.Model(scene).mass_modes()
    try:
        assert rebond.keep_modes(tmp_path / "kept") == tmp_path / "kept"
        rebond.Model(scene)
        (file,) = (tmp_path / "kept").glob("modes-*.bin")
        written = file.stat().st_ino
        kept = rebond.Model(scene).mass_modes()
        assert file.stat().st_ino == written
        for name in ("frequencies", "shapes", "momenta"):
            assert np.array_equal(getattr(kept, name), getattr(before, name)), name
        monkeypatch.setenv("REBOND_CACHE", str(tmp_path / "command"))
        assert rebond.keep_modes() == tmp_path / "command"
        rebond.Model(scene)
        assert [path.name for path in (tmp_path / "command").iterdir()] == [file.name]
    finally:
        assert rebond.keep_modes("") is None


def lines(axis: Any) -> np.ndarray:
    """Return the points of the nodal lines in a picture of a mode."""
    from matplotlib.contour import ContourSet

    of_axis = [thing for thing in axis.get_children() if isinstance(thing, ContourSet)]
    paths = [path for contour in of_axis for path in contour.get_paths()]
    return np.concatenate([np.empty((0, 2)), *(path.vertices for path in paths)])


def test_nodal_lines_are_drawn_where_the_sign_changes() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    # Navier's modes have straight lines, here along edges of cells and between them.
    first, second, *_ = rebond.Model(supported((12, 8))).modes(4).plot().axes
    assert len(lines(first)) == 0
    x, y = lines(second).T
    assert x == pytest.approx(np.full(len(x), 0.3), abs=1e-3)
    assert y.min() < 0.02 and y.max() > 0.38 and len(x) > 10
    # Within a washer and along a clamped edge the plate is at rest.
    bolt = '{ at = [0.1, 0.1], radius = 0.04, kind = "clamped" }'
    edge = '{ edge = "right", kind = "clamped" }'
    scene = supported((24, 16)).set(f"support=[{bolt}, {edge}]")
    for axis in rebond.Model(scene).modes(6).plot().axes:
        points = lines(axis)
        assert np.hypot(*(points - [0.1, 0.1]).T).min(initial=1.0) > 0.03
        assert points[:, 0].max(initial=0.0) < 0.6 - 1e-3
    pyplot.close("all")
