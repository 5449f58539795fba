# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Joints under time stepping: their laws beside the kernels, and a linkage beside its equation."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation
from rb_sim.contact.gauss_seidel import MOST_TOGETHER
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, body, scene, touch
from tests.mechanics.test_redundant import error, linkages, with_ball


def test_a_linkage_moves_as_its_equation_says_to_second_order() -> None:
    """As long as nothing strikes it: what its joints ask for in the middle of a step leaves it on
    them at its end."""
    errors = []
    for step in (0.01, 0.002):
        scene = with_ball(linkages(1, method="time_stepping", step=step))
        errors.append(error(Simulation(scene_from_mapping(scene))))
    assert errors[0] < 2e-3
    assert 17.0 < errors[0] / errors[1] < 35.0


def pull_of_a_pendulum(step: float) -> float:
    """Error of the reaction of a pendulum that falls from the horizontal, at its worst [N], beside
    m l w^2 and weight along its rod, and what its inertia takes of the weight across."""
    mass, length, moment, g = 1.3, 0.8, 0.2, 9.81
    rod = {"mass": mass, "inertia": [moment] * 3, "position": [length, 0.0, 0.0]}
    pin = {"type": "fixed_point", "body": "rod", "point_B": [-length, 0.0, 0.0]}
    scene = {
        "bodies": {"rod": rod},
        "constraints": {"pin": pin},
        "effects": {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -g]}},
        "simulation": {"duration": 0.8, "rate": 50.0, "method": "time_stepping", "step": step},
    }
    run = Simulation(scene_from_mapping(with_ball(scene))).run(checks=False)
    along = run.position["rod"][1:] / length  # away from the pin
    across = np.stack([-along[:, 2], 0.0 * along[:, 0], along[:, 0]], 1)  # upwards at the start
    about = moment + mass * length**2
    centripetal = mass * length * (-2.0 * mass * g * length * along[:, 2] / about)
    inward = centripetal - mass * g * along[:, 2]
    upward = mass * g * along[:, 0] * (1.0 - mass * length**2 / about)
    expected = -inward[:, None] * along + upward[:, None] * across
    return float(np.abs(run.reaction["pin"].force[1:] - expected).max())


def test_the_reactions_of_a_joint_that_turns_are_those_of_its_motion() -> None:
    """To first order; half of the centripetal force was missing, at any step."""
    coarse, fine = pull_of_a_pendulum(0.01), pull_of_a_pendulum(0.002)
    assert fine < 0.4
    assert 4.0 < coarse / fine < 6.5


def test_joints_too_many_to_be_solved_together_hold_what_is_struck() -> None:
    """Bodies on more lines of welds than MOST_TOGETHER: a ball leaves the first as from a wall."""
    names = [f"b{k}" for k in range(MOST_TOGETHER // 6 + 1)]
    shape = {"type": "box", "size": [0.5, 0.5, 0.2]}
    bodies = {n: body(shape, [k, 0.0, -0.1]) for k, n in enumerate(names)}
    bodies["ball"] = ball([0.1, 0.0, 0.1005], linear_velocity=[0.0, 0.0, -1.0])
    welds = {f"weld {n}": {"type": "weld", "body": n} for n in names}
    top = touch("ball", parent="b0", surface={"type": "shape"}, restitution=0.5)
    mapping = scene(bodies, welds | {"top": top}, gravity=False)
    mapping["simulation"] = {"duration": 0.002, "method": "time_stepping", "step": 1e-3}
    run = Simulation(scene_from_mapping(mapping)).run(at=[0.002], checks=False)
    assert_allclose(run.linear_velocity["ball"][-1], [0.0, 0.0, 0.5], atol=1e-9)


@pytest.mark.parametrize("step", [0.01, 0.001])
def test_joints_are_solved_together_and_leave_no_residual(step: float) -> None:
    """One line after the other, sweeps ended at 1e-4 of the largest impulse, step after step."""
    scene = with_ball(linkages(1, method="time_stepping", step=step))
    simulation = Simulation(scene_from_mapping(scene))
    simulation.advance(0.6)  # the ball has bounced
    assert simulation.unsolved_steps[0] == 0
    assert simulation.unsolved_steps[1] < 1e-9


def test_what_a_guide_leads_rebounds_as_its_law_says() -> None:
    """Along a line that leans the speed turns round to e times what it was, whatever friction
    takes: push and friction work against the guide, and sweeps that held it in turn with the
    contact came to 0.88 e within their bound."""
    e, direction = 0.26, np.array([0.3, 0.0, -1.0])
    line = {"type": "line", "direction": direction.tolist(), "point": [0.0, 0.0, 0.3]}
    mapping = scene(
        {
            "mass": 2.8,
            "inertia": [0.01, 0.006, 0.012],
            "position": [0.0, 0.0, 0.3],
            "linear_velocity": direction.tolist(),
        },
        {
            "guide": {"type": "translation", "body": "body", "guide": line},
            "floor": touch(mu=0.7, kinetic=0.48, restitution=e, points=[[0.05, 0.08, -0.1]]),
        },
        gravity=False,
    )
    mapping["simulation"] = {"duration": 0.3, "rate": 10.0}
    mapping["simulation"] |= {"method": "time_stepping", "step": 1e-3}
    simulation = Simulation(scene_from_mapping(mapping))
    run = simulation.run(check=False)
    assert_allclose(run.linear_velocity["body"][-1], -e * direction, atol=1e-7)
    assert simulation.unsolved_steps[0] == 0
