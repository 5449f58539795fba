# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""rb_sim_node: the node for a scene. `rb_sim_node SCENE`, or by parameters: see --help.

Exit status: 0 after the duration, SIGINT, SIGTERM or SIGHUP; 1 if the motion could not continue; 2
if the node could not start (one line: scene, parameter, argument, folder); 4 if a log lacks a part
of the run (full disk, writer killed or hanging); 128 + the signal's number if interrupted before
the first sample, or again after a second.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import RbSimError, SimulationError

if TYPE_CHECKING:
    from rclpy.node import Node

    from rb_sim.ros.parameters import LiveSettings
    from rb_sim.ros.topics.presence import Presence
    from rb_sim.simulation.signals import Interruption

NODE_NAME = "rb_sim"
BAD_INPUT, FAILED = 2, 1
"""Exit statuses, those of the command line."""
NO_RCLPY = (
    "the node needs rclpy: source a ROS 2 Jazzy installation, or pip install 'rb_sim[ros]'"
    " (everything but the node runs without it)"
)
USAGE = """usage: rb_sim_node [SCENE] [--ros-args -p NAME:=VALUE ... --params-file FILE -r FROM:=TO]

Simulates SCENE, takes wrench commands, publishes pose, twist and reactions.
Parameters:
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of rb_sim_node. arguments: without the program's name; None: sys.argv."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before numpy, as in rb_sim.__main__
    try:
        return _main(arguments)
    except Exception:  # outdated packages raise various errors
        from rb_sim.base.installed import complaint

        if not (line := complaint()):
            raise
        print(line, file=sys.stderr, flush=True)
        return FAILED
    finally:
        from rb_sim.simulation.signals import deafen

        deafen()


def _main(arguments: Sequence[str] | None) -> int:
    from rb_sim.simulation.signals import Interruption

    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with Interruption():  # importing rclpy takes a while
            need_rclpy()
            own = _without_ros_arguments(given)
            if "-h" in own or "--help" in own:
                from rb_sim.ros.parameters import table

                print(USAGE + table(), flush=True)
                return 0
        stray = [word for i, word in enumerate(own) if i > 0 or word.startswith("-")]
        if stray:
            raise RbSimError(
                f"got {' '.join(stray)!r}; must be SCENE --ros-args -p NAME:=VALUE ...; "
                "see rb_sim_node --help"
            )
    except RbSimError as error:
        return _complain(error)
    return run_node(own[0] if own else None, ros_arguments=given)


def run_node(
    scene_path: str | Path | None = None, *, ros_arguments: Sequence[str] = (), **options: Any
) -> int:
    """Run the node until it ends; returns the exit status.

    scene_path: overrides the parameter `scene`. ros_arguments: with --ros-args. options: values of
    parameters by name (rb_sim.ros.parameters.Settings); None leaves the default.
    """
    from rb_sim.simulation.signals import Interruption

    if scene_path is not None:
        options["scene"] = str(scene_path)
    chosen = {k: v for k, v in options.items() if v is not None}
    try:
        with Interruption() as stop:
            need_rclpy()
            return _run(list(ros_arguments), chosen, stop)
    except RbSimError as error:
        return _complain(error)


def _run(ros_arguments: list[str], options: dict[str, Any], stop: Interruption) -> int:
    """Run the node and shut it down, under `stop`.

    ros2 launch sends a second SIGINT, which must not end in a traceback during shutdown.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import try_shutdown

    try:
        rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        node, managed = _make_node(options)
    except RbSimError:
        raise
    except Exception as error:  # rclpy's own error types share no base class
        raise _ros_error(error) from None
    try:
        stop.status = _simulate(node, ros_arguments, stop, managed=managed)
        return stop.status
    finally:
        node.destroy_node()
        try_shutdown()


