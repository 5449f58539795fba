# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Safe YAML reader (text -> dict, list, str, int, float, bool, None) and wording of scene errors.

It uses the parser's events only: no tag constructs an object, keys are unique strings, and the size
of expanded aliases is counted before they are expanded. Plain scalars follow the core schema of
YAML 1.2: `1e-6` is a number; `no`, `1:30` and `2024-01-01` are text. Errors name the line of their
key.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from rb_sim.base.errors import SceneError
from rb_sim.base.names import a_mapping_of, one_of

Keys = tuple[str | int, ...]

Model = TypeVar("Model", bound=BaseModel)

MISSING = "is missing"

MOST_ERRORS = 9
"""Most errors listed in full after the first."""

LONGEST_MISTAKE = 1000
"""Characters of the description of one mistake."""

ABSENT = object()

_ALLOWED = {
    "float_type": "a number",
    "float_parsing": "a number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "bool_type": "true or false",
    "string_type": "text",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a mapping NAME: {{...}}",
    "model_type": "a mapping KEY: value",
    "model_attributes_type": "a mapping KEY: value",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:g}",
    "less_than": "a number < {lt:g}",
    "less_than_equal": "a number <= {le:g}",
    "string_too_long": "a text of at most {max_length} characters",
    "too_short": "a list or a mapping of at least {min_length} entries",
    "too_long": "a list or a mapping of at most {max_length} entries",
}
"""Allowed values by pydantic's type of error, with fields from the error's context."""

NAME_RULES = {
    "name": "a name: a letter or digit, then letters, digits, spaces or _-.:+() (at most 64)",
    "identifier": "a name: a letter, then letters, digits or underscores (at most 64)",
}


