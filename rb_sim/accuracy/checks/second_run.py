# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The global error of a run, estimated by a second, finer run whose poses are compared.

The second run uses steps shorter by the golden section, r = 0.618, including those that end at the
points of a table, or a tenth of the tolerance. Two runs of order p with steps h and r h differ by 1
- r^p of the error of the first; two runs whose error is proportional to the tolerance, by 0.9 of
it. With h/2 instead of r h, a load with a whole number of periods in h/2 would have the same phase
at all steps of both runs, which would then agree on a wrong motion; no number of periods is nearly
whole in both h and r h.

Fixed steps with contacts may converge to a wrong motion (e.g. if a slip that stops within a step is
continued), or agree between two events at h and r h. The second run is then one of dopri853 with
event detection at the default tolerance, and the difference is the error; for time stepping with so
many contacts that this takes too long, the second run uses shorter steps. Fixed steps of radau5
damp an oscillation that they do not resolve, and so do shorter ones: the second run is adaptive, of
radau5, or of dopri853 if an oscillation makes that too long.

The error at an instant is the maximum over the bodies of

    |x - x'| / S,   A turn / S,   turn / 1 rad

with A^2 = largest principal moment / mass and S the largest |x - x_0| or A turn_0 of any body over
the run. S is taken from the run or the second one, whichever is smaller: if one of them diverges,
the other gives the size of the motion. Commands act in the second run at the same times as in the
first, and states that were set are set again.

For a long run a coarser run is made first, which costs a fraction of it: if the two agree within
BOUND, the error is smaller than their difference, and no finer run is made. The cost of a run is
counted (accuracy/choice), not timed, so that a run has the same summary on every machine.

Errors common to both runs are not detected: wrong laws, and a choice that the laws leave open and
that both runs make alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.checks.check import finer_step, round_down, steps_alone, try_step
from rb_sim.accuracy.checks.step_doubling import SHORTER, in_shorter_steps
from rb_sim.accuracy.choice import TIGHTEST, Setting, counted_time
from rb_sim.accuracy.runs import exchanged_energy, motion_size, motions_apart, poses_of, samples_of
from rb_sim.base.errors import Finding, GlobalError, RbSimError, SimulationError
from rb_sim.base.rounding import SOLVED_IN_CONTACT
from rb_sim.contact.choose_motion import motion_of
from rb_sim.integrate.methods.radau5 import Radau5
from rb_sim.mechanics.methods import METHODS
from rb_sim.motion.motion import WatchEndedError
from rb_sim.scene.compile import compile_method
from rb_sim.scene.place import at_its_size
from rb_sim.scene.schema import DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from rb_sim.mechanics.compiled import Compiled
    from rb_sim.mechanics.samples import Array, Input, SampleBlock
    from rb_sim.motion.motion import Motion

BOUND = 1e-2
"""Global error relative to the motion above which a run is reported."""

AFFORDED, LONGEST = 1.0, 20.0
"""Counted time [s] of the steps of a run: up to AFFORDED a finer run is made unasked; up to LONGEST
a coarser run, and a finer one only if these two differ. Of a longer run only the beginning is
repeated, as much as takes AFFORDED."""

COARSER_STEP, COARSER_TOLERANCE, LOOSEST = SHORTER**-3, 100.0, 1e-3
"""Factors of the coarser run, and the largest tolerance for which one is made."""

MOST = 4096
"""Maximum number of instants compared; of more only every second, fourth, ... is kept."""

BETWEEN, FEW = 256, 32
"""Maximum number of instants compared in addition to the samples. The run itself is repeated at all
of them if there are fewer than FEW samples, or they show less than half of the motion."""

PATIENCE, GRACE = 8.0, 0.5
"""The second run may take this many times the counted time of the first, plus GRACE [s]."""

PIECE = 32
"""Maximum number of instants between two checks of the second run's counted time."""


SUSPECT = 0.1 * BOUND
"""Error above which one within BOUND is estimated again by a still finer run: near an instability a
finer run may be as wrong as the run."""

