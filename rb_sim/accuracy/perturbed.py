"""How much the scene itself magnifies one rounding: runs from initial states one ulp apart."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.errors import Errors, compare
from rb_sim.accuracy.runs import Runner
from rb_sim.engine.samples import Array
from rb_sim.engine.system import CONFIGURATION
from rb_sim.scene.compiled import Compiled

EPS = float(np.finfo(float).eps)

BODY, PLACES = 13, 7
"""Coordinates of a body that nothing holds, and of many: position, quaternion, velocity, spin; and
how many of them tell where it is."""


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


def one_ulp_apart(y: Any, random: np.random.Generator, sizes: Array | None = None) -> Any:
    """The coordinates, each moved to the next double up or down; of the same kind as y.

    Zeros move by half an ulp of their size: they come out of sums of terms that large. sizes: of
    each coordinate, (n,); None: 1.
    """
    values = np.array(y, dtype=float)
    sides = np.where(random.integers(0, 2, len(values)) > 0, 1.0, -1.0)
    least = 0.5 * EPS * (1.0 if sizes is None else sizes)
    moved = np.where(values == 0.0, least * sides, np.nextafter(values, np.inf * sides))
    return moved if isinstance(y, np.ndarray) else tuple(float(v) for v in moved)


def sizes_of(rows: Array, compiled: Compiled) -> Array:
    """How large each coordinate becomes in a run, its places, velocities and spins by their norms;
    1 for a quaternion, for what stays zero, and in coordinates that are none of these.

    rows: samples of the run. What swings by a nanometre has no terms of a metre.
    """
    n, bodies = len(compiled.y), len(compiled.layout.bodies)
    sizes = np.ones(n)
    if compiled.reduced and (n != BODY or CONFIGURATION.get(type(compiled.system)) != PLACES):
        return sizes
    states = rows[:, : BODY * bodies].reshape(len(rows), bodies, BODY)
    for part in (slice(0, 3), slice(7, 10), slice(10, 13)):
        with np.errstate(all="ignore"):
            largest = np.nan_to_num(np.linalg.norm(states[:, :, part], axis=2)).max(axis=0)
        for i in np.flatnonzero(largest):
            sizes[BODY * i + part.start : BODY * i + part.stop] = largest[i]
    return sizes
