# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Lines that depend on each other for good are kept and named; in one position only, refused."""

from __future__ import annotations

import math
from typing import Any

import pytest

from rb_sim import load_scene
from rb_sim.base.errors import SceneError
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted

HINGE = {"type": "fixed_axis", "axis_B": [0.0, 1.0, 0.0], "floating": "B"}


def links(apart: float, mass: float = 1.0, size: float = 1.0) -> dict[str, Any]:
    """A point held by two links of length `size` to points 2 size apart, `apart` off their line."""
    across, along = apart * size, size * math.sqrt(1.0 - apart * apart)
    ends = {"left": [-along, 0.0, 0.0], "right": [along, 0.0, 0.0]}
    inertia = [0.1 * mass * size**2] * 3
    return {
        "bodies": {"knee": {"mass": mass, "inertia": inertia, "position": [0.0, 0.0, across]}},
        "constraints": {
            name: {"type": "distance", "body": "knee", "point_A": point, "length": size}
            for name, point in ends.items()
        },
        "effects": {"weight": {"type": "gravity"}},
    }


def four_bar(crank: float, coupler: float = 1.0) -> dict[str, Any]:
    """Hinged bars in the plane y = 0: two cranks of length 0.5 and a coupler, seen from above x."""
    c, s = 0.5 * math.cos(crank), 0.5 * math.sin(crank)
    bodies, constraints = {}, {}
    for name, foot in (("first", 0.0), ("second", coupler)):
        turn = {"axis": [0.0, 1.0, 0.0], "angle": -crank}
        bodies[name] = bar(0.5) | {"position": [foot + c / 2, 0.0, s / 2], "orientation": turn}
        constraints[f"foot_{name}"] = HINGE | {"body": name, "point_B": [-0.25, 0.0, 0.0]}
    bodies["coupler"] = bar(coupler) | {"position": [c + coupler / 2, 0.0, s]}
    for name, end in (("first", -coupler / 2), ("second", coupler / 2)):
        at = {"point_B": [end, 0.0, 0.0], "point_A": [0.25, 0.0, 0.0]}
        constraints[f"top_{name}"] = HINGE | at | {"body": "coupler", "parent": name}
    return {"bodies": bodies, "constraints": constraints, "effects": {"w": {"type": "gravity"}}}


def bar(length: float) -> dict[str, Any]:
    across = length**2 / 12.0
    return {"mass": 1.0, "inertia": [1e-3, across, across]}


def compiled(scene: dict[str, Any]) -> tuple[int, tuple[str, ...]]:
    """(degrees of freedom, undetermined reactions)."""
    found = compile_scene(load_scene(scene), coordinates="maximal")
    return found.degrees_of_freedom, found.indeterminate


@pytest.mark.parametrize(("mass", "size"), [(1.0, 1.0), (1e6, 1e-3), (1e-6, 1e3)])
def test_two_links_at_dead_centre_are_refused_by_name(mass: float, size: float) -> None:
    with pytest.raises(
        SceneError, match="singular initial position: left, right lose rank .* dead centre"
    ):
        interpreted(compiled, links(0.0, mass, size))


@pytest.mark.parametrize(("mass", "size"), [(1.0, 1.0), (1e6, 1e-3), (1e-6, 1e3)])
def test_beside_the_dead_centre_the_links_are_two_lines(mass: float, size: float) -> None:
    assert interpreted(compiled, links(0.01, mass, size)) == (4, ())


def test_a_flat_parallelogram_is_refused_where_its_motion_branches() -> None:
    with pytest.raises(SceneError, match="dead centre"):
        interpreted(compiled, four_bar(0.0))


def test_a_four_bar_keeps_what_is_redundant_at_every_angle() -> None:
    """20 lines of rank 17: out of their plane the hinges hold each other, wherever the bars are."""
    freedom, named = interpreted(compiled, four_bar(0.7))
    assert freedom == 1
    assert {"foot_first", "foot_second", "top_first", "top_second"} <= set(named)


@pytest.mark.parametrize("axis", [[0.0, 1.0, 0.0], [0.0, 0.6, 0.8], [0.3, -0.5, 0.2]])
def test_two_bearings_that_both_carry_axial_force_share_it(axis: list[float]) -> None:
    """Askew, too, where what should vanish is rounding."""
    at = {"point_B": [-0.5, 0.1, 0.3], "axis_B": axis}
    scene = {
        "bodies": {
            "wheel": {"mass": 2.0, "inertia": [0.3, 0.2, 0.25], "position": [0.7, 0.2, 0.1]}
        },
        "constraints": {"axle": HINGE | at | {"body": "wheel", "floating": "none"}},
        "effects": {"weight": {"type": "gravity"}},
    }
    assert interpreted(compiled, scene) == (1, ("axle", "axle/A", "axle/B"))


@pytest.mark.parametrize("kind", ["disk", "cylinder"])
def test_a_rim_that_starts_flat_is_refused(kind: str) -> None:
    length = {"length": 0.2} if kind == "cylinder" else {}
    shape = {"type": kind, "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]} | length
    plane = {"type": "rolling", "body": "coin", "normal_A": [0.0, 0.0, 1.0]}
    scene = {"bodies": {"coin": {"mass": 1.0, "shape": shape}}, "constraints": {"floor": plane}}
    with pytest.raises(SceneError, match="the rim of coin starts flat"):
        compile_scene(load_scene(scene))
