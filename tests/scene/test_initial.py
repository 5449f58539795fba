# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Starts at which the lines of a constraint are not numbers are refused in one line."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.scene.compile import compile_scene
from rb_sim.simulation.state_override import compiled_at

BODY = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}


def rod(apart: float) -> dict[str, Any]:
    """Two bodies held `apart` by a rod of length 1, one of them on a pivot."""
    return {
        "bodies": {"a": BODY, "b": BODY | {"position": [apart, 0.0, 0.0]}},
        "constraints": {
            "pivot": {"type": "fixed_point", "body": "a", "point_B": [0.0, 0.0, 0.5]},
            "rod": {"type": "distance", "body": "b", "parent": "a", "point_A": [0, 0, 0],
                    "length": 1.0},
        },
    }  # fmt: skip


@pytest.mark.parametrize("project", [False, True])
def test_a_rod_without_direction_is_refused(project: bool) -> None:
    scene = rod(0.0) | {"simulation": {"project_initial": project}}
    with pytest.raises(SceneError, match=r"constraints\.rod: its points coincide at the start"):
        compile_scene(load_scene(scene))


def test_bodies_put_onto_one_point_are_refused() -> None:
    """Where they are put, not where the scene starts."""
    scene = load_scene(rod(1.0))
    state = np.array([0.0] * 6 + [1.0] + [0.0] * 6)
    with pytest.raises(RbSimError, match="points that must be apart coincide"):
        compiled_at(scene, dict.fromkeys(scene.bodies, state), 0.0, project=True)


def test_lengths_whose_squares_overflow_are_refused() -> None:
    big = {"mass": 1e6, "inertia": [1e6] * 3, "angular_velocity": [0.0, 0.3, 0.0]}
    far = {"mass": 1e-3, "inertia": [1e-4] * 3, "position": [0.0, 0.0, 1.0]}
    link = {"type": "fixed_point", "body": "b", "parent": "a", "point_B": [0.0, 0.0, 1e300]}
    scene = {
        "bodies": {"a": big, "b": far},
        "constraints": {"hinge": {"type": "fixed_point", "body": "a"}, "link": link},
        "simulation": {"project_initial": True},
    }
    with pytest.raises(SceneError, match="initial position overflow"):
        compile_scene(load_scene(scene))


def test_speeds_whose_squares_overflow_are_refused_before_contacts_divide_by_them() -> None:
    floor = {"type": "contact", "body": "ball", "friction": {"type": "coulomb", "static": 0.2}}
    shape = {"type": "sphere", "radius": 0.03}
    ball = {"mass": 0.2, "shape": shape, "inertia": [1e-4] * 3, "position": [0.0, 0.0, 0.03]}
    ball |= {"center_of_mass": [1e60, 0.0, 0.0], "angular_velocity": [0.0, 1e100, 0.0]}
    with pytest.raises(SceneError, match="squares overflow"):
        compile_scene(load_scene({"bodies": {"ball": ball}, "constraints": {"floor": floor}}))


ASKEW = {
    "position": [0.2, -0.1, 0.4],
    "orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.7},
    "linear_velocity": [0.3, 0.1, -0.2],
    "angular_velocity": [0.5, -1.0, 2.0],
}
JOINTS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "point": ({"type": "fixed_point", "point_A": [0.5, 0.0, 0.0]}, {}),
    "axis": ({"type": "fixed_axis", "axis_A": [0.0, 0.0, 1.0], "axis_B": [0.0, 0.6, 0.8]}, {}),
    "guide": (
        {"type": "translation", "guide": {"type": "line", "direction": [0.0, 0.6, 0.8]}},
        {},
    ),
    "disk": ({"type": "rolling"}, {"shape": {"type": "disk", "radius": 0.3}}),
    "line": ({"type": "rolling"}, {"shape": {"type": "cylinder", "radius": 0.2, "length": 0.5}}),
}


@pytest.mark.parametrize("joint", list(JOINTS))
def test_a_body_is_brought_to_one_place_alone_and_beside_others(joint: str) -> None:
    """Beside others too, where coordinates are maximal, a start off a joint moves along the joint's
    own free direction, not to whichever state of the joint an iteration comes upon."""
    spec, more = JOINTS[joint]
    body = {"mass": 2.0, "inertia": [0.02, 0.03, 0.04]} | ASKEW | more
    scene = {
        "bodies": {"body": body},
        "constraints": {"joint": spec | {"body": "body"}},
        "simulation": {"project_initial": True},
    }
    beside = scene | {"bodies": {"body": body, "other": BODY | {"position": [5.0, 0.0, 0.0]}}}
    alone, found = (Simulation(load_scene(one)).sample().block for one in (scene, beside))
    for column in ("position", "orientation", "linear_velocity", "angular_velocity"):
        expected = getattr(alone, column)[:, 0]
        np.testing.assert_allclose(getattr(found, column)[:, 0], expected, atol=1e-12)


