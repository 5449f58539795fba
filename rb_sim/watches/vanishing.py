"""Where a figure s >= 0 of the motion passes through zero as |x| does, also between two samples.

Around such a place s makes a V, which may be narrower than what a body turns by between two
samples.  States between them are interpolated (cubic Hermite: places and velocities are known at
both ends), so that s is looked at wherever the bodies have gone on by GRID, and around each minimum
again and again, four times as fine each time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.engine.systems.many_bodies import WIDTH
from rb_sim.maths.vectors import quaternion_rate

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, Indices

GRID = 0.1
"""What bodies turn by, or go on by over the scene's length, between two looks at s [rad]."""
RESOLVED = 0.8
"""As GRID, between two samples: up to it interpolation is exact to 1e-3; above it samples have to
show a V by themselves."""
FINER = 2
"""Times that the surroundings of a minimum are looked at again, last in steps of GRID / 16."""
KEPT = 4
"""Looks at a glance that are kept for the next samples."""
CALL = 40
"""What a look at many places costs besides, in those of one: most is Python."""
MOST_STRIDE = 8
"""The longest stride at which those are told."""
FALLS = 0.8
"""Share of a minimum to which the next look has to find it lower; above, it is a smooth one."""
NEAR = 0.2
"""Share of its surroundings below which a minimum may be that of a V in any case."""
VANISHED = 1e-5
"""s at or below which it is zero at the place itself."""
OPEN = 1.3
"""Two lowest places of a V over one step of its sides; above, s has a minimum beside zero."""

Figure = Callable[["Array", "Array"], "tuple[Array, Indices]"]
"""s, and to which line it belongs, at (t (n,), y (n, 13 N))."""


class Vanishing(NamedTuple):
    """Where s passes through zero."""

    at: float
    """[s]."""
    s: float
    """at the place next to it that was looked at."""
    line: int
    t: Array
    """the places around it that were looked at [s] ..."""
    y: Array
    """... and the states there."""


def suspects(s: Array) -> list[int]:
    """Places at which s is zero, or after which it passes through zero."""
    return np.flatnonzero(suspected(s)).tolist()


def suspected(s: Array) -> np.ndarray:
    """Whether s (..., n) is zero at a place, or passes through zero after it; shape (..., n)."""
    found = s <= VANISHED
    if s.shape[-1] > 3:
        a, b, c, d = s[..., :-3], s[..., 1:-2], s[..., 2:-1], s[..., 3:]
        found[..., 1:-2] |= (b < a) & (c < d) & (b + c <= OPEN * np.maximum(a - b, d - c))
    return found


