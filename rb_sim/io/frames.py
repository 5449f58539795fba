"""From the centre of mass C to the body origin O and back. Quaternions [x, y, z, w], body to world.

    p_O = p_C - R r_OC          v_O = v_C - w x (R r_OC)

with r_OC the centre of mass in the body frame and w the angular velocity in world axes.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any

    from rb_sim.mechanics.samples import Array, SampleBlock


def rotate(quaternion: Array, vector: Array) -> Array:
    """R(quaternion) vector, shapes (..., 4) and (..., 3), broadcast.

    A rotation to round-off, however far the quaternion is from unit length, so it can be undone.
    """
    axis, scalar = quaternion[..., :3], quaternion[..., 3:]
    x, y, z, w = (quaternion[..., k : k + 1] for k in range(4))
    turned = 2.0 / (x * x + y * y + z * z + w * w) * cross(axis, vector)
    return vector + scalar * turned + cross(axis, turned)


def norms(vectors: Array) -> Array:
    """Lengths of vectors (..., 3), shape (...); several times faster than numpy's `norm`."""
    return np.sqrt(np.einsum("...i,...i->...", vectors, vectors))


def cross(a: Array, b: Array) -> Array:
    """a x b, shapes (..., 3), broadcast: as np.cross, which takes ten times longer on one pair."""
    a_0, a_1, a_2 = a[..., 0], a[..., 1], a[..., 2]
    b_0, b_1, b_2 = b[..., 0], b[..., 1], b[..., 2]
    parts = (a_1 * b_2 - a_2 * b_1, a_2 * b_0 - a_0 * b_2, a_0 * b_1 - a_1 * b_0)
    out = np.empty((*parts[0].shape, 3))
    for k, part in enumerate(parts):
        out[..., k] = part
    return out


def conjugate(quaternion: Array) -> Array:
    """The inverse rotation, shape (..., 4)."""
    return quaternion * np.array([-1.0, -1.0, -1.0, 1.0])


def roll_pitch_yaw(quaternion: Array) -> Array:
    """Angles about the fixed axes x, y, z, in that order [rad], shapes (..., 4) and (..., 3).

    Where roll and yaw turn about the same axis, at a pitch of a quarter turn, all of it is yaw.
    """
    x, y, z, w = np.moveaxis(np.asarray(quaternion, dtype=float), -1, 0)
    sine = np.clip(2.0 * (w * y - z * x), -1.0, 1.0)
    alike = np.abs(sine) > 1.0 - 1e-12
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    pitch = np.where(alike, np.copysign(0.5 * np.pi, sine), np.arcsin(sine))
    yaw = np.where(alike, -2.0 * np.sign(sine) * np.arctan2(x, w), yaw)
    return np.stack([np.where(alike, 0.0, roll), pitch, yaw], axis=-1)


def without_jumps(angles: Array, before: Array | None = None) -> Array:
    """Roll, pitch and yaw over time [rad], shape (n, ..., 3), as angles that go on beyond a turn.

    (roll + pi, pi - pitch, yaw + pi) is the same attitude: at each sample that of the two is taken
    which is nearer to the sample before. before: the last angles so far, shape (..., 3).
    """
    if not len(angles):
        return angles
    first = angles[:1] if before is None else before[None]
    rows = np.concatenate([first, angles])
    other = np.stack([rows[..., 0] + np.pi, np.pi - rows[..., 1], rows[..., 2] + np.pi], axis=-1)
    stays, turns = (
        np.sum(np.abs(np.angle(np.exp(1j * (to[1:] - rows[:-1])))), axis=-1) for to in (rows, other)
    )
    turned = np.cumsum(turns < stays, axis=0) % 2 == 1
    chosen = np.where(turned[..., None], other[1:], angles)
    return np.unwrap(np.concatenate([first, chosen]), axis=0)[1:]


def centers_of_mass(bodies: Mapping[str, Any], names: tuple[str, ...]) -> Array:
    """r_OC of each named body, body frame [m], shape (N, 3)."""
    return np.array([bodies[name].center_of_mass for name in names], dtype=float).reshape(-1, 3)


class Origins(NamedTuple):
    """Motion of the body origins, world axes, SI; each of shape (n, N, 3)."""

    position: Array
    linear_velocity: Array
    angular_velocity: Array


def origins(block: SampleBlock, center_of_mass: Array) -> Origins:
    """Motion of the body origins. center_of_mass: r_OC, shape (N, 3)."""
    spin_W = rotate(block.orientation, block.angular_velocity)
    if not center_of_mass.any():
        return Origins(block.position, block.linear_velocity, spin_W)
    r_OC_W = rotate(block.orientation, center_of_mass)
    velocity = block.linear_velocity - cross(spin_W, r_OC_W)
    return Origins(block.position - r_OC_W, velocity, spin_W)
