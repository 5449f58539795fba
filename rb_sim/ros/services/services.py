"""~/reset and ~/step (std_srvs/Trigger), ~/pause (std_srvs/SetBool).

They are there from the first second: while the engine compiles, ~/pause says how the node is to
start, and the other two are refused with that reason. Whether there is a loop to act on is looked
up in a turn of the request's, so that a request never falls between two answers.
"""

from __future__ import annotations

from typing import Protocol

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from rb_sim.base.errors import RbSimError
from rb_sim.ros.serving import Turns, serve

COMPILING = "refused: still compiling, or not configured (wait for ~/state paused or running)"
INACTIVE = "refused: the node is inactive (ros2 lifecycle set NODE activate)"


class Controlled(Protocol):
    """What the services act on."""

    paused: bool
    inactive: bool

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        ...

    def pause(self, paused: bool) -> None:
        """Pause, or go on."""
        ...

    def reset(self) -> None:
        """Begin anew from the scene's initial state."""
        ...

    def step_once(self) -> None:
        """Take one sample period while paused."""
        ...


class Services:
    """Serves the three services; the answers come after the thing is done.

    paused: whether the node is to start so.
    """

    def __init__(self, node: Node, *, paused: bool) -> None:
        self.turns = Turns()
        """whose turn it is: a request's, or that of whoever prepares, runs and ends the loop."""
        self.paused = paused
        """how the node is to start, as asked last."""
        self._loop: Controlled | None = None
        serve(node, Trigger, "~/reset", self._reset)
        serve(node, SetBool, "~/pause", self._pause)
        serve(node, Trigger, "~/step", self._step)

    def serve(self, loop: Controlled | None) -> None:
        """From here on the services act on the loop; None: on none, as before the first.

        To be called in a turn, once the loop has shown its initial state.
        """
        self._loop = loop

    def _reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        with self.turns:
            if self._loop is None:
                answer.message = COMPILING
                return answer
            try:
                self._loop.reset()
            except RbSimError as error:
                answer.message = str(error)
                return answer
            answer.success = True
            answer.message = f"initial state at t = {self._loop.t:.9g} s, no wrench"
        return answer

    def _pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        answer.success = True
        how = "paused" if request.data else "running"
        with self.turns:
            if self._loop is None:
                self.paused = request.data
                answer.message = f"compiling; it will start {how}"
                return answer
            try:
                self._loop.pause(request.data)
            except RbSimError as error:
                answer.success, answer.message = False, str(error)
                return answer
            answer.message = f"{how} at t = {self._loop.t:.9g} s"
        return answer

    def _step(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        with self.turns:
            if self._loop is None:
                answer.message = COMPILING
                return answer
            if self._loop.inactive:
                answer.message = INACTIVE
                return answer
            if not self._loop.paused:
                answer.message = "refused: only while paused (call ~/pause with true first)"
                return answer
            try:
                self._loop.step_once()
            except RbSimError as error:
                answer.message = str(error)
                return answer
            answer.success = True
            answer.message = f"t = {self._loop.t:.9g} s"
        return answer
