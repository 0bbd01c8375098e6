"""The blocks of docs/python.md, the cells of the notebook, and the types of the native part."""

from __future__ import annotations

import ast
import json
import re
import shutil
from pathlib import Path

import pytest

import rebond
from conftest import FALL, ROOT

matplotlib = pytest.importorskip("matplotlib")


def execute(blocks: list[str], name: str) -> None:
    """Execute blocks of code one after another with the same names."""
    names: dict[str, object] = {"__name__": "__main__"}
    for number, block in enumerate(blocks, 1):
        exec(compile(block, f"{name}, block {number}", "exec"), names)


def test_the_blocks_of_the_page_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fall.toml").write_text(FALL)
    text = (ROOT / "docs" / "python.md").read_text()
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) >= 5
    execute(blocks, "docs/python.md")


def test_the_program_of_the_tutorial_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "scenes" / "new" / "bracket.msh", tmp_path)
    text = (ROOT / "docs" / "tutorial.md").read_text()
    fence = r"^```(?:toml|python) (>> )?(\S+)\n(.*?)^```"
    for appends, name, block in re.findall(fence, text, re.MULTILINE | re.DOTALL):
        with (tmp_path / name).open("a" if appends else "w") as file:
            file.write(block)
    execute([(tmp_path / "pins.py").read_text()], "pins.py")
    said = capsys.readouterr().out
    expected = re.findall(r"^python3 pins.py\n```\n\n```text\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(expected) == 1
    for line in expected[0].splitlines():
        assert line in said


#: Numbers in a text that a program prints.
NUMBER = r"[-+]?\d[\d.]*(?:e[-+]?\d+)?"


def test_the_notebook_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    notebook = json.loads((ROOT / "docs" / "python.ipynb").read_text())
    assert (notebook["nbformat"], notebook["nbformat_minor"]) >= (4, 5)
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    assert len(cells) >= 5
    # It has the outputs of scripts/notebook.py, which are those of any machine, and small.
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    outputs = [output for cell in cells for output in cell["outputs"]]
    pictures = [o["data"]["image/png"] for o in outputs if "image/png" in o.get("data", {})]
    assert len(pictures) >= 3 and sum(map(len, pictures)) < 100_000
    texts = [o.get("text") or o["data"]["text/plain"] for o in outputs]
    assert not any("/" in line for text in texts for line in text)
    assert all(cell["metadata"] == {} for cell in notebook["cells"])
    blocks = ["".join(cell["source"]) for cell in cells]
    assert sum("assert" in block for block in blocks) >= 3
    execute(blocks, "docs/python.ipynb")
    streams = [o["text"] for o in outputs if o["output_type"] == "stream"]
    kept, said = "".join(line for text in streams for line in text), capsys.readouterr().out
    assert re.sub(NUMBER, "", kept) == re.sub(NUMBER, "", said)
    numbers = [[float(number) for number in re.findall(NUMBER, text)] for text in (kept, said)]
    assert numbers[0] == pytest.approx(numbers[1], rel=1e-6, abs=1e-11)


def test_the_types_of_the_native_part_are_declared() -> None:
    core = rebond._core
    tree = ast.parse((Path(rebond.__file__).parent / "_core.pyi").read_text())
    declared: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            declared[node.name] = {
                item.name for item in node.body if isinstance(item, ast.FunctionDef)
            }
        elif isinstance(node, ast.FunctionDef):
            declared[node.name] = set()
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            declared[node.target.id] = set()
    found = {name for name in dir(core) if not name.startswith("_")}
    assert found == set(declared)
    for name, members in declared.items():
        kind = getattr(core, name)
        if isinstance(kind, type):
            own = {member for member in vars(kind) if not member.startswith("_")}
            assert own == members - {"__new__"}, name
    assert (Path(rebond.__file__).parent / "py.typed").exists()


def test_everything_that_is_public_is_documented() -> None:
    for name in rebond.__all__:
        if name != "__version__":
            thing = getattr(rebond, name)
            assert thing.__doc__, name
            for member, value in vars(thing).items() if isinstance(thing, type) else ():
                if not member.startswith("_") and (callable(value) or isinstance(value, property)):
                    assert value.__doc__, f"{name}.{member}"
    cargo = (ROOT / "Cargo.toml").read_text()
    assert f'version = "{rebond.__version__}"' in cargo
