"""Whole runs beside those of the command."""

from __future__ import annotations

import copy
import csv
import json
import os
import signal
import sys
import threading
import time
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import rebond
from conftest import FALL
from rebond.progress import Line

Command = Callable[..., Any]


def read(path: Path) -> dict[str, list[float]]:
    """Return the columns of a table."""
    with path.open() as file:
        head, *rows = csv.reader(file)
    return {name: [float(row[i]) for row in rows] for i, name in enumerate(head)}


def assert_equal(table: rebond.Table, path: Path) -> None:
    """Assert that a table has the columns of a file, to the last bit."""
    expected = read(path)
    assert list(table) == list(expected)
    for name, values in expected.items():
        assert table[name].tolist() == values, name


def test_a_run_equals_that_of_the_command(command: Command, fall_file: Path, tmp_path: Path) -> None:
    done = command("run", fall_file, "--quiet", "--out", tmp_path / "command")
    assert done.returncode == 0, done.stderr
    run = rebond.run(rebond.Scene(fall_file))
    assert run.finished and run.folder is None
    assert_equal(run.history, tmp_path / "command" / "history.csv")
    assert run.history["step"].dtype == np.int64
    assert run.history["contact_nodes"].max() > 0
    contacts = read(tmp_path / "command" / "contacts.csv")
    assert run.contacts.rows == len(contacts["node"]) > 0
    for name, values in contacts.items():
        if name in run.contacts:
            assert run.contacts[name].tolist() == values, name
    summary = json.loads((tmp_path / "command" / "summary.json").read_text())
    assert list(summary) == list(run.summary)
    for key in ("status", "scene_hash", "energy", "first_impact", "forces", "contacts", "warnings"):
        assert run.summary[key] == summary[key], key
    assert list(run.probes) == ["corner", "middle"]
    assert run.probes["corner"] is run.history["corner"]


def test_a_run_warns_of_what_it_finds(command: Command, fall_file: Path, tmp_path: Path) -> None:
    steep = ["load.pressure=30000*exp(-t)", "initial.static_pressure=0", "obstacle.0.height=-10"]
    scene = rebond.Scene(fall_file).set(*steep)
    options = [word for change in steep for word in ("--set", change)]
    assert command("run", fall_file, *options, "--quiet", "--out", tmp_path / "run").returncode == 0
    expected = json.loads((tmp_path / "run" / "summary.json").read_text())["warnings"]
    assert expected[-1].startswith("the largest deflection is "), expected
    assert rebond.run(scene).summary["warnings"] == expected


def test_a_run_folder_equals_that_of_the_command(
    command: Command, fall_file: Path, tmp_path: Path
) -> None:
    scene = rebond.Scene(fall_file)
    run = rebond.run(scene, out=tmp_path / "python")
    assert run.folder == str(tmp_path / "python")
    assert command("run", fall_file, "--quiet", "--out", tmp_path / "command").returncode == 0

    def files(folder: Path) -> dict[str, bytes]:
        found = (path for path in folder.rglob("*") if path.is_file())
        return {str(path.relative_to(folder)): path.read_bytes() for path in found}

    own, expected = files(tmp_path / "python"), files(tmp_path / "command")
    assert sorted(own) == sorted(expected)
    # Wall times differ.
    assert [name for name in own if own[name] != expected[name]] == ["summary.json"]
    # The same scene may replace its own results, another may not.
    rebond.run(scene, out=tmp_path / "python")
    other = scene.set("time.end=0.01")
    words = "of another scene .*: out= names another folder, overwrite=True replaces them$"
    with pytest.raises(rebond.UsageError, match=words):
        rebond.run(other, out=tmp_path / "python")
    assert rebond.run(other, out=tmp_path / "python", overwrite=True).history.rows == 11


def test_every_step_is_told(fall: rebond.Scene) -> None:
    steps: list[rebond.RunStep] = []
    run = rebond.run(fall, on_step=steps.append)
    assert [step.step for step in steps] == list(range(801))
    assert [step.time for step in steps][::400] == pytest.approx([0, 0.04, 0.08], rel=1e-14)
    rows = [step.row for step in steps if step.row is not None]
    assert len(rows) == run.history.rows == 81
    for name in run.history:
        assert [row[name] for row in rows] == run.history[name].tolist(), name
    touching = [step.contact_nodes for step in steps][::10]
    assert touching == run.history["contact_nodes"].tolist()


