# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Free numbers of a fit, their limits, and the result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from pydantic_core import PydanticCustomError

from rb_sim.base.errors import RbSimError
from rb_sim.base.names import keys_of
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.catalogue.spec import radians_of
from rb_sim.io.bag.reader import replaced, value_at
from rb_sim.numerics.rotations import from_rotation_vector, product, unit
from rb_sim.scene.schema import SimulationOptions

# Free numbers of a scene as one vector of search variables of about unit size.


LEAST = 1e-3
"""Lower bound of a number that is > 0 at the start, relative to its start value."""
AT_MOST = {"kinetic": "static"}
"""Numbers bounded above by another number of the same section."""


class Free(NamedTuple):
    """One free number.

    key: dotted path; index: component of a vector, None for a scalar; for an orientation the
    rotation about the world's axes [rad], relative to the start. share_of: index of the free number
    that is its upper bound; the search variable is then the ratio of the two.
    """

    key: str
    index: int | None
    start: float
    scale: float
    share_of: int | None = None

    @property
    def name(self) -> str:
        """The key, with the component if it has one."""
        return self.key if self.index is None else f"{self.key}[{self.index}]"

    @property
    def turn(self) -> bool:
        """Whether it is a component of an orientation."""
        return self.key.endswith(".orientation")


def free_numbers(data: Mapping[str, Any], keys: Sequence[str]) -> list[Free]:
    """Free numbers for all components of the keys. Raises RbSimError for other values."""
    found: list[Free] = []
    for key in keys:
        if key.endswith(".orientation"):
            value_at(data, key.removesuffix(".orientation"))
            found += [Free(key, k, 0.0, 1.0) for k in range(3)]
            continue
        value = _value(data, key)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            found.append(Free(key, None, float(value), abs(float(value)) or 1.0))
        elif isinstance(value, (list, tuple)) and value and all(_is_number(x) for x in value):
            size = float(np.abs(np.array(value, float)).max()) or 1.0
            found += [Free(key, k, float(x), size) for k, x in enumerate(value)]
        else:
            raise RbSimError(f"--free {key}: got {value!r}; must be a number or a vector")
    names = [number.name for number in found]
    twice = {name for name in names if names.count(name) > 1}
    if twice or not found:
        raise RbSimError(
            f"--free: {', '.join(sorted(twice)) or 'nothing'} given twice or not at all"
        )
    return _with_shares(found)


def _with_shares(free: list[Free]) -> list[Free]:
    """The free numbers with `share_of` set if their upper bound is free too."""
    at = {number.key: k for k, number in enumerate(free) if number.start > 0}
    of = [at.get(_other(number.key, AT_MOST)) for number in free]
    return [number._replace(share_of=k) for number, k in zip(free, of, strict=True)]


def _other(key: str, names: Mapping[str, str]) -> str:
    """Key in the same section that `names` assigns to this one; "" if there is none."""
    head, _, last = key.rpartition(".")
    return f"{head}.{names[last]}" if last in names else ""


VELOCITIES = ("position", "linear_velocity", "angular_velocity")
"""Body quantities that default to zero in a scene."""


def _value(data: Mapping[str, Any], key: str) -> Any:
    head, _, last = key.rpartition(".")
    if last in VELOCITIES and head.startswith("bodies") and len(keys_of(head) or ()) == 2:
        return value_at(data, head).get(last, [0.0, 0.0, 0.0])
    try:
        value = value_at(data, key)
    except RbSimError as error:
        hint = "the scene must have the key, with a value to start from"
        raise RbSimError(f"--free {error}; {hint}") from None
    try:
        return radians_of(value)  # an angle in degrees
    except PydanticCustomError:
        return value


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def with_numbers(
    data: Mapping[str, Any], free: Sequence[Free], values: np.ndarray, attitudes: Mapping[str, Any]
) -> dict[str, Any]:
    """The scene's data with these values. attitudes: start quaternions by key."""
    changed: Any = data
    turns: dict[str, np.ndarray] = {}
    for number, value in zip(free, values.tolist(), strict=True):
        if number.turn:
            turns.setdefault(number.key, np.zeros(3))[number.index or 0] = value
            continue
        if number.index is not None:
            vector = list(_value(changed, number.key))
            vector[number.index] = value
            value = vector
        changed = replaced(changed, keys_of(number.key) or (number.key,), value)
    for key, turn in turns.items():
        q = product(from_rotation_vector(turn), unit(attitudes[key]))
        changed = replaced(changed, ("bodies", body_of(key), "orientation"), q.tolist())
    return changed


