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
"""Times what leaving out every other sample changes an integral by, that it may be wrong by."""


def energy(run: Run) -> Look:
    """Energy that came from nowhere or is gone."""
    at_work = bodies_at_work(run.scene, run.layout)
    return lambda seen: energy_found(seen, run.layout, at_work)


def energy_found(seen: Seen, layout: SampleLayout, at_work: list[int]) -> Iterator[Finding]:
    """Energy that came from nowhere or is gone, as it shows at the end of the block.

    Samples that do not resolve a body on a spring tell the work of a drag on another one, at_work,
    all the same, and with it whether energy is lost.
    """
    block, effort, ledger, resolution = seen.block, seen.effort, seen.ledger, seen.resolution
    energy = ledger.energy()
    if energy is None:
        return
    error, scale, doubt = abs(energy["error"]), energy["scale"], energy["quadrature"]
    if np.isfinite(error):
        bound = effort.balance * scale + ledger.at_rest
        if error <= bound + DOUBTS * doubt:
            return
        if ledger.has_work and not resolution.resolved(at_work):  # loads act between samples
            return
    lost = np.flatnonzero(~np.isfinite(block.energy))
    i = int(lost[0]) if len(lost) else ledger.first_beyond(block, effort.balance)
    least = scale or ledger.at_rest  # nothing was exchanged where all bodies are exactly at rest
    figure = error / least if least > 0.0 else np.inf
    finer = effort.finer_step(figure, effort.balance)
    yield Finding(
        "energy",
        float(block.t[i]),
        figure,
        effort.balance,
        "energy error relative to the energy exchanged",
        liveliest(block, layout, i),
        effort.advice(finer),
        finer,
    )


def momentum(run: Run) -> Look:
    """Momentum, linear or angular, that no impulse explains."""
    return lambda seen: momentum_found(seen, run.layout)


def momentum_found(seen: Seen, layout: SampleLayout) -> Iterator[Finding]:
    """Momentum, linear or angular, that no impulse explains at the end of the block."""
    block, effort, balances = seen.block, seen.effort, seen.ledger.momentum()
    if balances is None or not seen.resolution.resolved():
        return
    bound = 10.0 * effort.balance
    for name, balance in balances.items():
        error, scale, doubt = abs(balance["error"]), balance["scale"], balance["quadrature"]
        if balance["relative"] is None:
            continue
        if np.isfinite(error) and error <= bound * scale + DOUBTS * doubt:
            continue
        last = len(block) - 1
        finer = effort.finer_step(error / scale, bound)
        yield Finding(
            "momentum" if name == "linear" else "angular momentum",
            float(block.t[last]),
            error / scale,
            bound,
            f"{name} momentum error relative to the largest momentum",
            liveliest(block, layout, last),
            effort.advice(finer),
            finer,
        )


def liveliest(block: SampleBlock, layout: SampleLayout, i: int) -> str:
    """The body that moves most at sample i."""
    speed = np.linalg.norm(block.linear_velocity[i], axis=1)
    spin = np.linalg.norm(block.angular_velocity[i], axis=1)
    moved = np.nan_to_num(speed + spin, nan=np.inf)
    return layout.bodies[int(moved.argmax())]
