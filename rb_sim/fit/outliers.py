"""Poses that lie far from all others beside the motion that was fitted: they draw the fit.

Least squares takes one pose that is a hundred times as far off as ten thousand others. How far the
others are tells the median of the residuals' sizes, which a few outliers do not change (Huber,
Robust Statistics, 1981).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rb_sim.analysis.derivatives import NORMAL

FAR = 10.0
"""Standard deviations of the noise: no sample of any size has one so far from noise."""
MOST = 0.1
"""Of the poses: more of them are no outliers, but another motion."""
TOLD = 3

Residuals = Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]]


def outliers(residuals: Residuals, rounding: float) -> tuple[str, ...]:
    """A line for each body that has some. residuals: as of `Fitted`; rounding: what is no more than
    that [m, rad] is none."""
    lines = []
    for body, (t, *parts) in residuals.items():
        far = np.zeros(len(t), bool)
        for part in parts:
            size = np.abs(part)
            sigma = np.median(size, axis=0) / NORMAL
            far |= (size > np.maximum(FAR * sigma, rounding)).any(axis=1)
        if far.any() and far.sum() <= MOST * len(t):
            at = ", ".join(f"{x:.6g}" for x in t[far][:TOLD]) + ", ..." * bool(far.sum() > TOLD)
            lines.append(
                f"{body}: {far.sum()} of {len(t)} poses are off by more than {FAR:g} times the "
                f"noise of the others (t = {at} s): they draw the fit and enlarge its errors"
            )
    return tuple(lines)
