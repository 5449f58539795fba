# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node: one loop that paces and steps the simulation, while another thread serves ROS.

Trace of one sample: `SimulationLoop.run` -> `Pacer.wait` -> `Stepper.step` -> `Simulation.advance`
and back through the sinks (topics, bag, recording). Requests act between samples (`Turns`). Once
per wall-clock second /diagnostics reports the state of the run.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.time import Time

from rb_sim.base.errors import Finding, RbSimError, SimulationError
from rb_sim.io.messages.topic_names import CLOCK
from rb_sim.motion.motion import Limits
from rb_sim.ros.log_process import LogProcess
from rb_sim.ros.pacing import SLICE, Pacer, Priority
from rb_sim.ros.parameters import LiveSettings
from rb_sim.ros.services import Services, offer_services
from rb_sim.ros.serving import Serving, offer
from rb_sim.ros.stepper import Stepper
from rb_sim.ros.topics import command
from rb_sim.ros.topics.command import OVERTAKEN, Commands
from rb_sim.ros.topics.conventions import asked_for
from rb_sim.ros.topics.presence import Presence, twins
from rb_sim.ros.topics.topic_sink import CheckSink, TopicSink

if TYPE_CHECKING:
    from signal import Signals

    from rb_sim.accuracy.choice import Choice
    from rb_sim.ros.parameters import Settings
    from rb_sim.ros.topics.command import Commands
    from rb_sim.simulation.signals import Interruption
    from rb_sim.simulation.simulation import Simulation
    from rb_sim.simulation.state_override import Placement


PERIOD = 1.0
"""[s] of wall-clock time between reports."""
HARMLESS = ("commands received", "commands applied", f"commands {OVERTAKEN}")
"""Counters whose growth is normal: a controller may be faster than the samples."""


class Monitored(NamedTuple):
    """Sources of the diagnostics."""

    stepper: Stepper
    pacer: Pacer
    priority: Priority
    commands: Commands
    logs: LogProcess | None
    check_list: CheckSink


class Diagnostics:
    """Publishes a DiagnosticArray with one status that contains counters and measurements."""

    def __init__(
        self, node: Node, scene_name: str, monitored: Monitored, *, publish_clock: bool = False
    ) -> None:
        """publish_clock: whether the node does, so that other publishers are reported."""
        self._node, self._publish_clock = node, publish_clock
        self._scene_name = scene_name
        self._monitored = monitored
        self._publisher = offer(node, DiagnosticArray, "/diagnostics", 10)
        self._last = (time.monotonic(), monitored.stepper.t)
        self._reported: dict[str, int] = {}
        self._others = {"other nodes of this name": 0, "other publishers of the clock": 0}
        """numbers of other nodes that interfere with this one, by name of the counter."""
        self._found: tuple[Finding, ...] = ()
        self._state = ""

    def tick(self, state: str, failure: str, *, real_time_factor: float) -> None:
        """Publish once per period, and at once if the state changes.

        state: "running", "paused" or "error". failure: reason of an error, or "".
        """
        now = time.monotonic()
        wall_0, t_0 = self._last
        if now - wall_0 < PERIOD and state == self._state:
            return
        self._state = state
        t = self._monitored.stepper.t
        self._last = (now, t)
        self._notice_others()
        self._notice_findings()
        judged = self._judgement()
        if not self._publisher.get_subscription_count():
            return  # packing takes half a millisecond
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
            **{f"warning, {finding.check}": str(finding) for finding in self._found},
        }

    def _notice_others(self) -> None:
        """Warn about other nodes of this name, and other publishers of the clock."""
        name, topic = self._node.get_fully_qualified_name(), self._node.resolve_topic_name(CLOCK)
        clocks = self._node.count_publishers(topic) - 1 if self._publish_clock else 0
        advice = (
            f"another node is called {name}: rename one (--ros-args -r __node:=NAME),"
            " or their messages are mixed",
            f"another node publishes {topic}: start all but one with publish_clock:=false,"
            " or the clock jumps for all that use it",
        )
        before, counts = self._others, (twins(self._node), max(0, clocks))
        self._others = dict(zip(before, counts, strict=True))
        for line, old, new in zip(advice, before.values(), counts, strict=True):
            if new > old:
                self._node.get_logger().warning(line)

    def _notice_findings(self) -> None:
        """Log new findings of the checks."""
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
            **self._others,
        }

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
        """Level and message. Error: a log failed. Warning: a counter of problems grew since the
        last report, or a check failed since the last reset."""
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
        if new := grown or [name for name, count in self._others.items() if count]:
            return DiagnosticStatus.WARN, f"new: {', '.join(new)}"
        if self._found:
            return DiagnosticStatus.WARN, str(self._found[0])
        return DiagnosticStatus.OK, self._state