def _without_ros_arguments(given: list[str]) -> list[str]:
    from rclpy.utilities import remove_ros_args

    try:
        return remove_ros_args(["rb_sim_node", *given])[1:]
    except Exception as error:  # as in _run
        raise _ros_error(error) from None


def _ros_error(error: Exception) -> RbSimError:
    """Error message of rcl without source locations."""
    text = re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split()))
    if (rule := re.search(r"parse parameter override rule: '(.*?)'", text)) is not None:
        return RbSimError(f"got {rule[1]!r}; must be -p NAME:=VALUE")
    return RbSimError(f"ROS refused to start: {text}")


def _make_node(options: dict[str, Any]) -> tuple[Node, bool]:
    """The node, and whether it is a lifecycle node."""
    from rclpy.parameter import Parameter

    from rb_sim.ros.topics.inbox import PollingNode

    overrides = [Parameter(name, value=value) for name, value in options.items()]
    node = PollingNode(NODE_NAME, parameter_overrides=overrides)
    # the kind of node is a parameter, and reading a parameter requires a node
    if not _asked_early(node, "managed", default=False):
        return node, False
    from rb_sim.ros.lifecycle import ManagedNode

    node.destroy_node()
    return ManagedNode(NODE_NAME, parameter_overrides=overrides), True


def _asked_early(node: Node, name: str, *, default: bool) -> bool:
    """Read a parameter before all are declared, which takes half a second and validates all."""
    from rcl_interfaces.msg import ParameterDescriptor

    value = node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value
    node.undeclare_parameter(name)
    return value if isinstance(value, bool) else default


def _simulate(node: Node, ros_arguments: list[str], stop: Interruption, *, managed: bool) -> int:
    """Run the node until its end; returns the exit status.

    Imports are delayed so that state, time, parameters and description are published before them.
    """
    from rb_sim.ros.topics.presence import Presence

    began = time.monotonic()
    presence = Presence(node, publish_clock=_asked_early(node, "publish_clock", default=True))
    presence.tell("unconfigured" if managed else "compiling")
    with ExitStack() as standing:
        standing.enter_context(presence.telling_time())
        from rb_sim.ros.parameters import LiveSettings, warn_of_other_nodes

        warn_of_other_nodes(node, ros_arguments)
        asked = LiveSettings(node)
        if managed:
            from rb_sim.ros.lifecycle import ManagedNode, simulate_managed

            standing.close()
            assert isinstance(node, ManagedNode)
            return simulate_managed(node, asked, stop, began, presence)
        return _simulate_now(node, asked, stop, began, presence, standing)


def _simulate_now(
    node: Node,
    asked: LiveSettings,
    stop: Interruption,
    began: float,
    presence: Presence,
    standing: ExitStack,
) -> int:
    """As `_simulate`, without a lifecycle. standing: keeps a clock at zero until closed."""
    from rb_sim.ros.services import Services
    from rb_sim.ros.serving import Serving

    services = Services(node, paused=asked.now.start_paused)
    with Serving(node) as serving, ExitStack() as closing:
        from rb_sim.ros.preparing import begin, described, ended, prepared, the_logs

        scene, logs = described(asked.now, presence), the_logs(node, asked.now)
        from rb_sim.ros.node import SimulationLoop

        simulation = prepared(node, scene, asked.now.discovery, began, stop)
        standing.close()
        with services.turns.own():
            loop = SimulationLoop(node, simulation, asked, logs, stop, presence, services, serving)
            closing.callback(loop.close)
            begin(node, loop, simulation, asked.now, logs, stop)
        loop.run()
    return ended(node, loop, stop)


def need_rclpy() -> None:
    """Raise RbSimError with instructions if rclpy is not installed."""
    try:
        import rclpy  # noqa: F401
    except ImportError:
        raise RbSimError(NO_RCLPY) from None


def _complain(error: RbSimError) -> int:
    print(f"rb_sim_node: {error}", file=sys.stderr)
    return FAILED if isinstance(error, SimulationError) else BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
