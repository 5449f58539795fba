"""~/advance (rb_sim_interfaces/Advance): wrenches in, samples on, state and reactions out.

Only while paused: until the next request nothing moves, so a controller may take its time. The
wrenches of a request act from its first sample on, and all are refused if one is.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from rclpy.node import Node
from rclpy.time import Time

from rb_sim.errors import RbSimError
from rb_sim.ros.command import Command, Commands, Refusal, Vector, beyond, checked, wrong_frame
from rb_sim.ros.serving import Turns
from rb_sim.ros.stepper import Stepper
from rb_sim.sinks.frames import centers_of_mass, origins
from rb_sim.sinks.topics import WORLD

if TYPE_CHECKING:
    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.simulation import Simulation


class Advancing(Protocol):
    """What the service acts on."""

    paused: bool
    failure: str
    turns: Turns

    @property
    def ending(self) -> bool: ...

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
        layout = simulation.layout
        self._center_of_mass = centers_of_mass(simulation.scene.bodies, layout.bodies)
        node.create_service(Advance, "~/advance", self._advance)

    def _advance(self, request: Any, answer: Any) -> Any:
        with self._loop.turns:
            return self._answered(request, answer)

    def _answered(self, request: Any, answer: Any) -> Any:
        answer.message = self._refusal() or self._take(request.wrenches)
        if not answer.message:
            answer.success = True
            for _ in range(request.samples):
                if self._loop.ending:
                    break
                try:
                    self._loop.step_once()
                except RbSimError as error:
                    answer.success, answer.message = False, str(error)
                    break
                answer.samples += 1
            answer.message = answer.message or f"t = {self._stepper.t:.9g} s"
        if self._stepper.last is not None:
            self._fill(answer, self._stepper.last)
        return answer

    def _refusal(self) -> str:
        if self._loop.failure:
            return self._loop.failure
        return "" if self._loop.paused else "refused: only while paused (call ~/pause with true)"

    def _take(self, wrenches: list[Any]) -> str:
        """Let the wrenches act; why they do not, if so."""
        commands: dict[str, Command] = {}
        for one in wrenches:
            command = self._read(one)
            if isinstance(command, Refusal):
                self._commands.refused[command.reason] += 1
                return f"{one.body}: wrench refused: {command.words}"
            commands[one.body] = command
        for body, command in commands.items():
            self._commands.give(self._simulation, body, command, self._stepper.t)
        return ""

    def _read(self, one: Any) -> Command | Refusal:
        known = self._simulation.layout.commanded
        if one.body not in known:
            named = ", ".join(known) or "none (no commanded_wrench effect)"
            return Refusal("unknown body", f"bodies that take a command: {named}")
        prefix = self._commands.prefix
        frame = {prefix + WORLD: "world", prefix + one.body: "body"}.get(one.frame_id)
        if frame is None:
            return wrong_frame(one.frame_id, one.body, prefix)
        force, torque = _vector(one.wrench.force), _vector(one.wrench.torque)
        command = checked(frame, force, torque)
        if isinstance(command, Refusal):
            return command
        return beyond(command, self._commands.limits) or command

    def _fill(self, answer: Any, block: SampleBlock) -> None:
        """State, reactions and events of the last sample."""
        layout, msg = self._simulation.layout, self._msg
        answer.stamp = Time(nanoseconds=round(self._stepper.t * 1e9)).to_msg()
        answer.energy, answer.residual = float(block.energy[-1]), float(block.residual[-1])
        answer.bodies = body_states(msg, layout, block, self._center_of_mass)
        for i, name in enumerate(layout.reactions):
            reaction = msg.Reaction(constraint=name, body=layout.reaction_bodies[i])
            _set(reaction.anchor, block.anchor[-1, i])
            _set(reaction.wrench.force, block.reaction_force[-1, i])
            _set(reaction.wrench.torque, block.reaction_torque[-1, i])
            answer.reactions.append(reaction)
        recent = self._stepper.recent
        while recent:
            event = recent.popleft()
            told = msg.ContactEvent(t=event.t, contact=event.contact, kind=event.kind)
            _set(told.impulse, event.impulse)
            answer.events.append(told)


def body_states(
    msg: Any, layout: SampleLayout, block: SampleBlock, center_of_mass: Array
) -> list[Any]:
    """A BodyState for each body at the last sample."""
    motion = origins(block, center_of_mass)
    states = []
    for i, name in enumerate(layout.bodies):
        state = msg.BodyState(body=name)
        _set(state.pose.position, motion.position[-1, i])
        _set(state.pose.orientation, block.orientation[-1, i])
        _set(state.twist.linear, motion.linear_velocity[-1, i])
        _set(state.twist.angular, motion.angular_velocity[-1, i])
        states.append(state)
    return states


def _set(of: Any, values: Any) -> None:
    for name, value in zip("xyzw", values, strict=False):
        setattr(of, name, float(value))


def _vector(of: Any) -> Vector:
    return (of.x, of.y, of.z)
