"""One measure of a body's velocities: |(v_C, A w)| with A = I / (m R), R^2 = largest moment / m.

It is |(p, J / R)| / m of momentum p and angular momentum J: of a sphere the speed that has the
kinetic energy.  Each axis counts by what it does to the motion.  The spin of a thin rod about its
axis may have most of the energy, and hardly turns the rod: with one length for all axes, or by
energy, it would hide what happens to all else.

That measure does not see what is wrong of the spin about such an axis, though the attitude is wrong
by it: where that matters, a thin body is measured once more with A = R 1 (see `measures_of`).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

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


THIN = 0.3
"""Smallest moment of inertia over the largest below which a body is thin: of another one the spin
about any axis counts by this share at least."""


class Measures(NamedTuple):
    """How the velocities of bodies are measured, M times in all: each once, thin ones twice."""

    lengths: Array
    """A [m], body axes (M, 3, 3)."""
    body: Array
    """index of the body, (M,)."""


def measures_of(bodies: Iterable[Any]) -> Measures:
    """The measures of the bodies of a scene: first that of each body by its momenta, then that of
    each thin one by R, which counts its spin about all axes alike."""
    lengths = lengths_of(bodies := list(bodies))
    sizes = np.linalg.eigvalsh(lengths)
    thin = np.flatnonzero(sizes[:, 0] < THIN * sizes[:, 2])
    alike = sizes[thin, 2, None, None] * np.eye(3)
    which = np.append(np.arange(len(bodies)), thin)
    return Measures(np.concatenate([lengths, alike]), which)


def by_lengths(lengths: Array, vectors: Array) -> Array:
    """A times vectors in body axes, shape (n, N, 3)."""
    return (lengths @ vectors[..., None])[..., 0]


def measured(v: Array, w: Array, lengths: Array) -> Array:
    """(v_C, A w) of bodies, shape (n, N, 6)."""
    return np.concatenate([v, by_lengths(lengths, w)], axis=2)
