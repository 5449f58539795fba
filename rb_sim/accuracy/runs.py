# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Runs of a compiled scene under different settings: their samples, errors and costs."""

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
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.methods import METHODS
from rb_sim.mechanics.samples import (
    Array,
    Indices,
    SampleBlock,
    SampleLayout,
    block_of,
    row_width,
)
from rb_sim.mechanics.system import CONFIGURATION
from rb_sim.motion.motion import Motion, nothing
from rb_sim.numerics.rotations import angle_between
from rb_sim.scene.schema import SimulationOptions

JUMPS = 0.05
"""Two runs of the same motion give an event slightly different times. Up to this share of the
instants may lie between two such times."""


class Errors(NamedTuple):
    """Largest differences from the reference over a run; infinite if the run ended early."""

    pose: float
    """rotation [rad] or centre of mass [m], whichever is larger."""
    reaction: float
    """relative to the largest reaction of the reference; 0 without constraints."""
    energy: float
    """without the work of contacts, relative to the energy that the motion exchanges."""


def pose_gaps(poses: Array, others: Array) -> tuple[Array, Array]:
    """Distances between the centres of mass [m] and angles between the attitudes [rad] of two runs,
    (n, bodies) each; poses (n, bodies, 7): position, quaternion."""
    shift = np.linalg.norm(poses[..., :3] - others[..., :3], axis=-1)
    return shift, angle_between(poses[..., 3:], others[..., 3:])


def motion_size(poses: Array, radius: Array) -> float:
    """Largest displacement of a body from its start, or largest turn times its radius of gyration
    [m]; poses (n, bodies, 7), radius (bodies,) [m]."""
    way, turn = pose_gaps(poses, poses[:1])
    return float(np.nan_to_num(np.maximum(way, radius * turn), nan=0.0, posinf=np.inf).max())


def motions_apart(
    one: Array, two: Array, radius: Array, least: float
) -> tuple[float, float, int, int]:
    """Largest difference between two runs: relative to the smaller motion, absolute [m, rad], and
    the instant and body of the relative one; poses (n, bodies, 7).

    radius: radius of gyration of each body, (bodies,) [m]. least: lower limit of the size of the
    motion [m].
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
    """Differences between two runs at each instant, (n, 6), the largest of all bodies or reactions.

    A value that is not finite counts as infinitely far. At instants between the times that the two
    runs give the same event, quantities that jump there count as 0: only the time of the event
    differs. With many such instants (JUMPS) the motions differ, and all quantities count.
    """
    a, b = parts(rows, layout), parts(others, layout)
    each = [np.linalg.norm(x - y, axis=2) for x, y in zip(a, b, strict=True)]
    each[ROTATION] = angle_between(a[ROTATION], b[ROTATION])
    worst = [size.max(axis=1, initial=0.0) for size in each]
    apart = np.nan_to_num(np.stack(worst, axis=1), nan=np.inf, posinf=np.inf)
    apart[across_an_event(rows, others, layout), VELOCITY:] = 0.0
    return apart


MOTION = (
    "position", "orientation", "linear_velocity", "angular_velocity", "reaction_force",
    "reaction_torque",
)  # fmt: skip
"""Fields of a block of samples, in the order of the columns of `distances`."""


def samples_of(rows: Array, layout: SampleLayout) -> SampleBlock:
    """The samples in rows, without times and commands."""
    n = len(rows)
    return block_of(np.zeros(n), rows, layout, np.zeros((n, len(layout.commanded), 6)))


def parts(rows: Array, layout: SampleLayout) -> list[Array]:
    """The quantities of MOTION, each (n, bodies or reactions, k)."""
    block = samples_of(rows, layout)
    return [getattr(block, name) for name in MOTION]


def poses_of(block: SampleBlock) -> Array:
    """Position and quaternion of each body, (n, bodies, 7)."""
    return np.concatenate([block.position, block.orientation], axis=2)


def across_an_event(rows: Array, others: Array, layout: SampleLayout) -> Indices:
    """Indices of the instants that lie between the times that two runs give the same event."""
    if not layout.contacts:
        return np.zeros(0, dtype=np.intp)
    finite = np.isfinite(rows).all(axis=1) & np.isfinite(others).all(axis=1)
    one, two = (samples_of(each, layout).contact_state for each in (rows, others))
    apart = np.flatnonzero((one != two).any(axis=1) & finite)
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
    body, block = (
        [layout.bodies.index(n) for n in layout.reaction_bodies],
        samples_of(reference, layout),
    )
    return float(np.linalg.norm(block.anchor - block.position[:, body], axis=2).max())


def energy_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Error of kinetic plus potential energy, relative to the energy that the motion exchanges.

    In a conservative scene the reference has constant energy, and this is the drift. The work of
    contacts is subtracted: it jumps at impacts, whose times differ slightly between the two runs.
    """
    run, true = samples_of(rows, layout), samples_of(reference, layout)
    error = (run.energy - run.contact_work) - (true.energy - true.contact_work)
    scale = max(exchanged_energy(true), np.finfo(float).tiny)
    return np.nan_to_num(np.abs(error) / scale, nan=np.inf, posinf=np.inf)


