"""What fixed steps miss between the events of contacts, beside the same steps taken by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.base.errors import StepTooLargeError
from rb_sim.checks.bounds import effort_of
from rb_sim.checks.check_list import WatchList
from rb_sim.contact.events import steps
from rb_sim.contact.problem.order import ALL, weight
from tests.interpreted import interpreted

W, REACH = 20.0, 0.3


def oscillator(**simulation: Any) -> dict[str, Any]:
    """A ball of 1 kg slides on a smooth floor, pulled by a spring: x = REACH cos(W t)."""
    spring = {"type": "spring", "body": "ball", "stiffness": W * W, "rest_length": 0.0}
    return {
        "bodies": {
            "ball": {
                "mass": 1.0,
                "shape": {"type": "sphere", "radius": 0.1},
                "position": [REACH, 0.0, 0.1],
            }
        },
        "constraints": {"floor": {"type": "contact", "body": "ball"}},
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0.0, 0.0, -9.81]},
            "spring": spring | {"point_A": [0.0, 0.0, 0.1], "point_B": [0.0, 0.0, 0.0]},
        },
        "simulation": {"duration": 2.0, "rate": 100.0} | simulation,
    }


def rk4_step(x: np.ndarray, h: float) -> np.ndarray:
    law = np.array([[0.0, 1.0], [-W * W, 0.0]])
    z, term = x.copy(), x.copy()
    for k in range(1, 5):
        term = h / k * law @ term
        z += term
    return z


def missed_by_hand(h: float, steps: int) -> float:
    """Sum of |v_h - v_h/2|, or of h W^2 |x_h - x_h/2| where that is more, over the largest |v|, of
    rk4 on the oscillator."""
    x, total, largest = np.array([REACH, 0.0]), 0.0, 0.0
    for _ in range(steps):
        whole = rk4_step(x, h)
        place, speed = np.abs(whole - rk4_step(rk4_step(x, 0.5 * h), 0.5 * h))
        total += max(speed, h * W * W * place)
        largest, x = max(largest, abs(whole[1])), whole
    return total / largest


def test_what_steps_miss_is_what_they_miss_by_hand() -> None:
    """All of the first steps are looked at: the same sum, step for step."""
    simulation = Simulation(load_scene(oscillator(method="rk4", step=0.01)))
    simulation.advance(0.9)
    assert 80 < simulation.steps <= ALL
    expected = missed_by_hand(0.01, simulation.steps)
    assert simulation.coarseness.grown == pytest.approx(expected, rel=1e-6)
    assert simulation.coarseness.grown_body == "ball"


def test_steps_that_are_not_all_looked_at_count_for_the_others() -> None:
    simulation = Simulation(load_scene(oscillator(method="rk4", step=5e-4)))
    simulation.run()
    expected = missed_by_hand(5e-4, simulation.steps)
    assert simulation.coarseness.grown == pytest.approx(expected, rel=0.05)


def found(mapping: dict[str, Any]) -> list[str]:
    simulation = Simulation(load_scene(mapping))
    watches = WatchList(simulation.scene, simulation.layout, simulation.compiled)
    for block in simulation.blocks(2.0, 100.0, lambda _: True):
        watches.add(block, lambda: effort_of(simulation))
    watches.finish()
    return [finding.watch for finding in watches.findings]


def test_steps_too_long_in_contact_are_told() -> None:
    """Seven steps to a period: rk4's phase is wrong by (w h)^5/120, 5e-3, in each of 44."""
    assert "step" in found(oscillator(method="rk4", step=0.045))
    assert not found(oscillator(method="rk4", step=1e-3))


def test_a_bounce_of_two_steps_is_told() -> None:
    """A ball comes back to a floor of springs after 143 steps, and leaves it two steps later, which
    miss a few hundredths of its speed; of four steps each misses little, and it comes back to 1.5 %
    less than its height. Six steps follow a bounce."""
    for width, told in ((2.0, ["step"]), (3.5, ["step"]), (6.0, [])):
        mapping = oscillator(method="rk4", step=1e-2)
        mapping["effects"].pop("spring")
        mapping["bodies"]["ball"]["linear_velocity"] = [0.0, 0.0, 7.0]
        stiffness = (np.pi / (width * 1e-2)) ** 2
        mapping["constraints"]["floor"]["compliance"] = {"stiffness": stiffness}
        assert [watch for watch in found(mapping) if watch == "step"] == told


