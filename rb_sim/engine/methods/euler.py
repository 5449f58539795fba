"""Semi-implicit (symplectic) Euler, order 1: the game engines' method, kept as the baseline.

Velocities first, v1 = v0 + h a(q0, v0), then the configuration with the new velocities.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from rb_sim.engine.methods.method import AT, DY, increment
from rb_sim.engine.methods.tuples import compile_source, copy, vector
from rb_sim.engine.system import CONFIGURATION, rate, rate_into
from rb_sim.maths.jit import by_type


class Euler(NamedTuple):
    """Fixed step [s]."""

    step: float


def _step(system, t, y, h, work):
    """The increment of one semi-implicit Euler step."""


def _of_array(system, t, y, h, work):
    at, first, dy = work[AT], work[0], work[DY]
    rate_into(system, t, y, first)
    copy(at, y)
    for body in range(y.shape[0] // 13):
        for i in range(13 * body + 7, 13 * body + 13):
            dy[i] = h * first[i]
            at[i] += dy[i]
    rate_into(system, t, at, first)
    for body in range(y.shape[0] // 13):
        for i in range(13 * body, 13 * body + 7):
            dy[i] = h * first[i]
    for i in range(13 * (y.shape[0] // 13), y.shape[0]):
        dy[i] = h * first[i]
    return dy


def _of_tuple(n: int, configuration: int) -> Any:
    at = vector(n, lambda i: f"y[{i}]" if i < configuration else f"y[{i}] + h*k0[{i}]")
    dy = vector(n, lambda i: f"h*k1[{i}]" if i < configuration else f"h*k0[{i}]")
    source = (
        "def implementation(system, t, y, h, work):\n"
        "    k0 = rate(system, t, y)\n"
        f"    k1 = rate(system, t, {at})\n"
        f"    return {dy}\n"
    )
    return compile_source(source, "implementation", rate=rate)


def _choose(system, t, y, h, work):
    if hasattr(y, "ndim"):
        return _of_array
    kind = getattr(system, "instance_class", type(system))
    return _of_tuple(len(y), CONFIGURATION[kind])


def _run(system, t, y, h, work):
    return _choose(system, t, y, h, work)(system, t, y, h, work)


step = by_type(_step, _choose, _run)


@increment.register(Euler)
def euler_increment(method, system, t, y, h, work):
    return step(system, t, y, h, work)
