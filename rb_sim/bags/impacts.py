"""Which bodies an impact of a run of ours strikes: all that constraints join to those it is of."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rb_sim.engine.samples import ContactEvent
from rb_sim.scene.schema import Scene


class Impacts:
    """The bodies of each constraint, and those that others join to them."""

    def __init__(self, scene: Scene) -> None:
        self._joined = {name: {name} for name in scene.bodies}
        self._of: dict[str, str] = {}
        for name, spec in scene.constraints.items():
            body, parent = spec.body, getattr(spec, "parent", None)  # type: ignore[attr-defined]
            self._of[name] = body
            if parent is not None and self._joined[body] is not self._joined[parent]:
                whole = self._joined[body] | self._joined[parent]
                self._joined |= dict.fromkeys(whole, whole)

    def times(self, events: Iterable[ContactEvent]) -> dict[str, np.ndarray]:
        """When each body is struck [s], those that are."""
        found: dict[str, set[float]] = {}
        for event in events:
            if any(event.impulse):
                for body in self._joined[self._of[event.contact.partition("/")[0]]]:
                    found.setdefault(body, set()).add(event.t)
        return {body: np.array(sorted(times)) for body, times in found.items()}
