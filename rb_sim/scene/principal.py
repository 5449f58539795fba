"""Principal axes of an inertia tensor (LL 32), by Jacobi's rotations in long doubles.

The small moment of a slender body keeps its digits: a rounding of the tensor, of the size of its
largest moment, is what the usual routines in doubles leave.
"""

from __future__ import annotations

import numpy as np

from rb_sim.catalogue.types import Quaternion, Symmetric, Vec3
from rb_sim.maths.vectors import quaternion_product, quaternion_unit
from rb_sim.scene.place import quaternion, vector

SWEEPS = 12
EQUAL = 4e-16
"""Moments that differ by less, relative to the largest, are those of a body of revolution."""


def principal_axes(inertia: Symmetric) -> tuple[Vec3, Quaternion]:
    """Principal moments and the quaternion from principal to body axes.

    A diagonal tensor keeps its axes and their order.
    """
    xx, yy, zz, xy, xz, yz = inertia
    A = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], dtype=np.longdouble)
    q: Quaternion = (0.0, 0.0, 0.0, 1.0)
    if xy == xz == yz == 0.0:
        return (xx, yy, zz), q
    for _ in range(SWEEPS):
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            if A[i, j] == 0.0:
                continue
            gap = A[i, i] - A[j, j]
            side = 1.0 if gap >= 0.0 else -1.0
            angle = 0.5 * np.arctan2(side * 2.0 * A[i, j], side * gap)  # at most 45 degrees
            c, s = np.cos(angle), np.sin(angle)
            J = np.eye(3, dtype=np.longdouble)
            J[i, i], J[i, j], J[j, i], J[j, j] = c, -s, s, c
            A = J.T @ A @ J
            A[i, j] = A[j, i] = 0.0
            turn = [0.0, 0.0, 0.0, float(np.cos(0.5 * angle))]
            turn[k] = float(np.sin(0.5 * angle))
            q = quaternion_product(q, quaternion(turn))
    return together(vector(np.diag(A))), quaternion_unit(q)


def together(moments: tuple[float, ...]) -> Vec3:
    """The moments, those equal but for rounding made equal: their difference would be a torque."""
    a, b, c = moments
    near = EQUAL * max(moments)
    if abs(a - b) <= near:
        a = b = 0.5 * (a + b)
    if abs(b - c) <= near:
        b = c = 0.5 * (b + c)
    if abs(a - c) <= near:
        a = c = 0.5 * (a + c)
    return (a, b, c)
