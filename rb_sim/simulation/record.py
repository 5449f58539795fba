# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The samples of a run by name, states at single instants, and the wrenches on its bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from rb_sim.base.errors import Finding, GlobalError, RbSimError, UnknownNameError
from rb_sim.base.names import one_of
from rb_sim.catalogue.spec import WORLD, BodyState, wrench
from rb_sim.mechanics.samples import Array, ContactEvent, SampleBlock, SampleLayout, empty_block
from rb_sim.numerics.rotations import conjugate, cross, rotate
from rb_sim.scene.place import InitialPlace
from rb_sim.scene.schema import Scene

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene


T = TypeVar("T")


class ByName(dict[str, T]):
    """A read-only dict whose KeyError names the requested and the allowed keys.

    what: word for a value in the message.
    """

    def __init__(self, what: str, values: Mapping[str, T]) -> None:
        super().__init__(values)
        self._what = what

    def __missing__(self, name: object) -> T:
        allowed = f"must be {one_of(name, self)}" if self else "there is none in this run"
        raise UnknownNameError(f"{self._what}: got {name!r}; {allowed}")

    def __setitem__(self, name: str, value: T) -> None:
        raise RbSimError(
            f"{name}: samples are read-only; the state of a simulation is set by set_state"
        )

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

    def __repr__(self) -> str:  # a run has dozens of them, of a thousand rows each
        force, torque, anchor = (x[0] if len(x) == 1 else x.shape for x in self)
        return f"<Reaction: force {force} N, torque {torque} N m, anchor {anchor} m>"


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


# States at single instants of a run, and at contact events.


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
    """Instant [s], contact, kind, and impulse of an impact on the body [N s]."""
    before: State
    """State just before the event."""
    after: State
    """State just after the event."""


# Wrenches of effects at the samples of a trajectory, evaluated by the laws of the catalogue.


def effect_wrenches(trajectory: Record) -> Mapping[str, Reaction]:
    """Wrenches of effects about C, by NAME, or NAME/BODY for an effect on several bodies.

    World axes, ON the body; on the parent of an effect the opposite, about the parent's C. Raises
    RbSimError if the scene is not known.
    """
    found: dict[str, Reaction] = {}
    for name, by_body in wrenches_by_body(trajectory).items():
        for body, acting in by_body.items():
            found[name if len(by_body) == 1 else f"{name}/{body}"] = acting
    return found


def wrenches_by_body(trajectory: Record) -> Mapping[str, Mapping[str, Reaction]]:
    """Wrenches by effect, then by the body on which they act; as `effect_wrenches`."""
    scene = trajectory.scene
    if not isinstance(scene, Scene):
        raise RbSimError("effects: the scene of these samples is not known")
    place = InitialPlace(scene)
    return {
        name: {
            body: Reaction(force, torque, trajectory.position[body])
            for body, (force, torque) in _of_effect(trajectory, place, spec).items()
        }
        for name, spec in scene.effects.items()
    }


def _of_effect(
    trajectory: Record, place: InitialPlace, spec: Any
) -> dict[str, tuple[Array, Array]]:
    """(force, torque about C) by body, world axes, shape (n, 3) each."""
    if spec.type == "commanded_wrench":
        return {spec.body: _commanded(trajectory, place, spec.body)}
    totals: dict[str, tuple[Array, Array]] = {}
    for row, body, parent in spec.rows(place):
        force, torque = _of_row(trajectory, place, row, body, parent)
        _add(totals, body, force, torque)
        if parent is not None:
            lever = trajectory.position[body] - trajectory.position[parent]
            _add(totals, parent, -force, -torque - np.cross(lever, force))
    return totals


def _add(totals: dict[str, tuple[Array, Array]], body: str, force: Array, torque: Array) -> None:
    f, m = totals.get(body, (np.zeros_like(force), np.zeros_like(torque)))
    totals[body] = f + force, m + torque


def _of_row(
    trajectory: Record, place: InitialPlace, row: Any, body: str, parent: str | None
) -> tuple[Array, Array]:
    """(force, torque about C) of one row of the catalogue at every sample, world axes."""
    inertial = place.inertial(body)
    bodies = _states(trajectory, body)
    parents = [WORLD] * len(bodies) if parent is None else _states(trajectory, parent)
    pairs = [
        wrench(row, t, inertial, B, A)
        for t, B, A in zip(trajectory.t.tolist(), bodies, parents, strict=True)
    ]
    force = np.array([pair[0] for pair in pairs], dtype=float).reshape(-1, 3)
    torque_B = np.array([pair[1] for pair in pairs], dtype=float).reshape(-1, 3)
    return force, rotate(trajectory.orientation[body], torque_B)


