# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Several points that hold one body: their shares keep to the laws, and nothing creeps."""

from __future__ import annotations

import math
import warnings
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from rb_sim import Simulation
from rb_sim.contact.event_workspace import workspace_for
from rb_sim.contact.events.shares import Reactions, cones_of, undetermined_at_start
from rb_sim.contact.modes import lay_out_held
from rb_sim.mechanics.contact.contact_bodies import (
    BILATERAL,
    CLOSED,
    COMPLIANT,
    CONTACT_TABLE_WIDTH,
    NORMAL_SIGN,
    ROLL,
    ROLLING_ARM,
    SLIDE,
    SPIN,
    SPINNING_ARM,
    SPRING,
    STATIC,
)
from rb_sim.mechanics.contact.contact_kinematics import NONE, SLIDING, STUCK
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, body, box, scene, touch
from tests.contact_runs import contact_run


def tilted(angle: float) -> tuple[np.ndarray, dict[str, Any]]:
    """(normal, surface) of a plane that falls towards +x."""
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    return normal, {"type": "plane", "normal": normal.tolist()}


@pytest.mark.parametrize("margin", [0.2, 1e-6])
def test_box_on_its_four_corners_does_not_creep(margin: float) -> None:
    """Friction above tan(tilt) by this part of it, for 1000 s; the shares of least norm would not
    keep to the friction bound at every corner."""
    normal, surface = tilted(0.4)
    turn = {"axis": [0, 1, 0], "angle": 0.4}
    start = box([0.2, 0.3, 0.1], 0.05 * normal, orientation=turn)
    mapping = scene(start, touch(mu=math.tan(0.4) * (1.0 + margin), surface=surface))
    mapping["simulation"]["duration"] = 1000.0
    found = contact_run(mapping, [0.0, 1000.0])
    r = found.trajectory
    assert (r.position["body"][1] == r.position["body"][0]).all()
    assert (r.linear_velocity["body"] == 0.0).all()
    assert_allclose(r.reaction["floor"].force, [[0, 0, G]] * 2, atol=1e-12)
    assert {e.kind for e in found.events} == {"closes", "sticks"}


def test_cylinder_rolls_down_on_both_ends() -> None:
    """a = g sin / (1 + 1/2), T = m g sin / 3; the ends share both."""
    angle = 0.3
    normal, surface = tilted(angle)
    along = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    shape = {"type": "cylinder", "radius": 0.1, "length": 0.3, "axis_B": [0, 1, 0]}
    mapping = scene(body(shape, 0.1 * normal), touch(mu=0.5, surface=surface))
    times = np.array([0.0, 0.5, 1.0])
    r = contact_run(mapping, times.tolist(), tolerance=1e-12).trajectory
    fallen = 0.5 * (G * math.sin(angle) / 1.5) * times**2
    assert_allclose(r.position["body"], 0.1 * normal + fallen[:, None] * along, atol=1e-11)
    share = 0.5 * G * (math.cos(angle) * normal - math.sin(angle) / 3.0 * along)
    for i in (1, 2):
        assert_allclose(r.reaction[f"floor/{i}"].force, [share] * 3, atol=1e-10)


SIDES = {"left": 1, "right": -1}


def test_ball_between_two_walls_falls_freely() -> None:
    """Smooth walls that it just fills do not hold it."""
    walls = {
        name: touch(surface={"type": "plane", "normal": [i, 0, 0], "point": [-0.1 * i, 0, 0]})
        for name, i in SIDES.items()
    }
    r = contact_run(scene(ball([0, 0, 1.0]), walls), [0.0, 0.5]).trajectory
    assert_allclose(r.position["body"][1], [0, 0, 1.0 - 0.125 * G], atol=1e-13)
    assert_allclose(r.reaction["left"].force, np.zeros((2, 3)), atol=1e-13)


