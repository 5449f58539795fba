"""The Jacobian of a fit is the derivative of its residuals, and does not take runs beside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.fit.test_fit import SCENES, TIMES, _plain
from tests.interpreted import interpreted

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
    from rb_sim.fit.parameters import free_numbers

    data = _plain(SCENES[name][0] | {"simulation": TIMES | method})
    if name == "top":
        data["effects"]["weight"] |= {"acceleration": [0.0, 0.0, -9.81]}
    if name == "throw":
        data["effects"]["weight"] |= {"acceleration": [0.3, 0.0, -9.81]}
    scene = load_scene(data)
    simulation = Simulation(scene)
    tracks = tracks_of_blocks([simulation.run().block], scene, simulation.layout, "truth")
    (body,) = tracks.bodies
    problem = _Problem(Recording(tracks, {body: body}), scene, data, free_numbers(data, KEYS[name]))
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
    exact, differences, runs, smooth = interpreted(both, name, {})
    assert smooth and runs == 1
    scale = np.abs(differences).max()
    np.testing.assert_allclose(exact, differences, rtol=0.0, atol=3e-8 * scale)
    assert (np.abs(exact).max(axis=0) > 1e-3 * scale).all()  # no column is trivial
