"""Values that a scene may hold but that are often meant otherwise: a line each, for a warning."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene

FAR_FROM_UNIT = 1e-2
"""Of the length of a quaternion: two digits of each component leave less."""


def habits(data: Mapping[str, Any], scene: Scene) -> Iterator[str]:
    """One line for each: key, value, how it is read, what to write for the other meaning."""
    for name in scene.bodies:
        given = data["bodies"][name]
        written = given.get("orientation") if isinstance(given, Mapping) else None
        if isinstance(written, (list, tuple)) and len(written) == 4:
            yield from _quaternion(f"bodies.{name}.orientation", [float(x) for x in written])
    still = not any(any(b.linear_velocity + b.angular_velocity) for b in scene.bodies.values())
    if still and not scene.effects and not any(map(_drives, scene.constraints.values())):
        yield (
            "nothing moves: the scene has no effects, and no body a velocity; for weight give "
            "effects: {weight: {type: gravity}}"
        )


def _quaternion(key: str, q: list[float]) -> Iterator[str]:
    if q == [1.0, 0.0, 0.0, 0.0]:
        yield (
            f"{key}: [1, 0, 0, 0] is half a turn about x, as the order is [x, y, z, w]; for no "
            "turn leave it out, for half a turn write {axis: [1, 0, 0], angle: 3.141592653589793}"
        )
    elif abs(math.hypot(*q) - 1.0) > FAR_FROM_UNIT:
        yield (
            f"{key}: the quaternion has length {math.hypot(*q):.4g} and is scaled to 1; for roll, "
            "pitch, yaw or degrees write {axis: [x, y, z], angle: radians}"
        )


def _drives(spec: Any) -> bool:
    """Whether a constraint moves what it holds."""
    return bool(getattr(spec, "rate", 0.0)) or getattr(spec, "motion", None) is not None
