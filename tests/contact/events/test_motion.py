# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions in contact against closed forms, and the laws that each of them obeys."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import load_scene
from tests.contact.scenes import G, ball, body, box, scene, touch
from tests.contact_runs import ContactRun, contact_run

TIGHT = 1e-10


def run(mapping: Any, times: Any, **options: Any) -> ContactRun:
    return contact_run(mapping, np.atleast_1d(times).tolist(), **{"tolerance": TIGHT} | options)


# closed forms


@pytest.mark.parametrize("duration", [0.5, 3.0, 100.0])
def test_what_is_passed_in_one_long_step_is_hit(duration: float) -> None:
    """Free flight has no length of its own: the step is as long as the run."""
    bodies = {"a": ball([0, 0, 0]), "b": ball([-1, 0.05, 0], linear_velocity=[2, 0, 0])}
    hit = touch("b", parent="a", surface={"type": "shape"}, restitution=1.0)
    mapping = scene(bodies, {"hit": hit}, gravity=False)
    mapping["simulation"]["duration"] = duration
    found = run(mapping, [0.0, duration])
    assert_allclose(found.times("impact"), [0.5 - 0.5 * math.sqrt(0.2**2 - 0.05**2)], atol=1e-13)


def test_bounces_of_a_shaken_table() -> None:
    """The table comes and goes many times during one flight: the first touch is found."""
    motion = {"type": "shaken", "direction": [0, 0, 1], "amplitude": 0.03, "frequency": 20.0}
    start = ball([0, 0, 0.15], linear_velocity=[0, 0, 3.0])
    mapping = scene(start, touch(restitution=0.8, motion=motion))
    times = np.linspace(0.0, 1.0, 51)
    found = run(mapping, times)
    t = np.linspace(0.0, 1.0, 1000001)
    w = 40.0 * math.pi
    gap = 0.05 + 3.0 * t - 0.5 * G * t**2 - 0.03 * np.sin(w * t)
    hit = found.times("impact")[0]
    assert abs(hit - t[np.argmax(gap < 0.0)]) <= 1e-6
    above = found.trajectory.position["body"][:, 2] - 0.1 - 0.03 * np.sin(w * times)
    assert above.min() >= -1e-10
    before, after = 3.0 - G * hit, None
    table = 0.03 * w * math.cos(w * hit)
    after = table - 0.8 * (before - table)
    (impulse, *_) = (e.impulse for e in found.events if e.kind == "impact")
    assert_allclose(impulse, [0.0, 0.0, after - before], atol=1e-9)
    assert found.balance() <= 1e-9


def test_bilateral_contact_pulls() -> None:
    """A bead under a wire's plane, lifted by nothing but the contact."""
    mapping = scene(
        ball([0, 0, 0], linear_velocity=[1, 0, 0]),
        touch(
            mode="bilateral", points=[[0, 0, 0]], surface={"type": "plane", "normal": [0, 0, -1]}
        ),
    )
    found = run(mapping, [0.0, 1.0])
    r = found.trajectory
    assert_allclose(r.position["body"][1], [1, 0, 0], atol=1e-12)
    assert_allclose(r.reaction["floor"].force, [[0, 0, G]] * 2, atol=1e-12)
    assert r.contact_state["floor"].tolist() == [1.0, 1.0]


def test_grazing_touch_and_touch_at_the_start() -> None:
    """A ball that passes at distance 0 goes on; one that touches at t = 0 with no speed rests."""
    bodies = {"a": ball([0, 0, 0]), "b": ball([-1, 0.2, 0], linear_velocity=[2, 0, 0])}
    hit = touch("b", parent="a", surface={"type": "shape"}, restitution=1.0)
    found = run(scene(bodies, {"hit": hit}, gravity=False), [0.0, 2.0])
    assert_allclose(found.trajectory.linear_velocity["b"][1], [2, 0, 0], atol=1e-6)
    rest = run(scene(ball([0, 0, 0.1]), touch(restitution=0.5)), [0.0, 10.0])
    assert_allclose(rest.trajectory.position["body"][1], [0, 0, 0.1], atol=1e-15)
    struck = run(
        scene(ball([0, 0, 0.1], linear_velocity=[0, 0, -1]), touch(restitution=0.5)), [0.0, 0.05]
    )
    assert_allclose(struck.trajectory.linear_velocity["body"][0], [0, 0, 0.5], atol=1e-15)
    assert struck.times("impact") == [0.0]


