"""The node of `managed:=true`: rclpy's lifecycle node; the main thread carries out its transitions.

Apart from `managed.py`, since a node is to be seen before what it runs is imported.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.service import Service

from rb_sim.ros.inbox import HidesPolled

if TYPE_CHECKING:
    from rb_sim.ros.node import SimulationLoop

Transit = Callable[[Any, Any], Any]
LOOK = 0.05
"""[s] between looks at signals, and whether what is waited for will come."""
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Turn:
    """Something that the main thread is asked to do. over: set once it does nothing any more."""

    def __init__(self, over: threading.Event) -> None:
        self._over = over
        self._done = threading.Event()
        self._success = False

    def answer(self, success: bool) -> None:
        """It is done, or cannot be."""
        self._success = success
        self._done.set()

    def wait(self) -> TransitionCallbackReturn:
        """Wait for the answer, or until there will be none."""
        while not (self._done.wait(LOOK) or self._over.is_set()):
            pass
        return SUCCESS if self._success else FAILURE


class ManagedNode(HidesPolled, LifecycleNode):
    """Hands transitions over to the main thread (`simulate_managed`)."""

    def __init__(self, name: str, **options: Any) -> None:
        self.loop: SimulationLoop | None = None
        """what runs, from configure to cleanup."""
        self.configure: queue.SimpleQueue[Turn] = queue.SimpleQueue()
        self.ended = threading.Event()
        """the main thread carries out no transition any more."""
        self.left = Turn(self.ended)
        """the loop's end."""
        self.over = False
        """after shutdown."""
        super().__init__(name, **options)
        self.transitions = [
            Aside(service) for service in self.services if service.srv_type is ChangeState
        ]

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Compile, and begin the logs."""
        turn = Turn(self.ended)
        self.configure.put(turn)
        return turn.wait()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Let time run."""
        return self._activate(True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop it."""
        return self._activate(False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finish the logs and forget the scene."""
        return self._leave()

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """As cleanup, and end the process."""
        self.over = True
        return self._leave()

    def _activate(self, active: bool) -> TransitionCallbackReturn:
        loop = self.loop
        if loop is None:
            return FAILURE
        with loop.turns:
            loop.activate(active)
        return SUCCESS

    def _leave(self) -> TransitionCallbackReturn:
        loop, left = self.loop, self.left
        if loop is None:
            return SUCCESS
        loop.leave()
        return left.wait()


class Aside:
    """Has a service's requests carried out in a thread each, which sends the answer: parameters and
    other services are answered meanwhile, another transition is refused.

    A transition that the present state has not is refused, too: rclpy raises, and whoever asked
    would wait for an answer for ever.
    """

    def __init__(self, service: Service) -> None:
        self._transit: Transit = service.callback
        self._send = service.send_response
        self._request: Any = None
        self._threads: list[threading.Thread] = []
        # what an executor calls for a request, one after the other
        service.callback, service.send_response = self._keep, self._begin  # type: ignore[method-assign]

    def join(self) -> None:
        """Wait until all have been answered."""
        for thread in self._threads:
            thread.join()

    def _keep(self, request: Any, answer: Any) -> Any:
        self._request = request
        return answer

    def _begin(self, answer: Any, header: Any) -> None:
        given = (self._request, answer, header)
        thread = threading.Thread(target=self._carry_out, args=given, daemon=True)
        self._threads = [*(one for one in self._threads if one.is_alive()), thread]
        thread.start()

    def _carry_out(self, request: Any, answer: Any, header: Any) -> None:
        try:
            answer = self._transit(request, answer)
        except Exception:  # rclpy's own error types share no base class
            answer.success = False
        self._send(answer, header)