def exchanged_energy(block: SampleBlock) -> float:
    """Largest kinetic energy, or range of the potential energy, of a motion [J]."""
    return float(max(block.kinetic_energy.max(), np.ptp(block.potential_energy)))


def compare(rows: Array, reference: Array, layout: SampleLayout) -> Errors:
    """Largest errors of a run against a reference at the same instants."""
    with np.errstate(over="ignore", invalid="ignore"):
        return Errors(
            float(pose_difference(rows, reference, layout).max()),
            float(reaction_difference(rows, reference, layout).max()),
            float(energy_difference(rows, reference, layout).max()),
        )


FEWEST, MOST = 400, 2000
"""Minimum and maximum number of instants at which runs are compared."""

EXPENSIVE = 1e-3
"""CPU time of a run [s] below which several runs are timed together."""


def sample_times(options: SimulationOptions) -> Array:
    """Instants from 0 to the scene's duration at which runs are compared [s]."""
    count = int(min(max(options.duration * options.rate, FEWEST), MOST))
    return options.duration * np.arange(count + 1) / count


# How much the scene itself amplifies a rounding error: runs whose initial states are 1 ulp apart.


EPS = float(np.finfo(float).eps)

BODY, PLACES = 13, 7
"""Coordinates of a free body (position, quaternion, velocities), and how many of them are its
pose."""


def from_one_ulp_apart(
    runner: Runner,
    setting: Setting,
    trials: int,
    budget: float = math.inf,
    sizes: Array | None = None,
) -> Iterator[Array]:
    """Rows of runs whose initial coordinates differ by one ulp from the scene's.

    budget: time of the runner after which no further run begins [s]. sizes: as `one_ulp_apart`.
    """
    random, start = np.random.default_rng(0), runner.spent
    for trial in range(trials):
        if trial and runner.spent - start > budget:
            break
        yield runner.sampled(setting, y=one_ulp_apart(runner.compiled.y, random, sizes))[0]


def largest_errors(runs: Iterable[Array], reference: Array, layout: SampleLayout) -> Errors:
    """Largest errors of several runs against a reference at the same instants."""
    each = [compare(rows, reference, layout) for rows in runs]
    return Errors(*np.max(each, axis=0).tolist())


def one_ulp_apart(y: Any, random: np.random.Generator, sizes: Array | None = None) -> Any:
    """The coordinates, each moved at random to the next double above or below.

    A zero is moved by half an ulp of the coordinate's size, since it is a sum of terms of that
    size. sizes: of each coordinate, (n,); None: 1.
    """
    values = np.array(y, dtype=float)
    sides = np.where(random.integers(0, 2, len(values)) > 0, 1.0, -1.0)
    least = 0.5 * EPS * (1.0 if sizes is None else sizes)
    moved = np.where(values == 0.0, least * sides, np.nextafter(values, np.inf * sides))
    return moved if isinstance(y, np.ndarray) else tuple(float(v) for v in moved)


