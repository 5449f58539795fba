# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Friction does not follow a slip too slow for the tolerance; on a support that gives way it does.

A pad on a door, close to the hinge: friction brakes the door by mu N r / I, exactly opposite to a
slip of a thousandth of the scene's speed, whose direction turns with the door.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from benchmarks.contact.stick_slips import case, judged
from benchmarks.contact.toss_scenes import toss
from rb_sim import Simulation, load_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import G, ball, box, scene, touch
from tests.contact_runs import contact_run
from tests.runs import trajectory

MU, STIFFNESS, DEPTH, SPIN = 0.4, 1e4, 1e-3, 0.05
INERTIA = 0.3 + 2.0
"""of the door about the hinge, a metre from its centre [kg m^2]."""


def braking(arm: float) -> float:
    """[rad/s^2]."""
    return MU * STIFFNESS * DEPTH * arm / INERTIA


def door(tolerance: float, arm: float, *, gives: bool) -> Simulation:
    body = {
        "mass": 2.0, "inertia": [0.2, 0.2, 0.3], "position": [1.0, 0.0, 0.0],
        "linear_velocity": [0.0, SPIN, 0.0], "angular_velocity": [0.0, 0.0, SPIN],
    }  # fmt: skip
    hinge = {
        "type": "fixed_axis", "body": "door", "axis_B": [0, 0, 1],
        "point_A": [0, 0, 0], "point_B": [-1, 0, 0],
    }  # fmt: skip
    pad = {
        "type": "contact", "body": "door", "points": [[arm - 1.0, 0.0, -0.1]],
        "surface": {"type": "plane", "normal": [0, 0, 1], "point": [0, 0, DEPTH - 0.1]},
        "compliance": {"stiffness": STIFFNESS},
        "friction": {"type": "coulomb", "static": 0.5, "kinetic": MU},
    }  # fmt: skip
    effects = {}
    if not gives:  # a hinge that leaves the door's weight to the pad, whose push is then the same
        hinge = {"type": "fixed_point", "body": "door", "point_A": [0, 0, 0], "point_B": [-1, 0, 0]}
        pad |= {"points": [[arm - 1.0, 0.0, 0.0]], "surface": {"type": "plane"}}
        del pad["compliance"]
        push = [0.0, 0.0, -STIFFNESS * DEPTH * arm]
        effects = {"weight": {"type": "wrench", "body": "door", "force": push}}
    times = {"duration": 40.0, "rate": 5, "method": "dopri853", "tolerance": tolerance}
    scene = {
        "bodies": {"door": body},
        "constraints": {"hinge": hinge, "pad": pad},
        "effects": effects,
    }
    return Simulation(scene_from_mapping(scene | {"simulation": times}))


@pytest.mark.parametrize(
    ("tolerance", "arm", "bound"), [(1e-6, 1e-3, 0.05), (1e-8, 1e-3, 2e-8), (1e-4, 0.5, 0.01)]
)
def test_a_pad_close_to_the_hinge(tolerance: float, arm: float, bound: float) -> None:
    """Wrong by 0.02 and 1e-8 of its spin. Far from the hinge the slip is as slow as that only in
    its last instant."""
    found = door(tolerance, arm, gives=False).run(checks=False)
    expected = np.maximum(0.0, SPIN - braking(arm) * found.t)
    assert expected[-1] == 0.0
    np.testing.assert_allclose(
        found.angular_velocity["door"][:, 2], expected, rtol=0.0, atol=bound * SPIN
    )


@pytest.mark.parametrize(("tolerance", "bound"), [(1e-3, 2e-4), (1e-6, 1e-6), (1e-8, 1e-9)])
def test_a_pad_on_what_gives_way(tolerance: float, bound: float) -> None:
    """Its slip is followed by implicit steps; at 1e-4 the spin was wrong by 0.14 of it."""
    simulation = door(tolerance, 1e-3, gives=True)
    found = simulation.run(checks=False)
    expected = np.maximum(0.0, SPIN - braking(1e-3) * found.t)
    np.testing.assert_allclose(
        found.angular_velocity["door"][:, 2], expected, rtol=0.0, atol=bound * SPIN
    )
    assert simulation.steps < 100


# Steps of fixed length see every end of a slip, also of one that friction turns aside.


CASES = (0, 1, 3, 11, 13, 20, 43, 53)


