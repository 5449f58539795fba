# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""All accuracy checks of one run: fed with its samples, asked for their findings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rb_sim.base.diagnostic import Finding, tell
from rb_sim.checks.balance import Ledger, bodies_at_work
from rb_sim.checks.check import Check, Effort, Run, Seen, effort_of
from rb_sim.checks.imbalance import energy, momentum
from rb_sim.checks.sample_integrals import Resolutions
from rb_sim.checks.second_run import BOUND, finding_of, is_decided
from rb_sim.checks.singular_configuration import rank
from rb_sim.checks.steps import chatter, steps, turns
from rb_sim.checks.violation import inside, residual
from rb_sim.mechanics.samples import ARRAYS

if TYPE_CHECKING:
    from rb_sim.base.diagnostic import GlobalError
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.compiled import Compiled
    from rb_sim.scene.schema import Scene

CHECKS: tuple[Check, ...] = (
    (("energy",), energy),
    (("momentum", "angular momentum"), momentum),
    (("residual",), residual),
    (("singular configuration",), rank),
    (("time", "step", "contact steps", "ambiguous"), steps),
    (("turn",), turns),
    (("inside",), inside),
    (("events",), chatter),
)
"""All checks that need no second run."""

MOST_CHANGES = 16
"""Changes of commands in one block above which no balance is drawn: a stream of commands leaves
pieces of a few samples, which say nothing and would cost more than the motion."""


class CheckList:
    """Checks one run. scene, layout: of the simulation whose samples will come; compiled: the scene
    as it is run."""

    def __init__(
        self, scene: Scene, layout: SampleLayout, compiled: Compiled | None = None
    ) -> None:
        self._run = Run(scene, layout, compiled)
        self._checks = [(names, make(self._run)) for names, make in CHECKS]
        self._found: dict[str, Finding] = {}
        self._samples = 0
        self._command: np.ndarray | None = None
        self._begin_anew()

    @property
    def ledger(self) -> Ledger:
        """The balances of all samples so far, or since the last command."""
        return self._ledger

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound so far, each check at most once, by time."""
        singular = self._found.get("singular configuration")
        found = (
            finding if singular is None else beyond(singular, finding)
            for finding in self._found.values()
        )
        return tuple(sorted(found, key=lambda finding: finding.t))

    @property
    def singular(self) -> float | None:
        """When the run has passed a singular configuration [s]; None: never."""
        found = self._found.get("singular configuration")
        return None if found is None else found.t

    def check(self, error: GlobalError, simulation: Any) -> None:
        """Report what a second run of the simulation shows, if it is beyond its bound.

        One within it decides what the setting seemed to leave open, and says more of the error
        than balances that are within the same bound: they hang on how well samples resolve loads.
        """
        found = finding_of(error, simulation)
        if found is not None:
            self._found.setdefault(found.watch, found)
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
        """The next samples. effort: of the run up to their end, or what gives it.

        Where a command changes, balances begin anew from the first sample that it has acted on.
        """
        if not len(block):
            return
        effort_now = effort if isinstance(effort, Effort) else effort()
        first, jumps = 0, self._jumps(block)
        with np.errstate(all="ignore"):
            if len(jumps) > MOST_CHANGES:
                self._begin_anew()
                self._look(block, effort_now)
                return
            for jump in jumps:
                self._add(_cut(block, first, jump), effort_now)
                self._begin_anew()
                first = jump
            self._add(_cut(block, first, len(block)) if first else block, effort_now)

    def _begin_anew(self) -> None:
        """Draw balances from the next sample on."""
        self._ledger = Ledger(self._run.scene, self._run.layout)
        self._resolution = Resolutions(self._run.layout, bodies_at_work(self._run.scene))

    def _jumps(self, block: SampleBlock) -> list[int]:
        """Samples of the block that show another command than the one before."""
        if not self._run.layout.commanded:
            return []
        flat = block.command.reshape(len(block), -1)
        before = flat[:1] if self._command is None else self._command
        self._command = flat[-1:].copy()
        return np.flatnonzero((flat != np.append(before, flat[:-1], 0)).any(axis=1)).tolist()

    def _add(self, block: SampleBlock, effort: Effort) -> None:
        if len(block):
            self._ledger.add(block)
            self._resolution.add(block)
            self._look(block, effort)

    def _look(self, block: SampleBlock, effort: Effort) -> None:
        """Ask all checks that have not reported yet."""
        self._samples += len(block)
        seen = Seen(block, effort, self._ledger, self._resolution, self._samples)
        for names, look in self._checks:
            if not all(name in self._found for name in names):
                for finding in look(seen):
                    self._found.setdefault(finding.watch, finding)


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


# Samples on their way from a simulation to whoever asked for them, looked at by all checks.


class CheckedSamples:
    """Iterates over blocks of samples and keeps what the checks find in them.

    simulation: whose samples they are; its effort is asked for as they come. blocks: of samples in
    time. From a reset, or a state that was set, on the checks begin anew, for it is another run.
    """

    def __init__(self, simulation: Any, blocks: Iterable[SampleBlock]) -> None:
        self._simulation, self._blocks = simulation, blocks
        self._check_list = self._new()
        self._found: list[Finding] = []
        self._before: tuple[Finding, ...] = ()
        """of runs before the last reset."""

    def __iter__(self) -> Iterator[SampleBlock]:
        try:
            for block in self._blocks:
                if any(given.state for given in block.inputs):
                    self._end()
                    self._check_list = self._new()
                else:
                    self._check_list.add(block, partial(effort_of, self._simulation))
                yield block
        finally:
            self._end()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What has passed its bound, by time; whole once the blocks have come to their end."""
        return tuple(self._found)

    @property
    def singular(self) -> float | None:
        """When the run has passed a singular configuration [s]; None: never."""
        return self._check_list.singular

    def check(self, error: GlobalError) -> None:
        """Add what the second run shows."""
        self._check_list.check(error, self._simulation)
        self._found = [*self._before, *self._check_list.findings]

    def warn(self, stacklevel: int = 2) -> None:
        """Give a Python warning for each finding, at the caller of the function that calls this."""
        tell((), self._found, stacklevel + 1)

    def _new(self) -> CheckList:
        of = self._simulation
        return CheckList(of.scene, of.layout, of.compiled)

    def _end(self) -> None:
        self._before = tuple(self._found)
        self._found += self._check_list.findings
