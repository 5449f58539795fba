"""Which fixed step would do, where a run came to its end but a watch found its step too large."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from rb_sim.engine.methods.registry import METHODS
from rb_sim.errors import RbSimError
from rb_sim.simulation import Simulation
from rb_sim.watches.bounds import effort_of
from rb_sim.watches.finer import below
from rb_sim.watches.watch_list import WatchList

if TYPE_CHECKING:
    from rb_sim.watches.finding import Finding

MOST_TIME = 3.0
"""CPU time of all trials together [s]: the run is over, and its user waits for the word."""

MOST_TRIALS = 12
"""Smaller steps that are tried, each less than half of the one before."""

LARGER = 3
"""Doublings that are tried where no smaller step does."""


def quiet_step(
    simulation: Simulation,
    findings: tuple[Finding, ...],
    goes_on: Callable[[], bool] = lambda: True,
) -> str:
    """Advice about the step of a run whose findings name a finer one; "" if none of them does.

    The scene is run from its start to its end with other steps, under the same watches, until one
    ends all findings about the step and brings no other; that step is named.
    findings: of the whole run of `simulation`; goes_on: asked during the trials.
    """
    finer = [finding.finer_step for finding in findings if finding.finer_step is not None]
    step = simulation.setting.step
    if not finer or step is None:
        return ""
    first = min(finer)
    trials = _Trials(simulation, findings, goes_on)
    try:
        tried = first
        for _ in range(MOST_TRIALS):
            if trials.quiet(tried):
                return f"with step {tried:g} s this warning does not come"
            smallest, tried = tried, below(tried)
        for k in range(1, LARGER + 1):
            if trials.quiet(step * 2**k):
                return f"smaller steps do not end it; with step {step * 2**k:g} s it does not come"
    except _NoTimeError:
        if not trials.loud:
            return f"step {first:g} s should do by the order of the method (not tried: too long)"
        smallest = min(trials.loud)
    return f"steps down to {smallest:g} s do not end it; {_otherwise(simulation)}"


def _otherwise(simulation: Simulation) -> str:
    """What to try where no step does."""
    if METHODS[simulation.setting.name].family == "time-stepping":
        return "try method dopri853, which locates the events of contacts"
    return "use method dopri853 with a tolerance"


class _NoTimeError(Exception):
    """The trials have taken MOST_TIME, or were asked to end."""


class _Trials:
    """Runs of the scene with other steps."""

    def __init__(
        self, simulation: Simulation, findings: tuple[Finding, ...], goes_on: Callable[[], bool]
    ) -> None:
        self._simulation, self._goes_on = simulation, goes_on
        self._known = {finding.watch for finding in findings if finding.finer_step is None}
        self._end = time.process_time() + MOST_TIME
        self.loud: list[float] = []
        """Steps that did not end the findings [s]."""

    def quiet(self, step: float) -> bool:
        """Whether the run with this step [s] ends with no finding but those that no step mends.

        Raises _NoTimeError.
        """
        try:
            quiet = self._run(step)
        except (RbSimError, ArithmeticError):
            quiet = False
        if not quiet:
            self.loud.append(step)
        return quiet

    def _run(self, step: float) -> bool:
        scene = self._simulation.scene
        how = {"method": self._simulation.setting.name, "step": step, "tolerance": None}
        options = scene.simulation.model_copy(update=how)
        trial = Simulation(scene.model_copy(update={"simulation": options}), announce=None)
        watches = WatchList(trial.scene, trial.layout, trial.compiled)
        for block in trial.blocks(options.duration, options.rate, self._may_go_on):
            watches.add(block, partial(effort_of, trial))
            if self._beyond(watches):
                return False
        if not self._may_go_on(math.inf):
            raise _NoTimeError
        watches.finish()
        return not self._beyond(watches)

    def _may_go_on(self, _: float) -> bool:
        return time.process_time() < self._end and self._goes_on()

    def _beyond(self, watches: WatchList) -> bool:
        """Whether a watch has found what is not known to come with any step."""
        return any(finding.watch not in self._known for finding in watches.findings)
