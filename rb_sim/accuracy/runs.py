# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs of a compiled scene under any setting, timed or compared with one another sample by sample.

Rows are those of the kernel: 13 numbers per body (position, quaternion, velocities), 9 per reaction
(force, torque, anchor), then kinetic and potential energy, power, momenta and residual, and where
there are contacts their work and states.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import (
    ADAPTIVE,
    Setting,
    counted_time,
    evaluations,
    overdetermined,
    seconds_of_evaluation,
)
from rb_sim.base.errors import SimulationError
from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.methods import METHODS
from rb_sim.mechanics.samples import Array, Indices, SampleLayout, row_width
from rb_sim.mechanics.system import CONFIGURATION
from rb_sim.motion.motion import Motion, nothing
from rb_sim.numerics.rotations import angle_between
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.schema import SimulationOptions

BALANCE = 10
"""Numbers of a row after the reactions; with contacts their work and states follow."""


JUMPS = 0.05
"""Share of the instants that may lie on different sides of a jump in two runs that move alike."""


class Errors(NamedTuple):
    """Largest difference over the run; infinite where a run ended early."""

    pose: float
    """rotation [rad] or centre of mass [m], whichever is larger."""
    reaction: float
    """relative to the largest reaction of the reference; 0 without constraints."""
    energy: float
    """less the work of contacts; relative to the energy that the motion exchanges."""


def pose_gaps(poses: Array, others: Array) -> tuple[Array, Array]:
    """Distances of the centres of mass [m] and angles between the attitudes [rad] of two runs,
    shape (n, bodies) each; poses (n, bodies, 7): position, quaternion."""
    shift = np.linalg.norm(poses[..., :3] - others[..., :3], axis=-1)
    return shift, angle_between(poses[..., 3:], others[..., 3:])


def motion_size(poses: Array, radius: Array) -> float:
    """The largest way of a body from its start [m], or its largest turn as an arc of its radius of
    gyration; poses (n, bodies, 7), radius (bodies,) [m]."""
    way, turn = pose_gaps(poses, poses[:1])
    return float(np.nan_to_num(np.maximum(way, radius * turn), nan=0.0, posinf=np.inf).max())


def motions_apart(
    one: Array, two: Array, radius: Array, least: float
) -> tuple[float, float, int, int]:
    """How far two runs are apart at most, as a share of the smaller motion and as it is [m, rad],
    and the instant and the body of the share; poses (n, bodies, 7).

    radius: of gyration of the bodies, (bodies,) [m]. least: the smallest motion that counts [m].
    """
    with np.errstate(all="ignore"):
        shift, turn = pose_gaps(one, two)
        scale = max(min(motion_size(one, radius), motion_size(two, radius)), least)
        far = np.linalg.norm(two[..., :3], axis=2).max(axis=0) + radius
        shift = np.nan_to_num(shift, nan=np.inf, posinf=np.inf)
        shift = np.where((shift > COMPUTED_ROUNDING * far) | np.isinf(shift), shift, 0.0)
        turn = np.where(turn > COMPUTED_ROUNDING, turn, 0.0)
        share = np.maximum(shift / scale, np.maximum(radius * turn / scale, turn))
        share = np.where((shift > 0.0) | (turn > 0.0), share, 0.0)
    share = np.nan_to_num(share, nan=np.inf, posinf=np.inf)
    i, body = np.unravel_index(int(np.argmax(share)), share.shape)
    pose = float(np.nan_to_num(np.maximum(shift, turn), nan=np.inf).max())
    return float(share[i, body]), pose, int(i), int(body)


POSITION, ROTATION, VELOCITY, SPIN, FORCE, TORQUE = range(6)
"""Columns of `distances`."""


def distances(rows: Array, others: Array, layout: SampleLayout) -> Array:
    """How far two runs are apart at each instant, shape (n, 6), the worst of bodies and reactions.

    What is not finite is infinitely far apart. Where the two are on different sides of an event,
    which is no error but one of its time, the quantities that jump count as 0; unless there are
    many such instants, for then they do not move alike.
    """
    a, b = parts(rows, layout), parts(others, layout)
    each = [np.linalg.norm(x - y, axis=2) for x, y in zip(a, b, strict=True)]
    each[ROTATION] = angle_between(a[ROTATION], b[ROTATION])
    worst = [size.max(axis=1, initial=0.0) for size in each]
    apart = np.nan_to_num(np.stack(worst, axis=1), nan=np.inf, posinf=np.inf)
    apart[across_an_event(rows, others, layout), VELOCITY:] = 0.0
    return apart


