# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Threads that samples wait for go first while the node keeps to the clock, where permitted."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress

import pytest

from rb_sim.ros.pacing import Priority
from tests.ros.client import Client
from tests.ros.conftest import NodeProcess

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


def test_who_is_not_permitted_is_told(monkeypatch: pytest.MonkeyPatch):
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
