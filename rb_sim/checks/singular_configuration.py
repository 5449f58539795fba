# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Singular configurations: constraints that become dependent on the way of a motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import Finding, RbSimError, SimulationError
from rb_sim.checks.check import Checker, CheckInput, Run
from rb_sim.checks.violation import coordinates
from rb_sim.contact.choose_motion import motion_of
from rb_sim.graph.machine import evaluate_rows
from rb_sim.mechanics.initial_projection import rows_left, rows_matrix
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.elimination import Dependent
from rb_sim.mechanics.systems.many_bodies import WIDTH
from rb_sim.numerics.vectors import quaternion_rate
from rb_sim.scene.compile import compile_motion
from rb_sim.scene.initial import part_of
from rb_sim.scene.place import InitialPlace

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, Indices, SampleBlock, SampleLayout
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

# The least number that a law gives, at many instants and states.


class LeastOf:
    """The least number of those that a law gives at many instants, 1 where none is below.

    What is not finite counts as 1. law: machine code, or a Python function of arrays.

    inputs: p. width: how many numbers it gives. located: whether its last two tell the least of
    them and which it is.
    """

    def __init__(self, law: Any, inputs: Any, width: int, located: bool) -> None:
        self._law, self._inputs, self._width, self._located = law, inputs, width, located

    def __call__(self, t: Any, y: Any) -> tuple[Any, Any]:
        """(the least, which) at every t (n,) with the rows of y (n, N), both contiguous."""
        rows = np.zeros((len(t), self._width))
        evaluate_rows(self._law, t, y, self._inputs, rows)
        rows[~np.isfinite(rows)] = 1.0
        if self._located:
            return rows[:, -2], rows[:, -1].astype(int)
        return np.minimum(rows.min(axis=1), 1.0), rows.argmin(axis=1)


# Where a figure s >= 0 of the motion passes through zero as |x| does, also between two samples.
#
# Around such a place s makes a V, which may be narrower than what a body turns by between two
# samples.  States between them are interpolated (cubic Hermite: places and velocities are known at
# both ends), so that s is looked at wherever the bodies have gone on by GRID, and around each
# minimum again and again, four times as fine each time.


GRID = 0.1
"""What bodies turn by, or go on by over the scene's length, between two looks at s [rad]."""
RESOLVED = 0.8
"""As GRID, between two samples: up to it interpolation is exact to 1e-3; above it states between
them are those of a motion beside, or samples have to show a V by themselves."""
MOST_BETWEEN = 1000
"""States of a motion beside between two samples."""
FINER = 2
"""Times that the surroundings of a minimum are looked at again, last in steps of GRID / 16."""
VANISHED = 1e-5
"""s at or below which it is zero at the place itself."""
OPEN = 1.3
"""Two lowest places of a V over one step of its sides; above, s has a minimum beside zero."""

Figure = Callable[["Array", "Array"], "tuple[Array, Indices]"]
"""s, and to which row it belongs, at (t (n,), y (n, 13 N))."""


Between = Callable[[float, "Array", "Array"], "Array | None"]
"""Rows of the motion at the times (n,) from the state y (13 N,) at t on; None where there is none.
"""


