# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""YAML text -> plain data (dict, list, str, int, float, bool, None), safely.

Built on the parser's events alone: no tag constructs an object, keys are unique strings, and what
aliases expand to is counted before it exists. Plain scalars follow the core schema of YAML 1.2:
`1e-6` is a number, `no`, `1:30` and `2024-01-01` are text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from rb_sim.base.errors import SceneError
from rb_sim.scene.errors_text import scene_error

MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 32
MAX_VALUES = 1_000_000
"""Values in the document after aliases are expanded."""

MAX_DIGITS = 300
"""A whole number longer than this is beyond the largest double, 1.8e308, within a few digits."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_WORDS: dict[str, Any] = {"": None, "~": None}
_WORDS |= {word: None for word in ("null", "Null", "NULL")}
_WORDS |= {word: True for word in ("true", "True", "TRUE")}
_WORDS |= {word: False for word in ("false", "False", "FALSE")}
_INT = re.compile(r"[-+]?[0-9]+")
_HEX = re.compile(r"(0x[0-9a-fA-F]+|0o[0-7]+)\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_INF = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NUMBER_STARTS = "0123456789+-."
_NAN = re.compile(r"\.(nan|NaN|NAN)")


def read_text(path: Path) -> str:
    """Text of a scene file.

    Raises SceneError: missing, not a file, unreadable, empty, above MAX_BYTES, not UTF-8.
    """
    file = str(path)
    try:
        if path.is_dir():
            raise scene_error("is a folder; a scene is a YAML file", (), file)
        if path.exists() and not path.is_file():
            raise scene_error("is not a regular file; a scene is a YAML file", (), file)
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise scene_error("does not exist; a scene is a YAML file", (), file) from None
    except OSError as error:
        raise scene_error(f"cannot be read: {error.strerror}", (), file) from None
    except ValueError as error:  # a path with a null byte
        raise scene_error(f"cannot be read: {error}", (), file) from None
    if len(raw) > MAX_BYTES:
        raise scene_error(f"is larger than {MAX_BYTES // 1024**2} MiB, the most allowed", (), file)
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        byte = f"byte 0x{raw[error.start]:02x} at offset {error.start}"
        raise scene_error(f"must be UTF-8 text, but has {byte}", (), file) from None


def parse(text: str, file: str) -> Any:
    """Plain data of one YAML document.

    Raises SceneError: no document or several, a syntax error (with its line), a tag, a key given
    twice or not text, nesting beyond MAX_DEPTH, more than MAX_VALUES values, an alias of nothing.
    """
    if len(text) > MAX_BYTES:
        raise scene_error(f"is larger than {MAX_BYTES // 1024**2} MiB, the most allowed", (), file)
    try:
        return _Builder(yaml.parse(text, Loader=_LOADER), file).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = error.problem or error.context or "syntax error"
        if "nesting depth" in problem:  # of PyYAML 6.0.4, which looks ahead before it tells us
            raise scene_error(f"is nested deeper than {MAX_DEPTH} levels", (), file) from None
        lines = text.split("\n")
        if mark and mark.line < len(lines) and lines[mark.line][mark.column :].startswith("\t"):
            problem = "found a tab; must be spaces"
        raise scene_error(f"is not YAML: {where}{problem}", (), file) from None
    except (yaml.YAMLError, UnicodeError) as error:
        first_line = next(iter(str(error).splitlines()), "syntax error")
        raise scene_error(f"is not YAML: {first_line}", (), file) from None


def scalar(text: str) -> Any:
    """Value of a plain (unquoted) scalar by the core schema of YAML 1.2."""
    if text in _WORDS:
        return _WORDS[text]
    if text[0] not in _NUMBER_STARTS:
        return text
    if _INT.fullmatch(text) and len(text) <= MAX_DIGITS:
        return int(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    if _HEX.fullmatch(text) and len(text) <= MAX_DIGITS // 2:
        return int(text, 0)
    if _INF.fullmatch(text) or _NAN.fullmatch(text):
        return float(text.replace(".", "").lower())
    return text


def write(data: Any) -> str:
    """YAML text of plain data, which `parse` reads back as the same data."""
    return yaml.dump(data, Dumper=_Writer, sort_keys=False, allow_unicode=True)


class _Writer(yaml.SafeDumper):
    """PyYAML's writer (YAML 1.1), which also quotes text that YAML 1.2 takes for a number."""


