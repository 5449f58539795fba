# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The unknowns of a fit: the numbers that it may change, how far, and what it found."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.base.names import keys_of
from rb_sim.base.rounding import WRITTEN_ROUNDING
from rb_sim.io.bag.reader import value_at
from rb_sim.numerics.rotations import from_rotation_vector, product, unit
from rb_sim.scene.schema import SimulationOptions

# The numbers of a scene that a fit may change, as one vector of about unit size.


LEAST = 1e-3
"""A number that is > 0 at the start stays above this part of it."""
AT_MOST = {"kinetic": "static"}
"""A number that its section takes up to another one of it at most."""


class Free(NamedTuple):
    """One free number.

    key: dotted path; index: component of a vector, None for a scalar; of an orientation the turn
    about the world's axes [rad], from where it starts. share_of: which of the free numbers it is at
    most; the search then has it as a share of that one.
    """

    key: str
    index: int | None
    start: float
    scale: float
    share_of: int | None = None

    @property
    def name(self) -> str:
        """The key, with the component if it has any."""
        return self.key if self.index is None else f"{self.key}[{self.index}]"

    @property
    def turn(self) -> bool:
        """True for a component of an orientation."""
        return self.key.endswith(".orientation")


def free_numbers(data: Mapping[str, Any], keys: Sequence[str]) -> list[Free]:
    """The components of all keys. Raises RbSimError for a key that is no number or vector."""
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
    """Those that may not be more than another free one as shares of it."""
    at = {number.key: k for k, number in enumerate(free) if number.start > 0}
    of = [at.get(_other(number.key, AT_MOST)) for number in free]
    return [number._replace(share_of=k) for number, k in zip(free, of, strict=True)]


def _other(key: str, names: Mapping[str, str]) -> str:
    """The key beside this one that `names` has for its last part; "" where it has none."""
    head, _, last = key.rpartition(".")
    return f"{head}.{names[last]}" if last in names else ""


VELOCITIES = ("position", "linear_velocity", "angular_velocity")
"""Of a body, zero where a scene leaves them out."""


def _value(data: Mapping[str, Any], key: str) -> Any:
    head, _, last = key.rpartition(".")
    if last in VELOCITIES and head.startswith("bodies") and len(keys_of(head) or ()) == 2:
        return value_at(data, head).get(last, [0.0, 0.0, 0.0])
    try:
        return value_at(data, key)
    except RbSimError as error:
        raise RbSimError(f"--free {error}") from None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def with_numbers(
    data: Mapping[str, Any], free: Sequence[Free], values: np.ndarray, attitudes: Mapping[str, Any]
) -> dict[str, Any]:
    """The scene's data with these values. attitudes: quaternions at the start, by key."""
    changed = _copy(data)
    turns: dict[str, np.ndarray] = {}
    for number, value in zip(free, values.tolist(), strict=True):
        if number.turn:
            turns.setdefault(number.key, np.zeros(3))[number.index or 0] = value
            continue
        *path, last = keys_of(number.key) or (number.key,)
        at = changed
        for name in path:
            at = at[name]
        if number.index is None:
            at[last] = value
        else:
            vector = list(at.get(last, [0.0, 0.0, 0.0]))
            vector[number.index] = value
            at[last] = vector
    for key, turn in turns.items():
        body = changed["bodies"][body_of(key)]
        q = product(from_rotation_vector(turn), unit(attitudes[key]))
        body["orientation"] = q.tolist()
    return changed


def body_of(key: str) -> Any:
    """The body of a path like `bodies.top.orientation`."""
    return (keys_of(key) or ("", ""))[1]


def _copy(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copy(entry) for key, entry in value.items()}
    return [_copy(entry) for entry in value] if isinstance(value, (list, tuple)) else value


def start_of(free: Sequence[Free]) -> np.ndarray:
    """The numbers as the search has them, at the start: over their scales, or shares."""
    return np.array([n.start / _unit(n, free) for n in free])


def _unit(number: Free, free: Sequence[Free]) -> float:
    return number.scale if number.share_of is None else free[number.share_of].start


def values_of(free: Sequence[Free], x: np.ndarray) -> np.ndarray:
    """The numbers themselves, from those of the search."""
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
    """Of the numbers of the search: what is a positive scalar at the start stays positive, what is
    at most another number of the scene stays so, and so does that other one."""
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


# How far the numbers of a fit may go: bounds that are known, and those at which a scene refuses.
#
# A scene says no where friction would be less at rest than in a slip, a body would begin inside a
# floor, an inertia would be no body's. A derivative is taken to the side that is possible, and a
# search that such a limit stops goes on along it. What a recording does not tell stays where it
# was.


