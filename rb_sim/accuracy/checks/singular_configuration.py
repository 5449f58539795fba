# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Singular configurations: instants at which constraints become dependent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.check import Checker, CheckInput, Run
from rb_sim.accuracy.checks.violation import coordinates, owner_of
from rb_sim.base.errors import Finding, RbSimError, SimulationError
from rb_sim.compiler.graph.machine import evaluate_rows
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.initial_projection import rows_matrix
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.systems.many_bodies import WIDTH
from rb_sim.numerics.vectors import quaternion_rate
from rb_sim.scene.compile import compile_motion

if TYPE_CHECKING:
    from rb_sim.mechanics.compiled import Compiled
    from rb_sim.mechanics.samples import Array, Indices, SampleBlock, SampleLayout
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.schema import Scene


class LeastOf:
    """The least result of a law at many instants and states, at most 1.

    Results that are not finite count as 1. law: machine code, or a Python function of arrays;
    inputs: p; width: number of its results; located: whether the last two are their minimum and its
    index.
    """

    def __init__(self, law: Any, inputs: Any, width: int, located: bool) -> None:
        self._law, self._inputs, self._width, self._located = law, inputs, width, located

    def __call__(self, t: Any, y: Any) -> tuple[Any, Any]:
        """(least result, its index) at every t (n,) with the rows of y (n, N), both contiguous."""
        rows = np.zeros((len(t), self._width))
        evaluate_rows(self._law, t, y, self._inputs, rows)
        rows[~np.isfinite(rows)] = 1.0
        if self._located:
            return rows[:, -2], rows[:, -1].astype(int)
        return np.minimum(rows.min(axis=1), 1.0), rows.argmin(axis=1)


# Zeros of a quantity s >= 0 of the motion that passes through zero as |x| does.
#
# Near a zero s has the shape of a V, which may be narrower than the distance of two samples. States
# between samples are interpolated (cubic Hermite, since positions and velocities are known at both
# ends), so that s is evaluated whenever the bodies have moved by GRID, and twice more around each
# minimum, four times as fine each time.


GRID = 0.1
"""Largest rotation [rad], or displacement relative to the scene's length, between two evaluations
of s."""
RESOLVED = 0.8
"""The same between two samples, up to which interpolation is exact to 1e-3. Above it, states
between samples are computed by a second motion if possible."""
MOST_BETWEEN = 1000
"""Maximum number of states of a second motion between two samples."""
FINER = 2
"""Number of refinements around a minimum, the last one with steps of GRID / 16."""
VANISHED = 1e-5
"""Value of s up to which it counts as zero."""
OPEN = 1.3
"""Sum of the two lowest values of a V, relative to one step of its sides, above which the minimum
is not a zero."""

Figure = Callable[["Array", "Array"], "tuple[Array, Indices]"]
"""(s, row of the constraints to which it belongs) at t (n,), y (n, 13 N)."""


Between = Callable[[float, "Array", "Array"], "Array | None"]
"""States of the motion at the times (n,) from the state y (13 N,) at t; None if not available."""


class Vanishing(NamedTuple):
    """A zero of s."""

    at: float
    """time [s]."""
    s: float
    """value at the nearest instant evaluated."""
    row: int
    t: Array
    """instants evaluated around it [s] ..."""
    y: Array
    """... and the states at them."""


def suspects(s: Array) -> list[int]:
    """Indices at which s is zero, or after which it passes through zero."""
    return np.flatnonzero(suspected(s)).tolist()


def suspected(s: Array) -> np.ndarray:
    """Whether s (..., n) is zero at an index, or passes through zero after it; shape (..., n)."""
    found = s <= VANISHED
    if s.shape[-1] > 3:
        a, b, c, d = s[..., :-3], s[..., 1:-2], s[..., 2:-1], s[..., 3:]
        found[..., 1:-2] |= (b < a) & (c < d) & (b + c <= OPEN * np.maximum(a - b, d - c))
    return found


