"""The numbers of a scene that a fit may change, as one vector of about unit size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from rb_sim.errors import RbSimError
from rb_sim.sinks.as_run import value_at

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
    if last in VELOCITIES and head.count(".") == 1 and head.startswith("bodies."):
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
        *path, last = number.key.split(".")
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
        body = changed["bodies"][key.split(".")[1]]
        q = Rotation.from_rotvec(turn) * Rotation.from_quat(attitudes[key])
        body["orientation"] = q.as_quat().tolist()
    return changed


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
