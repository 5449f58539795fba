"""What is compiled for calls by address is told like all other compiling."""

from __future__ import annotations

import gc

import numba

from rb_sim.maths import jit


@jit.inline
def twice(x):
    return 2.0 * x


def law(t, y, p, out):
    out[0] = twice(y[0])


def test_compiling_for_calls_by_address_is_told(monkeypatch, tmp_path):
    """Contacts spend most of their first start in it."""
    monkeypatch.setattr(jit, "_CACHE_DIRECTORY", str(tmp_path))
    told: list[bool] = []
    with jit.on_compilation(lambda: told.append(True)):
        assert jit.by_address(law).address
    assert told
    told.clear()
    with jit.on_compilation(lambda: told.append(True)):
        assert jit.by_address(law).address
    assert not told  # it comes from the cache


def test_garbage_is_looked_for_seldom_while_compiling_only():
    """Also where two blocks overlap, of which the inner one ends first."""
    before = gc.get_threshold()
    during: list[int] = []
    with jit.on_compilation(lambda: during.append(gc.get_threshold()[0])):
        with jit.on_compilation(lambda: None):
            assert numba.njit(lambda x: x + 1.0)(1.0) == 2.0
            assert gc.get_threshold() == before  # own_time listens for good
        assert numba.njit(lambda x: x + 2.0)(1.0) == 3.0
    assert len(during) == 2
    assert min(during) > before[0]
    assert gc.get_threshold() == before