def test_a_run_stops_where_it_is_told_and_resumes(
    command: Command, fall_file: Path, tmp_path: Path
) -> None:
    scene = rebond.Scene(fall_file)
    run = rebond.run(scene, out=tmp_path / "run", on_step=lambda step: step.step == 555)
    assert not run.finished
    assert run.summary["status"].startswith("interrupted at step 555")
    assert run.history["step"][-1] == 550
    assert list((tmp_path / "run").glob("checkpoint-*.bin"))
    words = r'an unfinished run: rebond.resume\(".*run"\) goes on with it, overwrite=True starts over$'
    with pytest.raises(rebond.UsageError, match=words):
        rebond.run(scene, out=tmp_path / "run")
    assert command("resume", tmp_path / "run", "--quiet").returncode == 0
    assert_equal(rebond.run(scene).history, tmp_path / "run" / "history.csv")


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a run folder, except the summary with its seconds."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != "summary.json")
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def assert_same(own: rebond.Run, expected: rebond.Run) -> None:
    """Assert that the tables of two runs are equal to the last bit."""
    for name in ("history", "probes", "contacts", "events"):
        table = getattr(expected, name)
        assert list(getattr(own, name)) == list(table), name
        for column in table:
            assert getattr(own, name)[column].dtype == table[column].dtype, column
            assert getattr(own, name)[column].tolist() == table[column].tolist(), column


@pytest.mark.parametrize("change", ["time.scheme=newmark", "time.scheme=exact"])
def test_a_resumed_run_equals_an_undisturbed_one(
    fall_file: Path, tmp_path: Path, change: str
) -> None:
    scene = rebond.Scene(fall_file).set(change, "mesh.cells=[3, 1]")
    whole = rebond.run(scene, out=tmp_path / "whole")
    assert whole.contacts.rows + whole.events.rows > 0
    rebond.run(scene, out=tmp_path / "run", on_step=lambda step: step.step == 555)
    told: list[rebond.RunStep] = []
    run = rebond.resume(tmp_path / "run", on_step=told.append)
    assert run.finished and run.folder == str(tmp_path / "run")
    assert (told[0].step, told[-1].step) == (556, 800)
    assert [step.row for step in told if step.row][-1]["corner"] == run.history["corner"][-1]
    assert_same(run, whole)
    assert contents(tmp_path / "run") == contents(tmp_path / "whole")
    assert run.fields.time.tolist() == whole.fields.time[2:].tolist()
    assert run.scene.to_dict() == scene.to_dict()


def test_a_finished_run_goes_on_to_a_later_end(
    command: Command, fall_file: Path, tmp_path: Path
) -> None:
    scene = rebond.Scene(fall_file)
    rebond.run(scene.set("time.end=0.04"), out=tmp_path / "run")
    run = rebond.resume(tmp_path / "run", until=0.08)
    assert run.scene.end == 0.08
    assert_same(run, rebond.run(scene, out=tmp_path / "whole"))
    assert contents(tmp_path / "run") == contents(tmp_path / "whole")
    for until in (None, 0.05):
        words = [] if until is None else ["--until", until]
        said = command("resume", tmp_path / "run", *words).stderr
        # Python has its own words for the options of the command.
        place = tmp_path / "run"
        said = said.replace(f"`rebond resume {place} --until T`", f'rebond.resume("{place}", until=T)')
        said = said.replace("--until ", "until=")
        with pytest.raises(rebond.Error) as caught:
            rebond.resume(tmp_path / "run", until=until)
        assert said == f"rebond: {caught.value}\n"
    with pytest.raises(rebond.FileError, match="nowhere"):
        rebond.resume(tmp_path / "nowhere")