class Follower:
    """Follows s along the samples of a motion."""

    def __init__(self, figure: Figure, length: float) -> None:
        self._figure, self._length = figure, length
        self._t, self._y, self._s = np.zeros(0), np.zeros((0, 0)), np.zeros(0)
        """the last places that were looked at closely ..."""
        self._way = np.zeros(0)
        """... and the ways between them."""
        self._samples = np.zeros(0), np.zeros((0, 0))
        """the last samples."""
        self._rough = np.zeros(0)
        """s at the last samples that `clear` has looked at."""
        self.spent = 0
        """what looks have cost so far, in those of one place."""

    def _look(self, t: Array, y: Array) -> tuple[Array, Indices]:
        self.spent += CALL + len(t)
        return self._figure(t, y)

    def clear(self, t: Array, y: Array, last: tuple[Array, Array]) -> bool:
        """Whether every so many of the next samples, (t, y), show nothing; all are done with then.

        last: the last of them, KEPT * MOST_STRIDE or fewer.
        """
        s = np.append(self._rough, self._look(t, y)[0])
        self._rough = s[-3:]
        if suspects(s):
            return False
        self._t, self._samples = self._t[:0], last
        return True

    def add(self, t: Array, y: Array, stride: int, between: bool = True) -> Vanishing | None:
        """The next samples: looked at closely, or with a stride above 1 at a glance.

        between: also between samples in a glance, which costs some times as much.
        Returns the first place where s passes through zero, if there is one.
        """
        last = -1 if stride == 1 else -KEPT * stride
        if len(self._samples[0]):
            before, states = self._samples
            t, y = np.append(before[last:], t), np.append(states[last:], y, 0)
        self._samples = t[-KEPT * MOST_STRIDE :], y[-KEPT * MOST_STRIDE :]
        return self._closely(t, y) if stride == 1 else self._at_a_glance(t, y, stride, between)

    def _closely(self, t: Array, y: Array) -> Vanishing | None:
        """All samples, and states between them; goes on from what was looked at closely before."""
        times, states, ways = self._filled(t, y)
        s, _ = self._look(times, states)
        if len(self._t):
            times, states = np.append(self._t[:-1], times), np.append(self._y[:-1], states, 0)
            s, ways = np.append(self._s[:-1], s), np.append(self._way, ways)
        self._t, self._y, self._s, self._way = times[-3:], states[-3:], s[-3:], ways[-2:]
        return self._first(times, states, s, ways)

    def _at_a_glance(self, t: Array, y: Array, stride: int, between: bool) -> Vanishing | None:
        """Every stride-th sample, those around a suspect, and, if between, closely the last ones,
        as far back as as many places go once more."""
        rough, states = t[::stride], y[::stride]
        s, _ = self._look(rough, states)
        if between:
            found = self._first(rough, states, s, self._ways(rough, states), sure=True)
            if found is not None:
                return found
        looks = [slice(max(0, (k - 2) * stride), (k + 3) * stride + 1) for k in suspects(s)]
        if between:
            most = max(4, len(rough))
            last = slice(-most - 1, None)  # each of them goes by one part at least
            parts = np.cumsum(parts_of(self._ways(t[last], y[last]))[::-1]) <= most
            looks.append(slice(len(t) - 1 - int(parts.sum()), None))
        for part in looks:
            self._t = self._t[:0]
            found = self._closely(t[part], y[part])
            if found is not None:
                return found
        return None

    def _filled(self, t: Array, y: Array) -> tuple[Array, Array, Array]:
        """The samples and states between them, and the way from each of these to the next."""
        ways = self._ways(t, y)
        parts = parts_of(ways)
        if len(t) < 2 or parts.max() == 1:
            return t, y, ways
        k = np.repeat(np.arange(len(parts)), parts)
        step = np.arange(len(k)) - np.repeat(np.cumsum(parts) - parts, parts)
        times, states = np.append(t[k], t[-1:]), np.append(y[k], y[-1:], 0)
        inner = np.flatnonzero(step)
        k, share = k[inner], step[inner] / parts[k[inner]]
        times[inner], states[inner] = between(t, y, k, share)
        return times, states, np.repeat(ways / parts, parts)

    def _ways(self, t: Array, y: Array) -> Array:
        """What bodies turn by, or go on by over the scene's length, from each place to the next."""
        bodies = y.reshape(len(y), -1, WIDTH)
        p, v, w = bodies[..., :3], bodies[..., 7:10], bodies[..., 10:13]
        if bodies.shape[1] > 1:
            p, v = (x - x.sum(axis=1, keepdims=True) / x.shape[1] for x in (p, v))
        turns, goes = (np.einsum("nbi,nbi->nb", x, x).max(axis=1) for x in (w, v))
        fastest = np.sqrt(np.maximum(turns, goes / self._length**2))
        jumped = np.abs(np.diff(p, axis=0)).max(axis=(1, 2)) / self._length
        return np.maximum(np.maximum(fastest[1:], fastest[:-1]) * np.diff(t), jumped)

    def leave_out(self) -> None:
        """Samples follow that nobody looks at."""
        self._t, self._rough = self._t[:0], self._rough[:0]
        self._samples = np.zeros(0), np.zeros((0, 0))

    def _first(
        self, t: Array, y: Array, s: Array, ways: Array, sure: bool = False
    ) -> Vanishing | None:
        """The first of the places where s passes through zero.

        ways: from each place to the next. sure: only where s is zero at a place, or interpolation
        shows it.
        """
        inner = s[1:-1]
        low = np.flatnonzero((inner < s[:-2]) & (inner <= s[2:])) + 1
        fine = low[np.maximum(ways[low - 1], ways[low]) <= RESOLVED]
        told = [k for k in suspects(s) if s[k] <= VANISHED or max(ways[k - 1 : k + 2]) > RESOLVED]
        places = [self._told(t, y, s, k) for k in told if not sure or s[k] <= VANISHED][:1]
        places += self._around(t, y, s, fine)
        return min(places, key=lambda place: place.at, default=None)

    def _around(self, t: Array, y: Array, s: Array, low: Indices) -> list[Vanishing]:
        """The first place beside the minima at `low` where s passes through zero."""
        at, value, sides = low, s[low], np.minimum(s[low - 1], s[low + 1])
        here = t[low[:, None] + [-1, 0, 1]]
        for _ in range(FINER):
            if not len(at):
                return []
            here = np.linspace(here[:, 0], here[:, -1], 9, axis=1)
            k = at[:, None] - (here < t[at][:, None])
            share = (here - t[k]) / (t[k + 1] - t[k])
            states = between(t, y, k.ravel(), share.ravel())[1]
            found = self._look(here.ravel(), states)[0].reshape(here.shape)
            least = found.min(axis=1)
            shown = suspected(found).any(axis=1)
            on = (least < FALLS * value) | (least < NEAR * sides) | shown
            here, found, states = here[on], found[on], states.reshape(*here.shape, -1)[on]
            at, value, sides = at[on], least[on], np.minimum(found[:, 0], found[:, -1])
            middle = found[:, 1:-1].argmin(axis=1) + 1
            kept = here, found, states
            here = np.take_along_axis(here, middle[:, None] + [-1, 0, 1], axis=1)
        for times, some, there in zip(*kept, strict=True):
            for k in suspects(some)[:1]:
                return [self._told(times, there, some, k)]
        return []

    def _told(self, t: Array, y: Array, s: Array, k: int) -> Vanishing:
        """The place k, or one after it."""
        near, at = k, float(t[k])
        if s[k] > VANISHED:
            b, c = s[k], s[k + 1]
            at += float((t[k + 1] - t[k]) * b / (b + c))
            near = k if b <= c else k + 1
        line = self._look(t[near : near + 1], y[near : near + 1])[1][0]
        around = slice(max(0, near - 4), near + 5)
        return Vanishing(at, float(s[near]), int(line), t[around], y[around])


