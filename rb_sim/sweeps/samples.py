"""What an output expression sees of a run: its samples, by the names used everywhere else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rb_sim.catalogue.spec import one_of
from rb_sim.columns import QUANTITIES
from rb_sim.sweeps.expressions import one_a_sample
from rb_sim.trajectory import Trajectory

BY_BODY = tuple(q.name for q in QUANTITIES if q.along == "body")
WHOLE_RUN = ("t", *(q.name for q in QUANTITIES if not q.along and not q.components))
MAPPINGS = ("reaction", "contact_state")
"""Names that expressions take further by the name of a constraint."""

EVENT_KINDS = (
    *("ambiguous", "closes", "impact", "jams", "leaps", "opens", "rests", "reverses", "rolls"),
    *("slack", "slips", "spins", "sticks", "stops rolling", "stops spinning", "taut"),
)
"""What can happen at a contact (see rb_sim.contact.events.journal)."""

COMPONENTS = {q.name: (q.components, q.unit) for q in QUANTITIES if q.name in BY_BODY}
"""Components and unit of each quantity of a body."""


def names(run: Trajectory) -> dict[str, Any]:
    """Arrays over time: of the whole run, by body, by reaction and by contact."""
    columns: dict[str, Any] = {name: getattr(run.block, name) for name in WHOLE_RUN}
    if not run.layout.contacts:
        del columns["contact_work"]
    columns |= {name: dict(getattr(run, name)) for name in BY_BODY}
    columns["reaction"] = {name: reaction._asdict() for name, reaction in run.reaction.items()}
    if run.layout.contacts:
        columns["contact_state"] = dict(run.contact_state)
    return columns


def functions(run: Trajectory) -> dict[str, Callable[..., Any]]:
    """What an expression may call of this very run."""

    def times(contact: str, kind: str) -> np.ndarray:
        """Instants of the events of that kind at that contact [s]."""
        _known(contact, run.layout.contacts, "contact")
        _known(kind, EVENT_KINDS, "kind of event")
        return np.array([e.t for e in run.events if e.contact == contact and e.kind == kind])

    def event_time(contact: str, kind: str, number: float = 1.0) -> float:
        """The instant of the event of that number, counted from 1; NaN if there is none [s]."""
        if not (number >= 1 and number == int(number)):
            raise ValueError(f"got the number {number:g}; must be a whole number >= 1")
        found = times(contact, kind)
        i = int(number) - 1
        return float(found[i]) if 0 <= i < len(found) else float("nan")

    def event_count(contact: str, kind: str) -> float:
        return float(len(times(contact, kind)))

    def integral(x: Any) -> float:
        """Over time, by the trapezoidal rule."""
        x = one_a_sample(np.asarray(x, dtype=float))
        return float(np.sum(0.5 * (x[1:] + x[:-1]) * np.diff(run.t)))

    def time_of(condition: Any) -> float:
        """The first sample at which the condition holds; NaN if none [s]."""
        found = np.flatnonzero(one_a_sample(np.asarray(condition)))
        return float(run.t[found[0]]) if len(found) else float("nan")

    return {
        "event_time": event_time,
        "event_count": event_count,
        "integral": integral,
        "time_of": time_of,
    }


def _known(name: str, allowed: tuple[str, ...], what: str) -> None:
    if not allowed:
        raise ValueError(f"got the {what} {name!r}; the scene has none")
    if name not in allowed:
        raise ValueError(f"got the {what} {name!r}; must be {one_of(name, allowed)}")


def final_state(run: Trajectory) -> dict[str, float]:
    """Every component of the last sample of every body, by `quantity.body.component`."""
    state = {}
    for quantity in BY_BODY:
        by_body: Mapping[str, Any] = getattr(run, quantity)
        for body, values in by_body.items():
            for i, component in enumerate(COMPONENTS[quantity][0]):
                state[f"{quantity}.{body}.{component}"] = float(values[-1, i])
    return state


def final_units(bodies: tuple[str, ...]) -> dict[str, str]:
    """The columns of `final_state` with their units, in the same order."""
    return {
        f"{quantity}.{body}.{component}": unit
        for quantity, (components, unit) in COMPONENTS.items()
        for body in bodies
        for component in components
    }