def test_a_damaged_checkpoint_is_warned_of(fall_file: Path, tmp_path: Path) -> None:
    scene = rebond.Scene(fall_file).set("output.checkpoint_every=200", "time.end=0.05")
    rebond.run(scene, out=tmp_path / "run", on_step=lambda step: step.step == 450)
    newest = max((tmp_path / "run").glob("checkpoint-*.bin"))
    newest.write_bytes(newest.read_bytes()[:-1])
    with pytest.warns(RuntimeWarning, match=f"{newest.name}.*; went on from the one before"):
        run = rebond.resume(tmp_path / "run")
    assert_same(run, rebond.run(scene))


def test_an_exception_stops_the_run(fall: rebond.Scene) -> None:
    last = []

    def fail(step: rebond.RunStep) -> None:
        last.append(step.step)
        if step.step == 7:
            raise LookupError("not this step")

    with pytest.raises(LookupError, match="not this step"):
        rebond.run(fall, on_step=fail)
    assert last[-1] == 7


@pytest.mark.parametrize("to_file", [False, True])
def test_ctrl_c_interrupts_a_run(fall: rebond.Scene, tmp_path: Path, to_file: bool) -> None:
    endless = fall.set("time.end=1e6", "output.every=1000000")
    out = tmp_path / "run" if to_file else None
    began = threading.Event()

    def interrupt() -> None:
        # Python's lock is free while the run goes on, or this thread would never get there.
        if out is None:
            began.wait()
        while out is not None and not (out / "history.csv").exists():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)

    other = threading.Thread(target=interrupt)
    other.start()
    with pytest.raises(KeyboardInterrupt):
        # The first run is interrupted in Python or beside it, the second in native code.
        rebond.run(endless, out=out, on_step=None if to_file else lambda _: began.set())
    other.join()
    if out is not None:
        assert list(out.glob("checkpoint-*.bin"))
        status = json.loads((out / "summary.json").read_text())["status"]
        assert status.startswith("interrupted at step")


def test_runs_of_several_threads_do_not_disturb_each_other(fall: rebond.Scene) -> None:
    ends = [0.02, 0.03, 0.04]
    found: dict[float, rebond.Run] = {}

    def work(end: float) -> None:
        found[end] = rebond.run(fall.set({"time.end": end}))

    threads = [threading.Thread(target=work, args=(end,)) for end in ends]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    longest = found[0.04].history["energy"]
    for end in ends:
        energy = found[end].history["energy"]
        assert energy.tolist() == longest[: len(energy)].tolist()


def test_fields_are_those_of_the_displacements(fall: rebond.Scene) -> None:
    run = rebond.run(fall)
    fields = run.fields
    assert fields.time == pytest.approx([0, 0.04, 0.08])
    assert fields.step.tolist() == [0, 400, 800]
    simulation = rebond.Simulation(fall)
    for snapshot, step in enumerate(fields.step):
        if step > 0:
            simulation.step(400)
        nodes = simulation.at_nodes(simulation.displacement)
        count = len(simulation.nodes)
        assert np.array_equal(fields.points[:count], simulation.nodes)
        assert fields.deflection[snapshot, :count] == pytest.approx(nodes[:, 0], abs=1e-13)
        assert fields["slope"][snapshot, :count] == pytest.approx(nodes[:, 1:], abs=1e-12)
        reactions = np.zeros(count)
        reactions[simulation.bounded_nodes] = simulation.reactions
        assert fields["reaction"][snapshot, :count] == pytest.approx(reactions, rel=1e-9)
    assert (fields["gap"] > -1e-9).all()
    # The small cells cover the plate, counter-clockwise.
    corners = fields.points[fields.triangles]
    (ax, ay), (bx, by) = (corners[:, k].T - corners[:, 0].T for k in (1, 2))
    areas = 0.5 * (ax * by - ay * bx)
    assert areas.min() > 0 and areas.sum() == pytest.approx(1.2 * 0.4)
    assert sorted(set(fields.parents)) == list(range(12))
    for name in fields.names:
        assert getattr(fields, name) is fields[name] and name in dir(fields), name
    assert {"gap", "reaction", "slope", "floor", "cell_velocity"} <= set(fields.names)
    words = "^the scene has no field 'von_mises'; there are deflection, velocity, .*, reaction$"
    with pytest.raises(KeyError, match="no field 'von_mises'; there are .*deflection"):
        fields["von_mises"]
    with pytest.raises(AttributeError, match=words):
        fields.von_mises
    assert not hasattr(fields, "ceiling") and "ceiling" not in dir(fields)
    assert copy.copy(fields).gap is fields.gap
    silent = rebond.run(fall.set({"time.end": 1e-3, "output": {"probes": []}}))
    assert len(silent.probes) == 0


