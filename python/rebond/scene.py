"""Scenes: what is simulated."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Union

from . import _core
from .errors import UsageError

#: Value of a key: a number, a text or a formula, a truth value, or a list or table of these.
Value = Union[bool, int, float, str, Sequence[Any], Mapping[str, Any]]


class Scene:
    """Validated scene of a TOML file; it never changes, and :meth:`set` returns another.

    ``file`` is the path of the scene file.
    """

    _native: _core.Scene

    def __init__(self, file: str | os.PathLike[str]) -> None:
        self._native = _core.Scene.load(os.fspath(file))

    @classmethod
    def from_text(cls, text: str, file: str | os.PathLike[str] = "scene.toml") -> Scene:
        """Read a scene from TOML text.

        Messages call it ``file``; meshes and tables that it names are in the folder of ``file``.
        """
        return cls._of(_core.Scene.from_text(text, os.fspath(file)))

    @classmethod
    def _of(cls, native: _core.Scene) -> Scene:
        scene = cls.__new__(cls)
        scene._native = native
        return scene

    def set(self, *changes: str | Mapping[str, Value], **tables: Value) -> Scene:
        """Return the scene with some keys changed.

        A change is a text as after ``--set`` of the command, such as ``"time.end=0.2"``, or a
        mapping from keys to values, such as ``{"time.end": 0.2, "mesh.cells": [10, 4]}``. Keyword
        arguments are tables of the scene: ``time={"end": 0.2}`` changes ``time.end`` alone. Keys of
        arrays have an index: ``"obstacle.0.height"``.
        """
        texts: list[str] = []
        for change in changes:
            if isinstance(change, str):
                texts.append(change)
            elif isinstance(change, Mapping):
                texts.extend(f"{key}={_toml(value, key)}" for key, value in change.items())
            else:
                raise UsageError(
                    f'set: found {type(change).__name__}; expected "key=value" or a mapping'
                )
        for table, value in tables.items():
            texts.extend(f"{key}={_toml(value, key)}" for key, value in _leaves(table, value))
        return Scene._of(self._native.changed(texts))

    @property
    def title(self) -> str:
        """Title of the scene."""
        return self._native.title

    @property
    def file(self) -> str:
        """Path of the scene file, as it was given."""
        return self._native.file

    @property
    def changes(self) -> list[str]:
        """Changes made by :meth:`set`, each as ``key=value``, in their order."""
        return self._native.changes

    @property
    def effects(self) -> list[str]:
        """Names of the effects that the scene calls for."""
        return self._native.effects

    @property
    def time_step(self) -> float:
        """Length of a step, in s."""
        return self._native.time[0]

    @property
    def end(self) -> float:
        """End of the run, in s."""
        return self._native.time[1]

    @property
    def steps(self) -> int:
        """Number of steps to the end."""
        return self._native.time[2]

    @property
    def probes(self) -> list[str]:
        """Names of the probes."""
        return self._native.probes

    @property
    def resolved(self) -> str:
        """TOML text of the scene with every default filled in."""
        return self._native.resolved

    def to_dict(self) -> dict[str, Any]:
        """Return the resolved scene as nested dictionaries, lists, numbers and texts."""
        table: dict[str, Any] = json.loads(self._native.json)
        return table

    def __repr__(self) -> str:
        return f"<rebond.Scene {self.file!r}: {self.title or 'untitled'}, {self.steps} steps>"


def _leaves(key: str, value: Value) -> Iterator[tuple[str, Value]]:
    """Yield the dotted keys of nested mappings with their values."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _leaves(f"{key}.{name}", inner)
    else:
        yield key, value


def _toml(value: Any, key: str) -> str:
    """Return a value in TOML's notation."""
    if hasattr(value, "tolist"):  # arrays and numbers of numpy
        value = value.tolist()
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return repr(value) if math.isfinite(value) else str(value)
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, Mapping):
        entries = (f"{json.dumps(name)} = {_toml(inner, key)}" for name, inner in value.items())
        return "{ " + ", ".join(entries) + " }"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_toml(inner, key) for inner in value) + "]"
    expected = "a number, a text, a truth value, or a list or mapping of these"
    raise UsageError(f"{key}: found {type(value).__name__}; expected {expected}")
