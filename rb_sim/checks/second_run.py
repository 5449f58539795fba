"""The global error of a run: the whole run is made again, finer, and the poses are compared.

The second run takes half of the steps that were really taken, or a tenth of the tolerance.  Two
runs of order p in steps h and h/2 are apart by 1 - 2^-p of the error of the first, and two runs in
which the error is as the tolerance by 0.9 of it.  Fixed steps between two events of contacts may be
the same at h and h/2, and their errors with them: there the second run is one of dopri853 at the
default tolerance, and its difference the error.  The error at an instant is the largest of

    |x - x'| / S,   A turn / S,   turn / 1 rad

over the bodies, with A^2 = largest moment / mass and S the largest |x - x_0| or A turn_0 of any
body over the run, in the run or in the second one, whichever is smaller: of two runs of which one
has exploded the other tells how large the motion is.

A run that takes long is made again in larger steps first, which costs a part of it: if the two
agree within BOUND the error is smaller than their difference, and no finer run is made.  How long
a run takes is counted (accuracy/choice), not timed, so that a run has the same summary on every
machine.

It cannot see what both runs share: a law that is not the one that was meant, and a choice that the
laws leave open and both runs make alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.choice import Setting, counted_time
from rb_sim.accuracy.differences import motion_size, motions_apart
from rb_sim.base.diagnostic import Finding, GlobalError
from rb_sim.base.errors import SimulationError
from rb_sim.checks.check import finer_step, round_down, try_step
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.methods import METHODS
from rb_sim.motion.pieces import WatchEndedError
from rb_sim.scene.compile import compile_method
from rb_sim.scene.scales import at_its_size
from rb_sim.scene.schema import DEFAULT_TOLERANCE

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock
    from rb_sim.motion.motion import Motion
    from rb_sim.scene.compiled import Compiled

BOUND = 1e-2
"""Global error, as a share of the motion, above which a run is reported."""

AFFORDED, LONGEST = 1.0, 20.0
"""Counted time [s] of the steps of a run up to which it is made again finer without being asked; up
to which it is made again coarser, and finer only where these two differ.  Of a longer one as much
is made again as the second run comes to in AFFORDED."""

COARSER_STEP, COARSER_TOLERANCE, LOOSEST = 4.0, 100.0, 1e-3
"""Factors of the coarser run, and the tolerance up to which there is one: a looser one tells
nothing of the motion."""

MOST = 4096
"""Instants of a run that are kept to be compared; of more every second, fourth, ... is kept."""

BETWEEN, FEW = 256, 32
"""Instants at which the second run is looked at besides the samples; the run itself is made once
more at all of them where samples are fewer than FEW, or show less than half of the motion."""

PATIENCE, GRACE = 8.0, 0.5
"""The second run may take this many times the counted time of the first, and so much more [s]."""

PIECE = 32
"""Instants between two looks at what the second run has taken, at most."""

TIGHTEST = 1e-14
"""Tolerance below which rounding makes the error: then a run is compared with a looser one."""

DOUBTFUL = 0.1
"""Share of BOUND above which an error within it is found once more, by a third run finer still: in
contact half of the steps may change little of an error that a quarter of them changes by more."""

SLOWEST = 16.0
"""Times the difference of two runs that their error is taken to be at most, where the next
difference is hardly smaller."""

REFINED = 3
"""Times that the second run is made finer still because it took no more steps than the first."""

SOLVED = 1e-6
"""Share of a body's size that is the smallest motion counted in contact: below it are the
residuals of the contact solvers, by which bodies at rest creep."""


class SecondRun:
    """Keeps the poses of a run as its samples come, and makes the second run at its end."""

    def __init__(self, simulation: Any) -> None:
        """simulation: at the start of the run."""
        self._simulation, motion = simulation, simulation.motion
        self._t0, self._system = motion.time, motion.system
        self._from_start = motion.as_compiled and motion.time == 0.0
        self._y = None if self._from_start else _copy(motion.coordinates)
        self._turns = motion.kept.copy()
        self._steps, self._before = motion.steps, self._counted(motion)
        self._rows: list[tuple[Array, Array]] = []
        self._count, self._stride, self._seen, self._disturbed = 0, 1, 0, False
        self._end = math.inf

    def add(self, block: SampleBlock) -> None:
        """The next samples of the run."""
        self._disturbed |= bool(block.inputs) and self._seen > 0
        first = -self._seen % self._stride
        self._seen += len(block)
        poses = np.concatenate([block.position, block.orientation], axis=2)[first :: self._stride]
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
    ) -> GlobalError:
        """The global error of the run so far, or up to a singular configuration at `singular` [s].

        always: make the finer run whatever it costs (True), or no second run (False); None: as
        AFFORDED and LONGEST say. look: called now and then meanwhile; it may raise WatchEndedError.
        """
        simulation, motion = self._simulation, self._simulation.motion
        if always is False:
            return GlobalError(unknown="not checked")
        if self._disturbed:
            return GlobalError(unknown="commands came during the run")
        if not self._from_start and motion.event_driven:
            return GlobalError(unknown="the run continues another one with contacts")
        if self._count < 2:
            return GlobalError(unknown="the run has one sample")
        took, found = self._counted(motion) - self._before, None
        limit = PATIENCE * took + GRACE if took <= LONGEST else AFFORDED
        times, poses = self._kept()
        self._end = math.inf if singular is None else max(singular, times[1])
        try:
            if AFFORDED < took <= LONGEST and not always and simulation.choice is None:
                found = self._by_coarser(times, poses, took, look)
            found = found or self._by_finer(times, poses, math.inf if always else limit, look)
        except WatchEndedError:
            return GlobalError(unknown="the run is too long (use --check)")
        if singular is None or (found.upto or math.inf) <= singular:
            return found
        return found._replace(upto=singular, why="not known beyond the singular configuration")

    def _by_coarser(
        self, times: Array, poses: Array, limit: float, look: Callable[[], None] | None
    ) -> GlobalError | None:
        """The difference from a coarser run, which is more than the error of the run; None where
        it is above BOUND, or samples do not show the motion."""
        made = _coarser(self._simulation)
        if made is None or len(times) < FEW:
            return None
        (trial, by), stride = made, max(1, len(times) // BETWEEN)
        times, poses = times[::stride], poses[::stride]
        grid = np.union1d(times, np.linspace(times[0], times[-1], BETWEEN))
        try:
            rows, upto = self._carried(trial, grid, limit, look)
        except SimulationError:
            return None
        second, radius = _poses(rows, len(trial.layout.bodies)), _radii(self._simulation)
        at = np.searchsorted(grid, times)
        if upto is not None or motion_size(second, radius) > 2.0 * motion_size(second[at], radius):
            return None
        found = self._apart(times, poses, second[at])
        return found._replace(by=by) if found.relative <= BOUND else None

    def _by_finer(
        self, times: Array, poses: Array, limit: float, look: Callable[[], None] | None
    ) -> GlobalError:
        """The error by the finer run, over what it comes to within the limit [s]."""
        simulation, run = self._simulation, self._simulation.motion
        finer, taken = 1, run.steps - self._steps
        fixed = getattr(simulation.method, "tolerance", None) is None
        grid = np.union1d(times, np.linspace(times[0], times[-1], BETWEEN))
        for _ in range(REFINED):
            other = _finer(simulation, finer)
            try:
                rows, upto = self._carried(other.motion, grid, limit, look)
            except SimulationError:
                return GlobalError(math.inf, other.motion.time, "", math.inf, other.by)
            more = other.motion.steps > (1.5 if fixed else 1.0) * taken
            if more or upto is not None or other.last:
                break
            finer += 1
        if upto is not None:  # in time it came so far only
            grid = grid[: len(rows)]
            times = times[: np.searchsorted(times, upto, side="right")]
            poses = poses[: len(times)]
            if len(times) < 2:
                raise WatchEndedError
        second = _poses(rows, len(run.layout.bodies))
        at, radius = np.searchsorted(grid, times), _radii(simulation)
        hidden = motion_size(second, radius) > 2.0 * motion_size(second[at], radius)
        if (hidden or len(times) < FEW) and upto is None:
            # the run once more, to see it between its samples
            again = motion_of(run.compiled, simulation.method)
            rows, _ = self._carried(again, grid, math.inf, look)
            times, poses = grid, _poses(rows, len(run.layout.bodies))
        else:
            second = second[at]
        found = self._apart(times, poses, second)
        stated = found._replace(relative=found.relative / other.share, by=other.by)
        if upto is not None:
            return stated._replace(upto=upto, why="use --check for the whole run")
        if other.last or not DOUBTFUL * BOUND < stated.relative <= BOUND:
            return stated
        return self._by_third(stated, found.relative, finer + 1, times, second, limit, look)

    def _by_third(
        self,
        stated: GlobalError,
        first: float,
        finer: int,
        times: Array,
        second: Array,
        limit: float,
        look: Callable[[], None] | None,
    ) -> GlobalError:
        """The error stated, or that by the differences of three runs if it is larger: differences
        that fall by r with each add up to first / (1 - r).

        first: difference of the run from the second one, whose poses are given at the times.
        finer: how many times the third one is made finer than the run.
        """
        simulation = self._simulation
        trial, by, *_ = _finer(simulation, finer)
        try:
            rows, upto = self._carried(trial, times, limit, look)
        except SimulationError:
            return stated
        if upto is not None:
            return stated
        third = _poses(rows, len(trial.layout.bodies))
        next_ = self._apart(times, second, third)
        falls = max(1.0 - next_.relative / first, 1.0 / SLOWEST)
        relative = max(first, next_.relative) / falls
        return stated if relative <= stated.relative else stated._replace(relative=relative, by=by)

    def _apart(self, times: Array, one: Array, two: Array) -> GlobalError:
        """The largest difference of two runs before a singular configuration: beyond it several
        motions fulfil the laws, and both may follow the same wrong one."""
        before = times <= self._end
        return apart(times[before], one[before], two[before], self._simulation)

    def _carried(
        self, trial: Motion, grid: Array, limit: float, look: Callable[[], None] | None
    ) -> tuple[Array, float | None]:
        """Rows of the trial at the instants, and where it was at the limit [s]; None: at its end.

        Raises SimulationError.
        """
        self._begin(trial)
        before, out = self._counted(trial), np.zeros((len(grid), trial.width))

        def watch() -> None:
            if self._counted(trial) - before > limit:
                raise WatchEndedError
            if look is not None:
                look()

        trial.watch = watch
        try:
            for first in range(0, len(grid), PIECE):
                trial.run_to(grid[first : first + PIECE], out[first : first + PIECE])
                if first + PIECE < len(grid):
                    watch()
        except WatchEndedError:
            reached = int(np.searchsorted(grid, trial.time, side="right"))
            return out[:reached], trial.time
        return out, None

    def _counted(self, motion: Motion) -> float:
        return counted_time(motion, self._simulation.setting)

    def _begin(self, trial: Motion) -> None:
        """Let the trial begin where the run began; it stands at the start of the scene."""
        if not self._from_start:
            trial.reset(self._y, self._t0)
            trial.kept = self._turns
            if trial.layout.commanded:
                trial.change_law(self._system)


def apart(times: Array, one: Array, two: Array, simulation: Any) -> GlobalError:
    """The largest difference of two runs of the simulation's scene, poses (n, bodies, 7)."""
    layout, radius = simulation.layout, _radii(simulation)
    least = SOLVED * float(radius.max()) if layout.contacts else 0.0
    share, pose, i, body = motions_apart(one, two, radius, least)
    return GlobalError(share, float(times[i]), layout.bodies[body], pose)


