# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names of bodies and constraints: how ROS has them, and how a path in a scene writes them.

A scene keeps the name that its user gave. ROS allows less: the parts of a topic are letters, digits
and underscores of ASCII and begin with a letter, and frames and joints are called as topics are.
A sentence lists the first few of many.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterable, Iterator, Sequence

LONGEST = 64
"""Characters of a name, in ROS as in a scene: a topic has 255 in all."""

MOST_NAMED = 3
"""Of many things of a kind, that a sentence lists, or that have a line of their own."""

_NOT_IN_TOPICS = re.compile(r"[^A-Za-z0-9_]+")
_STEP = re.compile(
    r"""\.?([^.\[\]"'=/\s](?:[^.\[\]"'=/]*[^.\[\]"'=/\s])?)|\[(\d+)\]|\[(["'])(.*?)\3\]"""
)
"""Of a path: a key, an index in brackets, a key in quotation marks in brackets."""


def ros_name(name: str) -> str:
    """The name as part of a topic: `left-wheel` is left_wheel, `2nd_gear` x2nd_gear.

    Letters lose their accents; those of other scripts are called by their number in Unicode.
    """
    if name.isascii() and name.isidentifier():
        return name
    plain = "".join(_ascii(letter) for letter in unicodedata.normalize("NFKD", name))
    parts = _NOT_IN_TOPICS.sub("_", plain).strip("_")
    return (f"x{parts}" if parts[:1].isdigit() else parts)[:LONGEST].rstrip("_")


def _ascii(letter: str) -> str:
    if letter.isascii():
        return letter
    if letter.isalnum():
        return f"u{ord(letter):x}"
    return "" if unicodedata.combining(letter) else "_"


def clashes(names: Iterable[str], taken: str = "") -> Iterator[tuple[str, str, str]]:
    """(name, the other one, what both are in ROS) of each that another one excludes."""
    seen = {taken: taken}
    for name in names:
        other = seen.setdefault(ros_name(name), name)
        if other != name:
            yield name, other, ros_name(name)


def keys_of(text: str) -> tuple[str | int, ...] | None:
    """The keys and indices of a path like `bodies.top.position[2]` or `bodies["v1.2"].mass`.

    None where it is no path.
    """
    keys: list[str | int] = []
    at = 0
    while at < len(text):
        match = _STEP.match(text, at)
        if match is None or (at == 0 and match[0].startswith((".", "["))):
            return None
        if at > 0 and match[1] is not None and not match[0].startswith("."):
            return None
        name, index, _, quoted = match.groups()
        keys.append(int(index) if index is not None else name if name is not None else quoted)
        at = match.end()
    return tuple(keys) or None


def first_few(texts: Sequence[str], count: int | None = None, most: int = MOST_NAMED) -> str:
    """The first of the texts as a list in a sentence, "..." for the rest; count: of how many, if
    they are not all given."""
    return ", ".join(texts[:most]) + ", ..." * ((count or len(texts)) > min(most, len(texts)))
