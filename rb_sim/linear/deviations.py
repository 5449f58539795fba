"""Deviations z = (position, rotation, velocity, spin) of N bodies from a moving state.

All positions and rotations (small rotation vectors) come first, then all velocities and spins;
in world axes unless a frame says otherwise.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from scipy import linalg

from rb_sim.engine.samples import Array
from rb_sim.engine.systems.many_bodies import state_of
from rb_sim.linear.equations import HeldMotion
from rb_sim.maths.vectors import rotate

Axes = Literal["world", "body"]


def block_diag(*blocks: Array) -> Array:
    """The blocks along the diagonal of one matrix."""
    return np.asarray(linalg.block_diag(*blocks), dtype=float)


def skew(a: Any) -> Array:
    """The matrix of a x."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]], float)


def rotation(q: Any) -> Array:
    return np.array([rotate(q, tuple(e)) for e in np.eye(3)]).T


def from_world(y: Array, bodies: int) -> Array:
    """dy for deviations z = (positions, rotations, velocities, spins), world axes: (13 N, 12 N).

    A rotation phi (world) turns q by (phi, 0) q / 2 and leaves of a spin W the body components
    R^T (dW - phi x W).
    """
    matrix = np.zeros((13 * bodies, 12 * bodies))
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        x, yy, z, s = B.q_WB
        R, W = rotation(B.q_WB), rotate(B.q_WB, B.w_WB_B)
        k = 13 * i
        matrix[k : k + 3, p] = matrix[k + 7 : k + 10, v] = np.eye(3)
        matrix[k + 3 : k + 7, phi] = 0.5 * np.array(
            [[s, z, -yy], [-z, s, x], [yy, -x, s], [-x, -yy, -z]]
        )
        matrix[k + 10 : k + 13, w] = R.T
        matrix[k + 10 : k + 13, phi] = R.T @ skew(W)
    return matrix


def columns(i: int, bodies: int) -> list[slice]:
    """Where the position, rotation, velocity and spin of body i are in z."""
    pose, twist = 6 * i, 6 * (bodies + i)
    return [slice(a, a + 3) for a in (pose, pose + 3, twist, twist + 3)]


def turned_spin(y: Array, bodies: int) -> Array:
    """From (a_C, dw/dt body) to (a_C, R dw/dt) of all bodies."""
    return block_diag(
        *(block for i in range(bodies) for block in (np.eye(3), rotation(state_of(y, i).q_WB)))
    )


def world_dynamics(y: Array, bodies: int, held: HeldMotion, du: Array) -> Array:
    """F of z' = F z, world axes; phi' = dW + W x phi, (R alpha)' = phi x R alpha + R d alpha."""
    F = np.zeros((12 * bodies, 12 * bodies))
    F[6 * bodies :] = turned_spin(y, bodies) @ du
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        F[p, v] = F[phi, w] = np.eye(3)
        F[phi, phi] = skew(rotate(B.q_WB, B.w_WB_B))
        alpha = rotate(B.q_WB, tuple(held.acceleration[6 * i + 3 : 6 * i + 6]))
        F[w, phi] -= skew(alpha)
    return F


def frame_of(
    y: Array, bodies: int, held: HeldMotion, axes: Axes, turning: float
) -> tuple[Array, Array]:
    """(T, dT/dt T^-1) for z in the chosen axes, T z.

    In axes of the body the spin's deviation is that of its components there, dw = R^T dW + w x phi.
    """
    size = 12 * bodies
    T, rate, shear, shear_rate = (
        np.eye(size),
        np.zeros((size, size)),
        np.eye(size),
        np.zeros((size, size)),
    )
    for i in range(bodies):
        B = state_of(y, i)
        p, phi, v, w = columns(i, bodies)
        own = axes == "body"
        for part in (p, phi, v, w):
            T[part, part] = rotation(B.q_WB).T if own else np.eye(3)
            rate[part, part] = -skew(B.w_WB_B if own else (0.0, 0.0, turning))
        if own:
            shear[w, phi] = skew(B.w_WB_B)
            shear_rate[w, phi] = skew(held.acceleration[6 * i + 3 : 6 * i + 6])
    back = np.linalg.inv(shear)
    return shear @ T, shear_rate @ back + shear @ rate @ back
