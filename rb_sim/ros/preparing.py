# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Preparation of the loop from the parameters: logs, compilation, check for a twin node."""

from __future__ import annotations

import gc
import time
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import RbSimError
from rb_sim.io.messages.topic_names import body_topic
from rb_sim.ros import build_interfaces
from rb_sim.ros.log_process import LogProcess, Plan, unfinished
from rb_sim.ros.log_writer import TIME_FIELD, out_folder, own_folder
from rb_sim.ros.parameters import OF_TOPICS, warn_of_unknown
from rb_sim.ros.topics.presence import is_alone
from rb_sim.scene.listing import find_scene
from rb_sim.scene.load import load_scene
from rb_sim.simulation.simulation import compiled

if TYPE_CHECKING:
    from rclpy.node import Node

    from rb_sim.ros.node import SimulationLoop
    from rb_sim.ros.parameters import Settings
    from rb_sim.ros.topics.presence import Presence
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.signals import Interruption
    from rb_sim.simulation.simulation import Simulation

RECORDED = ("real_time_factor", "wrench_timeout", "publish_depth", "start_paused", "duration")
"""Settings stored in a bag in addition to its scene."""

LOG_CUT = 4
"""Exit status of a node whose run is complete but whose logs are not."""


def described(settings: Settings, presence: Presence) -> Scene:
    """The scene, loaded and published before compilation. Raises RbSimError."""
    if not settings.scene:
        raise RbSimError("parameter scene: '' is no scene file; give one: rb_sim_node SCENE")
    scene = load_scene(find_scene(settings.scene), **settings.overrides)
    presence.describe(scene)
    return scene


def prepared(
    node: Node, scene: Scene, discovery: float, began: float, stop: Interruption
) -> Simulation:
    """The compiled simulation, with interfaces built and no other node of this name in sight.

    Nothing is compiled later in the loop. discovery: see the parameter [s]. began: when the node
    was created (time.monotonic) [s]. Raises RbSimError, also if a signal noted by `stop` ends it.
    """
    logger = node.get_logger()

    def say(line: str) -> None:
        logger.info(line)

    def warn(line: str) -> None:
        logger.warning(line)

    say(f"compiles {scene.name}, and looks {discovery:g} s for another node of this name")
    builds = build_interfaces.begin()
    simulation = compiled(scene, say)
    build_interfaces.finish(builds, warn)
    alone = is_alone(node, began, discovery, lambda: stop.cause is not None)
    if stop.cause is not None:
        raise RbSimError(f"ended by {stop.cause.name} before the first sample")
    if not alone:
        name = node.get_fully_qualified_name()
        raise RbSimError(
            f"a node called {name} runs already: rename this one (--ros-args -r"
            " __node:=NAME) or use another ROS_DOMAIN_ID"
        )
    return simulation


def begin(
    node: Node,
    loop: SimulationLoop,
    simulation: Simulation,
    settings: Settings,
    logs: LogProcess | None,
    stop: Interruption,
) -> None:
    """Open the logs, create the topics, publish the initial state, and report it; from here on
    signals end the loop."""
    stop.logging = True
    if logs is not None:
        stop.left_over = lambda: unfinished(logs)
        logs.ending = lambda: stop.cause is not None
        logs.plan = logs.plan._replace(run=recorded(settings))  # may have changed meanwhile
        if TIME_FIELD in settings.out:
            logs.plan = logs.plan._replace(folder=own_folder(logs.plan.folder))
    loop.open()
    gc.collect()
    gc.freeze()  # a collection that looks at existing objects takes 0.1 s now and then
    loop.show()
    warn_of_unknown(node, lambda name: name.startswith(OF_TOPICS))
    announce(node, simulation, settings)


def ended(node: Node, loop: SimulationLoop, stop: Interruption) -> int:
    """Report the end of the run; returns the exit status."""
    cause = stop.cause.name if stop.cause else "left" if loop.left else "duration over"
    node.get_logger().info(f"stopped at t = {loop.t:.9g} s ({cause})")
    if loop.incomplete:
        node.get_logger().error(f"not complete: {', '.join(loop.incomplete)}")
    return 1 if loop.failure else LOG_CUT if loop.incomplete else 0


def the_logs(node: Node, settings: Settings) -> LogProcess | None:
    """Log process for bag, recording and plots by the parameters; None without logs."""
    if not settings.out or not (settings.log_bag or settings.log_rerun or settings.log_plots):
        return None
    plan = Plan(
        out_folder(settings.out, overwrite=settings.overwrite),
        settings.overwrite,
        node.get_fully_qualified_name(),
        settings.log_bag,
        settings.log_rerun,
        settings.log_plots,
        time.time_ns() if settings.wall_stamps else 0,
        recorded(settings),
        settings.split,
        settings.accelerations,
        settings.odometry,
    )

    def warn(line: str) -> None:
        node.get_logger().warning(line)

    return LogProcess(plan, settings.log_queue, warn)


def recorded(settings: Settings) -> dict[str, Any]:
    """Settings of the run that are stored in the bag."""
    return {"by": "node", **{name: getattr(settings, name) for name in RECORDED}}


def announce(node: Node, simulation: Simulation, settings: Settings) -> None:
    """Report the scene, its pace, and the bodies that take commands."""
    say = node.get_logger().info
    scene = simulation.scene
    pace = (
        f"{settings.real_time_factor:g} x real time" if settings.real_time_factor else "no pacing"
    )
    say(f"scene {scene.name}: {scene.simulation.rate:g} samples per second, {pace}")
    name = node.get_fully_qualified_name()
    topics = [f"{name}/{body_topic(body, 'wrench')}" for body in simulation.layout.commanded]
    say(f"takes commands on: {', '.join(topics) or 'nothing (no commanded_wrench in the scene)'}")
