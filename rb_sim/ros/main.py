"""rb_sim_node: the node on a scene. `rb_sim_node SCENE`, or by parameters: see --help.

Exit status: 0 after the duration, SIGINT, SIGTERM or SIGHUP; 1 after an error, said in one line,
and where the motion could not go on when it was ended; 128 + the signal's number when interrupted
before the first sample, or a second time.
"""

from __future__ import annotations

import gc
import re
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.errors import RbSimError

if TYPE_CHECKING:
    from rclpy.node import Node

    from rb_sim.cli.signals import Interruption
    from rb_sim.ros.log_process import LogProcess
    from rb_sim.ros.parameters import Settings
    from rb_sim.ros.presence import Presence
    from rb_sim.simulation import Simulation

NODE_NAME = "rb_sim"
DISCOVERY = 3.5
"""[s] that DDS is given to find other nodes of the same name; it took 0.2 to 2.7 here."""
TIME_FIELD = "{time}"
RECORDED = ("real_time_factor", "wrench_timeout", "publish_depth", "start_paused", "duration")
"""Settings that a bag carries beside its scene."""
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
    given = list(sys.argv[1:] if arguments is None else arguments)
    try:
        need_rclpy()
        own = _without_ros_arguments(given)
        if "-h" in own or "--help" in own:
            from rb_sim.ros.parameters import table

            print(USAGE + table(), flush=True)
            return 0
        stray = [word for i, word in enumerate(own) if i > 0 or word.startswith("-")]
        if stray:
            raise RbSimError(
                f"got {' '.join(stray)!r}; must be SCENE, then --ros-args; see rb_sim_node --help"
            )
    except RbSimError as error:
        return _complain(error)
    return run_node(own[0] if own else None, ros_arguments=given)


def run_node(
    scene_path: str | Path | None = None, *, ros_arguments: Sequence[str] = (), **options: Any
) -> int:
    """Run the node until it ends; the exit status.

    scene_path: overrides the parameter `scene`. ros_arguments: with --ros-args. options: values of
    parameters by name (rb_sim.ros.parameters.Settings); None leaves the default.
    """
    if scene_path is not None:
        options["scene"] = str(scene_path)
    try:
        need_rclpy()
        return _run(list(ros_arguments), {k: v for k, v in options.items() if v is not None})
    except RbSimError as error:
        return _complain(error)


def _run(ros_arguments: list[str], options: dict[str, Any]) -> int:
    import rclpy
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import try_shutdown

    from rb_sim.cli.signals import Interruption

    try:
        rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = _make_node(options)
    except RbSimError:
        raise
    except Exception as error:  # rclpy's own error types share no base class
        raise _ros_error(error) from None
    try:
        with Interruption() as stop:
            return _simulate(node, stop)
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
    """What rcl says, without the places in its sources."""
    text = re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split()))
    return RbSimError(f"ROS refused to start: {text}")


def _make_node(options: dict[str, Any]) -> Node:
    from rclpy.node import Node
    from rclpy.parameter import Parameter

    overrides = [Parameter(name, value=value) for name, value in options.items()]
    return Node(NODE_NAME, parameter_overrides=overrides)


def _simulate(node: Node, stop: Interruption) -> int:
    from rb_sim.ros import interfaces, parameters
    from rb_sim.ros.log_process import unfinished
    from rb_sim.ros.node import SimulationLoop, announce, is_alone
    from rb_sim.ros.presence import Presence
    from rb_sim.ros.services import Services

    began = time.monotonic()
    settings = parameters.declare(node)
    logs = _logs(node, settings)  # first, since a folder that will not do is told at once

    def warn(line: str) -> None:
        node.get_logger().warning(line)

    presence = Presence(node)
    presence.tell("compiling")
    services = Services(node, paused=settings.start_paused)
    builds = interfaces.begin()
    with presence.answering(publish_clock=settings.publish_clock):
        simulation = _compiled(node, settings, presence)
        interfaces.finish(builds, warn)
        if not is_alone(node, began, DISCOVERY):
            name = node.get_fully_qualified_name()
            raise RbSimError(
                f"a node called {name} runs already: rename this one (--ros-args -r"
                " __node:=NAME) or use another ROS_DOMAIN_ID"
            )
    loop = SimulationLoop(node, simulation, settings, logs, stop, presence, services)
    stop.logging = True
    if logs is not None:
        stop.left_over = lambda: unfinished(logs)
    try:
        loop.open()
        settle_memory()
        announce(node, simulation, settings)
        loop.run()
    finally:
        loop.close()
    cause = stop.cause.name if stop.cause else "duration over"
    node.get_logger().info(f"stopped at t = {loop.t:.9g} s ({cause})")
    return 1 if loop.failure else 0


def settle_memory() -> None:
    """Take what there is out of garbage collection: going through it takes 0.1 s now and then."""
    gc.collect()
    gc.freeze()


def _compiled(node: Node, settings: Settings, presence: Presence) -> Simulation:
    """The simulation, ready to step: nothing compiles inside the loop."""
    if not settings.scene:
        raise RbSimError("parameter scene: '' is no scene file; give one: rb_sim_node SCENE")
    from rb_sim.cli.compiling import compiled
    from rb_sim.scene.listing import find_scene
    from rb_sim.scene.load import load_scene

    scene = load_scene(find_scene(settings.scene), **settings.overrides)

    presence.describe(scene)

    def say(line: str) -> None:
        node.get_logger().info(line)

    return compiled(scene, say)


def _logs(node: Node, settings: Settings) -> LogProcess | None:
    """Bag, recording and plots, as the parameters say."""
    from rb_sim.ros.log_process import LogProcess
    from rb_sim.ros.log_writer import Plan

    if not settings.out or not (settings.log_bag or settings.log_rerun or settings.log_plots):
        return None
    plan = Plan(
        out_folder(settings.out, settings.overwrite),
        node.get_fully_qualified_name(),
        settings.log_bag,
        settings.log_rerun,
        settings.log_plots,
        time.time_ns() if settings.wall_stamps else 0,
        {"by": "node", **{name: getattr(settings, name) for name in RECORDED}},
        settings.accelerations,
    )

    def warn(line: str) -> None:
        node.get_logger().warning(line)

    return LogProcess(plan, settings.log_queue, warn)


def out_folder(out: str, overwrite: bool) -> Path:
    """The folder for the logs. RbSimError: there are some in it, and they are not to be replaced.

    {time} in its name becomes the date and time; where that exists too, a number is added.
    """
    from rb_sim.ros.log_process import folder_logs

    if TIME_FIELD in out:
        named = out.replace(TIME_FIELD, time.strftime("%Y_%m_%d-%H_%M_%S"))
        folders = (Path(named if not k else f"{named}-{k + 1}") for k in range(1000))
        return next((f for f in folders if not folder_logs(f)), Path(named))
    folder = Path(out)
    there = folder_logs(folder)
    if there and not overwrite:
        raise RbSimError(
            f"parameter out: {folder} has {', '.join(there)} already: name another folder, put"
            f" {TIME_FIELD} in its name, or insist with overwrite:=true"
        )
    return folder


def need_rclpy() -> None:
    """Raise RbSimError, which says what to install, where rclpy is not."""
    try:
        import rclpy  # noqa: F401
    except ImportError:
        raise RbSimError(NO_RCLPY) from None


def _complain(error: RbSimError) -> int:
    print(f"rb_sim_node: {error}", file=sys.stderr)
    return 1


if __name__ == "__main__":
    sys.exit(main())