def validated(model: type[Model], data: Any, file: str, key: str = "") -> Model:
    """`data` validated as a `model`; raises SceneError with all errors in one line.

    key: location of `data` in the scene, a prefix of the keys in the message.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        details = error.errors(include_url=False)
    by_path: dict[Keys, list[Any]] = {}
    for detail in details:
        by_path.setdefault(_path_in(data, detail), []).append(detail)
    by_line: dict[str, list[Keys]] = {}  # the same error at several places is listed once
    for path, same in by_path.items():
        by_line.setdefault(_line(model, data, path, same), []).append(path)
    (message, (first, *alike)), *others = by_line.items()
    if alike:
        message += f" (as {_keys_text(alike)})"
    more = [f"{_keys_text(paths)}: {line}" for line, paths in others[:MOST_ERRORS]]
    if len(others) > MOST_ERRORS:
        more.append(f"and {len(others) - MOST_ERRORS} more")
    raise scene_error(message, (key, *first) if key else first, file, more)


def _keys_text(paths: list[Keys]) -> str:
    """The first of the paths, and the number of further ones."""
    texts = [key_text(path) for path in paths[:MOST_ERRORS]]
    more = len(paths) - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more else "")


def _line(model: type[BaseModel], data: Any, path: Keys, same: list[Any]) -> str:
    """Error at one path and the values allowed there."""
    phrases: list[str] = []
    if same[0]["type"] in ("missing", "union_tag_not_found"):
        phrases = _phrases_for(model, data, path, path)
    elif same[0]["type"] == "model_attributes_type":  # one of several models, by `type`
        unknown = {"type": f"{_at(data, path)}?"}  # the nearest name comes first
        names = _phrases_for(model, data, path, (*path, "type"), unknown)

        def needed(kind: str) -> list[str]:
            return _required(model, data, path, {"type": kind})

        phrases = [a_mapping_of(phrase, needed) for phrase in names]
    if same[0]["type"] in ("model_type", "model_attributes_type") and not phrases:
        keys = _required(model, data, path)
        phrases = [f"a mapping {{{', '.join(f'{key}: ...' for key in keys)}}}"] if keys else []
    return f"{_found(data, path, same[0])}; must be {' or '.join(phrases or _phrases(same))}"


def _required(model: type[BaseModel], data: Any, path: Keys, given: Any = None) -> list[str]:
    """The keys that a mapping at `path` must have, which already has those `given`."""
    changed = _with_value(data, path, given or {})
    try:
        model.model_validate(changed)
    except ValidationError as error:
        missing = [of for of in error.errors(include_url=False) if of["type"] == "missing"]
        paths = [_path_in(changed, detail) for detail in missing]
        return [str(found[-1]) for found in paths if found[:-1] == path]
    return []


def _phrases(details: list[Any]) -> list[str]:
    """Values allowed by each failed alternative, without repetition."""
    return list(dict.fromkeys(_allowed(detail) for detail in details))


def _phrases_for(
    model: type[BaseModel], data: Any, path: Keys, below: Keys, value: Any = None
) -> list[str]:
    """Values allowed at `below`, found by validating with an impossible `value` at `path`; default:
    one that is impossible everywhere."""
    changed = _with_value(data, path, object() if value is None else value)
    try:
        model.model_validate(changed)
    except ValidationError as error:
        details = error.errors(include_url=False)
        return _phrases([detail for detail in details if _path_in(changed, detail) == below])
    return []


def _with_value(data: Any, path: Keys, value: Any) -> Any:
    """A copy of `data` with `value` at `path`."""
    if not path:
        return value
    entries = data.items() if isinstance(data, Mapping) else enumerate(data)
    copy: dict[str | int, Any] = dict(entries)
    copy[path[0]] = _with_value(copy.get(path[0]), path[1:], value)
    return copy if isinstance(data, Mapping) else list(copy.values())


def _path_in(data: Any, detail: Mapping[str, Any]) -> Keys:
    """Location of an error as keys that exist in `data` (a missing key only as the last one)."""
    path: list[str | int] = []
    at = data
    parts = [part for part in detail["loc"] if part != "[key]"]
    for i, part in enumerate(parts):
        below = entry_at(at, part)
        if below is not ABSENT:
            path.append(part)
            at = below
        elif i == len(parts) - 1 and isinstance(at, Mapping) and at.get("type") != part:
            path.append(part)
    if detail["type"] in ("union_tag_invalid", "union_tag_not_found"):
        path.append("type")
    return tuple(path)


def _at(data: Any, path: Keys) -> Any:
    """The value at `path` of `data`, or ABSENT."""
    at = data
    for part in path:
        at = entry_at(at, part)
    return at


def entry_at(at: Any, part: str | int) -> Any:
    """The entry `part` of `at`, or ABSENT."""
    if isinstance(at, Mapping):
        return at.get(part, ABSENT)
    if isinstance(at, (list, tuple)) and isinstance(part, int) and part < len(at):
        return at[part]
    return ABSENT


def _found(data: Any, path: Keys, detail: Mapping[str, Any]) -> str:
    """The value found, or that the key is missing or unknown."""
    if detail["type"] == "rb_sim_key":
        return "unknown key"
    at = _at(data, path)
    if at is ABSENT:
        return MISSING
    key_itself = "[key]" in detail["loc"]
    return f"got {render(path[-1] if key_itself else at)}"


def _allowed(detail: Mapping[str, Any]) -> str:
    """Phrase after "must be" for one pydantic error."""
    kind, context = detail["type"], detail.get("ctx", {})
    if kind in _ALLOWED:
        return _ALLOWED[kind].format(**context)
    if kind in ("rb_sim", "rb_sim_key"):
        return str(context["allowed"])
    if kind == "missing":
        return "given"
    if kind == "string_pattern_mismatch":
        return NAME_RULES["name" if "\\p{L}" in context["pattern"] else "identifier"]
    if kind in ("literal_error", "union_tag_invalid"):
        names = re.findall(r"'([^']*)'", str(context.get("expected") or context["expected_tags"]))
        return one_of(context.get("tag", detail["input"]), names)
    if kind == "union_tag_not_found":
        return "given"
    message = str(detail["msg"])  # of pydantic or of a validator
    for start in ("Value error, ", "Assertion failed, ", "Input should be ", "must be "):
        message = message.removeprefix(start)
    return message


def render(value: Any) -> str:
    """A value as the user wrote it, shortened to one line."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return repr(shorten(value, 50))
    if isinstance(value, (int, float)):
        try:
            return shorten(repr(value), 40)
        except ValueError:  # Python refuses to print very long whole numbers
            return "a whole number of thousands of digits"
    if isinstance(value, Mapping):
        inside = ", ".join(f"{shorten(str(k), 20)}: {render(v)}" for k, v in _first(value.items()))
        return shorten("{" + inside + "}")
    if isinstance(value, (list, tuple)):
        return shorten("[" + ", ".join(render(v) for v in _first(value)) + "]")
    return shorten(f"an object of type {type(value).__name__}")


def _first(entries: Any) -> list[Any]:
    """The first 12 entries."""
    return [entry for _, entry in zip(range(12), entries, strict=False)]


def key_text(path: Keys) -> str:
    """Text of a path of keys, which `keys_of` parses: ("bodies", "ball", "position", 2) ->
    bodies.ball.position[2]."""
    key = ""
    for part in path:
        text = f"[{part}]" if isinstance(part, int) else shorten(part)
        if "." in text:
            text = f'["{text}"]'
        key += text if text.startswith("[") or not key else f".{text}"
    return key


def shorten(text: str, width: int = 60) -> str:
    """`text` on one line of at most `width` characters."""
    flat = "".join(c if c.isprintable() else " " for c in text)
    return flat if len(flat) <= width else flat[: width - 3] + "..."


def scene_error(message: str, path: Keys, file: str, others: Sequence[str] = ()) -> SceneError:
    """SceneError with a text of one line, for any names in the scene; others: further mistakes."""
    short, *more = (shorten(text, LONGEST_MISTAKE) for text in (message, *others))
    return SceneError(short, key=key_text(path), file=shorten(file, 1000), others=more)


