# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Habits of other programs and slips that a scene may hold: one line each."""

from __future__ import annotations

import math
import warnings
from typing import Any

import pytest

from rb_sim import SceneError, SceneWarning, Simulation, load_scene, scenes
from rb_sim.scene.listing import shipped_statics
from rb_sim.scene.load import load_statics

WEIGHT = {"weight": {"type": "gravity"}}


def scene(orientation: Any, **more: Any) -> dict[str, Any]:
    body = {"mass": 1.0, "inertia": [1.0, 1.0, 1.0], "orientation": orientation}
    return {"bodies": {"a": body}, "effects": WEIGHT} | more


def lines(data: dict[str, Any]) -> list[str]:
    """The warnings of loading it."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        load_scene(data)
    assert all(issubclass(each.category, SceneWarning) for each in found)
    return [str(each.message) for each in found]


def test_an_angle_in_degrees_is_refused_with_its_unit():
    with pytest.raises(SceneError, match=r"angle: got 90.*radians.*use 90 deg for degrees"):
        load_scene(scene({"axis": [0, 0, 1], "angle": 90}))
    assert lines(scene({"axis": [0, 0, 1], "angle": -3.5})) == []


@pytest.mark.parametrize("angle", [5, -4.0, 6])
def test_a_whole_number_of_radians_beyond_half_a_turn_gets_one_line(angle):
    (line,) = lines(scene({"axis": [0, 0, 1], "angle": angle}))
    assert f"bodies.a.orientation.angle: {angle:g} is in radians" in line
    assert f"use {angle:g} deg for degrees, or {angle:g} rad" in line


@pytest.mark.parametrize(
    ("text", "radians"), [("5 deg", math.radians(5)), ("-1e2deg", math.radians(-100)), ("5 rad", 5)]
)
def test_an_angle_may_say_its_unit(text, radians):
    given = scene({"axis": [0, 0, 1], "angle": text})
    assert lines(given) == []
    half = 0.5 * radians
    q = load_scene(given).bodies["a"].orientation
    assert q == pytest.approx((0, 0, math.sin(half), math.cos(half)), abs=1e-15)


TORSION = {"type": "torsion_spring", "body": "a", "axis_B": [0, 0, 1], "stiffness": 1.0}
SINE = {"type": "wrench", "body": "a", "sine_force": [1, 0, 0], "angular_frequency": 1.0}


@pytest.mark.parametrize(("law", "key"), [(TORSION, "rest_angle"), (SINE, "phase")])
def test_the_angle_of_an_effect_gets_the_same_line_and_takes_the_same_units(law, key):
    def effect(angle: Any) -> dict[str, Any]:
        return scene([0, 0, 0, 1], effects={"e": law | {key: angle}})

    (line,) = lines(effect(90))
    assert f"effects.e.{key}: 90 is in radians" in line and "use 90 deg for degrees" in line
    assert lines(effect(1.5)) == lines(effect("90 rad")) == []
    assert getattr(load_scene(effect("90 deg")).effects["e"], key) == math.pi / 2


@pytest.mark.parametrize("text", ["5", "5 grad", "deg", "1.2.3 deg", "1e999 deg", ""])
def test_a_text_that_is_no_angle_is_refused(text):
    with pytest.raises(SceneError, match=r"angle: got .*must be a number in radians, or a text"):
        load_scene(scene({"axis": [0, 0, 1], "angle": text}))


@pytest.mark.parametrize(
    ("orientation", "words"),
    [
        (
            [1, 0, 0, 0],
            "half a turn about [1.0, 0.0, 0.0], since the order is [x, y, z, w]; if w "
            "is meant to be first use [0.0, 0.0, 0.0, 1.0], for half a turn {axis: [1.0, 0.0, 0.0]",
        ),
        ([0.8, 0.6, 0, 0], "if w is meant to be first use [0.6, 0.0, 0.0, 0.8], for half a turn"),
        ([0.8, 0, 0.6, 0], "half a turn about [0.8, 0.0, 0.6]"),
        ([0, 0, 1, 1], "length 1.414"),
        ([0, 0, 90, 1], "length 90.01"),
    ],
)
def test_a_quaternion_of_another_order_or_length_gets_one_line(orientation, words):
    (line,) = lines(scene(orientation))
    assert "bodies.a.orientation" in line and words in line


@pytest.mark.parametrize(
    "orientation",
    [
        [0, 0, 0, 1],
        [0, 1, 0, 0],
        [0.6, 0, 0, 0.8],
        [0.5, 0.5, 0.5, 0.5],
        [0.71, 0, 0, 0.71],
        {"axis": [1, 0, 0], "angle": 3.14159},
    ],
)
def test_what_is_meant_gets_none(orientation):
    assert lines(scene(orientation)) == []


def test_a_scene_in_which_nothing_moves():
    (line,) = lines(scene([0, 0, 0, 1], effects={}))
    assert "nothing moves" in line
    spinning = scene([0, 0, 0, 1], effects={})
    spinning["bodies"]["a"]["angular_velocity"] = [0.0, 1.0, 0.0]
    assert lines(spinning) == []
    drag = {"type": "linear_drag", "body": "a", "coefficient": 1.0}
    (line,) = lines(scene([0, 0, 0, 1], effects={"drag": drag}))
    assert "nothing moves: the scene has no effects but drag" in line
    assert lines(scene([0, 0, 0, 1], effects={"wind": drag | {"medium_velocity": [1, 0, 0]}})) == []
    drive = {"type": "velocity", "body": "a", "linear": [1, 0, 0], "rate": 0.1}
    assert not any(
        "nothing" in line for line in lines(scene([0, 0, 0, 1], constraints={"d": drive}))
    )


def one_error(data: dict[str, Any]) -> str:
    with pytest.raises(SceneError) as caught:
        load_scene(data)
    text = str(caught.value)
    assert "\n" not in text
    return text


BALL = {"mass": 0.5, "shape": {"type": "sphere", "radius": 0.05}}


def test_grams_get_one_line_with_the_kilograms():
    (line,) = lines({"bodies": {"ball": BALL | {"mass": 500.0}}, "effects": WEIGHT})
    assert "bodies.ball.mass: 500 kg within a radius of 0.05 m" in line and "grams: 0.5" in line
    assert lines({"bodies": {"ball": BALL | {"mass": 12.0}}, "effects": WEIGHT}) == []  # osmium


def test_millimetres_get_one_line_with_the_metres():
    """In kg/mm^3 no solid is as dense as a ball of 1 m filled with gas is in kg/m^3."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 50.0}}
    (line,) = lines({"bodies": {"ball": ball}, "effects": WEIGHT})
    assert "bodies.ball.mass: 1 kg within a radius of 50 m is lighter than any solid" in line
    assert "from mm: 0.05" in line
    for mass in (1e-3, 3e4):
        ball = {"mass": mass, "shape": {"type": "sphere", "radius": 1.0}}
        assert lines({"bodies": {"ball": ball}, "effects": WEIGHT}) == []