class Follower:
    """Finds zeros of s along the samples of a motion."""

    motion: Between | None = None
    """computes states between two samples."""

    def __init__(self, figure: Figure, length: float) -> None:
        self._look, self._length = figure, length
        self._fastest = 0.0
        """largest rate of rotation, or speed over the scene's length, so far [1/s]."""
        self._t, self._y, self._s = np.zeros(0), np.zeros((0, 0)), np.zeros(0)
        """the last instants evaluated ..."""
        self._way = np.zeros(0)
        """... and the motion between them."""
        self._sample = np.zeros(0), np.zeros((0, 0))
        """the last sample."""

    def add(self, t: Array, y: Array) -> Vanishing | None:
        """Add samples; returns the first zero of s up to their end, if there is one."""
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
        """The samples, with states of the motion between two of them if bodies move by more than
        RESOLVED, or could at the largest speed so far, which samples far apart do not show."""
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
        """As `add`, for samples or states between them; the first one is the previous one."""
        times, states, ways = self._filled(t, y)
        s, _ = self._look(times, states)
        if len(self._t):
            times, states = np.append(self._t[:-1], times), np.append(self._y[:-1], states, 0)
            s, ways = np.append(self._s[:-1], s), np.append(self._way, ways)
        self._t, self._y, self._s, self._way = times[-3:], states[-3:], s[-3:], ways[-2:]
        return self._first(times, states, s, ways)

    def _filled(self, t: Array, y: Array) -> tuple[Array, Array, Array]:
        """The samples with interpolated states, and the motion from each to the next."""
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
        """Largest rotation, or displacement over the scene's length, between successive states."""
        p, fastest = _beside_middle(y.reshape(len(y), -1, WIDTH)[..., :3]), self._rates(y)
        jumped = np.abs(np.diff(p, axis=0)).max(axis=(1, 2)) / self._length
        return np.maximum(np.maximum(fastest[1:], fastest[:-1]) * np.diff(t), jumped)

    def _rates(self, y: Array) -> Array:
        """Largest rate of rotation of a body, or speed over the scene's length [1/s]."""
        bodies = y.reshape(len(y), -1, WIDTH)
        v, w = _beside_middle(bodies[..., 7:10]), bodies[..., 10:13]
        turns, goes = (np.einsum("nbi,nbi->nb", x, x).max(axis=1) for x in (w, v))
        return np.sqrt(np.maximum(turns, goes / self._length**2))

    def _first(self, t: Array, y: Array, s: Array, ways: Array) -> Vanishing | None:
        """The first zero of s. ways: motion from each state to the next."""
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
        """The first zero of s near the minima at `low`."""
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
        """The zero at index k, or after it."""
        near, at = k, float(t[k])
        if s[k] > VANISHED:
            b, c = s[k], s[k + 1]
            at += float((t[k + 1] - t[k]) * b / (b + c))
            near = k if b <= c else k + 1
        row = self._look(t[near : near + 1], y[near : near + 1])[1][0]
        around = slice(max(0, near - 4), near + 5)
        return Vanishing(at, float(s[near]), int(row), t[around], y[around])


def _beside_middle(x: Array) -> Array:
    """Vectors (n, N, 3) minus their mean over the bodies; unchanged for one body."""
    return x - x.sum(axis=1, keepdims=True) / x.shape[1] if x.shape[1] > 1 else x


def parts_of(ways: Array) -> Indices:
    """Number of parts into which the motion from each sample to the next is divided."""
    return np.where(ways <= RESOLVED, np.ceil(ways / GRID), 1.0).astype(int).clip(1)


def between(t: Array, y: Array, k: Indices, share: Array) -> tuple[Array, Array]:
    """(times, states) at the fraction `share` between index k of (t, y) and the next (Hermite)."""
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


# Singular configurations during a run.
#
# Let s be the square root of the smallest pivot of A = G M^-1 G^T relative to its diagonal element,
# over the rows that are independent at the start. If the rows lose rank, s passes through zero as
# |x| does, and the motion beyond is not unique.
#
# Permanently dependent rows are left out; in closed chains they are chosen after each step, and s
# is that of the best choice. In long chains the choice of the start is kept, and the rows that are
# kept may lose rank although all rows together do not. The motion is then unique, but loses digits.
# The eigenvalues of A over all rows distinguish the two cases.


MOST_ROWS = 120
"""Maximum number of rows of a scene that is checked, since the law of s is traced as a whole."""

UNDECIDED = (
    "the motion beyond is not unique; end the run before, or change lengths or drives to avoid it"
)


class SingularConfiguration(NamedTuple):
    """A singular configuration."""

    t: float
    least: float
    """s at the nearest instant evaluated."""
    constraint: str
    too_many: bool = False
    """whether only the rows that are kept lose rank, not all rows."""

    @property
    def finding(self) -> Finding:
        """The finding that reports it."""
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
        """The error of a run that ends there."""
        return (
            f"singular configuration at t = {self.t:.4g} s: constraint {self.constraint!r} loses "
            f"rank, and {UNDECIDED}"
        )


def rank(run: Run) -> Checker:
    """Checks that the constraints keep their rank."""
    followed: Conditioning | None = None

    def look(seen: CheckInput) -> Iterator[Finding]:
        nonlocal followed
        if followed is None:  # its laws are compiled with the first samples
            followed = Conditioning(*run)
        followed.add(seen.block, seen.effort.between)
        if followed.found is not None:
            yield followed.found.finding

    return look