def parts(rows: Array, layout: SampleLayout) -> list[Array]:
    """The six quantities, each (n, bodies or reactions, components)."""
    bodies, reactions = len(layout.bodies), len(layout.reactions)
    body = rows[:, : 13 * bodies].reshape(len(rows), bodies, 13)
    reaction = rows[:, 13 * bodies : 13 * bodies + 9 * reactions]
    reaction = reaction.reshape(len(rows), reactions, 9)
    columns = [slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)]
    held = [reaction[:, :, 0:3], reaction[:, :, 3:6]]
    return [body[:, :, part] for part in columns] + held


def across_an_event(rows: Array, others: Array, layout: SampleLayout) -> Indices:
    """Indices of the instants that lie between the times that two runs give one event."""
    if not layout.contacts:
        return np.zeros(0, dtype=np.intp)
    states = 13 * len(layout.bodies) + 9 * len(layout.reactions) + BALANCE + 1
    finite = np.isfinite(rows).all(axis=1) & np.isfinite(others).all(axis=1)
    apart = np.flatnonzero((rows[:, states:] != others[:, states:]).any(axis=1) & finite)
    return apart if len(apart) <= JUMPS * len(rows) else apart[:0]


def pose_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """max(rotation [rad], centre of mass [m]) over the bodies, shape (n,); NaN counts as inf."""
    return distances(rows, reference, layout)[:, :VELOCITY].max(axis=1)


def reaction_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Largest error of a reaction force or torque, relative to the largest of the reference."""
    worst = np.zeros(len(rows))
    if not layout.reactions:
        return worst
    apart, (*_, forces, torques) = distances(rows, reference, layout), parts(reference, layout)
    force = float(np.linalg.norm(forces, axis=2).max())
    torque = max(float(np.linalg.norm(torques, axis=2).max()), force * _arm(reference, layout))
    for column, scale in ((FORCE, force), (TORQUE, torque)):
        if scale > 0.0:
            worst = np.maximum(worst, apart[:, column] / scale)
    return worst


def _arm(reference: Array, layout: SampleLayout) -> float:
    """Largest distance from an anchor to its body's centre of mass [m]."""
    body = [layout.bodies.index(name) for name in layout.reaction_bodies]
    at = 13 * len(layout.bodies)
    centres = reference[:, :at].reshape(len(reference), -1, 13)[:, body, 0:3]
    reactions = reference[:, at : at + 9 * len(body)].reshape(len(reference), -1, 9)
    return float(np.linalg.norm(reactions[:, :, 6:9] - centres, axis=2).max())


def energy_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Error of kinetic plus potential energy, relative to the energy the motion exchanges.

    The reference of a conservative scene has constant energy, so this is the drift; elsewhere the
    work of the driving and dissipating effects is in the reference too.  The work of contacts is
    taken off: it jumps at impacts, and a sample may lie between those of the two runs.
    """
    at = 13 * len(layout.bodies) + 9 * len(layout.reactions)
    total, true = balance_of(rows, at, layout), balance_of(reference, at, layout)
    scale = max(reference[:, at].max(), np.ptp(reference[:, at + 1]), np.finfo(float).tiny)
    return np.nan_to_num(np.abs(total - true) / scale, nan=np.inf, posinf=np.inf)


def balance_of(rows: Array, at: int, layout: SampleLayout) -> Array:
    """Kinetic plus potential energy less the work of contacts; at: the column of the first [J]."""
    total = rows[:, at] + rows[:, at + 1]
    return total - rows[:, at + BALANCE] if layout.contacts else total


def compare(rows: Array, reference: Array, layout: SampleLayout) -> Errors:
    """Largest errors of a run against a reference at the same instants."""
    with np.errstate(over="ignore", invalid="ignore"):
        return Errors(
            float(pose_difference(rows, reference, layout).max()),
            float(reaction_difference(rows, reference, layout).max()),
            float(energy_difference(rows, reference, layout).max()),
        )


FEWEST, MOST = 400, 2000
"""Instants at which the errors of a run are taken."""

EXPENSIVE = 1e-3
"""[s] of CPU: a run shorter than this is timed in batches."""


def sample_times(options: SimulationOptions) -> Array:
    """Instants of the scene's duration at which runs are compared, both ends included [s]."""
    count = int(min(max(options.duration * options.rate, FEWEST), MOST))
    return options.duration * np.arange(count + 1) / count


