# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The search for a fixed step that passes the checks, and the forecast of a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from rb_sim.accuracy.choice import counted_time
from rb_sim.base.errors import RbSimError
from rb_sim.checks.check import below, effort_of, steps_alone
from rb_sim.checks.check_list import CheckList
from rb_sim.checks.second_run import SecondRun
from rb_sim.mechanics.methods import METHODS
from rb_sim.motion.motion import ADVICE, Forecast
from rb_sim.scene.schema import Scene

if TYPE_CHECKING:
    from rb_sim.base.errors import Finding


# The forecast of a scene's run, with what would make it shorter.


ADVICE_IN_CONTACT = (
    "slow slips with friction keep the steps short at any tolerance; try method time_stepping, a "
    "larger tolerance, or a shorter duration"
)


def advice_for(scene: Scene) -> str:
    """What to try where a run of the scene takes too long."""
    rubbing = any(
        getattr(getattr(spec, "friction", None), "static", 0.0) > 0.0
        for spec in scene.constraints.values()
    )
    adaptive = scene.simulation.step is None and scene.simulation.method != "auto"
    return ADVICE_IN_CONTACT if rubbing and adaptive else ADVICE


def forecast_for(
    scene: Scene,
    duration: float,
    tell: Callable[[str], None] | None,
    *,
    wall: float = math.inf,
) -> Forecast:
    """The forecast of a run of the scene; the rest as in Forecast."""
    return Forecast(duration, tell, wall=wall, advice=advice_for(scene))


# Which fixed step would do, where one failed or a check found it too large.
#
# It is found by running the scene with other steps, under the checks of every run.


MOST_TIME = 3.0
"""Counted time of all trials together [s], and of the second run of one that no other check finds
fault with: the run is over, and its user waits for the word."""

MOST_TRIALS = 16
"""Smaller steps that are tried, each at most half of the one before."""

STIFF = 0.02
"""Share of the step asked for at and below which one that does is of a stiff scene, for which there
is a method of its own."""

MOST_STEPS = 200_000
"""Steps, times bodies, of a whole run in steps 256 times as short: of a longer one that failed the
beginning is tried."""


def step_that_runs(
    simulation: Any,
    failed_at: float,
    end: float,
    goes_on: Callable[[], bool] = lambda: True,
) -> str:
    """Advice about the step of a run of a Simulation that failed because of it: one that does, or
    that none does.

    failed_at, end: of the run, which had no commands [s]; goes_on: asked during the trials, which
    begin at the scene's start; of a run too long for them a little more is tried than it came to.
    """
    step = simulation.setting.step
    whole = end / step * 256 * len(simulation.layout.bodies) <= MOST_STEPS
    horizon = end if whole else min(end, 1.5 * failed_at + 10.0 * step)
    where = "to the end" if horizon == end else f"at least to t = {horizon:.3g} s"
    trials = _Trials(simulation, horizon, None, goes_on)
    found = _search(trials, below(step))
    if found is not None:
        return f"use step {found:g} s, which runs {where}"
    if trials.loud:
        return f"step {min(trials.loud):g} s runs {where}, but with a warning"
    smallest = min(trials.failed, default=step)
    tried = f"steps down to {smallest:g} s fail as well; " if smallest < step else ""
    return tried + _otherwise(simulation)


def quiet_step(
    simulation: Any,
    findings: tuple[Finding, ...],
    goes_on: Callable[[], bool] = lambda: True,
) -> str:
    """Advice about the step of a run whose findings name a finer one; "" if none of them does.

    The step named ends all findings about the step and brings no other.
    findings: of the whole run of `simulation`; goes_on: asked during the trials.
    """
    finer = [finding.finer_step for finding in findings if finding.finer_step is not None]
    step = simulation.setting.step
    if not finer or step is None:
        return ""
    first = min(finer)
    known = frozenset(finding.watch for finding in findings if finding.finer_step is None)
    trials = _Trials(simulation, simulation.scene.simulation.duration, known, goes_on)
    found = _search(trials, first)
    if found is not None:
        mends = f"use step {found:g} s, which passes all checks"
        return mends + _in_longer_steps(simulation, found / step)
    tried = trials.loud + trials.failed
    if not tried:
        return f"try step {first:g} s (estimated by the order of the method)"
    return f"steps down to {min(tried):g} s do not help; {_otherwise(simulation)}"


def _in_longer_steps(simulation: Any, share: float) -> str:
    """What else to try where only steps do that are this share of what was asked for."""
    stiff = METHODS["radau5"]
    if share > STIFF or not stiff.suits(simulation.compiled.system):
        return ""
    return ", or method radau5 with a tolerance"


def _otherwise(simulation: Any) -> str:
    """What to try where no step does."""
    if METHODS[simulation.setting.name].family == "time-stepping":
        if steps_alone(simulation):
            return "no other method takes a contact `between`"
        return "try method dopri853, which locates the events of contacts"
    return "use method dopri853 with a tolerance"


def _search(trials: _Trials, first: float) -> float | None:
    """The first step [s] from `first` down that is quiet; None where there is none in time."""
    step = first
    with suppress(_NoTimeError):
        for _ in range(MOST_TRIALS):
            if trials.quiet(step):
                return step
            step = below(step)
    return None


class _NoTimeError(Exception):
    """The trials have taken MOST_TIME, or were asked to end."""


class _Trials:
    """Runs of the scene with other steps, up to `end` [s].

    known: checks that may report, as no step mends what they tell; None: all that name no step.
    """

    def __init__(
        self,
        simulation: Any,
        end: float,
        known: frozenset[str] | None = None,
        goes_on: Callable[[], bool] = lambda: True,
    ) -> None:
        self._simulation, self._end, self._known = simulation, end, known
        self._goes_on = goes_on
        self._left = MOST_TIME
        self.loud: list[float] = []
        """Steps that came to the end, but not without a finding [s]."""
        self.failed: list[float] = []
        """Steps that did not come to the end [s]."""

    def quiet(self, step: float) -> bool:
        """Whether the run with this step [s] comes to its end and no check finds fault with it.

        Raises _NoTimeError.
        """
        try:
            quiet = self._run(step)
        except (RbSimError, ArithmeticError):
            self.failed.append(step)
            return False
        if not quiet:
            self.loud.append(step)
        return quiet

    def _run(self, step: float) -> bool:
        trial = self._simulation.with_step(step)
        left = self._left

        def may_go_on(_: float) -> bool:
            self._left = left - counted_time(trial.motion, trial.setting)
            return self._left > 0.0 and self._goes_on()

        check_list = CheckList(trial.scene, trial.layout, trial.compiled)
        second = SecondRun(trial)
        try:
            for block in trial.blocks(self._end, trial.scene.simulation.rate, may_go_on):
                if not may_go_on(trial.motion.time):
                    raise _NoTimeError
                check_list.add(block, partial(effort_of, trial))
                second.add(block)
                if self._known is not None and self._beyond(check_list):
                    return False
        finally:
            may_go_on(trial.motion.time)
        if not self._beyond(check_list):
            error = second.result(singular=check_list.singular, within=MOST_TIME)
            check_list.check(error, trial, second.exchanged)
        return not self._beyond(check_list)

    def _beyond(self, check_list: CheckList) -> bool:
        """Whether a check has found what is not known to come with any step."""
        if self._known is None:
            return any(finding.finer_step is not None for finding in check_list.findings)
        return any(finding.watch not in self._known for finding in check_list.findings)
