"""An event of a contact as a message, to the last digit, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rb_sim.sinks import cdr
from rb_sim.sinks.cdr import stamp_of

if TYPE_CHECKING:
    from rb_sim.engine.samples import ContactEvent

_IMPULSE = ("impulse_x", "impulse_y", "impulse_z")


def event_message(event: ContactEvent) -> bytes:
    """The DiagnosticArray of an event."""
    impulse = zip(_IMPULSE, event.impulse, strict=True)
    values = {"t": repr(event.t), **{key: repr(value) for key, value in impulse}}
    return cdr.diagnostic(stamp_of(event.t), event.contact, event.kind, values)


def read_event(data: bytes) -> tuple[float, str, str, tuple[float, ...]]:
    """The fields of the event of a message. Raises ValueError for another message."""
    _, contact, kind, values = cdr.read_diagnostic(data)
    try:
        numbers = [float(values[key]) for key in ("t", *_IMPULSE)]
    except KeyError as missing:
        raise ValueError(f"an event without {missing}") from None
    return numbers[0], contact, kind, tuple(numbers[1:])
