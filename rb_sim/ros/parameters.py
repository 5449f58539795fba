# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node's parameters: one field each, with description, range, and whether it is live."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rcl_interfaces.msg import SetParametersResult as Result
from rclpy.node import Node
from rclpy.parameter import Parameter

from rb_sim.base.errors import RbSimError
from rb_sim.io.bag.bag_sink import LEAST_SPLIT
from rb_sim.io.messages.topic_names import CLOCK, TF
from rb_sim.ros.pacing import OVERRUN
from rb_sim.scene.schema import METHODS

OF_TOPICS = "qos_overrides."
"""Prefix of the QoS parameters that ROS declares for each topic when the topic is created."""
DISCOVERY = 3.5
"""[s] allowed for DDS to find other nodes of the same name; measured: 0.2 to 2.7."""


def setting(
    default: Any,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: Sequence[str] = (),
    live: bool = False,
) -> Any:
    """A field of Settings: closed range [low, high] or choices; live: may change at run time."""
    about = {"description": description, "low": low, "high": high, "choices": choices, "live": live}
    return field(default=default, metadata=about)


@dataclass(frozen=True)
class Settings:
    """Values of the node's parameters."""

    scene: str = setting("", "scene file, or the name of a shipped one (rb_sim scenes)")
    out: str = setting(
        "",
        "new folder for bag, recording and plots; {time} in its name becomes the start"
        " time; empty: no logs",
    )
    overwrite: bool = setting(False, "replace logs that are in OUT already")
    log_bag: bool = setting(True, "write OUT/bag")
    log_rerun: bool = setting(True, "write OUT/recording.rrd")
    log_plots: bool = setting(True, "write OUT/plots.png at the end")
    duration: float = setting(
        0.0, "simulated time after which the node ends [s]; 0: runs until stopped", low=0, high=1e9
    )
    rate: float = setting(
        0.0,
        "samples, commands taken and messages per simulated second [Hz]; 0: as in the scene",
        low=0,
        high=1e5,
    )
    real_time_factor: float = setting(
        1.0,
        "simulated seconds per wall second; 0: as fast as possible",
        low=0,
        high=1e4,
        live=True,
    )
    overrun: str = setting(
        "catch_up",
        "after a late sample: catch_up runs faster, slip lets simulated time fall behind",
        choices=OVERRUN,
    )
    thread_priority: int = setting(
        50,
        "real-time priority (SCHED_FIFO) of the node's threads in real time, if the system"
        " permits it; 0: none",
        low=0,
        high=99,
    )
    method: str = setting("", "integration method; empty: as in the scene", choices=("", *METHODS))
    step: float = setting(0.0, "fixed step [s]; 0: as in the scene", low=0, high=10)
    tolerance: float = setting(
        0.0, "tolerance of the adaptive method; 0: as in the scene", low=0, high=1
    )
    wrench_timeout: float = setting(
        0.0,
        "simulated time after which a commanded wrench becomes zero [s]; 0: never",
        low=0,
        high=1e9,
        live=True,
    )
    max_force: float = setting(
        0.0, "largest force accepted in a command [N]; 0: no limit", low=0, high=1e300, live=True
    )
    max_torque: float = setting(
        0.0, "largest torque accepted in a command [N m]; 0: no limit", low=0, high=1e300, live=True
    )
    max_sample_steps: int = setting(
        1_000_000,
        "largest number of integration steps between two samples; more is an error",
        low=1,
        high=1_000_000_000_000,
        live=True,
    )
    max_sample_time: float = setting(
        10.0,
        "largest wall-clock time between two samples [s]; more is an error",
        low=1e-3,
        high=1e9,
        live=True,
    )
    exit_on_error: bool = setting(
        False, "end when the motion cannot go on, instead of waiting for ~/reset"
    )
    wall_stamps: bool = setting(
        False, "log times of the bag in wall-clock time instead of simulated time"
    )
    split_size: int = setting(
        0,
        f"file size after which a new bag file starts [bytes], at least {LEAST_SPLIT}; 0: never",
        low=0,
        high=1_000_000_000_000_000,
    )
    split_duration: float = setting(
        0.0, "time after which a new bag file starts [s]; 0: never", low=0, high=1e9
    )
    log_queue: int = setting(
        20_000,
        "largest number of samples queued for the logs; if full, a run in real time drops and"
        " counts samples, any other run waits",
        low=1,
        high=10_000_000,
    )
    publish_depth: int = setting(
        10, "messages kept per topic for slow subscribers", low=1, high=10_000
    )
    publish_clock: bool = setting(
        True, "publish /clock; with several nodes in a domain, true for one of them only"
    )
    tf: bool = setting(True, "publish /tf, if tf2_msgs is installed")
    frame_prefix: str = setting(
        "", "prefix of all frame names, published and received, such as 'robot1/'"
    )
    odometry: bool = setting(False, "publish BODY/odometry (nav_msgs/Odometry)")
    joint_states: bool = setting(
        False, "publish joint_states (sensor_msgs/JointState) of axes and linear guides"
    )
    accelerations: bool = setting(
        False,
        "publish BODY/accel (geometry_msgs/AccelStamped), the rate of BODY/twist; the bag"
        " has it, too",
    )
    imu: str = setting(
        "",
        "publish BODY/imu (sensor_msgs/Imu) of a sensor at a body's origin, or at a point of it:"
        " 'BODY', 'BODY X Y Z', several with ';' in between",
    )
    markers: bool = setting(
        False, "publish markers (visualization_msgs/MarkerArray) of the shapes, latched"
    )
    robot_description: bool = setting(
        False, "publish robot_description (URDF written from the scene), latched"
    )
    discovery: float = setting(
        DISCOVERY,
        "wall-clock time in which to look for another node of the same name at the start [s]",
        low=0,
        high=60,
    )
    start_paused: bool = setting(False, "start paused: wait for ~/pause false or ~/step")
    managed: bool = setting(
        False, "a lifecycle node: compiles, runs and ends by the transitions of ~/change_state"
    )

    @property
    def skipped(self) -> tuple[str, ...]:
        """Topics that are not published; they are in the bag anyway."""
        wanted = {CLOCK: self.publish_clock, TF: self.tf}
        return tuple(topic for topic, there in wanted.items() if not there)

    @property
    def split(self) -> dict[str, float | None]:
        """Limits at which the bag is split, as in BagSink. Raises RbSimError if too small."""
        if 0 < self.split_size < LEAST_SPLIT:
            raise RbSimError(
                f"parameter split_size: got {self.split_size}; must be 0 (never) or at least"
                f" {LEAST_SPLIT} bytes"
            )
        return {
            "split_size": self.split_size or None,
            "split_duration": self.split_duration or None,
        }

    @property
    def overrides(self) -> dict[str, Any]:
        """Changes of the scene's simulation options for load_scene."""
        given = {name: getattr(self, name) for name in ("duration", "rate", "step", "tolerance")}
        overrides = {name: value for name, value in given.items() if value > 0}
        return overrides | ({"method": self.method} if self.method else {})


