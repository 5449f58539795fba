"""~/reset and ~/step (std_srvs/Trigger), ~/pause (std_srvs/SetBool)."""

from __future__ import annotations

from typing import Protocol

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from rb_sim.errors import RbSimError


class Controlled(Protocol):
    """What the services act on."""

    paused: bool

    @property
    def t(self) -> float: ...

    def pause(self, paused: bool) -> None: ...

    def reset(self) -> None: ...

    def step_once(self) -> None: ...


class Services:
    """Serves the three services; the answers come after the thing is done."""

    def __init__(self, node: Node, loop: Controlled) -> None:
        self._loop = loop
        node.create_service(Trigger, "~/reset", self._reset)
        node.create_service(SetBool, "~/pause", self._pause)
        node.create_service(Trigger, "~/step", self._step)

    def _reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        self._loop.reset()
        answer.success = True
        answer.message = f"initial state at t = {self._loop.t:.9g} s, no wrench"
        return answer

    def _pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        self._loop.pause(request.data)
        answer.success = True
        answer.message = f"{'paused' if request.data else 'running'} at t = {self._loop.t:.9g} s"
        return answer

    def _step(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
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