def ellipsoid(number: int) -> dict[str, Any]:
    """An ellipsoid that falls on a floor, which gives way in odd cases, slides there, comes to roll
    and leaves it: a slip in two directions, which each turns the other."""
    rng = np.random.default_rng(number)
    body = {
        "mass": 1.0,
        "shape": {"type": "ellipsoid", "semi_axes": rng.uniform(0.06, 0.14, 3).tolist()},
        "inertia": (0.004 * rng.uniform(0.7, 1.0, 3)).tolist(),
        "center_of_mass": rng.normal(0.0, 0.01, 3).tolist(),
        "position": [0.0, 0.0, 0.3],
        "orientation": {"axis": rng.normal(size=3).tolist(), "angle": 1.0},
        "linear_velocity": rng.normal(0.0, 0.5, 3).tolist(),
        "angular_velocity": rng.normal(0.0, 5.0, 3).tolist(),
    }
    floor: dict[str, Any] = {"type": "contact", "body": "b"}
    floor["friction"] = {"type": "coulomb", "static": 0.4, "kinetic": 0.3}
    if number % 2:
        floor["compliance"] = {"stiffness": 3000.0, "damping": 5.0}
    return {
        "bodies": {"b": body},
        "constraints": {"floor": floor},
        "effects": {"weight": {"type": "gravity"}},
        "simulation": {"duration": 0.45, "rate": 50.0},
    }


@pytest.fixture(scope="module")
def exact() -> list[Any]:
    return [events(n, method="dopri853", tolerance=1e-11) for n in CASES]


def events(number: int, **options: Any) -> list[tuple[str, float]]:
    """What happens, and when."""
    return [(e.kind, e.t) for e in trajectory(ellipsoid(number), **options).events]


@pytest.mark.parametrize(("step", "late"), [(1e-3, 1e-4), (2e-4, 1e-6)])
def test_no_stick_is_missed(exact: list[Any], step: float, late: float) -> None:
    """In most of these none was found in steps of rk4, or 4 to 35 ms late, at any step: once a step
    had turned a slip aside it went on beside zero."""
    for number, expected in zip(CASES, exact, strict=True):
        found = events(number, method="rk4", step=step)
        assert [kind for kind, _ in found] == [kind for kind, _ in expected], number
        at = [[t for _, t in run] for run in (found, expected)]
        np.testing.assert_allclose(at[0], at[1], rtol=0.0, atol=late)
    assert any(kind == "sticks" for run in exact for kind, _ in run)


def pulled(number: int) -> dict[str, Any]:
    """The ellipsoid, pulled along and turned, on a floor whose two coefficients are equal: a slip
    that begins does not grow at first, and friction turns it as fast as it likes."""
    scene = ellipsoid(number)
    scene["constraints"]["floor"]["friction"] = {"type": "coulomb", "static": 0.25}
    load = {"force": [1.0, 0.5, 0.0], "torque": [0.05, 0.1, 0.02]}
    scene["effects"]["pull"] = {"type": "wrench", "body": "b"} | load
    scene["simulation"]["rate"] = 2000.0
    return scene


@pytest.mark.parametrize("number", [2, 4, 10, 16, 17])
def test_a_slip_that_begins_keeps_its_direction(number: int) -> None:
    """A step of rk4 from there turned the slip aside: forces were wrong by 1 to 17 N of 10, the
    slip by 1 to 17 mm/s, and in case 4 slips and sticks came 25 times at one instant."""
    exact = trajectory(pulled(number), method="dopri853", tolerance=1e-11)
    found = trajectory(pulled(number), method="rk4", step=1e-3)
    assert [e.kind for e in found.events] == [e.kind for e in exact.events]
    assert "slips" in [e.kind for e in exact.events]
    begins = next(e.t for e in reversed(exact.events) if e.kind == "slips")
    after = (exact.t > begins) & (exact.t < begins + 5e-3)
    assert after.any()
    forces = found.reaction_force[after], exact.reaction_force[after]
    np.testing.assert_allclose(*forces, rtol=0.0, atol=5e-3)
    speeds = found.linear_velocity[after], exact.linear_velocity[after]
    np.testing.assert_allclose(*speeds, rtol=0.0, atol=1e-4)


def test_what_has_no_kinetic_friction_slips_where_it_is_pushed() -> None:
    """A push beyond the bound at rest, after which nothing resists: v = F t / m along it."""
    push = {"type": "wrench", "body": "body", "force": [3.0, 1.0, 0.0]}
    block = box([0.2, 0.2, 0.1], [0.0, 0.0, 0.05])
    found = contact_run(scene(block, touch(mu=0.3, kinetic=0.0), push=push), [0.0, 1.0])
    speed = found.trajectory.linear_velocity["body"][-1]
    np.testing.assert_allclose(speed, [3.0, 1.0, 0.0], rtol=1e-9, atol=1e-12)


def test_a_slip_ends_where_the_clock_does_not_resolve_what_is_left() -> None:
    """After 135 s two instants are 3e-14 s apart: less was left of a slip, and no step went on."""
    found = case(1311, 450, fixed=True)
    assert found.sticks[-1] > 100.0
    assert judged(found)[0] == "fine"


