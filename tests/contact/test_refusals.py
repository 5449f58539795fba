# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a contact cannot be is refused in one clear line."""

from __future__ import annotations

from typing import Any

import pytest

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from tests.contact.scenes import ball, body, box, scene, touch

BALL = ball([0, 0, 0.1])
TURNTABLE = {"type": "turntable", "rate": 1.0}
CYLINDER = {"type": "cylinder", "radius": 0.1, "length": 0.2}
PARENT = {"body": BALL, "a": box([1, 1, 1], [0, 0, -0.5])}
COULOMB = {"type": "coulomb", "static": 0.3}

REFUSED: dict[str, tuple[Any, Any, tuple[str, ...]]] = {
    "penetrates": (ball([0, 0, 0.05]), touch(), ("floor", "overlap of 0.05 m at the start")),
    "rough but slips": (
        ball([0, 0, 0.1], linear_velocity=[1, 0, 0]),
        touch(friction={"type": "rough"}),
        ("floor", "slips at 1 m/s at the start", "rough"),
    ),
    "bilateral but apart": (
        ball([0, 0, 0.2]), touch(mode="bilateral"), ("floor", "gap of 0.1 m at the start"),
    ),
    "unknown surface": (BALL, touch(surface={"type": "cone"}), ("cone", "plane", "cylinder")),
    "unknown friction": (BALL, touch(friction={"type": "sticky"}), ("sticky", "coulomb")),
    "unknown motion": (BALL, touch(motion={"type": "flown"}), ("flown", "turntable")),
    "motion of a body": (PARENT, touch(parent="a", motion=TURNTABLE), ("motion", "parent")),
    "shape of the world": (BALL, touch(surface={"type": "shape"}), ("shape", "parent")),
    "bounces up": (BALL, touch(restitution=1.1), ("restitution", "1.1")),
    "pulls back": (BALL, touch(restitution=-0.1), ("restitution", "-0.1")),
    "kinetic above static": (
        BALL, touch(friction=COULOMB | {"kinetic": 0.4}), ("kinetic", "0.3"),
    ),
    "negative friction": (BALL, touch(friction={"type": "coulomb", "static": -1}), ("static",)),
    "infinite friction": (
        BALL, touch(friction={"type": "coulomb", "static": float("inf")}), ("static",),
    ),
    "soft and bilateral": (
        BALL, touch(mode="bilateral", compliance={"stiffness": 1.0}), ("mode", "compliant"),
    ),
    "too large for the pipe": (
        BALL,
        touch(surface={"type": "cylinder", "radius": 0.1, "side": "inside"}),
        ("smaller", "cylinder"),
    ),
    "flatter than the bowl": (
        body({"type": "ellipsoid", "semi_axes": [0.5, 0.5, 0.05]}, [0, 0, 0.9]),
        touch(surface={"type": "sphere", "center": [0, 0, 1], "radius": 0.6, "side": "inside"}),
        ("largest radius of curvature", "0.6 m", "5 m", "two of its points"),
    ),
    "flatter than the pipe": (
        body({"type": "ellipsoid", "semi_axes": [0.5, 0.5, 0.25]}, [0, 0, 0.1]),
        touch(surface={"type": "cylinder", "axis": [1, 0, 0], "radius": 1.0}),
        ("largest radius of curvature", "1 m", "two of its points"),
    ),
    "cylinder on a cylinder": (
        body(CYLINDER, [0, 0, 1]),
        touch(surface={"type": "cylinder", "radius": 0.5, "side": "outside"}),
        ("points", "cylinder"),
    ),
    "in the middle of a bowl": (
        body({"type": "ellipsoid", "semi_axes": [0.1, 0.12, 0.14]}, [0, 0, 1]),
        touch(surface={"type": "sphere", "center": [0, 0, 1], "radius": 1.0, "side": "inside"}),
        ("centre of the round surface", "bodies.body.position"),
    ),
    "on a parent without shape": (
        {"body": BALL, "a": {"mass": 1.0, "inertia": [1, 1, 1]}},
        touch(parent="a", surface={"type": "shape"}),
        ("sphere, box or cylinder", "none"),
    ),
    "no shape at all": (
        {"mass": 1.0, "inertia": [1, 1, 1]}, touch(), ("points", "none"),
    ),
    "too many points": (BALL, touch(points=[[0, 0, 0.01 * i] for i in range(65)]), ("64",)),
    "parent is itself": (BALL, touch(parent="body"), ("parent", "body")),
    "parent is nobody": (BALL, touch(parent="nobody"), ("nobody",)),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_one_clear_line(name: str) -> None:
    bodies, contact, words = REFUSED[name]
    with pytest.raises(SceneError) as caught:
        compile_scene(load_scene(scene(bodies, contact)))
    text = str(caught.value)
    assert "\n" not in text
    assert "floor" in text
    for word in words:
        assert word in text, text


def test_penetration_may_be_projected_away() -> None:
    mapping = scene(ball([0, 0, 0.0999]), touch())
    mapping["simulation"]["project_initial"] = True
    compile_scene(load_scene(mapping))


def test_a_soft_support_may_be_pressed_in_at_the_start() -> None:
    compile_scene(load_scene(scene(ball([0, 0, 0.09]), touch(compliance={"stiffness": 1e3}))))
