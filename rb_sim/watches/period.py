"""What energy that got lost on the way makes of a motion whose period hangs on it.

An error of the energy of one part in a million is none to a balance; over a hundred thousand swings
of a pendulum that goes nearly round it is all of the phase.  Two motions from where the run has
come to, one of them a little faster, part by

    |v1 - v2| / max |v| = s t dE,    v = (v_C, A w) of a body (see engine.velocities),

besides what they part by at once; s tells how much the period hangs on the energy.  With an error
that has grown evenly up to E the run itself has parted from the motion by s t E / 2.

In fixed steps the error may go to and fro without growing, as that of a symplectic method does:
there only that counts by which the end of the run is off beyond all that its first quarter was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from rb_sim.engine.velocities import lengths_of, measured
from rb_sim.finding import Finding

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock
    from rb_sim.scene.schema import Scene
    from rb_sim.watches.bounds import Effort

PARTED = 0.1
"""Share of its largest velocity by which the energy's error may have moved a motion along its way;
above, it is told."""

SUSPECT = 0.03
"""Error of the energy, relative, times steps from which on it is asked how much the motion hangs on
it: below, it would have to hang on it more than that of a pendulum at 3 rad."""

FOLD = 10.0
"""Times what the tolerance lets both motions miss, by which share the one is faster."""


class Beside(NamedTuple):
    """How the two motions beside a run are taken and compared."""

    cost: int
    """steps of the run for one of each of them."""
    fewest: int
    """of their steps; over fewer no slow growth stands out from what parts at once."""
    most: int
    samples: float
    """for each of their steps."""
    ends: int
    """part of their samples that shows how far they are apart at once, and in the end."""
    faster: tuple[float, float]
    """share by which the one is faster, at least and at most; in between see FOLD."""


ADAPTIVE = Beside(cost=200, fewest=200, most=400, samples=2.0, ends=10, faster=(1e-5, 1e-2))
"""200 steps are some tens of swings."""

FIXED = Beside(cost=500, fewest=500, most=2000, samples=0.5, ends=4, faster=(3e-4, 3e-4))
"""Steps are a tenth as long: of 500 a quarter is still a swing; in less than one the ends would
show where in the swing they are.  Both motions are on one grid, so that what steps miss of the one
they miss of the other, and a small share does."""

EARLY = 0.25
"""Share of a run in which an error that grows evenly has a quarter of its size."""

KEPT = 64
"""Stretches of a run of which the largest error is kept."""


def period_found(
    scene: Scene, effort: Effort, missed: float, exchanged: float, t: float
) -> Finding | None:
    """What `missed` of the energy [J] makes of the motion up to t, where that is too much.

    exchanged: what the energy is compared with [J].
    """
    beside = FIXED if effort.tolerance is None else ADAPTIVE
    steps = min(effort.steps // beside.cost, beside.most)
    if effort.ahead is None or steps < beside.fewest or not exchanged > 0.0:
        return None
    if missed / exchanged * effort.steps < SUSPECT:
        return None
    span = steps * t / effort.steps
    least, most = beside.faster
    faster = min(max(FOLD * effort.local * steps, least), most)
    count = int(beside.samples * steps)
    slow, fast = (effort.ahead(span, count, more) for more in (0.0, faster))
    if slow is None or fast is None:
        return None
    figure = 0.5 * t * missed * growth(scene, slow, fast, beside.ends)
    if not figure > PARTED:
        return None
    what = "what the energy missed so far makes of the motion, over its velocities,"
    finer = effort.finer_step(figure, PARTED)
    tried = "a shorter step" if finer is None else f"step {finer:g} s"
    if effort.own_tolerance is not None:
        tried = f"a tolerance below {effort.own_tolerance * min(0.1, PARTED / figure):.0e}"
    advice = f"its period hangs on the energy: try {tried}, and --certify for when it is lost"
    return Finding("period", t, min(figure, 1.0), PARTED, what, "", advice, finer)


class Missed:
    """The largest error of the energy in each stretch of a run, in bounded memory."""

    def __init__(self) -> None:
        self._stretches: list[tuple[float, float]] = []
        """(end [s], largest error [J])."""

    def add(self, t: float, error: float) -> None:
        """The largest of a stretch up to t."""
        self._stretches.append((t, error))
        if len(self._stretches) >= KEPT:
            pairs = zip(self._stretches[::2], self._stretches[1::2], strict=True)
            self._stretches = [(b[0], max(a[1], b[1])) for a, b in pairs]

    def look(self, t: Array, error: Array) -> None:
        """The errors at samples, stretch by stretch."""
        for part in np.array_split(np.arange(len(t)), min(len(t), KEPT // 4)):
            self.add(float(t[part[-1]]), float(np.abs(error[part]).max()))

    def grown(self, error: float, t: float) -> float:
        """What an error at t is beyond all of the first EARLY of the time; 0 where that is unknown.

        An error that grew evenly is taken for all of it.
        """
        early = [size for end, size in self._stretches if end <= EARLY * t]
        beyond = error - max(early) if early else 0.0
        return max(0.0, beyond / (1.0 - EARLY))


def growth(scene: Scene, slow: SampleBlock, fast: SampleBlock, ends: int) -> float:
    """By how much velocities part in a second for each joule [1/(J s)]; 0 where they do not.

    ends: part of the samples that shows how far they are apart at once, and in the end.
    """
    lengths = lengths_of(scene.bodies.values())
    one, two = (measured(b.linear_velocity, b.angular_velocity, lengths) for b in (slow, fast))
    with np.errstate(all="ignore"):
        apart = np.linalg.norm(one - two, axis=2) / np.linalg.norm(one, axis=2).max(axis=0)
    apart = np.nan_to_num(apart).max(axis=1)
    end = len(apart) // ends
    first, last = float(apart[:end].max()), float(apart[-end:].max())
    more = abs(float(fast.energy[0] - slow.energy[0]))
    if not more > 0.0:
        return 0.0
    return max(0.0, last - first) / ((1.0 - 1.0 / ends) * float(slow.t[-1] - slow.t[0]) * more)