def _poses(rows: Array, bodies: int) -> Array:
    """Poses (n, bodies, 7) in the rows of samples."""
    return rows[:, : 13 * bodies].reshape(len(rows), bodies, 13)[:, :, :7]


def _radii(simulation: Any) -> Array:
    """The largest radius of gyration of each body [m]."""
    bodies = [simulation.scene.bodies[name] for name in simulation.layout.bodies]
    return np.array([math.sqrt(np.linalg.norm(b.inertia, 2) / b.mass) for b in bodies])


def finding_of(error: GlobalError, simulation: Any) -> Finding | None:
    """What the global error is reported as; None where it is within its bound or not known.

    The bound is BOUND, and the tolerance where `auto` has chosen the setting to keep it.
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
        advice = try_step(finer)
    else:
        tolerance = simulation.setting.tolerance or 0.0
        known = figure if math.isfinite(figure) else 100.0 * bound
        tighter = round_down(max(tolerance * 0.3 * bound / known, TIGHTEST))
        finer, advice = None, f"try tolerance {tighter:g}; if the error stays, the motion is "
        advice += "chaotic or unstable"
    what = f"estimate by a second run ({error.by}){of}"
    return Finding("global error", error.t, figure, bound, what, error.body, advice, finer)


def is_decided(finding: Finding) -> bool:
    """Whether a second run that agrees refutes the finding: that a fixed step does not follow the
    motion, or leaps over turns, of which half of the step shows others.  Not a choice in contact:
    of what the laws leave open both runs choose alike, and of a slow slip both lag alike."""
    return finding.watch in ("step", "turn")


class SecondMotion(NamedTuple):
    """What a run is compared with."""

    motion: Motion
    by: str
    """how it differs from the run, in words."""
    share: float
    """of the error of the run that the two differ by."""
    last: bool = False
    """whether none follows that is finer by the same rule."""


def _finer(simulation: Any, times: int) -> SecondMotion:
    """A motion of half of the steps, or a tenth of the tolerance, taken so many times.

    The last ones: a looser tolerance where a tighter one is below rounding, and one that does not
    take steps of the run's length.
    """
    compiled, method = simulation.motion.compiled, simulation.method
    step = getattr(method, "step", None)
    if step is not None and simulation.motion.event_driven:
        sharp = Setting("dopri853", tolerance=DEFAULT_TOLERANCE)
        motion = motion_of(compiled, sharp.build(simulation.scene.simulation.duration))
        return SecondMotion(motion, str(sharp), 1.0, last=True)
    if getattr(method, "tolerance", None) is None:
        parts = 2**times
        order = METHODS[simulation.setting.name].order
        finer = method._replace(step=step / parts)
        words = "with half the step" if times == 1 else f"with 1/{parts} of the step"
        motion = motion_of(_cut_between(compiled, parts), finer)
        return SecondMotion(motion, words, 1.0 - parts ** -float(order))
    looser = method.tolerance * 10.0**-times < TIGHTEST
    factor = 10.0 if looser else 10.0**-times
    words = f"at tolerance {factor * method.tolerance:.2g}"
    share = (factor - 1.0) / factor if looser else 1.0 - factor
    return SecondMotion(_at_tolerance(simulation, factor), words, share, looser)


def _coarser(simulation: Any) -> tuple[Motion, str] | None:
    """A motion of longer steps or a looser tolerance, and how in words; None where that would tell
    nothing."""
    compiled, method = simulation.motion.compiled, simulation.method
    if getattr(method, "tolerance", None) is None:
        words = f"with {COARSER_STEP:g} times the step; the error is smaller"
        return motion_of(compiled, method._replace(step=COARSER_STEP * method.step)), words
    looser = COARSER_TOLERANCE * method.tolerance
    if looser > LOOSEST:
        return None
    words = f"at tolerance {looser:.2g}; the error is smaller"
    return _at_tolerance(simulation, COARSER_TOLERANCE), words


def _at_tolerance(simulation: Any, factor: float) -> Motion:
    """A motion like that of the simulation at so many times its tolerance."""
    compiled, method = simulation.motion.compiled, simulation.method
    first, options = method, simulation.scene.simulation
    if simulation.choice is None:  # as the simulation was made: of small motions in two turns
        first = compile_method(at_its_size(simulation.scene).simulation, options.duration)
    trial = motion_of(compiled, first._replace(tolerance=factor * first.tolerance))
    if trial.held and simulation.choice is None:
        plain = compile_method(options, options.duration)
        trial.take(plain._replace(tolerance=factor * plain.tolerance))
        trial.reset()
    return trial


def _cut_between(compiled: Compiled, parts: int) -> Compiled:
    """The same with further breakpoints, so that the steps that end at one are halved as well."""
    if not compiled.breakpoints:
        return compiled
    ends = np.array([0.0, *compiled.breakpoints])
    between = [a + (b - a) * k / parts for a, b in zip(ends, ends[1:], strict=False)
               for k in range(1, parts)]  # fmt: skip
    found = replace(compiled, breakpoints=tuple(np.union1d(ends[1:], between).tolist()))
    if "laws" in compiled.__dict__:
        found.__dict__["laws"] = compiled.laws
    return found


def _copy(coordinates: Any) -> Any:
    return coordinates.copy() if isinstance(coordinates, np.ndarray) else coordinates
