# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What kernels see: constants of a body, its state, and the dispatched laws of the catalogue.

Frames: W world, B the body that a kind names, A its parent (the world when there is none).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, NamedTuple, Protocol

from rb_sim.numerics.kernels import dispatch

Vec3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Symmetric = tuple[float, float, float, float, float, float]


class Inertial(NamedTuple):
    """Constants of one rigid body."""

    mass: float
    """[kg]."""
    inertia: Symmetric
    """about the centre of mass C, body axes (xx, yy, zz, xy, xz, yz) [kg m^2]."""
    r_OC: Vec3
    """from the body origin O to C, body axes [m]."""


class BodyState(NamedTuple):
    """State of one body."""

    p_WC: Vec3
    """centre of mass, world [m]."""
    q_WB: Quaternion
    """unit quaternion [x, y, z, w], body to world."""
    v_WC: Vec3
    """velocity of the centre of mass, world [m/s]."""
    w_WB_B: Vec3
    """angular velocity, body frame [rad/s]."""


WORLD = BodyState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
"""The parent of what has none."""


class Part(NamedTuple):
    """One row of a constraint and the reactions in which its wrench counts."""

    row: NamedTuple
    outputs: tuple[str, ...] = ("",)
    """"" is the constraint's total; "A" and "B" are its bearings."""


class Place(Protocol):
    """What a spec may ask while it is compiled into rows."""

    def body_names(self) -> tuple[str, ...]:
        """All bodies of the scene."""
        ...

    def inertial(self, body: str) -> Inertial:
        """Constants of a body."""
        ...

    def state(self, body: str | None) -> BodyState:
        """Initial state of a body; WORLD for None."""
        ...

    def shape(self, body: str) -> Any:
        """The shape model of a body, or None."""
        ...

    def from_com(self, body: str | None, point: Vec3) -> Vec3:
        """A point given in body coordinates (from O), taken from C; unchanged for the world."""
        ...

    def partner_point(
        self, parent: str | None, point: Vec3 | None, body: str | None, point_B: Vec3
    ) -> Vec3:
        """The parent's point, from its C; where the body's point_B starts if `point` is None."""
        ...

    def partner_axis(
        self, parent: str | None, axis: Vec3 | None, body: str | None, axis_B: Vec3
    ) -> Vec3:
        """The parent's direction; along the body's axis_B at the start if `axis` is None."""
        ...


class ConstraintKind(Protocol):
    """What every constraint of the catalogue tells (its base is catalogue.spec.Spec)."""

    type: Any
    body: Any

    def parts(self, place: Place) -> list[Part]:
        """Its rows, and the reactions in which they count."""
        ...

    def reaction_suffixes(self, place: Place) -> tuple[str, ...]:
        """The reactions that it reports: "" is its total NAME, "A" stands for NAME/A."""
        ...

    def contact_suffixes(self, place: Place) -> tuple[str, ...]:
        """Its points of contact, named as its reactions are; none in a joint."""
        ...


class EffectKind(Protocol):
    """What every effect of the catalogue tells (its base is catalogue.spec.Spec)."""

    type: Any
    commandable: ClassVar[bool]

    def rows(self, place: Place) -> list[tuple[NamedTuple, str, str | None]]:
        """(row, body, parent) of each of its wrenches."""
        ...

    def breakpoints(self) -> tuple[float, ...]:
        """Instants at which its law is not smooth [s]; no step goes across them."""
        ...


class Changing(NamedTuple):
    """How a row, or a system, shows what changes between steps to a traced law: as its inputs."""

    count: int
    values: Callable[[Any, float, bool], tuple[float, ...]]
    """(row, t, whether for the steps from t on or for the instant alone) -> the inputs."""
    symbolic: Callable[[Any, tuple], Any]
    """(row, its inputs as symbols) -> the row that is traced in its place."""
    next: Callable[[Any, BodyState, BodyState], tuple] | None = None
    """(row, the body and its parent where a step ends) -> the inputs of the next step, of a row
    that keeps something from step to step; None: they change from outside only."""


CHANGING: dict[type, Changing] = {}
"""For the classes of which something changes; a law has everything else as constants."""


class Placed(NamedTuple):
    """A row and the bodies on which it acts; -1 stands for the world."""

    row: tuple
    body: int
    parent: int


CENTRAL: set[type] = set()
"""Row classes whose force acts at C and does not depend on how the body is turned or spins."""


@dispatch
def wrench(row, t, body, B, A):
    """Force at C in world axes [N] and torque about C in body axes [N m] on the body B."""


@dispatch
def potential(row, t, body, B, A):
    """Potential energy [J] of a conservative effect."""
