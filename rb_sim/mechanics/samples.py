# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The sample: all quantities reported at one instant, as arrays over time.

Every sink derives its schema from the definition here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rb_sim.numerics.rotations import cross, rotate

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

OPEN, SLIP, STICK = 0.0, 1.0, 2.0
"""States of a contact: open; slipping (or frictionless); sticking or rolling."""


@dataclass(frozen=True)
class ContactEvent:
    """A change of a contact: time, kind, and for an impact the impulse BY the contact ON the
    body."""

    t: float
    """time [s]."""
    contact: str
    """name of the contact, as in SampleLayout.contacts."""
    kind: str
    """kind of event: impact; closes and opens (for a string taut and slack); slips, sticks,
    reverses; rolls, stops rolling; spins, stops spinning; rests (the limit of infinitely many
    bounces); jams (Painleve: resolved by an impact); ambiguous (lift-off chosen though slipping is
    possible as well, or an impact with several solutions)."""
    impulse: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """impulse, world axes [N s]."""


def in_order(events: Iterable[ContactEvent]) -> tuple[ContactEvent, ...]:
    """Events sorted by time: a rest is recorded before the last bounce that precedes it."""
    return tuple(sorted(events, key=attrgetter("t")))


class Input(NamedTuple):
    """An external input between two samples: a wrench command, a reset, or a state that was set."""

    index: int
    """index of the first sample of its block after the input."""
    t: float
    """time from which on it acts [s]."""
    body: str
    """name of the commanded body; "" for a reset to the initial state, which ends all commands."""
    frame: str = "world"
    """axes of force and torque: "world" or "body"."""
    force: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """commanded force [N]."""
    torque: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """commanded torque about the body origin [N m]."""
    state: tuple[float, ...] = ()
    """state that was set: position of the body origin, orientation [x, y, z, w], velocity of the
    origin (world), angular velocity (body); 13 numbers, or none. One entry per body."""
    together: int = 0
    """number of bodies set in one call; their entries are consecutive."""
    project: bool = False
    """whether that state was to be projected onto the constraints."""


class SampleLayout(NamedTuple):
    """Names along the axes of a SampleBlock."""

    bodies: tuple[str, ...]
    """bodies, axis N."""
    reactions: tuple[str, ...]
    """reactions, axis K: a constraint's name, or NAME/A and NAME/B for its bearings."""
    reaction_bodies: tuple[str, ...]
    """the body on which each reaction acts, axis K."""
    commanded: tuple[str, ...]
    """bodies that take a commanded wrench, axis M."""
    contacts: tuple[str, ...] = ()
    """contact points, axis C: a constraint's name, or NAME/1, NAME/2 ... for several points."""