def hinged(size: float, apart: float = 0.0, **bob: Any) -> dict[str, Any]:
    """A bob on a hinge of that arm [m]; apart: by how much of it the hinge is torn open."""
    bob |= {"mass": 1.0, "inertia": [size**2] * 3, "position": [(1.0 + apart) * size, 0.0, 0.0]}
    hinge = {"type": "fixed_axis", "body": "bob", "point_B": [-size, 0.0, 0.0]}
    hinge |= {"axis_B": [0.0, 1.0, 0.0], "point_A": [0.0, 0.0, 0.0]}
    return {"bodies": {"bob": bob}, "constraints": {"hinge": hinge}}


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1.0, 1e3])
def test_a_joint_torn_open_is_refused_at_every_size(size: float) -> None:
    """The bearings are a metre apart if nothing else is said: a micrometre was laid on its hinge
    that was a tenth of it beside, without a word."""
    compile_scene(load_scene(hinged(size, 1e-8)))
    with pytest.raises(
        SceneError, match=f"position of bob violates it by {0.1 * size:.2g} m ".replace("+", ".")
    ):
        compile_scene(load_scene(hinged(size, 0.1)))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("contact", [False, True])
def test_so_is_one_beside_another_body(size: float, contact: bool) -> None:
    """With another body all have coordinates of their own; with a contact other tables."""

    def beside(apart: float) -> dict[str, Any]:
        scene = hinged(size, apart)
        other = {"mass": 1.0, "inertia": [size**2] * 3, "position": [0.0, 0.0, 5.0 * size]}
        scene["bodies"]["other"] = other
        if contact:
            other["shape"] = {"type": "sphere", "radius": size}
            scene["constraints"]["floor"] = {"type": "contact", "body": "other"}
        return scene

    compile_scene(load_scene(beside(1e-8)))
    with pytest.raises(
        SceneError, match=f"position violates it by {0.1 * size:.2g} m ".replace("+", ".")
    ):
        compile_scene(load_scene(beside(0.1)))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("along", [0, 1, 2])
def test_the_sine_of_pi_is_no_speed_that_violates_a_joint(size: float, along: int) -> None:
    """1.2e-16 of the speeds that come of a fall, which was said to violate the joint by 1e-4."""
    speed = float(np.sin(np.pi) * np.sqrt(9.81 * size))
    rounded, real = ([factor * speed * (k == along) for k in range(3)] for factor in (1.0, 1e3))
    compile_scene(load_scene(hinged(size, linear_velocity=rounded)))
    with pytest.raises(SceneError, match="velocity of bob violates it"):
        compile_scene(load_scene(hinged(size, linear_velocity=real)))


def test_a_body_hung_at_its_centre_may_be_rounded_there() -> None:
    """It has no arm that a misfit is a share of: 0.1 + 0.2 violated a joint at 0.3 by 5e-5."""
    bob = {"mass": 1.0, "inertia": [0.1] * 3, "position": [0.1 + 0.2, 0.0, 0.0]}
    pivot = {"type": "fixed_point", "body": "bob", "point_A": [0.3, 0.0, 0.0]}
    compile_scene(load_scene({"bodies": {"bob": bob}, "constraints": {"pivot": pivot}}))


@pytest.mark.parametrize(
    ("shape", "given", "cure"),
    [
        ({"type": "sphere"}, {"linear_velocity": [1.0, 0.0, 0.0]}, "[0, 10, 0]"),
        (
            {"type": "sphere"},
            {"linear_velocity": [1.0, 0.0, 0.0], "angular_velocity": [0.0, 5.0, 3.0]},
            "[0, 10, 3]",
        ),
        (
            {"type": "cylinder", "length": 0.4, "axis_B": [0, 1, 0], "center_B": [0, 0.1, 0]},
            {"linear_velocity": [1.0, 0.0, 0.0], "center_of_mass": [0, 0.1, 0]},
            "[0, 10, 0]",
        ),
        ({"type": "sphere"}, {"linear_velocity": [0.0, 0.0, 0.5]}, ""),
    ],
)
def test_a_start_that_slips_is_answered_with_the_rolling_spin(
    shape: dict[str, Any], given: dict[str, Any], cure: str
) -> None:
    """w = v / r: with 7.1 rad/s, the change to the nearest motion, nobody could do anything."""
    body = {"mass": 2.0, "shape": shape | {"radius": 0.1}, "position": [0, 0, 0.1], **given}
    scene = {
        "bodies": {"ball": body},
        "constraints": {"floor": {"type": "rolling", "body": "ball"}},
    }
    with pytest.raises(SceneError) as error:
        compile_scene(load_scene(scene))
    slip = 0.5 if given.get("angular_velocity") or not cure else 1
    assert f"the contact point of ball slips at {slip:g} m/s" in str(error.value)
    assert (f"use angular_velocity {cure} or" if cure else "correct it or") in str(error.value)
    if cure:
        body["angular_velocity"] = [float(part) for part in cure.strip("[]").split(",")]
        compile_scene(load_scene(scene))
