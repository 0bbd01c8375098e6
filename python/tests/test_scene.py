"""Scenes: changes of keys, and messages for whatever is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import rebond
from conftest import FALL, ROOT

BAD = sorted((ROOT / "tests" / "data" / "bad").glob("*.toml"))


def test_changes_of_every_kind_give_the_same_scene(fall: rebond.Scene) -> None:
    text = fall.set("time.end=0.2", "mesh.cells=[10, 4]", "obstacle.0.height=-0.1-x/100")
    mapping = fall.set(
        {"time.end": 0.2, "mesh.cells": (10, 4), "obstacle.0.height": "-0.1-x/100"}
    )
    tables = fall.set(time={"end": np.float64(0.2)}, mesh={"cells": np.array([10, 4])})
    tables = tables.set("obstacle.0.height=-0.1-x/100")
    assert text.resolved == mapping.resolved == tables.resolved
    assert text.resolved != fall.resolved
    assert (text.time_step, text.end, text.steps) == (1e-4, 0.2, 2000)
    assert text.to_dict()["mesh"]["cells"] == [10, 4]
    assert text.changes == ["time.end=0.2", "mesh.cells=[10, 4]", "obstacle.0.height=-0.1-x/100"]
    whole = {"name": "tip", "at": [1.2, 0.4]}
    assert fall.set({"output.probes": [whole]}).probes == ["tip"]
    assert fall.probes == ["corner", "middle"]
    assert "contact" in " ".join(fall.effects) or fall.effects


def test_a_file_is_read_like_its_text(fall: rebond.Scene, fall_file: Path) -> None:
    scene = rebond.Scene(fall_file)
    assert scene.resolved == fall.resolved
    assert scene.file == str(fall_file)
    assert "800 steps" in repr(scene)


@pytest.mark.parametrize("path", BAD, ids=lambda path: path.stem)
def test_a_bad_scene_has_the_message_of_the_command(path: Path) -> None:
    first = path.read_text(encoding="utf-8-sig", errors="replace").partition("\n")[0]
    parts = first.removeprefix("# expect: ").split(" | ")
    with pytest.raises(rebond.SceneError) as caught:
        rebond.Scene(path)
    message = str(caught.value)
    assert caught.value.exit_code == 2
    assert message.startswith(f"{path}:") and "\n" not in message
    assert [part for part in parts if part.strip() not in message] == []


def test_there_are_bad_scenes() -> None:
    assert len(BAD) > 200


def test_messages_name_the_change(fall: rebond.Scene) -> None:
    with pytest.raises(rebond.SceneError, match="^set: time.stop=1: time.stop: unknown key"):
        fall.set("time.stop=1")
    with pytest.raises(rebond.SceneError, match=r"^set: time.step=0.0: .*greater than 0"):
        fall.set({"time.step": 0.0})
    with pytest.raises(rebond.SceneError, match="time.step"):
        fall.set({"time.step": float("nan")})
    with pytest.raises(rebond.UsageError, match="time.step: found object; expected a number"):
        fall.set({"time.step": object()})
    with pytest.raises(rebond.UsageError, match="set: found int"):
        fall.set(3)  # type: ignore[arg-type]
    with pytest.raises(rebond.SceneError, match=r"^fall.toml:\d+:\d+: "):
        rebond.Scene.from_text(FALL.replace("density = 7770.0", "density = -1"), "fall.toml")


def test_each_kind_of_error_has_its_class(fall: rebond.Scene, tmp_path: Path) -> None:
    with pytest.raises(rebond.FileError, match="none.toml: there is no such file") as caught:
        rebond.Scene(tmp_path / "none.toml")
    assert isinstance(caught.value, OSError) and caught.value.exit_code == 4
    with pytest.raises(rebond.UsageError, match='this build has no "petsc"') as wrong:
        rebond.run(fall.set("solver.engine=petsc"))
    assert isinstance(wrong.value, ValueError) and wrong.value.exit_code == 2
    loose = fall.set({"support": [], "obstacle": []})
    with pytest.raises(rebond.SceneError, match="rigid|mechanism") as singular:
        rebond.Model(loose)
    assert singular.value.exit_code == 2
    # The midpoint rule with the consistent mass multiplies the energy at impacts.
    wild = fall.set("time.scheme=midpoint", "time.mass=consistent", "solver.energy_guard=1.0001")
    with pytest.raises(rebond.EnergyError, match="past the guard of 1.0001") as energy:
        rebond.run(wild)
    assert energy.value.exit_code == 5


def test_a_panic_is_an_exception_of_one_line() -> None:
    with pytest.raises(rebond.InternalError, match="^internal error, please report it: two lines$"):
        rebond._core.panic("two\nlines")