class Conditioning:
    """Finds the first singular configuration in the samples of a run (`found`).

    compiled: the compiled scene of the run; it is compiled again if this is None or in reduced
    coordinates.
    """

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self.found: SingularConfiguration | None = None
        self._layout, self._scene = layout, scene
        self._checked_rows: list[int] = []
        """rows that s refers to."""
        self._kept_rows: list[int] = []
        self._laws: list[LeastOf] = []
        if not layout.contacts and has_loops(scene):
            self._make(scene, compiled)

    def _make(self, scene: Scene, compiled: Compiled | None) -> None:
        """Compile the laws of the pivots, unless the scene does not allow it or has many rows."""
        if compiled is None or compiled.reduced:
            try:
                compiled = compile_motion(scene.with_options(project_initial=True), "maximal")
            except RbSimError:
                return
        system, laws = compiled.system, compiled.laws
        if not 0 < compiled.rows <= MOST_ROWS or not isinstance(laws, MultiBodyLaws):
            return
        self._kept_rows = laws.independent
        inputs = np.array([*laws.inputs.values(system, 0.0), 0.0])
        if self._kept_rows:
            self._laws.append(LeastOf(laws.pivots, inputs, len(self._kept_rows), located=False))
        if laws.choice is not None:
            self._laws.append(LeastOf(laws.choice, inputs, len(laws.changing) + 2, located=True))
        self._system = system
        self._follower = Follower(self.shares, system.length)
        self._checked_rows = [*self._kept_rows, *laws.changing]
        self._rank = len(self._checked_rows) - laws.inputs.chosen.count(0.0)

    @property
    def is_needed(self) -> bool:
        """Whether the scene has rows to check, and nothing has been found."""
        return bool(self._laws) and self.found is None

    def add(self, block: SampleBlock, between: Between | None = None) -> None:
        """Add samples. between: computes states between them."""
        if not self.is_needed or not len(block):
            return
        self._follower.motion = between
        place = self._follower.add(block.t, coordinates(block, slice(None)))
        if place is not None:
            owner = self._owner(self._checked_rows[place.row])
            self.found = SingularConfiguration(place.at, place.s, owner, self._others_hold(place))

    def _owner(self, row: int) -> str:
        """The constraint to which the row belongs."""
        return owner_of(self._scene, self._system, row)

    def located(self, t: float, least: float, row: int) -> SingularConfiguration:
        """The singular configuration at t at which s of this row is zero."""
        return SingularConfiguration(t, least, self._owner(self._checked_rows[row]))

    def shares(self, t: Array, y: Array) -> tuple[Array, Indices]:
        """s, and the row to which it belongs, at every sample; 1 if it is not finite."""
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
        """Whether rows were left out, and all rows together keep their rank near the zero."""
        rank = self._rank
        if rank == len(self._system.row_table) or len(place.t) < 4:
            return False
        with np.errstate(all="ignore"):
            pairs = zip(place.t, place.y, strict=True)
            least = np.array([least_kept(self._system, t, y, rank) for t, y in pairs])
        return bool(np.isfinite(least).all()) and not suspects(least)


def least_kept(system: Any, t: float, y: Array, rank: int) -> float:
    """Square root of the eigenvalue number `rank`, by falling size, of A scaled to a diagonal of
    ones; nan if A is not finite."""
    matrix = rows_matrix(system, t, y)
    sizes = np.sqrt(np.diag(matrix))
    scaled = matrix / np.outer(sizes, sizes)
    if not np.isfinite(scaled).all():
        return float("nan")
    return float(np.sqrt(max(0.0, np.linalg.eigvalsh(scaled)[-rank])))


def has_loops(scene: Scene) -> bool:
    """Whether the joints form a closed chain; rows of trees cannot lose rank."""
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


# The motion between two samples, by a second motion from the first one.


MOST_LOOKS = 100
"""Maximum number of pieces of the second motion between two samples."""


def rows_between(run: Motion, t: float, y: Array, times: Array) -> Array | None:
    """Coordinates (n, 13 N) at the times, of a motion like `run` from its state y at t.

    None if that fails or takes too long, with contacts, or in reduced coordinates.
    """
    if run.compiled.reduced:
        return None
    rows = _rows_from(run, t, y, times)
    return rows[:, : len(y)] if len(rows) == len(times) else None


def _rows_from(run: Motion, t: float, y: Any, times: Array) -> Array:
    """Rows at the times of a motion like `run` from its state y at t, as far as it comes."""
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


# Runs that fail at a singular configuration, which no step avoids.
#
# There s falls to zero: as |x| if the motion passes a change point, as the square root of x if a
# drive reaches the end of its range. The last states determine which, and the time of the zero.


LAST, BETWEEN = 4, 8
"""Number of last samples that are used, and of states between the last one and the end of the last
step; further states follow, each half as far from the end as the one before."""

STEPS = 2.0
"""Number of steps after the last state within which s must become zero."""


def singular_end(simulation: Any, t: Array, rows: Array) -> SingularConfiguration | None:
    """The singular configuration at which the run of a Simulation failed; None for another failure.

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
    """Time at which s (n,), falling over three successive times, becomes zero; None if after
    `until`."""
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
    """(distance of the third value from the line through the first two, relative to its fall; zero
    of the line through the last two)."""
    slope, last = np.diff(x) / np.diff(t)
    off = abs(last - slope) / abs(last)
    return float(off), float(t[2] - x[2] / last)