# How much the scene itself magnifies one rounding: runs from initial states one ulp apart.


EPS = float(np.finfo(float).eps)

BODY, PLACES = 13, 7
"""Coordinates of a body that nothing holds, and of many: position, quaternion, velocity, spin; and
how many of them tell where it is."""


def from_one_ulp_apart(
    runner: Runner,
    setting: Setting,
    trials: int,
    budget: float = math.inf,
    sizes: Array | None = None,
) -> Iterator[Array]:
    """Rows of runs whose initial coordinates are one ulp apart from the scene's.

    budget: time of the runner after which no further one begins [s]. sizes: as `one_ulp_apart`.
    """
    random, start = np.random.default_rng(0), runner.spent
    for trial in range(trials):
        if trial and runner.spent - start > budget:
            break
        yield runner.sampled(setting, y=one_ulp_apart(runner.compiled.y, random, sizes))[0]


def largest_errors(runs: Iterable[Array], reference: Array, layout: SampleLayout) -> Errors:
    """Of all these runs against a reference at the same instants."""
    each = [compare(rows, reference, layout) for rows in runs]
    return Errors(*np.max(each, axis=0).tolist())


def one_ulp_apart(y: Any, random: np.random.Generator, sizes: Array | None = None) -> Any:
    """The coordinates, each moved to the next double up or down; of the same kind as y.

    Zeros move by half an ulp of their size: they come out of sums of terms that large. sizes: of
    each coordinate, (n,); None: 1.
    """
    values = np.array(y, dtype=float)
    sides = np.where(random.integers(0, 2, len(values)) > 0, 1.0, -1.0)
    least = 0.5 * EPS * (1.0 if sizes is None else sizes)
    moved = np.where(values == 0.0, least * sides, np.nextafter(values, np.inf * sides))
    return moved if isinstance(y, np.ndarray) else tuple(float(v) for v in moved)


def sizes_of(rows: Array, compiled: Compiled) -> Array:
    """How large each coordinate becomes in a run, its places, velocities and spins by their norms;
    1 for a quaternion, for what stays zero, and in coordinates that are none of these.

    rows: samples of the run. What swings by a nanometre has no terms of a metre.
    """
    n, bodies = len(compiled.y), len(compiled.layout.bodies)
    sizes = np.ones(n)
    if compiled.reduced and (n != BODY or CONFIGURATION.get(type(compiled.system)) != PLACES):
        return sizes
    states = rows[:, : BODY * bodies].reshape(len(rows), bodies, BODY)
    for part in (slice(0, 3), slice(7, 10), slice(10, 13)):
        with np.errstate(all="ignore"):
            largest = np.nan_to_num(np.linalg.norm(states[:, :, part], axis=2)).max(axis=0)
        for i in np.flatnonzero(largest):
            sizes[BODY * i + part.start : BODY * i + part.stop] = largest[i]
    return sizes


# Runs whose time is counted, not measured: the same scene, the same figures, on any machine.


INSTANTS, UNSEEN = 4, 5e-4
"""Instants of a run between two looks at what it has spent, at least, and the counted time that as
many more of them may be worth [s]: a look takes longer than some steps of one body."""

ITERATED = "collocation"
"""The family of methods that iterate to their stages where bodies are in contact."""

SAMPLING, FEWEST_DEAR = 0.05, 64
"""Counted time that the samples of a run should cost at most [s], and how many there are at least:
a sample is a step, and a box at rest on its face, whose run is one step, took 0.2 s for 400."""


def affordable_times(compiled: Compiled, options: SimulationOptions) -> Array:
    """The instants of `sample_times`, evenly fewer where each is dear [s]."""
    times = sample_times(options)
    one = ADAPTIVE["dopri853"] * seconds_of_evaluation(compiled)
    most = max(FEWEST_DEAR, int(SAMPLING / one))
    return times if len(times) <= most else options.duration * np.linspace(0.0, 1.0, most + 1)