@pytest.mark.parametrize("width", [1.7, 2.2, 3.2])
def test_a_bounce_between_few_steps_misses_what_it_leaves_wrong(width: float) -> None:
    """A ball that slides at 2 m/s meets springs at 1 m/s and leaves them as fast, without weight.
    All that a step misses on the way in is an error of places: by its velocities alone the first of
    these bounces seemed to miss a third of what it does."""
    step = 1e-2
    mapping = oscillator(method="rk4", step=step)
    mapping["effects"] = {}
    mapping["bodies"]["ball"] |= {"linear_velocity": [2.0, 0.0, -1.0], "position": [0.0, 0.0, 0.15]}
    mapping["constraints"]["floor"]["compliance"] = {"stiffness": (np.pi / (width * step)) ** 2}
    simulation = Simulation(load_scene(mapping))
    run = simulation.run(duration=0.15, watched=False)
    wrong = abs(run.linear_velocity["ball"][-1, 2] - 1.0)
    missed = simulation.coarseness.grown * 5.0**0.5
    assert wrong < missed < 2.0 * wrong


def test_what_a_step_misses_of_next_to_nothing_is_not_told() -> None:
    """A ball that slides at 5 m/s trembles on springs by 4 um, in four steps to a period."""
    mapping = oscillator(method="rk4", step=1e-3, duration=0.5)
    mapping["effects"].pop("spring")
    mapping["bodies"]["ball"]["linear_velocity"] = [5.0, 0.0, 0.0]
    mapping["constraints"]["floor"]["compliance"] = {"stiffness": 1.5e3**2}
    assert "step" not in found(mapping)


def test_rounding_of_what_rests_is_nothing_missed() -> None:
    """A cylinder that stands on a rough slope has velocities of 1e-122 m/s, half of them missed."""
    from benchmarks.contact.coupled_scenes import coupled_scene

    mapping = coupled_scene(1313, 8).mapping
    own = {"duration": 0.1, "rate": 100.0, "method": "rk4", "step": 1e-2, "project_initial": True}
    assert "step" not in found(mapping | {"simulation": own})


def ends_with_and_without_looks() -> list[tuple[np.ndarray, float, int]]:
    """(pose and velocity at the end, what was missed, events), with looks at all steps and none."""
    mapping = oscillator(method="rk4", step=4e-3, duration=0.2)
    mapping["constraints"]["floor"]["friction"] = {"type": "coulomb", "static": 0.3}
    found = []
    for looks in (1, 0):
        steps.weight = lambda *_, looks=looks: looks  # type: ignore[assignment]
        simulation = Simulation(load_scene(mapping))
        simulation.run()
        end = np.array(simulation._motion.coordinates)
        found.append((end, simulation.coarseness.grown, len(simulation.events)))
    steps.weight = weight
    return found


def test_looking_leaves_the_run_as_it_is() -> None:
    """The tables of the end of the step are there again: bit for bit the run without a look."""
    looked, passed = interpreted(ends_with_and_without_looks)
    assert looked[1] > 0.0 == passed[1]
    assert (looked[0] == passed[0]).all()
    assert looked[2] == passed[2] > 0


def test_what_gauss6_cannot_follow_is_refused_with_the_contact() -> None:
    """The iteration of the method has no solution where friction turns a slow slip."""
    from benchmarks.contact.random_scenes import random_scene

    mapping = dict(random_scene(31, 36).mapping)
    own = {"duration": 0.5, "rate": 100.0, "method": "gauss6", "step": 2e-3}
    kept = {k: v for k, v in mapping["simulation"].items() if k not in ("tolerance", "step")}
    mapping["simulation"] = kept | own
    with pytest.raises(StepTooLargeError, match=r"gauss6 .* a slow slip .*on_c/1.*dopri853"):
        Simulation(load_scene(mapping)).run()
