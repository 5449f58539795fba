"""Gauss collocation of order 6 (3 stages): the structure-preserving method for long runs.

Symplectic and symmetric; it keeps every quadratic invariant of the equations exactly (Hairer,
Lubich, Wanner, Geometric Numerical Integration, section IV.2): |q|^2, and since the height of a
body point is quadratic in q, the energy of a free body and of a heavy top; elsewhere the energy
error stays bounded.  The step is `loops.methods.gauss6`.
"""

from __future__ import annotations

from typing import NamedTuple


class Gauss6(NamedTuple):
    """Fixed step [s]."""

    step: float
