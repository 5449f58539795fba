"""How large the quantities of two motions are, and what of their difference is rounding."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.sinks.extent import reach_of

if TYPE_CHECKING:
    from rb_sim.bags.tracks import Tracks

ROUNDING = 1e-11
"""Of the size of a quantity: what rounding makes of two runs of the same motion, or less."""

STANDING = 1e-11
"""[m]: a motion that covers less, of which no scene is known, only turns; its attitudes are then
compared as of a body of 1 m."""


def length_of(bodies: Iterable[Any]) -> float:
    """How far a body of a scene reaches from its origin at most [m]."""
    return max((hypot(*body.center_of_mass) + reach_of(body) for body in bodies), default=0.0)


def floors(a: Tracks, b: Tracks) -> dict[str, float]:
    """By quantity, the difference below which two motions are the same: ROUNDING of the largest
    in both, where quantities that belong together lend each other their size (a torque that
    vanishes is small against force times length)."""
    tracks = [*a.bodies.values(), *b.bodies.values()]
    covered = _largest(np.ptp(track.position, axis=0) for track in tracks)
    length = max(a.length, b.length, covered if covered > STANDING else 0.0) or 1.0
    spin = _largest(_present(track.angular_velocity for track in tracks))
    speed = max(_largest(_present(track.linear_velocity for track in tracks)), spin * length)
    wrenches = [w.values for w in (*a.reactions.values(), *b.reactions.values())]
    torque = _largest(w[:, 3:] for w in wrenches)
    force = max(_largest(w[:, :3] for w in wrenches), torque / length)
    sizes = {
        "position": length,
        "angle": 1.0,
        "velocity": speed,
        "spin": max(spin, speed / length),
        "force": force,
        "torque": max(torque, force * length),
    }
    return {quantity: ROUNDING * size for quantity, size in sizes.items()}


def _present(values: Iterable[np.ndarray | None]) -> Iterable[np.ndarray]:
    return (value for value in values if value is not None)


def _largest(values: Iterable[np.ndarray]) -> float:
    """The largest number of all that are finite; 0 of none."""
    finite = (np.abs(value[np.isfinite(value)]) for value in values)
    return max((float(value.max(initial=0.0)) for value in finite), default=0.0)
