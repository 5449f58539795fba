"""The stretches of a run of ours between resets and states that were set, and their balances.

No motion leads from the sample before such an instant to the one at it: nothing is differentiated,
and no balance drawn, across it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from rb_sim.checks.balance import FIRST_EVENTS, Ledger
from rb_sim.io.bag.reader import BagReader
from rb_sim.io.sink import stretches
from rb_sim.mechanics.samples import SampleBlock, SampleLayout
from rb_sim.scene.schema import Scene

MOST_TOLD = 3
FEW = 4
"""Samples between changes of commands, on average, below which balances are only a rough figure."""


class Part(NamedTuple):
    """Samples in a row."""

    block: SampleBlock
    anew: bool
    """whether they begin with a state that no motion leads to."""
    since: float
    """stamp at which the scene's own time, that of its laws, was zero [s]."""


def parts_of(reader: BagReader) -> Iterator[Part]:
    """The samples of a bag, cut where a state was set or the run began anew."""
    node = reader.settings.get("by") == "node"
    period = 1.0 / reader.scene.simulation.rate if node else 0.0
    since, some = 0.0, False
    for block in reader.blocks():
        for part, given in stretches(block):
            if given is not None:
                # a node's stamps go on: after a reset time is zero again, a state takes a period
                since = since + period if given.state else given.t * node
            if len(part) or part.events:
                yield Part(part, given is not None and some, since)
            some = some or len(part) > 0


class Balances:
    """Energy and momenta of a run over its stretches, summed up; bounded memory."""

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        self._scene, self._layout = scene, layout
        self._ledger = Ledger(scene, layout)
        self._energy: dict[str, Any] | None = None
        self._momentum: dict[str, Any] | None = None
        self._contacts: dict[str, Any] | None = None
        self._anew: list[float] = []
        self._latest = -np.inf
        self._count = self._samples = self._changes = 0

    def add(self, part: Part) -> None:
        """The next samples."""
        if part.anew:
            self._close()
            self._ledger = Ledger(self._scene, self._layout, part.since)
            self._count += 1
            self._anew += part.block.t[: MOST_TOLD - len(self._anew)][:1].tolist()
        self._samples += len(part.block)
        self._ledger.add(part.block, self._commands(part.block, part.anew))
        if len(part.block):  # else events alone, after the last sample
            self._latest = float(part.block.t[-1])

    def finish(self) -> dict[str, Any]:
        """Balances of energy and momentum, as of one run; no more samples come."""
        self._close()
        found = {"energy": self._energy, "momentum": self._momentum}
        return found | ({"stretches": 1 + self._count} if self._count else {})

    @property
    def contacts(self) -> dict[str, Any] | None:
        """Work and events of all stretches, after `finish`."""
        return self._contacts

    @property
    def notes(self) -> list[str]:
        """Where the balances begin anew, and whether commands leave them too few samples."""
        lines = []
        if self._count:
            at = ", ".join(f"{t:g}" for t in self._anew) + ", ..." * (self._count > len(self._anew))
            lines.append(f"reset or put elsewhere {self._count} times (t = {at} s): nothing is "
                         "differentiated or balanced across that")  # fmt: skip
        if self._changes * FEW > self._samples:
            lines.append(f"commands come at {self._changes} of {self._samples} samples: power and "
                         "reactions jump there, and the balances are only as good as the samples "
                         "in between")  # fmt: skip
        return lines

    def _commands(self, block: SampleBlock, anew: bool) -> list[float]:
        """Instants from which on another command acts: right after the sample before."""
        changed = sorted({given.index for given in block.inputs})
        self._changes += len(changed)
        if len(changed) * FEW > len(block):
            return []
        before = [block.t[k - 1] if k else self._latest for k in changed if k or not anew]
        return [float(np.nextafter(t, np.inf)) for t in before]

    def _close(self) -> None:
        """A stretch is over."""
        ledger = self._ledger
        if not ledger.samples:
            return
        self._energy = _energies(self._energy, ledger.energy())
        self._contacts = _contacts(self._contacts, ledger.contacts())
        momentum = ledger.momentum()
        if momentum is not None:
            before = self._momentum or dict.fromkeys(momentum)
            self._momentum = {
                name: _joined(before[name], balance) for name, balance in momentum.items()
            }


def _joined(before: dict[str, Any] | None, now: dict[str, Any]) -> dict[str, Any]:
    """Errors and doubts added, the larger of the scales."""
    if before is None:
        return now
    error, scale = before["error"] + now["error"], max(before["scale"], now["scale"])
    found = before | {"error": error, "scale": scale}
    found["relative"] = abs(error) / scale if scale > 0.0 else None
    found["quadrature"] = before["quadrature"] + now["quadrature"]
    return found


def _energies(before: dict[str, Any] | None, now: dict[str, Any] | None) -> dict[str, Any] | None:
    if before is None or now is None:
        return before or now
    return _joined(before, now) | {"final": now["final"], "work": before["work"] + now["work"]}


def _contacts(before: dict[str, Any] | None, now: dict[str, Any] | None) -> dict[str, Any] | None:
    if before is None or now is None:
        return before or now
    counts = {
        kind: before["events"].get(kind, 0) + now["events"].get(kind, 0)
        for kind in {**before["events"], **now["events"]}
    }
    sums = [before["impulses"], now["impulses"]]
    impulses = {
        name: np.sum([part[name] for part in sums if name in part], axis=0).tolist()
        for name in {**sums[0], **sums[1]}
    }
    first = (before["first_events"] + now["first_events"])[:FIRST_EVENTS]
    return {"work": before["work"] + now["work"], "events": counts, "first_events": first,
            "impulses": impulses}  # fmt: skip
