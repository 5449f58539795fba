"""~/advance (rb_sim_interfaces/Advance): wrenches in, samples on, state and reactions out.

Only while paused: until the next request nothing moves, so a controller may take its time. The
wrenches of a request act from its first sample on, and all are refused if one is.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from rclpy.node import Node

from rb_sim.base.errors import RbSimError
from rb_sim.io.messages.cdr import NANO, Layout, stamp_of
from rb_sim.io.messages.packing import Packer
from rb_sim.io.messages.topic_names import WORLD, body_frame
from rb_sim.io.messages.topics import Topic
from rb_sim.mechanics.samples import Origins, centers_of_mass
from rb_sim.ros.services.services import INACTIVE
from rb_sim.ros.serving import Turns, serve
from rb_sim.ros.stepper import Stepper
from rb_sim.ros.topics.command import (
    Command,
    Commands,
    Refusal,
    Vector,
    beyond,
    checked,
    wrong_frame,
)

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout, SampleRow
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.simulation import Simulation


# The state of a sample as the messages of rb_sim_interfaces, for the answers of services.
#
# The numbers are packed as those of the topics are, so the two agree to the last bit.


class Answer(NamedTuple):
    """What an answer says of a sample."""

    bodies: list[Any]
    """BodyState of each."""
    reactions: list[Any]
    """Reaction of each."""
    energy: float
    """kinetic plus potential [J]."""
    residual: float
    """worst violation of a constraint, relative."""


class StateMessages:
    """Makes the messages of one scene's samples; numbers come as plain floats, all at once.

    The messages are the same objects each time, with other numbers: an answer is sent before the
    next one is made.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        from rb_sim_interfaces import msg  # type: ignore[import-not-found]

        self._bodies: list[Any] = [msg.BodyState(body=name) for name in layout.bodies]
        of_each = zip(layout.reactions, layout.reaction_bodies, strict=True)
        self._reactions: list[Any] = [
            msg.Reaction(constraint=name, body=body) for name, body in of_each
        ]
        self._places = [
            *(place for state in self._bodies for place in _of_state(state)),
            *(place for one in self._reactions for place in _of_reaction(one)),
        ]
        """for each vector, in the order of the numbers: where it goes, and whether it has a w."""
        size = sum(3 + turns for _, turns in self._places) + 2
        numbers = Topic("", "", Layout().doubles(size).codec(), _numbers)
        self._codec = numbers.codec
        self._packer = Packer([numbers], layout, centers_of_mass(scene.bodies, layout.bodies))

    def of(self, row: SampleRow) -> Answer:
        """The messages of a sample."""
        packed = self._packer.pack_rows(row.row[None], row.command[None], [0])[0][0]
        values = iter(self._codec.unpack(packed))
        for place, turns in self._places:
            place.x, place.y, place.z = next(values), next(values), next(values)
            if turns:
                place.w = next(values)
        return Answer(self._bodies, self._reactions, next(values), next(values))


def _of_state(state: Any) -> tuple[tuple[Any, bool], ...]:
    pose, twist = state.pose, state.twist
    linear, angular = (twist.linear, False), (twist.angular, False)
    return (pose.position, False), (pose.orientation, True), linear, angular


def _of_reaction(one: Any) -> tuple[tuple[Any, bool], ...]:
    return (one.anchor, False), (one.wrench.force, False), (one.wrench.torque, False)


def _numbers(block: SampleBlock, motion: Origins) -> Array:
    """All numbers of an answer, shape (n, size), in the order of its vectors."""
    moving = (motion.position, block.orientation, motion.linear_velocity, motion.angular_velocity)
    acting = (block.anchor, block.reaction_force, block.reaction_torque)
    parts = [np.concatenate(one, axis=2) for one in (moving, acting)]
    totals = np.stack([block.energy, block.residual], axis=1)
    return np.concatenate([*(one.reshape(len(block), -1) for one in parts), totals], axis=1)


def set_vector(of: Any, values: Sequence[float]) -> None:
    """Three plain floats into a message's x, y and z."""
    of.x, of.y, of.z = values