def sizes_of(rows: Array, compiled: Compiled) -> Array:
    """Size of each coordinate in a run: largest norm of position, velocity and angular velocity.

    1 for quaternions, for vectors that stay zero, and for reduced coordinates. rows: samples of the
    run. A body that swings by a nanometre thus gets perturbations of that size.
    """
    n = len(compiled.y)
    sizes = np.ones(n)
    if compiled.reduced and (n != BODY or CONFIGURATION.get(type(compiled.system)) != PLACES):
        return sizes
    motion = parts(rows, compiled.layout)
    for k, part in ((0, slice(0, 3)), (2, slice(7, 10)), (3, slice(10, 13))):
        with np.errstate(all="ignore"):
            largest = np.nan_to_num(np.linalg.norm(motion[k], axis=2)).max(axis=0)
        for i in np.flatnonzero(largest):
            sizes[BODY * i + part.start : BODY * i + part.stop] = largest[i]
    return sizes


# Runs whose cost is counted from their steps, not measured, so that a scene gets the same figures
# on every machine.


INSTANTS, UNSEEN = 4, 5e-4
"""The cost of a run is checked after this number of instants or this counted time [s], whichever is
more: a check takes longer than some steps of one body."""

ITERATED = "collocation"
"""The family of methods that solve their stages by iteration."""

SAMPLING, FEWEST_DEAR = 0.05, 64
"""Maximum counted time of the samples of a run [s], and their minimum number. A sample costs a
step: 400 samples of a box at rest, whose run is one step, took 0.2 s."""


def affordable_times(compiled: Compiled, options: SimulationOptions) -> Array:
    """The instants of `sample_times`, or fewer if samples are expensive [s]."""
    times = sample_times(options)
    one = ADAPTIVE["dopri853"] * seconds_of_evaluation(compiled)
    most = max(FEWEST_DEAR, int(SAMPLING / one))
    return times if len(times) <= most else options.duration * np.linspace(0.0, 1.0, most + 1)