MAX_BYTES = 4 * 1024 * 1024
MAX_DEPTH = 32
MAX_VALUES = 1_000_000
"""Most values in a document after expansion of aliases."""

MAX_DIGITS = 300
"""Most digits of a whole number: a longer one exceeds the largest double, 1.8e308, within a few
digits."""

_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_WORDS: dict[str, Any] = {"": None, "~": None}
_WORDS |= {word: None for word in ("null", "Null", "NULL")}
_WORDS |= {word: True for word in ("true", "True", "TRUE")}
_WORDS |= {word: False for word in ("false", "False", "FALSE")}
_INT = re.compile(r"[-+]?[0-9]+")
_HEX = re.compile(r"(0x[0-9a-fA-F]+|0o[0-7]+)\Z")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?\Z")
_INF = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NO_BLANK = re.compile(r"[\s{-]*(\w+):([^\s:].*)")
_NO_COLON = re.compile(r"\s*([A-Za-z_]\w*)\s*")
_NUMBER_STARTS = "0123456789+-."
_NAN = re.compile(r"\.(nan|NaN|NAN)")


def read_text(path: Path) -> str:
    """Text of a scene file.

    Raises SceneError if it is missing, not a file, unreadable, empty, above MAX_BYTES or not UTF-8.
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

    Raises SceneError for no document or several, a syntax error (with its line), a tag, a key that
    is repeated or not text, nesting beyond MAX_DEPTH, more than MAX_VALUES values, an undefined
    alias.
    """
    if len(text) > MAX_BYTES:
        raise scene_error(f"is larger than {MAX_BYTES // 1024**2} MiB, the most allowed", (), file)
    try:
        return _Builder(yaml.parse(text, Loader=_LOADER), file).document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark else ""
        problem = error.problem or error.context or "syntax error"
        if "nesting depth" in problem:  # PyYAML 6.0.4 checks the depth itself
            raise scene_error(f"is nested deeper than {MAX_DEPTH} levels", (), file) from None
        lines = text.split("\n")
        if mark and mark.line < len(lines) and lines[mark.line][mark.column :].startswith("\t"):
            problem = "found a tab; must be spaces"
        problem += _near_by(lines, mark.line) if mark else ""
        raise scene_error(f"is not YAML: {where}{problem}", (), file) from None
    except (yaml.YAMLError, UnicodeError) as error:
        first_line = next(iter(str(error).splitlines()), "syntax error")
        raise scene_error(f"is not YAML: {first_line}", (), file) from None


def _near_by(lines: list[str], at: int) -> str:
    """Text that names line `at` or one of the two above if a colon is missing in it, or a blank
    after its colon: the parser takes `mass:1` and the line below as one text, and fails behind
    it."""
    for i in (at, at - 1, at - 2):
        line = lines[i] if 0 <= i < len(lines) else ""
        if found := _NO_BLANK.match(line):
            return f"; line {i + 1} needs a blank after the colon: {': '.join(found.groups())}"
        if i < at and (word := _NO_COLON.fullmatch(line)):
            return f"; line {i + 1} needs a colon: {word[1]}:"
    return ""


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
    """PyYAML's writer (YAML 1.1), which also quotes text that YAML 1.2 would read as a number."""


_Writer.add_implicit_resolver("tag:yaml.org,2002:float", _FLOAT, list(_NUMBER_STARTS))
_Writer.add_implicit_resolver("tag:yaml.org,2002:int", _HEX, ["0"])


class _Anchor(NamedTuple):
    """Anchored data, with its number of values and of nested levels."""

    data: Any
    values: int
    height: int


class _Builder:
    """Builds data from parser events and counts values, including those of expanded aliases."""

    def __init__(self, events: Iterator[Any], file: str) -> None:
        self._events = events
        self._file = file
        self._anchors: dict[str, _Anchor] = {}
        self._values = 0
        self._deepest = 0

    def document(self) -> Any:
        """The one document of the stream."""
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
            value = next(self._events)
            if event.implicit[0]:
                self._check_plain_key(key, event, value, path)
            data[key] = self._value(value, (*path, key))
        return data

    def _check_plain_key(self, key: str, event: Any, value: Any, path: tuple[str, ...]) -> None:
        """Refuses `<<`, and `{mass:1}`, which is a key `mass:1` without a value."""
        if key == "<<":
            problem = "merge keys are not read; write the keys out, or use *NAME for a whole value"
            raise self._error((*path, key), event, problem)
        empty = isinstance(value, yaml.ScalarEvent) and not value.value and value.implicit[0]
        if empty and (found := _NO_BLANK.fullmatch(key)):
            problem = f"needs a blank after the colon: {': '.join(found.groups())}"
            raise self._error((*path, key), event, problem)

    def _error(self, path: tuple[str, ...], event: Any, problem: str) -> SceneError:
        line = event.start_mark.line + 1
        return scene_error(f"{problem} (line {line})", path, self._file)