def refusal(name: str, value: Any) -> str | None:
    """Why this value is not allowed, in one line; None if it is allowed."""
    matching = [f for f in fields(Settings) if f.name == name]
    if not matching:
        return None  # a parameter of ROS (use_sim_time etc.)
    (known,) = matching
    if isinstance(known.default, float) and isinstance(value, int) and not isinstance(value, bool):
        value = float(value)
    if type(value) is not type(known.default):
        return f"{name}: got {value!r}; must be of type {type(known.default).__name__}"
    about = known.metadata
    if about["low"] is not None and not about["low"] <= value <= about["high"]:  # refuses NaN too
        return f"{name}: got {value!r}; must be within [{about['low']:g}, {about['high']:g}]"
    if about["choices"] and value not in about["choices"]:
        allowed = ", ".join(choice for choice in about["choices"] if choice)
        return f"{name}: got {value!r}; must be one of {allowed}"
    if name == "frame_prefix" and str(value).startswith("/"):
        return f"{name}: got {value!r}; must not begin with a slash (tf2 has no such frames)"
    return None


def declare(node: Node) -> Settings:
    """Declare all parameters on the node. Raises RbSimError if a start value is not allowed."""
    values: dict[str, Any] = {}
    for known in fields(Settings):
        # first without type and range, since rclpy's own error messages are unclear
        anything = ParameterDescriptor(dynamic_typing=True)
        value = node.declare_parameter(known.name, known.default, anything).value
        reason = refusal(known.name, value)
        if reason:
            raise RbSimError(f"parameter {reason}")
        node.set_descriptor(known.name, _descriptor(known))
        values[known.name] = type(known.default)(value)
    warn_of_unknown(node, lambda name: not name.startswith(OF_TOPICS))
    return Settings(**values)


