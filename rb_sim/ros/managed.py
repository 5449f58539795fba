"""The node under a lifecycle manager: `managed:=true`, as ros2_control's and Nav2's nodes are.

configure compiles the scene, begins the logs and shows the initial state; activate lets time run,
deactivate stops it; cleanup finishes the logs and takes everything down, so that configure begins
anew; shutdown ends the process. A transition has a thread of its own (`lifecycle.Aside`), the main
thread carries out what is long, and the answer comes when that is done. Who serves ROS goes on, and
takes down what was offered: nothing is destroyed while it looks at what there is.
"""

from __future__ import annotations

import queue
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from rb_sim.errors import RbSimError
from rb_sim.ros.lifecycle import LOOK, ManagedNode, Turn
from rb_sim.ros.node import SimulationLoop
from rb_sim.ros.preparing import begin, described, ended, prepared, the_logs
from rb_sim.ros.services import Services
from rb_sim.ros.serving import Serving

if TYPE_CHECKING:
    from rb_sim.cli.signals import Interruption
    from rb_sim.ros.live_settings import LiveSettings
    from rb_sim.ros.presence import Presence


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
            before, node.left = _offered(node), Turn(node.ended)
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