# What is left of a slip that ends is taken away where it is, and stops nothing else.


CREEP = 1e-6
"""Slip at which the corner of the law is rounded that the other is compared with [m/s]."""
BOXES = {
    "tall": (
        box((0.113, 0.133, 0.192), [0.0, 0.0, 0.09552298875])
        | {
            "mass": 0.778,
            "orientation": {"axis": [-0.519, 0.158, 0.0], "angle": 7.66e-4},
            "linear_velocity": [4.09e-4, -3.67e-4, 4.72e-4],
            "angular_velocity": [-0.0152, -0.0158, -0.0106],
        },
        {"stiffness": 4000.0},
        0.368,
    ),
    "flat": (
        box((0.184, 0.122, 0.0936), [0.0, 0.0, 0.04664671875])
        | {
            "mass": 0.475,
            "orientation": {"axis": [0.919, 0.993, 0.0], "angle": 3.71e-4},
            "linear_velocity": [2.67e-4, 3.54e-4, 1.09e-3],
            "angular_velocity": [0.00683, 0.04, 0.00492],
        },
        {"stiffness": 7600.0},
        0.498,
    ),
}
"""(box, its support, coefficient of friction)."""


@pytest.mark.parametrize("name", BOXES)
def test_corners_that_creep_let_a_box_rock(name: str) -> None:
    """A box rocks on a floor that gives way, its corners creep.  Two of them at rest leave no
    rocking across the line through both: where the slip of one turned, it was ended, and the
    rocking with it, over and over, which left angular velocities wrong by a tenth."""
    moving, compliance, mu = BOXES[name]

    def of(friction: dict[str, Any]) -> Any:
        floor = touch(friction=friction, compliance=compliance)
        mapping = scene(moving, floor)
        return trajectory(mapping | {"simulation": {"duration": 0.01, "rate": 1000.0}})

    found = of({"type": "coulomb", "static": mu})
    rounded = of({"type": "regularised", "coefficient": mu, "speed": CREEP})
    for field in ("angular_velocity", "linear_velocity"):
        error = getattr(found, field) - getattr(rounded, field)
        np.testing.assert_allclose(error, 0.0, atol=1e-4, err_msg=field)


# Errors of an adaptive method do not keep a slip alive that the laws of friction have ended.


def rim(**simulation: Any) -> dict[str, Any]:
    """A steep rim on a log, near Painleve's paradox: what friction gives the slip is a thousand
    times as much as what ends it, which is left over between friction and load."""
    disk = {
        "mass": 0.28148861906596,
        "position": [0.15080630583432086, -0.10935163017609772, 0.0018273431568666468],
        "orientation": [
            0.09312090267696181, 0.9888969271053489, 0.11577049720342819, -0.002925239049561024,
        ],
        "linear_velocity": [-0.5510872271783878, 0.1065095611264689, 0.6964864682770493],
        "angular_velocity": [3.736967916823091, -38.3102854581243, -5.929731892254288],
        "shape": {"type": "disk", "radius": 0.10144063901073133, "axis_B": [0.0, 0.0, 1.0]},
    }  # fmt: skip
    log = {
        "type": "cylinder",
        "axis": [1, 0, 0],
        "point": [0, 0, -1],
        "radius": 1.0,
        "side": "outside",
    }
    friction = {"type": "coulomb", "static": 0.7135794479297964}
    contact = {"type": "contact", "body": "b", "surface": log, "friction": friction}
    return {
        "bodies": {"b": disk},
        "constraints": {"c": contact},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]}},
        "simulation": {"duration": 2e-4} | simulation,
    }


ENDS = 3.1374136e-5
"""When the slip is over [s], by SciPy's Radau on the equations of the slip alone, which is stable
however fast friction turns it, down to 10 nm/s: some 10 ns before the end."""


@pytest.mark.parametrize("tolerance", [1e-10, 1e-12])
def test_a_slip_ends_when_its_laws_say_so(tolerance: float) -> None:
    """At 1e-8 errors keep it alive, at 1e-9 the run is refused."""
    simulation = Simulation(load_scene(rim(method="dopri853", tolerance=tolerance)))
    simulation.run(checks=False)
    (end,) = (event.t for event in simulation.events if event.kind == "sticks")
    assert end == pytest.approx(ENDS, abs=2e-8 + 10.0 * tolerance)
    assert simulation.steps < 10_000


def test_a_slip_at_the_bound_of_friction_takes_no_steps_without_end() -> None:
    """What would end it is less than a ten-thousandth of what friction gives: in steps that no
    error turns aside it went on for millions of them."""
    simulation = Simulation(load_scene(toss(271, 9).mapping))
    simulation.run(checks=False)
    assert simulation.time == pytest.approx(0.6)
    assert simulation.steps < 10_000


