"""A motion that ends at a singular configuration names time and constraint, and blames no step."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.base.errors import SimulationError, StepTooLargeError
from rb_sim.checks.continuation import zero_of
from rb_sim.scene.load import scene_from_mapping
from tests.checks.test_dead_point import ANGLE, SPEED, driven_to_the_end, four_bar


def failure(mapping: dict[str, Any], method: str, step: float | None) -> SimulationError:
    options = {k: v for k, v in mapping["simulation"].items() if k not in ("step", "tolerance")}
    options |= {"method": method} | ({} if step is None else {"step": step})
    simulation = Simulation(scene_from_mapping(mapping | {"simulation": options}), announce=None)
    with pytest.raises(SimulationError) as caught:
        simulation.run(watched=False)
    return caught.value


@pytest.mark.parametrize(
    ("method", "step"),
    [("gauss6", 1e-3), ("gauss6", 0.05), ("radau5", None), ("dopri853", None)],
)
def test_a_drive_at_the_end_of_its_way(method: str, step: float | None) -> None:
    """A rod of 1 m at x = 0.2 + t / 2: the end of its way is at 1.6 s."""
    told = failure(driven_to_the_end(), method, step)
    assert not isinstance(told, StepTooLargeError)
    assert "singular configuration at t = 1.6" in str(told)
    assert "'drive'" in str(told) or "'rod'" in str(told)


def test_a_change_point_within_the_step_that_fails() -> None:
    """In line at 0.6472 s; steps end at 0.65 s."""
    assert "singular configuration at t = 0.64" in str(failure(four_bar(2.0), "gauss6", 0.05))


def test_a_step_that_is_too_large_for_a_loop_is_blamed_all_the_same() -> None:
    scene = four_bar(2.0, rocker=1.5)
    spring = {"type": "spring", "body": "rocker", "point_A": [2.0, 0.0, 3.0]}
    scene["effects"] = {"spring": spring | {"stiffness": 1e9, "rest_length": 0.0}}
    scene["simulation"]["duration"] = 10.0
    told = failure(scene, "rk4", 0.01)
    assert isinstance(told, StepTooLargeError)
    assert "singular configuration" not in str(told)


@pytest.mark.parametrize("power", [1.0, 0.5])
def test_where_s_comes_to_zero(power: float) -> None:
    t = np.array([0.0, 0.2, 0.3, 0.35])
    assert zero_of(t, 2.0 * (0.4 - t) ** power, 0.36) == pytest.approx(0.4, rel=1e-9)
    assert zero_of(t, 2.0 * (2.0 - t) ** power, 0.36) is None
    assert zero_of(t, 2.0 * (0.4 + t) ** power, 0.36) is None


def seen_often(tolerance: float) -> Simulation:
    """A parallelogram that comes into line at 0.6472 s, at 2 kHz: within a step across that instant
    the stages of the steps to some of the samples find no solution."""
    mapping = four_bar(2.0)
    mapping["simulation"] |= {
        "method": "radau5",
        "tolerance": tolerance,
        "rate": 2000.0,
        "duration": 1.4,
    }
    del mapping["simulation"]["step"]
    return Simulation(scene_from_mapping(mapping), announce=None)


def test_samples_are_taken_in_parts_where_the_step_to_them_fails() -> None:
    run = seen_often(1e-6).run(check=False, watched=False)
    turn = run.orientation["crank"]
    angle = np.unwrap(2.0 * np.arctan2(-turn[:, 1], turn[:, 3]))
    # no load: the links keep their speed
    np.testing.assert_allclose(angle, ANGLE + SPEED * run.t, atol=1e-5)


def test_a_sample_that_no_step_comes_to_ends_the_run() -> None:
    """It is refused with the time, and no row of NaN comes before it."""
    rows: list[np.ndarray] = []

    class Rows:
        def open(self, scene: Any, layout: Any) -> None: ...
        def close(self, summary: Any = None) -> None: ...
        def write(self, block: Any) -> None:
            rows.append(block.position)

    try:
        seen_often(1e-8).run(check=False, watched=False, sinks=[Rows()])
    except SimulationError as error:
        assert "singular configuration at t = 0.647" in str(error)
    assert np.isfinite(np.concatenate(rows)).all()
