# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Coming to rest and leaving it, where several contacts share a load that they do not determine."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.contact.toss_scenes import toss
from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, body, box, scene, touch
from tests.contact_runs import contact_run

WALL = {"type": "plane", "normal": [1.0, 0.0, 0.0]}


def ladder(angle: float, floor: float, wall: float) -> dict[str, Any]:
    """A homogeneous rod of 1 m and 1 kg between a floor and a wall, at an angle to the floor."""
    c, s = 0.5 * math.cos(angle), 0.5 * math.sin(angle)
    turn = {"axis": [0.0, 1.0, 0.0], "angle": angle - 0.5 * math.pi}
    rod = body({"type": "rod", "length": 1.0}, [c, 0.0, s], orientation=turn)
    rod["inertia"] = [1.0 / 12.0, 1.0 / 12.0, 1e-3]
    contacts = {"floor": touch(mu=floor), "wall": touch(mu=wall, surface=WALL)}
    return scene({"body": rod}, contacts)


@pytest.mark.parametrize(("floor", "wall"), [(0.4, 0.3), (0.7, 0.05), (0.2, 0.9)])
def test_ladder_rests_down_to_its_least_angle(floor: float, wall: float) -> None:
    """Both ends at their bounds: tan(least angle) = (1 - mu_floor mu_wall)/(2 mu_floor)."""
    least = math.atan((1.0 - floor * wall) / (2.0 * floor))
    rests = contact_run(ladder(least + 1e-7, floor, wall), [0.0, 100.0], tolerance=1e-9)
    assert {e.kind for e in rests.events} <= {"closes", "sticks"}
    moved = np.diff(rests.trajectory.position["body"], axis=0)
    assert np.abs(moved).max() <= 1e-14
    for name, mu, n in (("floor", floor, 2), ("wall", wall, 0)):
        force = rests.trajectory.reaction[name].force[1]
        along = np.delete(force, n)
        assert np.linalg.norm(along) <= mu * force[n] * (1.0 + 1e-12)
    slides = contact_run(ladder(least - 1e-7, floor, wall), [0.0, 1.0], tolerance=1e-9)
    height = slides.trajectory.position["body"][:, 2]
    assert height[1] < height[0] - 1e-8


def test_corners_share_a_pull_until_none_can_take_more() -> None:
    """A block pulled off its middle by a growing force: its four corners give way as one.

    The pull F = r t at height z above the base tips the load to the front corners; all slip when
    F = mu m g, wherever the load is, and move on under what kinetic friction leaves of F.
    """
    mu, kinetic, rate, high = 0.4, 0.3, 2.0, 0.05
    table = {"times": [0.0, 10.0], "forces": [[0.0] * 3, [10.0 * rate, 0.0, 0.0]]}
    pull = {"type": "wrench_table", "body": "body"} | table
    start = box([0.4, 0.2, 2.0 * high], [0.0, 0.0, high])
    slip = mu * G / rate
    floor, times = touch(mu=mu, kinetic=kinetic), [0.0, slip + 0.01]
    found = contact_run(scene(start, floor, pull=pull), times, tolerance=1e-10)
    began = [e for e in found.events if e.kind == "slips"]
    assert len({e.contact for e in began}) == 4
    assert_allclose([e.t for e in began], slip, atol=1e-9)
    v = (mu - kinetic) * G * 0.01 + rate * 0.01**2 / 2.0
    assert_allclose(found.trajectory.linear_velocity["body"][1], [v, 0.0, 0.0], atol=1e-9)