def warn_of_unknown(node: Node, those: Callable[[str], bool]) -> None:
    """Warn about given parameters that the node does not have, among names selected by `those`."""
    given = node._parameter_overrides  # no public attribute in rclpy
    unknown = [name for name in given if those(name) and not node.has_parameter(name)]
    known = [field.name for field in fields(Settings)]
    words = []
    for name in sorted(unknown):
        near = get_close_matches(name, known, 1)
        words.append(f"{name} (did you mean {near[0]}?)" if near else name)
    if words:
        node.get_logger().warning(
            f"unknown parameters: {', '.join(words)}; rb_sim_node --help lists all"
        )


def warn_of_other_nodes(node: Node, arguments: Sequence[str]) -> None:
    """Warn about parameter files and `-p NODE:NAME:=VALUE` that set nothing of this node."""
    own = node.get_fully_qualified_name()
    for option, value in pairwise(arguments):
        if option in ("-p", "--param"):
            name = value.partition(":=")[0]
            source, named = f"-p {name}", [name.rpartition(":")[0] or "/**"]
        elif option == "--params-file":
            document = yaml.safe_load(Path(value).read_text(encoding="utf-8"))
            source, named = value, list(_nodes_of(document))
        else:
            continue
        if named and not any(_is_meant(own, pattern) for pattern in named):
            node.get_logger().warning(
                f"{source}: sets parameters of {', '.join(named)}, none of {own}"
            )


def _nodes_of(document: Any, above: str = "") -> Iterator[str]:
    """Names of the nodes in a parameter file, namespaces included."""
    for name, inner in document.items() if isinstance(document, dict) else ():
        if name == "ros__parameters":
            yield above
        else:
            yield from _nodes_of(inner, f"{above}/{str(name).strip('/')}")


def _is_meant(node: str, pattern: str) -> bool:
    """Whether a name with wildcards (* one part, ** any number) means the node."""
    parts = f"/{pattern.lstrip('/')}".split("/")[1:]
    wild = {"**": "(/[^/]+)*", "*": "/[^/]+"}
    return re.fullmatch("".join(wild.get(p, "/" + re.escape(p)) for p in parts), node) is not None


def _descriptor(known: Any) -> ParameterDescriptor:
    about = known.metadata
    descriptor = ParameterDescriptor(
        description=about["description"],
        type=Parameter.Type.from_parameter_value(known.default).value,
        read_only=not about["live"],
        # `-p duration:=5` is an integer in ROS; accept it for floating-point parameters
        dynamic_typing=isinstance(known.default, float),
        additional_constraints=" | ".join(choice for choice in about["choices"] if choice),
    )
    if about["low"] is None:
        return descriptor
    if isinstance(known.default, float):
        limits = FloatingPointRange(from_value=float(about["low"]), to_value=float(about["high"]))
        descriptor.floating_point_range = [limits]
    else:
        descriptor.integer_range = [IntegerRange(from_value=about["low"], to_value=about["high"])]
    return descriptor


def table() -> str:
    """Help text with one line per parameter."""
    width = max(len(known.name) for known in fields(Settings))
    return "\n".join(
        f"  {known.name:{width}}  {known.metadata['description']} (default {known.default!r})"
        for known in fields(Settings)
    )


# Parameters of a running node, some of which may change from their declaration on.
#
# Also during compilation and while a lifecycle node is unconfigured: changes accepted then apply
# to the next run.


class LiveSettings:
    """Declares the parameters, and accepts or refuses changes.

    Raises RbSimError if a start value is not allowed.
    """

    def __init__(self, node: Node) -> None:
        self.now = declare(node)
        """the present values."""
        self._node = node
        self._changed: Callable[[Settings], None] | None = None
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._accept)

    def watch(self, changed: Callable[[Settings], None] | None) -> None:
        """Call changed(settings) after every change from now on; None: no call.

        Call this before reading `now`, so that no change in between is missed.
        """
        self._changed = changed

    def _check(self, parameters: list[Parameter]) -> Result:
        reasons = [refusal(parameter.name, parameter.value) for parameter in parameters]
        reason = next((reason for reason in reasons if reason), "")
        if reason:
            self._node.get_logger().warning(f"parameter refused: {reason}")
        return Result(successful=not reason, reason=reason)

    def _accept(self, parameters: list[Parameter]) -> None:
        kinds = {known.name: type(known.default) for known in fields(Settings)}
        news: dict[str, Any] = {
            p.name: kinds[p.name](p.value or 0) for p in parameters if p.name in kinds
        }
        if news:  # only live parameters get here, and all are numbers
            self.now = replace(self.now, **news)
            if (changed := self._changed) is not None:
                changed(self.now)
