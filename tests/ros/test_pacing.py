# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a late loop does, on a clock of the test's own."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from rb_sim.ros import node, pacing
from rb_sim.ros.node import SimulationLoop
from rb_sim.ros.pacing import Pacer, Priority
from tests.ros.client import Client
from tests.ros.conftest import NodeProcess

PERIOD = 0.01


class Clock:
    """Stands in for the module `time`; sleeping takes exactly as long as was asked for."""

    now = 100.0
    computed = 3.0

    def process_time(self) -> float:
        return self.computed

    def monotonic(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(pacing, "time", clock)
    return clock


def instants(
    clock: Clock, policy: str, delay: float, samples: int = 10
) -> tuple[Pacer, list[float]]:
    """Wall times [s] of samples, the fourth of which takes `delay` to compute."""
    pacer = Pacer(1.0, policy)
    pacer.restart(0.0, 1.0)
    start, found = clock.now, []
    for k in range(1, samples + 1):
        if k == 4:
            clock.now += delay
        assert pacer.wait(k * PERIOD, PERIOD, lambda: True)
        found.append(clock.now - start)
    return pacer, found


def test_catching_up_hurries_until_simulated_time_agrees_with_the_wall(clock: Clock):
    pacer, found = instants(clock, "catch_up", 0.045)
    assert found[3:7] == pytest.approx([0.075, 0.075, 0.075, 0.075])
    assert found[9] == pytest.approx(0.1)
    assert (pacer.overruns, pacer.slips, pacer.slipped) == (3, 0, 0.0)


def test_a_burst_is_short_and_then_it_hurries_at_twice_the_pace(clock: Clock):
    """Who keeps the last ten, and is late as well, would lose some of a longer one."""
    pacer, found = instants(clock, "catch_up", 0.155, samples=30)
    assert found[3:9] == pytest.approx([0.185] * 5 + [0.19])
    late = found[9:27]
    assert late == pytest.approx([0.195 + 0.005 * k for k in range(18)])
    assert found[28:] == pytest.approx([0.29, 0.3]) and pacer.slips == 0


def test_slipping_keeps_the_period_and_counts_what_is_given_up(clock: Clock):
    pacer, found = instants(clock, "slip", 0.045)
    assert found[3:] == pytest.approx([0.075 + k * PERIOD for k in range(7)])
    assert (pacer.overruns, pacer.slips) == (1, 1)
    assert pacer.slipped == pytest.approx(0.035)


def test_catching_up_gives_up_what_is_beyond_the_largest_lag(clock: Clock):
    pacer, found = instants(clock, "catch_up", 1.0)
    assert found[3:5] == pytest.approx([1.03, 1.04])
    assert (pacer.overruns, pacer.slips) == (1, 1)
    assert pacer.slipped == pytest.approx(0.99)


def test_a_loop_that_cannot_keep_up_is_told_from_one_that_was_held_up(clock: Clock):
    """Another chance comes after a while."""
    pacer = Pacer(1.0)
    for share, keeps_up in ((0.5, True), (0.9, False)):
        pacer.restart(0.0, 1.0)
        clock.now += 2.0
        clock.computed += 2.0 * share
        assert pacer.wait(PERIOD, PERIOD, lambda: True)
        assert pacer.keeps_up == keeps_up
    clock.now += 5.1
    assert pacer.keeps_up


@pytest.mark.parametrize("share, keeps_up", [(0.5, True), (1.0, False)])
def test_overload_is_reported_where_lateness_is_given_up_bit_by_bit(
    clock: Clock, share: float, keeps_up: bool
):
    """Each sample takes three periods; `slip` gives up 0.02 s each time, far below the largest lag.
    It computed all that time, or waited for others for a half of it. One late sample tells nothing.
    """
    pacer = Pacer(1.0, "slip")
    pacer.restart(0.0, 1.0)
    for k in range(1, 20):
        assert pacer.keeps_up or k > 2
        clock.now += 3 * PERIOD
        clock.computed += 3 * PERIOD * share
        assert pacer.wait(k * PERIOD, PERIOD, lambda: True)
    assert pacer.slips == 19 and pacer.keeps_up == keeps_up


def test_a_pace_that_changes_ends_the_wait_for_the_old_one(clock: Clock):
    """100 s to the next sample, until somebody asks for real time after one of them."""
    pacer = Pacer(1e-4)
    pacer.restart(0.0, 1e-4)
    assert pacer.wait(PERIOD, PERIOD, lambda: True)
    before = clock.now

    def hurry() -> bool:
        if clock.now > before + 1.0:
            pacer.restart(PERIOD, 1.0)
        return True

    assert not pacer.wait(2 * PERIOD, PERIOD, hurry)
    assert pacer.wait(2 * PERIOD, PERIOD, hurry)
    assert clock.now == pytest.approx(before + 1.0 + PERIOD, abs=0.03)


def test_what_may_take_long_is_done_in_slices_of_a_wait_and_never_where_a_sample_is_due(
    clock: Clock,
):
    pacer, asked = Pacer(1.0), []

    def between() -> bool:
        asked.append(clock.now - 100.0)
        return len(asked) < 3

    assert pacer.wait(PERIOD, PERIOD, between) and not asked
    assert pacer.wait(0.06, 0.05, between)
    assert asked == pytest.approx([0.03, 0.05])
    assert not pacer.wait(0.2, 0.05, between), "a wait is ended by it"
    assert clock.now - 100.0 == pytest.approx(0.08)


def test_what_is_done_between_samples_waits_for_those_who_listen(clock: Clock):
    """A part of the time that is left; none of a late loop's, nor of one that keeps no clock."""
    pacer = Pacer(2.0)
    pacer.give_way(0.02)
    assert clock.now - 100.0 == pytest.approx(pacing.WAY * 0.01)
    clock.now = 100.011
    pacer.give_way(0.02)
    assert clock.now == 100.011
    pacer.restart(0.0, 0.0)
    pacer.give_way(1.0)
    assert clock.now == 100.011
    pacer.restart(0.0, 1.0)
    pacer.give_way(10.0)
    assert clock.now == pytest.approx(100.011 + pacing.SLICE), "signals are heard meanwhile"


class Loop(SimulationLoop):
    """The node's loop without a node: who steps is counted, nothing is simulated."""

    def __init__(self, pacer: Pacer) -> None:
        self.paused = self.inactive = self._closed = self.left = False
        self.failure = ""
        self._stop: Any = SimpleNamespace(cause=None)
        self._pacer = pacer
        self._settings: Any = SimpleNamespace(real_time_factor=1.0)
        self._stepper: Any = SimpleNamespace(
            t=0.0, t_next=PERIOD, reset=self._sampled, rewind=lambda: None,
            set_state=lambda *_, **__: self._sampled(),
        )  # fmt: skip
        self._check_list: Any = SimpleNamespace(reset=lambda: None)

    def _sampled(self) -> None:
        self._stepper.t += PERIOD
        self._stepper.t_next += PERIOD

    def _report_now_and_then(self) -> None:
        """Nobody looks."""

    def _keep_to_the_clock(self) -> None:
        """There is no thread to raise."""


def test_requests_do_not_change_the_pace(clock: Clock, monkeypatch):
    """~/set_state and ~/reset are samples: 400 in a row took no time, and put simulated time
    ahead of the wall; ~/pause false in each period put it behind."""
    monkeypatch.setattr(node, "time", clock)
    pacer = Pacer(1.0)
    pacer.restart(0.0, 1.0)
    loop = Loop(pacer)
    for _ in range(200):
        loop.set_state({}, project=False)
        loop.reset()
    assert loop.t == pytest.approx(clock.now - 100.0) == pytest.approx(400 * PERIOD)
    for _ in range(100):
        clock.now += 0.6 * PERIOD
        loop.pause(False)
        assert pacer.wait(loop._stepper.t_next, PERIOD, lambda: True)
        loop._sampled()
    assert loop.t == pytest.approx(clock.now - 100.0) == pytest.approx(500 * PERIOD)
    loop.pause(True)
    clock.now += 3.0
    loop.reset()
    assert clock.now == pytest.approx(103.0 + 500 * PERIOD), "nothing is waited for in a pause"
    loop.pause(False)
    assert pacer.left(loop._stepper.t_next) == pytest.approx(PERIOD), "a pause does not count"


# Threads that samples wait for go first while the node keeps to the clock, where permitted.


LEVEL = 7
ORDINARY, RAISED = (os.SCHED_OTHER, 0), (os.SCHED_FIFO, LEVEL)


def standing(thread: int) -> tuple[int, int]:
    """Policy and priority of a thread."""
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return policy, os.sched_getparam(thread).sched_priority


def of_all(process: int) -> set[tuple[int, int]]:
    """Policies and priorities of all threads of a process."""
    found = set()
    for thread in os.listdir(f"/proc/{process}/task"):
        with suppress(ProcessLookupError):  # it has ended meanwhile
            found.add(standing(int(thread)))
    return found


def permitted() -> bool:
    """Whether this process may have a real-time priority; asked in one of its own."""
    ask = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({LEVEL}))"
    return subprocess.run([sys.executable, "-c", ask], stderr=subprocess.DEVNULL).returncode == 0


