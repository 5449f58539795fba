"""What is compiled for calls by address is told like all other compiling."""

from __future__ import annotations

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