class Runner:
    """Runs of one compiled scene over one span of time, each setting once from the same start.

    Their times are counted, work at written prices, unless `wall` is set.
    compiled: the scene. duration: length of every run [s]. times: instants to compare at [s].
    look: called now and then during a run; what it raises but SimulationError ends all.
    """

    def __init__(
        self,
        compiled: Compiled,
        duration: float,
        times: Array,
        look: Callable[[], None] = nothing,
    ) -> None:
        self.compiled = compiled
        self.duration = duration
        self.times = times
        self._look = look
        self.runs = 0
        """runs made so far."""
        self.spent = 0.0
        """Time of all runs so far, compilation left out [s]."""
        self.limit, self.purse = math.inf, math.inf
        """Time after which a run is broken off, and that all runs together may take [s]."""
        self.wall = math.inf
        """Measured time after which a run is broken off [s]: too coarse a method may take a block
        that rocks for one that rattles.  Where it is set, `spent` and `known_cost` are measured."""
        self._begun = 0.0
        self._allowed = math.inf
        self.broken_off = False
        """whether the last run ended at `limit`, or where the purse was empty."""
        self._unit = seconds_of_evaluation(compiled)
        self._motions: dict[type, Motion] = {}
        self._costs: dict[Setting, float] = {}
        self._rows: dict[Setting, tuple[Array, int]] = {}
        self._impacts: dict[Setting, Array] = {}
        self._begun_runs: dict[type, tuple[Setting, Array]] = {}
        """of each class of methods the run that was broken off last, and its rows so far."""
        self._current: tuple[Setting, Motion] | None = None
        self._sharing = overdetermined(compiled) > 0
        self._loses_slips = False

    def motion(self, setting: Setting) -> Motion:
        """The scene under the setting, at its start and compiled; it ends at the limits."""
        method = setting.build(self.duration)
        motion = self._motions.get(type(method))
        if motion is None:
            motion = motion_of(self.compiled, method)
            motion.warm()
            self._motions[type(method)] = motion
        motion.method = method
        motion.reset()
        motion.watch = self._in_time
        self._current, self._begun = (setting, motion), time.perf_counter()
        self._begun_runs.pop(type(method), None)
        return motion

    def sampled(self, setting: Setting, y: Any = None) -> tuple[Array, int]:
        """(rows at self.times, steps taken), started at the coordinates y if they are given.

        Rows after the instant where the run could not go on are NaN.  No run goes beyond the limit
        or the purse, none is begun that has to; of one broken off nothing is known but how far it
        came.
        """
        if y is None and setting in self._rows:
            return self._rows[setting]
        self.broken_off = self.beyond(setting)
        if self.broken_off:
            self._costs.setdefault(setting, math.inf)
            return np.full((len(self.times), row_width(self.compiled.layout)), np.nan), 0
        self._allowed = min(self.limit, self.purse - self.spent - self._looking(setting))
        motion = self.motion(setting)
        motion.reset(y)
        rows = np.full((len(self.times), motion.width), np.nan)
        self._carry(motion, rows)
        if y is None and self.broken_off:
            self._begun_runs[type(motion.method)] = setting, rows
        return self._noted(setting, rows, motion.steps, self.spent, kept=y is None)

    def carried_on(self, setting: Setting) -> tuple[Array, int]:
        """As `sampled`, but a run of this setting that was broken off goes on from there."""
        kind = type(setting.build(self.duration))
        begun = self._begun_runs.pop(kind, None)
        if begun is None or begun[0] != setting:
            return self.sampled(setting)
        motion, rows = self._motions[kind], begun[1]
        self._current, self.broken_off = (setting, motion), False
        before, self._begun = self.spent, time.perf_counter()
        if self.wall == math.inf:
            before -= self._counted(setting, motion) + self._looking(setting)
        self._allowed = min(self.limit, self.purse - before - self._looking(setting))
        self._carry(motion, rows, int(np.isfinite(rows).all(axis=1).argmin()))
        if self.broken_off:
            self._begun_runs[kind] = setting, rows
        return self._noted(setting, rows, motion.steps, before, kept=True)

    def _carry(self, motion: Motion, rows: Array, done: int = 0) -> None:
        """Carry the motion from instant to instant as far as it goes; done: rows that are there.

        What was spent is looked at after every few instants, too: two thousand implicit steps of
        many bodies may take seconds."""
        assert self._current is not None
        one = self._unit * self._evaluations(self._current[0])
        some = max(INSTANTS, int(UNSEEN / one))
        try:
            for first in range(done, len(self.times), some):
                motion.run_to(self.times[first : first + some], rows[first : first + some])
                if first + some < len(self.times):
                    self._in_time()
        except SimulationError:
            rows[-1] = np.nan

    def _noted(
        self, setting: Setting, rows: Array, steps: int, before: float, kept: bool
    ) -> tuple[Array, int]:
        """What a run gave and what it was worth; kept: the run is from the scene's own start."""
        self.runs += 1
        stepping, looking = self._counted(setting, self.motion_of(setting)), self._looking(setting)
        if self.wall < math.inf:
            stepping, looking = time.perf_counter() - self._begun, 0.0
        if kept:
            ended = bool(np.isfinite(rows[-1]).all())
            self._costs[setting] = stepping / self.duration if ended else math.inf
            if not self.broken_off:
                self._rows[setting] = rows, steps
                events = self.motion_of(setting).events
                self._impacts[setting] = np.unique([e.t for e in events if any(e.impulse)])
                self._see_slips(setting, ended, any(event.kind == "sticks" for event in events))
        self.spent = before + stepping + looking
        return rows, steps

    def _see_slips(self, setting: Setting, ended: bool, stuck: bool) -> None:
        """Note whether an iteration would be lost on the way: where a load is shared, and friction
        turns a slip ever faster to its end, it has no solution close to there, and looking for one
        in ever shorter steps took a second and more, which no price of a step tells."""
        if METHODS[setting.name].family == ITERATED:
            self._sharing = self._sharing and not ended
        self._loses_slips = self._sharing and (self._loses_slips or stuck)

    def beyond(self, setting: Setting) -> bool:
        """Whether a run is known to cost more than the limit or than what is left, before it is
        begun."""
        iterated = METHODS[setting.name].family == ITERATED
        if iterated and self._loses_slips and self.wall == math.inf:
            return True  # the wall would break it off
        known = 0.0
        if setting.step is not None:
            known = self.duration / setting.step * self._unit * self._evaluations(setting)
        return known > self.limit or known + self._looking(setting) > self.purse - self.spent

    def known_cost(self, setting: Setting) -> float:
        """Counted seconds of a whole run, if one was made; 0 if not, or if it did not reach the
        end."""
        cost = self._costs.get(setting, 0.0)  # infinite of one that does not come to the end
        return cost * self.duration if math.isfinite(cost) else 0.0

    def _looking(self, setting: Setting) -> float:
        """What the samples are worth [s]: one between two steps is a step of its own."""
        return len(self.times) * self._unit * self._evaluations(setting)

    def impacts(self, setting: Setting) -> Array:
        """Times of the impacts of the setting's last run from the scene's own start [s]; none of
        one that was not made, or whose method knows no events."""
        return self._impacts.get(setting, np.zeros(0))

    def forget(self) -> None:
        """Drop the rows that are kept."""
        self._rows.clear()

    def motion_of(self, setting: Setting) -> Motion:
        """The motion that ran last, of this setting."""
        assert self._current is not None and self._current[0] == setting
        return self._current[1]

    def cost(self, setting: Setting) -> float:
        """Counted seconds per simulated second of stepping alone; runs a setting not yet seen."""
        if setting not in self._costs:
            self.sampled(setting)
        return self._costs[setting]

    def _counted(self, setting: Setting, motion: Motion) -> float:
        """What the steps, and events, of the motion so far are worth [s]."""
        return counted_time(motion, setting, self._unit)

    def _evaluations(self, setting: Setting) -> float:
        """Right sides that a step is worth."""
        return evaluations(setting.name, setting.tolerance, self.compiled)

    def _in_time(self) -> None:
        self._look()
        assert self._current is not None
        if time.perf_counter() - self._begun > self.wall:
            raise SimulationError(f"stopped after {self.wall:.3g} s")
        if self._counted(*self._current) > self._allowed:
            self.broken_off = True
            raise SimulationError(f"stopped after {self._allowed:.3g} counted seconds")

    def measured_cost(self, setting: Setting, budget: float = 0.02) -> float:
        """CPU seconds per simulated second of stepping alone, the best of several runs; infinite
        if it cannot go on.

        budget: CPU time to spend on the measurement [s]; one run is made at least.
        """
        motion = self.motion(setting)
        self._allowed = math.inf
        if not motion.event_driven:
            motion.watch = nothing
        best, total, batch = math.inf, 0.0, 1
        while True:
            cpu = sum(self._one(motion) for _ in range(batch)) / batch
            best, total = min(best, cpu), total + cpu * batch
            if total >= budget or not math.isfinite(cpu):
                return best / self.duration
            batch = max(1, min(1000, int(EXPENSIVE / max(cpu, 1e-7))))

    def _one(self, motion: Motion) -> float:
        """CPU time of one run without samples [s]; infinite if it cannot go on."""
        motion.reset()
        self._begun, start = time.perf_counter(), time.process_time()
        try:
            motion.run_to([self.duration])
        except SimulationError:
            return math.inf
        return time.process_time() - start
