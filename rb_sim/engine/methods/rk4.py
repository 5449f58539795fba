"""The classical Runge-Kutta method of order 4 (Kutta 1901)."""

from __future__ import annotations

from typing import NamedTuple

from rb_sim.engine.methods.method import increment
from rb_sim.engine.methods.runge_kutta import Tableau, runge_kutta

TABLEAU = Tableau(
    order=4,
    a=((), (0.5,), (0.0, 0.5), (0.0, 0.0, 1.0)),
    b=(1 / 6, 1 / 3, 1 / 3, 1 / 6),
    c=(0.0, 0.5, 0.5, 1.0),
)

step = runge_kutta(TABLEAU)


class Rk4(NamedTuple):
    """Fixed step [s]."""

    step: float


@increment.register(Rk4)
def rk4_increment(method, system, t, y, h, work):
    return step(system, t, y, h, work)
