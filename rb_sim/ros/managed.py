"""The node under a lifecycle manager: `managed:=true`, as ros2_control's and Nav2's nodes are.

configure compiles the scene, begins the logs and shows the initial state; activate lets time run,
deactivate stops it; cleanup finishes the logs and takes everything down, so that configure begins
anew; shutdown ends the process. The thread that serves ROS takes a transition, the main thread
carries out what is long, and the answer comes when that is done.
"""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from rb_sim.errors import RbSimError
from rb_sim.ros.inbox import HidesPolled
from rb_sim.ros.node import SimulationLoop
from rb_sim.ros.preparing import begin, ended, prepared, the_logs
from rb_sim.ros.presence import Presence
from rb_sim.ros.services import Services
from rb_sim.ros.serving import Serving

if TYPE_CHECKING:
    from rb_sim.cli.signals import Interruption
    from rb_sim.ros.live_settings import LiveSettings

Transit = Callable[[Any, Any], Any]
LOOK = 0.05
"""[s] between looks at signals while there is nothing to run."""
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class Turn:
    """Something that the main thread is asked to do."""

    def __init__(self) -> None:
        self._done = threading.Event()
        self._success = False

    def answer(self, success: bool) -> None:
        """It is done, or cannot be."""
        self._success = success
        self._done.set()

    def wait(self) -> TransitionCallbackReturn:
        """Wait for the answer."""
        self._done.wait()
        return SUCCESS if self._success else FAILURE


class ManagedNode(HidesPolled, LifecycleNode):
    """Hands transitions over to the main thread (`simulate_managed`)."""

    def __init__(self, name: str, **options: Any) -> None:
        self.loop: SimulationLoop | None = None
        """what runs, from configure to cleanup."""
        self.configure: queue.SimpleQueue[Turn] = queue.SimpleQueue()
        self.left = Turn()
        """the loop, when it was asked to end."""
        self.over = False
        """after shutdown."""
        super().__init__(name, **options)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = refusing(service.callback)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Compile, and begin the logs."""
        turn = Turn()
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
        if self.loop is None:
            return FAILURE
        with self.loop.turns:
            self.loop.activate(active)
        return SUCCESS

    def _leave(self) -> TransitionCallbackReturn:
        if self.loop is None:
            return SUCCESS
        self.left = Turn()
        self.loop.leave()
        return self.left.wait()


def refusing(transit: Transit) -> Transit:
    """As `transit`, but a transition that the present state has not is refused: rclpy raises, and
    whoever asked waits for an answer for ever."""

    def change(request: Any, answer: Any) -> Any:
        try:
            return transit(request, answer)
        except Exception:  # rclpy's own error types share no base class
            answer.success = False
            return answer

    return change


def simulate_managed(
    node: ManagedNode, asked: LiveSettings, stop: Interruption, began: float
) -> int:
    """Carry out the transitions until shutdown, a signal, or the end of the duration; the status.

    Raises RbSimError where a loop that runs cannot go on and is to end then.
    """
    presence, serving = Presence(node), Serving(node)
    services = Services(node, paused=asked.now.start_paused)
    presence.tell("unconfigured")
    node.get_logger().info("unconfigured: waits for the transition configure")
    stop.logging = True  # a signal ends the process in order, also where nothing runs
    serving.start()
    status, going = 0, True
    try:
        while going and not (node.over or stop.cause):
            serving.check()
            try:
                turn = node.configure.get(timeout=LOOK)
            except queue.Empty:
                continue
            before = _offered(node)
            status, going = _configured(node, asked, stop, began, presence, services, serving, turn)
            with services.turns.own():
                services.serve(None)
            node.loop = None
            _take_down(node, before)
            presence.tell("unconfigured")
            node.left.answer(True)
    finally:
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
    turn: Turn,
) -> tuple[int, bool]:
    """One loop, from configure to cleanup: the exit status, and whether another may follow."""
    presence.tell("compiling")
    logs, closing, settings = None, ExitStack(), asked.now
    try:
        logs = the_logs(node, settings)
        if logs is not None:
            closing.callback(logs.close)
        simulation = prepared(node, settings, presence, began)
        with services.turns.own():
            who = (presence, services, serving)
            loop = SimulationLoop(node, simulation, asked, logs, stop, *who, managed=True)
            closing.pop_all()
            closing.callback(loop.close)
            begin(node, loop, simulation, asked.now, logs, stop)
    except RbSimError as error:
        node.get_logger().error(f"not configured: {error}")
        closing.close()
        turn.answer(False)
        return 0, True
    node.loop = loop
    turn.answer(True)
    with closing:
        loop.run()
    return ended(node, loop, stop), loop.left


def _offered(node: ManagedNode) -> set[Any]:
    return {*node.publishers, *node.subscriptions, *node.services}


def _take_down(node: ManagedNode, before: set[Any]) -> None:
    """Destroy what was offered since."""
    for publisher in set(node.publishers) - before:
        node.destroy_publisher(publisher)
    for subscription in set(node.subscriptions) - before:
        node.destroy_subscription(subscription)
    for service in set(node.services) - before:
        node.destroy_service(service)