@dataclass(frozen=True)
class SampleBlock:
    """n samples of N bodies, K reactions, M commanded bodies and C contacts. SI units.

    Reactions act BY the constraint ON the body.
    """

    t: Array
    """simulated time [s], shape (n,)."""
    position: Array
    """centre of mass, world [m], shape (n, N, 3)."""
    orientation: Array
    """unit quaternion [x, y, z, w], body to world, shape (n, N, 4)."""
    linear_velocity: Array
    """velocity of the centre of mass, world [m/s], shape (n, N, 3)."""
    angular_velocity: Array
    """angular velocity, body frame [rad/s], shape (n, N, 3)."""
    reaction_force: Array
    """reaction force, world axes [N], shape (n, K, 3)."""
    reaction_torque: Array
    """reaction torque about the anchor, world axes [N m], shape (n, K, 3)."""
    anchor: Array
    """point of application of the reaction, world [m], shape (n, K, 3)."""
    command: Array
    """commanded [force, torque] as applied, world axes, about the body origin, shape (n, M, 6)."""
    kinetic_energy: Array
    """kinetic energy [J], shape (n,)."""
    potential_energy: Array
    """potential energy of the conservative effects [J], shape (n,)."""
    power: Array
    """power of the non-conservative effects and of the reactions [W], shape (n,)."""
    momentum: Array
    """total linear momentum, world [kg m/s], shape (n, 3)."""
    angular_momentum: Array
    """total angular momentum about the world origin, world axes [kg m^2/s], shape (n, 3)."""
    residual: Array
    """largest constraint violation, relative to the scene's scale, shape (n,)."""
    contact_work: Array
    """work of all contacts since the start, impacts included [J], shape (n,)."""
    contact_state: Array
    """state of each contact: OPEN, SLIP or STICK, shape (n, C)."""
    events: tuple[ContactEvent, ...] = ()
    """contact events since the previous block, up to the last sample."""
    inputs: tuple[Input, ...] = ()
    """commands and resets before the samples of this block, in order."""
    worst: tuple[Array, float] | None = None
    """(residuals, their maximum) if the loop that made the samples computed it; finding the maximum
    of a strided column costs more than all other checks of a block."""

    @property
    def worst_residual(self) -> float:
        """The largest of the residuals; nan if one is."""
        if self.worst is not None and self.worst[0] is self.residual:  # not for a part of the block
            return self.worst[1]
        return float(np.maximum.reduce(self.residual))

    def __len__(self) -> int:
        return len(self.t)

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy [J], shape (n,)."""
        return self.kinetic_energy + self.potential_energy


class SampleRow(NamedTuple):
    """One sample as a row of the kernel."""

    t: float
    """simulated time [s]."""
    row: Array
    """row of the kernel, shape (width,)."""
    command: Array
    """command as in SampleBlock, shape (M, 6)."""
    events: tuple[ContactEvent, ...] = ()
    inputs: tuple[Input, ...] = ()

    def block(self, layout: SampleLayout) -> SampleBlock:
        """A block of this one sample."""
        return block_of_rows([self], layout)


ARRAYS = tuple(f.name for f in fields(SampleBlock) if f.name not in ("events", "inputs", "worst"))
"""Fields of a block that are arrays over time."""


def row_width(layout: SampleLayout) -> int:
    """Number of columns that the kernel writes per sample."""
    contacts = 1 + len(layout.contacts) if layout.contacts else 0
    return 13 * len(layout.bodies) + 9 * len(layout.reactions) + 10 + contacts


def empty_block(n: int, layout: SampleLayout) -> SampleBlock:
    """Zeroed block of n samples."""
    command = np.zeros((n, len(layout.commanded), 6))
    return block_of(np.zeros(n), np.zeros((n, row_width(layout))), layout, command)


def block_of(t: Array, out: Array, layout: SampleLayout, command: Array) -> SampleBlock:
    """A block from rows of the kernel.

    out: (n, width) as the kernel writes them; command: (n, M, 6), world axes.
    """
    n, bodies, reactions = len(t), len(layout.bodies), len(layout.reactions)
    body = out[:, : 13 * bodies].reshape(n, bodies, 13)
    at = 13 * bodies
    reaction = out[:, at : at + 9 * reactions].reshape(n, reactions, 9)
    balance = out[:, at + 9 * reactions :]
    return SampleBlock(
        t=np.array(t),
        position=body[:, :, 0:3],
        orientation=body[:, :, 3:7],
        linear_velocity=body[:, :, 7:10],
        angular_velocity=body[:, :, 10:13],
        reaction_force=reaction[:, :, 0:3],
        reaction_torque=reaction[:, :, 3:6],
        anchor=reaction[:, :, 6:9],
        command=command,
        kinetic_energy=balance[:, 0],
        potential_energy=balance[:, 1],
        power=balance[:, 2],
        momentum=balance[:, 3:6],
        angular_momentum=balance[:, 6:9],
        residual=balance[:, 9],
        contact_work=balance[:, 10] if layout.contacts else np.zeros(n),
        contact_state=balance[:, 11:],
    )


def rows_of(block: SampleBlock) -> Array:
    """Rows of the kernel from a block, (n, width): the inverse of `block_of`."""
    motion = ("position", "orientation", "linear_velocity", "angular_velocity")
    reaction = ("reaction_force", "reaction_torque", "anchor")
    balance = ("kinetic_energy", "potential_energy", "power", "momentum", "angular_momentum")
    contacts = ("contact_work", "contact_state") if block.contact_state.size else ()
    groups = [
        np.concatenate([getattr(block, name) for name in names], axis=2)
        for names in (motion, reaction)
    ]
    groups += [getattr(block, name) for name in (*balance, "residual", *contacts)]
    return np.concatenate([part.reshape(len(block), -1) for part in groups], axis=1)


def block_of_rows(rows: Sequence[SampleRow], layout: SampleLayout) -> SampleBlock:
    """One block from one or more samples in time order."""
    t = np.array([one.t for one in rows])
    out = np.array([one.row for one in rows])
    block = block_of(t, out, layout, np.array([one.command for one in rows]))
    if not any(one.events or one.inputs for one in rows):
        return block
    events = tuple(event for one in rows for event in one.events)
    inputs = tuple(given._replace(index=k) for k, one in enumerate(rows) for given in one.inputs)
    return replace(block, events=events, inputs=inputs)


def concatenate(blocks: Iterable[SampleBlock], layout: SampleLayout) -> SampleBlock:
    """One block from several in time order; an empty block if there are none."""
    parts = list(blocks) or [empty_block(0, layout)]
    return SampleBlock(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS},
        events=tuple(event for part in parts for event in part.events),
        inputs=tuple(_shifted(parts)),
        worst=None,
    )


def _shifted(parts: list[SampleBlock]) -> Iterator[Input]:
    """The inputs of the parts, with indices relative to the whole."""
    first = 0
    for part in parts:
        yield from (entry._replace(index=entry.index + first) for entry in part.inputs)
        first += len(part)


# From the centre of mass C to the body origin O.
#
#     p_O = p_C - R r_OC          v_O = v_C - w x (R r_OC)
#
# with r_OC the centre of mass in the body frame and w the angular velocity in world axes.


def centers_of_mass(bodies: Mapping[str, Any], names: tuple[str, ...]) -> Array:
    """r_OC of each named body, body frame [m], shape (N, 3)."""
    return np.array([bodies[name].center_of_mass for name in names], dtype=float).reshape(-1, 3)


class Origins(NamedTuple):
    """Motion of the body origins, world axes, SI; each of shape (n, N, 3)."""

    position: Array
    linear_velocity: Array
    angular_velocity: Array


def origins(block: SampleBlock, center_of_mass: Array) -> Origins:
    """Motion of the body origins. center_of_mass: r_OC, shape (N, 3)."""
    spin_W = rotate(block.orientation, block.angular_velocity)
    if not center_of_mass.any():
        return Origins(block.position, block.linear_velocity, spin_W)
    r_OC_W = rotate(block.orientation, center_of_mass)
    velocity = block.linear_velocity - cross(spin_W, r_OC_W)
    return Origins(block.position - r_OC_W, velocity, spin_W)