def test_events_of_the_exact_scheme(fall: rebond.Scene) -> None:
    exact = fall.set("mesh.cells=[3, 1]", "time.scheme=exact")
    run = rebond.run(exact)
    events = run.events
    assert events.rows == run.summary["events"] > 0
    assert events["closes"][0] and events["time"][0] == run.summary["first_impact"]["time"]
    assert (np.diff(events["time"]) >= 0).all()
    # Between events nothing is lost.
    energy = run.history["energy"]
    assert energy.max() / energy.min() - 1 < 1e-9
    with pytest.raises(KeyError, match="no column 'tip'; there are step, time"):
        run.history["tip"]


def names(figure: Any) -> list[list[str]]:
    """Return what the legends of a figure say."""
    return [[text.get_text() for text in axis.get_legend().get_texts()] for axis in figure.axes]


def test_a_driven_run_is_drawn_as_by_the_command(fall: rebond.Scene) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    probes = "[{ name = 'tip', at = [1.2, 0] }, { name = 'speed', at = [1.2, 0], quantity = 'velocity' }]"
    stop = "obstacle=[{ side = 'below', height = -2e-3, at = [1.2, 0], name = 'bumper' }]"
    far = "[{ side = 'below', height = -1, name = 'floor' }]"
    shock = "load.base_acceleration=50*sin(200*t)"
    changes = ("initial.static_pressure=0", shock, f"output.probes={probes}", "damping.mass=20")
    run = rebond.run(fall.set(stop, *changes))
    figure = run.plot()
    labels = ["deflection (mm)", "velocity (m/s)", "energy (J)", "since the start (J)"]
    assert [axis.get_ylabel() for axis in figure.axes] == labels
    whole = ["kinetic + elastic", "elastic", "kinetic"]
    assert names(figure) == [["tip", "bumper"], ["speed"], whole, ["put in", "lost"]]
    history = run.history
    stored, put_in, lost = (
        next(line.get_ydata() for line in axis.get_lines() if line.get_label() == label)
        for axis, label in zip(figure.axes[2:3] + figure.axes[3:] * 2, ("kinetic + elastic", "put in", "lost"))
    )
    assert stored == pytest.approx(history["kinetic"] + history["elastic"])
    assert stored == pytest.approx(put_in - lost) and stored.min() >= 0 and lost[-1] > 0
    # Legends stand beside the panels.
    figure.canvas.draw()
    for axis in figure.axes:
        assert axis.get_legend().get_window_extent().x0 >= axis.get_window_extent().x1
    # A stop far from all curves would flatten them.
    still = rebond.run(fall.set(f"obstacle={far}", *changes)).plot()
    assert names(still)[0] == ["tip"]
    pyplot.close("all")


def test_a_file_runs_and_is_drawn(tmp_path: Path) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    (tmp_path / "fall.toml").write_text(FALL)
    run = rebond.run(tmp_path / "fall.toml")
    assert run.finished and run.summary["largest_deflection"]["value"] > 0.2
    figure = run.plot()
    assert [axis.get_ylabel() for axis in figure.axes] == ["deflection (mm)", "energy (J)"]
    assert names(figure) == [["corner", "middle", "obstacle"], ["energy", "elastic", "kinetic"]]
    assert figure.axes[-1].get_xlabel() == "time (ms)"
    modes = rebond.Model(run.scene).modes(4)
    assert repr(modes).startswith("<rebond.Modes: 4 modes, 5.9") and repr(modes).endswith(" Hz>")
    figure = modes.plot()
    assert [axis.get_title() for axis in figure.axes[:4]] == [f"{f:.4g} Hz" for f in modes.frequencies]
    pyplot.close("all")


