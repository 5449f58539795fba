# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Where the balances of a run pass their bounds: energy against work, momentum against impulse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.base.diagnostic import Finding
from rb_sim.checks.balance import bodies_at_work
from rb_sim.checks.check import Look, Run, Seen

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rb_sim.mechanics.samples import SampleBlock, SampleLayout


DOUBTS = 10.0
"""Times what the samples leave in doubt of an integral, that it may be wrong by."""

TIMES = 10.0
"""Bound of a momentum over that of the energy."""

WHAT = {
    "energy": "energy error relative to the energy exchanged",
    "momentum": "linear momentum error relative to the largest momentum",
    "angular momentum": "angular momentum error relative to the largest momentum",
}


def balances(run: Run) -> Look:
    """Energy that no work explains, and momentum that no impulse does."""
    at_work = bodies_at_work(run.scene, run.layout)
    return lambda seen: unbalanced(seen, run.layout, at_work)


def unbalanced(seen: Seen, layout: SampleLayout, at_work: list[int]) -> Iterator[Finding]:
    """What is beyond its bound at the end of the block.

    Samples that do not resolve a body on a spring tell the work of a drag on another one, at_work,
    all the same, and with it whether energy is lost.
    """
    block, effort, ledger, resolution = seen.block, seen.effort, seen.ledger, seen.resolution
    for name, balance in ledger.balances().items():
        error, scale = abs(balance["error"]), balance["scale"]
        bound, at_rest = TIMES * effort.balance, 0.0
        known, i = resolution.resolved(), len(block) - 1
        if name == "energy":
            bound, at_rest = effort.balance, ledger.at_rest
            known = not ledger.has_work or resolution.resolved(at_work)
        elif balance["relative"] is None:
            continue
        if np.isfinite(error) and (
            not known or error <= bound * scale + at_rest + DOUBTS * balance["quadrature"]
        ):
            continue
        if name == "energy":
            lost = np.flatnonzero(~np.isfinite(block.energy))
            i = int(lost[0]) if len(lost) else ledger.first_beyond(block, bound)
        least = scale or at_rest  # nothing was exchanged where all bodies are exactly at rest
        figure = error / least if least > 0.0 else np.inf
        finer = effort.finer_step(figure, bound)
        where, advice = liveliest(block, layout, i), effort.advice(finer)
        yield Finding(name, float(block.t[i]), figure, bound, WHAT[name], where, advice, finer)


def liveliest(block: SampleBlock, layout: SampleLayout, i: int) -> str:
    """The body that moves most at sample i."""
    speed = np.linalg.norm(block.linear_velocity[i], axis=1)
    spin = np.linalg.norm(block.angular_velocity[i], axis=1)
    moved = np.nan_to_num(speed + spin, nan=np.inf)
    return layout.bodies[int(moved.argmax())]