needs_permission = pytest.mark.skipif(
    not permitted(), reason="real-time priorities are not permitted to this user"
)


@pytest.fixture
def worker() -> Iterator[int]:
    """A thread that there is beside the test's own."""
    over = threading.Event()
    thread = threading.Thread(target=over.wait)
    thread.start()
    yield thread.native_id or 0
    over.set()
    thread.join()


@needs_permission
def test_all_threads_are_raised_and_put_back_and_what_they_start_is_ordinary(worker: int):
    priority = Priority(LEVEL)
    try:
        priority.raised(True)
        assert standing(0) == standing(worker) == RAISED
        assert str(priority) == f"{LEVEL} (SCHED_FIFO)"
        ask = "import os; print(os.sched_getscheduler(0))"
        child = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True)
        assert int(child.stdout) == os.SCHED_OTHER
    finally:
        priority.raised(False)
    assert standing(0) == standing(worker) == ORDINARY
    assert str(priority) == "ordinary"


@needs_permission
def test_a_policy_that_was_given_from_outside_comes_back(worker: int):
    os.sched_setscheduler(worker, os.SCHED_RR, os.sched_param(3))
    priority = Priority(LEVEL)
    priority.raised(True)
    assert standing(worker) == RAISED
    priority.raised(False)
    assert standing(worker) == (os.SCHED_RR, 3)


