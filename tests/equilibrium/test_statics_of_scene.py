# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Statics of ordinary scenes: their joints, effects and contacts at the initial pose."""

from __future__ import annotations

import math
from math import asin, cos, inf, sin
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import rb_sim
from rb_sim import RbSimError, SceneError, Simulation, load_scene, scenes
from rb_sim.cli.summary import _ranges_at_start as ranges_at_start
from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_tables import StaticsResult
from tests.contact.scenes import G, ball, box, scene, touch
from tests.runs import trajectory


def asked(bodies: Any, constraints: Any, **effects: Any) -> StaticsResult:
    """Under gravity."""
    return solve(load_scene(scene(bodies, constraints, **effects)))


def test_ladder_with_its_closed_form() -> None:
    """Smooth wall: N = m g, T = H = m g / (2 tan); as rods and walls of a scene of motion."""
    angle, length = math.radians(60.0), 4.0
    top = [length * math.cos(angle), 0.0, length * math.sin(angle)]
    middle = [0.5 * value for value in top]
    turn = {"axis": [0.0, 1.0, 0.0], "angle": 0.5 * math.pi - angle}
    rod = {"mass": 10.0, "shape": {"type": "rod", "length": length}, "position": middle}
    wall = {"type": "plane", "point": top, "normal": [-1.0, 0.0, 0.0]}
    ends = [[0.0, 0.0, -0.5 * length]], [[0.0, 0.0, 0.5 * length]]
    constraints = {
        "floor": touch("ladder", 0.5, points=ends[0]),
        "wall": touch("ladder", surface=wall, points=ends[1]),
    }
    found = asked({"ladder": rod | {"orientation": turn}}, constraints)
    assert found.verdict == "equilibrium", found.explanation
    push = 10.0 * G / (2.0 * math.tan(angle))
    assert_allclose(found.reactions["floor"].force, [push, 0.0, 10.0 * G], atol=1e-10)
    assert_allclose(found.reactions["wall"].force, [-push, 0.0, 0.0], atol=1e-10)
    assert found.reactions["floor"].friction_used == pytest.approx(push / (10.0 * G), rel=1e-12)
    constraints["floor"] = touch("ladder", 0.25, points=ends[0])
    slips = asked({"ladder": rod | {"orientation": turn}}, constraints)
    assert slips.verdict == "no equilibrium"
    assert (
        "contact 'floor' slips: it would need friction 0.288675 and has 0.25" in slips.explanation
    )


@pytest.mark.parametrize(("overhang", "stands"), [(0.19, True), (0.21, False)])
def test_box_that_overhangs_another(overhang: float, stands: bool) -> None:
    """It falls when its centre passes the edge; its corners lie beyond the lower box's face."""
    bodies = {
        "low": box([0.4, 0.4, 0.2], [0, 0, 0.1]),
        "high": box([0.4, 0.3, 0.2], [overhang, 0.02, 0.3]),
    }
    on = touch("high", 0.5, parent="low", surface={"type": "shape"})
    found = asked(bodies, {"floor": touch("low", 0.5), "on": on})
    assert (found.verdict != "no equilibrium") == stands
    if stands:
        total = sum(r.force for name, r in found.reactions.items() if name.startswith("on"))
        assert_allclose(total, [0.0, 0.0, G], atol=1e-9)


def test_beams_that_cross_hold_each_other() -> None:
    """Their common face has four corners, none of them a corner of either beam."""
    bodies = {
        "low": box([1.0, 0.1, 0.1], [0, 0, 0.05]),
        "high": box([0.1, 1.0, 0.1], [0, 0, 0.15]),
    }
    on = touch("high", 0.5, parent="low", surface={"type": "shape"})
    found = asked(bodies, {"floor": touch("low", 0.5), "on": on})
    assert found.verdict == "indeterminate"
    assert len([name for name in found.reactions if name.startswith("on")]) == 4


@pytest.mark.parametrize(("share", "stands"), [(0.999, True), (1.001, False)])
def test_ball_on_a_slope_is_held_by_rolling_resistance(share: float, stands: bool) -> None:
    """Up to tan = arm / radius."""
    arm, radius = 0.01, 0.1
    angle = math.atan(share * arm / radius)
    normal = [math.sin(angle), 0.0, math.cos(angle)]
    slope = touch(mu=0.9, surface={"type": "plane", "normal": normal}, rolling_resistance=arm)
    found = asked(ball([radius * x for x in normal], radius), slope)
    assert (found.verdict == "equilibrium") == stands
    assert stands or "rolls: it would need a rolling resistance of 0.01001 m" in found.explanation


