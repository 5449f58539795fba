"""What energy that got lost on the way makes of a motion whose period hangs on it.

An error of the energy of one part in a million is none to a balance; over a hundred thousand swings
of a pendulum that goes nearly round it is all of the phase.  Two motions from where the run has
come to, one of them a little faster, part by

    |v1 - v2| / max |v| = s t dE,    v = (v_C, A w) of a body (see engine.velocities),

besides what they part by at once; s tells how much the period hangs on the energy.  With an error
that has grown evenly up to E the run itself has parted from the motion by s t E / 2.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from rb_sim.engine.velocities import lengths_of, measured
from rb_sim.finding import Finding

if TYPE_CHECKING:
    from rb_sim.engine.samples import SampleBlock
    from rb_sim.scene.schema import Scene
    from rb_sim.watches.bounds import Effort

PARTED = 0.1
"""Share of its largest velocity by which the energy's error may have moved a motion along its way;
above, it is told."""

SUSPECT = 0.03
"""Error of the energy, relative, times steps from which on it is asked how much the motion hangs on
it: below, it would have to hang on it more than that of a pendulum at 3 rad."""

COST = 200
"""Steps of the run for one of each motion beside it."""

FEWEST, MOST = 200, 400
"""Of these: 200 are some tens of swings; over fewer no slow growth stands out from what parts
at once."""

FASTER, LEAST, FOLD = 1e-2, 1e-5, 10.0
"""Share by which the one is faster, at most and at least; in between so many times what the
tolerance lets both miss."""

ENDS = 10
"""Part of their samples, a tenth, that shows how far they are apart at once, and in the end."""


def period_found(
    scene: Scene, effort: Effort, missed: float, exchanged: float, t: float
) -> Finding | None:
    """What `missed` of the energy [J] makes of the motion up to t, where that is too much.

    exchanged: what the energy is compared with [J].
    """
    steps = min(effort.steps // COST, MOST)
    if effort.tolerance is None or effort.ahead is None or steps < FEWEST or not exchanged > 0.0:
        return None
    if missed / exchanged * effort.steps < SUSPECT:
        return None
    span = steps * t / effort.steps
    faster = min(max(FOLD * effort.local * steps, LEAST), FASTER)
    slow, fast = (effort.ahead(span, 2 * steps, more) for more in (0.0, faster))
    if slow is None or fast is None:
        return None
    figure = 0.5 * t * missed * growth(scene, slow, fast)
    if not figure > PARTED:
        return None
    what = "what the energy missed so far makes of the motion, over its velocities,"
    lower = (effort.own_tolerance or 1.0) * min(0.1, PARTED / figure)
    advice = (
        f"its period hangs on the energy: try a tolerance below {lower:.0e}, and --certify for "
        "when it is lost"
    )
    return Finding("period", t, min(figure, 1.0), PARTED, what, "", advice)


def growth(scene: Scene, slow: SampleBlock, fast: SampleBlock) -> float:
    """By how much velocities part in a second for each joule [1/(J s)]; 0 where they do not."""
    lengths = lengths_of(scene.bodies.values())
    one, two = (measured(b.linear_velocity, b.angular_velocity, lengths) for b in (slow, fast))
    with np.errstate(all="ignore"):
        apart = np.linalg.norm(one - two, axis=2) / np.linalg.norm(one, axis=2).max(axis=0)
    apart = np.nan_to_num(apart).max(axis=1)
    tenth = len(apart) // ENDS
    first, last = float(apart[:tenth].max()), float(apart[-tenth:].max())
    more = abs(float(fast.energy[0] - slow.energy[0]))
    if not more > 0.0:
        return 0.0
    return max(0.0, last - first) / (0.9 * float(slow.t[-1] - slow.t[0]) * more)
