# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a sample tells of bodies in contact, beside Newton's and Euler's equations of each."""

from __future__ import annotations

from itertools import product
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from rb_sim.mechanics.contact import motion_kernels as _registers_its_kernels  # noqa: F401  # noqa: F401
from rb_sim.mechanics.contact.contact_bodies import CLOSED, GAP, SLIDE
from rb_sim.mechanics.contact.contact_kinematics import SLIDING, STUCK
from rb_sim.mechanics.contact.motion_kernels import contact_rate
from rb_sim.mechanics.system import sample, settle
from rb_sim.motion.motion import row_width
from rb_sim.scene.compile import compile_scene
from tests.interpreted import interpreted

MASSES, MOMENTS, SIZE = (2.1, 1.3), ((0.3, 0.2, 0.4), (0.02, 0.03, 0.04)), (0.3, 0.4, 0.2)
G = np.array([0.0, 0.0, -9.81])
PIN_B = np.array([0.1, 0.2, -0.3])
NAMES = ["pin", "c", *(f"c/{i + 1}" for i in range(8))]
HELD = (0, 3, 6)
"""Corners that touch."""
FRICTIONS: dict[str, Any] = {
    "viscous": {"type": "viscous", "coefficient": 0.7},
    "coulomb": {"type": "coulomb", "static": 0.4},
}


class Seen(NamedTuple):
    """Of one instant."""

    y: np.ndarray
    slope: np.ndarray
    wrenches: dict[str, np.ndarray]
    """force, torque about the anchor, anchor, by constraint, (3, 3)."""
    balance: np.ndarray
    """kinetic energy, energy in gravity, power, momentum, angular momentum, (9,)."""
    work: float
    states: np.ndarray
    residual: float
    gaps: np.ndarray
    length: float


def box_on_a_pinned_body(friction: dict[str, Any]) -> dict[str, Any]:
    """Box `b` on a plane of body `a`, which turns about a point of the world."""
    bodies = {
        name: {"mass": mass, "inertia": list(moments), "angular_velocity": w, "position": p}
        for name, mass, moments, w, p in zip(
            "ab", MASSES, MOMENTS, ([0.3, -0.2, 0.5], [1, 2, 0.7]), ([0, 0, -0.2], [0.3, 0.1, 0.2]),
            strict=True,
        )
    }  # fmt: skip
    bodies["b"] |= {
        "shape": {"type": "box", "size": list(SIZE)},
        "orientation": {"axis": [1.0, 2.0, 0.5], "angle": 0.7},
        "linear_velocity": [0.5, 0.2, 0.1],
    }
    plane = {"type": "plane", "normal": [0.0, 0.0, 1.0]}
    return {
        "bodies": bodies,
        "constraints": {
            "pin": {"type": "fixed_point", "body": "a", "point_B": PIN_B.tolist()},
            "c": {
                "type": "contact",
                "body": "b",
                "parent": "a",
                "surface": plane,
                "friction": friction,
            },
        },
        "effects": {"weight": {"type": "gravity", "acceleration": G.tolist()}},
        "simulation": {"duration": 1.0, "project_initial": True},
    }


def seen(friction: str, slide: float, held: tuple[int, ...]) -> Seen:
    """The sample with some corners closed, in this mode."""
    compiled = compile_scene(load_scene(box_on_a_pinned_body(FRICTIONS[friction])))
    system, y = compiled.system, np.array(compiled.y)
    system.touch[:, CLOSED] = 0.0
    for c in held:
        system.touch[c, [CLOSED, SLIDE]] = 1.0, slide
    slope, out = np.zeros_like(y), np.zeros(row_width(compiled.layout))
    settle(system, 0.0, y)
    contact_rate(system, 0.0, y, slope)
    y[-1] = 0.7  # work of the contacts until then
    sample(system, 0.0, y, out)
    names = compiled.layout.reactions
    wrenches = dict(zip(names, out[26 : 26 + 9 * len(names)].reshape(-1, 3, 3), strict=True))
    gaps = system.touch[:, GAP].copy()
    balance = out[26 + 9 * len(names) : 35 + 9 * len(names)].copy()
    told = float(out[-9]), out[-8:].copy(), float(out[-10])
    return Seen(y, slope, wrenches, balance, *told, gaps, system.length)


def needed(seen: Seen, i: int) -> np.ndarray:
    """[m a - weight, rate of the angular momentum about C] of body i, world axes."""
    own, rate = seen.y[13 * i : 13 * i + 13], seen.slope[13 * i : 13 * i + 13]
    turned, w, inertia = Rotation.from_quat(own[3:7]), own[10:13], np.array(MOMENTS[i])
    torque = turned.apply(inertia * rate[10:13] + np.cross(w, inertia * w))
    return np.array([MASSES[i] * (rate[7:10] - G), torque])


def about(wrench: np.ndarray, point: np.ndarray) -> np.ndarray:
    """[force, torque about the point]."""
    force, torque, anchor = wrench
    return np.array([force, torque + np.cross(anchor - point, force)])


@pytest.mark.parametrize("slide", [SLIDING, STUCK])
@pytest.mark.parametrize("friction", FRICTIONS)
def test_reactions_move_both_bodies(friction: str, slide: float) -> None:
    """What the box feels `a` feels the other way, and the pin besides; the corners' wrenches make
    up that of the contact, about the box's centre."""
    if friction == "viscous" and slide == STUCK:
        return  # it has no corner, and sticks at nothing
    found = interpreted(seen, friction, slide, HELD)
    w, a, b = found.wrenches, found.y[:3], found.y[13:16]
    assert list(w) == NAMES
    size = max(1.0, np.abs(found.slope).max())
    assert_allclose(about(w["c"], b), needed(found, 1), atol=1e-9 * size)
    assert_allclose(about(w["pin"], a) - about(w["c"], a), needed(found, 0), atol=1e-9 * size)
    corners = [w[f"c/{c + 1}"] for c in range(8)]
    assert_allclose(sum(about(x, b) for x in corners), about(w["c"], b), atol=1e-9 * size)
    assert np.linalg.norm(w["c"][0]) > 1e-2 and np.linalg.norm(w["pin"][0]) > 1e-2


