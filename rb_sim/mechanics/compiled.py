# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A compiled scene: the system that kernels integrate, its initial coordinates, its samples."""

from __future__ import annotations

import hashlib
import pickle
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.compiler.graph.machine import interpreted
from rb_sim.compiler.graph.store import cache_root
from rb_sim.mechanics.initial_projection import changing_in, dependent_rows
from rb_sim.mechanics.inputs import Family, Place, cleared
from rb_sim.mechanics.laws import ReducedLaws, traceable
from rb_sim.mechanics.multibody_laws import MultiBodyLaws
from rb_sim.mechanics.samples import SampleLayout, row_width
from rb_sim.mechanics.systems.elimination import INDEPENDENT, Dependent
from rb_sim.mechanics.systems.many_bodies import MultiBody
from rb_sim.mechanics.table_laws import laws_over_tables

if TYPE_CHECKING:
    from rb_sim.catalogue.contact import ContactLaw, Sides


# Cache of the laws of recent systems: running the same scene again, with another method or
# tolerance, needs no tracing, compiling or loading.


KEPT = 32
"""Number of systems whose laws are cached; those of one body take 0.3 MB of memory, of ten 1 MB."""

_LAWS: OrderedDict[Hashable, Any] = OrderedDict()
_LOCK = threading.Lock()


def recent_laws(system: Any, others: Hashable, make: Callable[[Any], Any]) -> Any:
    """make(system), or its cached result for an equal system and equal `others`.

    The laws get their own copy of the system, with a cleared workspace.
    """
    own = cleared(system)
    try:
        # classes by name, floats bit by bit
        content = hashlib.sha256(pickle.dumps(own)).digest()
    except (pickle.PicklingError, AttributeError, TypeError):  # a class that cannot be imported
        return make(own)
    key = content, others, interpreted(), cache_root()
    with _LOCK:
        if key not in _LAWS:
            _LAWS[key] = make(own)
        _LAWS.move_to_end(key)
        while len(_LAWS) > KEPT:
            _LAWS.popitem(last=False)
        return _LAWS[key]


def forget() -> None:
    """Empty the cache of laws."""
    with _LOCK:
        _LAWS.clear()


class BoxPair(NamedTuple):
    """Contact of a box with a box: both sizes, for methods that intersect their surfaces."""

    first: int
    """index of its first point among the contact points."""
    sizes: list[float]
    """centre (from C) and half edges of the body's box, then of the parent's; 12 numbers [m]."""


@dataclass(frozen=True)
class Compiled:
    """A compiled scene as the outer loop needs it; no field holds a string that kernels would
    see."""

    system: Any
    y: Any
    """initial coordinates: a tuple (one body, reduced) or an array (maximal)."""
    layout: SampleLayout
    commands: dict[str, tuple[int, ...]]
    """indices of the command rows of each commanded body among system.effects."""
    breakpoints: tuple[float, ...]
    """instants that no step may cross, increasing [s]."""
    indeterminate: tuple[str, ...]
    """reactions whose values equilibrium alone does not determine."""
    rows: int
    degrees_of_freedom: int
    contact_laws: tuple[ContactLaw, ...] = ()
    """law of each contact point; () without contacts."""
    box_pairs: tuple[BoxPair, ...] = ()
    """contacts of a box with a box: their points form one contact."""
    sides: tuple[Sides, ...] = ()
    """edges that may penetrate between the contact points of a body."""
    one_by_one: bool = False
    """whether simultaneous impacts are solved one after the other."""
    between: Any = None
    """pairs of bodies in contact through `between`, a scene.pairs_of_bodies.Between; None without
    such contacts."""
    absolute: tuple[float | None, ...] = ()
    """absolute tolerance of each body; () if none is given."""

    @property
    def reduced(self) -> bool:
        """True in reduced coordinates."""
        return not isinstance(self.y, np.ndarray)

    @property
    def redundant(self) -> bool:
        """True if constraints depend on each other at the start."""
        return self.rows > 6 * len(self.layout.bodies) - self.degrees_of_freedom

    @cached_property
    def dependent(self) -> Dependent:
        """The rows that depend on others at the start and in all later positions."""
        if not self.redundant or not isinstance(self.y, np.ndarray):
            return INDEPENDENT
        return dependent_rows(self.system, self.y)

    @cached_property
    def laws(self) -> ReducedLaws | MultiBodyLaws | None:
        """The traced laws of the system; None if it is compiled by inference of types instead."""
        if not traceable(self.system):
            return None
        others = type(self.system), len(self.y), row_width(self.layout), self._lost
        return recent_laws(self.system, others, lambda system: self._laws_of(system, ()))

    @property
    def _lost(self) -> tuple[bool, Dependent]:
        """(redundant, dependent rows), which the laws take as fixed."""
        return self.redundant, self.dependent

    def _laws_of(self, system: Any, varied: Sequence[Place]) -> ReducedLaws | MultiBodyLaws:
        """The traced laws with the constants at these places as inputs instead of constants."""
        width = row_width(self.layout)
        if isinstance(system, MultiBody):
            redundant, dependent = self._lost
            fixed = MultiBodyLaws(system, width, redundant, varied, dependent)
            over_tables, changing = laws_over_tables(fixed), changing_in(system, dependent)
            if over_tables is not fixed or not changing:
                return over_tables
            return MultiBodyLaws(system, width, redundant, varied, dependent, changing)
        return ReducedLaws(system, len(self.y), width, varied)

    def sharing(self, family: Family) -> Compiled:
        """The same scene with the laws of the family; unchanged if its system is not a member."""
        laws: Any = family.laws
        if isinstance(laws, MultiBodyLaws) and (laws.redundant, laws.dependent) != self._lost:
            return self
        if not family.has(self.system):
            return self
        shared = replace(self)
        shared.__dict__["laws"] = family.laws  # where cached_property looks
        return shared


def family_of(members: Sequence[Compiled]) -> Family | None:
    """Laws shared by scenes that differ in numbers only; None if they cannot be traced."""
    first = members[0]
    if not traceable(first.system):
        return None
    systems = [member.system for member in members]
    return Family(
        systems, lambda _, varied: first._laws_of(first.system, varied) if varied else first.laws
    )
