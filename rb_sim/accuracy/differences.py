# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Differences between two runs of one scene, sample by sample.

Rows are those of the kernel: 13 numbers per body (position, quaternion, velocities), 9 per reaction
(force, torque, anchor), then kinetic and potential energy, power, momenta and residual, and where
there are contacts their work and states.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rb_sim.base.rounding import COMPUTED_ROUNDING
from rb_sim.mechanics.samples import Array, Indices, SampleLayout
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


def motion_size(poses: Array, radius: Array) -> float:
    """The largest way of a body from its start [m], or its largest turn as an arc of its radius of
    gyration; poses (n, bodies, 7), radius (bodies,) [m]."""
    way, turn = pose_gaps(poses, poses[:1])
    return float(np.nan_to_num(np.maximum(way, radius * turn), nan=0.0, posinf=np.inf).max())


def motions_apart(
    one: Array, two: Array, radius: Array, least: float
) -> tuple[float, float, int, int]:
    """How far two runs are apart at most, as a share of the smaller motion and as it is [m, rad],
    and the instant and the body of the share; poses (n, bodies, 7).

    radius: of gyration of the bodies, (bodies,) [m]. least: the smallest motion that counts [m].
    """
    with np.errstate(all="ignore"):
        shift, turn = pose_gaps(one, two)
        scale = max(min(motion_size(one, radius), motion_size(two, radius)), least)
        far = np.linalg.norm(two[..., :3], axis=2).max(axis=0) + radius
        shift = np.nan_to_num(shift, nan=np.inf, posinf=np.inf)
        shift = np.where((shift > COMPUTED_ROUNDING * far) | np.isinf(shift), shift, 0.0)
        turn = np.where(turn > COMPUTED_ROUNDING, turn, 0.0)
        share = np.maximum(shift / scale, np.maximum(radius * turn / scale, turn))
        share = np.where((shift > 0.0) | (turn > 0.0), share, 0.0)
    share = np.nan_to_num(share, nan=np.inf, posinf=np.inf)
    i, body = np.unravel_index(int(np.argmax(share)), share.shape)
    pose = float(np.nan_to_num(np.maximum(shift, turn), nan=np.inf).max())
    return float(share[i, body]), pose, int(i), int(body)


POSITION, ROTATION, VELOCITY, SPIN, FORCE, TORQUE = range(6)
"""Columns of `distances`."""


def distances(rows: Array, others: Array, layout: SampleLayout) -> Array:
    """How far two runs are apart at each instant, shape (n, 6), the worst of bodies and reactions.

    What is not finite is infinitely far apart. Where the two are on different sides of an event,
    which is no error but one of its time, the quantities that jump count as 0; unless there are
    many such instants, for then they do not move alike.
    """
    a, b = parts(rows, layout), parts(others, layout)
    each = [np.linalg.norm(x - y, axis=2) for x, y in zip(a, b, strict=True)]
    each[ROTATION] = angle_between(a[ROTATION], b[ROTATION])
    worst = [size.max(axis=1, initial=0.0) for size in each]
    apart = np.nan_to_num(np.stack(worst, axis=1), nan=np.inf, posinf=np.inf)
    apart[across_an_event(rows, others, layout), VELOCITY:] = 0.0
    return apart


def parts(rows: Array, layout: SampleLayout) -> list[Array]:
    """The six quantities, each (n, bodies or reactions, components)."""
    bodies, reactions = len(layout.bodies), len(layout.reactions)
    body = rows[:, : 13 * bodies].reshape(len(rows), bodies, 13)
    reaction = rows[:, 13 * bodies : 13 * bodies + 9 * reactions]
    reaction = reaction.reshape(len(rows), reactions, 9)
    columns = [slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 13)]
    held = [reaction[:, :, 0:3], reaction[:, :, 3:6]]
    return [body[:, :, part] for part in columns] + held


def across_an_event(rows: Array, others: Array, layout: SampleLayout) -> Indices:
    """Indices of the instants that lie between the times that two runs give one event."""
    if not layout.contacts:
        return np.zeros(0, dtype=np.intp)
    states = 13 * len(layout.bodies) + 9 * len(layout.reactions) + BALANCE + 1
    finite = np.isfinite(rows).all(axis=1) & np.isfinite(others).all(axis=1)
    apart = np.flatnonzero((rows[:, states:] != others[:, states:]).any(axis=1) & finite)
    return apart if len(apart) <= JUMPS * len(rows) else apart[:0]


def pose_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """max(rotation [rad], centre of mass [m]) over the bodies, shape (n,); NaN counts as inf."""
    return distances(rows, reference, layout)[:, :VELOCITY].max(axis=1)


def reaction_difference(rows: Array, reference: Array, layout: SampleLayout) -> Array:
    """Largest error of a reaction force or torque, relative to the largest of the reference."""
    worst = np.zeros(len(rows))
    if not layout.reactions:
        return worst
    apart, (*_, forces, torques) = distances(rows, reference, layout), parts(reference, layout)
    force = float(np.linalg.norm(forces, axis=2).max())
    torque = max(float(np.linalg.norm(torques, axis=2).max()), force * _arm(reference, layout))
    for column, scale in ((FORCE, force), (TORQUE, torque)):
        if scale > 0.0:
            worst = np.maximum(worst, apart[:, column] / scale)
    return worst


def _arm(reference: Array, layout: SampleLayout) -> float:
    """Largest distance from an anchor to its body's centre of mass [m]."""
    body = [layout.bodies.index(name) for name in layout.reaction_bodies]
    at = 13 * len(layout.bodies)
    centres = reference[:, :at].reshape(len(reference), -1, 13)[:, body, 0:3]
    reactions = reference[:, at : at + 9 * len(body)].reshape(len(reference), -1, 9)
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
