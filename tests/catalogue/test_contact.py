# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the mapping of a contact is refused for; what it does is in tests/contact."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, scene, touch


def test_friction_that_grows_when_it_slips_is_refused() -> None:
    with pytest.raises(SceneError, match="at most static"):
        law = {"type": "coulomb", "static": 0.4, "kinetic": 0.5}
        scene_from_mapping(scene(ball([0.0, 0.0, 0.1]), touch(friction=law)))


# The page of contacts says how many points each pair of shapes has, and which pairs there are.


PAGE = Path(__file__).parents[2] / "docs" / "contact.md"
UPRIGHT = {"axis_B": [0.0, 0.0, 1.0]}
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"type": "sphere", "radius": 0.1},
    "ellipsoid": {"type": "ellipsoid", "semi_axes": [0.1, 0.12, 0.08]},
    "disk": {"type": "disk", "radius": 0.1} | UPRIGHT,
    "cylinder": {"type": "cylinder", "radius": 0.1, "length": 0.2} | UPRIGHT,
    "box": {"type": "box", "size": [0.1, 0.2, 0.15]},
    "rod": {"type": "rod", "length": 0.3} | UPRIGHT,
}
LYING = {"type": "cylinder", "axis": [1.0, 0.0, 0.0]}
SURFACES: dict[str, dict[str, Any]] = {
    "plane": {"type": "plane"},
    "sphere": {"type": "sphere", "radius": 1.0, "center": [0.0, 0.0, -1.0]},
    "bowl": {"type": "sphere", "radius": 3.0, "center": [0.0, 0.0, 2.5], "side": "inside"},
    "cylinder": LYING | {"radius": 1.0, "point": [0.0, 0.0, -1.0], "side": "outside"},
    "pipe": LYING | {"radius": 3.0, "point": [0.0, 0.0, 2.5], "side": "inside"},
}
OWN: dict[str, dict[str, Any]] = {
    "own sphere": {"type": "sphere", "radius": 1.0},
    "own box": {"type": "box", "size": [1.0, 1.0, 2.0]},
    "own cylinder": {"type": "cylinder", "radius": 1.0, "length": 2.0, "axis_B": [1.0, 0.0, 0.0]},
}
CORNERS = [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.1, -0.1], [0.0, -0.1, 0.0]]


def rows() -> list[tuple[str, str, str]]:
    """(shape, support, number of points) of each cell of the table."""
    lines = PAGE.read_text(encoding="utf-8").splitlines()
    at = next(i for i, line in enumerate(lines) if line.startswith("| on | plane |"))
    supports = [cell.strip() for cell in lines[at].strip("|").split("|")][1:]
    cells = []
    for line in lines[at + 2 : at + 3 + len(SHAPES)]:
        shape, *numbers = (cell.strip() for cell in line.strip("|").split("|"))
        cells += [(shape, *pair) for pair in zip(supports, numbers, strict=True)]
    return cells


@pytest.mark.parametrize(("shape", "support", "number"), rows())
def test_the_page_says_what_touches_what(shape: str, support: str, number: str) -> None:
    tilted = {"axis": [1, 0, 0], "angle": 0.01}  # a rim all round in a bowl has no nearest point
    body: dict[str, Any] = {"mass": 1.0, "position": [0.0, 0.0, 0.5], "orientation": tilted}
    contact: dict[str, Any] = {"type": "contact", "body": "b"}
    if shape == "points":
        body |= {"inertia": [0.1, 0.1, 0.1]}
        contact["points"] = CORNERS
    else:
        body |= {"shape": SHAPES[shape]}
    bodies = {"b": body}
    if support in OWN:
        bodies["a"] = {"mass": 2.0, "position": [0.0, 0.0, -1.0], "shape": OWN[support]}
        contact |= {"parent": "a", "surface": {"type": "shape"}}
    else:
        contact["surface"] = SURFACES[support]
    mapping = {"bodies": bodies, "constraints": {"c": contact}, "simulation": {"duration": 0.1}}
    if number == "-":
        with pytest.raises(SceneError):
            compile_scene(load_scene(mapping))
        return
    found = len(compile_scene(load_scene(mapping)).layout.contacts)
    assert found == (len(CORNERS) if number == "n" else int(number))
