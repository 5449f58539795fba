"""Newton's and Euler's laws on a run: dv/dt by differences of its samples beside its wrenches.

The velocities come from the solver, the accelerations from the reactions and effects that the run
reports: a term that is missing in either, a wrong sign on a parent, a wrong point shows.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim import Simulation, Trajectory

Array = Any

AT = 0.02
"""Time of the scene at which it is looked [s]."""

SPACINGS = (1e-3, 1e-4, 1e-5)
"""Of the samples [s]: the one that gives the surest difference counts."""

CONTRADICTION = 30.0
"""Doubts of the difference by which a law must be broken."""

SHARE = 1e-5
"""Of the largest acceleration in the scene, below which nothing is a find."""

CANCELLED = 1e-9
"""The same of what the wrenches would do one by one: of a body that is held they cancel."""


def broken_law(mapping: dict[str, Any]) -> str:
    """The body whose acceleration contradicts the wrenches, in words; "" if none does.

    The scene is run to AT with a tolerance so tight that the method's own error is not seen.
    """
    options = {"duration": 1.0, "rate": 100.0, "tolerance": 1e-11, "project_initial": True}
    simulation = Simulation(mapping | {"simulation": options}, announce=None)
    instants = {AT + k * h * s for h in SPACINGS for s in (0.5, 1.0) for k in (-2, -1, 0, 1, 2)}
    run = simulation.run(at=sorted(instants))
    wrenches = [*run.reaction.values(), *run.effect.values()]
    force = sum(float(np.abs(w.force).max()) for w in wrenches)
    torque = force + sum(float(np.abs(w.torque).max()) for w in wrenches)
    bodies = simulation.scene.bodies.values()
    inertia = min(float(np.linalg.eigvalsh(body.inertia)[-1]) for body in bodies)
    found = []
    for of, told, alone in (
        (run.linear_velocity, run.linear_acceleration, force / min(b.mass for b in bodies)),
        (run.angular_velocity, run.angular_acceleration, torque / inertia),
    ):
        sizes = [np.abs(of[body]).max() + np.abs(told[body]).max() for body in of]
        least = SHARE * max(sizes) + CANCELLED * alone
        for body in of:
            found += contradiction(run, body, of[body], told[body], least)
    return "; ".join(found)


def contradiction(run: Trajectory, body: str, of: Array, told: Array, least: float) -> list[str]:
    """What contradicts: the derivative of `of` beside the acceleration told, both (n, 3).

    least: difference below which there is none.
    """
    slope, doubt = surest(run.t, of)
    middle = int(np.abs(run.t - AT).argmin())
    gap = float(np.abs(slope - told[middle]).max())
    if gap <= CONTRADICTION * doubt + least:
        return []
    return [f"{body}: dv/dt {slope} is {told[middle]} by its wrenches (doubt {doubt:.1e})"]


def surest(t: Array, values: Array) -> tuple[Array, float]:
    """(derivative at AT, its doubt) by central differences of fourth order at the best spacing."""
    best = np.full(values.shape[1], np.nan), np.inf
    for h in SPACINGS:
        coarse, fine = difference(t, values, h), difference(t, values, 0.5 * h)
        rounding = 1e-13 * np.abs(values).max() / h  # of the run: a hundred ulps
        doubt = float(np.abs(fine - coarse).max() + rounding)
        if doubt < best[1]:
            best = fine, doubt
    return best


def difference(t: Array, values: Array, h: float) -> Array:
    """(f(-2h) - 8 f(-h) + 8 f(h) - f(2h)) / 12 h about AT."""
    at = [int(np.abs(t - (AT + k * h)).argmin()) for k in (-2, -1, 1, 2)]
    return np.array([1.0, -8.0, 8.0, -1.0]) @ values[at] / (12.0 * h)
