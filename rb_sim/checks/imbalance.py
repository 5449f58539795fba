"""Where the balances of a run pass their bounds: energy against work, momentum against impulse."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.balance import bodies_at_work
from rb_sim.checks.check import Look, Run, Seen
from rb_sim.numerics.rotations import cross, norms, turn_between

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rb_sim.checks.balance import Ledger
    from rb_sim.checks.effort import Effort
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


# Whether samples resolve a motion, so that integrals over them mean something.
#
#     x(t1) - x(t0) = (t1 - t0) (v(t0) + v(t1)) / 2 + O(dt^3)
#
# holds to a fraction where they do; a body that turns by much between two samples is not resolved.
# So does its turn between them about each of its axes, up to what turns about two axes make of each
# other,
#
#     2 (q(t0)^-1 q(t1))_xyz = (t1 - t0) (w(t0) + w(t1)) / 2 + O(dt^2),
#
# for a thin rod may swing about its own axis without turning far: the power of a damper there goes
# to and fro between samples. Where a body hardly moves the fraction says little, and where a coarse
# method parts positions from velocities it is not the samples' fault: what all intervals miss is
# held against the whole way, too.


PART = 0.2
"""Share of the way that the trapezoid of the velocities may miss."""

PART_OF_ALL = 0.1
"""Share of the whole way of a body that all its intervals together may miss."""

TURN = 0.5
"""Angle between two samples [rad]."""

DOUBTS = 10.0
"""Times what leaving out every other sample changes an integral by, that it may be wrong by."""

MOST = 0.02
"""Share of the intervals that may be unresolved: impacts and other jumps."""

MANY = 256
"""Intervals of one block from which on every fourth stands for all."""


class Resolutions:
    """The resolution of all bodies, and of those whose motion the work of loads hangs on.

    Samples that do not resolve a body in a spring tell the work of a drag on another one all the
    same, and with it whether energy is lost.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self.of_all = self.at_work = Resolution()
        names = bodies_at_work(scene)
        self._at_work: list[int] = []
        if names is not None and len(names) < len(layout.bodies):
            self._at_work = [layout.bodies.index(name) for name in names]
            self.at_work = Resolution()

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        self.of_all.add(block)
        if self._at_work:
            self.at_work.add(_of_bodies(block, self._at_work))


def _of_bodies(block: SampleBlock, bodies: list[int]) -> SampleBlock:
    """The samples with the motions of these bodies only; momenta stay those of all."""
    names = "position", "linear_velocity", "orientation", "angular_velocity"
    return replace(block, **{name: getattr(block, name)[:, bodies] for name in names})


class Resolution:
    """Counts the intervals between samples that do not resolve the motion."""

    def __init__(self) -> None:
        self._last: tuple[np.ndarray, ...] | None = None
        self._intervals = self._missed = self._turned = 0
        self._all: tuple[np.ndarray, np.ndarray] | None = None
        """Of each body, and of each of its axes: what the intervals miss of the way [m] and of the
        turn [rad], and these themselves, added up."""
        self.unseen = np.zeros(2)
        """Impulse [N s] and its moment [N m s] that the samples may not show: the change of both
        momenta over the intervals that miss much of the motion, as where a disk that falls nearly
        flat rises again within one."""

    @property
    def resolved(self) -> bool:
        """Whether integrals over the samples so far can be trusted: bodies turn little between two,
        and the velocities at the samples tell the ways between them."""
        if self._turned > MOST * self._intervals:
            return False
        if self._missed <= MOST * self._intervals or self._all is None:
            return True
        missed, way = self._all
        return bool((missed <= PART_OF_ALL * way).all())

    def add(self, block: SampleBlock) -> None:
        """The next samples."""
        columns = block.t, block.position, block.linear_velocity, block.orientation
        columns = *columns, block.angular_velocity, block.momentum, block.angular_momentum
        last, self._last = self._last, tuple(column[-1:] for column in columns)
        if last is not None:
            columns = tuple(np.append(*pair, 0) for pair in zip(last, columns, strict=True))
        t, x, v, q, w, *momenta = columns
        if len(t) < 2:
            return
        stride = 1 if len(t) <= MANY else 4
        ends, starts = slice(1, None, stride), slice(0, -1, stride)
        dt = (t[ends] - t[starts])[:, None]
        with np.errstate(all="ignore"):
            moved = x[ends] - x[starts]
            expected = 0.5 * dt[..., None] * (v[ends] + v[starts])
            noise = 1e-12 * np.abs(x[ends]).max(axis=0).max(axis=1)
            way = norms(moved - expected), norms(moved) + norms(expected), noise
            turn = norms(w[ends]) * dt
            spins = dt[..., None] * w[starts], dt[..., None] * w[ends]
            parts = [way, turned(q[starts], q[ends], *spins)]
            miss, size, bad = ends_of(parts)
            turn = turn.max(axis=1)
            fast = ~(turn <= TURN)
        lost = bad | fast
        # by much, not only by much of what little an interval near rest has
        hidden = (~(miss <= PART * size.max(axis=0))).any(axis=1)
        for k, p in enumerate(momenta):
            self.unseen[k] += stride * norms((p[ends] - p[starts])[lost & hidden]).sum()
        self._intervals += stride * len(bad)
        self._missed += stride * int(lost.sum())
        self._turned += stride * int(fast.sum())
        sums = stride * miss.sum(axis=0), stride * size.sum(axis=0)
        before = self._all or (0.0, 0.0)
        self._all = before[0] + sums[0], before[1] + sums[1]


