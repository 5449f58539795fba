# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How the run is going, once per wall second on /diagnostics."""

from __future__ import annotations

import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.time import Time

from rb_sim.base.diagnostic import Finding
from rb_sim.io.messages.topic_names import CLOCK
from rb_sim.ros.logs.process import LogProcess
from rb_sim.ros.pacing import Pacer, Priority
from rb_sim.ros.serving import offer
from rb_sim.ros.stepper import Stepper
from rb_sim.ros.topics.command import OVERTAKEN, Commands
from rb_sim.ros.topics.presence import twins
from rb_sim.ros.topics.topic_sink import CheckSink

PERIOD = 1.0
"""[s] of wall time."""
HARMLESS = ("commands received", "commands applied", f"commands {OVERTAKEN}")
"""Counters that may grow: a controller may well be faster than the samples."""


class Monitored(NamedTuple):
    """What diagnostics report on."""

    stepper: Stepper
    pacer: Pacer
    priority: Priority
    commands: Commands
    logs: LogProcess | None
    check_list: CheckSink


class Diagnostics:
    """Publishes a DiagnosticArray with one status; its values are counters and measurements."""

    def __init__(
        self, node: Node, scene_name: str, monitored: Monitored, *, publish_clock: bool = False
    ) -> None:
        """publish_clock: whether the node does, so that nobody else is to."""
        self._node, self._publish_clock = node, publish_clock
        self._scene_name = scene_name
        self._monitored = monitored
        self._publisher = offer(node, DiagnosticArray, "/diagnostics", 10)
        self._last = (time.monotonic(), monitored.stepper.t)
        self._reported: dict[str, int] = {}
        self._twins = self._clocks = 0
        self._found: tuple[Finding, ...] = ()
        self._state = ""

    def tick(self, state: str, failure: str, *, real_time_factor: float) -> None:
        """Publish if a period has passed, or at once where the state is another one.

        state: "running", "paused" or "error". failure: why, or "".
        """
        now = time.monotonic()
        wall_0, t_0 = self._last
        if now - wall_0 < PERIOD and state == self._state:
            return
        self._state = state
        t = self._monitored.stepper.t
        self._last = (now, t)
        self._notice_twins()
        self._notice_clocks()
        self._notice_findings()
        judged = self._judgement()
        if not self._publisher.get_subscription_count():
            return  # packing it takes half a millisecond
        measured = (t - t_0) / max(now - wall_0, 1e-9)
        values = self._values(t, state, real_time_factor, measured)
        self._publish(t, values, (DiagnosticStatus.ERROR, failure) if failure else judged)

    def _values(self, t: float, state: str, factor: float, measured: float) -> dict[str, str]:
        logs = self._monitored.logs
        return {
            "scene": self._scene_name,
            "state": state,
            "paused": str(state == "paused").lower(),
            "simulated time [s]": f"{t:.9f}",
            "samples": str(self._monitored.stepper.samples),
            "real-time factor, set": f"{factor:g}",
            "real-time factor, measured": f"{measured:.4g}",
            **({} if logs is None else {"log queue [samples]": str(logs.queued)}),
            "thread priority": str(self._monitored.priority),
            "behind the wall clock [s]": f"{self._monitored.pacer.slipped:.6f}",
            **self._step_values(),
            **{name: str(count) for name, count in self._counters().items()},
            **{f"warning, {finding.watch}": str(finding) for finding in self._found},
        }

    def _notice_twins(self) -> None:
        count = twins(self._node)
        if count > self._twins:
            name = self._node.get_fully_qualified_name()
            self._node.get_logger().warning(
                f"another node is called {name}: rename one (--ros-args -r __node:=NAME),"
                " or their messages are mixed"
            )
        self._twins = count

    def _notice_clocks(self) -> None:
        """Who else publishes the time that this node does."""
        if not self._publish_clock:
            return
        topic = self._node.resolve_topic_name(CLOCK)
        count = max(0, self._node.count_publishers(topic) - 1)
        if count > self._clocks:
            self._node.get_logger().warning(
                f"another node publishes {topic}: start all but one with publish_clock:=false,"
                " or the clock jumps for all that use it"
            )
        self._clocks = count

    def _notice_findings(self) -> None:
        """Say on the log, too, what a check has found since the last report."""
        found = self._monitored.check_list.look()
        for finding in found:
            if finding not in self._found:
                self._node.get_logger().warning(str(finding))
        self._found = found

    def _step_values(self) -> dict[str, str]:
        mean, longest = self._monitored.stepper.take_times()
        last = self._monitored.stepper.last
        values = {
            "step time, mean [us]": f"{mean * 1e6:.1f}",
            "step time, longest [us]": f"{longest * 1e6:.1f}",
        }
        if last is not None:
            values["constraint residual"] = f"{last.residual[-1]:.3g}"
            values["energy [J]"] = f"{last.energy[-1]:.12g}"
        return values

    def _counters(self) -> dict[str, int]:
        refused, logs = self._monitored.commands.refused, self._monitored.logs
        lost = {} if logs is None else logs.lost
        return {
            "overruns": self._monitored.pacer.overruns,
            "slips": self._monitored.pacer.slips,
            "commands received": self._monitored.commands.received,
            "commands applied": self._monitored.commands.applied,
            **{f"commands {reason}": refused[reason] for reason in sorted(refused)},
            **{f"log rows dropped, {name}": count for name, count in lost.items()},
            **dict(self._others()),
        }

    def _others(self) -> list[tuple[str, int]]:
        """Nodes that are in this one's way, now."""
        return [
            ("other nodes of this name", self._twins),
            ("other publishers of the clock", self._clocks),
        ]

    def _publish(self, t: float, values: dict[str, str], judged: tuple[bytes, str]) -> None:
        level, message = judged
        status = DiagnosticStatus(
            level=level,
            name=f"{self._node.get_fully_qualified_name().lstrip('/')}: simulation",
            message=message,
            hardware_id=self._scene_name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = Time(nanoseconds=round(t * 1e9)).to_msg()
        self._publisher.publish(array)

    def _judgement(self) -> tuple[bytes, str]:
        """Error: a log was lost. Warning: a counter of trouble grew since the last report, or a
        check has passed its bound since the last reset."""
        counters = self._counters()
        grown = [
            name
            for name, count in counters.items()
            if name not in HARMLESS and count > self._reported.get(name, 0)
        ]
        self._reported = counters
        lost = [] if self._monitored.logs is None else self._monitored.logs.failures
        if lost:
            return DiagnosticStatus.ERROR, f"no longer logged: {', '.join(lost)}"
        if new := grown or [name for name, count in self._others() if count]:
            return DiagnosticStatus.WARN, f"new: {', '.join(new)}"
        if self._found:
            return DiagnosticStatus.WARN, str(self._found[0])
        return DiagnosticStatus.OK, self._state
