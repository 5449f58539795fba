"""Sides are looked at between samples, too: nothing goes through a support where they are rare."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from rb_sim import Simulation, load_scene
from rb_sim.contact.looks import SHARE, next_looks, thickness
from rb_sim.errors import RbSimError
from tests.contact.scenes import box, scene, touch
from tests.contact.test_sides import ACROSS, LOG, OWN, held
from tests.contact_runs import contact_run

FALLEN = [5.0]
"""One sample, when what falls has long been through [s]."""


@pytest.mark.parametrize("name", ACROSS)
def test_going_through_between_samples_is_told(name: str) -> None:
    with pytest.raises(
        RbSimError, match=r"a side of the body sinks by .* contact floor at t = 0\."
    ):
        contact_run(ACROSS[name], FALLEN, tolerance=1e-8)


def test_going_through_is_told_where_nothing_is_sampled() -> None:
    simulation = Simulation(load_scene(ACROSS["rod on a log"]), announce=None)
    with pytest.raises(RbSimError, match="a side of the body sinks by"):
        simulation._motion.run_to(FALLEN)


def test_going_through_between_samples_is_told_in_steps() -> None:
    steps = {"method": "time_stepping", "step": 1e-2, "tolerance": None}
    with pytest.raises(RbSimError, match=r"a side of the body sinks by .* at t = 0\."):
        contact_run(ACROSS["rod on a log"], FALLEN, **steps)


def test_what_comes_at_speed_is_told() -> None:
    """A rod thrown at 300 m/s is through the log in 3 ms."""
    thrown = ACROSS["rod on a log"] | {
        "bodies": {
            "body": ACROSS["rod on a log"]["bodies"]["body"]
            | {"position": [0, 0, 60.0], "linear_velocity": [0, 0, -300.0]}
        }
    }
    with pytest.raises(RbSimError, match=r"a side of the body sinks by .* at t = 0\.19[78]"):
        contact_run(thrown, [1.0], tolerance=1e-8)


def standing(**more: Any) -> dict[str, Any]:
    """A box that comes down on its corners upon a box."""
    under = held({"type": "box", "size": [1.0, 1.0, 0.4]}, 0.2)
    falling = box([0.3, 0.2, 0.1], [0, 0, 0.2], angular_velocity=[1.0, 0.5, 2.0]) | more
    made = scene({"body": falling, "a": under}, touch(**OWN, mu=0.5, restitution=0.3))
    made["effects"]["weight"] = made["effects"]["weight"] | {"bodies": ["body"]}
    return made


def test_looks_change_no_bit_of_a_motion() -> None:
    rare = contact_run(standing(), [0.6], tolerance=1e-9)
    often = contact_run(standing(), np.linspace(0.0, 0.6, 601).tolist(), tolerance=1e-9)
    for field in ("position", "orientation", "linear_velocity", "angular_velocity"):
        a, b = (getattr(run.trajectory, field)["body"][-1] for run in (rare, often))
        assert_array_equal(a, b)
    assert rare.times("impact") == often.times("impact")


def test_samples_are_those_asked_for() -> None:
    times = [0.0, 0.1, 0.1 + 1e-9, 0.35, 0.6]
    found = contact_run(standing(), times, tolerance=1e-9).trajectory
    alone = contact_run(standing(), [0.35], tolerance=1e-9).trajectory
    assert_array_equal(found.t, times)
    assert_array_equal(found.position["body"][3], alone.position["body"][0])


def test_far_away_nothing_is_looked_at() -> None:
    """The next look is when it can be there; from then on after a part of the thickness each."""
    from rb_sim.scene.compile import compile_scene

    high = scene(box([0.8, 0.8, 0.2], [0, 0, 20.0]), touch(**LOG))
    compiled = compile_scene(load_scene(high))
    (sides,), system = compiled.sides, compiled.system
    looks = next_looks(compiled.sides, system, 0.0, compiled.y)
    pull = system.speed**2 / system.length
    way = 20.0 - 0.5 - np.linalg.norm([0.4, 0.4, 0.1])
    ways = 0.5 * pull * looks**2
    assert way <= ways[0] <= way + 1.01 * SHARE * thickness(sides)
    assert np.diff(ways) == pytest.approx(SHARE * thickness(sides))
    assert thickness(sides) == 0.8
