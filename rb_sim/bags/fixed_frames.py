"""Frames that static transforms hold together: where one of them lies in another, at all times."""

from __future__ import annotations

from collections.abc import Container, Iterable
from typing import NamedTuple

import numpy as np

from rb_sim.bags.composed import product
from rb_sim.bags.piece import POSE, Piece
from rb_sim.bags.transform_tree import is_static, namespace, plain
from rb_sim.sinks.frames import cross, rotate

Array = np.ndarray
HERE = np.array([0.0] * 6 + [1.0])
"""The pose of a frame in itself."""


class _Link(NamedTuple):
    parent: str
    pose: Array
    """of the child in the parent, shape (7,)."""


class FixedFrames:
    """The static transforms of a bag. A child with two parents, or whose transform changes, is
    fixed to nothing."""

    def __init__(self, pieces: Iterable[Piece] = ()) -> None:
        self._trees: dict[str, dict[str, _Link | None]] = {}
        for piece in pieces:
            if piece.kind != POSE or not piece.transform or not is_static(piece.source):
                continue
            links = self._trees.setdefault(namespace(piece.source), {})
            child, pose = plain(piece.child), piece.values[0, :7].copy()
            pose[3:] /= np.linalg.norm(pose[3:])
            link = links.setdefault(child, _Link(plain(piece.frame), pose))
            one = link is not None and link.parent == plain(piece.frame)
            if not one or not (piece.values == piece.values[0]).all():
                links[child] = None

    def carrier(self, frame: str, bodies: Container[str]) -> tuple[str, Array] | None:
        """The nearest of the frames above that is one of `bodies`, and the pose in it, (7,).

        None where there is none, or where trees of several namespaces say different things.
        """
        found = [way for links in self._trees.values() if (way := _up(frame, links, bodies))]
        same = all(f == found[0][0] and np.array_equal(p, found[0][1]) for f, p in found)
        return found[0] if found and same else None


def _up(
    frame: str, links: dict[str, _Link | None], bodies: Container[str]
) -> tuple[str, Array] | None:
    at, pose = plain(frame), HERE
    for _ in range(len(links) + 1):  # a circle ends, too
        if at in bodies and pose is not HERE:
            return at, pose
        link = links.get(at)
        if link is None:
            return None
        at, pose = link.parent, product(link.pose[None], pose[None])[0]
    return None


def carried_over(wrench: Array, pose: Array) -> Array:
    """Forces and torques about a frame's origin, in its axes, as about the origin and in the axes
    of the frame in which it has that pose; shapes (n, 6) and (7,).

        F_B = R F_S        K_B = R K_S + r x F_B
    """
    r, q = pose[:3], pose[3:]
    force = rotate(q, wrench[:, :3])
    return np.hstack([force, rotate(q, wrench[:, 3:]) + cross(r, force)])
