"""Time stepping as a method that scenes name; its steps are those of `contact.stepping`."""

from __future__ import annotations

from typing import NamedTuple


class TimeStepping(NamedTuple):
    """Fixed step [s]."""

    step: float
