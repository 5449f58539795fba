"""Semi-implicit (symplectic) Euler, order 1: the game engines' method, kept as the baseline.

Velocities first, v1 = v0 + h a(q0, v0), then the configuration with the new velocities; the step
is `loops.methods.euler`.
"""

from __future__ import annotations

from typing import NamedTuple


class Euler(NamedTuple):
    """Fixed step [s]."""

    step: float