# Summary of the run, for the logs.


def summary_of(
    stepper: Stepper,
    commands: Commands,
    pacer: Pacer,
    check_list: CheckSink,
    choice: Choice | None,
    cause: Signals | None,
    failure: str,
    dropped: int,
) -> dict[str, object]:
    """The summary of the run, in JSON types.

    choice: of method and step, if one was made. cause: the signal that ended the run. failure: why
    the motion could not continue, or "". dropped: samples dropped because the log queue was full.
    """
    return {
        "choice": None if choice is None else choice.as_dict(),
        "samples": stepper.samples + 1,
        "steps": stepper.steps,
        "duration": stepper.t,
        "commands_applied": commands.applied,
        "commands_refused": dict(commands.refused),
        "overruns": pacer.overruns,
        "slips": pacer.slips,
        "samples_dropped": dropped,
        "stopped_by": cause.name if cause else None,
        "error": failure or None,
        "warnings": [finding.as_dict() for finding in check_list.look()],
    }


ENDING = "the node is ending"
REPORT_PERIOD = 0.02
"""[s] of wall-clock time between checks of logs and diagnostics while samples are due."""


class SimulationLoop:
    """Runs one simulation in a node until its duration is over or it is requested to stop."""

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        asked: LiveSettings,
        logs: LogProcess | None,
        stop: Interruption,
        presence: Presence,
        services: Services,
        serving: Serving,
        *,
        managed: bool = False,
    ) -> None:
        """To be created and opened in the same turn of `services`: requests wait meanwhile.

        serving: the thread that serves ROS, before and after this loop too.
        """
        self.turns = services.turns
        """lock shared by the requests and the loop."""
        self.paused = services.paused
        self.failure = ""
        """why the motion cannot continue, until a reset; else ""."""
        self.inactive = managed
        """whether the lifecycle state keeps it from running."""
        self.left = False
        """whether `leave` was called."""
        self._closed = False
        self._fatal: SimulationError | None = None
        asked.watch(self._change)
        self._asked, self._settings = asked, (settings := asked.now)
        self._node, self._simulation, self._stop = node, simulation, stop
        self._presence, self._services, self._serving = presence, services, serving
        self._pacer = Pacer(settings.real_time_factor, settings.overrun)
        self._logs, self._priority = logs, Priority(settings.thread_priority)
        self._topics = TopicSink(
            node, settings.publish_depth, settings.skipped, settings.frame_prefix
        )
        extras = asked_for(node, settings)
        found = (getattr(sink, "latest", None) for sink in (self._topics, *extras))
        self._latest = [latest for latest in found if latest is not None]
        self._check_list = CheckSink(simulation)
        self._sinks = [self._topics, *extras, *([logs] if logs else []), self._check_list]
        self.commands = command.Commands(node, simulation.layout.commanded, settings.frame_prefix)
        rate = simulation.scene.simulation.rate
        self._stepper = Stepper(simulation, self.commands, self._sinks, rate)
        self._stepper.watch, self._reported = self._look, 0.0
        who = (self._stepper, self._pacer, self._priority, self.commands, logs, self._check_list)
        self._diagnostics = Diagnostics(
            node, simulation.scene.name, Monitored(*who), publish_clock=settings.publish_clock
        )
        offer_services(node, self, simulation, self._stepper, may_quit=not managed)
        self._bound()

    @property
    def t(self) -> float:
        """Stamp of the last sample [s]."""
        return self._stepper.t

    @property
    def incomplete(self) -> list[str]:
        """Paths of the incomplete logs, after `close`."""
        return [] if self._logs is None else self._logs.incomplete

    def open(self) -> None:
        """Start the logs and create the topics. Raises SinkError if a log cannot be started."""
        for sink in self._sinks:
            sink.open(self._simulation.scene, self._simulation.layout)

    def show(self) -> None:
        """Publish the initial state; from here on requests are accepted."""
        self._stepper.emit()
        self._tell_state()
        self._services.serve(self)

    def run(self) -> None:
        """Step until the end.

        If the motion cannot continue, the node reports it and waits for ~/reset or a signal; it
        raises SimulationError if it is to end then.
        """
        with self.turns.own():
            self._begin_to_pace()
        if self._priority.refusal:
            self._node.get_logger().info(self._priority.refusal)
        while not (self._stop.cause or self.left or self._is_over()):
            if self._fatal is not None:
                raise self._fatal
            if self._stands:
                time.sleep(SLICE)
                with self.turns.own():
                    self._tick()
                    self._topics.repeat_clock()
            elif self._pacer.wait(due := self._stepper.t_next, self._stepper.period, self._between):
                with self.turns.own():
                    if not self._stands and self._stepper.t_next == due:
                        self._step()  # unless a request made that sample
                self._rest()

    def close(self) -> None:
        """Finish the logs, which contain all samples so far. Requests are refused from here on.

        After a signal (also during this call) or `leave`, plots are left to the log process.
        """
        with self.turns.own():
            self._closed = True
            self._keep_to_the_clock()
            self._stepper.rewind()
        self._asked.watch(None)
        self.commands.close()
        for sink in [one for one in self._sinks if one is not self._logs]:
            sink.close()
        if self._logs is not None:
            who = (self._stepper, self.commands, self._pacer, self._check_list)
            of_end = self._simulation.choice, self._stop.cause, self.failure, self._logs.dropped
            summary = summary_of(*who, *of_end)
            self._logs.close(summary, patient=lambda: not (self._stop.cause or self.left))

    def pause(self, paused: bool) -> None:
        """Pause or continue; pacing restarts. Raises RbSimError if the node is ending."""
        self._refuse_if_ending()
        if paused != self.paused:
            self.paused = paused
            self._begin_to_pace()

    def activate(self, active: bool) -> None:
        """Allow the simulation to run (unless paused), or stop it."""
        if self.inactive == active:
            self.inactive = not active
            self._begin_to_pace()

    def leave(self) -> None:
        """Make `run` return."""
        self.left = True

    def reset(self) -> None:
        """Make the initial state the next sample, when due. Raises RbSimError while ending."""
        self._wait_for_next()
        self._stepper.reset()
        self._check_list.reset()
        if self.failure:
            self._node.get_logger().info("reset after an error: the simulation continues")
            self._pacer.restart(self.t, self._settings.real_time_factor)
        self.failure = ""

    def set_state(self, bodies: dict[str, Placement], *, project: bool) -> None:
        """Make this state the next sample, when due. Raises RbSimError if impossible."""
        self._wait_for_next()
        self._stepper.set_state(bodies, project=project)
        self._check_list.reset()

    def step_once(self) -> None:
        """Advance one sample period at once. Raises RbSimError if the motion cannot continue, or
        the node is ending."""
        if self._is_over():
            raise RbSimError(f"the duration of {self._settings.duration:g} s is over")
        self._refuse_if_ending()
        before = self._stepper.samples
        self._report_now_and_then()
        if not self.failure:
            self._step()
        if self.failure:
            raise RbSimError(self.failure)
        if self._stepper.samples == before:
            raise RbSimError(ENDING)

    def _wait_for_next(self) -> None:
        """Wait until the next sample is due, so that requests for a sample keep the pace.

        Raises RbSimError if the node is ending."""
        self._refuse_if_ending()
        while not self._stands and (left := self._pacer.left(self._stepper.t_next)) > 0.0:
            time.sleep(min(left, SLICE))
            self._refuse_if_ending()
            self._report_now_and_then()

    def _refuse_if_ending(self) -> None:
        if self._closed or self._stop.cause or self.left:
            raise RbSimError(ENDING)

    def _step(self) -> None:
        """Advance one sample period; an error of the motion is reported and stored in `failure`."""
        try:
            self._stepper.step(self._settings.wrench_timeout)
        except SimulationError as error:
            words = f"{error}{self._stepper.origin}; commands in force: {self.commands.in_force()}"
            self.failure = f"stopped at t = {self.t:.9g} s: {words}"
            if self._settings.exit_on_error:
                self._fatal = error  # raised by `run`, also if a request caused the sample
            else:
                self._node.get_logger().error(f"{self.failure}; ~/reset goes back to the start")

    def _look(self, _: float) -> bool:
        """Called while a sample takes long: publishes diagnostics, checks for signals."""
        self.commands.collect()
        self._report()
        return self._stop.cause is None

    def _bound(self) -> None:
        of = self._settings
        self.commands.limits = command.Limits(of.max_force, of.max_torque)
        self._stepper.limits = Limits(of.max_sample_steps, of.max_sample_time)

    def _begin_to_pace(self) -> None:
        """Restart pacing at the present time, if time runs."""
        self._stepper.rewind()
        self._keep_to_the_clock()
        self._pacer.restart(self.t, self._settings.real_time_factor)

    def _keep_to_the_clock(self) -> None:
        """Set queue mode and thread priority.

        Only if paced by the wall clock, a full queue drops samples and the threads have real-time
        priority, the latter only while the loop keeps up: otherwise it would starve other processes
        in vain."""
        stands = self.paused or self.inactive or self._closed
        waits = stands or self._settings.real_time_factor == 0.0
        self._priority.raised(not waits and self._pacer.keeps_up)
        if self._logs is not None:
            self._logs.blocking = waits

    def _is_over(self) -> bool:
        return self._stepper.is_over(self._settings.duration)

    def _rest(self) -> None:
        """Do one background task between samples, after subscribers took the last one."""
        if (ahead := self._stepper.ahead.is_due) or self._is_time_to_report:
            self._pacer.give_way(self._stepper.t_next)
            with self.turns.own():
                if ahead and not self._stands:
                    self._stepper.look_ahead()
                else:
                    self._report_now_and_then()

    def _between(self) -> bool:
        """Update logs and diagnostics if due. False: stop waiting for the sample."""
        with self.turns.own():
            self._report_now_and_then()
        return not (self._stands or self.left or self._stop.cause)

    @property
    def _is_time_to_report(self) -> bool:
        return time.monotonic() - self._reported >= REPORT_PERIOD

    def _report_now_and_then(self) -> None:
        """Call `_tick` once per REPORT_PERIOD."""
        if self._is_time_to_report:
            self._reported = time.monotonic()
            self._tick()

    @property
    def _stands(self) -> bool:
        """Whether no samples are due."""
        return self.paused or self.inactive or bool(self.failure)

    def _tick(self) -> None:
        self._serving.check()
        self._keep_to_the_clock()
        self.commands.collect()
        for latest in self._latest:
            latest.tick(stands=self._stands)
        if self._logs is None or not self._logs.tick():  # not both between two samples
            self._report()

    @property
    def _state(self) -> str:
        if self.failure:
            return "error"
        return "inactive" if self.inactive else "paused" if self.paused else "running"

    def _tell_state(self) -> None:
        """Publish and record the state if it changed."""
        self._presence.tell(self._state)
        if self._logs is not None:
            self._logs.note_state(self._state)

    def _report(self) -> None:
        self._tell_state()
        factor = self._settings.real_time_factor
        self._diagnostics.tick(self._state, self.failure, real_time_factor=factor)

    def _change(self, settings: Settings) -> None:
        with self.turns:
            if settings.real_time_factor != self._settings.real_time_factor:
                self._pacer.restart(self.t, settings.real_time_factor)
            self._settings = settings
            self._bound()
            self._keep_to_the_clock()
