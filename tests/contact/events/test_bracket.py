"""An event is located in a handful of states, however many points there are that touch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.contact.scenes import box, scene, touch
from tests.contact_runs import contact_run
from tests.interpreted import interpreted

MOST = 8
"""States looked at for one event, one of them at the end of the step."""


def looks(mapping: dict[str, Any], duration: float) -> tuple[int, int]:
    """(events located, states looked at for them)."""
    from rb_sim import Simulation, load_scene
    from rb_sim.contact.events import next_event as inside

    counted = {"states": 0, "events": 0}
    level_at, begin = inside.level_at, inside.begin_bracket

    def looked(*arguments: Any) -> Any:
        counted["states"] += 1
        return level_at(*arguments)

    def begun(*arguments: Any) -> Any:
        counted["events"] += 1
        return begin(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(inside, "level_at", looked)
        patch.setattr(inside, "begin_bracket", begun)
        mapping["simulation"] |= {"duration": duration}
        Simulation(load_scene(mapping)).run()
    return counted["events"], counted["states"]


def falling(**more: Any) -> dict[str, Any]:
    """A tilted box that falls onto its corners, bounces and slips."""
    tilted = box(
        [0.3, 0.2, 0.1], [0, 0, 0.15],
        orientation={"axis": [0.6, 0.8, 0.0], "angle": 0.2}, linear_velocity=[0.3, 0.0, 0.0],
    )  # fmt: skip
    return scene(tilted, touch(mu=0.3, restitution=0.3, **more))


def test_a_handful_of_states_tells_an_instant() -> None:
    """Regula falsi on the lowest of all event functions, which has kinks, took 26."""
    events, states = interpreted(looks, falling(), 0.2)
    assert events >= 8
    assert states <= MOST * events


def test_the_instants_are_those_of_free_fall() -> None:
    """The first touch to the last digits: where the lowest corner's parabola meets the floor."""
    run = contact_run(falling(), [0.0, 0.2], tolerance=1e-12)
    first = min(event.t for event in run.events)
    turn = np.array([0.6, 0.8, 0.0])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    r = corners * [0.15, 0.1, 0.05]
    heights = (r * np.cos(0.2) + np.cross(turn, r) * np.sin(0.2))[:, 2]
    heights += turn[2] * (r @ turn) * (1.0 - np.cos(0.2))
    assert abs(first - np.sqrt(2.0 * (0.15 + heights.min()) / 9.81)) < 1e-14
