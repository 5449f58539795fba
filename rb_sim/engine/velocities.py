"""One measure of a body's velocities: |(v_C, A w)| with A = I / (m R), R^2 = largest moment / m.

It is |(p, J / R)| / m of momentum p and angular momentum J: of a sphere the speed that has the
kinetic energy.  Each axis counts by what it does to the motion.  The spin of a thin rod about its
axis may have most of the energy, and hardly turns the rod: with one length for all axes, or by
energy, it would hide what happens to all else.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

Array = np.ndarray

OF_SYMMETRIC = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])
"""Where the elements of a tensor are among (xx, yy, zz, xy, xz, yz)."""


def spin_lengths(inertia: Array, mass: Array) -> Array:
    """A [m] of each body, body axes (N, 3, 3).

    inertia: about C, body axes (N, 3, 3); mass: (N,).
    """
    largest = np.linalg.norm(inertia, 2, axis=(1, 2))
    return inertia / np.sqrt(largest * mass)[:, None, None]


def lengths_of(bodies: Iterable[Any]) -> Array:
    """A [m] of the bodies of a scene, body axes (N, 3, 3)."""
    bodies = list(bodies)
    inertia = np.array([body.inertia for body in bodies])
    return spin_lengths(inertia, np.array([body.mass for body in bodies]))


def by_lengths(lengths: Array, vectors: Array) -> Array:
    """A times vectors in body axes, shape (n, N, 3)."""
    return (lengths @ vectors[..., None])[..., 0]


def measured(v: Array, w: Array, lengths: Array) -> Array:
    """(v_C, A w) of bodies, shape (n, N, 6)."""
    return np.concatenate([v, by_lengths(lengths, w)], axis=2)
