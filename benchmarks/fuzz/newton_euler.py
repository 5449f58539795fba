# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Newton's and Euler's laws on a run: dv/dt by differences of its samples beside its wrenches.

The velocities come from the solver, the accelerations from the reactions and effects that the run
reports: a term that is missing in either, a wrong sign on a parent, a wrong point shows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rb_sim import Simulation, Trajectory

Array = Any

AT = 0.02
"""Time of the scene at which it is looked [s]."""

SPACINGS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8)
"""Of the samples [s]: the one that gives the surest difference counts. A spring of 1e5 N/m turns a
thin rod to and fro about its own axis at 1e6 rad/s."""

TOLERANCE, COARSER = 1e-11, 1e-10
"""Of the run, and of another that tells what the tolerance leaves in the accelerations: of a spin
that dies out at 1e7 /s they err by 1e7 times as much as it."""

CONTRADICTION = 30.0
"""Doubts of the difference by which a law must be broken."""

SHARE = 1e-5
"""Of the largest acceleration in the scene, below which nothing is a find."""

CANCELLED = 1e-9
"""The same of what the wrenches would do one by one: of a body that is held they cancel."""


class Gap(NamedTuple):
    """The derivative of a body's velocity beside the acceleration that its wrenches give."""

    slope: Array
    reported: Array
    uncertainty: float
    """of the slope."""
    least: float
    """difference below which there is none."""

    def fits(self, more: float = 0.0) -> bool:
        """Whether they are the same within the uncertainty, and so much more of it."""
        most = CONTRADICTION * (self.uncertainty + more) + self.least
        return float(np.abs(self.slope - self.reported).max()) <= most

    def apart(self, other: Gap) -> float:
        """By how much two runs differ in either."""
        pairs = ((self.slope, other.slope), (self.reported, other.reported))
        return max(float(np.abs(a - b).max()) for a, b in pairs)

    def __str__(self) -> str:
        uncertain = f"(uncertainty {self.uncertainty:.1e})"
        return f"dv/dt {self.slope} is {self.reported} by its wrenches {uncertain}"


def broken_law(mapping: dict[str, Any]) -> str:
    """The body whose acceleration contradicts the wrenches, in words; "" if none does.

    The scene is run to AT with a tolerance so tight that the method's own error is not seen, and
    where it seems to be broken once more, less tightly, which tells what is left of that error.
    """
    gaps = gaps_of(run_about(mapping, TOLERANCE))
    if all(gap.fits() for gap in gaps.values()):
        return ""
    other = gaps_of(run_about(mapping, COARSER))
    broken = {key: gap for key, gap in gaps.items() if not gap.fits(gap.apart(other[key]))}
    return "; ".join(f"{body}: {gap}" for (body, _), gap in broken.items())


def run_about(mapping: dict[str, Any], tolerance: float) -> Trajectory:
    """Samples about AT, at all spacings."""
    options = {"duration": 1.0, "rate": 100.0, "tolerance": tolerance, "project_initial": True}
    simulation = Simulation(mapping | {"simulation": options}, announce=None)
    instants = {AT + k * h * s for h in SPACINGS for s in (0.5, 1.0) for k in (-2, -1, 0, 1, 2)}
    return simulation.run(at=sorted(instants))


def gaps_of(run: Trajectory) -> dict[tuple[str, str], Gap]:
    """Of each body, of its velocity and of its spin."""
    wrenches = [*run.reaction.values(), *run.effect.values()]
    force = sum(float(np.abs(w.force).max()) for w in wrenches)
    torque = force + sum(float(np.abs(w.torque).max()) for w in wrenches)
    bodies = run.scene.bodies.values()
    inertia = min(float(np.linalg.eigvalsh(body.inertia)[-1]) for body in bodies)
    ways = (
        ("v", run.linear_velocity, run.linear_acceleration, force / min(b.mass for b in bodies)),
        ("w", run.angular_velocity, run.angular_acceleration, torque / inertia),
    )
    found = {}
    for name, of, reported, alone in ways:
        sizes = [np.abs(of[body]).max() + np.abs(reported[body]).max() for body in of]
        least = SHARE * max(sizes) + CANCELLED * alone + TOLERANCE  # of what has died out
        for body in of:
            found[body, name] = gap_of(run.t, of[body], reported[body], least)
    return found


def gap_of(t: Array, values: Array, reported: Array, least: float) -> Gap:
    """By central differences of fourth order at the spacing where they are surest. values, told:
    (n, 3).

    Their error is h^4 f^(5) / 30: the change of the slope with the spacing tells it, and so do the
    fourth differences of the accelerations told, where oscillations faster than the samples make
    slopes that agree by chance.
    """
    best = Gap(np.full(values.shape[1], np.nan), reported[nearest(t, AT)], np.inf, least)
    for h in SPACINGS:
        coarse, fine = difference(t, values, h), difference(t, values, 0.5 * h)
        rounding = 1e-13 * np.abs(values).max() / h  # of the run: a hundred ulps
        bent = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) @ reported[places(t, 0.5 * h)] / 30.0
        uncertainty = float(np.abs(fine - coarse).max() + np.abs(bent).max() + rounding)
        if uncertainty < best.uncertainty:
            best = Gap(fine, best.reported, uncertainty, least)
    return best


def difference(t: Array, values: Array, h: float) -> Array:
    """(f(-2h) - 8 f(-h) + 8 f(h) - f(2h)) / 12 h about AT."""
    return np.array([1.0, -8.0, 0.0, 8.0, -1.0]) @ values[places(t, h)] / (12.0 * h)


def places(t: Array, h: float) -> list[int]:
    """Of the samples at AT - 2h ... AT + 2h."""
    return [nearest(t, AT + k * h) for k in (-2, -1, 0, 1, 2)]


def nearest(t: Array, instant: float) -> int:
    """Number of the sample there."""
    return int(np.abs(t - instant).argmin())