def test_rocking_comes_to_rest() -> None:
    """A body on two feet: each impact of one lifts the other, ever less.

    With k^2 = I/m and feet at +-a below C, without rebound, an impact leaves the part
    (k^2 - a^2)/(k^2 + a^2) of the turning: after n impacts nothing is left, in finite time.
    """
    a, k2 = 0.1, 0.04
    feet = [[-a, 0.0, -1e-3], [a, 0.0, -1e-3]]
    tilt = 0.02
    start = body(
        {"type": "sphere", "radius": 0.1},
        [0.0, 0.0, a * math.sin(tilt) + 1e-3 * math.cos(tilt)],
        inertia=[k2] * 3,
        orientation={"axis": [0.0, 1.0, 0.0], "angle": tilt},
    )
    found = contact_run(
        scene(start, touch(mu=0.5, points=feet)), np.linspace(0.0, 1.0, 51).tolist(), tolerance=1e-9
    )
    spin = np.abs(found.trajectory.angular_velocity["body"][:, 1])
    assert found.trajectory.contact_state["floor/1"][-1] == 2.0
    assert found.trajectory.contact_state["floor/2"][-1] == 2.0
    assert spin[-1] <= 1e-12
    impacts = found.times("impact")
    assert len(impacts) < 60
    assert max(impacts) < 0.9
    assert (np.diff(found.trajectory.energy) <= 1e-12).all()
    assert found.balance() <= 1e-10


def test_tall_box_jams_at_both_front_corners() -> None:
    """Painleve's paradox of an edge: of its two corners each alone could slide on."""
    start = box([0.3, 0.3, 0.9], [0.0, 0.0, 0.45], linear_velocity=[2.0, 0.0, 0.0])
    found = contact_run(scene(start, touch(mu=1.5)), [0.0, 0.05, 0.1], tolerance=1e-9)
    r = found.trajectory
    assert np.isfinite(r.position["body"]).all()
    assert (np.diff(r.energy) <= 1e-9).all()
    assert r.energy[0] - G * 0.45 < 2.0 - 0.1  # the stop has cost energy
    assert {"leaps", "jams"} & {e.kind for e in found.events}


# A box that lands on a support that gives way rocks, creeps and rests.
#
# Its corners slip by lean times rate of the lean, ever more slowly, while friction of some newtons
# turns those slips at once: explicit steps were as short as that (1e-9 s), and the changes between
# rest and slip, at speeds that are but errors, had no end.


SIZE, MASS, STIFFNESS, DAMPING, MU, G_COMPLIANT = (0.2, 0.15, 0.1), 1.0, 5e3, 20.0, 0.4, 9.81
AXIS, ANGLE, START = (0.6, 0.8, 0.0), 0.03, (0.05, 0.02, 0.0)
HEIGHT = 0.5 * 0.1 * np.cos(ANGLE) + (0.5 * 0.2 * 0.8 + 0.5 * 0.15 * 0.6) * np.sin(ANGLE) + 1e-4
REFERENCE = {
    "position": ([0.0013857002019, 0.000580810296126, 0.0495490924591], 5e-9),
    "linear_velocity": ([-8.50849545722e-05, 0.000467378122239, -0.00605720189468], 1e-7),
    "angular_velocity": ([-0.00934508803745, -0.0017152263156, 1.09747290247e-07], 2e-6),
}
"""At 0.12 s, by `python -m benchmarks.contact.rocking_box`, and how far off it is: friction is
rounded there at 1e-8 m/s; at 1e-7 m/s it is off by 19 times as much."""


