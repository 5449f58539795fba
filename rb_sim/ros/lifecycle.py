# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node of `managed:=true`: rclpy's lifecycle node; the main thread carries out its transitions.

Apart from `managed.py`, since a node is to be seen before what it runs is imported.
"""

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


# The node under a lifecycle manager: `managed:=true`, as ros2_control's and Nav2's nodes are.
#
# configure compiles the scene, begins the logs and shows the initial state; activate lets time run,
# deactivate stops it; cleanup finishes the logs and takes everything down, so that configure begins
# anew; shutdown ends the process. A transition has a thread of its own (`lifecycle.Aside`), the
# main thread carries out what is long, and the answer comes when that is done. Who serves ROS goes
# on, and takes down what was offered: nothing is destroyed while it looks at what there is.


def simulate_managed(
    node: ManagedNode, asked: LiveSettings, stop: Interruption, began: float, presence: Presence
) -> int:
    """Carry out the transitions until shutdown, a signal, or the end of the duration; the status.

    Raises RbSimError where a loop that runs cannot go on and is to end then.
    """
    serving, services = Serving(node), Services(node, paused=asked.now.start_paused)
    node.get_logger().info("unconfigured: waits for the transition configure")
    stop.logging = True  # a signal ends the process in order, also where nothing runs
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
    """One loop, from configure to cleanup: the exit status, whether another may follow, and the
    transition that is to be refused, if there was no loop."""
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
    """Wait for the transition; None: the process is to end."""
    while not (node.over or stop.cause):
        serving.check()
        try:
            return node.configure.get(timeout=LOOK)
        except queue.Empty:
            continue
    return None


def _refused(node: ManagedNode, turn: Turn, error: RbSimError) -> tuple[int, bool, Turn]:
    """Say why there is no loop, and go on without."""
    node.get_logger().error(f"not configured: {error}")
    return 0, True, turn


def _take_down(node: ManagedNode, before: set[Any]) -> None:
    """Destroy what was offered since."""
    for publisher in set(node.publishers) - before:
        node.destroy_publisher(publisher)
    for subscription in set(node.subscriptions) - before:
        node.destroy_subscription(subscription)
    for service in set(node.services) - before:
        node.destroy_service(service)
