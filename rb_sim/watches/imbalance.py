"""Where the balances of a run pass their bounds: energy against work, momentum against impulse."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.finding import Finding
from rb_sim.watches.resolution import DOUBTS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rb_sim.engine.samples import SampleBlock, SampleLayout
    from rb_sim.watches.balance import Ledger
    from rb_sim.watches.bounds import Effort
    from rb_sim.watches.resolution import Resolution

FAR_MORE = 1e3
"""Times the work that samples between jumps of the velocities show, that may have been done."""


def energy_found(
    ledger: Ledger, resolution: Resolution, block: SampleBlock, layout: SampleLayout, effort: Effort
) -> Finding | None:
    """Energy that came from nowhere or is gone, as it shows at the end of the block."""
    energy = ledger.energy()
    error = 0.0 if energy is None else abs(energy["error"])
    if energy is None or (energy["relative"] is None and np.isfinite(error)):
        return None
    scale, doubt = energy["scale"], energy["quadrature"]
    if np.isfinite(error):
        bound = effort.balance * scale + ledger.rounding + ledger.at_rest
        if error <= bound + DOUBTS * doubt:
            return None
        # infinite doubts of nothing are no number, and no reason to speak
        unknown = resolution.doubts * doubt
        if resolution.jumps_alone and not unknown <= FAR_MORE * ledger.worked:
            unknown = FAR_MORE * ledger.worked if ledger.worked > 0.0 else np.inf
        if ledger.has_work and not error > bound + unknown:
            return None
    lost = np.flatnonzero(~np.isfinite(block.energy))
    i = int(lost[0]) if len(lost) else ledger.first_beyond(block, effort.balance)
    figure = error / scale if scale > 0.0 else np.inf
    finer = effort.finer_step(figure, effort.balance)
    return Finding(
        "energy",
        float(block.t[i]),
        figure,
        effort.balance,
        "change of energy less work, relative to the energy exchanged",
        liveliest(block, layout, i),
        effort.advice(finer),
        finer,
    )


def momentum_found(
    ledger: Ledger, resolution: Resolution, block: SampleBlock, layout: SampleLayout, effort: Effort
) -> Iterator[Finding]:
    """Momentum, linear or angular, that no impulse explains at the end of the block."""
    balances = ledger.momentum()
    if balances is None or not resolution.resolved:
        return
    bound = 10.0 * effort.balance
    for (name, balance), unseen in zip(balances.items(), resolution.unseen, strict=True):
        error, scale, doubt = abs(balance["error"]), balance["scale"], balance["quadrature"]
        if balance["relative"] is None:
            continue
        if np.isfinite(error) and error <= bound * scale + DOUBTS * doubt + unseen:
            continue
        last = len(block) - 1
        finer = effort.finer_step(error / scale, bound)
        yield Finding(
            "momentum" if name == "linear" else "angular momentum",
            float(block.t[last]),
            error / scale,
            bound,
            "change less impulse of what acts from outside, relative to the largest",
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
