# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Scenes with contacts that several tests use, as mappings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rb_sim import load_scene
from rb_sim.catalogue.contact import Contact
from rb_sim.scene.listing import find_scene, list_scenes
from rb_sim.scene.yaml_reader import parse

G = 9.81
WEIGHT = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}


def body(shape: dict[str, Any], position: Sequence[float], **more: Any) -> dict[str, Any]:
    """A homogeneous body of 1 kg; vectors as any sequence."""
    solid = {"mass": 1.0, "shape": shape, "position": plain(position)}
    return solid | {key: plain(value) for key, value in more.items()}


def plain(value: Any) -> Any:
    """Lists and floats, as YAML has them."""
    if hasattr(value, "tolist"):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


def ball(position: Sequence[float], radius: float = 0.1, **more: Any) -> dict[str, Any]:
    return body({"type": "sphere", "radius": radius}, position, **more)


def box(size: Sequence[float], position: Sequence[float], **more: Any) -> dict[str, Any]:
    return body({"type": "box", "size": list(size)}, position, **more)


def touch(name: str = "body", mu: float = 0.0, kinetic: float | None = None, **more: Any) -> Any:
    """A contact of `name` with the floor z = 0, Coulomb's law if mu is given."""
    contact: dict[str, Any] = {"type": "contact", "body": name}
    if mu > 0.0:
        friction = {"type": "coulomb", "static": mu}
        contact["friction"] = friction if kinetic is None else friction | {"kinetic": kinetic}
    return contact | more


def scene(bodies: Any, constraints: Any, gravity: bool = True, **effects: Any) -> dict[str, Any]:
    """One body is named `body`, one contact `floor`; else the mappings."""
    bodies = {"body": bodies} if "mass" in bodies else bodies
    constraints = {"floor": constraints} if "type" in constraints else constraints
    effects = ({"weight": WEIGHT} if gravity else {}) | effects
    return {
        "bodies": bodies,
        "constraints": constraints,
        "effects": effects,
        "simulation": {"duration": 10.0, "tolerance": 1e-10},
    }


def acts_on(acting: Any, name: str) -> int:
    """1 where a constraint or an effect acts on this body, -1 where it acts back on it, else 0."""
    if hasattr(acting, "body"):
        return (acting.body == name) - (getattr(acting, "parent", None) == name)
    return int(acting.bodies is None or name in acting.bodies)


def shipped_with_contacts() -> list[str]:
    """Names of the shipped scenes that have a contact."""
    return [
        listed.name
        for listed in list_scenes()
        if any(isinstance(c, Contact) for c in load_scene(listed.name).constraints.values())
    ]


def shipped(name: str) -> Any:
    """The mapping of a shipped scene."""
    path = find_scene(name)
    return parse(path.read_text(), path.name)
