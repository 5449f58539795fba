"""Commands: the wrenches that bodies are commanded, held until the next one comes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rb_sim.catalogue.spec import STRONGEST
from rb_sim.catalogue.types import Placed
from rb_sim.engine.samples import Array
from rb_sim.errors import RbSimError
from rb_sim.scene.compiled import Compiled


class Commands:
    """What the bodies of a compiled scene are commanded; nothing at first."""

    def __init__(self, compiled: Compiled) -> None:
        self._effects = compiled.commands
        self._layout = compiled.layout
        self.clear()

    def clear(self) -> None:
        """Nothing is commanded any more."""
        self._held = {name: np.zeros((2, 6)) for name in self._layout.commanded}
        self.any = False
        """whether one of them is not zero."""

    def read(self, body: str, force: Sequence[float], torque: Sequence[float], frame: str) -> Array:
        """A command as [force, torque] in world and in body axes, shape (2, 6).

        Raises RbSimError for a body that takes no command, an unknown frame, a value not finite
        or beyond STRONGEST.
        """
        if body not in self._effects:
            allowed = ", ".join(self._held) or "none (no commanded_wrench effect)"
            raise RbSimError(f"body: got {body!r}; bodies that take a command: {allowed}")
        if frame not in ("world", "body"):
            raise RbSimError(f"frame: got {frame!r}; must be 'world' or 'body'")
        held = np.zeros((2, 6))
        row = held[0 if frame == "world" else 1]
        row[:3], row[3:] = _vector("force", force), _vector("torque", torque)
        return held

    def hold(self, body: str, held: Array) -> bool:
        """Command a body what `read` gave; whether that is another command than before."""
        if np.array_equal(held, self._held[body]):
            return False
        self._held[body] = held
        self.any = any(values.any() for values in self._held.values())
        return True

    def in_law(self, system: Any, effects: dict[str, tuple[int, ...]] | None = None) -> Any:
        """The system under these commands. effects: of each body, the indices of those that take
        its command; None: as in the compiled scene."""
        rows = list(system.effects)
        for body, indices in (self._effects if effects is None else effects).items():
            world, own = self._held[body].tolist()
            values = tuple(map(tuple, (world[:3], world[3:], own[:3], own[3:])))
            for i in indices:
                rows[i] = _with_command(rows[i], values)
        return system._replace(effects=tuple(rows))

    def applied(self, body: Array) -> Array:
        """Commanded wrenches in world axes, shape (n, M, 6), where the bodies are in `body`: poses
        and twists, shape (n, N, 13)."""
        names = self._layout.commanded
        command = np.zeros((len(body), len(names), 6))
        if not self.any:
            return command
        for m, name in enumerate(names):
            world, own = self._held[name]
            command[:, m] = world
            if own.any():
                q = body[:, self._layout.bodies.index(name), 3:7]
                for k in (0, 3):
                    command[:, m, k : k + 3] += _turned(q, own[k : k + 3])
        return command


def _vector(name: str, value: Sequence[float]) -> Array:
    """Raises RbSimError unless it is three numbers, none beyond STRONGEST."""
    try:
        vector = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not (np.abs(vector) <= STRONGEST).all():
        raise RbSimError(
            f"{name}: got {value!r}; must be 3 finite numbers, none beyond {STRONGEST:g}"
        )
    return vector


def _with_command(effect: Any, values: tuple[Any, ...]) -> Any:
    """The command row (or the placed one) with new held wrenches."""
    if isinstance(effect, Placed):
        return effect._replace(row=_with_command(effect.row, values))
    return effect._replace(
        force_W=values[0], torque_W=values[1], force_B=values[2], torque_B=values[3]
    )


def _turned(q: Array, a: Array) -> Array:
    """R(q) a for quaternions (n, 4) and one vector (3,)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)