class Vanishing(NamedTuple):
    """Where s passes through zero."""

    at: float
    """[s]."""
    s: float
    """at the place next to it that was looked at."""
    row: int
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

    motion: Between | None = None
    """gives states of the motion itself between two samples."""

    def __init__(self, figure: Figure, length: float) -> None:
        self._look, self._length = figure, length
        self._fastest = 0.0
        """rate at which bodies turned, or went on over the scene's length, so far [1/s]."""
        self._t, self._y, self._s = np.zeros(0), np.zeros((0, 0)), np.zeros(0)
        """the last places that were looked at closely ..."""
        self._way = np.zeros(0)
        """... and the ways between them."""
        self._sample = np.zeros(0), np.zeros((0, 0))
        """the last one."""

    def add(self, t: Array, y: Array) -> Vanishing | None:
        """The next samples, and states between them, after what was looked at before.

        Returns the first place where s passes through zero, if there is one.
        """
        before, states = self._sample
        if len(before):
            t, y = np.append(before, t), np.append(states, y, 0)
        self._sample = t[-1:], y[-1:]
        for times, states in self._resolved(t, y):
            place = self._follow(times, states)
            if place is not None:
                return place
        return None

    def _resolved(self, t: Array, y: Array) -> Iterator[tuple[Array, Array]]:
        """The samples, each two with states of the motion between them where bodies turn by more
        than RESOLVED, or would at the greatest speed so far: samples far apart show neither."""
        self._fastest = max(self._fastest, float(self._rates(y).max()))
        ways = np.maximum(self._ways(t, y), self._fastest * np.diff(t))
        if self.motion is None or not (ways > RESOLVED).any():
            yield t, y
            return
        yield t[:1], y[:1]
        for k, way in enumerate(ways):
            here, there = slice(k, k + 1), slice(k + 1, k + 2)
            times, states = t[k : k + 2], y[k : k + 2]
            if not way <= RESOLVED:
                count = int(min(np.nan_to_num(way / RESOLVED), MOST_BETWEEN)) + 1
                inner = np.linspace(t[k], t[k + 1], count + 1)[1:-1]
                found = self.motion(float(t[k]), y[k], inner)
                if found is not None:
                    self._fastest = max(self._fastest, float(self._rates(found).max()))
                    times = np.concatenate([t[here], inner, t[there]])
                    states = np.concatenate([y[here], found, y[there]])
            yield times, states

    def _follow(self, t: Array, y: Array) -> Vanishing | None:
        """As `add`, of samples or of states of the motion, the first of which is that before."""
        times, states, ways = self._filled(t, y)
        s, _ = self._look(times, states)
        if len(self._t):
            times, states = np.append(self._t[:-1], times), np.append(self._y[:-1], states, 0)
            s, ways = np.append(self._s[:-1], s), np.append(self._way, ways)
        self._t, self._y, self._s, self._way = times[-3:], states[-3:], s[-3:], ways[-2:]
        return self._first(times, states, s, ways)

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
        p, fastest = _beside_middle(y.reshape(len(y), -1, WIDTH)[..., :3]), self._rates(y)
        jumped = np.abs(np.diff(p, axis=0)).max(axis=(1, 2)) / self._length
        return np.maximum(np.maximum(fastest[1:], fastest[:-1]) * np.diff(t), jumped)

    def _rates(self, y: Array) -> Array:
        """The greatest rate at which a body turns, or goes on over the scene's length [1/s]."""
        bodies = y.reshape(len(y), -1, WIDTH)
        v, w = _beside_middle(bodies[..., 7:10]), bodies[..., 10:13]
        turns, goes = (np.einsum("nbi,nbi->nb", x, x).max(axis=1) for x in (w, v))
        return np.sqrt(np.maximum(turns, goes / self._length**2))

    def _first(self, t: Array, y: Array, s: Array, ways: Array) -> Vanishing | None:
        """The first of the places where s passes through zero. ways: from each place to the
        next."""
        inner = s[1:-1]
        low = np.flatnonzero((inner < s[:-2]) & (inner <= s[2:])) + 1
        fine = low[np.maximum(ways[low - 1], ways[low]) <= RESOLVED]
        located = [
            k for k in suspects(s) if s[k] <= VANISHED or max(ways[k - 1 : k + 2]) > RESOLVED
        ]
        places = [self._located(t, y, s, k) for k in located[:1]]
        places += self._around(t, y, fine)
        return min(places, key=lambda place: place.at, default=None)

    def _around(self, t: Array, y: Array, low: Indices) -> list[Vanishing]:
        """The first place beside the minima at `low` where s passes through zero."""
        if not len(low):
            return []
        here = t[low[:, None] + [-1, 0, 1]]
        for _ in range(FINER):
            here = np.linspace(here[:, 0], here[:, -1], 9, axis=1)
            k = low[:, None] - (here < t[low][:, None])
            share = (here - t[k]) / (t[k + 1] - t[k])
            states = between(t, y, k.ravel(), share.ravel())[1]
            found = self._look(here.ravel(), states)[0].reshape(here.shape)
            looked, middle = here, found[:, 1:-1].argmin(axis=1) + 1
            here = np.take_along_axis(here, middle[:, None] + [-1, 0, 1], axis=1)
        there = states.reshape(*looked.shape, -1)
        for i in np.flatnonzero(suspected(found).any(axis=1))[:1]:
            return [self._located(looked[i], there[i], found[i], suspects(found[i])[0])]
        return []

    def _located(self, t: Array, y: Array, s: Array, k: int) -> Vanishing:
        """The place k, or one after it."""
        near, at = k, float(t[k])
        if s[k] > VANISHED:
            b, c = s[k], s[k + 1]
            at += float((t[k + 1] - t[k]) * b / (b + c))
            near = k if b <= c else k + 1
        row = self._look(t[near : near + 1], y[near : near + 1])[1][0]
        around = slice(max(0, near - 4), near + 5)
        return Vanishing(at, float(s[near]), int(row), t[around], y[around])


def _beside_middle(x: Array) -> Array:
    """Vectors (n, N, 3) less their mean over the bodies; that of one body alone."""
    return x - x.sum(axis=1, keepdims=True) / x.shape[1] if x.shape[1] > 1 else x


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


