# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""All accuracy checks of one run, and the check of its energy and momentum balances."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.accuracy.checks.balance import Ledger
from rb_sim.accuracy.checks.check import Check, Checker, CheckInput, Effort, Run, effort_of
from rb_sim.accuracy.checks.second_run import BOUND, SecondRun, finding_of, is_decided
from rb_sim.accuracy.checks.singular_configuration import rank
from rb_sim.accuracy.checks.step_checks import MADE, chatter, steps
from rb_sim.accuracy.checks.violation import inside, residual
from rb_sim.base.errors import Finding, tell

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rb_sim.base.errors import GlobalError
    from rb_sim.mechanics.compiled import Compiled
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


UNCERTAINTIES = 10.0
"""Factor of the estimated uncertainty of an integral over the samples."""

TIMES = 10.0
"""Bound of the momentum balances relative to that of the energy."""

WHAT = {
    "energy": "energy error relative to the energy exchanged",
    "gained": "energy gained in contacts relative to the energy exchanged",
    "momentum": "linear momentum error relative to the largest momentum",
    "angular momentum": "angular momentum error relative to the largest momentum",
}


def balances(run: Run) -> Checker:
    """Checks that work explains the change of energy, impulse that of momentum, and that contacts
    give no energy."""

    def look(seen: CheckInput) -> Iterator[Finding]:
        yield from unbalanced(seen, run.layout)
        yield from gained(seen, run.layout)

    return look


def gained(seen: CheckInput, layout: SampleLayout) -> Iterator[Finding]:
    """Energy gained in contacts, which by their laws give none. It is part of their work, so that
    no balance shows it. Time stepping has a check of its own (`step_checks`)."""
    block, effort, ledger = seen.block, seen.effort, seen.ledger
    allowed = MADE * ledger.exchanged + ledger.at_rest
    if effort.method == "time_stepping" or not ledger.gained > allowed:
        return
    i, exchanged = int(ledger.gains(block).argmax()), ledger.exchanged or ledger.at_rest
    figure = ledger.gained / exchanged if exchanged > 0.0 else np.inf
    finer = effort.finer_step(figure, MADE)
    where, advice, t = fastest_body(block, layout, i), effort.advice(finer), float(block.t[i])
    yield Finding("energy", t, figure, MADE, WHAT["gained"], where, advice, finer)


def unbalanced(seen: CheckInput, layout: SampleLayout) -> Iterator[Finding]:
    """The balances that are beyond their bounds at the end of the block."""
    block, effort, ledger = seen.block, seen.effort, seen.ledger
    for name, balance in ledger.balances().items():
        error, scale = abs(balance.error), balance.scale
        i, bound, at_rest = len(block) - 1, effort.balance, ledger.at_rest
        if name != "energy":
            bound, at_rest = TIMES * effort.balance, 0.0
            if scale == 0.0:
                continue
        uncertainty = at_rest + UNCERTAINTIES * balance.uncertainty
        if np.isfinite(error) and (not balance.known or error <= bound * scale + uncertainty):
            continue
        if name == "energy":
            lost = np.flatnonzero(~np.isfinite(block.energy))
            i = int(lost[0]) if len(lost) else ledger.first_beyond(block, bound)
        least = scale or at_rest  # no energy is exchanged if all bodies are exactly at rest
        figure = error / least if least > 0.0 else np.inf
        finer = effort.finer_step(figure, bound)
        where, advice = fastest_body(block, layout, i), effort.advice(finer)
        yield Finding(name, float(block.t[i]), figure, bound, WHAT[name], where, advice, finer)


def fastest_body(block: SampleBlock, layout: SampleLayout, i: int) -> str:
    """The body with the largest sum of speed [m/s] and angular speed [rad/s] at sample i."""
    speed = np.linalg.norm(block.linear_velocity[i], axis=1)
    spin = np.linalg.norm(block.angular_velocity[i], axis=1)
    moved = np.nan_to_num(speed + spin, nan=np.inf)
    return layout.bodies[int(moved.argmax())]


CHECKS: tuple[Check, ...] = (
    (("energy", "momentum", "angular momentum"), balances),
    (("residual",), residual),
    (("singular configuration",), rank),
    (("step", "contact steps", "ambiguous"), steps),
    (("inside",), inside),
    (("events",), chatter),
)
"""All checks that need no second run."""