def test_a_weightless_body_at_rest_gets_none():
    rod = {"shape": {"type": "rod", "length": 1.0}}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load_statics({"bodies": {"a": rod}})


def test_a_harmonic_force_without_a_frequency_gets_one_line():
    push = {"type": "wrench", "body": "a", "sine_torque": [0, 0, 1]}

    def heard(**given: Any) -> list[str]:
        return lines(scene([0, 0, 0, 1], effects={"push": push | given}))

    (line,) = heard()
    assert "effects.push.angular_frequency: is 0, so that the harmonic part is zero" in line
    assert heard(angular_frequency=1.0) == heard(phase=1.0) == []


def test_a_support_with_a_shape_that_is_not_named_gets_one_line():
    """Of two spheres one would touch the plane through the middle of the other."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}}
    bodies = {"a": ball, "b": ball | {"position": [0, 0, 0.2]}}
    touch = {"type": "contact", "body": "b", "parent": "a"}

    def heard(**given: Any) -> list[str]:
        data = {"bodies": bodies, "constraints": {"c": touch | given}, "effects": WEIGHT}
        return lines(data)

    (line,) = heard()
    assert line.startswith("<scene>: constraints.c.surface: not given") and "'a'" in line
    assert heard(surface={"type": "shape"}) == heard(surface={"type": "plane"}) == []


def test_an_inertia_beyond_that_of_the_mass_at_the_rim_of_the_shape_gets_one_line():
    """In g cm^2, or with a factor too many; a ring has the largest that a shape allows."""
    (line,) = lines({"bodies": {"a": BALL | {"inertia": [0.9, 0.9, 1.3]}}, "effects": WEIGHT})
    assert line.startswith("<scene>: bodies.a.inertia: 1.3 kg m^2 is more than 0.5 kg within")
    assert "(0.00125)" in line
    ring = BALL | {"inertia": [0.5 * 0.00125, 0.5 * 0.00125, 0.00125]}
    aside = BALL | {"inertia": [0.001, 0.005, 0.005], "center_of_mass": [0.05, 0, 0]}
    assert lines({"bodies": {"a": ring, "b": aside}, "effects": WEIGHT}) == []


@pytest.mark.parametrize(
    ("law", "keys"),
    [
        ({"type": "wrench", "body": "a"}, "force, torque, sine_force, sine_torque are all zero"),
        ({"type": "wrench", "body": "a", "torque": [0, 0, 0]}, "are all zero"),
        ({"type": "spring", "body": "a", "rest_length": 0.3}, "stiffness, damping are all zero"),
        ({"type": "gravity", "acceleration": [0, 0, 0]}, "acceleration is zero"),
    ],
)
def test_an_effect_without_a_strength_gets_one_line(law, keys):
    (line,) = lines(scene([0, 0, 0, 1], effects=WEIGHT | {"e": law}))
    assert line.startswith("<scene>: effects.e: does nothing: ") and line.endswith(keys)
    command = {"type": "commanded_wrench", "body": "a"}
    damper = {"type": "spring", "body": "a", "damping": 1.0}
    assert lines(scene([0, 0, 0, 1], effects={"c": command, "d": damper})) == []


def touching(**given: Any) -> dict[str, Any]:
    floor = {"type": "contact", "body": "a", "surface": {"type": "plane"}} | given
    ball = BALL | {"position": [0, 0, 0.05]}
    return {"bodies": {"a": ball}, "effects": WEIGHT, "constraints": {"floor": floor}}


def test_a_weight_out_of_the_floor_gets_one_line():
    """Not where there is nothing to rest on: z may point down there."""
    up = {"effects": {"weight": {"type": "gravity", "acceleration": [0, 0, 9.81]}}}
    (line,) = lines(touching() | up)
    assert "effects.weight.acceleration: [0.0, 0.0, 9.81] points out of the planes" in line
    assert "use [0.0, 0.0, -9.81], or reverse their normals" in line
    assert lines(scene([0, 0, 0, 1]) | up) == lines(touching()) == []
    ceiling = {"type": "plane", "point": [0, 0, 0.1], "normal": [0, 0, -1]}
    assert lines(touching(surface=ceiling) | up) == []
    both = touching() | up
    both["constraints"] |= {"above": touching(surface=ceiling)["constraints"]["floor"]}
    assert lines(both) == []


def test_a_friction_in_degrees_gets_one_line():
    def heard(**law: Any) -> list[str]:
        return lines(touching(friction=law))

    (line,) = heard(type="coulomb", static=30)
    assert "constraints.floor.friction.static: 30 is a ratio of forces" in line
    assert "(30 degrees: 0.577; no slip at all: {type: rough})" in line
    (line,) = heard(type="regularised", coefficient=1e3, speed=0.1)
    assert "friction.coefficient: 1000 is a ratio" in line and "degrees" not in line
    assert heard(type="coulomb", static=4.0) == heard(type="viscous", coefficient=30.0) == []


def test_a_coefficient_alone_is_refused_with_the_mapping_that_has_it():
    text = one_error(touching(friction=0.5))
    assert "friction: got 0.5; must be a mapping {type: NAME, KEY: ...} as {type: coulomb, " in text
    assert "static: 0.5}; NAME is" in text
    assert " as " not in one_error(touching(friction=-0.5))


def test_shipped_scenes_get_none():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for shipped in scenes():
            load_scene(shipped.name)
        for path in shipped_statics().values():
            load_statics(path)


@pytest.mark.parametrize("given", [[0.1, 0.2, 0.3], {"roll": 0.1, "pitch": 0.2, "yaw": 0.3}])
def test_roll_pitch_yaw_is_refused_with_what_is_taken(given):
    text = one_error(scene(given))
    assert "bodies.a.orientation" in text and "axis" in text


def ball(**keys: Any) -> dict[str, Any]:
    return {"bodies": {"a": BALL | keys}, "effects": WEIGHT}


def with_law(part: str, **keys: Any) -> dict[str, Any]:
    return {"bodies": {"a": BALL}, part: {"law": keys}}


@pytest.mark.parametrize(
    ("data", "words"),
    [
        # the nearest name first, then the others
        (ball(weight=3.0), "bodies.a.weight: unknown key; must be mass, or one of absolute_"),
        (ball(velocity=[1, 0, 0]), "bodies.a.velocity: unknown key; must be linear_velocity, or"),
        (ball(omega=[0, 0, 1]), "bodies.a.omega: unknown key; must be angular_velocity, or one"),
        (ball(rpy=[0, 0, 1]), "bodies.a.rpy: unknown key; must be orientation, or one of"),
        (ball(shape={"type": "sphere", "diameter": 1.0}), "diameter: unknown key; must be radius,"),
        (ball(shape={"type": "sphere", "size": 1.0}), "size: unknown key; must be radius,"),
        (ball(shape={"type": "cuboid", "size": [1, 1, 1]}), "got 'cuboid'; must be box, or one"),
        (ball(shape={"type": "cylinder", "radius": 1.0, "length": 1.0, "height": 2.0}),
         "height: unknown key; must be length, or one of"),
        (ball(shape={"type": "box", "half_extents": [1, 1, 1]}),
         "half_extents: unknown key; must be size, or one of center_B, type"),
        (ball(orientation={"axis": [0, 0, 1], "degrees": 90}),
         "degrees: unknown key; must be angle or axis"),
        (ball() | {"simulation": {"dt": 0.01}}, "simulation.dt: unknown key; must be step, or"),
        (ball() | {"simulation": {"method": "RK4"}}, "got 'RK4'; must be rk4, or one of auto,"),
        (ball() | {"gravity": [0, 0, -9.81]}, "gravity: unknown key; must be effects, or one of"),
        (ball() | {"contacts": {}}, "contacts: unknown key; must be constraints, or one of"),
        (with_law("constraints", type="ball_joint", body="a"), "must be fixed_point, or one of"),
        (with_law("constraints", type="weld", child="a"), "child: unknown key; must be body, or"),
        (ball() | {"simulation": {"integrator": "rk4"}}, "integrator: unknown key; must be method"),
        (with_law("constraints", type="contact", body="a", mu=0.3), "must be friction, or one of"),
        (with_law("effects", type="gravity", g=9.81), "must be acceleration, or one of bodies"),
        (with_law("constraints", type="fixed_axis", body="a", axis=[0, 0, 1]), "must be axis_B,"),
        ({"links": {}}, "links: unknown key; must be bodies, or one of"),
        (ball(com=[0, 0, 0]), "com: unknown key; must be center_of_mass, or one of"),
        (ball(pose=[0, 0, 0]), "pose: unknown key; must be position, or one of"),
        (with_law("effects", type="spring", body="a", k=1), "must be stiffness, or one of"),
        (with_law("effects", type="spring", body="a", c=1), "must be damping, or one of"),
        (with_law("effects", type="torque", body="a"), "must be wrench, or one of"),
        (with_law("constraints", type="Hinge", body="a"), "must be fixed_axis, or one of"),
        (with_law("constraints", type="prismatic", body="a"), "must be translation, or one of"),
        # the beginning of a key
        (ball(quat=[0, 0, 0, 1]), "quat: unknown key; must be orientation, or one of"),
        (ball() | {"simulation": {"t_end": 1.0}}, "t_end: unknown key; must be duration, or"),
        # what belongs elsewhere
        (ball(fixed=True), "bodies.a.fixed: unknown key; must be omitted: leave out a body that"),
        (ball(friction=0.3), "bodies.a.friction: unknown key; must be a key of a constraint of"),
        (with_law("effects", type="fixed_point", body="a"),
         "effects.law.type: got 'fixed_point'; must be listed under constraints, or here one of"),
        (with_law("constraints", type="gravity"), "got 'gravity'; must be listed under effects,"),
        # a decimal comma within braces
        (ball(**{"5": None}), "bodies.a.5: unknown key; must be omitted (a decimal number has a"),
        # names of types have the keys that each needs
        (with_law("constraints", type="contact", body="a", friction=0.3), "coulomb (static), "),
        (with_law("constraints", type="translation", body="a", guide=[1, 0, 0]),
         "must be a mapping {type: NAME, KEY: ...}; NAME is one of circle (center, normal, radius"),
        (ball(shape="ball"), "NAME is sphere (radius), or one of box (size), cylinder (radius,"),
        # a body is named
        (with_law("constraints", type="rolling"), "law.body: is missing; must be the name of a"),
        (with_law("effects", type="spring"), "effects.law.body: is missing; must be the name of a"),
        (with_law("constraints", type="weld", body="a", parent=3), "got 3; must be the name of a"),
        # a quaternion with names, in the order of no program in particular
        (ball(orientation={"w": 1, "x": 0, "y": 0, "z": 0}),
         "got {w: 1, x: 0, y: 0, z: 0}; must be a quaternion [x, y, z, w]"),
        # numbers that no body has
        (ball(inertia=[1, 1, 3]), "no principal moment above the sum of the others, but 3 > 1 + 1"),
        (ball(inertia=[[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "must be a symmetric inertia tensor"),
        (ball(mass=math.inf), "bodies.a.mass: got inf; must be a finite number"),
        (ball(mass="500 g"), "mass: got '500 g'; must be a number"),
        (with_law("effects", type="gravity", acceleration=-9.81), "law.acceleration: got -9.81;"),
        (ball(position=["10 cm", 0, 0]), "bodies.a.position[0]: got '10 cm'; must be a number"),
        # several places with the same mistake
        (ball(position=[math.nan, math.nan, 0]), "bodies.a.position[0]: got nan; must be a finite"
         " number (as bodies.a.position[1])"),
    ],
)  # fmt: skip
def test_a_wrong_key_or_value_gets_one_line_with_the_nearest_name_first(data, words):
    assert words in one_error(data)


def test_an_error_has_a_line_for_each_mistake():
    with pytest.raises(SceneError) as caught:
        load_scene(ball(mass=-1.0, position=[0, 0]) | {"simulation": {"rate": 0}})
    assert str(caught.value).startswith("<scene>: bodies.a.mass: got -1.0; must be a number > 0; ")
    assert caught.value.lines == (
        "<scene>: bodies.a.mass: got -1.0; must be a number > 0",
        "<scene>: bodies.a.position: got [0, 0]; must be 3 numbers [x, y, z]",
        "<scene>: simulation.rate: got 0; must be a number > 0",
    )


def test_a_scene_of_bodies_at_rest_is_named_as_such():
    rod = {"shape": {"type": "rod", "length": 1.0}}
    text = one_error({"bodies": {"a": rod}, "supports": {"s": {"type": "hinge", "body": "a"}}})
    assert "is for rb_sim statics only: bodies.a.mass: is missing" in text


HINGE = {"hinge": {"type": "fixed_axis", "body": "a", "axis_B": [0, 0, 1]}}


def test_a_start_that_a_joint_does_not_allow_names_the_nearest_one_that_it_does():
    """A rod of 1 m on a hinge at its end: of all spins that with the least error of momenta,
    w = 3 v / (2 l)."""
    rod = {"mass": 1.0, "shape": {"type": "rod", "length": 1.0, "axis_B": [1, 0, 0]}}
    rod["shape"]["center_B"] = rod["center_of_mass"] = [0.5, 0, 0]
    data = {"bodies": {"a": rod | {"linear_velocity": [0, 1, 0]}}, "constraints": HINGE}
    with pytest.raises(SceneError, match=r"use linear_velocity \[0, 0, 0\], angular_velocity "
                       r"\[0, 0, 1.5\] or set simulation.project_initial"):  # fmt: skip
        Simulation(data)
    Simulation({**data, "bodies": {"a": rod | {"angular_velocity": [0, 0, 1.5]}}})


def test_a_list_of_names_is_short():
    """A scene of thirty bodies does not list them all for one wrong name."""
    bodies = {f"link{i}": BALL for i in range(30)}
    joint = {"type": "fixed_point", "body": "lin7"}
    text = one_error({"bodies": bodies, "constraints": {"c": joint}})
    assert "a body of the scene: link7, or one of link0" in text and "and 15 more" in text
