# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Contacts between many bodies: pairs are found as they come close, without an entry for each.

A bounding ball about the centre of mass encloses each body. Pairs whose balls are closer than a
margin are neighbours; the list of neighbours is valid until a body has moved by half the margin
(Verlet 1967).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from pydantic_core import PydanticCustomError

from rb_sim.base.errors import SceneError
from rb_sim.catalogue.contact import Contact, ContactLaw, Touching
from rb_sim.catalogue.surfaces import BodySurface
from rb_sim.numerics.vectors import norm
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene

Pair = tuple[int, int]


class PairRows(NamedTuple):
    """Contact points of a pair of bodies, the same for all pairs of equal shapes."""

    swapped: bool
    """whether the first body of the pair touches the surface of the second one, not the reverse."""
    rows: tuple[Any, ...]
    law: ContactLaw
    boxes: list[float] | None
    """centres and half edge lengths of two boxes, see mechanics.compiled.BoxPair; else None."""


class Between:
    """Pairs of bodies in contact through `between`, without an own constraint for each pair."""

    def __init__(self, scene: Scene, place: InitialPlace) -> None:
        self.scene, self._place = scene, place
        self.names = tuple(scene.bodies)
        index = {name: i for i, name in enumerate(self.names)}
        self.groups: dict[str, dict[int, str]] = {}
        """bodies of each group, with the names of their constraints."""
        self._specs: dict[str, Contact] = {}
        self._joined: set[frozenset[int]] = set()
        for name, spec in scene.constraints.items():
            parent = getattr(spec, "parent", None)
            if isinstance(spec, Contact) and spec.between is not None:
                group = name.removesuffix(f"_{spec.body}")
                self.groups.setdefault(group, {})[index[spec.body]] = name
                self._specs[group] = spec
            elif parent is not None:
                self._joined.add(frozenset((index[parent], index[spec.body])))  # type: ignore[attr-defined]
        self._balls = np.array([self._ball(name) for name in self.names])
        kinds: dict[Any, int] = {}
        self._kinds = [kinds.setdefault(self._kind(name), len(kinds)) for name in self.names]
        self._made: dict[Any, PairRows] = {}
        self._check()

    def __bool__(self) -> bool:
        return bool(self.groups)

    @property
    def radii(self) -> np.ndarray:
        """Radii of the bounding balls about the centres of mass [m]; 0 without a shape."""
        return self._balls

    def _ball(self, name: str) -> float:
        shape = self._place.shape(name)
        if shape is None:
            return 0.0
        return norm(self._place.from_com(name, shape.center_B)) + float(shape.reach)

    def _kind(self, name: str) -> Any:
        """Key of the contact geometry of a body: bodies with an equal key have equal contact
        points."""
        shape = self._place.shape(name)
        if shape is None:
            return None
        return (self._place.from_com(name, shape.center_B), shape.model_dump_json())

    def _check(self) -> None:
        """Refuse shapes that cannot touch, and a pair in two groups."""
        for group, members in self.groups.items():
            examples: dict[Any, list[int]] = {}
            for i in members:
                of_kind = examples.setdefault(self._kinds[i], [])
                if len(of_kind) < 2:
                    of_kind.append(i)
            found = sorted(i for several in examples.values() for i in several)
            for at, i in enumerate(found):
                for j in found[at + 1 :]:
                    if frozenset((i, j)) not in self._joined:
                        self.rows_of(group, (i, j))
        for group, members in self.groups.items():
            for other, others in self.groups.items():
                if group < other and len(members.keys() & others.keys()) > 1:
                    what = (
                        f"two of its bodies are also in {other}; a pair of bodies takes one contact"
                    )
                    raise SceneError(what, key=f"constraints.{group}", file=self.scene.file)

    def rows_of(self, group: str, pair: Pair) -> PairRows:
        """The contact points of a pair (i < j), on j if its shape allows that, else on i."""
        key = (group, self._kinds[pair[0]], self._kinds[pair[1]])
        if key not in self._made:
            self._made[key] = self._make(group, pair)
        return self._made[key]

    def _make(self, group: str, pair: Pair) -> PairRows:
        refused, kinds = "", [self._place.shape(self.names[i]).type for i in pair]
        if not touches_everywhere(kinds):
            refused = (
                "between supports spheres with every shape and boxes with boxes; remove one, or "
                "give this pair its own contact with points"
            )
        for swapped in () if refused else (False, True):
            first, second = (self.names[i] for i in (reversed(pair) if swapped else pair))
            spec = self._specs[group].of_pair(second, first)
            try:
                rows = tuple(part.row for part in spec.parts(self._place))
            except (PydanticCustomError, ValueError) as error:
                text = error.message() if isinstance(error, PydanticCustomError) else str(error)
                refused = refused or text
                continue
            return PairRows(swapped, rows, spec.law(), box_sizes(spec, self._place))
        names = " and ".join(self.names[i] for i in pair)
        what = f"{names} cannot touch each other ({' and '.join(kinds)}): {refused}"
        raise SceneError(what, key=f"constraints.{group}", file=self.scene.file)

    def near(self, y: np.ndarray, margin: float) -> list[tuple[str, Pair]]:
        """(group, pair) of the pairs (i < j) whose balls are closer than the margin [m] at y, in
        order."""
        found = []
        centres = y[:-1].reshape(-1, 13)[:, :3]
        for group, members in self.groups.items():
            of = np.array(sorted(members))
            radii = self._balls[of]
            # each body queries bodies that are not larger: twice its own radius reaches them
            from scipy.spatial import KDTree  # imported when it is used

            tree = KDTree(centres[of])
            seen = tree.query_ball_point(centres[of], 2.0 * radii + margin)
            counts = [len(one) for one in seen]
            i = np.repeat(np.arange(len(of)), counts)
            j = np.array([k for one in seen for k in one], dtype=int)
            i, j = np.minimum(i, j), np.maximum(i, j)
            pairs = np.unique(np.stack((i[i < j], j[i < j]), axis=1), axis=0)
            apart = np.linalg.norm(centres[of[pairs[:, 0]]] - centres[of[pairs[:, 1]]], axis=1)
            close = apart - radii[pairs].sum(axis=1) <= margin
            found += [(group, (a, b)) for a, b in of[pairs[close]].tolist()]
        if not self._joined:
            return found
        return [one for one in found if frozenset(one[1]) not in self._joined]

    def placed(self, group: str, pair: Pair) -> tuple[PairRows, int, int]:
        """(contact points of a pair, index of the body that carries them, index of its parent)."""
        made = self.rows_of(group, pair)
        return (made, pair[0], pair[1]) if made.swapped else (made, pair[1], pair[0])


def touches_everywhere(shapes: list[str]) -> bool:
    """Whether the contact geometry of two shapes covers their whole surfaces, not only some
    points."""
    return "sphere" in shapes or shapes == ["box", "box"]


def box_sizes(spec: Touching, place: InitialPlace) -> list[float] | None:
    """Centre and half edge lengths of both boxes of a box-box contact [m]; None for other
    contacts."""
    if not isinstance(spec, Contact) or not isinstance(spec.surface, BodySurface):
        return None
    if spec.points is not None:
        return None
    sizes: list[float] = []
    for name in (spec.body, spec.parent):
        shape = place.shape(name)  # type: ignore[arg-type]
        if shape is None or shape.type != "box":
            return None
        sizes += [*place.from_com(name, shape.center_B), *(0.5 * edge for edge in shape.size)]
    return sizes
