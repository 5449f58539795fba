"""An inner function is compiled once, whoever calls it."""

from collections import Counter

import pytest
from numba import config, float64
from numba.core import event

from rb_sim.maths.jit import entry, inline, plain


@plain
def twice(x):
    return 2.0 * x


@plain
def through_plain(x):
    return twice(x) + 1.0


@inline
def through_inline(x):
    return twice(x) + 2.0


@entry
def kernel(x):
    return twice(x) + through_plain(x) + through_inline(x)


@pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
def test_callers_of_other_options_share_one_compilation():
    compiled = Counter()

    class Listener(event.Listener):
        def on_start(self, event):
            compiled[event.data["dispatcher"].py_func.__name__] += 1

        def on_end(self, event):
            pass

    listener = Listener()
    event.register("numba:compile", listener)
    try:
        kernel.compile((float64,))
    finally:
        event.unregister("numba:compile", listener)
    assert kernel(1.0) == 9.0
    assert set(compiled.values()) <= {1}