# Where a ball that spins begins to roll because its normal turns, against closed forms.


FAR, R = 0.5, 0.1
"""Of the ball's middle from that of the support; its radius [m]."""
SPIN_ROLLING, SPEED, ARM = 15.0, 0.5, 0.01
"""About the normal [rad/s], at the top [m/s], of the resistance [m]."""


def rolls_at() -> float:
    """A smooth ball slides down a sphere, n = (sin a, 0, cos a); to turn its spin with n takes the
    torque I spin v / FAR, and there is ARM N, N = m (g cos a - v^2 / FAR)."""
    inertia = 0.4 * R**2

    def speed(a: float) -> float:
        return float(np.sqrt(SPEED**2 + 2.0 * G * FAR * (1.0 - np.cos(a))))

    def left(a: float) -> float:
        push = G * np.cos(a) - speed(a) ** 2 / FAR
        return float(ARM * push - inertia * SPIN_ROLLING * speed(a) / FAR)

    angle = brentq(left, 0.0, 0.8, xtol=1e-15)
    return quad(lambda a: FAR / speed(a), 0.0, angle, epsabs=1e-14)[0]


@pytest.mark.parametrize("spin", [SPIN_ROLLING, -SPIN_ROLLING])
def test_a_spin_that_the_normal_takes_along_is_no_rolling(spin: float) -> None:
    """The event function of rolling had the spin in it, whose direction turns with the normal: it
    chattered (a random scene: 415 events where there are 18)."""
    moving = {"linear_velocity": [SPEED, 0.0, 0.0], "angular_velocity": [0.0, 0.0, spin]}
    sphere = {"type": "sphere", "radius": FAR - R, "center": [0.0, 0.0, -FAR]}
    contact = touch(surface=sphere, rolling_resistance=ARM)
    run = contact_run(scene(ball([0.0, 0.0, 0.0], R, **moving), contact), np.linspace(0, 0.3, 31))
    assert [event.kind for event in run.events] == ["closes", "stops rolling", "rolls"]
    assert abs(run.times("rolls")[0] - rolls_at()) < 1e-10
    assert run.balance() < 1e-9


def test_rolling_ends_once_while_the_ball_spins() -> None:
    """In a bowl: what is left of a rolling that has ended is taken away."""
    moving = {"linear_velocity": [0.3, 0.1, 0.0], "angular_velocity": [3.0, -2.0, SPIN_ROLLING]}
    bowl = {"type": "sphere", "radius": 1.0, "center": [0, 0, 1.0], "side": "inside"}
    contact = touch(surface=bowl, rolling_resistance=0.02)
    thrown = ball([0.0, 0.0, R], R, **moving)
    run = contact_run(scene(thrown, contact), np.linspace(0.0, 0.5, 51))
    assert [e.kind for e in run.events] == ["closes", "rolls", "stops rolling"]
    r = run.trajectory
    after = r.t > run.times("stops rolling")[0]
    normal = r.position["body"] - [0.0, 0.0, 1.0]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    assert run.balance() < 1e-9 and after.sum() > 10
    turn = Rotation.from_quat(r.orientation["body"]).apply(r.angular_velocity["body"])
    across = turn - np.sum(turn * normal, axis=1)[:, None] * normal
    assert np.abs(across[after]).max() < 1e-9


# Slips that rounding begins and ends: friction at its very bound holds, and soon.


@pytest.mark.parametrize("mu", [0.2585755739915971, 0.6630037871702823])
def test_a_box_at_the_very_threshold_of_slipping_rests(mu: float) -> None:
    """A slope of atan(mu), to the last digit: rounding let it slip, by 1e-20 m each time, 900
    times. From the start on its corners share the load within their cones, up to rounding: the
    upper ones bear less, and may hold less."""
    angle = math.atan(mu)
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    start = box([0.2, 0.2, 0.2], (0.1 * normal).tolist())
    start |= {"orientation": {"axis": [0, 1, 0], "angle": angle}}
    mapping = scene(start, touch(mu=mu, surface={"type": "plane", "normal": normal.tolist()}))
    mapping["simulation"] = {"duration": 0.1, "rate": 100.0, "tolerance": 1e-9}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(checks=False)
    assert np.abs(run.position["body"] - run.position["body"][0]).max() <= 1e-15
    assert {event.kind for event in simulation.events} <= {"closes", "sticks"}
    corners = [run.reaction[name].force for name in run.layout.reactions if "/" in name]
    pushes = np.array([force @ normal for force in corners])
    across = [np.linalg.norm(f - np.outer(f @ normal, normal), axis=1) for f in corners]
    assert np.all(np.array(across) <= mu * pushes + 1e-12 * pushes.sum(axis=0))
