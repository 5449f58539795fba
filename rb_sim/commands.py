"""Commands: the wrenches that bodies are commanded, held until the next one comes."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan
from typing import Any, NamedTuple

import numpy as np

from rb_sim.catalogue.spec import STRONGEST
from rb_sim.catalogue.types import Placed
from rb_sim.engine.samples import Array
from rb_sim.errors import RbSimError
from rb_sim.scene.compiled import Compiled

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


class HeldWrench(NamedTuple):
    """What a body is commanded, about its origin: in world axes (W), or in its own (B)."""

    force_W: Vector
    """[N]."""
    torque_W: Vector
    """[N m]."""
    force_B: Vector
    torque_B: Vector

    @property
    def in_body(self) -> bool:
        """Whether it turns with the body."""
        return any(self.force_B) or any(self.torque_B)


NOTHING = HeldWrench(ZERO, ZERO, ZERO, ZERO)


class Commands:
    """What the bodies of a compiled scene are commanded; nothing at first."""

    def __init__(self, compiled: Compiled) -> None:
        self._effects = compiled.commands
        self._layout = compiled.layout
        self.clear()

    def clear(self) -> None:
        """Nothing is commanded any more."""
        self._held = dict.fromkeys(self._layout.commanded, NOTHING)
        self.any = False
        """whether one of them is not zero."""

    def read(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str
    ) -> HeldWrench:
        """A command in the axes of "world" or "body".

        Raises RbSimError for a body that takes no command, an unknown frame, a value not finite
        or beyond STRONGEST.
        """
        if body not in self._effects:
            allowed = ", ".join(self._held) or "none (no commanded_wrench effect)"
            raise RbSimError(f"body: got {body!r}; bodies that take a command: {allowed}")
        if frame not in ("world", "body"):
            raise RbSimError(f"frame: got {frame!r}; must be 'world' or 'body'")
        wrench = _vector("force", force), _vector("torque", torque)
        return (
            HeldWrench(*wrench, ZERO, ZERO) if frame == "world" else HeldWrench(ZERO, ZERO, *wrench)
        )

    def hold(self, body: str, held: HeldWrench) -> bool:
        """Command a body what `read` gave; whether that is another command than before."""
        if held == self._held[body]:
            return False
        self._held[body] = held
        self.any = any(values != NOTHING for values in self._held.values())
        return True

    def in_law(self, system: Any, effects: dict[str, tuple[int, ...]] | None = None) -> Any:
        """The system under these commands. effects: of each body, the indices of those that take
        its command; None: as in the compiled scene."""
        rows = list(system.effects)
        for body, indices in (self._effects if effects is None else effects).items():
            for i in indices:
                rows[i] = _with_command(rows[i], self._held[body])
        return system._replace(effects=tuple(rows))

    def applied(self, body: Array) -> Array:
        """Commanded wrenches in world axes, shape (n, M, 6), where the bodies are in `body`: poses
        and twists, shape (n, N, 13)."""
        names = self._layout.commanded
        command = np.zeros((len(body), len(names), 6))
        if not self.any:
            return command
        for m, name in enumerate(names):
            held = self._held[name]
            command[:, m] = (*held.force_W, *held.torque_W)
            if held.in_body:
                q = body[:, self._layout.bodies.index(name), 3:7]
                for k, own in ((0, held.force_B), (3, held.torque_B)):
                    command[:, m, k : k + 3] += _turned(q, np.array(own))
        return command


def _vector(name: str, value: Sequence[float]) -> Vector:
    """Raises RbSimError unless it is three numbers, none beyond STRONGEST."""
    try:
        x, y, z = np.asarray(value, dtype=float).tolist()
        if max(abs(x), abs(y), abs(z)) <= STRONGEST and not isnan(x + y + z):
            return x, y, z
    except (TypeError, ValueError):
        pass
    raise RbSimError(f"{name}: got {value!r}; must be 3 finite numbers, none beyond {STRONGEST:g}")


def _with_command(effect: Any, held: HeldWrench) -> Any:
    """The command row (or the placed one) with new held wrenches."""
    if isinstance(effect, Placed):
        return effect._replace(row=_with_command(effect.row, held))
    return effect._replace(**held._asdict())


def _turned(q: Array, a: Array) -> Array:
    """R(q) a for quaternions (n, 4) and one vector (3,)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)
