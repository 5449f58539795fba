# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

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
from types import ModuleType
from typing import Any

import numpy as np
from scipy.integrate._ivp import dop853_coefficients as published

from rb_sim.mechanics.samples import block_of, row_width
from rb_sim.mechanics.system import rate, sample, settle

Long = np.longdouble
# the module; its package has the step under the same name
dopri853: ModuleType = importlib.import_module("rb_sim.integrate.methods.dopri853")
MODULES = ("rb_sim.graph.functions",)
"""Where kernels call `math`."""


class LongMath:
    """The functions of `math` that they call."""

    sin, cos, sqrt = np.sin, np.cos, np.sqrt
    isfinite, nan = np.isfinite, np.nan


@cache
def sharper_coefficients() -> tuple[Any, Any, Any]:
    """A, B and C of the step of dopri853 as published, to all their 30 digits."""
    number = r"(?<![\w.])(\d+\.\d+(?:[eE][-+]?\d+)?)"
    text = re.sub(number, r'Long("\1")', inspect.getsource(published))
    text = re.sub(r"np\.zeros\((.+)\)", r"np.zeros(\1, dtype=Long)", text)
    sharp: dict[str, Any] = {"Long": Long}
    exec(text, sharp)
    n = dopri853.STAGES
    found = sharp["A"][:n, :n], sharp["B"], sharp["C"][:n]
    for long, double in zip(found, (dopri853.A, dopri853.B, dopri853.C), strict=True):
        assert long.dtype == Long
        np.testing.assert_array_equal(long.astype(float), double)
    return found


@contextmanager
def long_doubles() -> Iterator[None]:
    """Inside, the step of dopri853 and the kernels keep the digits of long doubles."""
    names = ("A", "B", "C")
    usual = {name: getattr(dopri853, name) for name in names}
    sharp = dict(zip(names, sharper_coefficients(), strict=True))
    modules = [importlib.import_module(name) for name in MODULES]
    for module in modules:
        module.math = LongMath  # type: ignore[attr-defined]
    vars(dopri853).update(sharp, float=Long)
    try:
        yield
    finally:
        vars(dopri853).update(usual)
        del dopri853.float  # type: ignore[attr-defined]
        for module in modules:
            module.math = math  # type: ignore[attr-defined]


def long_end(compiled: Any, end: float, steps: float) -> Any:
    """The sample (a SampleBlock of long doubles) at `end` after `steps` steps, whole or not."""
    system, h, step = compiled.system, Long(end) / Long(steps), dopri853.dopri853.traced
    assert step is not None
    lengths = [h] * int(steps)
    if steps > len(lengths):
        lengths.append(Long(end) - len(lengths) * h)
    y = tuple(Long(value) for value in compiled.y)
    carry = (Long(0.0),) * len(y)
    out = np.zeros((1, row_width(compiled.layout)), dtype=Long)
    with long_doubles():
        for k, length in enumerate(lengths):
            dy, _ = step(lambda t, y: rate(system, t, y), k * h, y, length, ())
            change = [a + b for a, b in zip(dy, carry, strict=True)]
            moved = tuple(a + b for a, b in zip(y, change, strict=True))
            carry = [c - (b - a) for a, b, c in zip(y, moved, change, strict=True)]
            y = settle(system, k * h + length, moved)
        sample(system, Long(end), y, out[0])
    assert all(isinstance(value, Long) for value in y)
    return block_of(np.array([Long(end)]), out, compiled.layout, np.zeros((1, 0, 6)))