@pytest.mark.parametrize("slide", [SLIDING, STUCK])
def test_reactions_act_at_their_points(slide: float) -> None:
    """The pin's at its point, without torque; a corner's at the corner, but for the gap; that of
    several at the body's centre."""
    found = interpreted(seen, "coulomb", slide, HELD)
    of_a, of_b = found.y[:13], found.y[13:26]
    pin = of_a[:3] + Rotation.from_quat(of_a[3:7]).apply(PIN_B)
    assert_allclose(found.wrenches["pin"][1:], [np.zeros(3), pin], atol=1e-12)
    assert_allclose(found.wrenches["c"][2], of_b[:3], rtol=1e-14)
    signs = 0.5 * np.array(list(product((-1.0, 1.0), repeat=3))) * SIZE
    corners = of_b[:3] + Rotation.from_quat(of_b[3:7]).apply(signs)
    for c in range(8):
        force, torque, anchor = found.wrenches[f"c/{c + 1}"]
        apart = np.linalg.norm(corners - anchor, axis=1)
        assert apart.min() <= abs(found.gaps[c]) + 1e-12
        assert_allclose(torque, 0.0, atol=1e-12)
        assert (np.linalg.norm(force) > 0.0) == (c in HELD)


def test_energies_and_momenta_are_those_of_all_bodies() -> None:
    """m v^2/2 + w . I w/2, -m g . p, m v, p x m v + I w; the power is that of friction alone."""
    found = interpreted(seen, "coulomb", SLIDING, HELD)
    kinetic, potential, momentum, angular, rate = 0.0, 0.0, np.zeros(3), np.zeros(3), 0.0
    for i, (mass, moments) in enumerate(zip(MASSES, MOMENTS, strict=True)):
        own, slope = found.y[13 * i : 13 * i + 13], found.slope[13 * i : 13 * i + 13]
        p, v, w = own[:3], own[7:10], own[10:13]
        turned, spin = Rotation.from_quat(own[3:7]), np.array(moments) * w
        kinetic += 0.5 * (mass * v @ v + spin @ w)
        potential -= mass * G @ p
        momentum += mass * v
        angular += np.cross(p, mass * v) + turned.apply(spin)
        rate += mass * v @ (slope[7:10] - G) + spin @ slope[10:13]
    expected = [kinetic, potential, rate, *momentum, *angular]
    assert_allclose(found.balance, expected, rtol=1e-9, atol=1e-9)
    assert abs(rate) > 1e-2


def driven() -> tuple[float, float]:
    """(the power that is told, d(kinetic + potential)/dt) of a body that a drive holds against a
    push, and a ball that rolls on a floor which turns."""
    solid = {"mass": 2.1, "inertia": [0.3, 0.2, 0.4], "position": [0.0, 0.0, 5.0]}
    ball = {"mass": 1.3, "shape": {"type": "sphere", "radius": 0.2}, "position": [0.3, 0.0, 0.2]}
    ball |= {"linear_velocity": [0.2, 0.4, 0.0], "angular_velocity": [0.5, 1.0, 2.0]}
    drive = {"type": "velocity", "body": "a", "linear": [1.0, 0.0, 0.0], "rate": 0.5}
    table = {"type": "turntable", "rate": 1.7, "axis": [0, 0, 1], "point": [0, 0, 0]}
    floor = {"type": "contact", "body": "b", "friction": FRICTIONS["coulomb"], "motion": table}
    push = {"type": "wrench", "body": "a", "force": [-3.0, 0.0, 0.0]}
    weight = {"type": "gravity", "acceleration": G.tolist()}
    mapping = {
        "bodies": {"a": solid | {"linear_velocity": [0.5, 0.1, 0.0]}, "b": ball},
        "constraints": {"drive": drive, "floor": floor},
        "effects": {"weight": weight, "push": push},
        "simulation": {"duration": 1.0},
    }
    compiled = compile_scene(load_scene(mapping))
    system, y = compiled.system, np.array(compiled.y)
    system.touch[0, [CLOSED, SLIDE]] = 1.0, STUCK
    slope, out = np.zeros_like(y), np.zeros(row_width(compiled.layout))
    contact_rate(system, 0.0, y, slope)
    sample(system, 0.0, y, out)
    at, rate = 26 + 9 * len(compiled.layout.reactions), 0.0
    inertia = [np.array([0.3, 0.2, 0.4]), np.full(3, 0.4 * 1.3 * 0.2**2)]
    for i, mass in enumerate((2.1, 1.3)):
        v, w = y[13 * i + 7 : 13 * i + 10], y[13 * i + 10 : 13 * i + 13]
        rate += mass * v @ (slope[13 * i + 7 : 13 * i + 10] - G)
        rate += (inertia[i] * w) @ slope[13 * i + 10 : 13 * i + 13]
    return float(out[at + 2]), float(rate)


def test_power_is_that_of_drives_loads_and_what_turns_below() -> None:
    told, rate = interpreted(driven)
    assert abs(rate) > 0.05
    assert told == pytest.approx(rate, rel=1e-9)
