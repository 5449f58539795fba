# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Singular configurations: constraints that become dependent on the way of a motion.

Let s be the root of the least pivot of A = G M^-1 G^T relative to its diagonal element, over the
rows that were independent at the start.  Where the rows lose rank s is zero; it falls as |x| where
a linkage passes a change point, as the root of x where a drive comes to the end of its way.  So
each minimum of s along the motion is bracketed, refined and compared with one bound, VANISHED.  The
motion beyond is not unique.

Where rows depend on each other for good some are left out, in loops those that are chosen after
each step: s is of the best choice, then.  Where the choice is that of the start (long loops), those
that are kept may lose rank on the way although all together do not: the laws decide, but the choice
is a bad one there and the motion loses digits.  The eigenvalues of A over all rows tell which.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import Finding, SimulationError
from rb_sim.checks.check import Look, Run, Seen
from rb_sim.checks.violation import coordinates, in_maximal_coordinates, owner_of
from rb_sim.contact.choose_motion import motion_of
from rb_sim.graph.machine import evaluate_rows
from rb_sim.integrate.quadrature import cubic_at
from rb_sim.mechanics.initial_projection import rows_left, rows_matrix
from rb_sim.mechanics.methods import build
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.elimination import Dependent
from rb_sim.mechanics.systems.many_bodies import WIDTH
from rb_sim.numerics.rotations import norms
from rb_sim.numerics.vectors import quaternion_rate
from rb_sim.scene.schema import DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from rb_sim.checks.check import Between
    from rb_sim.mechanics.samples import Array, Indices, SampleBlock, SampleLayout
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

VANISHED = 5e-3
"""s at or below which rows are dependent: interpolated states are exact to 1e-3, and a linkage that
is off a parallelogram by 1e-4 of its links comes to 2.5e-2."""

GRID = 0.1
"""What bodies turn by, or go on by over the scene's length, between two looks at s [rad]."""

RESOLVED = 0.8
"""As GRID, between two samples: up to it states between them are interpolated, exact to 1e-3; above
it they are those of a motion beside."""

MOST_BETWEEN = 1000
"""States of a motion beside between two samples."""

FINER = 4
"""Times that the surroundings of a minimum are looked at again, each time four times as fine."""

Figure = Callable[["Array", "Array"], "tuple[Array, Indices]"]
"""s, and to which row it belongs, at (t (n,), y (n, 13 N))."""


class Place(NamedTuple):
    """Where s comes to zero."""

    t: float
    """[s]."""
    y: Array
    row: int
    """to which s belongs."""


