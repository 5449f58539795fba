"""Commands, resets and states that were given to a simulation, given to another one."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rb_sim.engine.samples import Input
from rb_sim.placing import placement

if TYPE_CHECKING:
    from rb_sim.simulation import Simulation


def give(simulation: Simulation, inputs: list[Input]) -> None:
    """What came from outside at one instant, in its order, to a simulation that is there."""
    k = 0
    while k < len(inputs):
        given = inputs[k]
        k += max(1, given.together)
        if given.state:
            group = {one.body: one.state for one in inputs[k - given.together : k]}
            simulation.set_state(
                {body: placement(state) for body, state in group.items()}, project=given.project
            )
        elif given.body:
            simulation.apply_wrench(given.body, given.force, given.torque, given.frame)
        else:
            simulation.reset()