REFINED = 4
"""Maximum number of further refinements if the second run took no more steps than the first."""


class _Change(NamedTuple):
    """A change of commands or state during a run."""

    t: float
    """[s]."""
    law: Any
    """the system from then on, with its commands."""
    states: tuple[Input, ...]
    """states that bodies were given."""


class SecondRun:
    """Collects the poses of a run, and makes the second run at its end."""

    def __init__(self, simulation: Any) -> None:
        """simulation: at the start of the run."""
        self._simulation, motion = simulation, simulation.motion
        self._compiled = motion.compiled
        self._t0, self._laws = motion.time, [_Change(motion.time, motion.system, ())]
        self._from_start = motion.as_compiled and motion.time == 0.0
        self._y = None if self._from_start else _copy(motion.coordinates)
        self._turns = motion.kept.copy()
        self._before = motion.steps, self._counted(motion)
        self._steps, self._took = 0, 0.0
        """cost of the run so far: steps, and counted time [s]."""
        self._second_steps = 0
        """number of steps of the last second run."""
        self.exchanged = 0.0
        """energy exchanged by the motion, also between samples [J]; set with the result."""
        self._rows: list[tuple[Array, Array]] = []
        self._count, self._stride, self._seen, self._reset = 0, 1, 0, False
        self._look: Callable[[], None] | None = None
        self._end = math.inf

    def add(self, block: SampleBlock) -> None:
        """Append samples of the run."""
        motion, before = self._simulation.motion, self._before
        if block.inputs and self._seen:
            states = tuple(given for given in block.inputs if given.state)
            self._reset |= any(not given.body for given in block.inputs)
            self._laws.append(_Change(block.inputs[-1].t, motion.system, states))
            before = (0, 0.0) if states else before  # setting a state restarts the counters
        self._before = motion.steps, self._counted(motion)
        self._steps += self._before[0] - before[0]
        self._took += self._before[1] - before[1]
        first = -self._seen % self._stride
        self._seen += len(block)
        poses = poses_of(block)[first :: self._stride]
        self._rows.append((block.t[first :: self._stride].copy(), poses))
        self._count += len(poses)
        while self._count > MOST:
            t, kept = self._kept()
            self._rows, self._stride = [(t[::2], kept[::2])], 2 * self._stride
            self._count = len(t[::2])

    def _kept(self) -> tuple[Array, Array]:
        times, poses = zip(*self._rows, strict=True)
        return np.concatenate(times), np.concatenate(poses)

    def result(
        self,
        always: bool | None = None,
        look: Callable[[], None] | None = None,
        singular: float | None = None,
        within: float = math.inf,
    ) -> GlobalError:
        """The global error of the run so far, or up to a singular configuration at `singular` [s].

        always: make the finer run at any cost (True), or no second run (False); None: as AFFORDED
        and LONGEST define. look: called regularly meanwhile; it may raise WatchEndedError. within:
        limit of the counted time of each run made [s].
        """
        motion = self._simulation.motion
        if always is False:
            return GlobalError(unknown="not checked")
        if self._reset:
            return GlobalError(unknown="the run was reset on its way")
        if not self._from_start and motion.event_driven:
            return GlobalError(unknown="the run continues another one with contacts")
        if self._count < 2:
            return GlobalError(unknown="the run has one sample")
        took, self._look = self._took, look
        self._end = math.inf if singular is None else singular
        limit = min(within, PATIENCE * took + GRACE if took <= LONGEST else AFFORDED)
        try:
            found = self._by_adaptive(limit)
            if found is None and AFFORDED < took <= LONGEST and not always:
                found = self._by_coarser(took)
            found = found or self._by_finer(math.inf if always else limit)
        except WatchEndedError:
            return GlobalError(unknown="the run is too long (use --check)")
        except RbSimError:
            return GlobalError(unknown="the second run cannot take a state that was set")
        if singular is None or (found.upto or math.inf) <= singular:
            return found
        return found._replace(upto=singular, why="not known beyond the singular configuration")

    def _by_adaptive(self, limit: float) -> GlobalError | None:
        """The error of fixed steps with contacts, or of radau5, as the difference from an adaptive
        run.

        None for other runs, and for time stepping if that run exceeds the limit [s].
        """
        simulation, motion = self._simulation, self._simulation.motion
        if getattr(simulation.method, "step", None) is None:
            return None
        damps = isinstance(simulation.method, Radau5)
        if not (damps or motion.layout.contacts and self._from_start):
            return None
        names = ("radau5", "dopri853") if damps else ("dopri853",)
        for name in names:
            last = name == names[-1] and (damps or motion.event_driven)
            most = limit if name == names[-1] else min(limit, self._took + GRACE)
            try:
                other = _adaptive(name, simulation, self._compiled)
                return self._by(other, most, whole=not last)
            except RbSimError:  # too many bodies, or an undecidable event
                if last:
                    raise
            except WatchEndedError:
                if last:
                    raise
                if self._look is not None:
                    self._look()
        return None

    def _by_coarser(self, limit: float) -> GlobalError | None:
        """The difference from a coarser run, a bound of the error; None if above BOUND."""
        other = _coarser(self._simulation, self._compiled)
        if other is None:
            return None
        try:
            found = self._by(other, limit, whole=True)
        except (SimulationError, WatchEndedError):
            return None
        return found._replace(below=True) if found.relative <= BOUND else None

    def _by_finer(self, limit: float) -> GlobalError:
        """The error from the finer run, up to the time that it reaches within the limit [s].

        Raises WatchEndedError.
        """
        taken, found = self._steps, GlobalError()
        fixed = getattr(self._simulation.method, "tolerance", None) is None
        for finer in range(1, REFINED + 1):
            other = _finer(self._simulation, self._compiled, finer)
            found = self._by(other, limit)
            more = self._second_steps > (1.25 if fixed else 1.0) * taken
            if more or found.upto is not None or other.last:
                if not other.last and found.upto is None and SUSPECT < found.relative <= BOUND:
                    third = self._by(_finer(self._simulation, self._compiled, finer + 1), limit)
                    return third if third.relative > found.relative else found
                break
        return found

    def _by(self, other: SecondMotion, limit: float, *, whole: bool = False) -> GlobalError:
        """The error of the run from another motion, up to the time reached within the limit [s].

        whole: require the other motion to reach the end, and raise its errors. Raises
        WatchEndedError, and with `whole` SimulationError.
        """
        simulation, run = self._simulation, self._simulation.motion
        times, poses = self._kept()
        grid = np.union1d(times, self._between(times))
        try:
            rows, upto, self._second_steps = self._carried(other.motion, grid, limit)
        except SimulationError:
            if whole:
                raise
            return GlobalError(math.inf, other.motion.time, "", math.inf, other.by)
        if upto is not None:  # the limit ended it at this time
            grid = grid[: len(rows)]
            times = times[: np.searchsorted(times, upto, side="right")]
            poses = poses[: len(times)]
            if whole or len(times) < 2:
                raise WatchEndedError
        block, radius = samples_of(rows, run.layout), _radii(simulation)
        self.exchanged = exchanged_energy(block)
        second = poses_of(block)
        at = np.searchsorted(grid, times)
        hidden = motion_size(second, radius) > 2.0 * motion_size(second[at], radius)
        if (hidden or len(times) < FEW) and upto is None:
            # repeat the run itself, for poses between its samples
            rows, *_ = self._carried(motion_of(self._compiled, simulation.method), grid, math.inf)
            times, poses = grid, poses_of(samples_of(rows, run.layout))
        else:
            second = second[at]
        # beyond a singular configuration the motion is not unique, and both runs may err alike
        before = times <= max(self._end, times[1])
        found = apart(times[before], poses[before], second[before], simulation)
        why = "use --check for the whole run" if upto is not None else ""
        relative = found.relative / other.share
        return found._replace(relative=relative, by=other.by, upto=upto, why=why)

    def _between(self, times: Array) -> Array:
        """Instants between the samples: ends of the run's steps if these are fixed. Other instants
        cost an additional step each, and a run of few steps then has more instants."""
        step = getattr(self._simulation.method, "step", None)
        if step is None:
            return np.linspace(times[0], times[-1], BETWEEN)
        count = int((times[-1] - self._t0) / step)
        ends = self._t0 + step * np.arange(0, count + 1, max(1, math.ceil(count / BETWEEN)))
        return ends[(ends >= times[0]) & (ends <= times[-1])]

    def _carried(self, trial: Motion, grid: Array, limit: float) -> tuple[Array, float | None, int]:
        """Rows of the trial at the instants, the time at which the limit [s] ended it (None: it
        completed), and its number of steps.

        Raises SimulationError.
        """
        if not self._from_start:
            trial.reset(self._y, self._t0)
            trial.kept = self._turns
        before, steps, out = self._counted(trial), 0, np.zeros((len(grid), trial.width))

        def watch() -> None:
            if self._counted(trial) - before > limit:
                raise WatchEndedError
            if self._look is not None:
                self._look()

        trial.watch = watch
        done, ends = 0, [*(change.t for change in self._laws[1:]), math.inf]
        try:
            for (begun, law, states), end in zip(self._laws, ends, strict=True):
                if states:
                    trial.run_to([begun])
                    before, steps = before - self._counted(trial), steps + trial.steps
                    trial = self._simulation.moved(trial, states)
                    before, trial.watch = before + self._counted(trial), watch
                if trial.layout.commanded and not (self._from_start and begun == self._t0):
                    trial.run_to([begun])
                    trial.change_law(law)
                upto = int(np.searchsorted(grid, end))
                for first in range(done, upto, PIECE):
                    last = min(first + PIECE, upto)
                    trial.run_to(grid[first:last], out[first:last])
                    watch()
                done = max(done, upto)
        except WatchEndedError:
            reached = int(np.searchsorted(grid, trial.time, side="right"))
            return out[:reached], trial.time, steps + trial.steps
        return out, None, steps + trial.steps

    def _counted(self, motion: Motion) -> float:
        return counted_time(motion, self._simulation.setting)


