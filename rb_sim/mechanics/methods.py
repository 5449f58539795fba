# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Table of the integration methods.

A method is listed here only; the scene compiler, `method: auto`, the work-precision runs and the
documentation read this table.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from rb_sim.integrate.methods.dopri853 import AdaptiveDopri853, Dopri853, dopri853
from rb_sim.integrate.methods.euler import Euler, euler
from rb_sim.integrate.methods.gauss6 import Gauss6, gauss6
from rb_sim.integrate.methods.radau5 import AdaptiveRadau5, Radau5, radau5
from rb_sim.integrate.methods.rk4 import Rk4, rk4
from rb_sim.integrate.methods.taylor import AdaptiveTaylor, taylor
from rb_sim.mechanics.laws import traceable
from rb_sim.mechanics.systems.many_bodies import MultiBody
from rb_sim.mechanics.systems.translation import GuidedBody, splines_of
from rb_sim.numerics.kernels import Step

# Time stepping as a method of scenes; its steps are in `contact.stepping`.


class TimeStepping(NamedTuple):
    """Time stepping with a fixed step [s]."""

    step: float


def in_contact(system: Any) -> bool:
    """Whether the system has contacts, so that its motion has events."""
    return not traceable(system)


def any_system(system: Any) -> bool:
    """True: the method takes every system."""
    return True


def expandable(system: Any) -> bool:
    """Whether the law of the system has a Taylor series.

    In maximal coordinates the nearest point of a spline is found by iteration, which has no series.
    """
    return traceable(system) and (isinstance(system, GuidedBody) or not splines_of(system))


def reduced(system: Any) -> bool:
    """Whether the system is one body in reduced coordinates.

    In maximal ones a step along the series costs 2 to 16 steps of dopri853, and compiling it
    seconds (`python -m benchmarks.series`).
    """
    return traceable(system) and not isinstance(system, MultiBody)


class MethodEntry(NamedTuple):
    """One method: its options, order, description and domain."""

    fixed: type | None
    """class made from a step [s], or None."""
    adaptive: type | None
    """class made from a local tolerance and a largest step [s], or None."""
    order: int
    """order p of the global error ~ step^p."""
    line: str
    """description in one line."""
    family: str = "runge-kutta"
    """family of the method: those of different families share neither coefficients nor
    construction, so that one can verify another."""
    suits: Callable[[Any], bool] = any_system
    """whether it can integrate a compiled system."""
    domain: str = "every scene"
    """systems that it can integrate, in words."""
    loop: Step | None = None
    """its step on traced laws; None if it integrates other systems only."""
    error_order: int = 0
    """order of the error estimate of an adaptive step; 0: as `order`."""
    weighed: Callable[[Any], bool] = any_system
    """systems for which `auto` tries it first and verifies others by it; for all other systems it
    is usually more expensive and is tried last, if its estimated cost is low enough."""


METHODS: dict[str, MethodEntry] = {
    "euler": MethodEntry(Euler, None, 1, "semi-implicit Euler: the baseline", "euler", loop=euler),
    "rk4": MethodEntry(Rk4, None, 4, "classical Runge-Kutta (Kutta 1901)", loop=rk4),
    "dopri853": MethodEntry(
        Dopri853,
        AdaptiveDopri853,
        8,
        "Dormand-Prince 8(5,3), fixed or adaptive step",
        loop=dopri853,
    ),
    "gauss6": MethodEntry(
        Gauss6,
        None,
        6,
        "Gauss collocation: symmetric, symplectic, for long runs",
        "collocation",
        loop=gauss6,
    ),
    "radau5": MethodEntry(
        Radau5,
        AdaptiveRadau5,
        5,
        "Radau IIA, L-stable: stiff springs, strong damping, extreme mass ratios",
        "radau",
        traceable,
        "scenes without contacts",
        radau5,
        4,
    ),
    "taylor": MethodEntry(
        None,
        AdaptiveTaylor,
        20,
        "Taylor series of the motion itself: the fewest steps at high accuracy",
        "taylor",
        expandable,
        "scenes without contacts (with a spline as guide: only one body that does not rotate)",
        taylor,
        weighed=reduced,
    ),
    "time_stepping": MethodEntry(
        TimeStepping,
        None,
        1,
        "velocities and impulses over a step: many contacts, any step, no events",
        "time-stepping",
        in_contact,
        "bodies in contact",
    ),
}


def tried(system: Any) -> dict[str, MethodEntry]:
    """The methods that `auto` tries first, and by which it verifies others."""
    return {n: e for n, e in METHODS.items() if e.suits(system) and e.weighed(system)}


def name_of(kind: type) -> str:
    """The name under which a method's class is listed; "" if it is not."""
    for name, entry in METHODS.items():
        if kind in (entry.fixed, entry.adaptive):
            return name
    return ""


def order_of(method: Any) -> int:
    """The order of a method; 1 of one that is not listed."""
    entry = METHODS.get(name_of(type(method)))
    return entry.order if entry else 1


def loop_of(kind: type) -> tuple[Step, float] | None:
    """(step of a method's class on traced laws, order of its error estimate); None without such a
    step."""
    for entry in METHODS.values():
        if entry.loop is not None and kind in (entry.fixed, entry.adaptive):
            return entry.loop, float(entry.error_order or entry.order)
    return None


def build(name: str, *, step: float | None, tolerance: float | None, largest_step: float) -> Any:
    """The method `name` with a fixed step [s], or adaptive with a local tolerance.

    Exactly one of step and tolerance is given; largest_step [s] bounds an adaptive step. Raises
    ValueError if the method does not support that choice.
    """
    entry = METHODS[name]
    if step is not None and entry.fixed is not None:
        return entry.fixed(float(step))
    if tolerance is not None and entry.adaptive is not None:
        return entry.adaptive(float(tolerance), float(largest_step))
    form = "fixed step" if step is not None else "tolerance"
    raise ValueError(f"method {name} takes no {form}")
