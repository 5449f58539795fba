# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Starts: what is refused in one line, and what a misfit means at every size."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError, SceneError
from rb_sim.mechanics.table_laws import BODIES, TableLaws
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
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
        ({"type": "sphere"}, {"linear_velocity": [1.0, 0.0, 0.0]}, "angular_velocity [0, 10, 0]"),
        (
            {"type": "sphere"},
            {"linear_velocity": [1.0, 0.0, 0.0], "angular_velocity": [0.0, 5.0, 3.0]},
            "angular_velocity [0, 10, 3]",
        ),
        (
            {"type": "cylinder", "length": 0.4, "axis_B": [0, 1, 0], "center_B": [0, 0.1, 0]},
            {"linear_velocity": [1.0, 0.0, 0.0], "center_of_mass": [0, 0.1, 0]},
            "angular_velocity [0, 10, 0]",
        ),
        ({"type": "sphere"}, {"linear_velocity": [0.0, 0.0, 0.5]}, "linear_velocity [0, 0, 0]"),
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
    slip = 0.5 if given.get("angular_velocity") or cure.startswith("linear") else 1
    assert f"the contact point of ball slips at {slip:g} m/s" in str(error.value)
    assert f"use {cure} or" in str(error.value)
    key, _, value = cure.partition(" ")
    body[key] = [float(part) for part in value.strip("[]").split(",")]
    compile_scene(load_scene(scene))


# What a start or a run violates of an angle or a spin means the same whatever a scene's size.


SIZES = (1e-6, 1e-3, 1.0, 1e3, 1e5)


def body(size: float) -> dict[str, Any]:
    squares = np.array([0.1, 0.2, 0.25]) * size**2
    return {"mass": 1.0, "inertia": squares.tolist(), "center_of_mass": [0.3 * size, 0, 0]}


def upright(size: float, tilt: float = 0.0, spin: float = 0.0) -> dict[str, Any]:
    """A body on a plane whose axis, off by `tilt` [rad], is to stay parallel to z; it falls over
    its size in half a second."""
    start = {"orientation": {"axis": [1, 0, 0], "angle": tilt}, "angular_velocity": [spin, 0, 0]}
    return {
        "bodies": {"b": body(size) | start},
        "constraints": {
            "upright": {"type": "parallel", "body": "b", "axis_B": [0, 0, 1], "axis_A": [0, 0, 1]},
            "table": {"type": "plane", "body": "b", "point_B": [size, 0, 0], "normal_A": [0, 0, 1]},
        },
        "effects": {"weight": {"type": "gravity", "acceleration": [size, 0, -size]}},
        "simulation": {"duration": 0.1, "rate": 10.0, "method": "rk4", "step": 0.01},
    }


@pytest.mark.parametrize("size", SIZES)
def test_a_tilt_is_refused_by_its_angle(size: float) -> None:
    """At a kilometre 1e-3 rad were taken for rounding without a word, and the body turned."""
    with pytest.raises(SceneError, match=r"upright: the initial position violates it by 1e-05 rad"):
        Simulation(scene_from_mapping(upright(size, tilt=1e-5)))
    Simulation(scene_from_mapping(upright(size, tilt=1e-7)))


@pytest.mark.parametrize("size", SIZES)
def test_a_spin_is_refused_by_its_speed_at_the_scene_s_size(size: float) -> None:
    fall = math.sqrt(9.81 * size)
    with pytest.raises(SceneError, match="upright: the initial velocity violates it by"):
        Simulation(scene_from_mapping(upright(size, spin=1e-5 * fall / size)))
    Simulation(scene_from_mapping(upright(size, spin=1e-8 * fall / size)))


def test_a_driven_spin_that_starts_otherwise_is_refused_in_its_unit() -> None:
    """A shaft that a drive turns at 3 rad/s, and one that a knife edge moves at 3 m/s."""
    shaft = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    hinge = {"type": "fixed_axis", "body": "shaft", "axis_B": [0, 1, 0]}
    drive = {"type": "velocity", "body": "shaft", "angular": [0, 1, 0], "rate": 3.0}
    scene = {"bodies": {"shaft": shaft}, "constraints": {"hinge": hinge, "drive": drive}}
    with pytest.raises(SceneError, match=r"drive: .* violates it by 3 rad/s \(must be 0\)"):
        compile_scene(load_scene(scene))
    sled = {"type": "velocity", "body": "shaft", "linear": [1, 0, 0], "rate": 3.0}
    scene["constraints"] = {
        "drive": sled,
        "hinge": {"type": "parallel", "body": "shaft", "axis_B": [0, 0, 1]},
    }
    with pytest.raises(SceneError, match=r"drive: .* violates it by 3 m/s \(must be 0\)"):
        compile_scene(load_scene(scene))


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("count", [2, BODIES])
def test_a_run_is_on_its_constraints_at_every_size(size: float, count: int) -> None:
    """Rounding of an attitude was told as a violation at a micrometre: 1e-16 rad over 1e-6 m."""
    names = [f"b{k}" for k in range(count)]
    welds: dict[str, Any] = {}
    for name, parent in zip(names[1:], names[:-1], strict=True):
        welds[name] = {"type": "weld", "body": name, "parent": parent}
    spin = {"orientation": {"axis": [1, 2, 3], "angle": 0.7}}
    bodies = {n: body(size) | spin | {"position": [0, k * size, 0]} for k, n in enumerate(names)}
    push = {"type": "wrench", "body": "b0", "force": [size, 0, 0], "torque": [0, size**2, size**2]}
    scene = upright(size) | {
        "bodies": bodies,
        "constraints": {"foot": {"type": "fixed_point", "body": "b0"}} | welds,
    }
    scene["effects"] = scene["effects"] | {"push": push}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        simulation = Simulation(scene_from_mapping(scene))
        assert isinstance(simulation.compiled.laws, TableLaws) == (count == BODIES)
        assert simulation.run().residual.max() < 1e-12


# Lines that depend on each other for good are kept and named; in one position only, refused.


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
        compiled(links(0.0, mass, size))


@pytest.mark.parametrize(("mass", "size"), [(1.0, 1.0), (1e6, 1e-3), (1e-6, 1e3)])
def test_beside_the_dead_centre_the_links_are_two_lines(mass: float, size: float) -> None:
    assert compiled(links(0.01, mass, size)) == (4, ())


def test_a_flat_parallelogram_is_refused_where_its_motion_branches() -> None:
    with pytest.raises(SceneError, match="dead centre"):
        compiled(four_bar(0.0))


def test_a_four_bar_keeps_what_is_redundant_at_every_angle() -> None:
    """20 lines of rank 17: out of their plane the hinges hold each other, wherever the bars are."""
    freedom, named = compiled(four_bar(0.7))
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
    assert compiled(scene) == (1, ("axle", "axle/A", "axle/B"))


@pytest.mark.parametrize("kind", ["disk", "cylinder"])
def test_a_rim_that_starts_flat_is_refused(kind: str) -> None:
    length = {"length": 0.2} if kind == "cylinder" else {}
    shape = {"type": kind, "radius": 0.1, "axis_B": [0.0, 0.0, 1.0]} | length
    plane = {"type": "rolling", "body": "coin", "normal_A": [0.0, 0.0, 1.0]}
    scene = {"bodies": {"coin": {"mass": 1.0, "shape": shape}}, "constraints": {"floor": plane}}
    with pytest.raises(SceneError, match="the rim of coin starts flat"):
        compile_scene(load_scene(scene))