def apart(times: Array, one: Array, two: Array, simulation: Any) -> GlobalError:
    """Largest difference between two runs of the simulation's scene; poses (n, bodies, 7)."""
    layout, radius = simulation.layout, _radii(simulation)
    least = SOLVED_IN_CONTACT * float(radius.max()) if layout.contacts else 0.0
    share, pose, i, body = motions_apart(one, two, radius, least)
    return GlobalError(share, float(times[i]), layout.bodies[body], pose)


def _radii(simulation: Any) -> Array:
    """Largest radius of gyration of each body [m], (bodies,)."""
    bodies = [simulation.scene.bodies[name] for name in simulation.layout.bodies]
    return np.array([math.sqrt(np.linalg.norm(b.inertia, 2) / b.mass) for b in bodies])


def finding_of(error: GlobalError, simulation: Any) -> Finding | None:
    """The finding for a global error; None if it is within its bound or unknown.

    The bound is BOUND, and the requested tolerance if `auto` chose the settings.
    """
    choice = simulation.choice
    if choice is not None and not choice.reached:
        what, advice = "smallest global error that can be assured [m, rad]", choice.reason
        return Finding("auto", error.t, choice.predicted_error, choice.target, what, "", advice)
    figure, bound, of = error.relative, BOUND, ", relative to the motion,"
    if choice is not None and error.pose > choice.target:
        figure, bound, of = error.pose, choice.target, " [m, rad]"
    if not error.known or not figure > bound:
        return None
    step = getattr(simulation.method, "step", None)
    if choice is not None:
        finer, advice = None, f"try a tolerance below {choice.target:g}"
    elif step is not None:
        entry = METHODS.get(simulation.setting.name)
        known = figure if math.isfinite(figure) else 100.0 * bound
        finer = finer_step(step, known, bound, entry.order if entry else 1)
        advice = try_step(finer, steps_alone(simulation))
    else:
        tolerance = simulation.setting.tolerance or 0.0
        known = figure if math.isfinite(figure) else 100.0 * bound
        tighter = round_down(max(tolerance * 0.3 * bound / known, TIGHTEST))
        finer, advice = None, f"try tolerance {tighter:g}; if the error stays, the motion is "
        advice += "chaotic or unstable"
    what = f"estimate by a second run ({error.by}){of}"
    return Finding("global error", error.t, figure, bound, what, error.body, advice, finer)