class Runner:
    """Runs one compiled scene under different settings, and keeps the samples and cost of each.

    Costs are counted (see accuracy/choice) unless `wall` is set. compiled: the scene. duration: of
    every run [s]. times: instants of the samples [s]. look: called regularly during a run; an
    exception that it raises, other than SimulationError, passes through.
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
        """cost of all runs so far without compilation [s]."""
        self.limit, self.total_limit = math.inf, math.inf
        """Maximum cost of one run, and of all runs together [s]; a run that exceeds it is stopped.
        """
        self.wall = math.inf
        """Maximum wall-clock time of one run [s]: too coarse a method may find far more events than
        there are. If it is set, `spent` and `known_cost` are measured as well."""
        self._begun = 0.0
        self._allowed = math.inf
        self.stopped = False
        """whether the last run was stopped by `limit` or `total_limit`."""
        self._unit = seconds_of_evaluation(compiled)
        self._motions: dict[type, Motion] = {}
        self._costs: dict[Setting, float] = {}
        self._rows: dict[Setting, tuple[Array, int]] = {}
        self._impacts: dict[Setting, Array] = {}
        self._stopped_runs: dict[type, tuple[Setting, Array]] = {}
        """last stopped run of each class of methods, and its rows so far."""
        self._current: tuple[Setting, Motion] | None = None
        self._sharing = overdetermined(compiled) > 0
        self._loses_slips = False

    def motion(self, setting: Setting) -> Motion:
        """The motion of the scene under the setting, compiled and at its start; it stops at the
        limits."""
        method = setting.build(self.duration)
        motion = self._motions.get(type(method))
        if motion is None:
            motion = motion_of(self.compiled, method)
            motion.warm()
            self._motions[type(method)] = motion
        motion.method = method
        motion.reset()
        motion.watch = self._check_limits
        self._current, self._begun = (setting, motion), time.perf_counter()
        self._stopped_runs.pop(type(method), None)
        return motion

    def sampled(self, setting: Setting, y: Any = None) -> tuple[Array, int]:
        """(rows at self.times, number of steps) of a run, from the coordinates y if given.

        Rows after a failure, or after the limits stopped the run, are NaN. A run that is known to
        exceed the limits is not begun.
        """
        if y is None and setting in self._rows:
            return self._rows[setting]
        self.stopped = self.exceeds_limits(setting)
        if self.stopped:
            self._costs.setdefault(setting, math.inf)
            return np.full((len(self.times), row_width(self.compiled.layout)), np.nan), 0
        self._allowed = min(
            self.limit, self.total_limit - self.spent - self._cost_of_samples(setting)
        )
        motion = self.motion(setting)
        motion.reset(y)
        rows = np.full((len(self.times), motion.width), np.nan)
        self._carry(motion, rows)
        if y is None and self.stopped:
            self._stopped_runs[type(motion.method)] = setting, rows
        return self._noted(setting, rows, motion.steps, self.spent, kept=y is None)

    def continued(self, setting: Setting) -> tuple[Array, int]:
        """As `sampled`, but a stopped run of this setting continues where it was stopped."""
        kind = type(setting.build(self.duration))
        begun = self._stopped_runs.pop(kind, None)
        if begun is None or begun[0] != setting:
            return self.sampled(setting)
        motion, rows = self._motions[kind], begun[1]
        self._current, self.stopped = (setting, motion), False
        before, self._begun = self.spent, time.perf_counter()
        if self.wall == math.inf:
            before -= self._counted(setting, motion) + self._cost_of_samples(setting)
        self._allowed = min(self.limit, self.total_limit - before - self._cost_of_samples(setting))
        self._carry(motion, rows, int(np.isfinite(rows).all(axis=1).argmin()))
        if self.stopped:
            self._stopped_runs[kind] = setting, rows
        return self._noted(setting, rows, motion.steps, before, kept=True)

    def _carry(self, motion: Motion, rows: Array, done: int = 0) -> None:
        """Fill in the rows from number `done` on, as far as the motion goes.

        The cost is also checked between instants, since two thousand implicit steps of many bodies
        may take seconds."""
        assert self._current is not None
        one = self._unit * self._evaluations(self._current[0])
        some = max(INSTANTS, int(UNSEEN / one))
        try:
            for first in range(done, len(self.times), some):
                motion.run_to(self.times[first : first + some], rows[first : first + some])
                if first + some < len(self.times):
                    self._check_limits()
        except SimulationError:
            rows[-1] = np.nan

    def _noted(
        self, setting: Setting, rows: Array, steps: int, before: float, kept: bool
    ) -> tuple[Array, int]:
        """Keep the result and cost of a run; kept: whether it starts at the scene's own start."""
        self.runs += 1
        stepping, looking = (
            self._counted(setting, self.motion_of(setting)),
            self._cost_of_samples(setting),
        )
        if self.wall < math.inf:
            stepping, looking = time.perf_counter() - self._begun, 0.0
        if kept:
            ended = bool(np.isfinite(rows[-1]).all())
            self._costs[setting] = stepping / self.duration if ended else math.inf
            if not self.stopped:
                self._rows[setting] = rows, steps
                events = self.motion_of(setting).events
                self._impacts[setting] = np.unique([e.t for e in events if any(e.impulse)])
                self._see_slips(setting, ended, any(event.kind == "sticks" for event in events))
        self.spent = before + stepping + looking
        return rows, steps

    def _see_slips(self, setting: Setting, ended: bool, stuck: bool) -> None:
        """Note whether methods that iterate would fail on this scene.

        If several contacts share a load and friction turns a slip faster and faster towards its
        end, the stages have no solution near that end. Such methods then halve their step for a
        second and more, which their counted cost does not show.
        """
        if METHODS[setting.name].family == ITERATED:
            self._sharing = self._sharing and not ended
        self._loses_slips = self._sharing and (self._loses_slips or stuck)

    def exceeds_limits(self, setting: Setting) -> bool:
        """Whether a run not yet begun is known to exceed the limits."""
        iterated = METHODS[setting.name].family == ITERATED
        if iterated and self._loses_slips and self.wall == math.inf:
            return True
        known = 0.0
        if setting.step is not None:
            known = self.duration / setting.step * self._unit * self._evaluations(setting)
        return (
            known > self.limit
            or known + self._cost_of_samples(setting) > self.total_limit - self.spent
        )

    def known_cost(self, setting: Setting) -> float:
        """Cost of a whole run [s]; 0 if none was made, or if it did not reach the end."""
        cost = self._costs.get(setting, 0.0)  # infinite if the run did not reach the end
        return cost * self.duration if math.isfinite(cost) else 0.0

    def _cost_of_samples(self, setting: Setting) -> float:
        """Cost of the samples [s]: each takes a step of its own."""
        return len(self.times) * self._unit * self._evaluations(setting)

    def impacts(self, setting: Setting) -> Array:
        """Times of the impacts in the setting's last run from the scene's own start [s]; empty if
        there is no such run or its method detects no events."""
        return self._impacts.get(setting, np.zeros(0))

    def forget(self) -> None:
        """Drop the rows that are kept."""
        self._rows.clear()

    def motion_of(self, setting: Setting) -> Motion:
        """The motion of the last run, which had this setting."""
        assert self._current is not None and self._current[0] == setting
        return self._current[1]

    def cost(self, setting: Setting) -> float:
        """Cost of stepping per simulated second, without samples; makes the run if necessary."""
        if setting not in self._costs:
            self.sampled(setting)
        return self._costs[setting]

    def _counted(self, setting: Setting, motion: Motion) -> float:
        """Counted time of the motion's steps and events so far [s]."""
        return counted_time(motion, setting, self._unit)

    def _evaluations(self, setting: Setting) -> float:
        """Cost of a step in evaluations of the right-hand side."""
        return evaluations(setting.name, setting.tolerance, self.compiled)

    def _check_limits(self) -> None:
        self._look()
        assert self._current is not None
        if time.perf_counter() - self._begun > self.wall:
            raise SimulationError(f"stopped after {self.wall:.3g} s")
        if self._counted(*self._current) > self._allowed:
            self.stopped = True
            raise SimulationError(f"stopped after {self._allowed:.3g} counted seconds")

    def measured_cost(self, setting: Setting, budget: float = 0.02) -> float:
        """Measured CPU time per simulated second, without samples, the least of several runs;
        infinite if the run fails.

        budget: CPU time of the measurement [s]; at least one run is made.
        """
        motion = self.motion(setting)
        self._allowed = math.inf
        if not motion.event_driven:
            motion.watch = nothing

        def run() -> None:
            self._begun = time.perf_counter()
            motion.run_to([self.duration])

        try:
            return cpu_time(run, budget, motion.reset) / self.duration
        except SimulationError:
            return math.inf


def cpu_time(
    act: Callable[[], object], spell: float, before: Callable[[], object] = nothing
) -> float:
    """Shortest CPU time of the calls within `spell` [s]; at least one is made.

    Of short calls the mean of several counts as one. before: called before each, not timed.
    """
    best, total, batch = math.inf, 0.0, 1
    while True:
        spent = 0.0
        for _ in range(batch):
            before()
            start = time.process_time()
            act()
            spent += time.process_time() - start
        best, total = min(best, spent / batch), total + max(spent, 1e-6)
        if total >= spell:
            return best
        batch = max(1, min(1000, int(EXPENSIVE * batch / max(spent, 1e-7))))
