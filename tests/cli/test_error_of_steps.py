"""What the summary says of the error of fixed steps: beside closed forms, and where it is not
known."""

from __future__ import annotations

from typing import Any

import pytest

from rb_sim import Simulation, load_scene
from rb_sim.cli.error_of_steps import error_of_steps, told
from tests.test_half_steps import above_a_floor, falling


@pytest.mark.parametrize("steps", [4, 20, 500])
def test_it_is_that_of_eulers_way(steps: int) -> None:
    """n steps under a constant load are short by 1/n of the way, whose halves show half of it."""
    simulation = falling(steps)
    simulation.advance(1.0)
    error: Any = error_of_steps(simulation, 1.0)
    assert error["relative"] == pytest.approx(1.0 / steps, rel=1e-9)
    assert (error["body"], error["of"], error["t"], error["all"]) == ("stone", "way", 1.0, True)
    words = f"by half steps about {1.0 / steps:.2g} of stone's way at t = 1 s"
    assert told(error) == words


def test_an_attitude_is_told_beside_a_long_way() -> None:
    """A wheel that flies at 100 m/s: Euler's angle under a torque along its axis, h w/2 a second
    short with w = T t/I, is 1/n of T t^2/(2 I) = 0.2 rad, which is little of the way (to 2e-3: a
    step turns the quaternion along its tangent)."""
    scene = {
        "bodies": {
            "wheel": {"mass": 2.0, "inertia": [0.1] * 3, "linear_velocity": [100.0, 0.0, 0.0]}
        },
        "effects": {"motor": {"type": "wrench", "body": "wheel", "torque": [0.0, 0.0, 0.04]}},
        "simulation": {"method": "euler", "step": 0.1, "duration": 1.0, "rate": 10.0},
    }
    simulation = Simulation(load_scene(scene), announce=None)
    simulation.advance(1.0)
    error: Any = error_of_steps(simulation, 1.0)
    assert error["relative"] < 1e-3
    assert (error["turn"], error["turned"]) == (pytest.approx(0.2 / 10, rel=2e-3), "wheel")
    assert told(error).endswith("and 0.02 rad in the attitude of wheel")


def test_of_a_method_that_has_the_motion_exactly_there_is_none() -> None:
    simulation = falling(4, "rk4")
    simulation.advance(1.0)
    error: Any = error_of_steps(simulation, 1.0)
    assert told(error) == "none that half steps show"


def test_of_a_long_run_it_says_up_to_when_it_is_known() -> None:
    simulation = falling(10)
    simulation.advance(1e4)
    error: Any = error_of_steps(simulation, 1e4)
    assert not error["all"] and 0.0 < error["upto"] < 1e4
    assert told(error).endswith(f"; after t = {error['upto']:.6g} s not known: --certify bounds it")


def test_of_a_run_that_somebody_interfered_with_it_is_not_known() -> None:
    simulation = above_a_floor(50.0, "euler", 5)
    simulation.apply_wrench("stone", [100.0, 0.0, 0.0], [0.0, 0.0, 0.0])
    simulation.advance(1.0)
    error: Any = error_of_steps(simulation, 1.0)
    assert told(error) == "not known: --certify bounds it"


def test_of_an_adaptive_run_nothing_is_said() -> None:
    simulation = Simulation(load_scene("free_tumble"), announce=None)
    simulation.advance(1.0)
    assert error_of_steps(simulation, 1.0) is None