def turned(
    before: np.ndarray, after: np.ndarray, spin_before: np.ndarray, spin: np.ndarray
) -> tuple[np.ndarray, ...]:
    """About each axis of each body what the mean of the spins, times the interval [rad], misses of
    the turn, more than turns about two axes make of each other (Magnus 1954) and a sine of its
    angle; both sizes; and what is rounding, in columns (n, 3 bodies)."""
    found = turn_between(before, after)
    expected = 0.5 * (spin_before + spin)
    both = norms(cross(spin_before, spin)) / 6.0 + norms(expected) ** 3 / 12.0
    miss = np.maximum(0.0, np.abs(found - expected) - both[..., None])
    size = np.abs(found) + np.abs(expected)
    flat = len(before), -1
    return miss.reshape(flat), size.reshape(flat), np.full(1, 1e-12)


def ends_of(parts: list[tuple[np.ndarray, ...]]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(what is missed, sizes, whether an interval misses too much) of ways and turns together.

    Rounding is no part of what is missed: of a body that is held at rest it is all of the way.
    """
    miss = np.concatenate([np.maximum(0.0, miss - noise) for miss, _, noise in parts], axis=1)
    size = np.concatenate([size for _, size, _ in parts], axis=1)
    return miss, size, np.any(~(miss <= PART * size), axis=1)


# What a motion does between two samples: some taken closer, on the way ahead.
#
# Of an oscillation sampled once a period all samples are alike: it seems to exchange no energy, so
# that a rounding of its balance is all there is.  Nothing among them tells that; so where the check
# is about to speak, the motion is followed for some intervals by another one beside it.


INTERVALS = 6
"""Between samples, that are looked at."""

CLOSER = 64
"""Samples in place of one."""


def closer_samples(block: SampleBlock, effort: Effort) -> SampleBlock | None:
    """Samples CLOSER times as close as those of the block, from its end on; None where there are
    none to be had.  effort: of the run, which stands at the end of the block."""
    if effort.ahead is None or len(block) < 2:
        return None
    interval = float(block.t[-1] - block.t[0]) / (len(block) - 1)
    return effort.ahead(INTERVALS * interval, INTERVALS * CLOSER)


def energy(run: Run) -> Look:
    """Energy that came from nowhere or is gone."""
    looked: Ledger | None = None

    def look(seen: Seen) -> Iterator[Finding]:
        nonlocal looked
        found = energy_found(seen, run.layout)
        if found is not None and looked is not seen.ledger:
            looked = seen.ledger
            fine = closer_samples(seen.block, seen.effort)
            if fine is not None:
                seen.ledger.saw(fine)
                found = energy_found(seen, run.layout)
        if found is not None:
            yield found

    return look


def energy_found(seen: Seen, layout: SampleLayout) -> Finding | None:
    """Energy that came from nowhere or is gone, as it shows at the end of the block."""
    block, effort, ledger, resolution = seen.block, seen.effort, seen.ledger, seen.resolution
    energy = ledger.energy()
    error = 0.0 if energy is None else abs(energy["error"])
    if energy is None or (energy["relative"] is None and np.isfinite(error)):
        return None
    scale, doubt = energy["scale"], energy["quadrature"]
    if np.isfinite(error):
        bound = effort.balance * scale + ledger.rounding + ledger.at_rest
        if error <= bound + DOUBTS * doubt:
            return None
        if ledger.has_work and not resolution.at_work.resolved:  # loads act between samples
            return None
    lost = np.flatnonzero(~np.isfinite(block.energy))
    i = int(lost[0]) if len(lost) else ledger.first_beyond(block, effort.balance)
    figure = error / scale if scale > 0.0 else np.inf
    finer = effort.finer_step(figure, effort.balance)
    return Finding(
        "energy",
        float(block.t[i]),
        figure,
        effort.balance,
        "energy error relative to the energy exchanged",
        liveliest(block, layout, i),
        effort.advice(finer),
        finer,
    )


def momentum(run: Run) -> Look:
    """Momentum, linear or angular, that no impulse explains."""
    return lambda seen: momentum_found(seen, run.layout)


def momentum_found(seen: Seen, layout: SampleLayout) -> Iterator[Finding]:
    """Momentum, linear or angular, that no impulse explains at the end of the block."""
    block, effort, resolution = seen.block, seen.effort, seen.resolution.of_all
    balances = seen.ledger.momentum()
    if balances is None or not resolution.resolved:
        return
    bound = 10.0 * effort.balance
    for (name, balance), unseen in zip(balances.items(), resolution.unseen, strict=True):
        error, scale, doubt = abs(balance["error"]), balance["scale"], balance["quadrature"]
        if balance["relative"] is None:
            continue
        if np.isfinite(error) and error <= bound * scale + DOUBTS * doubt + unseen:
            continue
        last = len(block) - 1
        finer = effort.finer_step(error / scale, bound)
        yield Finding(
            "momentum" if name == "linear" else "angular momentum",
            float(block.t[last]),
            error / scale,
            bound,
            f"{name} momentum error relative to the largest momentum",
            liveliest(block, layout, last),
            effort.advice(finer),
            finer,
        )


def liveliest(block: SampleBlock, layout: SampleLayout, i: int) -> str:
    """The body that moves most at sample i."""
    speed = np.linalg.norm(block.linear_velocity[i], axis=1)
    spin = np.linalg.norm(block.angular_velocity[i], axis=1)
    moved = np.nan_to_num(speed + spin, nan=np.inf)
    return layout.bodies[int(moved.argmax())]
