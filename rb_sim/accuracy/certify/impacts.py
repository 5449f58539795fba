"""What the roundings of impacts add up to, beside that of the start."""

from __future__ import annotations

import numpy as np

from rb_sim.engine.samples import Array


def rounded_at_impacts(times: Array, ulp: Array, impacts: Array) -> Array:
    """sum over the impacts before t of ulp(t - t_impact): errors that the roundings of all impacts
    may add up to, shape (n, 6).

    An impact finds its instant and all velocities anew, each but for its last bit, which then goes
    on as one ulp of the start does. Two runs that are compared meet the same states and round them
    alike, so that their difference does not show it. times: of the samples from 0 on, (n,) [s];
    ulp: what one ulp in every coordinate of the start makes of the six quantities, (n, 6);
    impacts: their times [s].
    """
    total = np.zeros_like(ulp)
    worst = np.maximum.accumulate(ulp, axis=0)
    # the impacts between two samples count together, as from the earlier one on
    first = np.searchsorted(times, impacts, side="right") - 1
    for i, count in zip(*np.unique(first, return_counts=True), strict=True):
        after = times[i:] - times[i]
        for k in range(ulp.shape[1]):
            total[i:, k] += count * np.interp(after, times, worst[:, k])
    return total
