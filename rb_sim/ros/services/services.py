"""~/reset and ~/step (std_srvs/Trigger), ~/pause (std_srvs/SetBool).

They are there from the first second: while the engine compiles, ~/pause says how the node is to
start, and the other two are refused with that reason. Whether there is a loop to act on is looked
up in a turn of the request's, so that a request never falls between two answers.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

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
    def t(self) -> float: ...

    def pause(self, paused: bool) -> None: ...

    def reset(self) -> None: ...

    def step_once(self) -> None: ...


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

    def _answered(self, answer: Any, act: Callable[[], str]) -> Any:
        """The answer, in a turn: what `act` says it has done, or why it is refused."""
        with self.turns:
            try:
                answer.message, answer.success = act(), True
            except RbSimError as error:
                answer.message = str(error)
        return answer

    def _there(self) -> Controlled:
        """The loop; RbSimError where there is none yet."""
        if self._loop is None:
            raise RbSimError(COMPILING)
        return self._loop

    def _reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        def act() -> str:
            loop = self._there()
            loop.reset()
            return f"initial state at t = {loop.t:.9g} s, no wrench"

        return self._answered(answer, act)

    def _pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        def act() -> str:
            how = "paused" if request.data else "running"
            if self._loop is None:
                self.paused = request.data
                return f"compiling; it will start {how}"
            self._loop.pause(request.data)
            return f"{how} at t = {self._loop.t:.9g} s"

        return self._answered(answer, act)

    def _step(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        def act() -> str:
            loop = self._there()
            if loop.inactive:
                raise RbSimError(INACTIVE)
            if not loop.paused:
                raise RbSimError("refused: only while paused (call ~/pause with true first)")
            loop.step_once()
            return f"t = {loop.t:.9g} s"

        return self._answered(answer, act)
