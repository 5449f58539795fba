"""Instants at which the velocity of a body jumps: nothing follows from poses beside them.

A polynomial through samples on both sides of an impact has accelerations of about the jump over a
few periods, which no force of the motion is. Where a run is ours its events tell the impacts. Of
others' poses a second difference d_k stands out from what those beside it foretell,

    D_k = d_k - 0.9 (d_k-2 + d_k+2) + 0.4 (d_k-3 + d_k+3)

(the cubic through four of them), is more than noise makes, and larger than all four.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.analysis.derivatives import NORMAL, ROUNDING, WINDOW, even, pieces

LOOK = 4
"""Samples on either side of one that are looked at."""
NEIGHBOURS = {2: 0.9, 3: -0.4}
"""Weights of the second differences as many samples before and after."""
SURE = 6.0
"""Standard deviations of D that noise does not reach."""
LARGER = 2.0
"""Times the second differences beside it: an oscillation of up to a radian a sample stays below."""
STILL = 1e-12
"""[m]: what moves by less is a point at rest, and its rounding."""
KEPT = 20
"""Intervals that are kept one by one."""
TOLD = 3


class Struck:
    """The instants of one body, in bounded memory.

    told: events tell them; else they are looked for in the poses.
    """

    def __init__(self, told: bool = False) -> None:
        self.told = told
        self.count = self.samples = self.of = 0
        """jumps; samples beside them; samples in all."""
        self.intervals: list[list[float]] = []
        self._times = np.empty(0)
        self._first: list[float] = []
        self._reach = 0.0

    def add(self, times: np.ndarray) -> None:
        """The next instants [s], increasing."""
        self._times = np.concatenate([self._times, times])
        self.count += len(times)
        self._first += times[: TOLD - len(self._first)].tolist()

    def look(self, t: np.ndarray, pose: np.ndarray) -> None:
        """Find those in poses (n, 7); stretches overlap by LOOK samples at least."""
        if self.told:
            return
        for part in pieces(t):
            if part.stop - part.start <= 2 * LOOK:
                continue
            at, rows, h = even(t[part], pose[part, :3], pose[part, 3:7])
            last = self._times[-1] if len(self._times) else -np.inf
            fresh = []
            for time in at[jumps(rows)].tolist():
                if time - last > 2.5 * h:
                    fresh.append(time)
                last = max(time, last)
            self.add(np.array(fresh))

    def beside(self, t: np.ndarray, h: float) -> np.ndarray:
        """Which of the instants t, h apart, have one within the filter's window."""
        reach = self._reach = (WINDOW // 2 + (0.0 if self.told else 1.0)) * h
        self._times = self._times[self._times >= t[0] - reach - WINDOW * h]
        k = np.searchsorted(self._times, t - reach)
        padded = np.append(self._times, np.inf)
        found = padded[k] <= t + reach
        self.of += len(t)
        self.samples += int(found.sum())
        self._keep(t, found, h)
        return found

    def _keep(self, t: np.ndarray, found: np.ndarray, h: float) -> None:
        edges = np.flatnonzero(np.diff(np.concatenate([[False], found, [False]]).astype(int)))
        for a, b in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
            if self.intervals and t[a] - self.intervals[-1][1] < 1.5 * h:
                self.intervals[-1][1] = float(t[b - 1])
            elif len(self.intervals) < KEPT:
                self.intervals.append([float(t[a]), float(t[b - 1])])

    @property
    def note(self) -> str:
        """When, and what is left out for it; or ""."""
        if not self.samples:
            return ""
        at = ", ".join(f"{t:.6g}" for t in self._first) + ", ..." * (self.count > len(self._first))
        what = "is struck" if self.told else "jumps, or moves too fast for its samples,"
        times = "once" if self.count == 1 else f"{self.count} times"
        return (
            f"{what} {times} (t = {at} s): within {self._reach:.2g} s of that nothing follows from "
            f"its poses; {self.samples} of {self.of} samples are left out of its motion and wrench"
        )

    def as_dict(self) -> dict[str, Any]:
        """Plain numbers."""
        return {"count": self.count, "samples": self.samples, "intervals": self.intervals}


def jumps(rows: np.ndarray) -> np.ndarray:
    """Indices of jumps of the velocity in even samples of a pose, shape (7, n)."""
    d = np.diff(rows, 2, axis=1)  # of sample 1 + k
    n, width = d.shape[1], max(NEIGHBOURS)
    middle = d[:, width : n - width]
    beside = {j: d[:, width + j : n - width + j] for k in NEIGHBOURS for j in (-k, k)}
    D = middle - sum(NEIGHBOURS[abs(j)] * part for j, part in beside.items())
    sigma = np.median(np.abs(D), axis=1) / NORMAL
    found = np.zeros(D.shape[1], bool)
    for part, still in ((slice(0, 3), STILL), (slice(3, 7), 0.0)):
        # of the noisiest component: how noise is shared among those of a quaternion changes
        least = max(SURE * sigma[part].max(), ROUNDING * np.abs(rows[part]).max(), still)
        size = np.linalg.norm(D[part], axis=0)
        others = np.max([np.linalg.norm(b[part], axis=0) for b in beside.values()], axis=0)
        found |= (np.abs(D[part]).max(axis=0) > least) & (size > LARGER * others)
    return np.flatnonzero(found) + width + 1
