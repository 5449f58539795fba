# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Errors of a scene in one line each: file: key.path: got the value; what is allowed.

Pydantic says where and how a value fails; this module says it in the user's words, with the key as
it is in the file (the labels that pydantic adds for alternatives are left out).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from rb_sim.base.errors import SceneError
from rb_sim.base.names import one_of

Path = tuple[str | int, ...]

Model = TypeVar("Model", bound=BaseModel)

MISSING = "is missing"

MOST_ERRORS = 9
"""Failures after the first that are spelled out."""

_MISSING = object()

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
    "too_short": "a list of at least {min_length} entries",
    "too_long": "a list of at most {max_length} entries",
}
"""What is allowed, by pydantic's type of error; filled in from the error's context."""

NAME_RULES = {
    "name": "a name: a letter or digit, then letters, digits, spaces or _-.:+() (at most 64)",
    "identifier": "a name: a letter, then letters, digits or underscores (at most 64)",
}


def validated(model: type[Model], data: Any, file: str, key: str = "") -> Model:
    """`data` as a `model`; raises SceneError with all failures in one line.

    key: where `data` stands in the scene, put in front of the keys in the message.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        details = error.errors(include_url=False)
    by_path: dict[Path, list[Any]] = {}
    for detail in details:
        by_path.setdefault(_path_in(data, detail), []).append(detail)
    by_line: dict[str, list[Path]] = {}  # what is wrong at several places alike is said once
    for path, same in by_path.items():
        by_line.setdefault(_line(model, data, path, same), []).append(path)
    (message, (first, *alike)), *others = by_line.items()
    if alike:
        message += f" (as {_keys_text(alike)})"
    message += "".join(f"; {_keys_text(paths)}: {line}" for line, paths in others[:MOST_ERRORS])
    if len(others) > MOST_ERRORS:
        message += f"; and {len(others) - MOST_ERRORS} more"
    raise scene_error(message, (key, *first) if key else first, file)


def _keys_text(paths: list[Path]) -> str:
    """The first of them, and how many more."""
    texts = [key_text(path) for path in paths[:MOST_ERRORS]]
    more = len(paths) - len(texts)
    return ", ".join(texts) + (f" and {more} more" if more else "")


def _line(model: type[BaseModel], data: Any, path: Path, same: list[Any]) -> str:
    """What is wrong at one path, and what is allowed there."""
    absent = same[0]["type"] in ("missing", "union_tag_not_found")
    phrases = _phrases_for_missing(model, data, path) if absent else []
    return f"{_found(data, path, same[0])}; must be {' or '.join(phrases or _phrases(same))}"


def _phrases(details: list[Any]) -> list[str]:
    """What each failed alternative allows, without repetition."""
    return list(dict.fromkeys(_allowed(detail) for detail in details))


def _phrases_for_missing(model: type[BaseModel], data: Any, path: Path) -> list[str]:
    """What the missing key allows: found by validating with a value there that nothing allows."""
    try:
        model.model_validate(_with_value(data, path, object()))
    except ValidationError as error:
        details = error.errors(include_url=False)
        return _phrases([detail for detail in details if _path_in(data, detail) == path])
    return []


def _with_value(data: Any, path: Path, value: Any) -> Any:
    """A copy of `data` that has `value` at `path`."""
    if not path:
        return value
    entries = data.items() if isinstance(data, Mapping) else enumerate(data)
    copy: dict[str | int, Any] = dict(entries)
    copy[path[0]] = _with_value(copy.get(path[0]), path[1:], value)
    return copy if isinstance(data, Mapping) else list(copy.values())


def _path_in(data: Any, detail: Mapping[str, Any]) -> Path:
    """The error's location as keys that exist in `data` (and the missing one at the end)."""
    path: list[str | int] = []
    at = data
    parts = [part for part in detail["loc"] if part != "[key]"]
    for i, part in enumerate(parts):
        below = _below(at, part)
        if below is not _MISSING:
            path.append(part)
            at = below
        elif i == len(parts) - 1 and isinstance(at, Mapping) and at.get("type") != part:
            path.append(part)
    if detail["type"] in ("union_tag_invalid", "union_tag_not_found"):
        path.append("type")
    return tuple(path)


def _below(at: Any, part: str | int) -> Any:
    """The entry `part` of `at`, or _MISSING."""
    if isinstance(at, Mapping):
        return at.get(part, _MISSING)
    if isinstance(at, (list, tuple)) and isinstance(part, int) and part < len(at):
        return at[part]
    return _MISSING


def _found(data: Any, path: Path, detail: Mapping[str, Any]) -> str:
    """What is there: the value, or that the key is missing or unknown."""
    if detail["type"] == "rb_sim_key":
        return "unknown key"
    at = data
    for part in path:
        at = _below(at, part)
    if at is _MISSING:
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
    return _in_our_words(str(detail["msg"]))


def _in_our_words(message: str) -> str:
    """Pydantic's or a validator's own message as a phrase after "must be"."""
    for start in ("Value error, ", "Assertion failed, ", "Input should be ", "must be "):
        message = message.removeprefix(start)
    return message


def render(value: Any) -> str:
    """A value as the user wrote it, on one line and short."""
    if value is None:
        return "nothing"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return repr(shorten(value, 50))
    if isinstance(value, (int, float)):
        return shorten(_number_text(value), 40)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{shorten(str(k), 20)}: {render(v)}" for k, v in _first(value.items()))
        return shorten("{" + inside + "}")
    if isinstance(value, (list, tuple)):
        return shorten("[" + ", ".join(render(v) for v in _first(value)) + "]")
    return shorten(f"an object of type {type(value).__name__}")


def _first(entries: Any) -> list[Any]:
    """The few entries that can be shown."""
    return [entry for _, entry in zip(range(12), entries, strict=False)]


def _number_text(value: float) -> str:
    try:
        return repr(value)
    except ValueError:  # Python refuses to print very long whole numbers
        return "a whole number of thousands of digits"


def key_text(path: Path) -> str:
    """Path as `keys_of` reads it: ("bodies", "ball", "position", 2) -> bodies.ball.position[2]."""
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


def scene_error(message: str, path: Path, file: str) -> SceneError:
    """SceneError whose text is one line, whatever the user's names hold."""
    return SceneError(shorten(message, 2000), key=key_text(path), file=shorten(file, 1000))
