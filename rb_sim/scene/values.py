# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Values of a scene's data by their paths: bodies.ball.position[2] read, or replaced in a copy."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.base.names import keys_of, one_of
from rb_sim.scene.yaml_reader import ABSENT, entry_at, parse


def with_values(data: Mapping[str, Any], changes: Sequence[str]) -> Mapping[str, Any]:
    """Scene data with several values replaced one after the other, each as in `with_value`."""
    for change in changes:
        data = with_value(data, change)
    return data


def with_value(data: Mapping[str, Any], change: str) -> dict[str, Any]:
    """Scene data with one value replaced. change: "effects.weight.acceleration=[0,0,-1]".

    Raises RbSimError if the text is not KEY=VALUE, or the key's section does not exist.
    """
    key, equals, text = change.partition("=")
    names = keys_of(key.strip())
    if not equals or names is None or len(names) < 2:
        raise RbSimError(
            f"--set {change}: must be KEY=VALUE with a path as KEY, e.g. bodies.top.mass=2"
        )
    try:
        value = parse(f"value: {text}", "--set")["value"]
    except SceneError as error:
        raise RbSimError(f"--set {change}: {error.message}") from None
    try:
        return replaced(data, names, value)
    except RbSimError as error:
        raise RbSimError(f"--set {key}: {error}") from None


def replaced(data: Any, keys: Sequence[str | int], value: Any) -> Any:
    """Copy of `data` with the value at the path `keys` replaced; unchanged parts are shared.

    A last key that a mapping lacks is added, since the scene's validation checks names. Raises
    RbSimError if the path does not exist.
    """
    first, rest = keys[0], keys[1:]
    new = not rest and isinstance(data, Mapping) and isinstance(first, str)
    if not new and entry_at(data, first) is ABSENT:
        indexed = isinstance(first, str) and any(isinstance(key, int) for key in rest[:1])
        whole = f", or set the whole vector: {first}=[...]" if indexed else ""
        raise RbSimError(_absent(data, first) + whole)
    inner = replaced(data[first], rest, value) if rest else value
    copy: Any = dict(data) if isinstance(data, Mapping) else list(data)
    copy[first] = inner
    return copy


def value_at(data: Mapping[str, Any], key: str) -> Any:
    """The value at a path. Raises RbSimError if it does not exist."""
    at: Any = data
    for name in keys_of(key) or (key,):
        if entry_at(at, name) is ABSENT:
            raise RbSimError(f"{key}: {_absent(at, name)}")
        at = at[name]
    return at


def _absent(at: Any, key: str | int) -> str:
    known = "omitted: there is a single value"
    if isinstance(at, Mapping):
        known = one_of(key, at)
    elif isinstance(at, (list, tuple)):
        known = f"[0] to [{len(at) - 1}]"
    return f"there is no {key!r}; must be {known}"
