"""Run a one-body scene by dopri853 with the kernels as plain Python on numpy's long doubles.

The sources are the same; only `math` and the coefficients know more digits.  Rounding then starts
near 1e-19 instead of 1e-16, so that the order of the method shows over three more decades of error.
To be called inside `interpreted`.
"""

from __future__ import annotations

import importlib
import inspect
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as published

Long = np.longdouble
MODULES = ("rb_sim.graph.functions",)
"""Where kernels call `math`."""


class LongMath:
    """The functions of `math` that they call."""

    sin, cos, sqrt = np.sin, np.cos, np.sqrt
    isfinite, nan = np.isfinite, np.nan


@cache
def sharper_step() -> Any:
    """The generated step of dopri853 with the published coefficients to all their 30 digits."""
    from rb_sim.engine.methods import dopri853, runge_kutta
    from rb_sim.engine.methods.tuples import compile_source

    number = r"(?<![\w.])(\d+\.\d+(?:[eE][-+]?\d+)?)"
    text = re.sub(number, r'Long("\1")', inspect.getsource(published))
    text = re.sub(r"np\.zeros\((.+)\)", r"np.zeros(\1, dtype=Long)", text)
    sharp: dict[str, Any] = {"Long": Long}
    exec(text, sharp)
    a = tuple(tuple(sharp["A"][i, :i]) for i in range(12))
    tableau = runge_kutta.Tableau(8, a, tuple(sharp["B"]), tuple(sharp["C"][:12]))
    for long, double in zip(
        (*a, tableau.b), (*dopri853.TABLEAU.a, dopri853.TABLEAU.b), strict=True
    ):
        assert tuple(float(value) for value in long) == tuple(double)

    def sharp_terms(row: Any) -> list[tuple[int, Any]]:
        return [(j, value) for j, value in enumerate(row) if value != 0]

    def sharp_source(source: str, name: str, **names: Any) -> Any:
        return compile_source(source, name, np=np, **names)

    saved = runge_kutta.terms, runge_kutta.compile_source
    runge_kutta.terms, runge_kutta.compile_source = sharp_terms, sharp_source
    try:
        return {n: runge_kutta.tuple_step(tableau, n) for n in (2, 7, 10, 13)}
    finally:
        runge_kutta.terms, runge_kutta.compile_source = saved


@contextmanager
def long_doubles() -> Iterator[None]:
    """Inside, the kernels keep the digits of long doubles."""
    from rb_sim.engine.methods.dopri853 import Dopri853
    from rb_sim.engine.methods.method import increment

    steps, kernels = sharper_step(), increment.kernels
    modules = [importlib.import_module(name) for name in MODULES]
    usual = kernels[Dopri853]
    for module in modules:
        module.math = LongMath  # type: ignore[attr-defined]
    kernels[Dopri853] = lambda method, system, t, y, h, work: steps[len(y)](system, t, y, h, work)
    try:
        yield
    finally:
        kernels[Dopri853] = usual
        for module in modules:
            module.math = math  # type: ignore[attr-defined]


def long_end(compiled: Any, end: float, steps: float) -> Any:
    """The sample (a SampleBlock of long doubles) at `end` after `steps` steps, whole or not."""
    from rb_sim.engine.grid import start_grid
    from rb_sim.engine.integrate import record
    from rb_sim.engine.methods.dopri853 import Dopri853
    from rb_sim.engine.samples import block_of
    from rb_sim.motion import Motion

    method = Dopri853(Long(end) / Long(steps))
    times, out = np.array([Long(end)]), np.zeros((1, Motion(compiled, method).width), dtype=Long)
    grid = start_grid(Long(0.0), tuple(Long(value) for value in compiled.y))
    with long_doubles():
        record(method, compiled.system, grid, times, math.inf, True, out, ())
    return block_of(times, out, compiled.layout, np.zeros((1, 0, 6)))
