"""Joints under time stepping: their laws beside the kernels, and a linkage beside its equation."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim import Simulation
from rb_sim.catalogue.constraints.rows import ERROR, ROW_WIDTH
from rb_sim.contact.stepping import step_kernels
from rb_sim.contact.stepping.step_workspace import memory_of, workspace_for
from rb_sim.contact.stepping.stepping_motion import Joints, joint_system
from rb_sim.mechanics.systems.multipliers import settle_bodies, write_rows
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import scene, touch
from tests.contact.stepping.tables_by_hand import Heap
from tests.mechanics.test_redundant_steps import error, linkages, with_ball


def driven() -> dict[str, Any]:
    """A sledge that is pulled at a given speed, and a rod on it; no line depends on others."""
    rod = {"mass": 0.7, "inertia": [0.04, 0.04, 0.01], "position": [0.1, 0.0, 0.5]}
    joints = {
        "knife": {"type": "velocity", "body": "sledge", "linear": [1, 0, 0], "rate": 0.3},
        "level": {"type": "plane", "body": "sledge", "normal_A": [0, 0, 1]},
        "pin": {"type": "fixed_point", "body": "rod", "parent": "sledge", "point_B": [0, 0, -0.4]},
    }
    sledge = {"mass": 2.0, "inertia": [0.2, 0.3, 0.4], "linear_velocity": [0.3, 0, 0]}
    bodies = {"sledge": sledge, "rod": rod | {"linear_velocity": [0.3, 0, 0]}}
    run = {"duration": 1.0, "method": "time_stepping", "step": 0.01}
    return {"bodies": bodies, "constraints": joints, "simulation": run}


def settled(joints: Joints, t: float, y: np.ndarray) -> None:
    """y as the kernels bring it back to the manifold, in place."""
    bodies, rows = len(joints.system.bodies), len(joints.system.lines)
    tables = joints.into(Heap(bodies, [], 1).tables)
    tables = tables._replace(joint_rows=np.zeros((rows, ROW_WIDTH)))
    memory = memory_of(0)
    space = workspace_for(bodies, 0, rows)
    step_kernels.run(step_kernels.FIND, tables, memory, space, t, 1e-3, y, 0, 0, y.copy(), memory)


@pytest.mark.parametrize("scene", [linkages(1, method="time_stepping", step=0.01), driven()])
def test_laws_of_the_joints_are_the_kernels(scene: dict[str, Any]) -> None:
    """At a state off the manifold; of a loop, which settles on other lines, once it is back."""
    compiled = compile_scene(scene_from_mapping(with_ball(scene)))
    joints = Joints(compiled.system)
    plain = joint_system(compiled.system, joints.system.lines.shape[0])
    y = compiled.y + 1e-4 * np.random.default_rng(3).normal(size=len(compiled.y))
    write_rows(plain, 0.2, y)
    assert_allclose(joints.rows(0.2, y), plain.rows, atol=1e-14)
    back, reference = y.copy(), y.copy()
    settled(joints, 0.2, back)
    if (joints.system.lines.shape[0]) < 10:
        settle_bodies(plain, 0.2, reference)
        assert_allclose(back, reference, atol=1e-13)
    write_rows(plain, 0.2, back)
    assert float(np.abs(plain.rows[:, ERROR]).max()) < 1e-14
    assert np.abs(back - y).max() < 1e-2


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
    run = Simulation(scene_from_mapping(with_ball(scene))).run(watched=False)
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