@pytest.mark.parametrize(("share", "stands"), [(0.99, True), (1.01, False)])
def test_ball_is_held_against_a_twist_by_spinning_resistance(share: float, stands: bool) -> None:
    """Up to arm m g."""
    twist = {"type": "wrench", "body": "body", "torque": [0.0, 0.0, share * 0.01 * G]}
    floor = touch(mu=0.9, spinning_resistance=0.01, rolling_resistance=0.002)
    found = asked(ball([0, 0, 0.1]), floor, twist=twist)
    assert (found.verdict == "equilibrium") == stands
    assert stands or "spins: it would need a spinning resistance of" in found.explanation


@pytest.mark.parametrize("deeper", [0.0, 1e-4])
def test_support_that_gives_way_pushes_as_deep_as_it_is(deeper: float) -> None:
    """N = k depth, whatever the weight: only at depth m g / k is it in equilibrium."""
    depth = G / 1.0e4 + deeper
    soft = touch(mu=0.5, compliance={"stiffness": 1.0e4})
    side = {"type": "wrench", "body": "body", "force": [0.4 * G, 0.0, 0.0]}
    found = asked(ball([0, 0, 0.1 - depth]), soft | {"rolling_resistance": 0.1}, side=side)
    if deeper:
        assert found.verdict == "no equilibrium"
    else:
        assert found.verdict == "equilibrium", found.explanation
        assert_allclose(found.reactions["floor"].force, [-0.4 * G, 0.0, G], atol=1e-9)
        assert found.reactions["floor"].along == pytest.approx(G, rel=1e-12)


def test_string_holds_and_a_slack_one_does_not() -> None:
    tie = {"type": "string", "body": "body", "point_A": [0.0, 0.0, 1.0], "length": 1.0}
    held = asked(ball([0, 0, 0]), tie)
    assert held.verdict == "equilibrium"
    assert_allclose(held.reactions["floor"].force, [0, 0, G], atol=1e-12)
    slack = asked(ball([0, 0, 0.1]), tie)
    assert (slack.verdict, slack.apart) == ("no equilibrium", ("floor",))


JOINTS: dict[str, dict[str, Any]] = {
    "weld": {"type": "weld", "point_B": [0.1, -0.2, 0.3]},
    "hinge": {
        "type": "fixed_axis",
        "point_B": [0.1, -0.2, 0.3],
        "axis_B": [0.3, 0.4, 0.866],
        "bearing_distance": 0.4,
    },
    "ball joint": {"type": "fixed_point", "point_B": [0.1, -0.2, 0.3]},
    "rail": {"type": "translation", "guide": {"type": "line", "direction": [1.0, 0.5, 0.2]}},
}

HINGES = ("weld", "hinge", "ball joint")
"""Those that may hold the body to another one."""


@pytest.mark.parametrize(
    ("name", "parent"), [*((name, None) for name in JOINTS), *((n, "arm") for n in HINGES)]
)
def test_joint_holds_as_it_does_in_motion(name: str, parent: str | None) -> None:
    """What is balanced in every direction that the joint leaves free stays at rest when it runs:
    the reactions at the start are those of statics."""
    joint = JOINTS[name]
    body = {
        "mass": 2.0,
        "inertia": [0.2, 0.3, 0.4],
        "center_of_mass": [0.05, 0.02, -0.04],
        "position": [0.3, 0.1, 0.5],
        "orientation": Rotation.from_rotvec([0.2, -0.4, 0.3]).as_quat().tolist(),
    }
    arm = {
        "mass": 3.0,
        "inertia": [0.3, 0.3, 0.3],
        "orientation": Rotation.from_rotvec([0.1, 0.2, -0.3]).as_quat().tolist(),
    }
    own = joint | {"body": "b"} | ({} if parent is None else {"parent": parent})
    bodies = {"b": body} | ({} if parent is None else {"arm": arm})
    constraints = {"joint": own} | (
        {} if parent is None else {"wall": {"type": "weld", "body": "arm"}}
    )
    push = {"type": "wrench", "body": "b", "force": [3.0, -2.0, 1.0], "torque": [0.3, 0.1, -0.2]}
    mapping = {
        "bodies": bodies,
        "constraints": constraints,
        "effects": {"push": balanced(push, name, body)},
        "simulation": {"duration": 0.1, "rate": 10.0},
    }
    found = solve(load_scene(mapping))
    assert found.verdict in ("equilibrium", "indeterminate"), found.explanation
    block = trajectory(mapping)
    assert np.abs(block.angular_velocity).max() < 1e-12
    resting = {n: r for n, r in found.reactions.items() if n.split("/")[0] == "joint"}
    total = sum(r.force for r in resting.values())
    assert_allclose(total, block.reaction_force[0, 0], atol=1e-10)
    centre = block.position[0, 0]
    about = sum(r.torque + np.cross(r.anchor - centre, r.force) for r in resting.values())
    moving = block.reaction_torque[0, 0] + np.cross(block.anchor[0, 0] - centre, total)
    assert_allclose(about, moving, atol=1e-10)


