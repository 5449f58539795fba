"""Tables of bodies and points of contact that no scene made, for the parts of a step alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rb_sim.contact.stepping.geometry import GAP, NORMAL, POINT
from rb_sim.contact.stepping.scene_tables import COMPLIANT, LAWS, Tables
from rb_sim.contact.stepping.step_workspace import Workspace, workspace_for
from rb_sim.mechanics.systems.many_bodies import BODY_WIDTH, INVERSE
from tests.moving import unit

LENGTH, SPEED = 2.0, 3.0
"""Of the scene [m, m/s]."""


class Heap:
    """Bodies at random places, and points of contact between some of them and the world."""

    def __init__(self, bodies: int, owners: list[tuple[int, int]], seed: int) -> None:
        rng, points = np.random.default_rng(seed), len(owners)
        table = np.zeros((bodies, BODY_WIDTH))
        self.masses, self.inertias = rng.uniform(0.5, 3.0, bodies), []
        for i in range(bodies):
            half = rng.normal(size=(3, 3))
            inertia = half @ half.T + np.eye(3)
            inverse = np.linalg.inv(inertia)
            for at, m in ((1, inertia), (INVERSE, inverse)):
                packed = m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]
                table[i, at : at + 6] = packed
            table[i, 0] = self.masses[i]
            self.inertias.append(inertia)
        self.y = np.zeros(13 * bodies + 1)
        for i in range(bodies):
            quaternion = unit(rng, 4)
            self.y[13 * i : 13 * i + 13] = *rng.normal(size=3), *quaternion, *rng.normal(size=6)
        self.tables = Tables(
            bodies=table,
            gravity=rng.normal(size=(bodies, 3)),
            entries=np.zeros((0, 5), np.int64),
            sizes=np.zeros((0, 16)),
            motions=np.zeros((0, 8)),
            laws=np.zeros((points, LAWS)),
            owners=np.array(owners, np.int64).reshape(-1, 2),
            joints=np.zeros((0, 3), np.int64),
            joint_rows=np.zeros((0, 16)),
            scales=np.array([LENGTH, SPEED]),
        )
        self.workspace: Workspace = workspace_for(bodies, points, 0)
        for c in range(points):
            spot = self.workspace.spots[c]
            spot[NORMAL : NORMAL + 3], spot[POINT : POINT + 3] = unit(rng, 3), rng.normal(size=3)

    def gaps(self, *gaps: float, soft: tuple[int, ...] = ()) -> None:
        """Of the points; soft: those whose support gives way."""
        self.workspace.spots[:, GAP] = gaps
        for c in soft:
            self.tables.laws[c, COMPLIANT] = 1.0

    def place(self, i: int) -> np.ndarray:
        return self.y[13 * i : 13 * i + 3].copy()

    def turned(self, i: int) -> Rotation:
        return Rotation.from_quat(self.y[13 * i + 3 : 13 * i + 7])

    def lines(self) -> np.ndarray:
        """Rates of the gaps by velocities, spins in body axes, (points, 6 N)."""
        out = np.zeros((len(self.tables.owners), 6 * len(self.masses)))
        for c, owners in enumerate(self.tables.owners):
            n = self.workspace.spots[c, NORMAL : NORMAL + 3]
            p = self.workspace.spots[c, POINT : POINT + 3]
            for i, sign in zip(owners, (1.0, -1.0), strict=True):
                if i >= 0:
                    turn = self.turned(i).inv().apply(np.cross(p - self.place(i), n))
                    out[c, 6 * i : 6 * i + 6] += sign * np.concatenate([n, turn])
        return out

    def inverse_mass(self) -> np.ndarray:
        n = len(self.masses)
        out = np.zeros((6 * n, 6 * n))
        for i in range(n):
            out[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = np.eye(3) / self.masses[i]
            turn = slice(6 * i + 3, 6 * i + 6)
            out[turn, turn] = np.linalg.inv(self.inertias[i])
        return out

    def moved(self, shift: np.ndarray) -> Any:
        """y after displacements and turns (body axes) of the bodies."""
        y = self.y.copy()
        for i in range(len(self.masses)):
            y[13 * i : 13 * i + 3] += shift[6 * i : 6 * i + 3]
            turned = self.turned(i) * Rotation.from_rotvec(shift[6 * i + 3 : 6 * i + 6])
            y[13 * i + 3 : 13 * i + 7] = turned.as_quat()
        return y


def same_poses(y: np.ndarray, other: np.ndarray, close: float) -> bool:
    """True if all places and attitudes are; of a quaternion either sign is right."""
    for i in range(len(y) // 13):
        a, b = y[13 * i : 13 * i + 7], other[13 * i : 13 * i + 7]
        sign = 1.0 if a[3:] @ b[3:] > 0.0 else -1.0
        if not np.abs(np.append(a[:3] - b[:3], a[3:] - sign * b[3:])).max() <= close:
            return False
    return True
