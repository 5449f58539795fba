"""Places of numbers in a system: which they are, what is there, and others in their stead."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

Place = tuple[int, ...]
"""Of a number in a system: an index a level of its nested tuples, the last one into an array."""


CLEARED: dict[type, Callable[[Any], Any]] = {}
"""For classes of systems that have room to work in: the same system with zeros there."""


def cleared(system: Any) -> Any:
    """The system without what was left in its room to work in."""
    clear = CLEARED.get(type(system))
    return system if clear is None else clear(system)


def numbers(x: Any, place: Place = ()) -> Iterator[tuple[Place, float]]:
    """Every float in a system with its place."""
    if isinstance(x, float):
        yield place, float(x)
    elif isinstance(x, tuple):
        for i, entry in enumerate(x):
            yield from numbers(entry, (*place, i))
    elif isinstance(x, np.ndarray) and x.dtype.kind == "f":
        for i, entry in enumerate(x.ravel().tolist()):
            yield (*place, i), entry


def skeleton(x: Any) -> Any:
    """What remains of a system without its floats: classes, lengths, indices, shapes."""
    if isinstance(x, float):
        return float
    if isinstance(x, tuple):
        return type(x), tuple(skeleton(entry) for entry in x)
    if isinstance(x, np.ndarray):
        return x.shape, None if x.dtype.kind == "f" else x.tobytes()
    return x


def with_numbers(x: Any, values: Mapping[Place, Any]) -> Any:
    """The system with these values at their places; float arrays become arrays of objects there."""
    if () in values:
        return values[()]
    heads = {place[0] for place in values}
    if isinstance(x, np.ndarray):
        table = x.astype(object)
        for (i,), value in values.items():
            table.flat[i] = value
        return table
    entries = list(x)
    for i in heads:
        below = {place[1:]: value for place, value in values.items() if place[0] == i}
        entries[i] = with_numbers(x[i], below)
    return x._make(entries) if hasattr(x, "_make") else tuple(entries)


FREE = object()
"""In a pattern: any number."""


def fits(x: Any, pattern: Any) -> bool:
    """True for a system that is equal to the pattern but for numbers where it says FREE."""
    if pattern is FREE:
        return isinstance(x, float)
    if isinstance(pattern, tuple):
        if type(x) is not type(pattern) or len(x) != len(pattern):
            return False
        return all(fits(one, other) for one, other in zip(x, pattern, strict=True))
    if isinstance(pattern, np.ndarray):
        if not isinstance(x, np.ndarray) or x.shape != pattern.shape:
            return False
        if pattern.dtype == object:
            return all(map(fits, x.ravel().tolist(), pattern.ravel().tolist()))
        return x.dtype == pattern.dtype and bool((x == pattern).all())
    return isinstance(x, float) is isinstance(pattern, float) and bool(x == pattern)


def number_at(x: Any, place: Place) -> float:
    """The number at a place of a system."""
    for i in place:
        x = x.flat[i] if isinstance(x, np.ndarray) else x[i]
    return float(x)