def box_of_compliant(lean: float = 0.0, **simulation: Any) -> Simulation:
    """The box above a floor that leans."""
    body = {
        "mass": MASS, "shape": {"type": "box", "size": SIZE}, "position": [0.0, 0.0, HEIGHT],
        "orientation": {"axis": AXIS, "angle": ANGLE}, "linear_velocity": START,
    }  # fmt: skip
    contact = {
        "type": "contact", "body": "box", "friction": {"type": "coulomb", "static": MU},
        "compliance": {"stiffness": STIFFNESS, "damping": DAMPING},
    }  # fmt: skip
    weight = [G_COMPLIANT * np.sin(lean), 0.0, -G_COMPLIANT * np.cos(lean)]
    scene = {
        "bodies": {"box": body},
        "constraints": {"floor": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": weight}},
    }
    return Simulation(scene_from_mapping(scene | {"simulation": simulation}))


@pytest.mark.parametrize("lean", [0.0, 0.2])
def test_it_comes_to_rest(lean: float) -> None:
    simulation = box_of_compliant(lean, duration=1.0, rate=200)
    found = simulation.run(checks=False)
    assert simulation.steps < 20_000
    assert [e.kind for e in simulation.events[-4:]] == ["sticks"] * 4
    for velocity in (found.linear_velocity["box"][-1], found.angular_velocity["box"][-1]):
        assert np.abs(velocity).max() < 1e-9
    weight = MASS * G_COMPLIANT * np.array([np.sin(lean), 0.0, -np.cos(lean)])
    np.testing.assert_allclose(found.reaction["floor"].force[-1], -weight, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(found.reaction["floor"].torque[-1], 0.0, rtol=0.0, atol=1e-9)
    balance = found.energy - found.contact_work
    assert np.ptp(balance) < 1e-9 * MASS * G_COMPLIANT


def test_on_the_way_it_moves_as_an_independent_program_says() -> None:
    """At 0.12 s corners slip by some 1e-5 m/s, and have stuck six times."""
    found = box_of_compliant(duration=0.12, rate=100).run(checks=False)
    for name, (expected, off) in REFERENCE.items():
        np.testing.assert_allclose(getattr(found, name)["box"][-1], expected, rtol=0.0, atol=off)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-12])
def test_what_has_stopped_is_held_by_static_friction(tolerance: float) -> None:
    """A point that gives way stops under a load of 0.985 of kinetic friction, and stays where the
    load grows beyond that, up to 0.95 of static friction; it went on, creeping."""
    static, kinetic, pulled, swings = 0.5, 0.4, 0.394 * G_COMPLIANT, 0.08 * G_COMPLIANT
    body = {
        "mass": 1.0,
        "position": [0.0, 0.0, -G_COMPLIANT / 5e3],
        "linear_velocity": [-0.01, 0.0, 0.0],
    }
    contact = {
        "type": "contact", "body": "b", "points": [[0.0, 0.0, 0.0]],
        "compliance": {"stiffness": 5e3},
        "friction": {"type": "coulomb", "static": static, "kinetic": kinetic},
    }  # fmt: skip
    pull = {
        "type": "wrench", "body": "b", "force": [pulled, 0.0, 0.0],
        "sine_force": [swings, 0.0, 0.0], "angular_frequency": 20.0,
    }  # fmt: skip
    scene = {
        "bodies": {"b": {"inertia": [1.0, 1.0, 1.0]} | body},
        "constraints": {"c": contact},
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G_COMPLIANT]},
            "pull": pull,
        },
        "simulation": {"duration": 0.5, "tolerance": tolerance, "method": "dopri853"},
    }
    simulation = Simulation(scene_from_mapping(scene))
    found = simulation.run(checks=False)
    assert [e.kind for e in simulation.events] == ["closes", "slips", "sticks"]
    stopped = found.position["b"][found.t > 0.01, 0]
    assert np.ptp(stopped) < 1e-12
    # the pull helps to stop it, and grows but by 0.08 g 20 t in the millisecond that it takes
    assert stopped[0] == pytest.approx(-0.5 * 0.01**2 / ((kinetic + 0.394) * G_COMPLIANT), rel=5e-3)


def test_one_corner_that_creeps_near_the_bound_of_friction_rests() -> None:
    """Under 0.98 of kinetic friction; static friction holds more. Runs parted by 2 mm."""
    ends = []
    for tolerance in (1e-10, 1e-12):
        mapping = toss(77, 432).mapping
        times = {"duration": 0.3, "tolerance": tolerance, "method": "dopri853"}
        simulation = Simulation(scene_from_mapping(mapping | {"simulation": times}))
        ends.append(simulation.run(checks=False).position["b"][-1])
        assert simulation.steps < 5000
    np.testing.assert_allclose(*ends, rtol=0.0, atol=1e-8)


