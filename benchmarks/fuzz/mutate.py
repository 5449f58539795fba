# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Damage to the text and to the values of scene files."""

from __future__ import annotations

import copy
import random
from pathlib import Path
from typing import Any

import yaml

from rb_sim.scene.yaml_reader import parse

ODD: tuple[Any, ...] = (
    0, -0.0, -1, 1, 0.5, 1e-300, 1e300, 5e-324, 1e-12, 1e12, -1e12, float("nan"), float("inf"),
    True, None, "", "x", "1", [], {}, [0, 0, 0], [0, 0, 1], [1e200, 0, 0], [1, 2], [[1, 2, 3]],
    "world", "../x", "a b", 10**400, {"type": "sphere"}, {"axis": [0, 0, 0], "angle": 1},
)  # fmt: skip

SIGNS = "{}[]:,-#&*!|>'\"%@`\t\0\n é𝄞"


def texts(folder: Path) -> list[str]:
    """The scene files below a folder, hard cases' scenes among them."""
    found = []
    for path in sorted(folder.rglob("*.yaml")):
        text = path.read_text(encoding="utf-8")
        values = yaml.safe_load(text)
        if isinstance(values, dict) and "bodies" in values:
            found.append(text)
        elif isinstance(values, dict) and isinstance(values.get("scene"), dict):
            found.append(yaml.safe_dump(values["scene"]))
    return found


def damaged(text: str, rng: random.Random) -> str:
    """The text with one to three of its characters, lines or values changed."""
    for _ in range(rng.randint(1, 3)):
        text = rng.choice((of_characters, of_lines, of_values, of_values, of_values))(text, rng)
    return text


def of_characters(text: str, rng: random.Random) -> str:
    """A character put in, taken out or doubled."""
    i = rng.randrange(len(text) + 1)
    kind = rng.randrange(3)
    if kind == 0:
        return text[:i] + rng.choice(SIGNS) + text[i:]
    return text[:i] + text[i + 1 :] if kind == 1 else text[:i] + text[max(0, i - 1) :]


def of_lines(text: str, rng: random.Random) -> str:
    """A line left out, doubled, or moved in."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    i, kind = rng.randrange(len(lines)), rng.randrange(3)
    lines[i : i + 1] = [] if kind == 0 else [lines[i]] * 2 if kind == 1 else ["  " + lines[i]]
    return "".join(lines)


def of_values(text: str, rng: random.Random) -> str:
    """A value, a key or a whole part replaced."""
    try:
        values = copy.deepcopy(parse(text, "file"))
    except Exception:
        return text
    places = list(every_place(values))
    if not places:
        return text
    holder, key = rng.choice(places)
    kind = rng.randrange(6)
    if kind == 0:
        del holder[key]
    elif kind == 1 and isinstance(holder, dict):
        holder[rng.choice(("x", "body", "type", "parent", 3, key))] = holder.pop(key)
    elif kind == 2:
        other, there = rng.choice(places)
        holder[key] = copy.deepcopy(other[there]) if there in range_of(other) else None
    elif kind == 3 and isinstance(holder[key], int | float):
        holder[key] = holder[key] * rng.choice((-1, 0, 1e3, 1e-3, 1e9, 1e-9, 1e30))
    else:
        holder[key] = copy.deepcopy(rng.choice(ODD))
    try:
        return yaml.safe_dump(values, sort_keys=False)
    except (yaml.YAMLError, RecursionError):
        return text


def range_of(holder: Any) -> Any:
    return holder if isinstance(holder, dict) else range(len(holder))


def every_place(value: Any) -> Any:
    """(container, key) of every value in it."""
    keys = list(value) if isinstance(value, dict) else range(len(value)) if is_list(value) else ()
    for key in keys:
        yield value, key
        yield from every_place(value[key])


def is_list(value: Any) -> bool:
    return isinstance(value, list)
