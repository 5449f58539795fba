"""How much the scene itself magnifies one rounding: runs from initial states one ulp apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.errors import Errors, compare
from rb_sim.accuracy.runs import Runner

EPS = float(np.finfo(float).eps)


def ulp_growth(
    runner: Runner, setting: Setting, trials: int = 3, budget: float = math.inf
) -> Errors:
    """Largest differences that initial coordinates one ulp apart make.

    budget: time of the runner after which no further trial begins [s].
    """
    layout, start = runner.compiled.layout, runner.spent
    base, _ = runner.sampled(setting)
    random = np.random.default_rng(0)
    growths = []
    for trial in range(trials):
        if trial and runner.spent - start > budget:
            break
        moved, _ = runner.sampled(setting, y=one_ulp_apart(runner.compiled.y, random))
        growths.append(compare(moved, base, layout))
    return Errors(*np.max(growths, axis=0).tolist())


def one_ulp_apart(y: Any, random: np.random.Generator) -> Any:
    """The coordinates, each moved to the next double up or down; of the same kind as y.

    Zeros move by half an ulp of 1: they come out of sums of terms of the size of 1.
    """
    values = np.array(y, dtype=float)
    sides = np.where(random.integers(0, 2, len(values)) > 0, 1.0, -1.0)
    moved = np.where(values == 0.0, 0.5 * EPS * sides, np.nextafter(values, np.inf * sides))
    return moved if isinstance(y, np.ndarray) else tuple(float(v) for v in moved)