def test_none_is_asked_for(worker: int):
    priority = Priority(0)
    priority.raised(True)
    assert standing(0) == standing(worker) == ORDINARY and not priority.refusal


def test_who_is_not_permitted_is_reported(monkeypatch: pytest.MonkeyPatch):
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    priority = Priority(LEVEL)
    priority.raised(True)
    assert priority.refusal == (
        "thread_priority 7: operation not permitted (see `ulimit -r`, or CAP_SYS_NICE);"
        " samples wait for other programs"
    )
    assert str(priority) == "ordinary"


@needs_permission
def test_a_node_goes_first_while_it_keeps_to_the_clock(
    start: Callable[..., NodeProcess], client: Client, sphere: str
):
    node = start(sphere, thread_priority=LEVEL, rate=100.0)
    ours = node.process.pid

    def reach(wanted: tuple[int, int], *beside: tuple[int, int]) -> None:
        def reached() -> bool:
            return standing(ours) == wanted and of_all(ours) <= {wanted, *beside}

        client.until(reached, f"threads that are {wanted}")

    reach(RAISED, ORDINARY)  # threads that began later are not
    shown = client.diagnostics(lambda v: "SCHED_FIFO" in v["thread priority"], "raised threads")
    assert shown["thread priority"] == f"{LEVEL} (SCHED_FIFO)"
    client.pause()
    reach(ORDINARY)
    client.pause(False)
    reach(RAISED, ORDINARY)
    # more than can be computed: it would only take the processor away from all others
    assert client.set("real_time_factor", 1e4).successful
    reach(ORDINARY)
    assert client.set("real_time_factor", 1.0).successful
    reach(RAISED, ORDINARY)
    assert client.set("real_time_factor", 0.0).successful
    reach(ORDINARY)