_Writer.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list(_NUMBER_STARTS))
_Writer.add_implicit_resolver("tag:yaml.org,2002:int", _HEX, ["0"])


class _Anchor(NamedTuple):
    """What an alias stands for: the data, the values in it and the levels below it."""

    data: Any
    values: int
    height: int


class _Builder:
    """Turns parser events into data and keeps count of what the aliases expand to."""

    def __init__(self, events: Iterator[Any], file: str) -> None:
        self._events = events
        self._file = file
        self._anchors: dict[str, _Anchor] = {}
        self._values = 0
        self._deepest = 0

    def document(self) -> Any:
        """Read the one document of the stream."""
        next(self._events)  # stream start
        if isinstance(next(self._events), yaml.StreamEndEvent):
            raise scene_error("is empty; a scene needs at least bodies", (), self._file)
        data = self._value(next(self._events), ())
        next(self._events)  # document end
        if not isinstance(next(self._events), yaml.StreamEndEvent):
            raise scene_error("holds several YAML documents; a scene is one", (), self._file)
        if data is None:
            raise scene_error("is empty; a scene needs at least bodies", (), self._file)
        return data

    def _value(self, event: Any, path: tuple[str, ...]) -> Any:
        self._reach(len(path), path, event)
        if isinstance(event, yaml.AliasEvent):
            return self._alias(event, path)
        if event.tag is not None:
            raise self._error(path, event, f"has the tag {event.tag}; tags are not read")
        values, deepest = self._values, self._deepest
        self._deepest = len(path)
        self._count(1, path, event)
        if isinstance(event, yaml.MappingStartEvent):
            data: Any = self._mapping(path)
        elif isinstance(event, yaml.SequenceStartEvent):
            data = self._sequence(path)
        else:
            data = scalar(event.value) if event.implicit[0] else event.value
        if event.anchor is not None:
            height = self._deepest - len(path)
            self._anchors[event.anchor] = _Anchor(data, self._values - values, height)
        self._deepest = max(deepest, self._deepest)
        return data

    def _alias(self, event: Any, path: tuple[str, ...]) -> Any:
        if event.anchor not in self._anchors:
            raise self._error(path, event, f"names the anchor {event.anchor}, not defined before")
        anchor = self._anchors[event.anchor]
        self._count(anchor.values, path, event)
        self._reach(len(path) + anchor.height, path, event)
        return anchor.data

    def _reach(self, depth: int, path: tuple[str, ...], event: Any) -> None:
        self._deepest = max(self._deepest, depth)
        if depth > MAX_DEPTH:
            raise self._error(path[:4], event, f"is nested deeper than {MAX_DEPTH} levels")

    def _count(self, size: int, path: tuple[str, ...], event: Any) -> None:
        self._values += size
        if self._values > MAX_VALUES:
            raise self._error(path, event, f"brings the scene above {MAX_VALUES} values")

    def _sequence(self, path: tuple[str, ...]) -> list[Any]:
        items: list[Any] = []
        while not isinstance(event := next(self._events), yaml.SequenceEndEvent):
            items.append(self._value(event, (*path, f"[{len(items)}]")))
        return items

    def _mapping(self, path: tuple[str, ...]) -> dict[str, Any]:
        data: dict[str, Any] = {}
        lines: dict[str, int] = {}
        while not isinstance(event := next(self._events), yaml.MappingEndEvent):
            line = event.start_mark.line + 1
            if not isinstance(event, yaml.ScalarEvent) or event.tag is not None:
                raise self._error(path, event, "has a key that is not a plain name")
            key = event.value
            if key in lines:
                raise self._error(
                    (*path, key), event, f"is given twice, first in line {lines[key]}"
                )
            lines[key] = line
            data[key] = self._value(next(self._events), (*path, key))
        return data

    def _error(self, path: tuple[str, ...], event: Any, problem: str) -> SceneError:
        line = event.start_mark.line + 1
        return scene_error(f"{problem} (line {line})", path, self._file)
