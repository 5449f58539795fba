# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Jacobian of a fit is the derivative of its residuals, and does not take runs beside."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.fit.test_fit import SCENES, TIMES, _plain

KEYS = {
    "drag": ["effects.air.coefficient", "bodies.ball.mass", "bodies.ball.linear_velocity"],
    "spring": ["effects.hook.stiffness", "effects.hook.damping", "effects.hook.point_A"],
    "throw": ["bodies.ball.angular_velocity", "effects.weight.acceleration"],
    "top": ["bodies.top.mass", "bodies.top.center_of_mass", "bodies.top.angular_velocity"],
    "attitude": ["bodies.nut.orientation"],
}


def both(name: str, method: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """The Jacobian as a fit takes it, the one of differences of order six, runs, smooth."""
    from rb_sim import Simulation, load_scene
    from rb_sim.bags.tracks import tracks_of_blocks
    from rb_sim.fit.fit import Recording, _Problem
    from rb_sim.fit.unknowns import free_numbers

    data = _plain(SCENES[name][0] | {"simulation": TIMES | method})
    if name == "top":
        data["effects"]["weight"] |= {"acceleration": [0.0, 0.0, -9.81]}
    if name == "throw":
        data["effects"]["weight"] |= {"acceleration": [0.3, 0.0, -9.81]}
    scene = load_scene(data)
    simulation = Simulation(scene)
    tracks = tracks_of_blocks(
        [simulation.run(watched=False).block], scene, simulation.layout, "truth"
    )
    (body,) = tracks.bodies
    problem = _Problem(Recording(tracks, {body: body}), scene, data, free_numbers(data, KEYS[name]))
    return beside(problem)


def beside(problem: Any) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """What `both` gives, of a problem."""
    x = np.array([number.start / number.scale for number in problem.free])
    x = x + 0.01 * np.linspace(-1.0, 1.0, len(x))
    before = problem.runs
    exact = problem.jacobian(x)
    runs, h, columns = problem.runs - before, 2e-3, []
    for k in range(len(x)):
        e = np.eye(len(x))[k] * h
        sides = [problem.weighted(x + j * e) - problem.weighted(x - j * e) for j in (1, 2, 3)]
        columns.append((45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h))
    return exact, np.stack(columns, axis=1), runs, problem.smooth


@pytest.mark.parametrize("name", KEYS)
def test_the_jacobian_is_that_of_high_order_differences(name: str) -> None:
    """Fixed steps: the derivative of the very numbers that a run gives."""
    exact, differences, runs, smooth = both(name, {})
    assert smooth and runs == 1
    scale = np.abs(differences).max()
    np.testing.assert_allclose(exact, differences, rtol=0.0, atol=3e-8 * scale)
    assert (np.abs(exact).max(axis=0) > 1e-3 * scale).all()  # no column is trivial


def of_node(folder: Path, set_at: int = 0) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Of a bag of the node with commands in both frames and a reset; set_at: a state is set
    before that sample, too."""
    from rb_sim.cli.verbs.fit import FitOptions, set_up
    from rb_sim.fit.fit import _Problem
    from rb_sim.fit.unknowns import free_numbers
    from rb_sim.mechanics.samples import Input
    from tests.bags.scenes import record_node

    keys = ["bodies.box.mass", "bodies.box.angular_velocity"]
    scene, data, recording = set_up(FitOptions(record_node(folder), ",".join(keys)))
    if set_at:
        assert recording.inputs is not None
        state = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.0)
        given = Input(0, set_at / 50.0, "box", state=state, together=1, project=False)
        recording.inputs[set_at] = [given]
    return beside(_Problem(recording, scene, data, free_numbers(data, keys)))


def test_a_reset_begins_with_the_derivatives_of_the_start(tmp_path: Path) -> None:
    """What comes after it depends on the numbers as what came before; it ended in a traceback."""
    exact, differences, runs, smooth = of_node(tmp_path / "bag")
    assert smooth and runs == 1
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(exact - differences).max(axis=0) < 3e-8 * scale).all()
    after = exact.reshape(61, 6, -1)[42:]
    assert (np.abs(after).max(axis=(0, 1))[1:] > 0.1 * scale[1:]).all()  # the mass: no command


def test_a_state_that_was_set_takes_differences(tmp_path: Path) -> None:
    """No derivative is carried across it."""
    found, differences, _, smooth = of_node(tmp_path / "bag", 20)
    assert not smooth
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(found - differences).max(axis=0) < 1e-5 * scale).all()
