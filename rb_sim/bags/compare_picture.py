"""The differences of two motions over time, as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from rb_sim.bags.compare import UNITS, Differences

MOST_POINTS = 4000
FLOOR = 1e-17
"""A logarithm has no zero: smaller differences are left out, or drawn there if all are."""


def picture(found: Differences, path: Path, title: str) -> None:
    """Write one axis per quantity, logarithmic, with a line for each body or reaction."""
    from matplotlib.figure import Figure

    quantities = [q for q in UNITS if any(q in series for series in found.series.values())]
    figure = Figure(figsize=(9, 1.0 + 2.2 * len(quantities)), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(quantities), 1, sharex=True))
    figure.suptitle(title, fontsize=10)
    for axis, quantity in zip(axes, quantities, strict=True):
        for name, series in found.series.items():
            if quantity in series:
                stride = max(1, len(series[quantity]) // MOST_POINTS)
                values = _above_floor(series[quantity][::stride])
                axis.semilogy(
                    found.t[name][::stride] - found.start, values, label=name, linewidth=1.0
                )
        _shade_rounding(axis, found.floors[quantity])
        axis.set_ylabel(f"{quantity} apart [{UNITS[quantity]}]")
        axis.grid(alpha=0.3)
        axis.legend(fontsize=7, loc="best")
    axes[-1].set_xlabel(f"t - {found.start:.6f} [s]" if found.start else "t [s]")
    figure.savefig(path, dpi=120)


def _shade_rounding(axis: Any, floor: float) -> None:
    """Grey below the floor, which is always in view: what lies there is the same motion."""
    if not floor > 0.0:
        return
    low, high = axis.get_ylim()
    axis.set_ylim(low, max(high, 10.0 * floor))
    if low < floor:
        axis.axhspan(low, floor, color="0.9", zorder=0, label="rounding")


def _above_floor(values: np.ndarray) -> np.ndarray:
    """The values; NaN, thus a hole, for those below FLOOR, but a line at FLOOR if all are."""
    hole = FLOOR if (values <= FLOOR).all() else np.nan
    return np.where(values > FLOOR, values, hole)