def test_ball_slips_until_it_rolls_in_a_groove() -> None:
    """Walls at 45 degrees, N = m g / sqrt 2 each; it rolls on circles of r / sqrt 2, so its slip
    falls by sqrt 2 mu g (1 + 5/4) per second, its speed by 4/9 of that.  Both stick at once."""
    s, v, mu = math.sqrt(0.5), 1.0, 0.5
    walls = {
        name: touch(mu=mu, surface={"type": "plane", "normal": [i * s, 0, s]})
        for name, i in SIDES.items()
    }
    start = ball([0, 0, 0.1 / s], linear_velocity=[0, v, 0])
    found = contact_run(scene(start, walls), [0.0, 1.0], tolerance=1e-12)
    assert_allclose(found.times("sticks"), [v / (2.25 * math.sqrt(2.0) * mu * G)] * 2, atol=1e-12)
    assert [e.kind for e in found.events if e.t > 0.0] == ["sticks", "sticks"]
    assert_allclose(found.trajectory.linear_velocity["body"][1], [0, v / 1.8, 0], atol=1e-11)


def test_the_bounds_of_contacts_by_hand() -> None:
    """Each as a force along the normal: of x = least + self-stress y the normal one, friction over
    its coefficient and torques over their arms.  One that may pull has its side, one that gives way
    pushes as it does, over the unit; what slips or is open has no bound."""
    table = np.zeros((5, CONTACT_TABLE_WIDTH))
    table[:, CLOSED] = 1.0, 1.0, 1.0, 0.0, 1.0
    table[:, SLIDE] = STUCK, STUCK, SLIDING, STUCK, STUCK
    table[0, [ROLL, SPIN]] = STUCK
    table[1, [NORMAL_SIGN, SPIN]] = -1.0, STUCK
    table[2, [SPRING, ROLL, SPIN]] = 6.0, STUCK, NONE
    table[:, [STATIC, ROLLING_ARM, SPINNING_ARM, COMPLIANT, BILATERAL]] = (
        (0.5, 0.1, 0.2, 0.0, 0.0),
        (0.4, 0.0, 0.25, 0.0, 1.0),
        (0.3, 0.05, 0.0, 1.0, 0.0),
        (0.3, 0.0, 0.0, 0.0, 0.0),
        (math.inf, 0.0, 0.0, 0.0, 0.0),
    )
    system: Any = SimpleNamespace(
        contact_table=table, row_table=np.zeros((36, 2), np.int64), bodies=np.zeros((1, 1)),
        first_row=np.array([0, 5, 11, 17, 23, 33, 36]), joints=1, length=1.0,
    )  # fmt: skip
    at: Any = SimpleNamespace(system=system, workspace=workspace_for(system))
    held = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 16, 20, 21, 33, 34, 35]
    rng = np.random.default_rng(4)
    least, stress = rng.normal(size=20), rng.normal(size=(20, 2))
    count, bounds = lay_out_held(system, at.workspace)
    assert at.workspace.used[:count].tolist() == held
    cones = cones_of(at, Reactions(held, least, stress, 3.0, bounds))

    def lines(*factors: tuple[int, float]) -> tuple[list[Any], list[Any]]:
        at = [(f, held.index(k)) for k, f in factors]
        return [f * least[i] for f, i in at], [f * stress[i] for f, i in at]

    linear = [[(5, 1.0)], [(33, 1.0)], [(5, 1.0), (10, 5.0)], [(5, 1.0), (10, -5.0)]]
    linear += [[(11, -1.0), (16, 4.0)], [(11, -1.0), (16, -4.0)]]
    assert len(cones.lin_h) == 6 and len(cones.soc_h) == 4
    for one, h, g in zip(linear, cones.lin_h, cones.lin_G, strict=True):
        values, rows = lines(*one)
        assert_allclose(h, sum(values), rtol=1e-14)
        assert_allclose(g, sum(rows), rtol=1e-14)
    rounds = [
        [(5, 1.0), (6, 2.0), (7, 2.0)],
        [(5, 1.0), (8, 10.0), (9, 10.0)],
        [(11, -1.0), (12, 2.5), (13, 2.5)],
    ]
    for one, h, g in zip(rounds, cones.soc_h, cones.soc_G, strict=False):
        values, rows = lines(*one)
        assert_allclose(h, values, rtol=1e-14)
        assert_allclose(g, rows, rtol=1e-14)
    at_20 = [held.index(20), held.index(21)]
    assert_allclose(cones.soc_h[3], [2.0, *(20.0 * least[at_20])], rtol=1e-14)
    assert_allclose(cones.soc_G[3], [[0.0, 0.0], *(20.0 * stress[at_20])], rtol=1e-14)


