# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The scene of a bag as it was run, and with other values in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.base.names import keys_of, one_of
from rb_sim.io.bag.reader import BagReader
from rb_sim.scene import yaml_reader
from rb_sim.scene.load import scene_from_mapping
from rb_sim.scene.schema import Scene

OPTIONS = ("duration", "rate", "method", "step", "tolerance", "project_initial", "impacts")


def scene_as_run(
    reader: BagReader, changes: Sequence[str] = (), overrides: Mapping[str, Any] | None = None
) -> Scene:
    """The scene with the options of that run; where `auto` chose a method, with its choice.

    changes: texts KEY=VALUE that replace values of the scene; overrides: as of load_scene.
    Raises SceneError, RbSimError.
    """
    recorded = reader.scene
    data = yaml_reader.parse(recorded.text, recorded.name)
    options = {k: v for k, v in vars(recorded.simulation).items() if k in OPTIONS and v is not None}
    given = {key: value for key, value in (overrides or {}).items() if value is not None}
    summary = reader.summary
    choice = (summary or {}).get("choice")
    if choice and options.get("method") == "auto":
        options |= {"method": choice["method"], "step": None, "tolerance": None}
        options |= {k: choice[k] for k in ("step", "tolerance") if choice.get(k)}
        options = {key: value for key, value in options.items() if value is not None}
    data = {**data, "simulation": options}
    for change in changes:
        data = with_value(data, change)
    return scene_from_mapping(data, name=recorded.name, file=str(reader.path), **given)


def with_value(data: Mapping[str, Any], change: str) -> dict[str, Any]:
    """The data of a scene with one value replaced. change: "effects.weight.acceleration=[0,0,-1]".

    Raises RbSimError for a text that is no KEY=VALUE, and a key whose section does not exist.
    """
    key, equals, text = change.partition("=")
    names = keys_of(key.strip())
    if not equals or names is None or len(names) < 2:
        raise RbSimError(
            f"--set {change}: must be KEY=VALUE with a path as KEY, e.g. bodies.top.mass=2"
        )
    try:
        value = yaml_reader.parse(f"value: {text}", "--set")["value"]
    except SceneError as error:
        raise RbSimError(f"--set {change}: {error.message}") from None
    try:
        return replaced(data, names, value)
    except RbSimError as error:
        raise RbSimError(f"--set {key}: {error}") from None


def replaced(data: Any, keys: Sequence[str | int], value: Any) -> Any:
    """A copy of `data` with that value at the path `keys`; what the path does not touch is shared.

    A last key that a mapping lacks is added: the scene's own check says whether it exists. Raises
    RbSimError where the path leads nowhere.
    """
    first, rest = keys[0], keys[1:]
    new = not rest and isinstance(data, Mapping) and isinstance(first, str)
    if not (new or _has(data, first)):
        raise RbSimError(_absent(data, first))
    inner = replaced(data[first], rest, value) if rest else value
    copy: Any = dict(data) if isinstance(data, Mapping) else list(data)
    copy[first] = inner
    return copy


def value_at(data: Mapping[str, Any], key: str) -> Any:
    """The value that a path names. Raises RbSimError where there is none."""
    at: Any = data
    for name in keys_of(key) or (key,):
        if not _has(at, name):
            raise RbSimError(f"{key}: {_absent(at, name)}")
        at = at[name]
    return at


def _has(at: Any, key: str | int) -> bool:
    """Whether a mapping has the key, or a list the index."""
    if isinstance(at, (list, tuple)):
        return isinstance(key, int) and key < len(at)
    return isinstance(at, Mapping) and key in at


def _absent(at: Any, key: str | int) -> str:
    known = "omitted: there is a single value"
    if isinstance(at, Mapping):
        known = one_of(key, at)
    elif isinstance(at, (list, tuple)):
        known = f"[0] to [{len(at) - 1}]"
    return f"there is no {key!r}; must be {known}"
