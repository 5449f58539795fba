"""All accuracy checks of one run: fed with its samples, asked for their findings."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from math import inf, isfinite
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.diagnostic import Finding, tell
from rb_sim.checks.balance import SPARSE, Ledger
from rb_sim.checks.effort import SAFE_TURN, Effort, effort_of, found_in, turns
from rb_sim.checks.imbalance import Resolutions, energy_found, momentum_found
from rb_sim.checks.second_run import BOUND, finding_of, is_decided
from rb_sim.checks.singular_configuration import STRIDE, Conditioning
from rb_sim.checks.violation import CONTACT_RESIDUAL, RESIDUAL, Inside, residual_found
from rb_sim.mechanics.samples import ARRAYS

if TYPE_CHECKING:
    from collections.abc import Callable

    from rb_sim.base.diagnostic import GlobalError
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene


# What a motion does between two samples: some taken closer, on the way ahead.
#
# Of an oscillation sampled once a period all samples are alike: it seems to exchange no energy, so
# that a rounding of its balance is all there is, and to move by nothing but the errors of a step.
# Nothing among them tells that; so where a watch is about to speak of one of these, the motion is
# followed for some intervals by another one beside it.


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


# Whether a contact chatters: opens and closes so often that its events say nothing any more.


MOST_EVENTS_PER_SAMPLE = 50.0
CHATTER = 1000
"""Events, all in all and on average between two samples, that say: a contact chatters."""


class Chatter:
    """Counts the events of each contact of a run."""

    def __init__(self) -> None:
        self._events: dict[str, int] = {}
        self._end = 0.0

    def add(self, block: SampleBlock) -> None:
        """The next samples, at least one."""
        self._end = float(block.t[-1])
        for event in block.events:
            self._events[event.contact] = self._events.get(event.contact, 0) + 1

    def found(self, samples: int) -> Finding | None:
        """The finding after so many samples of the run, if a contact chatters."""
        if not self._events:
            return None
        name, count = max(self._events.items(), key=lambda item: item[1])
        mean = count / samples
        if not (count > CHATTER and mean > MOST_EVENTS_PER_SAMPLE):
            return None
        advice = "the contact chatters; try method time_stepping"
        what = "number of contact events between two samples"
        return Finding("events", self._end, mean, MOST_EVENTS_PER_SAMPLE, what, name, advice)


# All watches of one run: fed with the samples as they come, asked for findings at any time.
#
# The first samples are all looked at closely, and from there on one block whenever the samples have
# doubled, so that watching a long run costs little of it; the others are passed with a glance. That
# takes in every sample's residual and work, the energy at the end of the block and dead points, and
# where one of them passes its bound the block is looked at closely at once.


FIRST = 2048
"""Samples at the beginning of a run that are all looked at closely."""


MOST_CHANGES = 16
"""Changes of commands in one block above which no balance is drawn: a stream of commands leaves
pieces of a few samples, which say nothing and would cost more than the motion."""


class WatchList:
    """Watches one run. scene, layout: of the simulation whose samples will come; compiled: the
    scene as it is run, which spares compiling a linkage once more to watch its rank."""

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self._scene, self._layout, self._compiled = scene, layout, compiled
        self._ledger = Ledger(scene, layout)
        self._resolution = Resolutions(scene, layout)
        self._conditioning: Conditioning | None = None
        self._inside = Inside(scene, layout)
        self._found: dict[str, Finding] = {}
        self._chatter = Chatter()
        self._samples = 0
        self._block: SampleBlock | None = None
        """the last."""
        self._looked = False
        """whether samples were taken closer."""
        self._command: np.ndarray | None = None
        self._next_close = 0
        """samples from which on a block is looked at closely again."""
        self._effort = Effort("", None, None, 0)
        """the last that was asked for."""
        self._balance = self._effort.balance
        self._glanced: tuple[SampleBlock, Effort | Callable[[], Effort]] | None = None
        """the last block that was passed with a glance, unless the one after it was not."""
        self._apart = False
        """whether there was one since the last close look."""
        self._held = bool(scene.constraints)
        self._overlap = CONTACT_RESIDUAL if layout.contacts else RESIDUAL
        self._stepped = scene.simulation.method == "time_stepping"
        self._may_strike = bool(layout.contacts or layout.commanded)
        self._innocent = 0.0
        """what the energy seemed to miss at a glance, twice, where a close look missed nothing."""

    @property
    def ledger(self) -> Ledger:
        """The balances of all samples so far, or since the last command."""
        return self._ledger

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound so far, each watch at most once, by time.

        Before `catch_up` the last blocks may only have been passed with a glance.
        """
        singular = self._found.get("singular configuration")
        found = (
            finding if singular is None else beyond(singular, finding)
            for finding in self._found.values()
        )
        return tuple(sorted(found, key=lambda finding: finding.t))

    def check(self, error: GlobalError, simulation: Any) -> None:
        """Report what a second run of the simulation shows, if it is beyond its bound.

        One within it decides what the setting seemed to leave open, and says more of the error
        than balances that are within the same bound: they hang on how well samples resolve loads.
        """
        found = finding_of(error, simulation)
        if found is not None:
            self._say(found)
        elif error.known and error.upto is None:
            small = self._small_balances()
            self._found = {
                name: each
                for name, each in self._found.items()
                if name not in small and not is_decided(each)
            }

    def _small_balances(self) -> set[str]:
        """Names of the balances that at the end of the run are within the bound of a second run."""
        momentum = self._ledger.momentum() or {"linear": None, "angular": None}
        balances = {
            "energy": self._ledger.energy(),
            "momentum": momentum["linear"],
            "angular momentum": momentum["angular"],
        }
        shares = {name: (each or {}).get("relative") for name, each in balances.items()}
        return {name for name, share in shares.items() if share is not None and share <= BOUND}

    def advise(self, advice: str) -> None:
        """Give this advice with all findings that a finer step may mend."""
        for name, finding in self._found.items():
            if finding.finer_step is not None:
                self._found[name] = finding._replace(advice=advice)

    def add(self, block: SampleBlock, effort: Effort | Callable[[], Effort]) -> None:
        """The next samples. effort: of the run up to their end; a function is asked for it only
        where it is needed.

        Where a command changes, balances begin anew from the first sample that it has acted on.
        """
        count = len(block.t)
        if not count:
            return
        self._block = block
        close = self._samples + count <= FIRST or self._samples >= self._next_close
        if not close and not (self._may_strike and self._strikes(block)):
            self._glance(block, count, effort)
            return
        self._next_close = 2 * self._samples
        self._resume()
        self._ask(effort)
        with np.errstate(all="ignore"):
            if not self._jumps_in(block, self._effort):
                self._add(block, self._effort)

    def _resume(self) -> None:
        """Look closely again; where blocks were passed with a glance, a new stretch begins."""
        if self._apart:
            self._resolution.leave_out()
            self._ledger.leave_out()
        self._glanced, self._apart = None, False

    def catch_up(self) -> None:
        """Look closely at the energy and the effort up to the end of the samples so far."""
        if self._glanced is None:
            return
        (block, effort), self._glanced = self._glanced, None
        self._ask(effort)
        with np.errstate(all="ignore"):
            self._watch_energy(block, self._effort)
            self._watch_effort(block, self._effort)
            self._watch_turns(block, self._effort)

    def finish(self) -> None:
        """Look closely at the end of the run, as far as it was passed with a glance."""
        glanced = self._glanced
        self.catch_up()
        if glanced is not None:
            with np.errstate(all="ignore"):
                self._ledger.leave_out()
                self._resolution.leave_out()
                self._ledger.look_back(glanced[0])
                self._resolution.add(glanced[0])
                self._watch_momentum(glanced[0], self._effort)

    def _ask(self, effort: Effort | Callable[[], Effort]) -> None:
        self._effort = effort if isinstance(effort, Effort) else effort()
        self._balance = self._effort.balance

    def _glance(
        self, block: SampleBlock, count: int, effort: Effort | Callable[[], Effort]
    ) -> None:
        """Take a glance at the block, and look closely where it stands out."""
        self._glanced, self._apart = (block, effort), True
        self._watch_inside(block)
        if self._stands_out(block, count):
            self._ask(effort)
            with np.errstate(all="ignore"):
                self._watch_energy(block, self._effort)
                self._watch_residual(block)

    def _strikes(self, block: SampleBlock) -> bool:
        """Whether contacts change or commands act, whose jumps a glance would miss.

        Steps of time stepping tell no events.
        """
        if block.events or (self._layout.contacts and self._stepped):
            return True
        before = self._command is not None and bool(self._command.any())
        return before or bool(block.command.any())

    def _stands_out(self, block: SampleBlock, count: int) -> bool:
        """Whether the block is to be looked at closely at once; `count` of its samples.

        Most blocks of most runs come here only, a few microseconds each.
        """
        self._samples += count
        residual = block.worst_residual if self._held else 0.0
        found = not residual <= self._overlap and "residual" not in self._found
        missed, effort = abs(self._ledger.glance(block, count, residual)), self._effort
        if not missed <= self._balance * self._ledger.exchanged + self._innocent:
            found |= "energy" not in self._found
            self._innocent = 2.0 * missed if isfinite(missed) else inf
        if self._conditioning is not None and self._conditioning.watching:
            self._watch_rank(block, STRIDE)
        if effort.step is not None:
            spin = block.angular_velocity[::SPARSE].ravel()
            if max(spin.max(), -spin.min()) * effort.step > SAFE_TURN:
                self._watch_turns(block, effort, SPARSE)
        return found

    def _jumps_in(self, block: SampleBlock, effort: Effort) -> bool:
        """Whether commands change in the block; then its pieces are looked at one by one."""
        first, jumps = 0, self._jumps(block)
        if len(jumps) > MOST_CHANGES:
            self._begin_anew()
            self._watch_block(block, effort)
            return True
        for jump in jumps:
            self._add(_cut(block, first, jump), effort)
            self._begin_anew()
            first = jump
        if first:
            self._add(_cut(block, first, len(block)), effort)
        return bool(first)

    def _begin_anew(self) -> None:
        """Draw balances from the next sample on."""
        self._ledger = Ledger(self._scene, self._layout)
        self._resolution = Resolutions(self._scene, self._layout)
        self._looked = False

    def _jumps(self, block: SampleBlock) -> list[int]:
        """Samples of the block that show another command than the one before."""
        if not self._layout.commanded or not len(block):
            return []
        flat = block.command.reshape(len(block), -1)
        before = flat[:1] if self._command is None else self._command
        self._command = flat[-1:].copy()
        return np.flatnonzero((flat != np.append(before, flat[:-1], 0)).any(axis=1)).tolist()

    def _add(self, block: SampleBlock, effort: Effort) -> None:
        if not len(block):
            return
        self._ledger.add(block)
        self._resolution.add(block)
        self._watch_energy(block, effort)
        self._watch_momentum(block, effort)
        self._watch_block(block, effort)

    def _watch_block(self, block: SampleBlock, effort: Effort) -> None:
        """What shows without a balance."""
        self._samples += len(block)
        self._watch_residual(block)
        self._watch_rank(block)
        self._watch_effort(block, effort)
        self._watch_turns(block, effort)
        self._watch_inside(block)
        self._watch_events(block)

    def _say(self, finding: Finding) -> None:
        self._found.setdefault(finding.watch, finding)

    def _watch_residual(self, block: SampleBlock) -> None:
        if "residual" not in self._found:
            found = residual_found(self._scene, self._layout, block, self._overlap)
            if found is not None:
                self._say(found)

    def _watch_rank(self, block: SampleBlock, stride: int = 1) -> None:
        if "singular configuration" in self._found:
            return
        if self._conditioning is None:
            self._conditioning = Conditioning(self._scene, self._layout, self._compiled)
        self._conditioning.add(block, stride)
        if self._conditioning.found is not None:
            self._say(self._conditioning.found.finding)

    def _watch_energy(self, block: SampleBlock, effort: Effort) -> None:
        if "energy" in self._found:
            return
        for _ in range(2):
            found = energy_found(
                self._ledger, self._resolution.at_work, block, self._layout, effort
            )
            if found is None or not self._looks_closer(block, effort):
                break
        if found is not None:
            self._say(found)

    def _watch_momentum(self, block: SampleBlock, effort: Effort) -> None:
        for found in momentum_found(
            self._ledger, self._resolution.of_all, block, self._layout, effort
        ):
            self._say(found)

    def _looks_closer(self, block: SampleBlock, effort: Effort) -> bool:
        """Look, once, at what the motion does between samples; False where nothing was to be seen.

        Asked only where a watch is about to speak.
        """
        if self._looked:
            return False
        self._looked = True
        fine = closer_samples(block, effort)
        if fine is None:
            return False
        self._ledger.saw(fine)
        return True

    def _watch_effort(self, block: SampleBlock, effort: Effort) -> None:
        """What shows in how the run was integrated."""
        for finding in found_in(block, effort, self._scene.simulation.rate, self._ledger.exchanged):
            self._say(finding)

    def _watch_turns(self, block: SampleBlock, effort: Effort, stride: int = 1) -> None:
        if "turn" not in self._found:
            for finding in turns(block, effort, self._layout.bodies, stride):
                self._say(finding)

    def _watch_inside(self, block: SampleBlock) -> None:
        """Whether the shape of a body with listed points lies in what it may touch."""
        if "inside" not in self._found:
            found = self._inside.first(block)
            if found is not None:
                self._say(found)

    def _watch_events(self, block: SampleBlock) -> None:
        self._chatter.add(block)
        found = self._chatter.found(self._samples)
        if found is not None:
            self._say(found)


