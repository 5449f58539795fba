# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names of bodies and constraints, in ROS and in paths of a scene; suggestions of names.

A scene keeps the names given by its user. ROS allows less: the parts of a topic are ASCII letters,
digits and underscores and begin with a letter; frames and joints have the same names as topics.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Sequence
from difflib import get_close_matches

LONGEST = 64
"""Largest length of a name, in ROS as in a scene; a topic has 255 characters in total."""

MOST_NAMED = 3
"""Most items of a kind that a sentence lists, or that get a line each."""

_NOT_IN_TOPICS = re.compile(r"[^A-Za-z0-9_]+")
_STEP = re.compile(
    r"""\.?([^.\[\]"'=/\s](?:[^.\[\]"'=/]*[^.\[\]"'=/\s])?)|\[(\d+)\]|\[(["'])(.*?)\3\]"""
)
"""Pattern of one step of a path: a key, an index in brackets, a quoted key in brackets."""


def ros_name(name: str) -> str:
    """The name as part of a topic: `left-wheel` is left_wheel, `2nd_gear` x2nd_gear.

    Letters lose their accents; letters of other scripts become their Unicode number.
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
    """(name, other name, common ROS name) of each name that coincides with another one in ROS."""
    seen = {taken: taken}
    for name in names:
        other = seen.setdefault(ros_name(name), name)
        if other != name:
            yield name, other, ros_name(name)


def keys_of(text: str) -> tuple[str | int, ...] | None:
    """The keys and indices of a path like `bodies.top.position[2]` or `bodies["v1.2"].mass`.

    None if the text is not a path.
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
    """The first of the texts as a list in a sentence, with "..." for the rest; count: their total
    number, if not all are given."""
    return ", ".join(texts[:most]) + ", ..." * ((count or len(texts)) > min(most, len(texts)))


ALSO_CALLED = {
    "hinge": ("fixed_axis",),
    "revolute": ("fixed_axis",),
    "ball": ("fixed_point", "sphere"),
    "spherical": ("fixed_point",),
    "prismatic": ("translation",),
    "slider": ("translation",),
    "fixed": ("weld",),
    "rope": ("string",),
    "cable": ("string",),
    "damper": ("spring",),
    "force": ("wrench",),
    "torque": ("wrench",),
    "drag": ("linear_drag",),
    "cube": ("box",),
    "cuboid": ("box",),
    "rk45": ("dopri853",),
    "k": ("stiffness",),
    "c": ("damping",),
    "coefficient": ("static",),
    "mu": ("static", "coefficient", "friction"),
    "pose": ("position",),
    "com": ("center_of_mass",),
    "weight": ("mass",),
    "density": ("mass",),
    "velocity": ("linear_velocity",),
    "omega": ("angular_velocity",),
    "rpy": ("orientation",),
    "quaternion": ("orientation",),
    "quat": ("orientation",),
    "euler": ("orientation",),
    "degrees": ("angle",),
    "deg": ("angle",),
    "diameter": ("radius",),
    "half_extents": ("size",),
    "size": ("radius",),
    "axis": ("axis_b",),
    "point": ("point_b",),
    "anchor": ("point_b",),
    "child": ("body",),
    "link": ("body",),
    "floor": ("contact", "plane"),
    "ground": ("contact", "plane"),
    "dimensions": ("size",),
    "extents": ("size",),
    "height": ("length",),
    "ball_joint": ("fixed_point",),
    "rigid": ("weld",),
    "g": ("acceleration",),
    "dt": ("step",),
    "timestep": ("step",),
    "integrator": ("method",),
    "solver": ("method",),
    "t_end": ("duration",),
    "end_time": ("duration",),
    "time": ("duration",),
    "ode45": ("dopri853",),
    "frequency": ("rate",),
    "fps": ("rate",),
    "rtol": ("tolerance",),
    "gravity": ("effects",),
    "contacts": ("constraints",),
    "name": ("description",),
    "links": ("bodies",),
    "joints": ("constraints",),
    "forces": ("effects",),
}
"""Names in other programs -> candidates in rb_sim, in lower case; the context decides between
them."""


_FIXED = (
    "omitted: leave out a body that never moves (constraints without parent are to the world), or "
    "hold it by a constraint of type weld"
)
_OF_CONTACT = "a key of a constraint of type contact"

SAID_ELSEWHERE = {
    "fixed": _FIXED,
    "static": _FIXED,
    "kinematic": _FIXED,
    "is_static": _FIXED,
    "friction": _OF_CONTACT,
    "mu": _OF_CONTACT,
    "restitution": _OF_CONTACT,
    "collision": _OF_CONTACT,
    "material": _OF_CONTACT,
}
"""Keys of other programs that have no counterpart in the mapping where they stand -> the phrase
after "must be"."""


MOST_NAMES = 14
"""Most names in a message: the length of the longest list of keys, that of a contact."""


SHORTEST = 3
"""Letters of the beginning of a name that stand for it."""


def meant(value: object, names: Iterable[str]) -> str | None:
    """The one of `names` that `value` was probably meant to be."""
    known = {name.lower(): name for name in sorted(names)}
    word = value[:64].lower() if isinstance(value, str) else ""
    close = [name for name in (word, *ALSO_CALLED.get(word, ())) if name in known]
    if len(word) >= SHORTEST:  # pos: position
        close = close or [name for name in known if name.startswith(word)]
    close = close or get_close_matches(word, known, n=1)
    return known[close[0]] if close else None


def one_of(value: object, names: Iterable[str]) -> str:
    """Phrase that lists `names`, first the one that `value` was probably meant to be."""
    listed = sorted(names)
    close = meant(value, listed)
    if close:
        listed.remove(close)
    text = ", ".join(listed[:MOST_NAMES])
    if len(listed) > MOST_NAMES:
        text += f" and {len(listed) - MOST_NAMES} more"
    if not close:
        return f"one of {text or 'none'}"
    return {0: close, 1: f"{close} or {text}"}.get(len(listed), f"{close}, or one of {text}")


def known_key(key: object, names: Iterable[str]) -> str:
    """Phrase with the key that an unknown one was probably meant to be, or where it belongs."""
    listed = list(names)
    word = str(key).lower()
    if word in SAID_ELSEWHERE and not set(listed).intersection(ALSO_CALLED.get(word, ())):
        return SAID_ELSEWHERE[word]
    if word.isdigit():
        return "omitted (a decimal number has a point: 1.5, not 1,5)"
    return one_of(key, listed)


_A_NAME = re.compile(r"\b(?!(?:one|of|or)\b)\w+")
"""A name in the phrase of `one_of`."""


def a_mapping_of(names: str, needed: Callable[[str], list[str]], such: str = "") -> str:
    """Phrase for a mapping of one of several types, each with the keys that it needs.

    names: phrase of `one_of`; needed: the keys that a type needs besides `type`; such: phrase of
    an example, put behind the form.
    """

    def with_keys(name: re.Match[str]) -> str:
        keys = ", ".join(needed(name[0]))
        return f"{name[0]} ({keys})" if keys else name[0]

    return f"a mapping {{type: NAME, KEY: ...}}{such}; NAME is {_A_NAME.sub(with_keys, names)}"