def balanced(push: dict[str, Any], name: str, body: dict[str, Any]) -> dict[str, Any]:
    """The push without what the joint cannot carry."""
    turn = Rotation.from_quat(body["orientation"])
    force, torque = np.array(push["force"]), np.array(push["torque"])
    if name == "rail":
        along = np.array([1.0, 0.5, 0.2]) / np.linalg.norm([1.0, 0.5, 0.2])
        force = force - along * (along @ force)
    elif name in ("hinge", "ball joint"):
        arm = -turn.apply([0.1, -0.2, 0.3])  # from the joint to the body origin
        about = torque + np.cross(arm, force)
        if name == "hinge":
            axis = turn.apply(np.array([0.3, 0.4, 0.866]) / np.linalg.norm([0.3, 0.4, 0.866]))
            torque = torque - axis * (axis @ about)
        else:
            torque = torque - about
    return push | {"force": force.tolist(), "torque": torque.tolist()}


@pytest.mark.parametrize("name", [scene.name for scene in scenes()])
def test_every_shipped_scene_has_an_answer(name: str) -> None:
    """And where it has reactions, they balance the loads."""
    found = solve(load_scene(name), ranges=False)
    for force, torque in found.balance.values():
        assert_allclose([*force, *torque], 0.0, atol=1e-9)
    assert found.reactions or found.findings or found.explanation


def test_bilateral_contact_with_friction_is_refused() -> None:
    with pytest.raises(SceneError, match="constraints.floor: statics takes a bilateral contact"):
        asked(ball([0, 0, 0.1]), touch(mu=0.5, mode="bilateral"))


@pytest.mark.parametrize(("end", "pull"), [([0, 0, 0], -10.0 * G), ([0, 0, 2], 10.0 * G)])
def test_a_distance_is_pulled_from_above_and_pushed_from_below(end: Any, pull: float) -> None:
    """A block on a vertical rail stands on a leg, or hangs from a rod: tension is positive."""
    block = {"mass": 10.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, 1.0]}
    rail = {"type": "translation", "body": "block", "guide": {"type": "line"}}
    rail["guide"]["direction"] = [0.0, 0.0, 1.0]
    rod = {"type": "distance", "body": "block", "point_A": end}
    found = asked({"block": block}, {"rail": rail, "rod": rod})
    assert found.reactions["rod"].along == pytest.approx(pull, rel=1e-12)
    assert_allclose(found.reactions["rod"].force, [0.0, 0.0, 10.0 * G], atol=1e-9)


def test_the_short_form_moves_with_the_reactions_of_its_equilibrium() -> None:
    """Of a standing ladder, a scene of supports and loads; at once and after a second."""
    standing = load_scene("ladder_smooth_wall", duration=1.0, rate=10.0)
    found, run = solve(standing), Simulation(standing).run(checks=False)
    assert_allclose(
        run.block.reaction_force[0], [r.force for r in found.reactions.values()], atol=1e-9
    )
    assert np.abs(run.block.position[-1] - run.block.position[0]).max() < 1e-9


def test_what_only_rests_is_refused_in_motion() -> None:
    with pytest.raises(SceneError, match="supports.edge_C.normal_B: .*at rest: rb_sim statics"):
        load_scene("rod_over_wall")
    with pytest.raises(SceneError, match="bodies.rod_AC.mass: is missing"):
        load_scene("hinged_rods")


# Ranges of reactions of bodies in motion: which components the motion does not determine.


R, L, TURNED = 1.0, 2.5, 0.7
G_MOTION = 9.81


