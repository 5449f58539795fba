"""Attitude from a spin that is known in closed form: dq/dt = w(t) q / 2, by power series.

w(t) is entire, so its series and that of q converge at any length of panel; panels are short enough
for the rest after ORDER terms to be below the last digit.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rb_sim.accuracy.closed_forms.extended import Array, Long, long, np, product, unit

ORDER = 28
REACH = 0.5
"""Turn of a panel at most [rad]: REACH^ORDER / ORDER! is far below the last digit."""


class Spin(NamedTuple):
    """w(t) = steady + growing t + cosine cos(rate t) + sine sin(rate t), world axes [rad/s]."""

    steady: Array
    growing: Array
    cosine: Array
    sine: Array
    rate: Long

    def at(self, t: Array) -> Array:
        """w at times t, (n, 3)."""
        angle, t = (self.rate * t)[:, None], t[:, None]
        wave = self.cosine * np.cos(angle) + self.sine * np.sin(angle)
        return self.steady + self.growing * t + wave

    def series(self, t: Array) -> list[Array]:
        """Coefficients of w(t + s) in s, each (n, 3), at the times t."""
        angle = (self.rate * t)[:, None]
        cos, sin = np.cos(angle), np.sin(angle)
        found, factor = [], Long(1)
        for k in range(ORDER):
            found.append(factor * (self.cosine * cos + self.sine * sin))
            cos, sin = -sin, cos
            factor *= self.rate / (k + 1)
        found[0] = found[0] + self.steady + self.growing * t[:, None]
        found[1] = found[1] + self.growing
        return found


def steady_spin(w: Array) -> Spin:
    none = np.zeros(3, dtype=Long)
    return Spin(long(w), none, none, none, Long(0))


def attitudes(q0: Array, spin: Spin, t: Array) -> Array:
    """Quaternions at increasing times t from q0 at t[0], (n, 4)."""
    gaps = np.diff(t)
    if not len(gaps):
        return unit(q0)[None]
    fastest = np.sqrt((spin.at(t) ** 2).sum(axis=1)).max() + abs(spin.rate)
    pieces = max(1, math.ceil(float(gaps.max() * fastest / REACH)))
    width = np.repeat(gaps / pieces, pieces)
    starts = (t[:-1, None] + np.arange(pieces) * (gaps / pieces)[:, None]).ravel()
    turns = panel_turns(spin, starts, width)
    q, found = unit(q0), [unit(q0)]
    for i, turn in enumerate(turns):
        q = unit(product(turn, q))
        if (i + 1) % pieces == 0:
            found.append(q)
    return np.stack(found)


def panel_turns(spin: Spin, t: Array, width: Array) -> Array:
    """Quaternions of the turns from t to t + width, (n, 4)."""
    rates = [np.concatenate([w, np.zeros_like(w[:, :1])], axis=1) for w in spin.series(t)]
    terms: list[Array] = [np.tile(long([0, 0, 0, 1]), (len(t), 1))]
    total, power = terms[0], np.ones_like(width)
    for k in range(ORDER):
        products = [product(rates[j], terms[k - j]) for j in range(k + 1)]
        following = np.sum(products, axis=0) / (2 * (k + 1))
        terms.append(following)
        power = power * width
        total = total + following * power[:, None]
    return total