def body_of(key: str) -> Any:
    """Name of the body in a path like `bodies.top.orientation`."""
    return (keys_of(key) or ("", ""))[1]


def start_of(free: Sequence[Free]) -> np.ndarray:
    """Search variables at the start: numbers relative to their scale or upper bound."""
    return np.array([n.start / _unit(n, free) for n in free])


def _unit(number: Free, free: Sequence[Free]) -> float:
    return number.scale if number.share_of is None else free[number.share_of].start


def values_of(free: Sequence[Free], x: np.ndarray) -> np.ndarray:
    """The numbers for these search variables."""
    values = x * np.array([number.scale for number in free])
    for k, number in enumerate(free):
        if number.share_of is not None:
            values[k] = x[k] * values[number.share_of]
    return values


def slopes_of(free: Sequence[Free], x: np.ndarray) -> np.ndarray:
    """d values_of / d x, shape (n, n)."""
    values, slopes = values_of(free, x), np.diag([number.scale for number in free])
    for k, number in enumerate(free):
        if number.share_of is not None:
            slopes[k, k] = values[number.share_of]
            slopes[k, number.share_of] = x[k] * free[number.share_of].scale
    return slopes


def bounds(free: Sequence[Free], data: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper bounds of the search variables: positive scalars stay positive, and a number
    stays below its upper bound in the scene, or above the number that it bounds."""
    scalar = np.array([n.index is None and n.start > 0 for n in free])
    low, high = np.where(scalar, LEAST, -np.inf), np.full(len(free), np.inf)
    shares = {number.share_of for number in free}
    at_least = {above: below for below, above in AT_MOST.items()}
    for k, number in enumerate(free):
        above, below = (_given(data, _other(number.key, n)) for n in (AT_MOST, at_least))
        if number.share_of is not None:
            high[k] = 1.0
        elif above is not None:
            high[k] = above / number.scale
        elif below is not None and k not in shares:
            low[k] = max(low[k], below / number.scale)
    return low, high


def _given(data: Mapping[str, Any], key: str) -> float | None:
    try:
        value = value_at(data, key) if key else None
    except RbSimError:
        return None
    return float(value) if value is not None and _is_number(value) else None


# Limits of the search: known bounds, and values for which the scene is invalid.
#
# A scene is invalid if static friction is below kinetic friction, a body starts inside a floor, or
# an inertia is impossible. Derivatives are then one-sided, and a search stopped by such a limit
# continues along it. Numbers that the recording does not determine keep their start value.


STEP = 1e-5
"""Step of a difference, relative to a number's scale."""
UNDETERMINED = 1e-5
"""Relative singular value of J that is negligible if J comes from differences: motions with an
error of 1e-10 over steps of 1e-5."""
TOLERANCE = 1e-10
"""Largest tolerance of motions from which differences are taken."""
NEAR = 1e-6
"""Distance from a bound within which a number counts as at it."""


def differenced(options: SimulationOptions) -> SimulationOptions:
    """Simulation options for differences: adaptive steps change with the numbers, so that a coarse
    tolerance would add errors that change too."""
    if options.tolerance is None:
        return options
    method = "dopri853" if options.method == "auto" else options.method
    return options.model_copy(
        update={"method": method, "tolerance": min(TOLERANCE, options.tolerance)}
    )


def difference(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, k: int) -> np.ndarray:
    """df/dx_k of second order; zero if f is not finite on either side.

    Central; one-sided, (4 f(x + h) - f(x + 2 h) - 3 f(x)) / 2 h, if f(x - h) is not finite.
    """
    h = np.zeros(len(x))
    h[k] = STEP
    above, below = f(x + h), f(x - h)
    sides = np.isfinite(above).all(), np.isfinite(below).all()
    if all(sides):
        return (above - below) / (2.0 * STEP)
    if not any(sides):
        return np.zeros_like(above)
    sign, one = (1.0, above) if sides[0] else (-1.0, below)
    here, two = f(x), f(x + 2.0 * sign * h)
    if not np.isfinite(two).all():
        return sign * (one - here) / STEP
    return sign * (4.0 * one - two - 3.0 * here) / (2.0 * STEP)


def differences(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    """`difference` for each variable, shape (len(f), len(x))."""
    return np.stack([difference(f, x, k) for k in range(len(x))], axis=1)


def moving(J: np.ndarray) -> np.ndarray:
    """Mask of the variables with an effect."""
    sizes = np.linalg.norm(J, axis=0)
    return sizes > WRITTEN_ROUNDING * sizes.max(initial=1e-300)


def negligible(exact: bool) -> float:
    """Relative singular value of J at or below which a combination is undetermined."""
    return WRITTEN_ROUNDING if exact else UNDETERMINED


def poorly_determined(s: np.ndarray, least: float) -> np.ndarray:
    """Mask of the negligible singular values."""
    return s <= least * max(s[0], 1e-300)


def holding_rows(J: np.ndarray, least: float) -> np.ndarray:
    """Rows that hold undetermined combinations at their start values, as strongly as the data hold
    the weakest determined one."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    weak = poorly_determined(s, least)
    return s[~weak].min() * Vt[weak] if weak.any() and not weak.all() else Vt[:0]


def with_holding_rows(
    slopes: Callable[[np.ndarray], np.ndarray], start: np.ndarray, least: float
) -> tuple[np.ndarray, Any]:
    """The `holding_rows` at the start, and the derivative with these rows appended; the derivative
    at the start is computed only once."""
    first = slopes(start)
    held = holding_rows(first, least)

    def derivative(x: np.ndarray) -> np.ndarray:
        return np.vstack([first if np.array_equal(x, start) else slopes(x), held])

    return held, derivative


@dataclass
class Limits:
    """Lower and upper limits of the search variables."""

    low: np.ndarray
    high: np.ndarray

    @property
    def fixed(self) -> np.ndarray:
        """Mask of the variables that cannot move."""
        return self.low >= self.high

    def same(self, other: Limits) -> bool:
        """Whether the limits are equal."""
        return np.array_equal(self.low, other.low) and np.array_equal(self.high, other.high)

    def inside(self, x: np.ndarray) -> np.ndarray:
        """x clipped to the limits."""
        return np.clip(x, self.low, self.high)

    def reached(self, x: np.ndarray) -> np.ndarray:
        """Mask of the variables at a limit."""
        near = NEAR * np.maximum(1.0, np.abs(x))
        return (x - self.low < near) | (self.high - x < near)

    def at(
        self, x: np.ndarray, slope: np.ndarray, possible: Callable[[np.ndarray], bool]
    ) -> Limits:
        """Limits with x added as a limit on each downhill side on which the scene is invalid.

        slope: derivative of the sum of squares along each variable.
        """
        low, high = self.low.copy(), self.high.copy()
        for k, downhill in enumerate(-np.sign(slope)):
            step = np.zeros(len(x))
            step[k] = STEP
            refused = {sign: not possible(x + sign * step) for sign in (-1.0, 1.0)}
            if refused.get(float(downhill)):
                low[k] = x[k] if refused[-1.0] else low[k]
                high[k] = x[k] if refused[1.0] else high[k]
        return Limits(low, high)


# Result of a fit.


@dataclass
class Fitted:
    """Result of a fit. Arrays are in the order of `free`."""

    free: list[Free]
    values: np.ndarray
    errors: np.ndarray
    """standard errors; inf for undetermined numbers."""
    correlation: np.ndarray
    noise: dict[str, float]
    """[m] and [rad], as given, or estimated from the residuals."""
    residuals: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(repr=False)
    """by body: t, position residuals (n, 3), attitude residuals (n, 3)."""
    runs: int
    message: str
    undetermined: list[str]
    data: dict[str, Any] = field(repr=False)
    """the scene with the fitted values."""
    limited: list[str]
    """numbers at a limit of the scene's valid range; their errors do not account for it."""
    correlation_left: float = 0.0
    """lag-1 correlation of the residuals if they are not noise, else 0: the model does not match
    the recording, or the search ended in a wrong minimum, and the errors are not valid."""
    outliers: tuple[str, ...] = ()
    """lines on poses far from the fitted motion, one for each body."""
    lost: tuple[str, ...] = ()
    """findings of the accuracy checks in the fitted motion, one line each."""

    def as_dict(self) -> dict[str, Any]:
        """Plain data."""
        names = [number.name for number in self.free]
        return {
            "numbers": {
                name: {"start": n.start, "value": float(v), "error": float(e)}
                for name, n, v, e in zip(names, self.free, self.values, self.errors, strict=True)
            },
            "correlation": self.correlation.tolist(),
            "noise": self.noise,
            "runs": self.runs,
            "message": self.message,
            "undetermined": self.undetermined,
            "limited": self.limited,
            "correlation_left": self.correlation_left,
            "outliers": list(self.outliers),
            "lost": list(self.lost),
        }
