# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The answer of the statics of a scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Verdict = Literal["equilibrium", "indeterminate", "at the limit", "no equilibrium"]


@dataclass(frozen=True)
class Reaction:
    """Wrench BY a support ON its body, world axes; the parent feels the opposite force."""

    kind: str
    body: str
    parent: str | None
    """None is the world."""
    force: Array
    """[N], (3,)."""
    torque: Array
    """about the anchor [N m], (3,)."""
    anchor: Array
    """where it acts on the body, world [m], (3,)."""
    parent_anchor: Array
    """where the opposite force acts on the parent, world [m], (3,)."""
    direction: Array | None
    """normal of a contact, direction of a string or rod away from the body; world, (3,)."""
    along: float | None
    """component of the force along `direction`: normal force, tension (a rod may push) [N]."""
    friction: float | None
    """coefficient of friction; inf for rough, None where there is none to speak of."""

    @property
    def friction_used(self) -> float | None:
        """|tangential| / normal of a rubbing contact; nan without normal force."""
        if self.friction is None or self.direction is None or self.along is None:
            return None
        across = float(np.linalg.norm(self.force - self.along * self.direction))
        return across / self.along if self.along > 0.0 else float("nan")

    def ends(self) -> list[tuple[str | None, Array, Array, Array]]:
        """(body, point, force, torque) at both ends: action and reaction."""
        return [
            (self.body, self.anchor, self.force, self.torque),
            (self.parent, self.parent_anchor, -self.force, -self.torque),
        ]


@dataclass(frozen=True)
class ReactionRange:
    """Smallest and largest value of each component over admissible reactions; inf: unbounded."""

    force: Array
    """world axes [N], (3, 2)."""
    torque: Array
    """world axes, about the anchor [N m], (3, 2)."""
    along: Array | None
    """tension or normal force [N], (2,)."""
    determinate: bool
    """all components have one value."""

    @property
    def undetermined(self) -> dict[str, list[float]]:
        """[min, max] of each component that has more than one value: force_x to torque_z."""
        spans = {"force": self.force, "torque": self.torque}
        return {
            f"{kind}_{axis}": [float(low), float(high)]
            for kind, values in spans.items()
            for axis, (low, high) in zip("xyz", values, strict=True)
            if low != high
        }


@dataclass(frozen=True)
class Finding:
    """A support that fails or would fail first, or a body whose balance fails."""

    kind: Literal["slack", "lifts", "slips", "rolls", "spins", "force", "torque"]
    """a string goes slack, a contact lifts, slips, rolls or spins, a body's force or torque is not
    balanced."""
    name: str
    """the support, or the body whose balance fails."""
    amount: float
    """missing pull or push [N]; needed friction coefficient, or arm [m]; uncarried force [N] or
    torque [N m]."""
    words: str


@dataclass(frozen=True)
class StaticsResult:
    """Verdict on an equilibrium, reactions by the supports on the bodies, and their ranges."""

    verdict: Verdict
    explanation: str
    reactions: dict[str, Reaction]
    """Reactions; the minimum-norm ones if there are many; empty without equilibrium."""
    ranges: dict[str, ReactionRange]
    """Ranges of the reactions; empty without equilibrium, or if not requested."""
    indeterminacy: int
    """Number of independent states of self-stress."""
    mobility: int
    """Number of independent motions that no support resists in either direction."""
    margin: float
    """Distance of the safest state from slack, lift-off and slip as tension or normal force over
    the largest load, at most 1; negative: no equilibrium; nan: no state balances the loads."""
    tolerance: float
    """Largest |margin| and imbalance that count as "at the limit": the value requested, or the
    accuracy of the margin if that is larger."""
    accuracy: float
    """Bound of the error of ranges and minimum-norm reactions, over the largest load."""
    balance: dict[str, tuple[Array, Array]]
    """Sum of forces [N] and of torques about the centre of mass [N m] on each body, world axes,
    which should be 0; empty without equilibrium."""
    findings: tuple[Finding, ...] = field(default=())
    apart: tuple[str, ...] = ()
    """Contacts whose surfaces do not touch and which carry nothing."""

    @property
    def determinate(self) -> bool:
        """Whether all reactions have exactly one value."""
        return bool(self.reactions) and all(r.determinate for r in self.ranges.values())
