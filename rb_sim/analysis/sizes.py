"""How large the numbers of a unit are, all in all: what is far less is rounding."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from rb_sim.analysis.figures import Figures
from rb_sim.analysis.units import unit_of

RESIDUAL = "residual"
"""The source that is relative to the scene's scale, which is 1 therefore."""


def sizes_of(sources: Iterable[tuple[str, Figures]], length: float) -> dict[str, float]:
    """The largest absolute value of each unit.

    Bodies that reach r [m] from their origins, turn at w and take a force F move elsewhere at r w,
    and a torque of F r is of their size.  length: r.
    """
    sizes: dict[str, float] = {}
    for name, figures in sources:
        for column, size in zip(figures.names, figures.size.tolist(), strict=True):
            unit = unit_of(name, column)
            sizes[unit] = max(sizes.get(unit, 0.0), size)
    sizes["m"] = max(sizes.get("m", 0.0), length)
    sizes["m/s"] = max(sizes.get("m/s", 0.0), length * sizes.get("rad/s", 0.0))
    sizes["N m"] = max(sizes.get("N m", 0.0), length * sizes.get("N", 0.0))
    return sizes


def sizes_beside(name: str, figures: Figures, sizes: Mapping[str, float]) -> np.ndarray:
    """What each number of a source is small or large beside; those without a unit are compared with
    their own kind only: what one topic counts says nothing of another."""
    if name == RESIDUAL:
        return np.ones(len(figures.names))
    units = [unit_of(name, column) for column in figures.names]
    own = max((float(s) for s, u in zip(figures.size, units, strict=True) if not u), default=0.0)
    return np.array([sizes.get(unit, 0.0) if unit else own for unit in units])
