# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the checks find is on /diagnostics and in the log, until a reset; without a process."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from rb_sim.ros.node import Diagnostics, Monitored
from rb_sim.ros.pacing import Pacer, Priority
from rb_sim.ros.topics.topic_sink import BATCH, CheckSink
from rb_sim.scene.load import scene_from_mapping
from rb_sim.simulation.simulation import Simulation
from tests.accuracy.checks.test_check_list import TOP


class FakeNode:
    """Keeps what a node would publish and say."""

    def __init__(self) -> None:
        self.published: list[DiagnosticArray] = []
        self.said: list[str] = []
        self.listeners = self.clocks = 1

    def create_publisher(self, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(
            publish=self.published.append, get_subscription_count=lambda: self.listeners
        )

    def get_logger(self) -> Any:
        return SimpleNamespace(warning=self.said.append)

    def resolve_topic_name(self, name: str) -> str:
        return f"/remapped{name}"

    def count_publishers(self, topic: str) -> int:
        assert topic == "/remapped/clock"
        return self.clocks

    def get_name(self) -> str:
        return "rb_sim"

    def get_namespace(self) -> str:
        return "/"

    def get_fully_qualified_name(self) -> str:
        return "/rb_sim"

    def get_node_names_and_namespaces(self) -> list[tuple[str, str]]:
        return [("rb_sim", "/")]


def simulation_of(**options: Any) -> Simulation:
    return Simulation(scene_from_mapping(TOP | {"simulation": TOP["simulation"] | options}))


def fed(check_list: CheckSink, simulation: Simulation, duration: float) -> None:
    """One sample at a time, as the node does."""
    for _ in range(round(duration * 500)):
        simulation.advance(1.0 / 500)
        check_list.write_row(simulation.sample_row())


def told_of() -> tuple[Any, FakeNode, CheckSink, Diagnostics]:
    """A simulation that blows up, the node that tells of it, what watches it and what reports."""
    simulation, node = simulation_of(method="euler", step=1e-3, tolerance=None), FakeNode()
    check_list = CheckSink(simulation)
    stepper = SimpleNamespace(t=0.3, samples=150, last=None, take_times=lambda: (0.0, 0.0))
    commands = SimpleNamespace(refused={}, applied=0, received=0)
    monitored: Any = Monitored(stepper, Pacer(1.0), Priority(0), commands, None, check_list)  # type: ignore[arg-type]
    return simulation, node, check_list, Diagnostics(node, "top", monitored)  # type: ignore[arg-type]


def reports() -> list[tuple[bytes, str, dict[str, str], list[str]]]:
    """Level, message, values and log after a run that blows up, after its failure and reset."""
    simulation, node, check_list, diagnostics = told_of()
    seen = []

    def report(state: str, failure: str = "") -> None:
        diagnostics.tick(state, failure, real_time_factor=1.0)
        (status,) = node.published[-1].status
        values = {pair.key: pair.value for pair in status.values}
        seen.append((status.level, status.message, values, list(node.said)))

    report("paused")
    fed(check_list, simulation, 0.3)
    report("running")
    report("error", "stopped")
    check_list.reset()
    report("paused")
    return seen


def test_a_broken_balance_is_a_warning_until_reset() -> None:
    """Semi-implicit Euler on a fast top gains energy; a failure goes before, and keeps it."""
    start, broken, failed, again = reports()
    assert start[:2] == (DiagnosticStatus.OK, "paused") and not start[3]
    level, message, values, said = broken
    assert level == DiagnosticStatus.WARN
    energy = values["warning, energy"]
    assert energy.startswith("energy:") and "(top)" in energy
    assert message in [text for key, text in values.items() if key.startswith("warning")]
    assert message in said and energy in said
    assert failed[:2] == (DiagnosticStatus.ERROR, "stopped")
    assert failed[2]["warning, energy"].startswith("energy:")
    assert failed[3] == said, "each is said once"
    assert again[:2] == (DiagnosticStatus.OK, "paused")
    assert not any(key.startswith("warning") for key in again[2])


def unheard() -> tuple[int, list[str], int]:
    """Reports to nobody, what is said on the log of a broken balance, and reports to somebody."""
    simulation, node, check_list, diagnostics = told_of()
    node.listeners = 0
    fed(check_list, simulation, 0.3)
    diagnostics.tick("running", "", real_time_factor=1.0)
    to_nobody, said = len(node.published), list(node.said)
    node.listeners = 1
    diagnostics.tick("paused", "", real_time_factor=1.0)
    return to_nobody, said, len(node.published)


def test_what_nobody_listens_to_is_not_packed_but_still_said() -> None:
    to_nobody, said, to_somebody = unheard()
    assert to_nobody == 0 and to_somebody == 1
    assert any("energy" in line for line in said)


def by_thread_and_at_once() -> list[tuple[int, list[str], dict[str, Any] | None]]:
    """Samples, findings and balance of the same run, looked at either way."""
    found = []
    for threaded in (False, True):
        simulation = simulation_of(method="euler", step=1e-3, tolerance=None)
        check_list = CheckSink(simulation)
        if threaded:
            check_list.open(simulation.scene, simulation.layout)
        fed(check_list, simulation, 2.3)
        check_list.look()
        check_list.close()
        findings = [str(finding) for finding in check_list.look()]
        found.append(
            (
                check_list._check_list.ledger.samples,
                findings,
                check_list._check_list.ledger.energy(),
            )
        )
    return found


def test_the_thread_puts_samples_together_in_parts_and_finds_the_same() -> None:
    at_once, by_thread = by_thread_and_at_once()
    assert at_once[0] > BATCH and at_once[1]
    assert by_thread == at_once


def quick_controller() -> tuple[bytes, str]:
    """The last report where commands overtake each other all the time."""
    _, node, _, diagnostics = told_of()
    for k in range(3):
        diagnostics._monitored.commands.refused = Counter(overtaken=10 * k)
        diagnostics.tick("paused" if k % 2 else "running", "", real_time_factor=1.0)
    (status,) = node.published[-1].status
    return status.level, {pair.key: pair.value for pair in status.values}["commands overtaken"]


def test_a_controller_that_is_faster_than_the_samples_is_no_warning() -> None:
    assert quick_controller() == (DiagnosticStatus.OK, "20")


def two_clocks() -> list[tuple[bytes, str, list[str]]]:
    """Level, message and log while another clock comes and goes, and of a node without one."""
    _, node, _, diagnostics = told_of()
    seen = []
    for own, clocks in ((True, 1), (True, 2), (True, 2), (True, 1), (False, 1)):
        diagnostics._publish_clock, node.clocks = own, clocks
        state = "paused" if len(seen) % 2 else "running"
        diagnostics.tick(state, "", real_time_factor=1.0)
        (status,) = node.published[-1].status
        seen.append((status.level, status.message, list(node.said)))
    return seen


def test_another_clock_is_a_warning_while_it_is_there() -> None:
    alone, other, still, gone, without = two_clocks()
    assert alone[0] == gone[0] == without[0] == DiagnosticStatus.OK
    assert other[0] == still[0] == DiagnosticStatus.WARN
    assert other[1] == still[1] == "new: other publishers of the clock"
    (line,) = without[2]
    assert "another node publishes /remapped/clock" in line and "publish_clock:=false" in line