def parts_of(ways: Array) -> Indices:
    """Into how many parts the way from each sample to the next is to be taken."""
    return np.where(ways <= RESOLVED, np.ceil(ways / GRID), 1.0).astype(int).clip(1)


def between(t: Array, y: Array, k: Indices, share: Array) -> tuple[Array, Array]:
    """(times, states) by so much of the way from place k of (t, y) to the next (cubic Hermite)."""
    bodies = y.reshape(len(y), -1, WIDTH)
    one, two, x = bodies[k], bodies[k + 1], share[:, None, None]
    span = (t[k + 1] - t[k])[:, None, None]
    found = one + x * (two - one)  # velocities
    h = x * x * (3.0 - 2.0 * x), x * (1.0 - x) ** 2 * span, x * x * (x - 1.0) * span

    def placed(a: Array, b: Array, da: Array, db: Array) -> Array:
        return a + h[0] * (b - a) + h[1] * da + h[2] * db

    found[..., :3] = placed(one[..., :3], two[..., :3], one[..., 7:10], two[..., 7:10])
    p, q = one[..., 3:7], two[..., 3:7]
    q = np.where((p * q).sum(axis=2, keepdims=True) < 0.0, -q, q)
    turned = placed(p, q, _quaternion_rate(p, one), _quaternion_rate(q, two))
    found[..., 3:7] = turned / np.linalg.norm(turned, axis=2, keepdims=True)
    return t[k] + share * (t[k + 1] - t[k]), found.reshape(len(k), -1)


def _quaternion_rate(q: Array, bodies: Array) -> Array:
    """dq/dt of all bodies, shape (n, N, 4)."""
    parts = (tuple(np.moveaxis(x, -1, 0)) for x in (q, bodies[..., 10:13]))
    return np.stack(quaternion_rate(*parts), axis=-1)