@pytest.mark.parametrize("offset", [-1e-16, 0.0, 1e-16])
def test_sample_at_the_instant_of_an_impact_shows_the_state_after_it(offset: float) -> None:
    height = 0.5 * G * 0.25
    found = run(scene(ball([0, 0, 0.1 + height]), touch(restitution=0.5)), [0.0, 0.5 + offset])
    hit = found.times("impact")
    if hit:  # the instant itself is known to the last digits only
        assert_allclose(found.trajectory.linear_velocity["body"][1], [0, 0, 0.25 * G], atol=1e-12)
    later = run(scene(ball([0, 0, 0.1 + height]), touch(restitution=0.5)), [0.0, 0.5 + 1e-14])
    assert_allclose(later.trajectory.linear_velocity["body"][1], [0, 0, 0.25 * G], atol=1e-12)


def test_impact_without_kinetic_friction() -> None:
    """A coefficient that is 0 once it slips takes nothing in an impact that slips."""
    start = ball([0, 0, 0.1], linear_velocity=[1, 0, -1])
    friction = {"type": "coulomb", "static": 0.5, "kinetic": 0.0}
    found = run(scene(start, touch(friction=friction)), [0.0, 0.5])
    assert_allclose(found.trajectory.linear_velocity["body"][1], [1, 0, 0], atol=1e-14)
    assert found.trajectory.contact_state["floor"].tolist() == [1.0, 1.0]


# rest and slip


def test_reversals_do_not_chatter() -> None:
    """A block swings on a spring with friction: one reversal per half swing, then it sticks."""
    k, mu, x0 = 100.0, 0.1, 0.105
    block = body({"type": "box", "size": [0.2, 0.2, 0.1]}, [0, 0, 0.05])
    spring = {"type": "spring", "body": "body", "stiffness": k, "rest_length": 0.0}
    constraints = {
        "floor": touch(mu=mu, points=[[0, 0, -0.05]]),
        "tilt": {"type": "translation", "body": "body"},
    }
    found = run(
        scene(block, constraints, spring=spring | {"point_A": [x0, 0.0, 0.05]}), [0.0, 20.0]
    )
    d = mu * G / k  # each half swing of pi / sqrt(k/m) loses 2 d
    swings, left = 0, x0
    while left > d:
        left, swings = abs(left - 2.0 * d), swings + 1
    half = math.pi / math.sqrt(k)
    instants = [e.t for e in found.events if e.t > 0.0]
    assert_allclose(instants, [half * (i + 1) for i in range(swings)], atol=1e-9)
    kinds = [e.kind for e in found.events if e.t > 0.0]
    assert kinds == ["reverses"] * (swings - 1) + ["sticks"]
    x = found.trajectory.position["body"][1, 0]
    assert_allclose(abs(x0 - x), left, atol=1e-9)


def test_ball_rolls_over_the_edge_of_a_box() -> None:
    """It tips over the edge without loss of speed, rolls on it and falls off."""
    bodies = {"a": box([0.4, 0.4, 0.4], [0, 0, 0.2]), "b": ball([0.1, 0, 0.5])}
    v = 0.3
    bodies["b"] |= {"linear_velocity": [v, 0, 0], "angular_velocity": [0, v / 0.1, 0]}
    constraints = {
        "stand": {"type": "weld", "body": "a"},
        "on": touch("b", parent="a", surface={"type": "shape"}, friction={"type": "rough"}),
    }
    times = np.linspace(0.0, 0.8, 161)
    found = run(scene(bodies, constraints), times, tolerance=1e-10)
    r = found.trajectory
    x, z = r.position["b"][:, 0], r.position["b"][:, 2]
    beyond = np.hypot(np.maximum(x - 0.2, 0.0), z - 0.4)
    closed = r.contact_state["on"] > 0.0
    assert_allclose(beyond[closed], 0.1, atol=1e-10)
    # on the edge: 7/10 v^2 + g r cos = const; N = m g cos - m v^2 / r = 0 leaves it
    (left,) = found.times("opens")
    # 17/10 cos = 1 + 7/10 v0^2/(g r)
    cos = (1.0 + 0.7 * v * v / (G * 0.1)) / 1.7
    after = np.searchsorted(times, left)
    leave = run(scene(bodies, constraints), [0.0, left], tolerance=1e-10)
    assert_allclose((leave.trajectory.position["b"][1, 2] - 0.4) / 0.1, cos, atol=1e-8)
    assert (~closed[after:]).all()
    assert found.balance() <= 1e-9


# symmetries and balances


def oblique(turn: Rotation, shift: np.ndarray) -> dict[str, Any]:
    """A tumbling rod that strikes a plane, slides and rolls over, in a turned and shifted world."""
    start = body(
        {"type": "rod", "length": 0.4},
        turn.apply([0, 0, 0.3]) + shift,
        inertia=[0.013, 0.013, 0.002],
        orientation=(turn * Rotation.from_rotvec([0.3, 0.9, 0.2])).as_quat(),
        linear_velocity=turn.apply([1.0, 0.3, -0.5]),
        angular_velocity=[1.0, 2.0, 0.5],
    )
    surface = {"type": "plane", "point": shift.tolist(), "normal": turn.apply([0, 0, 1]).tolist()}
    mapping = scene(start, touch(mu=0.3, surface=surface, restitution=0.2))
    weight = {"type": "gravity", "acceleration": turn.apply([0, 0, -G]).tolist()}
    return mapping | {"effects": {"weight": weight}}