def is_decided(finding: Finding) -> bool:
    """Whether an agreeing second run refutes the finding: a fixed step too large for the motion.

    Not for choices in contact, where both runs choose alike, or slow slips, where both lag alike.
    """
    return finding.check == "step"


class SecondMotion(NamedTuple):
    """The motion with which a run is compared."""

    motion: Motion
    by: str
    """text on its difference from the run."""
    share: float
    """fraction of the run's error by which the two differ."""
    last: bool = False
    """whether it cannot be refined further by the same rule."""


def _adaptive(name: str, simulation: Any, compiled: Compiled) -> SecondMotion:
    """The motion by adaptive steps, with contacts event-driven. Raises SceneError if the method
    does not support the scene."""
    setting = Setting(name, tolerance=DEFAULT_TOLERANCE)
    method = setting.build(simulation.scene.simulation.duration)
    return SecondMotion(motion_of(compiled, method), str(setting), 1.0)


def _finer(simulation: Any, compiled: Compiled, times: int) -> SecondMotion:
    """A motion with steps SHORTER, or a tenth of the tolerance, to the power `times`; the last one
    has a larger tolerance, if a smaller one would be below rounding."""
    method = simulation.method
    if getattr(method, "tolerance", None) is None:
        motion, share = in_shorter_steps(simulation.motion, compiled, times)
        return SecondMotion(motion, f"with {SHORTER**times:.2f} of the step", share)
    looser = method.tolerance * 10.0**-times < TIGHTEST
    factor = 10.0 if looser else 10.0**-times
    words = f"at tolerance {factor * method.tolerance:.2g}"
    share = (factor - 1.0) / factor if looser else 1.0 - factor
    return SecondMotion(_at_tolerance(simulation, compiled, factor), words, share, looser)


