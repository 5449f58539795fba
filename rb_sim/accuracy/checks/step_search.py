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
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

from rb_sim.accuracy.checks.check import below, steps_alone
from rb_sim.accuracy.checks.check_list import CheckedSamples
from rb_sim.accuracy.choice import counted_time
from rb_sim.base.errors import RbSimError
from rb_sim.mechanics.methods import METHODS
from rb_sim.motion.motion import ADVICE, Forecast
from rb_sim.scene.schema import Scene

if TYPE_CHECKING:
    from rb_sim.base.errors import Finding


ADVICE_IN_CONTACT = (
    "slow slips with friction keep the steps short at any tolerance; try method time_stepping, a "
    "larger tolerance, or a shorter duration"
)


def advice_for(scene: Scene) -> str:
    """Advice for a run of the scene that takes too long."""
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
    """The Forecast of a run of the scene."""
    return Forecast(duration, tell, wall=wall, advice=advice_for(scene))


# A smaller fixed step, if the run failed or a check found the step too large: the scene is run with
# other steps under the same checks.


MOST_TIME = 3.0
"""Maximum counted time of all trials together, and of a second run of one trial [s]."""

MOST_TRIALS = 16
"""Maximum number of smaller steps that are tried, each at most half of the one before."""

STIFF = 0.02
"""If a step this fraction of the scene's, or smaller, is needed, the scene is stiff."""

MOST_STEPS = 200_000
"""Steps times bodies of a run with steps 256 times as short, above which only the beginning of a
failed run is tried."""


def step_that_runs(
    simulation: Any,
    failed_at: float,
    end: float,
    goes_on: Callable[[], bool] = lambda: True,
) -> str:
    """Advice for a run of a Simulation that failed because of its step: a step with which it runs.

    failed_at, end: of the run, which had no commands [s]; goes_on: called during the trials, which
    it may end. A long run is tried only to a little beyond its failure.
    """
    step = simulation.setting.step
    whole = end / step * 256 * len(simulation.layout.bodies) <= MOST_STEPS
    horizon = end if whole else min(end, 1.5 * failed_at + 10.0 * step)
    where = "to the end" if horizon == end else f"at least to t = {horizon:.3g} s"
    loud, failed = math.inf, step
    for tried, found in _trials(simulation, below(step), horizon, goes_on):
        if found is None:
            failed = tried
        elif _follows(found):
            return f"use step {tried:g} s, which runs {where}"
        else:
            loud = tried
    if math.isfinite(loud):
        return f"step {loud:g} s runs {where}, but with a warning"
    tell = f"steps down to {failed:g} s fail as well; " if failed < step else ""
    return tell + _otherwise(simulation)


def quiet_step(
    simulation: Any,
    findings: tuple[Finding, ...],
    goes_on: Callable[[], bool] = lambda: True,
) -> str:
    """Advice for a run with findings about its step: a step that passes all checks; "" if there
    are no such findings.

    findings: of the whole run of `simulation`; goes_on: called during the trials, which it may end.
    """
    finer = [finding.finer_step for finding in findings if finding.finer_step is not None]
    step = simulation.setting.step
    if not finer or step is None:
        return ""
    tried, end = math.inf, simulation.scene.simulation.duration
    for tried, found in _trials(simulation, min(finer), end, goes_on):
        if found is not None and _follows(found):
            stiff = tried <= STIFF * step and METHODS["radau5"].suits(simulation.compiled.system)
            other = ", or method radau5 with a tolerance" if stiff else ""
            return f"use step {tried:g} s, which passes all checks{other}"
    if math.isfinite(tried):
        return f"steps down to {tried:g} s do not help; {_otherwise(simulation)}"
    return f"try step {min(finer):g} s (estimated by the order of the method)"


def _otherwise(simulation: Any) -> str:
    """Advice if no step passes."""
    if METHODS[simulation.setting.name].family == "time-stepping":
        if steps_alone(simulation):
            return "no other method takes a contact `between`"
        return "try method dopri853, which locates the events of contacts"
    return "use method dopri853 with a tolerance"


def _follows(findings: tuple[Finding, ...]) -> bool:
    """Whether no finding of a run is about its step."""
    return all(finding.finer_step is None for finding in findings)


def _trials(
    simulation: Any, step: float, end: float, goes_on: Callable[[], bool]
) -> Iterator[tuple[float, tuple[Finding, ...] | None]]:
    """Steps from `step` [s] down, each with the findings of a run to `end` [s], or None if the run
    fails; until the time is used up or `goes_on` returns False."""
    left = MOST_TIME
    for _ in range(MOST_TRIALS):
        trial = simulation.with_step(step)

        def taken(trial: Any = trial) -> float:
            return counted_time(trial.motion, trial.setting)

        def may_go_on(_: float, left: float = left, taken: Callable[[], float] = taken) -> bool:
            return taken() < left and goes_on()

        try:
            found = _findings(trial, end, may_go_on)
        except (RbSimError, ArithmeticError):
            found = None
        left -= taken()
        if left <= 0.0 or not goes_on():
            return
        yield step, found
        step = below(step)


def _findings(trial: Any, end: float, goes_on: Callable[[float], bool]) -> tuple[Finding, ...]:
    """Findings of a run of the simulation to `end` [s]; a second run is made if the other checks
    find nothing about the step. Raises RbSimError, ArithmeticError."""
    blocks = trial.blocks(end, trial.scene.simulation.rate, goes_on)
    checked = CheckedSamples(trial, blocks, second=True)
    for _ in checked:
        pass
    if goes_on(end) and _follows(checked.findings):
        checked.compare_again(within=MOST_TIME)
    return checked.findings