# Points that lift off together open once each, whatever they stand on.


AMPLITUDE, RATE = 0.03, 10.0 * math.pi
SHAKEN = {"type": "shaken", "direction": [0, 0, 1], "amplitude": AMPLITUDE, "frequency": 5.0}
LEAVES = math.asin(G / (AMPLITUDE * RATE**2)) / RATE
"""Where the floor falls as fast as the weight asks for: a w^2 sin(w t) = g."""
SETTINGS: dict[str, dict[str, Any]] = {
    "default": {},
    "loose": {"tolerance": 1e-4},
    "sharp": {"tolerance": 1e-13},
    "rk4": {"method": "rk4", "step": 1e-3, "tolerance": None},
    "coarse rk4": {"method": "rk4", "step": 1e-2, "tolerance": None},
    "gauss6": {"method": "gauss6", "step": 2e-3, "tolerance": None},
}


def thrown_off(solid: dict[str, Any], **contact: Any) -> dict[str, Any]:
    """What stands on a floor that rises first and then falls away under it."""
    moving = solid | {"linear_velocity": [0.0, 0.0, AMPLITUDE * RATE]}
    return scene(moving, touch(motion=SHAKEN, **contact))


def assert_lifts_once(mapping: dict[str, Any], **setting: Any) -> None:
    found = contact_run(mapping, [0.0, LEAVES + 1e-3], **setting)
    after = [e for e in found.events if e.t > 0.0]
    assert {e.kind for e in after} == {"opens"}
    assert set(Counter(e.contact for e in after).values()) == {1}
    assert {e.contact for e in after} == {e.contact for e in found.events if e.kind == "closes"}
    assert_allclose([e.t for e in after], LEAVES, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("mu", "setting"), [(0.0, "default"), *((0.5, setting) for setting in SETTINGS)]
)
def test_a_box_is_thrown_off(mu: float, setting: str) -> None:
    """Its corners opened and closed 52 times, by rounding, and the run leapt over the rest."""
    beside = {"center_of_mass": [0.03, 0.02, 0.01], "inertia": [0.01, 0.012, 0.02]}
    thrown = box([0.3, 0.2, 0.1], [0, 0, 0.05]) | beside
    assert_lifts_once(thrown_off(thrown, mu=mu), **SETTINGS[setting])


def test_a_cylinder_on_its_end_is_thrown_off() -> None:
    shape = {"type": "cylinder", "radius": 0.1, "length": 0.2}
    assert_lifts_once(thrown_off(body(shape, [0, 0, 0.1]), mu=0.4))


def test_an_edge_that_is_lifted_leaves_the_other_down() -> None:
    """A force F = c t at the middle of an edge, a half width b off C: the other edge bears until
    c t b = m g b - c t b, and the corners under the force leave at c t = m g / 2, both at once."""
    pull = {"type": "wrench_table", "body": "body", "times": [0.0, 1.0], "point_B": [0.15, 0, 0.05]}
    pull |= {"forces": [[0.0, 0.0, 0.0], [0.0, 0.0, 10.0 * G]]}
    standing = scene(box([0.3, 0.2, 0.1], [0, 0, 0.05]), touch(mu=0.5), pull=pull)
    found = contact_run(standing, np.linspace(0.0, 0.06, 7).tolist())
    opened = [e for e in found.events if e.t > 0.0 and e.kind == "opens"]
    assert_allclose([e.t for e in opened], [0.05, 0.05], rtol=0.0, atol=1e-9)
    states = found.trajectory.contact_state
    down = [name for name in states if name.startswith("floor/") and states[name][-1] > 0.0]
    assert len(down) == 2
    assert not set(down) & {e.contact for e in opened}