def _states(trajectory: Record, body: str) -> list[BodyState]:
    columns = (
        trajectory.position[body],
        trajectory.orientation[body],
        trajectory.linear_velocity[body],
        trajectory.angular_velocity[body],
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [BodyState(*map(tuple, row)) for row in rows]


def _commanded(trajectory: Record, place: InitialPlace, body: str) -> tuple[Array, Array]:
    """(force, torque about C) of the recorded command, which is about the body origin."""
    command = trajectory.command[body]
    force, torque = command[:, :3], command[:, 3:]
    r_OC_W = rotate(trajectory.orientation[body], np.array(place.inertial(body).r_OC))
    return force, torque - np.cross(r_OC_W, force)


# Accelerations of the bodies at the samples of a trajectory, by Newton's and Euler's equations.
#
#     m a_C = F        I dw/dt + w x I w = K        (about the centre of mass C, body axes)
#
# F and K are the wrenches of the effects, evaluated at the samples, and the recorded reactions; the
# integration does not need them, so they cost time only when requested.


class Accelerations(NamedTuple):
    """Accelerations of all bodies, in the order of the layout."""

    linear: Array
    """acceleration of the centre of mass, world axes [m/s^2], shape (n, N, 3)."""
    angular: Array
    """angular acceleration dw/dt, body axes [rad/s^2], shape (n, N, 3)."""


def accelerations(trajectory: Record) -> Accelerations:
    """The accelerations at every sample, without the jumps of impacts.

    Raises RbSimError if the scene is not known, and for time_stepping, whose reactions are means
    over a step.
    """
    scene = trajectory.scene
    if not isinstance(scene, Scene):
        raise RbSimError("accelerations: the scene of these samples is not known")
    if scene.simulation.method == "time_stepping":
        raise RbSimError(
            "accelerations: method time_stepping has reactions that are means over its steps; "
            "must be another method"
        )
    block, bodies = trajectory.block, trajectory.layout.bodies
    force, torque = np.zeros_like(block.position), np.zeros_like(block.position)
    for body, acting in _wrenches(trajectory, scene):
        i = bodies.index(body)
        lever = acting.anchor - block.position[:, i]
        force[:, i] += acting.force
        torque[:, i] += acting.torque + cross(lever, acting.force)
    mass = np.array([scene.bodies[name].mass for name in bodies])
    inertia = np.array([scene.bodies[name].inertia for name in bodies])
    spin = block.angular_velocity
    moment = rotate(conjugate(block.orientation), torque)
    moment -= cross(spin, np.einsum("bij,nbj->nbi", inertia, spin))
    angular = np.linalg.solve(inertia, moment[..., None])[..., 0]
    return Accelerations(force / mass[:, None], np.asarray(angular, dtype=float))


def accelerating(scene: Scene, layout: SampleLayout) -> Callable[[SampleBlock], Accelerations]:
    """Function that returns the accelerations of blocks of a run. Raises RbSimError as
    `accelerations`."""

    def of(block: SampleBlock) -> Accelerations:
        return accelerations(Record(block, layout, scene))

    of(empty_block(0, layout))  # refuses an unsupported scene before the run
    return of


def _wrenches(trajectory: Record, scene: Scene) -> Iterator[tuple[str, Reaction]]:
    """(body, wrench ON it) of all effects and constraints, including those on parents."""
    for by_body in wrenches_by_body(trajectory).values():
        yield from by_body.items()
    place = InitialPlace(scene)
    reactions = trajectory.reaction
    joints: dict[str, Any] = dict(scene.constraints)
    for name, spec in joints.items():
        suffixes = spec.reaction_suffixes(place)
        for suffix in ("",) if "" in suffixes else suffixes:  # the total includes all others
            wrench = reactions[f"{name}/{suffix}" if suffix else name]
            yield spec.body, wrench
            if getattr(spec, "parent", None) is not None:
                yield spec.parent, wrench._replace(force=-wrench.force, torque=-wrench.torque)