class CheckList:
    """Checks one run. scene, layout: of the simulation; compiled: the compiled scene of the run."""

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self._run = Run(scene, layout, compiled)
        self._checks = [(names, make(self._run)) for names, make in CHECKS]
        self._found: dict[str, Finding] = {}
        self._samples = 0
        self._command: tuple[Array, Array] | None = None
        """command and time of the last sample."""
        self._ledger = Ledger(scene, layout)

    @property
    def ledger(self) -> Ledger:
        """The balances of all samples so far."""
        return self._ledger

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings so far by time, each check at most once."""
        singular = self._found.get("singular configuration")
        found = (
            finding if singular is None else beyond(singular, finding)
            for finding in self._found.values()
        )
        return tuple(sorted(found, key=lambda finding: finding.t))

    @property
    def singular(self) -> float | None:
        """Time at which the run passed a singular configuration [s]; None if it did not."""
        found = self._found.get("singular configuration")
        return None if found is None else found.t

    def check(self, error: GlobalError, simulation: Any, exchanged: float = 0.0) -> None:
        """Report the global error by a second run of the simulation, if it is beyond its bound.

        If it is within, it refutes the findings about the step, and balances whose error is within
        the same bound: these depend on how well the samples resolve the loads. exchanged: energy of
        the second run [J], which includes motion between the samples.
        """
        found = finding_of(error, simulation)
        if found is not None:
            self._found.setdefault(found.check, found)
        elif error.known and error.upto is None:
            small = self._small_balances(exchanged)
            self._found = {
                name: each
                for name, each in self._found.items()
                if name not in small and not is_decided(each)
            }

    def _small_balances(self, exchanged: float) -> set[str]:
        """Names of the balances whose error at the end of the run is within BOUND."""
        found = self._ledger.balances()
        scales = {name: each.scale for name, each in found.items()}
        scales["energy"] = max(scales.get("energy", 0.0), exchanged)
        return {name for name, e in found.items() if 0.0 < abs(e.error) <= BOUND * scales[name]}

    def advise(self, advice: str) -> None:
        """Replace the advice of all findings that name a smaller step."""
        for name, finding in self._found.items():
            if finding.finer_step is not None:
                self._found[name] = finding._replace(advice=advice)

    def add(self, block: SampleBlock, effort: Effort | Callable[[], Effort]) -> None:
        """Check the next samples. effort: of the run up to their end, or a function that returns
        it."""
        if not len(block):
            return
        effort_now = effort if isinstance(effort, Effort) else effort()
        with np.errstate(all="ignore"):
            self._ledger.add(block, self._changes(block))
            self._look(block, effort_now)

    def _changes(self, block: SampleBlock) -> list[float]:
        """Ends of the intervals between samples in which a command changes [s]."""
        if not self._run.layout.commanded:
            return []
        flat, t = block.command.reshape(len(block), -1), block.t
        before, last = (flat[:1], t[:1]) if self._command is None else self._command
        self._command = flat[-1:].copy(), t[-1:].copy()
        t = np.append(last, t)
        jumps = np.flatnonzero((flat != np.append(before, flat[:-1], 0)).any(axis=1))
        return t[jumps + 1].tolist()

    def _look(self, block: SampleBlock, effort: Effort) -> None:
        """Call all checks that have not reported yet."""
        self._samples += len(block)
        seen = CheckInput(block, effort, self._ledger, self._samples)
        for names, look in self._checks:
            if not all(name in self._found for name in names):
                for finding in look(seen):
                    self._found.setdefault(finding.check, finding)


OF_TOLERANCE = frozenset({"energy", "momentum", "angular momentum", "global error"})
"""Checks that advise a tighter tolerance."""


def beyond(singular: Finding, finding: Finding) -> Finding:
    """The finding without the advice of a tighter tolerance if it comes after a singular
    configuration, where short steps amplify round-off."""
    if finding.check not in OF_TOLERANCE or finding.finer_step or finding.t < singular.t:
        return finding
    advice = (
        f"the singular configuration at t = {singular.t:.4g} s enlarges round-off: "
        "a tighter tolerance does not help, a larger one (1e-9) may"
    )
    return finding._replace(advice=advice)


class CheckedSamples:
    """Iterates over blocks of samples, and checks them on the way.

    simulation: that makes the samples. blocks: of samples by time. second: whether a second run may
    follow (`compare_again`). After a reset, or after a state was set, the checks begin anew.
    """

    def __init__(
        self, simulation: Any, blocks: Iterable[SampleBlock], *, second: bool = False
    ) -> None:
        self._simulation, self._blocks = simulation, blocks
        self._check_list = self._new()
        self._second = SecondRun(simulation) if second else None
        self._found: list[Finding] = []
        self._before: tuple[Finding, ...] = ()
        """findings before the last reset."""

    def __iter__(self) -> Iterator[SampleBlock]:
        try:
            for block in self._blocks:
                if any(given.state for given in block.inputs):
                    self._end()
                    self._check_list = self._new()
                self._check_list.add(block, partial(effort_of, self._simulation))
                if self._second is not None:
                    self._second.add(block)
                yield block
        finally:
            self._end()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """All findings by time; complete after the last block."""
        return tuple(self._found)

    def compare_again(
        self, always: bool | None = None, within: float = math.inf
    ) -> GlobalError | None:
        """The global error by a second run, which may refute or add findings; None without one.

        always, within: as of `SecondRun.result`.
        """
        if self._second is None:
            return None
        singular = self._check_list.singular
        error = self._second.result(always, singular=singular, within=within)
        self._check_list.check(error, self._simulation, self._second.exchanged)
        self._found = [*self._before, *self._check_list.findings]
        return error

    def warn(self, stacklevel: int = 2) -> None:
        """Issue a Python warning for each finding, at the caller of the calling function."""
        tell((), self._found, stacklevel + 1)

    def _new(self) -> CheckList:
        of = self._simulation
        return CheckList(of.scene, of.layout, of.compiled)

    def _end(self) -> None:
        self._before = tuple(self._found)
        self._found += self._check_list.findings