@pytest.mark.parametrize(("backend", "open_figures"), [("agg", 1), ("inline", 0)])
def test_a_notebook_shows_a_figure_once(
    fall: rebond.Scene, monkeypatch: pytest.MonkeyPatch, backend: str, open_figures: int
) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    pyplot.switch_backend("Agg")
    pyplot.close("all")
    # A notebook shows the value of a cell, and at its end all figures that are open.
    monkeypatch.setattr(pyplot, "get_backend", lambda: backend)
    for draw in (rebond.run(fall.set("time.end=0.001")).plot, rebond.Model(fall).modes(2).plot):
        assert draw().axes and len(pyplot.get_fignums()) == open_figures
        pyplot.close("all")


class StandIn:
    """Unstructured grid of pyvista as far as fields use it."""

    def __init__(self, cells: Any, kinds: Any, points: Any) -> None:
        self.cells, self.kinds, self.points = cells, kinds, points
        self.point_data: dict[str, Any] = {}
        self.cell_data: dict[str, Any] = {}


def test_fields_become_a_grid_of_pyvista(
    fall: rebond.Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    fields = rebond.run(fall).fields
    stand_in = types.SimpleNamespace(UnstructuredGrid=StandIn)
    monkeypatch.setitem(sys.modules, "pyvista", stand_in)
    grid = fields.to_pyvista()
    assert np.array_equal(grid.points[:, :2], fields.points) and not grid.points[:, 2].any()
    for name in ("deflection", "velocity", "slope"):
        assert np.array_equal(grid.point_data[name], fields[name][-1]), name
    assert "cell_velocity" not in grid.point_data
    # Each cell is its number of corners, and the corners; 9 is VTK's quadrilateral.
    assert set(grid.kinds) == {9} and len(grid.cells) == 5 * len(fields.cells)
    assert np.array_equal(grid.cells.reshape(-1, 5)[:, 1:], fields.cells)
    assert np.array_equal(fields.to_pyvista(0).point_data["deflection"], fields.deflection[0])
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(ImportError, match="to_pyvista needs pyvista: pip install pyvista"):
        fields.to_pyvista()
    monkeypatch.setitem(sys.modules, "pyvista", stand_in)
    without = FALL.replace("output.fields_every = 400\n", "")
    silent = rebond.run(rebond.Scene.from_text(without).set("time.end=1e-3")).fields
    words = "the scene asks for no snapshots; set output.fields_every$"
    with pytest.raises(rebond.UsageError, match=f"^to_pyvista: {words}"):
        silent.to_pyvista()
    with pytest.raises(AttributeError, match=f"^gap: {words}"):
        silent.gap


def test_the_grid_of_pyvista_has_the_area_of_the_plate(fall: rebond.Scene) -> None:
    pytest.importorskip("pyvista")
    for element in ("fvs", "hct"):
        grid = rebond.run(fall.set(f'mesh.element="{element}"')).fields.to_pyvista()
        assert grid.area == pytest.approx(1.2 * 0.4)
        assert grid.bounds[:4] == pytest.approx((0, 1.2, 0, 0.4))
        assert grid["slope"].shape == (grid.n_points, 2)


def test_a_run_shows_its_progress(
    fall: rebond.Scene, capsys: pytest.CaptureFixture[str]
) -> None:
    steps: list[rebond.RunStep] = []
    told = rebond.run(fall, on_step=steps.append, progress=True)
    assert len(steps) == fall.steps + 1
    first, *_, last = capsys.readouterr().err.strip("\r\n").split("\r")
    assert first == "  0 %, t = 0 s, 0 nodes touch" and last.startswith("ended after ")
    line = Line(1000)
    line.show(230, 0.0092, 1)
    assert capsys.readouterr().err == "\r 23 %, t = 9.2 ms, 0 s left, 1 node touches"
    quiet = rebond.run(fall, progress=True)
    assert quiet.history["energy"].tolist() == told.history["energy"].tolist()

    def fail(_: rebond.RunStep) -> None:
        raise LookupError

    with pytest.raises(LookupError):
        rebond.run(fall, on_step=fail, progress=True)
    assert "\rstopped after " in capsys.readouterr().err
