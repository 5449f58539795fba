# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Lines in loops are chosen anew after every step: the choice, and linkages in full turns."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation
from rb_sim.scene.load import scene_from_mapping
from tests.mechanics.bennett import Bennett
from tests.properties.test_newton_euler import CLOSE, defects

TURNING = 4.0
"""[rad/s] at which the linkages turn: more than a full turn in TIME."""
TIME = 2.0


WAYS: dict[str, tuple[dict[str, Any], float]] = {
    "rk4": ({"step": 0.005}, 4e-7),
    "gauss6": ({"step": 0.01}, 5e-10),
    "dopri853": ({"tolerance": 1e-10}, 5e-10),
    "taylor": ({"tolerance": 1e-10}, 5e-10),
    "radau5": ({"tolerance": 1e-8}, 1e-9),
}
"""Of each method its setting and the error [m]; with lines chosen at the start alone they were
up to 8e-2, and gauss6 went on at no step."""


@cache
def middles(seed: int) -> np.ndarray:
    """Where the bars of a linkage are at ten instants a second."""
    return Bennett(seed).middles(TURNING, np.linspace(0.0, TIME, 21))


def watched(mapping: dict[str, Any]) -> Any:
    """The run of a scene; whatever a watch finds is an error."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Simulation(scene_from_mapping(mapping)).run()


@pytest.mark.parametrize(
    ("seed", "method"),
    [(2, "rk4"), (4, "rk4"), (7, "dopri853"), (2, "gauss6"), (4, "taylor"), (7, "radau5")],
)
def test_linkages_turn_full_turns(seed: int, method: str) -> None:
    linkage, (setting, close) = Bennett(seed), WAYS[method]
    run = watched(linkage.scene(TURNING, duration=TIME, rate=10.0, method=method, **setting))
    found = np.stack([run.position[f"bar{k}"] for k in range(3)], axis=1)
    assert np.abs(found - middles(seed)).max() < close


def test_reactions_of_linkages_move_them() -> None:
    scene = Bennett(2).scene(TURNING, duration=TIME, rate=10.0)
    for t in (0.7, 1.6):
        assert max(defects(scene, t)) < CLOSE


def test_reactions_of_linkages_do_not_hang_on_the_order_of_hinges() -> None:
    """They are those of least norm, whichever lines get a multiplier."""
    scene = Bennett(3).scene(TURNING, duration=TIME, rate=10.0)
    turned_round = scene | {"constraints": dict(reversed(scene["constraints"].items()))}
    one, other = watched(scene), watched(turned_round)
    for name, reaction in one.reaction.items():
        largest = np.abs(reaction.force).max()
        np.testing.assert_allclose(
            other.reaction[name].force, reaction.force, rtol=0.0, atol=1e-6 * largest
        )


def test_a_run_in_pieces_is_the_run_in_one() -> None:
    """To the last bit, wherever samples are taken: what is chosen hangs on the steps alone."""
    options = {"duration": TIME, "method": "rk4", "step": 0.005}
    scene = Bennett(4).scene(TURNING, rate=40.0, **options)
    whole = watched(scene)
    parts = Simulation(scene_from_mapping(scene))
    for t in (0.3, 0.7123, 1.4):
        parts.advance(t - parts.time)
    rest = parts.run(TIME - 1.4, 40.0)
    coarse = watched(Bennett(4).scene(TURNING, rate=5.0, **options))
    for name in whole.position:
        np.testing.assert_array_equal(rest.position[name][-1], whole.position[name][-1])
        np.testing.assert_array_equal(coarse.position[name], whole.position[name][::8])


def placed(simulation: Simulation) -> np.ndarray:
    """Where the bars of a linkage are now."""
    sample = simulation.sample()
    return np.stack([sample.position[f"bar{k}"][0] for k in range(3)])


def test_looking_at_the_present_changes_nothing() -> None:
    """A sample of the present takes its inputs anew; the lines stay as they are chosen."""
    ends = []
    for looking in (True, False):
        linkage, step = Bennett(2), 0.01
        scene = linkage.scene(TURNING, method="rk4", step=step)
        simulation = Simulation(scene_from_mapping(scene))
        for _ in range(100):
            simulation.advance(step)
            if looking:
                simulation.sample()
        ends.append(placed(simulation))
    np.testing.assert_array_equal(*ends)


def test_a_state_that_is_set_has_lines_of_its_own() -> None:
    """One step from places at some of which the lines of the start serve badly."""
    linkage, step = Bennett(0), 0.01
    simulation = Simulation(scene_from_mapping(linkage.scene(TURNING, method="rk4", step=step)))
    fields = ("position", "orientation", "linear_velocity", "angular_velocity")
    for angle in np.arange(2.5, 3.5, 0.1):
        linkage.start = angle
        there = linkage.scene(TURNING)["bodies"]
        simulation.set_state({name: {f: body[f] for f in fields} for name, body in there.items()})
        simulation.advance(step)
        after = linkage.middles(TURNING, np.array([0.0, step]))[-1]
        assert np.abs(placed(simulation) - after).max() < 1e-7