# Which reactions statics alone does not determine, where bodies are in contact.


FEET = [[0.4, 0.3, -0.5], [-0.4, 0.3, -0.5], [-0.4, -0.3, -0.5], [0.4, -0.3, -0.5]]
ROUGH = {"type": "rough"}


def found(mapping: dict[str, Any]) -> tuple[str, ...]:
    return undetermined_at_start(compile_scene(scene_from_mapping(mapping)))


def names_of(*mappings: dict[str, Any]) -> list[tuple[str, ...]]:
    return [found(mapping) for mapping in mappings]


def table(feet: int, **more: Any) -> dict[str, Any]:
    shape = {"type": "box", "size": [1.0, 0.8, 1.0]}
    return scene(body(shape, [0.0, 0.0, 0.5]), touch(points=FEET[:feet]) | more)


def test_redundant_contacts_are_named() -> None:
    upright = {"upright": {"type": "translation", "body": "body"}}
    standing = box([0.2, 0.2, 0.2], [0.0, 0.0, 0.1])
    flying = box([0.2, 0.2, 0.2], [0.0, 0.0, 0.5])
    held = scene(standing, upright | {"floor": touch()}, gravity=True)
    got = names_of(
        table(4),
        table(3),
        table(3, friction={"type": "coulomb", "static": 0.5}),
        scene(ball([0.0, 0.0, 0.1]), touch(friction=ROUGH)),
        scene(standing, touch()),
        scene(flying, touch()),
        held,
    )
    four = tuple(f"floor/{i}" for i in (1, 2, 3, 4))
    assert got[0] == four  # their total, floor, is determined
    assert got[1] == ()
    assert got[2] == four[:3]  # three tangential forces more than a body has freedoms to hold
    assert got[3] == ()
    assert got[4] == four  # the lower corners
    assert got[5] == ()
    # what keeps it upright may take up any torque that the corners leave
    assert set(got[6]) == {"upright", "floor", *got[4]}


@pytest.mark.parametrize("size", [1e-3, 1e3])
@pytest.mark.parametrize("mass", [1e-9, 1e9])
def test_whether_they_are_does_not_hang_on_units(mass: float, size: float) -> None:
    """A table of three legs and one of four, of any mass and size."""
    mappings = []
    for feet in (3, 4):
        shape = {"type": "box", "size": [size, 0.8 * size, size]}
        points = (size * np.array(FEET[:feet])).tolist()
        thing = body(shape, [0.0, 0.0, 0.5 * size]) | {"mass": mass}
        mappings.append(scene(thing, touch(points=points)))
    assert names_of(*mappings) == [(), tuple(f"floor/{i}" for i in (1, 2, 3, 4))]


# A vehicle on more wheels than are needed to carry it, slipping and turning on the spot.


RADIUS, MASS, HALF_TRACK, FRICTION, TORQUE = 0.1, 0.5, 0.25, 0.6, 2.5
SPIN_INERTIA = 0.4 * MASS * RADIUS**2
YAW_INERTIA = 0.25
"""Of the chassis alone [kg m^2]."""
TIME, RATE = 0.12, 500.0


def places_of(base: float) -> np.ndarray:
    """x and y of each wheel [m]."""
    return np.array([[x, y] for y in (-HALF_TRACK, HALF_TRACK) for x in (base / 2, -base / 2)])


