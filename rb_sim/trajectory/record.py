# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The samples of a run by name: what tables, plots and wrenches are made of; states at instants."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import index
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from rb_sim.base.diagnostic import Finding, GlobalError
from rb_sim.base.errors import RbSimError, UnknownNameError
from rb_sim.base.names import one_of
from rb_sim.mechanics.samples import Array, ContactEvent, SampleBlock, SampleLayout

if TYPE_CHECKING:
    from rb_sim.scene.schema import Scene

T = TypeVar("T")


class ByName(dict[str, T]):
    """A dict whose KeyError tells what was asked for and what is allowed.

    what: a value of it is called so.
    """

    def __init__(self, what: str, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._what = what

    def __missing__(self, name: object) -> T:
        allowed = f"must be {one_of(name, self)}" if self else "there is none in this run"
        raise UnknownNameError(f"{self._what}: got {name!r}; {allowed}")

    def __reduce__(self) -> tuple[type[ByName[T]], tuple[str, dict[str, T]]]:
        return ByName, (self._what, dict(self))


class Reaction(NamedTuple):
    """Wrench of a constraint or an effect ON a body over time, world axes."""

    force: Array
    """Force [N], shape (n, 3)."""
    torque: Array
    """Torque about the anchor [N m], shape (n, 3)."""
    anchor: Array
    """Anchor or contact point; of an effect the centre of mass; world [m], shape (n, 3)."""


class Record:
    """Samples of a run by name, and the scene that moved; see `Trajectory`."""

    def __init__(
        self,
        block: SampleBlock,
        layout: SampleLayout,
        scene: Any = None,
        method: str = "",
        findings: Sequence[Finding] = (),
        error: GlobalError | None = None,
    ) -> None:
        self.block = block
        self.layout = layout
        self.scene: Scene | Any = scene
        """Scene that was simulated; None if only samples are known."""
        self.method = method
        """Method and its setting, in words."""
        self.findings = tuple(findings)
        """Accuracy checks that failed in the run, by time."""
        self.global_error = error
        """Error of the run by a second, finer run; None if none was made."""

    def __len__(self) -> int:
        return len(self.block)

    def _by_body(self, values: Array) -> Mapping[str, Array]:
        return ByName("body", {name: values[:, i] for i, name in enumerate(self.layout.bodies)})

    @property
    def t(self) -> Array:
        """Simulated time [s], shape (n,)."""
        return self.block.t

    @property
    def position(self) -> Mapping[str, Array]:
        """Position of each body's centre of mass, world [m], shape (n, 3)."""
        return self._by_body(self.block.position)

    @property
    def orientation(self) -> Mapping[str, Array]:
        """Attitude of each body: unit quaternion [x, y, z, w], body to world, shape (n, 4)."""
        return self._by_body(self.block.orientation)

    @property
    def linear_velocity(self) -> Mapping[str, Array]:
        """Velocity of each body's centre of mass, world [m/s], shape (n, 3)."""
        return self._by_body(self.block.linear_velocity)

    @property
    def angular_velocity(self) -> Mapping[str, Array]:
        """Angular velocity of each body, body axes [rad/s], shape (n, 3)."""
        return self._by_body(self.block.angular_velocity)

    @property
    def reaction(self) -> Mapping[str, Reaction]:
        """Reaction of each constraint BY it ON the body: force [N] and torque [N m] about the
        anchor, world axes, shape (n, 3) each.

        NAME of a fixed axis is the total about bearing A; NAME/A and NAME/B are the bearings.
        NAME/1, NAME/2 ... are the points of a contact with several points.
        """
        b = self.block
        by_name = {
            name: Reaction(b.reaction_force[:, i], b.reaction_torque[:, i], b.anchor[:, i])
            for i, name in enumerate(self.layout.reactions)
        }
        return ByName("reaction", by_name)

    @property
    def command(self) -> Mapping[str, Array]:
        """Commanded force [N] and torque [N m] on each body that takes commands, as applied, about
        the body origin, world axes, shape (n, 6)."""
        commands = {name: self.block.command[:, i] for i, name in enumerate(self.layout.commanded)}
        return ByName("commanded body", commands)

    @property
    def contact_state(self) -> Mapping[str, Array]:
        """State of each point of contact: 0 open, 1 slip, 2 stick or roll, shape (n,) each."""
        b = self.block
        states = {name: b.contact_state[:, c] for c, name in enumerate(self.layout.contacts)}
        return ByName("contact", states)

    @property
    def contact_work(self) -> Array:
        """Work of all contacts since the start, impacts included [J], shape (n,)."""
        return self.block.contact_work

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """Events of contacts by time: instant [s], contact, kind, impulse [N s] of an impact."""
        return self.block.events

    @property
    def energy(self) -> Array:
        """Kinetic plus potential energy [J], shape (n,)."""
        return self.block.energy

    @property
    def kinetic_energy(self) -> Array:
        """Kinetic energy of all bodies [J], shape (n,)."""
        return self.block.kinetic_energy

    @property
    def potential_energy(self) -> Array:
        """Potential energy of all effects that have one (gravity, springs) [J], shape (n,)."""
        return self.block.potential_energy

    @property
    def power(self) -> Array:
        """Power of the effects without potential and of the reactions [W], shape (n,)."""
        return self.block.power

    @property
    def momentum(self) -> Array:
        """Linear momentum of all bodies, world axes [kg m/s], shape (n, 3)."""
        return self.block.momentum

    @property
    def angular_momentum(self) -> Array:
        """Angular momentum of all bodies about the world origin, world axes [kg m^2/s], (n, 3)."""
        return self.block.angular_momentum

    @property
    def residual(self) -> Array:
        """Largest violation of a constraint, relative to the scene's scale, shape (n,)."""
        return self.block.residual


# States at single instants of a run, and beside the events of its contacts.


NEAR = 256.0
"""Roundings of the end time within which a sample lies beside an event."""


@dataclass(frozen=True)
class State:
    """State of all bodies at one instant; each mapping has the names of the bodies."""

    t: float
    """Simulated time [s]."""
    position: Mapping[str, Array]
    """Centre of mass, world [m], shape (3,)."""
    orientation: Mapping[str, Array]
    """Unit quaternion [x, y, z, w], body to world, shape (4,)."""
    linear_velocity: Mapping[str, Array]
    """Velocity of the centre of mass, world [m/s], shape (3,)."""
    angular_velocity: Mapping[str, Array]
    """Angular velocity, body axes [rad/s], shape (3,)."""


class EventState(NamedTuple):
    """An event of a contact with the states just before and just after it."""

    event: ContactEvent
    """Instant [s], contact, kind, and of an impact the impulse on the body [N s]."""
    before: State
    """State just before the event."""
    after: State
    """State just after the event."""


def state_of(run: Record, sample: int) -> State:
    """The state at that sample of the run. Raises RbSimError where there is none such."""
    count = len(run)
    try:
        found = -count <= index(sample) < count
    except TypeError:
        found = False
    if not found:
        raise RbSimError(
            f"state: got {sample!r}; must be a whole number from {-count} to {count - 1}"
        )
    columns = ("position", "orientation", "linear_velocity", "angular_velocity")
    block, bodies = run.block, run.layout.bodies

    def rows(name: str) -> Mapping[str, Array]:
        values = getattr(block, name)[sample]
        return ByName("body", {body: values[i] for i, body in enumerate(bodies)})

    return State(float(run.t[sample]), **{name: rows(name) for name in columns})


def beside(run: Record, event: ContactEvent) -> EventState:
    """The event with the states of the samples just before and just after it.

    Raises RbSimError where no samples lie there.
    """
    near = NEAR * np.spacing(max(abs(float(run.t[-1])), abs(event.t)))
    after = int(np.searchsorted(run.t, event.t, side="right"))
    before = int(np.searchsorted(run.t, event.t, side="left")) - 1
    if after == len(run.t):
        after -= 1
    before = max(before, 0)
    rows = (before, after) if run.t[before] > 0.0 or event.t > near else (0, 0)
    if any(abs(run.t[row] - event.t) > near for row in rows):
        raise RbSimError(
            f"no sample lies beside the event at t = {event.t:.9g} s: "
            "Simulation.run(events=True) samples there"
        )
    return EventState(event, state_of(run, rows[0]), state_of(run, rows[1]))
