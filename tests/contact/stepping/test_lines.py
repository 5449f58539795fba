"""Which pairs take part in a step: those left out as far would not have, and what is an impact."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.heaps import scenes
from rb_sim.contact.stepping.constraint_rows import is_impact, takes_part
from rb_sim.contact.stepping.scene_tables import COMPLIANT, RESTITUTION
from rb_sim.contact.stepping.step_workspace import GAP, MOVES, NORMAL, POINT
from rb_sim.mechanics.systems.many_bodies import WIDTH
from tests.interpreted import interpreted


def heap_after(steps: int, looks_at_all: bool) -> tuple[np.ndarray, int]:
    """(state of ten piled spheres after so many steps of 10 ms, pairs that were left out)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.stepping import constraint_rows

    left_out, is_far = [0], constraint_rows.is_far

    def far(*arguments: object) -> bool:
        found = bool(is_far(*arguments))
        left_out[0] += found
        return found and not looks_at_all

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(constraint_rows, "is_far", far)
        mapping = scenes.piled_balls()
        mapping["simulation"] |= {"method": "time_stepping", "step": 0.01}
        simulation = Simulation(load_scene(mapping))
        simulation.advance(0.01 * steps)
    return simulation.sample().block.position, left_out[0]


def test_what_is_far_takes_no_part() -> None:
    found, left_out = interpreted(heap_after, 15, False)
    expected, _ = interpreted(heap_after, 15, True)
    assert found.tobytes() == expected.tobytes()
    assert left_out > 600


@pytest.mark.parametrize(
    ("e", "before", "now", "expected"),
    [
        (0.5, -1.0, -1.0, True),
        (0.5, -1.0, -1.4, True),
        (0.5, -1.0, -1.6, False),  # the loads give half of it in this step, and all in two
        (0.5, 1.0, 3.0, False),
        (0.0, -1.0, -1.0, False),
    ],
)
def test_what_the_loads_give_in_two_steps_is_no_impact(
    e: float, before: float, now: float, expected: bool
) -> None:
    assert is_impact(e, before, now) == expected


@pytest.mark.parametrize(
    ("gap", "moves", "e", "compliant", "expected"),
    [
        (0.019, 2.0, 0.0, 0.0, True),
        (0.021, 2.0, 0.0, 0.0, False),
        (0.009, 2.0, 0.5, 0.0, True),
        (0.011, 2.0, 0.5, 0.0, False),
        (0.009, 2.0, 0.0, 1.0, True),
        (0.011, 2.0, 0.0, 1.0, False),
        (0.001, -2.0, 0.0, 0.0, False),
        (-0.001, -2.0, 0.0, 0.0, True),
    ],
)
def test_a_support_that_comes_up_to_a_body_takes_part(
    gap: float, moves: float, e: float, compliant: float, expected: bool
) -> None:
    """What is not to bounce, within the step of 10 ms; what is, and what gives way, where half of
    the step is enough: from there on it is nearer to the next one."""
    y, u = np.zeros(WIDTH), np.zeros((1, 6))
    y[6] = 1.0
    spots, laws = np.zeros((1, 64)), np.zeros((1, 64))
    spots[0, GAP], spots[0, NORMAL + 2] = gap, 1.0
    spots[0, POINT : POINT + 3], spots[0, MOVES + 2] = (0.3, 0.2, -0.1), moves
    laws[0, RESTITUTION], laws[0, COMPLIANT] = e, compliant
    assert takes_part(spots, laws, u, y, 0, 0, -1, 0.01, 1e-6) == expected
