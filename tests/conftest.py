# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What all tests have in common."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator

import pytest

from rb_sim.mechanics.compiled import forget

IGNORED = "RB_SIM_TESTS_IGNORE"
"""Environment variable: signals that this process and its workers ignore, by number."""


def _ignore_alone() -> None:
    """Ignore what nohup, or `&` in a script, has ignored, by a handler: the programs that tests
    start would inherit an ignored signal, and tests send them signals."""
    asked = [n for n in (signal.SIGHUP, signal.SIGINT) if signal.getsignal(n) == signal.SIG_IGN]
    for number in os.environ.setdefault(IGNORED, " ".join(str(int(n)) for n in asked)).split():
        signal.signal(int(number), lambda *_: None)


_ignore_alone()

# Of the time of tests that trace laws, which make many objects and keep most of them while they do,
# a sixth went to a garbage collector that looked through them after every 700.
gc.set_threshold(20_000)


@pytest.fixture(autouse=True)
def _laws_of_its_own(request: pytest.FixtureRequest) -> Iterator[None]:
    """Keep laws that were traced while something was patched from other tests, and the reverse."""
    patched = "monkeypatch" in request.fixturenames
    if patched:
        forget()
    yield
    if patched:
        forget()


@pytest.fixture
def no_advice(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run that fails for its step is not made again in shorter ones, which takes seconds."""
    from rb_sim.accuracy.checks import step_search

    monkeypatch.setattr(step_search, "MOST_TIME", 0.0)


@pytest.fixture(scope="session")
def here() -> Iterator[str]:
    """Address of a scheduler whose only worker is a thread here, for what sweeps leave behind: the
    workers that `rb_sim sweep` has, in processes of their own, take seconds to start."""
    distributed = pytest.importorskip("distributed")
    settings = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "silence_logs": 50}
    with distributed.LocalCluster(dashboard_address=None, protocol="tcp", **settings) as cluster:
        yield cluster.scheduler_address


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave the thousands of tests to no garbage collector: it would go through them again and
    again."""
    del session
    gc.collect()
    gc.freeze()