# Whether constraints become dependent during a run: a singular configuration.
#
# Let s be the root of the least pivot of A = G M^-1 G^T relative to its diagonal element, over the
# rows that were independent at the start.  Where the rows lose rank s passes through zero as |x|
# does, so that around a singular configuration the samples of s make a V whose two lowest add up to
# one step of its sides.  The motion beyond it is not unique.
#
# Where rows depend on each other for good some are left out, in loops those that are chosen after
# each step: s is of the best choice, then.  Where the choice is that of the start (long loops),
# those that are kept may lose rank on the way although all together do not: the laws decide, but
# the choice is a bad one there and the motion loses digits.  The two are distinguished by the
# eigenvalues of A over all rows.
#
# States between samples are looked at, too (see above), where bodies turn by much from one to
# the next.


MOST_ROWS = 120
"""Rows up to which a scene is checked: the law that tells s is traced as a whole."""

UNDECIDED = (
    "the motion beyond is not unique; end the run before, or change lengths or drives to avoid it"
)


class SingularConfiguration(NamedTuple):
    """Where rows came to depend on each other."""

    t: float
    least: float
    """s at the sample next to it."""
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


def rank(run: Run) -> Checker:
    """The first singular configuration."""
    followed: Conditioning | None = None

    def look(seen: CheckInput) -> Iterator[Finding]:
        nonlocal followed
        if followed is None:  # its laws are made where samples come
            followed = Conditioning(*run)
        followed.add(seen.block, seen.effort.between)
        if followed.found is not None:
            yield followed.found.finding

    return look