class Follower:
    """Follows s along a motion, from its samples and states between them.

    figure: gives s. length: of the scene [m].
    """

    def __init__(self, figure: Figure, length: float) -> None:
        self._look, self._length = figure, length
        self._fastest = 0.0
        """rate at which bodies turned, or went on over the scene's length, so far [1/s]."""
        self._last: tuple[Any, ...] = ()
        """t, y, s and row of the last two places that were looked at."""

    def add(self, t: Array, y: Array, motion: Between | None = None) -> Place | None:
        """The first place among the next samples, and after the last before, where s comes to zero.

        motion: gives states of the motion itself between two samples.
        """
        if self._last:
            t, y = np.append(self._last[0][-1:], t), np.append(self._last[1][-1:], y, 0)
        for times, states in self._resolved(t, y, motion):
            place = self._follow(*self._filled(times, states))
            if place is not None:
                return place
        return None

    def _resolved(
        self, t: Array, y: Array, motion: Between | None
    ) -> Iterator[tuple[Array, Array]]:
        """The samples, each two with states of the motion between them where bodies turn by more
        than RESOLVED, or would at the greatest speed so far: samples far apart show neither."""
        self._fastest = max(self._fastest, float(self._rates(y).max()))
        ways = np.maximum(self._ways(t, y), self._fastest * np.diff(t))
        if motion is None or not (ways > RESOLVED).any():
            yield t, y
            return
        for k, way in enumerate(ways):
            times, states = t[k : k + 2], y[k : k + 2]
            if not way <= RESOLVED:
                count = int(min(np.nan_to_num(way / RESOLVED), MOST_BETWEEN))
                inner, found = motion(float(t[k]), y[k], float(t[k + 1]), count)
                if len(found):
                    self._fastest = max(self._fastest, float(self._rates(found).max()))
                times = np.concatenate([times[:1], inner, times[1:]])
                states = np.concatenate([states[:1], found, states[1:]])
            yield times, states

    def _filled(self, t: Array, y: Array) -> tuple[Array, Array]:
        """The places, and interpolated ones between them so that all are at most GRID apart."""
        ways = self._ways(t, y)
        parts = np.where(ways <= RESOLVED, np.ceil(ways / GRID), 1.0).astype(int).clip(1)
        k = np.repeat(np.arange(len(parts)), parts)
        share = (np.arange(len(k)) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[k]
        times, states = np.append(t[k], t[-1:]), np.append(y[k], y[-1:], 0)
        inner = np.flatnonzero(share)
        if len(inner):
            times[inner], states[inner] = between(t, y, k[inner], share[inner])
        return times, states

    def _ways(self, t: Array, y: Array) -> Array:
        """What bodies turn by, or go on by over the scene's length, from each place to the next."""
        rates, p = self._rates(y), _beside_middle(y.reshape(len(y), -1, WIDTH)[..., :3])
        jumped = norms(np.diff(p, axis=0)).max(axis=1) / self._length
        return np.maximum(np.maximum(rates[1:], rates[:-1]) * np.diff(t), jumped)

    def _rates(self, y: Array) -> Array:
        """The greatest rate at which a body turns, or goes on beside the others over the scene's
        length [1/s]."""
        bodies = y.reshape(len(y), -1, WIDTH)
        v, w = _beside_middle(bodies[..., 7:10]), bodies[..., 10:13]
        return np.maximum(norms(w), norms(v) / self._length).max(axis=1)

    def _follow(self, t: Array, y: Array) -> Place | None:
        """The first of the places, or of those around a minimum, where s comes to zero."""
        places: tuple[Any, ...] = (t, y, *self._look(t, y))
        if self._last:
            places = tuple(np.append(a[:-1], b, 0) for a, b in zip(self._last, places, strict=True))
        self._last = tuple(each[-2:] for each in places)
        t, y, s, row = places
        for k in self._minima(t, y, s):
            place, least = self._lowest(t[k - 1 : k + 2], y[k - 1 : k + 2])
            if least <= VANISHED:
                return place
        for k in np.flatnonzero(s <= VANISHED)[:1]:
            return Place(float(t[k]), y[k], int(row[k]))
        return None

    def _minima(self, t: Array, y: Array, s: Array) -> list[int]:
        """Places where s is least and may be zero between them and the next: it is not above what
        its slope takes away there.  Only where states between them can be interpolated."""
        spans, near = np.diff(t), self._ways(t, y) <= RESOLVED
        steep, here = np.abs(np.diff(s) / spans), s[1:-1]
        fall = np.maximum(spans[1:], spans[:-1]) * np.maximum(steep[1:], steep[:-1])
        low = (here < s[:-2]) & (here <= s[2:]) & (here <= fall) & near[1:] & near[:-1]
        return (np.flatnonzero(low) + 1).tolist()

    def _lowest(self, t: Array, y: Array) -> tuple[Place, float]:
        """The lowest place around the middle one of three, and s there."""
        times, place, least = t, Place(float(t[1]), y[1], 0), np.inf
        for _ in range(FINER):
            times = np.linspace(times[0], times[-1], 9)
            k = (times >= t[1]).astype(int)
            _, states = between(t, y, k, (times - t[k]) / (t[k + 1] - t[k]))
            s, row = self._look(times, states)
            i = int(s[1:-1].argmin()) + 1
            place, least = Place(float(times[i]), states[i], int(row[i])), float(s[i])
            times = times[i - 1 : i + 2]
        return place, least


def _beside_middle(x: Array) -> Array:
    """Vectors (n, N, 3) less their mean over the bodies; that of one body alone."""
    return x - x.mean(axis=1, keepdims=True) if x.shape[1] > 1 else x


def between(t: Array, y: Array, k: Indices, share: Array) -> tuple[Array, Array]:
    """(times, states) by so much of the way from place k of (t, y) to the next (cubic Hermite)."""
    bodies = y.reshape(len(y), -1, WIDTH)
    one, two, x = bodies[k], bodies[k + 1], share[:, None, None]
    width = (t[k + 1] - t[k])[:, None, None]
    found = one + x * (two - one)  # spins
    at, rate = slice(0, 3), slice(7, 10)
    place, slope = cubic_at(one[..., at], one[..., rate], two[..., at], two[..., rate], width, x)
    found[..., at], found[..., rate] = place, slope / width
    p, q = one[..., 3:7], two[..., 3:7]
    q = np.where((p * q).sum(axis=2, keepdims=True) < 0.0, -q, q)
    turned, _ = cubic_at(p, _quaternion_rate(p, one), q, _quaternion_rate(q, two), width, x)
    found[..., 3:7] = turned / np.linalg.norm(turned, axis=2, keepdims=True)
    return t[k] + share * (t[k + 1] - t[k]), found.reshape(len(k), -1)


def _quaternion_rate(q: Array, bodies: Array) -> Array:
    """dq/dt of all bodies, shape (n, N, 4)."""
    parts = (tuple(np.moveaxis(x, -1, 0)) for x in (q, bodies[..., 10:13]))
    return np.stack(quaternion_rate(*parts), axis=-1)


# Whether constraints become dependent during a run.


MOST_ROWS = 120
"""Rows up to which a scene is checked: the law that tells s is traced as a whole."""

UNDECIDED = (
    "the motion beyond is not unique; end the run before, or change lengths or drives to avoid it"
)


class SingularConfiguration(NamedTuple):
    """Where rows came to depend on each other."""

    t: float
    constraint: str
    too_many: bool = False
    """whether it is not all rows that lose rank, but those that were kept of too many."""

    @property
    def finding(self) -> Finding:
        """The finding that tells of it."""
        advice = UNDECIDED
        if self.too_many:
            advice = (
                "equations dropped as redundant at the start are needed here, so digits are lost; "
                "use a joint with fewer equations in this loop, or end the run before"
            )
        what = "number of constraint equations that become dependent"
        return Finding("singular configuration", self.t, 1.0, 0.0, what, self.constraint, advice)

    @property
    def refusal(self) -> str:
        """What a run that ends there says."""
        return (
            f"singular configuration at t = {self.t:.4g} s: constraint {self.constraint!r} loses "
            f"rank, and {UNDECIDED}"
        )


def rank(run: Run) -> Look:
    """The first singular configuration."""
    followed: Conditioning | None = None

    def look(seen: Seen) -> Iterator[Finding]:
        nonlocal followed
        if followed is None:  # its laws are made where samples come
            followed = Conditioning(*run)
        found = followed.add(seen.block, seen.effort.between)
        if found is not None:
            yield found.finding

    return look


class Conditioning:
    """Follows s over the samples of a run.

    compiled: the scene as it is run; None, or one in reduced coordinates, has it compiled anew.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self._scene = scene
        self._rows: list[int] = []
        """those of which s tells."""
        self._laws: list[tuple[Any, int, int]] = []
        """each law of the pivots, how many numbers it gives, and the place of its first in _rows.
        """
        if layout.contacts or not has_loops(scene):
            return
        if compiled is None or compiled.reduced:
            compiled = in_maximal_coordinates(scene)
        if compiled is not None and 0 < compiled.rows <= MOST_ROWS:
            self._make(compiled)

    def _make(self, compiled: Compiled) -> None:
        """Make the laws of the shares of the pivots, where they can be made."""
        system, laws = compiled.system, compiled.laws
        if not isinstance(laws, MultiBodyLaws):
            return
        kept, law = rows_left(system, Dependent(compiled.dependent.rows | set(laws.changing)))
        self._rows = [*kept, *laws.changing]
        if kept:
            self._laws.append((law, len(kept), 0))
        self._choice = laws.choice
        if laws.choice is not None:
            self._laws.append((laws.choice, len(laws.changing) + 2, len(kept)))
        self._system = system
        self._inputs = np.array([*laws.inputs.values(system, 0.0), 0.0])
        self._follower = Follower(self.shares, system.length)
        self._rank = len(self._rows) - laws.inputs.chosen.count(0.0)

    @property
    def able(self) -> bool:
        """Whether there is something to look at."""
        return bool(self._laws)

    def add(
        self, block: SampleBlock, between: Between | None = None
    ) -> SingularConfiguration | None:
        """The first singular configuration among the next samples. between: gives the motion
        between them."""
        if not len(block):
            return None
        return self.follow(block.t, coordinates(block, slice(None)), between)

    def follow(
        self, t: Array, y: Array, between: Between | None = None
    ) -> SingularConfiguration | None:
        """As `add`, of states (n, 13 N)."""
        if not self.able:
            return None
        with np.errstate(all="ignore"):
            place = self._follower.add(t, y, between)
            if place is None:
                return None
            too_many = least_kept(self._system, place.t, place.y, self._rank) > VANISHED
        owner = owner_of(self._scene, self._system, self._rows[place.row])
        return SingularConfiguration(place.t, owner, too_many)

    def shares(self, t: Array, y: Array) -> tuple[Array, Indices]:
        """s and the place in _rows to which it belongs at every sample; 1 where it is no number."""
        y, t = np.ascontiguousarray(y), np.ascontiguousarray(t)
        least, row = np.ones(len(t)), np.zeros(len(t), dtype=int)
        for law, width, first in self._laws:
            found = np.zeros((len(t), width))
            evaluate_rows(law, t, y, self._inputs, found)
            found[~np.isfinite(found)] = 1.0
            if law is self._choice:  # it tells the least itself, and which it is
                pivot, which = found[:, -2], found[:, -1].astype(int)
            else:
                pivot, which = found.min(axis=1), found.argmin(axis=1)
            row = np.where(pivot < least, first + which, row)
            least = np.minimum(pivot, least)
        return np.sqrt(np.maximum(least, 0.0)), row


def least_kept(system: Any, t: float, y: Array, rank: int) -> float:
    """The root of the eigenvalue of A, scaled to a diagonal of ones, that is the least of the
    `rank` largest; 0 where A is not finite."""
    matrix = rows_matrix(system, t, y)
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    if not np.isfinite(scaled).all():
        return 0.0
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(scaled)[-rank])))


def has_loops(scene: Scene) -> bool:
    """True unless the joints hang together as trees, whose rows cannot lose rank."""
    group: dict[str | None, str | None] = {}

    def root(name: str | None) -> str | None:
        while group.setdefault(name, name) != name:
            name = group[name]
        return name

    for spec in scene.constraints.values():
        first, second = root(spec.body), root(getattr(spec, "parent", None))  # type: ignore[attr-defined]
        if first == second:
            return True
        group[first] = second
    return False


# How a motion goes on from where it is, by another one beside it.


MOST_LOOKS = 100
"""Pieces of the comparison motion between two samples; it would take too long."""

HALVINGS = 20
"""States before the end of a motion that fails, each half as far from it as the one before."""


def motion_between(run: Motion, t: float, y: Array, end: float, count: int) -> tuple[Array, Array]:
    """Times between t and `end`, and coordinates (n, 13 N) there, of a motion like `run`, without
    contacts, from its state y at t on.

    It adapts its step: it comes as near to a singular configuration as numbers go, where a fixed
    step leaps over it. count: of the times; where the motion fails before the end they come ever
    closer to that.
    """
    method = run.method
    if getattr(method, "tolerance", None) is None:
        method = build("dopri853", step=None, tolerance=DEFAULT_TOLERANCE, largest_step=end - t)
    beside, times = motion_of(run.compiled, method), np.linspace(t, end, count + 2)[1:]
    rows = _rows_from(beside, run, t, y, times)
    if len(rows) > count:
        return times[:-1], rows[:-1]
    end = min(end, beside.frontier[0])
    closer = end - (end - t) * 0.5 ** np.arange(1, HALVINGS)
    times = np.union1d(times[times < end], closer[closer > t])
    rows = _rows_from(beside, run, t, y, times)
    return times[: len(rows)], rows


def _rows_from(beside: Motion, run: Motion, t: float, y: Array, times: Array) -> Array:
    """Coordinates (n, 13 N) at the times of a motion `beside` the run, from its state y at t on, as
    far as it comes."""
    looks, out = 0, np.zeros((len(times), beside.width))

    def look() -> None:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            raise SimulationError("the comparison motion takes too long")

    try:
        beside.reset_beside(run, y, t)
        if run.layout.commanded:
            beside.change_law(run.system)
        beside.watch = look
        beside.run_to(times, out)
    except SimulationError:
        out = out[: np.searchsorted(times, beside.time, side="right")]
    return out[:, : len(y)]


AT_THE_END = 32
"""States between the last sample and the end of a run that has failed."""

STEPS = 2.0
"""Steps after the one that failed in which s has to come to zero; of an adaptive method, times from
the last sample to there."""


def singular_end(simulation: Any, t: Array, rows: Array) -> SingularConfiguration | None:
    """The singular configuration at which the run of a Simulation has failed, if it is one: no step
    mends it.  t, rows: its last samples."""
    conditioning = Conditioning(simulation.scene, simulation.layout, simulation.compiled)
    if not conditioning.able or not len(t):
        return None
    run, begin = simulation._motion, float(t[-1])
    end, step = run.frontier
    end += STEPS * (getattr(run.method, "step", None) or max(step, end - begin))
    last = rows[-1:, : WIDTH * len(simulation.layout.bodies)]
    times, states = motion_between(run, begin, last[0], end, AT_THE_END)
    return conditioning.follow(np.append(t[-1:], times), np.append(last, states, 0))