def test_turned_and_shifted_world() -> None:
    turn, shift = Rotation.from_rotvec([0.7, -1.1, 0.5]), np.array([2.0, -1.0, 0.5])
    times = np.linspace(0.0, 0.25, 6)
    here = run(oblique(Rotation.identity(), np.zeros(3)), times)
    there = run(oblique(turn, shift), times)
    a, b = here.trajectory, there.trajectory
    assert [e.kind for e in here.events] == [e.kind for e in there.events]
    assert_allclose([e.t for e in there.events], [e.t for e in here.events], atol=1e-8)
    assert_allclose(b.position["body"], turn.apply(a.position["body"]) + shift, atol=1e-8)
    assert_allclose(b.linear_velocity["body"], turn.apply(a.linear_velocity["body"]), atol=1e-7)
    assert_allclose(b.angular_velocity["body"], a.angular_velocity["body"], atol=1e-6)


@pytest.mark.parametrize("method", ["dopri853", "rk4", "time_stepping"])
def test_run_split_in_two_is_the_run_in_one(method: str) -> None:
    """Bit for bit, with the cut off the grid of steps and near events."""
    mapping = oblique(Rotation.identity(), np.zeros(3))
    options = {"tolerance": 1e-9} if method == "dopri853" else {"step": 2e-3}
    mapping["simulation"] = {"duration": 1.0, "method": method} | options
    whole = _split(mapping, (0.4,))
    assert _split(mapping, (0.1234, 0.4 - 0.1234)) == whole
    assert _split(mapping, (0.2, 0.0011, 0.4 - 0.2 - 0.0011)) == whole


def _split(mapping: Any, pieces: tuple[float, ...]) -> list[Any]:
    """State and time at the end of a run made in these pieces, events included."""
    from rb_sim import Simulation

    simulation = Simulation(load_scene(mapping))
    for piece in pieces[:-1]:
        simulation.advance(piece)
        simulation.sample()
    simulation.advance(sum(pieces) - simulation.time)
    last = simulation.sample().block
    names = ("position", "orientation", "linear_velocity", "angular_velocity", "reaction_force")
    return [list(simulation.events), *(getattr(last, name).tolist() for name in names)]


@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.5), (0.4, 0.1), (0.9, 2.0)])
def test_impacts_never_create_energy(e: float, mu: float) -> None:
    """A tumbling rod: eccentric impacts, where Newton's law alone may create energy."""
    rng = np.random.default_rng(int(10 * e))
    for _ in range(1):
        start = body(
            {"type": "rod", "length": 0.4},
            [0, 0, 0.3],
            inertia=[0.01, 0.01, 0.001],
            orientation=Rotation.random(random_state=rng.integers(1000)).as_quat(),
            linear_velocity=rng.normal(size=3),
            angular_velocity=8.0 * rng.normal(size=3),
        )
        found = run(
            scene(start, touch(mu=mu, restitution=e)), np.linspace(0, 0.3, 61), tolerance=1e-9
        )
        assert found.times("impact")
        assert (np.diff(found.trajectory.energy) <= 1e-8).all()
        assert found.balance() <= 1e-7


@pytest.mark.parametrize(("method", "order"), [("euler", 1), ("rk4", 4), ("gauss6", 6)])
def test_order_through_events(method: str, order: int) -> None:
    """A bounce under drag, then slip that ends in rolling: the events are those of the method."""
    start = ball([0, 0, 0.2], linear_velocity=[1.5, 0.2, 0], angular_velocity=[0, -5, 2])
    air = {"type": "quadratic_drag", "body": "body", "coefficient": 0.4}
    turn = {"type": "angular_damping", "body": "body", "coefficient": 0.004}
    mapping = scene(start, touch(mu=0.15), air=air, turn=turn)
    end = [0.0, 1.2]
    best = run(mapping, end, tolerance=1e-13)
    assert {"impact", "slips", "sticks"} <= {e.kind for e in best.events}
    exact = best.trajectory.position["body"][1]
    steps = {"euler": (8e-3, 2e-3), "rk4": (0.04, 0.01), "gauss6": (0.04, 0.02)}[method]
    errors = [
        np.abs(
            run(mapping, end, method=method, step=h, tolerance=None).trajectory.position["body"][1]
            - exact
        ).max()
        for h in steps
    ]
    slope = math.log(errors[0] / errors[1]) / math.log(steps[0] / steps[1])
    assert slope >= order - 0.5, errors