def slider_crank() -> dict[str, Any]:
    """In the plane x, y; all pins along z, each able to carry bending and thrust."""
    tilt = -asin(R * sin(TURNED) / L)
    tip = np.array([R * cos(TURNED), R * sin(TURNED), 0.0])
    half = 0.5 * L * np.array([cos(tilt), sin(tilt), 0.0])

    def body(mass: float, at: Any, angle: float) -> dict[str, Any]:
        turned = [0.0, 0.0, sin(angle / 2), cos(angle / 2)]
        inertia = [0.1, 0.2, 0.2]
        return {"mass": mass, "inertia": inertia, "position": list(at), "orientation": turned}

    def pin(body: str, at: float, parent: str | None) -> dict[str, Any]:
        joint = {"type": "fixed_axis", "body": body, "axis_B": [0, 0, 1], "point_B": [at, 0, 0]}
        return joint if parent is None else joint | {"parent": parent}

    rail = {"type": "line", "direction": [1.0, 0.0, 0.0]}
    return {
        "bodies": {
            "crank": body(1.0, tip / 2, TURNED),
            "rod": body(2.0, tip + half, tilt),
            "slider": body(3.0, tip + 2.0 * half, 0.0),
        },
        "constraints": {
            "main": pin("crank", -R / 2, None),
            "pin": pin("rod", -L / 2, "crank"),
            "wrist": pin("rod", L / 2, "slider"),
            "guide": {"type": "translation", "body": "slider", "guide": rail},
        },
        "effects": {"g": {"type": "gravity", "acceleration": [0.0, -G_MOTION, 0.0]}},
        "simulation": {"duration": 0.5, "rate": 10.0},
    }


def test_in_a_plane_the_components_out_of_it_are_nobodys_load():
    run = Simulation(slider_crank()).run(checks=False)
    ranges = rb_sim.reaction_ranges(run, 3)
    assert set(ranges) == set(run.layout.reactions)
    out_of_plane = {"force_z", "torque_x", "torque_y"}
    for name in ("main", "pin", "wrist", "guide"):
        assert set(ranges[name].undetermined) == out_of_plane
        assert all(span == [-inf, inf] for span in ranges[name].undetermined.values())
        inside = ranges[name].force[:2]
        assert_allclose(inside[:, 0], run.reaction[name].force[3, :2], atol=1e-6)
        assert_allclose(inside[:, 1], run.reaction[name].force[3, :2], atol=1e-6)
    assert set(ranges["pin/A"].undetermined) == {"force_x", "force_y", "force_z"}
    summary = ranges_at_start(Simulation(slider_crank()))
    assert set(summary["pin"]) == out_of_plane


def test_a_body_that_only_moves_along_has_no_load_that_fails():
    """A crank falls and takes its rod and slider along; the weight of the slider is on its rail."""
    found = rb_sim.statics(slider_crank())
    assert found.verdict == "no equilibrium"
    assert [(of.kind, of.name) for of in found.findings] == [("torque", "crank"), ("torque", "rod")]
    arm = 0.5 * R * cos(TURNED)
    assert abs(found.findings[0].amount) == pytest.approx(1.0 * G_MOTION * arm)


def table(speed: float, mu: float) -> dict[str, Any]:
    half = 0.5
    legs = [[sx * half, sy * half, -half] for sx in (1, -1) for sy in (1, -1)]
    top = {"mass": 4.0, "inertia": [1.0, 1.0, 1.0], "position": [0.0, 0.0, half]}
    floor = {"type": "contact", "body": "top", "points": legs}
    floor |= {"friction": {"type": "coulomb", "static": mu, "kinetic": mu}}
    return {
        "bodies": {"top": top | {"linear_velocity": [speed, 0.0, 0.0]}},
        "constraints": {"floor": floor},
        "effects": {"g": {"type": "gravity"}},
        "simulation": {"duration": 0.2, "rate": 10.0},
    }


def test_a_sliding_table_brakes_with_all_its_legs():
    """Friction mu m g pitches it: the front pair carries m g / 2 (1 + mu), the rear one the rest,
    each side m g / 2. So a front leg carries mu m g / 2 to m g / 2, a rear one 0 to m g / 2 (1 -
    mu); the friction of a leg is -mu times its push."""
    mu, weight = 0.3, 4.0 * G_MOTION
    run = Simulation(table(2.0, mu)).run(checks=False)
    ranges = rb_sim.reaction_ranges(run)
    for k, x in enumerate((1, 1, -1, -1)):
        span = ranges[f"floor/{k + 1}"]
        push = weight / 2.0 * np.array([mu, 1.0] if x > 0 else [0.0, 1.0 - mu])
        assert_allclose(span.force[2], push, atol=1e-6)
        assert_allclose(span.force[0], -mu * push[::-1], atol=1e-6)
        assert_allclose(span.force[1], 0.0, atol=1e-9)


def test_averages_of_a_step_have_no_ranges():
    scene = table(0.0, 0.3)
    scene["simulation"] |= {"method": "time_stepping", "step": 0.01}
    with pytest.raises(RbSimError, match="time_stepping reports averages"):
        rb_sim.reaction_ranges(Simulation(scene).run(checks=False))