GIVEN_TWICE = "given twice"


class Advancing(Protocol):
    """What the service acts on."""

    paused: bool
    inactive: bool
    failure: str
    turns: Turns

    def step_once(self) -> None: ...


class Lockstep:
    """Serves ~/advance. loop: the node's; the rest is what it steps with."""

    def __init__(
        self,
        node: Node,
        loop: Advancing,
        simulation: Simulation,
        commands: Commands,
        stepper: Stepper,
    ) -> None:
        from rb_sim_interfaces import msg  # type: ignore[import-not-found]
        from rb_sim_interfaces.srv import Advance  # type: ignore[import-not-found]

        self._msg = msg
        self._loop, self._simulation = loop, simulation
        self._commands, self._stepper = commands, stepper
        self._state = StateMessages(simulation.scene, simulation.layout)
        serve(node, Advance, "~/advance", self._advance)

    def _advance(self, request: Any, answer: Any) -> Any:
        with self._loop.turns:
            return self._answered(request, answer)

    def _answered(self, request: Any, answer: Any) -> Any:
        answer.message = self._refusal() or self._take(request.wrenches)
        if not answer.message:
            answer.success = True
            for _ in range(request.samples):
                try:
                    self._loop.step_once()
                except RbSimError as error:
                    answer.success, answer.message = False, str(error)
                    break
                answer.samples += 1
            answer.message = answer.message or f"t = {self._stepper.t:.9g} s"
        if self._stepper.last_row is not None:
            self._fill(answer, self._stepper.last_row)
        return answer

    def _refusal(self) -> str:
        if self._loop.failure:
            return self._loop.failure
        if self._loop.inactive:
            return INACTIVE
        return "" if self._loop.paused else "refused: only while paused (call ~/pause with true)"

    def _take(self, wrenches: list[Any]) -> str:
        """Let the wrenches act; why they do not, if so."""
        commands: dict[str, Command] = {}
        for one in wrenches:
            command = self._read(one)
            if one.body in commands and not isinstance(command, Refusal):
                command = Refusal(GIVEN_TWICE, "the body is given twice")
            if isinstance(command, Refusal):
                self._commands.refused[command.reason] += 1
                return f"{one.body}: wrench refused: {command.words}"
            commands[one.body] = command
        self._commands.overtake(commands)
        for body, command in commands.items():
            self._commands.give(self._stepper.ahead, body, command, self._stepper.t)
        return ""

    def _read(self, one: Any) -> Command | Refusal:
        known = self._simulation.layout.commanded
        if one.body not in known:
            named = ", ".join(known) or "none (no commanded_wrench effect)"
            return Refusal("unknown body", f"bodies that take a command: {named}")
        prefix = self._commands.prefix
        frame = {prefix + WORLD: "world", prefix + body_frame(one.body): "body"}.get(one.frame_id)
        if frame is None:
            return wrong_frame(one.frame_id, one.body, prefix)
        force, torque = _vector(one.wrench.force), _vector(one.wrench.torque)
        command = checked(frame, force, torque)
        if isinstance(command, Refusal):
            return command
        return beyond(command, self._commands.limits) or command

    def _fill(self, answer: Any, row: SampleRow) -> None:
        """State, reactions and events of the last sample."""
        msg = self._msg
        answer.stamp.sec, answer.stamp.nanosec = divmod(stamp_of(self._stepper.t), NANO)
        state = self._state.of(row)
        answer.energy, answer.residual = state.energy, state.residual
        answer.bodies, answer.reactions = state.bodies, state.reactions
        events, forgotten = self._stepper.take_events()
        if forgotten:
            answer.message += f"; {forgotten} events before the first one here are omitted"
        for event in events:
            one = msg.ContactEvent(t=event.t, contact=event.contact, kind=event.kind)
            set_vector(one.impulse, event.impulse)
            answer.events.append(one)


def _vector(of: Any) -> Vector:
    return (of.x, of.y, of.z)