def vehicle(places: np.ndarray, tolerance: float) -> dict[str, Any]:
    scene: dict[str, Any] = {
        "bodies": {
            "chassis": {
                "mass": 8.0,
                "inertia": [0.1, 0.15, YAW_INERTIA],
                "position": [0.0, 0.0, 0.12],
            }
        },
        "constraints": {},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {
            "duration": TIME,
            "rate": RATE,
            "method": "dopri853",
            "tolerance": tolerance,
        },
    }
    for i, (x, y) in enumerate(places.tolist()):
        name = f"wheel_{i}"
        scene["bodies"][name] = {
            "mass": MASS,
            "shape": {"type": "sphere", "radius": RADIUS},
            "position": [x, y, RADIUS],
        }
        scene["constraints"][f"axle_{i}"] = {
            "type": "fixed_axis",
            "body": name,
            "parent": "chassis",
            "axis_B": [0, 1, 0],
        }
        scene["constraints"][f"tyre_{i}"] = {
            "type": "contact",
            "body": name,
            "friction": {"type": "coulomb", "static": FRICTION, "kinetic": FRICTION},
        }
        scene["effects"][f"motor_{i}"] = {
            "type": "wrench",
            "body": name,
            "frame": "body",
            "torque": [0.0, -np.sign(y) * TORQUE, 0.0],
        }
    return scene


def yaw_and_spins(places: np.ndarray, loads: CubicSpline) -> np.ndarray:
    """Yaw rate of the chassis and spins of the wheels at TIME: Coulomb's law with these loads."""
    x, y = places.T
    yaw = YAW_INERTIA + np.sum(MASS * (x**2 + y**2) + SPIN_INERTIA)

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        slip = np.array([-s[0] * y - RADIUS * s[1:], s[0] * x])
        size = np.linalg.norm(slip, axis=0)
        # at rest each wheel is about to slip along its own drive
        way = slip / size if size.all() else np.array([np.sign(y), 0.0 * x])
        fx, fy = -FRICTION * loads(t) * way
        spins = (-np.sign(y) * TORQUE - RADIUS * fx) / SPIN_INERTIA
        return np.array([np.sum(x * fy - y * fx) / yaw, *spins])

    start = np.zeros(1 + len(places))
    return solve_ivp(rates, (0.0, TIME), start, "DOP853", rtol=1e-11, atol=1e-11).y[:, -1]


@pytest.mark.parametrize(("base", "tolerance"), [(0.4, 1e-5), (0.7, 1e-9)])
def test_a_vehicle_turns_on_the_spot_in_a_few_steps(base: float, tolerance: float) -> None:
    places = places_of(base)
    simulation = Simulation(scene_from_mapping(vehicle(places, tolerance)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # how the wheels share the load is not determined
        run = simulation.run()
    tyres = [run.reaction[f"tyre_{i}"].force[:, 2] for i in range(len(places))]
    # at t = 0, where nothing slips yet, the load may be shared otherwise than just after
    loads = CubicSpline(run.t[1:], np.array(tyres).T[1:])
    expected = yaw_and_spins(places, loads)
    got = [run.angular_velocity["chassis"][-1, 2]]
    got += [run.angular_velocity[f"wheel_{i}"][-1, 1] for i in range(len(places))]
    assert np.abs(got - expected).max() < 10.0 * tolerance * np.abs(expected).max()
    assert simulation.steps + simulation.rejected_steps < 60


def test_samples_asked_for_one_at_a_time_are_those_asked_for_at_once() -> None:
    """As a node asks for them: also where several lie in one step, in which no more lines count
    than at its start. The chassis stays level, since the wheels are the corners of a rectangle."""
    scene = scene_from_mapping(vehicle(places_of(0.4), 1e-10))
    times = np.linspace(0.0, TIME, 61)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        at_once = Simulation(scene).run(at=times, check=False)
        simulation = Simulation(scene)
        alone = [simulation.run(at=[t], check=False) for t in times]
    one = np.array([run.position["chassis"][0] for run in alone])
    assert np.abs(one - [0.0, 0.0, 0.12]).max() < 1e-10
    np.testing.assert_array_equal(one, at_once.position["chassis"])
    turning = [run.angular_velocity["wheel_1"][0] for run in alone]
    np.testing.assert_array_equal(turning, at_once.angular_velocity["wheel_1"])
