# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Time without that of compiling, on a clock by hand."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from rb_sim.numerics import kernels as module
from rb_sim.numerics.kernels import own_time


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A clock that stands at 100 s, and a thread that has compiled nothing."""
    now = SimpleNamespace(t=100.0)
    monkeypatch.setattr(module, "time", SimpleNamespace(monotonic=lambda: now.t))
    monkeypatch.setattr(module, "_COMPILING", module._Compiling())
    return now


def test_it_stands_still_while_something_compiles(clock: SimpleNamespace) -> None:
    """Compilations begin inside others; the outermost counts, and after it the next one."""
    compiling = module._COMPILING
    assert own_time() == 100.0
    for total in (7.0, 14.0):
        begun = clock.t
        compiling.begin()
        clock.t += 2.0
        compiling.begin()
        clock.t += 4.0
        compiling.end()
        clock.t += 1.0
        compiling.end()
        assert compiling.total == total and compiling.depth == 0
        assert own_time() == clock.t - total and clock.t == begun + 7.0
        clock.t += 3.0
        assert own_time() == clock.t - total


def test_a_compilation_that_was_broken_off_has_ended(clock: SimpleNamespace) -> None:
    """By a signal, however deep: time goes on from when it is asked for."""
    for _ in range(2):
        module._COMPILING.begin()
    clock.t = 105.0
    assert own_time() == 100.0 and module._COMPILING.depth == 0
    clock.t = 106.0
    assert own_time() == 101.0