STEP = 1e-5
"""Of a difference, relative to a number's scale."""
UNDETERMINED = 1e-5
"""The same where J is taken by differences: a motion to 1e-10 over steps of 1e-5."""
TOLERANCE = 1e-10
"""Of motions of which differences are taken, at most."""
NEAR = 1e-6
"""From a bound, within which a number is at it."""


def differenced(options: SimulationOptions) -> SimulationOptions:
    """How the motions of differences are integrated: steps of adaptive length change with the
    numbers, and what a coarse tolerance leaves of the motion changes with them."""
    if options.tolerance is None:
        return options
    method = "dopri853" if options.method == "auto" else options.method
    return options.model_copy(
        update={"method": method, "tolerance": min(TOLERANCE, options.tolerance)}
    )


def difference(f: Callable[[np.ndarray], np.ndarray], x: np.ndarray, k: int) -> np.ndarray:
    """df/dx_k of second order; nothing where f is not finite on either side.

    Central, or to one side, (4 f(x + h) - f(x + 2 h) - 3 f(x)) / 2 h, where f(x - h) is not finite.
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
    """`difference` by each number, shape (len(f), len(x))."""
    return np.stack([difference(f, x, k) for k in range(len(x))], axis=1)


def moving(J: np.ndarray) -> np.ndarray:
    """Which numbers have an effect."""
    sizes = np.linalg.norm(J, axis=0)
    return sizes > WRITTEN_ROUNDING * sizes.max(initial=1e-300)


def negligible(exact: bool) -> float:
    """Singular value of J, relative to the largest, that says nothing."""
    return WRITTEN_ROUNDING if exact else UNDETERMINED


def poorly_determined(s: np.ndarray, least: float) -> np.ndarray:
    """Which singular values say nothing beside the largest."""
    return s <= least * max(s[0], 1e-300)


def still(J: np.ndarray, least: float) -> np.ndarray:
    """Rows that hold the combinations without effect, as strongly as the data hold the weakest
    of the others: what the data do not tell is where the search began."""
    _, s, Vt = np.linalg.svd(J, full_matrices=False)
    weak = poorly_determined(s, least)
    return s[~weak].min() * Vt[weak] if weak.any() and not weak.all() else Vt[:0]


def held_still(
    slopes: Callable[[np.ndarray], np.ndarray], start: np.ndarray, least: float
) -> tuple[np.ndarray, Any]:
    """The rows of `still` at the start, and the derivative with them; at the start it is taken
    once."""
    first = slopes(start)
    held = still(first, least)

    def derivative(x: np.ndarray) -> np.ndarray:
        return np.vstack([first if np.array_equal(x, start) else slopes(x), held])

    return held, derivative


@dataclass
class Limits:
    """low and high of each number, of the numbers of the search."""

    low: np.ndarray
    high: np.ndarray

    @property
    def fixed(self) -> np.ndarray:
        """Those that may not move at all."""
        return self.low >= self.high

    def same(self, other: Limits) -> bool:
        """Whether they are the same."""
        return np.array_equal(self.low, other.low) and np.array_equal(self.high, other.high)

    def inside(self, x: np.ndarray) -> np.ndarray:
        """x, not beyond them."""
        return np.clip(x, self.low, self.high)

    def reached(self, x: np.ndarray) -> np.ndarray:
        """Which numbers are at one of them."""
        near = NEAR * np.maximum(1.0, np.abs(x))
        return (x - self.low < near) | (self.high - x < near)

    def at(
        self, x: np.ndarray, slope: np.ndarray, possible: Callable[[np.ndarray], bool]
    ) -> Limits:
        """These, and x itself on each side on which it would go down but is not possible.

        slope: of the sum of squares along each number.
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


# What a fit found.


@dataclass
class Fitted:
    """The result. Arrays are in the order of `free`."""

    free: list[Free]
    values: np.ndarray
    errors: np.ndarray
    """standard errors; inf for a number that the recording does not determine."""
    correlation: np.ndarray
    noise: dict[str, float]
    """[m] and [rad], as given or as left."""
    residuals: dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(repr=False)
    """by body: t, position residuals (n, 3), attitude residuals (n, 3)."""
    runs: int
    message: str
    undetermined: list[str]
    data: dict[str, Any] = field(repr=False)
    """the scene with the fitted values."""
    limited: list[str]
    """numbers that are held by a limit of what the scene takes; their errors know nothing of it."""
    correlation_left: float = 0.0
    """of neighbours in what is left where it is not noise, else 0: the scene is another one than
    was recorded, or the search ended elsewhere, and the errors mean nothing."""
    outliers: tuple[str, ...] = ()
    """poses that lie far from all others beside that motion, a line for each body."""
    lost: tuple[str, ...] = ()
    """what the checks found of lost accuracy in the motion with the fitted values, a line each."""

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