class Conditioning:
    """Follows s over the samples of a run; `found`: its first singular configuration, or None.

    compiled: the scene as it is run; None, or one in reduced coordinates, has it compiled anew.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self.found: SingularConfiguration | None = None
        self._layout, self._scene = layout, scene
        self._checked_rows: list[int] = []
        """rows of which s tells."""
        self._kept_rows: list[int] = []
        self._laws: list[LeastOf] = []
        if not layout.contacts and has_loops(scene):
            self._make(scene, compiled)

    def _make(self, scene: Scene, compiled: Compiled | None) -> None:
        """Make the laws of the shares of the pivots, where they can be made and are not long."""
        if compiled is None or compiled.reduced:
            try:
                compiled = compile_motion(scene.with_options(project_initial=True), "maximal")
            except RbSimError:
                return
        system, laws = compiled.system, compiled.laws
        if not 0 < compiled.rows <= MOST_ROWS or not isinstance(laws, MultiBodyLaws):
            return
        left_out = Dependent(compiled.dependent.rows | set(laws.changing))
        self._kept_rows, law = rows_left(system, left_out)
        inputs = np.array([*laws.inputs.values(system, 0.0), 0.0])
        if self._kept_rows:
            self._laws.append(LeastOf(law, inputs, len(self._kept_rows), located=False))
        if laws.choice is not None:
            self._laws.append(LeastOf(laws.choice, inputs, len(laws.changing) + 2, located=True))
        self._system = system
        self._follower = Follower(self.shares, system.length)
        self._checked_rows = [*self._kept_rows, *laws.changing]
        self._rank = len(self._checked_rows) - laws.inputs.chosen.count(0.0)

    @property
    def is_needed(self) -> bool:
        """Whether there is something to look at, and nothing has been found."""
        return bool(self._laws) and self.found is None

    def add(self, block: SampleBlock, between: Between | None = None) -> None:
        """The next samples. between: gives the motion between them."""
        if not self.is_needed or not len(block):
            return
        self._follower.motion = between
        place = self._follower.add(block.t, coordinates(block, slice(None)))
        if place is not None:
            owner = self._owner(self._checked_rows[place.row])
            self.found = SingularConfiguration(place.at, place.s, owner, self._others_hold(place))

    def _owner(self, row: int) -> str:
        """The constraint to which the row belongs."""
        place = InitialPlace(self._scene)
        specs: dict[str, Any] = dict(self._scene.constraints)
        owners = [name for name, spec in specs.items() for _ in spec.parts(place)]
        return owners[part_of(self._system, row)]

    def located(self, t: float, least: float, row: int) -> SingularConfiguration:
        """The singular configuration at t where s of this row comes to zero."""
        return SingularConfiguration(t, least, self._owner(self._checked_rows[row]))

    def shares(self, t: Array, y: Array) -> tuple[Array, Indices]:
        """s and the row to which it belongs at every sample; 1 where it is no number."""
        y, t = np.ascontiguousarray(y), np.ascontiguousarray(t)
        least, row = self._laws[0](t, y)
        if len(self._laws) > 1:
            pivots, numbers = self._laws[1](t, y)
            row = np.where(pivots < least, len(self._kept_rows) + numbers, row)
            least = np.minimum(pivots, least)
        elif not self._kept_rows:
            row = len(self._kept_rows) + row
        return np.sqrt(np.maximum(least, 0.0)), row

    def _others_hold(self, place: Vanishing) -> bool:
        """True where rows were left out and all together keep their rank around the place."""
        rank = self._rank
        if rank == len(self._system.row_table) or len(place.t) < 4:
            return False
        with np.errstate(all="ignore"):
            pairs = zip(place.t, place.y, strict=True)
            least = np.array([least_kept(self._system, t, y, rank) for t, y in pairs])
        return bool(np.isfinite(least).all()) and not suspects(least)


def least_kept(system: Any, t: float, y: Array, rank: int) -> float:
    """The root of the eigenvalue of A, scaled to a diagonal of ones, that is the least of the
    `rank` largest; nan where A is not finite."""
    matrix = rows_matrix(system, t, y)
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    if not np.isfinite(scaled).all():
        return float("nan")
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


def rows_between(run: Motion, t: float, y: Array, times: Array) -> Array | None:
    """Coordinates (n, 13 N) at the times of a motion like `run` from its state y at t on.

    None where the motion does not come so far or takes too long, with contacts, whose modes it
    would have to choose anew, and where its coordinates are others.
    """
    if run.compiled.reduced:
        return None
    rows = _rows_from(run, t, y, times)
    return rows[:, : len(y)] if len(rows) == len(times) else None


def _rows_from(run: Motion, t: float, y: Any, times: Array) -> Array:
    """Rows at the times of a motion like `run` from its state y at t on, as far as it comes."""
    beside, looks = motion_of(run.compiled, run.method), 0

    def look() -> None:
        nonlocal looks
        looks += 1
        if looks > MOST_LOOKS:
            raise SimulationError("the comparison motion takes too long")

    out = np.zeros((len(times), beside.width))
    if run.layout.contacts:
        return out[:0]
    try:
        beside.reset_beside(run, y, t)
        if run.layout.commanded:
            beside.change_law(run.system)
        beside.watch = look
        beside.run_to(times, out)
    except SimulationError:
        return out[: np.searchsorted(times, beside.time, side="right")]
    return out


# Whether a motion that cannot go on has come to a singular configuration, which no step mends.
#
# There s of `singular_configuration` falls to zero: as |x| where the motion passes a change point,
# as the root of x where a drive comes to the end of its way.  The last states tell
# which of the two, and where.


LAST, BETWEEN = 4, 8
"""Samples, and states between the last of them and the end of the last step, that are looked at,
and others that are each half as far from the end as the one before, down to a step and below."""

STEPS = 2.0
"""Steps after the last state in which s has to come to zero, fixed ones, or of those states."""


def singular_end(simulation: Any, t: Array, rows: Array) -> SingularConfiguration | None:
    """The singular configuration at which the run of a Simulation has failed, if it is one.

    t, rows: its last samples.
    """
    conditioning = Conditioning(simulation.scene, simulation.layout, simulation.compiled)
    if not conditioning.is_needed or not len(t):
        return None
    run = simulation._motion
    t, rows = t[-LAST:], rows[-LAST:]
    end, step = run.frontier
    if end > t[-1]:
        gap = end - t[-1]
        halvings = math.log2(gap / step) if gap > step > 0.0 else 0.0
        ever_closer = end - gap * 0.5 ** np.arange(1, BETWEEN + math.ceil(halvings))
        between = np.union1d(np.linspace(t[-1], end, BETWEEN + 1)[1:], ever_closer)
        found = _rows_from(run, run.time, run.coordinates, between)
        t, rows = np.append(t, between[: len(found)]), np.concatenate([rows, found])
    width = 13 * len(simulation.layout.bodies)
    with np.errstate(all="ignore"):
        s, row = conditioning.shares(t, rows[:, :width])
    at = zero_of(t, s, end + STEPS * (getattr(run.method, "step", None) or step))
    return None if at is None else conditioning.located(at, float(s[-1]), int(row[-1]))


def zero_of(t: Array, s: Array, until: float) -> float | None:
    """Where s (n,), falling over three of the times in turn, comes to zero not after `until`."""
    for k in range(len(t) - 3, -1, -1):
        (a, b, c), times = s[k : k + 3], t[k : k + 3]
        if not (a > b > c and np.isfinite(a)):
            continue
        by = [_line(times, np.array([a, b, c]) ** power) for power in (1, 2)]
        _, at = min(by)
        if times[2] <= at <= max(until, times[2] + STEPS * (times[2] - times[1])):
            return at
    return None


def _line(t: Array, x: Array) -> tuple[float, float]:
    """By how much the third place is off the line through the other two, over what it falls; where
    the line through the last two is zero."""
    slope, last = np.diff(x) / np.diff(t)
    off = abs(last - slope) / abs(last)
    return float(off), float(t[2] - x[2] / last)