def _coarser(simulation: Any, compiled: Compiled) -> SecondMotion | None:
    """A motion with longer steps or larger tolerance; None if that is useless, or `auto` has
    measured the error of a coarser setting."""
    method = simulation.method
    if simulation.choice is not None:
        return None
    if getattr(method, "tolerance", None) is None:
        longer = method._replace(step=COARSER_STEP * method.step)
        motion = motion_of(compiled, longer)
        return SecondMotion(motion, f"with {COARSER_STEP:.2f} times the step", 1.0)
    looser = COARSER_TOLERANCE * method.tolerance
    if looser > LOOSEST:
        return None
    motion = _at_tolerance(simulation, compiled, COARSER_TOLERANCE)
    return SecondMotion(motion, f"at tolerance {looser:.2g}", 1.0)


def _at_tolerance(simulation: Any, compiled: Compiled, factor: float) -> Motion:
    """A motion like that of the simulation with `factor` times its tolerance."""
    first = simulation.method
    options = simulation.scene.simulation
    if simulation.choice is None:  # as the simulation was made: small motions in two stages
        first = compile_method(at_its_size(simulation.scene).simulation, options.duration)
    trial = motion_of(compiled, first._replace(tolerance=factor * first.tolerance))
    if trial.held and simulation.choice is None:
        plain = compile_method(options, options.duration)
        trial.take(plain._replace(tolerance=factor * plain.tolerance))
        trial.reset()
    return trial


def _copy(coordinates: Any) -> Any:
    return coordinates.copy() if isinstance(coordinates, np.ndarray) else coordinates
