"""What a closed form gives: the coordinates of a system at any time."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from rb_sim.accuracy.closed_forms.special_functions import Long, LongArray, long, np
from rb_sim.catalogue.effects.gravity import GravityRow
from rb_sim.mechanics.samples import Array
from rb_sim.mechanics.systems.translation import TranslatingBody
from rb_sim.scene.compiled import Compiled


class Exact(NamedTuple):
    """The exact motion of one compiled system."""

    name: str
    """what it is, and the source."""
    coordinates: Callable[[Array], Array]
    """times (n,) [s] -> coordinates y (n, len y) of the system."""


# Uniform acceleration: p = p0 + v0 t + g t^2 / 2, of a body that gravity alone acts on.


def only_gravity(effects: tuple[Any, ...]) -> bool:
    """Whether no effect but uniform gravity acts."""
    return all(isinstance(row, GravityRow) for row in effects)


def gravity_of(effects: tuple[Any, ...]) -> LongArray:
    """Sum of the accelerations [m/s^2], (3,)."""
    return sum((long(row.acceleration_W) for row in effects), np.zeros(3, dtype=Long))


def parabola(effects: tuple[Any, ...], p: Any, v: Any, t: LongArray) -> tuple[LongArray, LongArray]:
    """Position and velocity of C at times t from p and v at 0, (n, 3) each."""
    g, t = gravity_of(effects), t[:, None]
    return long(p) + long(v) * t + g * t * t / 2, long(v) + g * t


def falling_body(compiled: Compiled) -> Exact | None:
    """The exact motion of a body that does not turn, under gravity alone, or None."""
    system, y = compiled.system, compiled.y
    if not isinstance(system, TranslatingBody) or not only_gravity(system.effects):
        return None

    def coordinates(times: LongArray) -> LongArray:
        p, v = parabola(system.effects, y[0:3], y[3:6], long(times))
        return np.concatenate([p, v], axis=1).astype(float)

    return Exact("uniform acceleration", coordinates)
