"""Differences between two runs of one scene, sample by sample.

Rows are those of the kernel: 13 numbers per body (position, quaternion, velocities), 9 per reaction
(force, torque, anchor), then kinetic and potential energy, power, momenta and residual, and where
there are contacts their work and states.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.mechanics.samples import Array, SampleLayout
from rb_sim.numerics.rotations import angle_between

BALANCE = 10
"""Numbers of a row after the reactions; with contacts their work and states follow."""


JUMPS = 0.05
"""Share of the instants that may lie on different sides of a jump in two runs that move alike."""


class Errors(NamedTuple):
    """Largest difference over the run; infinite where a run ended early."""

    pose: float
    """rotation [rad] or centre of mass [m], whichever is larger."""
    reaction: float
    """relative to the largest reaction of the reference; 0 without constraints."""
    energy: float
    """less the work of contacts; relative to the energy that the motion exchanges."""


def pose_gaps(poses: Array, others: Array) -> tuple[Array, Array]:
    """Distances of the centres of mass [m] and angles between the attitudes [rad] of two runs,
    shape (n, bodies) each; poses (n, bodies, 7): position, quaternion."""
    shift = np.linalg.norm(poses[..., :3] - others[..., :3], axis=-1)
    return shift, angle_between(poses[..., 3:], others[..., 3:])


def pose_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """max(rotation [rad], centre of mass [m]) over the bodies, shape (n,); NaN counts as inf."""
    count = len(layout.bodies)
    shift, turn = pose_gaps(
        *(run[:, : 13 * count].reshape(len(rows), count, 13)[..., :7] for run in (rows, reference))
    )
    return np.nan_to_num(np.maximum(shift, turn).max(axis=1), nan=np.inf, posinf=np.inf)


def reaction_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Largest error of a reaction force or torque, relative to the largest of the reference.

    Forces jump where a contact changes its mode; an instant at which the two runs are on different
    sides of such a jump says nothing about them and counts as 0, unless there are many: then they
    do not move alike.
    """
    count, at = len(layout.reactions), 13 * len(layout.bodies)
    if count == 0:
        return np.zeros(len(rows))
    a = rows[:, at : at + 9 * count].reshape(len(rows), count, 9)
    b = reference[:, at : at + 9 * count].reshape(len(rows), count, 9)
    force = np.linalg.norm(b[:, :, 0:3], axis=2).max()
    torque = max(np.linalg.norm(b[:, :, 3:6], axis=2).max(), force * _arm(reference, b, layout))
    worst = np.zeros(len(rows))
    for part, scale in ((slice(0, 3), force), (slice(3, 6), torque)):
        if scale > 0.0:
            size = np.linalg.norm(a[:, :, part] - b[:, :, part], axis=2).max(axis=1)
            worst = np.maximum(worst, size / scale)
    states = at + 9 * count + BALANCE + 1
    apart = (rows[:, states:] != reference[:, states:]).any(axis=1) & np.isfinite(worst)
    if np.mean(apart) <= JUMPS:
        worst[apart] = 0.0
    return np.nan_to_num(worst, nan=np.inf, posinf=np.inf)


def _arm(reference: Array, reactions: Array, layout: SampleLayout) -> float:
    """Largest distance from an anchor to its body's centre of mass [m]."""
    body = [layout.bodies.index(name) for name in layout.reaction_bodies]
    centres = reference[:, : 13 * len(layout.bodies)].reshape(len(reference), -1, 13)[:, body, 0:3]
    return float(np.linalg.norm(reactions[:, :, 6:9] - centres, axis=2).max())


def energy_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Error of kinetic plus potential energy, relative to the energy the motion exchanges.

    The reference of a conservative scene has constant energy, so this is the drift; elsewhere the
    work of the driving and dissipating effects is in the reference too.  The work of contacts is
    taken off: it jumps at impacts, and a sample may lie between those of the two runs.
    """
    at = 13 * len(layout.bodies) + 9 * len(layout.reactions)
    total, true = balance_of(rows, at, layout), balance_of(reference, at, layout)
    scale = max(reference[:, at].max(), np.ptp(reference[:, at + 1]), np.finfo(float).tiny)
    return np.nan_to_num(np.abs(total - true) / scale, nan=np.inf, posinf=np.inf)


def balance_of(rows: Array, at: int, layout: SampleLayout) -> Array:
    """Kinetic plus potential energy less the work of contacts; at: the column of the first [J]."""
    total = rows[:, at] + rows[:, at + 1]
    return total - rows[:, at + BALANCE] if layout.contacts else total


def compare(rows: Array, reference: Array, layout: SampleLayout) -> Errors:
    """Largest errors of a run against a reference at the same instants."""
    with np.errstate(over="ignore", invalid="ignore"):
        return Errors(
            float(pose_difference(rows, reference, layout).max()),
            float(reaction_difference(rows, reference, layout).max()),
            float(energy_difference(rows, reference, layout).max()),
        )
