# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The lifecycle node of `managed:=true`; the main thread executes its transitions."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.service import Service

from rb_sim.base.errors import RbSimError
from rb_sim.ros.node import SimulationLoop
from rb_sim.ros.preparing import begin, described, ended, prepared, the_logs
from rb_sim.ros.services import Services
from rb_sim.ros.serving import Serving
from rb_sim.ros.topics.inbox import HidesPolled

if TYPE_CHECKING:
    from rb_sim.ros.parameters import LiveSettings
    from rb_sim.ros.topics.presence import Presence
    from rb_sim.simulation.signals import Interruption


Transit = Callable[[Any, Any], Any]
LOOK = 0.05
"""[s] between checks for signals and for the end of the main thread."""
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Turn:
    """A request to the main thread. over: set once it answers no more requests."""

    def __init__(self, over: threading.Event) -> None:
        self._over = over
        self._done = threading.Event()
        self._success = False

    def answer(self, success: bool) -> None:
        """Answer the request: whether it was done."""
        self._success = success
        self._done.set()

    def wait(self) -> TransitionCallbackReturn:
        """Wait for the answer, or until there will be none."""
        while not (self._done.wait(LOOK) or self._over.is_set()):
            pass
        return SUCCESS if self._success else FAILURE


class ManagedNode(HidesPolled, LifecycleNode):
    """Lifecycle node that hands transitions to the main thread (`simulate_managed`)."""

    def __init__(self, name: str, **options: Any) -> None:
        self.loop: SimulationLoop | None = None
        """the simulation loop, from configure to cleanup."""
        self.configure: queue.SimpleQueue[Turn] = queue.SimpleQueue()
        self.ended = threading.Event()
        """set when the main thread executes no more transitions."""
        self.left = Turn(self.ended)
        """answered at the end of the loop."""
        self.over = False
        """True after shutdown."""
        super().__init__(name, **options)
        self.transitions = [
            Aside(service) for service in self.services if service.srv_type is ChangeState
        ]

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Compile the scene and start the logs."""
        turn = Turn(self.ended)
        self.configure.put(turn)
        return turn.wait()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start simulated time."""
        return self._activate(True)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop simulated time."""
        return self._activate(False)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Finish the logs and discard the scene."""
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
    """Executes each request of a service in a thread that also sends the answer.

    Meanwhile parameters and other services are answered, and another transition is refused. A
    transition that is not allowed in the present state is refused too: rclpy raises, and the client
    would wait forever.
    """

    def __init__(self, service: Service) -> None:
        self._transit: Transit = service.callback
        self._send = service.send_response
        self._request: Any = None
        self._threads: list[threading.Thread] = []
        # the two functions that an executor calls for a request, in this order
        service.callback, service.send_response = self._keep, self._begin  # type: ignore[method-assign]

    def join(self) -> None:
        """Wait until all requests have been answered."""
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


# The node under a lifecycle manager (`managed:=true`), like nodes of ros2_control and Nav2.
#
# configure compiles the scene, starts the logs and publishes the initial state; activate starts
# time, deactivate stops it; cleanup finishes the logs and removes everything, so that configure can
# start again; shutdown ends the process. Each transition has its own thread (`Aside`); the main
# thread does the long work, and the answer is sent afterwards. The serving thread continues, and
# destroys publishers and services itself, since its executor must not see them vanish.


def simulate_managed(
    node: ManagedNode, asked: LiveSettings, stop: Interruption, began: float, presence: Presence
) -> int:
    """Execute transitions until shutdown, a signal or the duration; returns the exit status.

    Raises RbSimError if a running loop cannot continue and is to end then.
    """
    serving, services = Serving(node), Services(node, paused=asked.now.start_paused)
    node.get_logger().info("unconfigured: waits for the transition configure")
    stop.logging = True  # a signal ends the process in order, also without a loop
    serving.start()
    status, going = 0, True
    try:
        while going and not (node.over or stop.cause):
            before = {*node.publishers, *node.subscriptions, *node.services}
            node.left = Turn(node.ended)
            who = (presence, services, serving)
            status, going, refused = _configured(node, asked, stop, began, *who)
            with services.turns.own():
                services.serve(None)
            node.loop = None
            serving.do(lambda before=before: _take_down(node, before))
            presence.tell("unconfigured")
            if refused is not None:
                refused.answer(False)
            node.left.answer(True)
    finally:
        node.ended.set()
        for one in node.transitions:
            one.join()
        serving.stop()
    return status


def _configured(
    node: ManagedNode,
    asked: LiveSettings,
    stop: Interruption,
    began: float,
    presence: Presence,
    services: Services,
    serving: Serving,
) -> tuple[int, bool, Turn | None]:
    """Run one loop, from configure to cleanup.

    Returns the exit status, whether another loop may follow, and the transition to refuse if there
    was no loop."""
    with ExitStack() as closing:
        with presence.telling_time(serving.do):
            turn = _asked_to_configure(node, stop, serving)
            if turn is None:
                return 0, False, None
            try:
                presence.tell("compiling")
                scene = described(asked.now, presence)
                logs = the_logs(node, asked.now)
                if logs is not None:
                    closing.callback(logs.close)
                simulation = prepared(node, scene, asked.now.discovery, began, stop)
            except RbSimError as error:
                return _refused(node, turn, error)
        try:
            with services.turns.own():
                who = (presence, services, serving)
                loop = SimulationLoop(node, simulation, asked, logs, stop, *who, managed=True)
                closing.pop_all()
                closing.callback(serving.do, loop.close)
                begin(node, loop, simulation, asked.now, logs, stop)
        except RbSimError as error:
            return _refused(node, turn, error)
        node.loop = loop
        turn.answer(True)
        loop.run()
    return ended(node, loop, stop), loop.left, None


def _asked_to_configure(node: ManagedNode, stop: Interruption, serving: Serving) -> Turn | None:
    """Wait for the transition; None if the process is to end."""
    while not (node.over or stop.cause):
        serving.check()
        try:
            return node.configure.get(timeout=LOOK)
        except queue.Empty:
            continue
    return None


def _refused(node: ManagedNode, turn: Turn, error: RbSimError) -> tuple[int, bool, Turn]:
    """Report why the node was not configured, and continue unconfigured."""
    node.get_logger().error(f"not configured: {error}")
    return 0, True, turn


def _take_down(node: ManagedNode, before: set[Any]) -> None:
    """Destroy the publishers, subscriptions and services created since `before`."""
    for publisher in set(node.publishers) - before:
        node.destroy_publisher(publisher)
    for subscription in set(node.subscriptions) - before:
        node.destroy_subscription(subscription)
    for service in set(node.services) - before:
        node.destroy_service(service)
