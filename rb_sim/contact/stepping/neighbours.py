"""Tables of a scene whose bodies touch all each other: entries of the pairs that are near alone.

The entries of constraints come first and stay; those of neighbours follow, in the order of their
bodies, so that the motion does not depend on when neighbours were looked for.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from rb_sim.catalogue.geometry.boxes import MOST_POINTS, box_points
from rb_sim.catalogue.geometry.pairs import touching
from rb_sim.contact.stepping.scene_tables import (
    ALONE,
    COLUMNS,
    LAWS,
    NEAR_WIDTH,
    SIZES,
    PointLaws,
    Tables,
    entry_of,
    write_law,
)
from rb_sim.contact.stepping.step_workspace import Workspace, memory_of, workspace_for
from rb_sim.mechanics.systems.many_bodies import WIDTH as STATE
from rb_sim.mechanics.systems.many_bodies import state_of
from rb_sim.numerics.vectors import add, rotate
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.initial import MISFIT, refuse_initial
from rb_sim.scene.pairs_of_bodies import Between, Pair, PairRows

STEPS_AHEAD = 20.0
"""Steps at the present speed for which a list of neighbours serves, about."""
LEAST_MARGIN = 0.1
"""Of the smallest ball about a body: margin of neighbours at rest."""


class Neighbours:
    """Which pairs are near, and where their points stand in the tables."""

    def __init__(
        self, compiled: Compiled, between: Between, fixed: Tables, laws: PointLaws
    ) -> None:
        self._between, self._fixed, self._laws = between, fixed, laws
        self._points = len(fixed.owners)
        reactions = {name: k for k, name in enumerate(compiled.layout.reactions)}
        contacts = {name: k for k, name in enumerate(compiled.layout.contacts)}
        self._shares = {
            group: {i: (reactions[name], contacts[name]) for i, name in members.items()}
            for group, members in between.groups.items()
        }
        balls = between.radii[between.radii > 0.0]
        self._least = LEAST_MARGIN * float(balls.min())
        self._numbers: dict[int, Any] = {}
        """of each set of points, by its identity, what `_numbers_of` gives."""
        refuse_overlaps(between, compiled.y, compiled.system.length)
        self.first: dict[tuple[str, Pair], tuple[int, int]] = {}
        """first point and number of points of each pair."""

    def look(self, y: np.ndarray, h: float) -> Tables:
        """The tables with the pairs that are near at y; h: of the steps to come."""
        fixed = self._fixed
        state = y[:-1].reshape(-1, STATE)
        speeds = np.linalg.norm(state[:, 7:10], axis=1)
        speeds += self._between.radii * np.linalg.norm(state[:, 10:13], axis=1)
        pull = np.linalg.norm(fixed.gravity, axis=1).max()
        fastest = speeds.max() + STEPS_AHEAD * h * pull
        way = (2.0 + STEPS_AHEAD) * h * (fastest + h * pull)
        margin = max(self._least, 2.0 * way, 4.0 * (2.0 + STEPS_AHEAD) * h * h * pull)
        entries, sizes, laws, owners, shares = [], [], [], [], []
        self.first = {}
        c = self._points
        for group, pair in self._between.near(y, margin):
            made, body, parent = self._between.placed(group, pair)
            found, rules = self._numbers_of(made, group)
            self.first[group, pair] = c, len(rules)
            for entry, size in found:
                entries.append((entry[0], body, parent, c, *entry[1:]))
                sizes.append(size)
                c += len(rules) // len(found)
            laws.append(rules)
            B, A = self._shares[group][body], self._shares[group][parent]
            owners += [(body, parent)] * len(rules)
            shares += [(B[0], A[0], B[1], A[1])] * len(rules)
        near = np.concatenate((state[:, :3], self._between.radii[:, None]), axis=1)
        none = np.zeros((self._points, 4), np.int64)
        added = np.array(entries, np.int64).reshape(-1, COLUMNS)
        return self._laws.written(fixed)._replace(
            entries=np.concatenate((fixed.entries, added)),
            sizes=np.concatenate((fixed.sizes, np.array(sizes).reshape(-1, SIZES))),
            laws=np.concatenate((fixed.laws, *laws)),
            owners=np.concatenate((fixed.owners, np.array(owners, np.int64).reshape(-1, 2))),
            near=np.ascontiguousarray(near.reshape(-1, NEAR_WIDTH)),
            shares=np.concatenate((none, np.array(shares, np.int64).reshape(-1, 4))),
            margin=np.array([margin]),
        )

    def _numbers_of(self, made: PairRows, group: str) -> tuple[list[Any], np.ndarray]:
        """(entries and sizes, as of `entry_of`, laws of the points) of such a pair."""
        if id(made) not in self._numbers:
            boxes, length = made.boxes, float(self._fixed.scales[0])
            rows = made.rows[:1] if boxes is not None else made.rows
            found = [entry_of(row, boxes, False, self._laws, length) for row in rows]
            points = MOST_POINTS if boxes is not None else len(rows)
            laws = np.zeros((points, LAWS))
            traction = self._laws.of_traction(made.rows[0].friction, group)
            for row in laws:
                write_law(row, traction, made.law)
            laws[:, ALONE] = points == 1
            self._numbers[id(made)] = found, laws
        return self._numbers[id(made)]

    def moved(
        self, before: dict[tuple[str, Pair], tuple[int, int]], memory: np.ndarray, points: int
    ) -> np.ndarray:
        """What points keep from step to step, where they stand now; before: where they stood."""
        out = memory_of(points)
        out[: self._points] = memory[: self._points]
        for key, (first, count) in self.first.items():
            if key in before:
                at = before[key][0]
                out[first : first + count] = memory[at : at + count]
        return out


def resized(workspace: Workspace, bodies: int, points: int, joints: int) -> Workspace:
    """Work space for another number of points, with what the workspace has to tell."""
    made = workspace_for(bodies, points, joints)
    for name in ("notes", "joint_x", "joint_back", "joint_summed"):
        getattr(made, name)[:] = getattr(workspace, name)
    return made


def refuse_overlaps(between: Between, y: np.ndarray, length: float) -> None:
    """Raise SceneError where two bodies overlap at y, unless they may be moved apart."""
    if between.scene.simulation.project_initial:
        return
    for group, pair in between.near(y, 0.0):
        made, body, parent = between.placed(group, pair)
        gap = least_gap(made, state_of(y, body), state_of(y, parent))
        if not made.law.compliant and gap < -MISFIT * length:
            names = " and ".join(between.names[i] for i in pair)
            refuse_initial(between.scene, group, f"{names} overlap by {-gap:.2g} m at the start")


def least_gap(made: PairRows, B: Any, A: Any) -> float:
    """Distance of two bodies [m], negative where they overlap."""
    if made.boxes is None:
        return min(float(touching(row.pair, B, A).gap) for row in made.rows)
    s = made.boxes
    c_B = add(B.p_WC, rotate(B.q_WB, tuple(s[0:3])))
    c_A = add(A.p_WC, rotate(A.q_WB, tuple(s[6:9])))
    points, _ = box_points(A.q_WB, c_A, tuple(s[9:12]), B.q_WB, c_B, tuple(s[3:6]), 0.0)
    return float(points[:, 3].min(initial=np.inf))