OF_TOLERANCE = frozenset({"energy", "momentum", "angular momentum", "global error"})
"""Checks that advise a tighter tolerance."""


def beyond(singular: Finding, finding: Finding) -> Finding:
    """The finding without the advice of a tighter tolerance, if it comes after a singular
    configuration: short steps near it make round-off grow."""
    if finding.watch not in OF_TOLERANCE or finding.finer_step or finding.t < singular.t:
        return finding
    advice = (
        f"the singular configuration at t = {singular.t:.4g} s enlarges round-off: "
        "a tighter tolerance does not help, a larger one (1e-9) may"
    )
    return finding._replace(advice=advice)


def _cut(block: SampleBlock, first: int, end: int) -> SampleBlock:
    """Samples first to end - 1; events stay with the piece that ends the block."""
    last = end == len(block)
    part = {name: getattr(block, name)[first:end] for name in ARRAYS}
    return replace(block, **part, events=block.events if last else ())


# Samples on their way from a simulation to whoever asked for them, looked at by all watches.


class Watched:
    """Iterates over blocks of samples and keeps what the watches find in them.

    simulation: whose samples they are; its effort is asked for as they come. blocks: of samples in
    time. From a reset, or a state that was set, on the watches begin anew, for it is another run.
    """

    def __init__(self, simulation: Any, blocks: Iterable[SampleBlock]) -> None:
        self._simulation, self._blocks = simulation, blocks
        self._watches = self._new()
        self._found: list[Finding] = []
        self._before: tuple[Finding, ...] = ()
        """of runs before the last reset."""

    def __iter__(self) -> Iterator[SampleBlock]:
        try:
            for block in self._blocks:
                if any(given.state for given in block.inputs):
                    self._end()
                    self._watches = self._new()
                else:
                    self._watches.add(block, partial(effort_of, self._simulation))
                yield block
        finally:
            self._end()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound, by time; whole once the blocks have come to their end."""
        return tuple(self._found)

    def check(self, error: GlobalError) -> None:
        """Add what the second run shows."""
        self._watches.check(error, self._simulation)
        self._found = [*self._before, *self._watches.findings]

    def warn(self, stacklevel: int = 2) -> None:
        """Give a Python warning for each finding, at the caller of the function that calls this."""
        tell((), self._found, stacklevel + 1)

    def _new(self) -> WatchList:
        of = self._simulation
        return WatchList(of.scene, of.layout, of.compiled)

    def _end(self) -> None:
        self._watches.finish()
        self._before = tuple(self._found)
        self._found += self._watches.findings
