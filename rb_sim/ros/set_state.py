"""~/set_state (rb_sim_interfaces/SetState): bodies put elsewhere, checked or projected.

The state is the next sample, one period on, as after ~/reset; commands go on. Poses and twists are
those of the body origins in world axes, angular velocities too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from rclpy.node import Node
from rclpy.time import Time

from rb_sim.errors import RbSimError
from rb_sim.ros.offers import serve
from rb_sim.ros.serving import Turns
from rb_sim.ros.state_messages import StateMessages
from rb_sim.sinks.frames import conjugate, rotate

if TYPE_CHECKING:
    from rb_sim.placing import Placement
    from rb_sim.ros.stepper import Stepper
    from rb_sim.simulation import Simulation


class Placing(Protocol):
    """What the service acts on."""

    failure: str
    turns: Turns

    def set_state(self, bodies: dict[str, Placement], *, project: bool) -> None: ...


class SetStateService:
    """Serves ~/set_state. loop: the node's."""

    def __init__(self, node: Node, loop: Placing, simulation: Simulation, stepper: Stepper) -> None:
        from rb_sim_interfaces.srv import SetState  # type: ignore[import-not-found]

        self._loop, self._stepper = loop, stepper
        self._state = StateMessages(simulation.scene, simulation.layout)
        serve(node, SetState, "~/set_state", self._set)

    def _set(self, request: Any, answer: Any) -> Any:
        with self._loop.turns:
            if self._loop.failure:
                answer.message = f"{self._loop.failure}; ~/reset goes first"
                return answer
            try:
                bodies = {one.body: _placement(one) for one in request.bodies}
                if len(bodies) < len(request.bodies):
                    raise RbSimError("bodies: one is given twice")
                self._loop.set_state(bodies, project=request.project)
            except RbSimError as error:
                answer.message = str(error)
                return answer
            answer.success = True
            answer.message = f"set at t = {self._stepper.t:.9g} s"
            answer.stamp = Time(nanoseconds=round(self._stepper.t * 1e9)).to_msg()
            row = self._stepper.last_row
            assert row is not None  # it has just been emitted
            answer.bodies = self._state.of(row).bodies
        return answer


def _placement(one: Any) -> Placement:
    """A BodyState as a placement: the angular velocity in body axes. RbSimError: it cannot be."""
    pose, twist = one.pose, one.twist
    q = np.array([getattr(pose.orientation, name) for name in "xyzw"])
    if not q.any():
        raise RbSimError(f"{one.body}.orientation: got (0, 0, 0, 0); must have length 1")
    return {
        "position": _vector(pose.position),
        "orientation": q.tolist(),
        "linear_velocity": _vector(twist.linear),
        "angular_velocity": rotate(conjugate(q), np.array(_vector(twist.angular))).tolist(),
    }


def _vector(of: Any) -> list[float]:
    return [of.x, of.y, of.z]
