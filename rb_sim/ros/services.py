# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Services of the node: ~/reset, ~/step and ~/pause, and those with optional interface packages."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from rclpy.node import Node
from rclpy.time import Time
from std_srvs.srv import SetBool, Trigger

from rb_sim.base.errors import RbSimError
from rb_sim.io.messages.cdr import NANO, Layout, stamp_of
from rb_sim.io.messages.packing import Packer, columns_of
from rb_sim.io.messages.topic_names import WORLD, body_frame
from rb_sim.io.messages.topics import Topic
from rb_sim.mechanics.samples import centers_of_mass
from rb_sim.numerics.rotations import conjugate, rotate
from rb_sim.ros.build_interfaces import is_there
from rb_sim.ros.serving import Turns, serve, unusable
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
    from rb_sim.mechanics.samples import SampleLayout, SampleRow
    from rb_sim.ros.stepper import Stepper
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.simulation import Simulation
    from rb_sim.simulation.state_override import Placement


class Loop(Protocol):
    """The node's loop as seen by the services."""

    paused: bool
    inactive: bool
    failure: str
    turns: Turns

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        ...

    @property
    def commands(self) -> Commands:
        """The commanded wrenches."""
        ...

    def pause(self, paused: bool) -> None:
        """Pause or continue."""
        ...

    def reset(self) -> None:
        """Restart from the scene's initial state."""
        ...

    def step_once(self) -> None:
        """Advance one sample period while paused."""
        ...

    def set_state(self, bodies: dict[str, Placement], *, project: bool) -> None:
        """Set the state of bodies; project: onto the constraints first."""
        ...

    def leave(self) -> None:
        """End the node."""
        ...


# ~/advance (rb_sim_interfaces/Advance): takes wrenches, advances samples, returns state and
# reactions.
#
# Only while paused, so that time stands until the controller's next request. The wrenches of a
# request act from its first sample on; if one is refused, all are.


# The state of a sample as messages of rb_sim_interfaces, for the answers of services.
#
# Values are packed like those of the topics, so that both agree to the last bit.


class Answer(NamedTuple):
    """State of a sample as messages."""

    bodies: list[Any]
    """BodyState of each."""
    reactions: list[Any]
    """Reaction of each."""
    energy: float
    """kinetic plus potential [J]."""
    residual: float
    """largest constraint violation, relative."""


class StateMessages:
    """Builds the messages of one scene's samples; values are plain floats, unpacked at once.

    The message objects are reused, since an answer is sent before the next one is made.
    """

    def __init__(self, scene: Scene, layout: SampleLayout) -> None:
        from rb_sim_interfaces import msg  # type: ignore[import-not-found]

        self._bodies: list[Any] = [msg.BodyState(body=name) for name in layout.bodies]
        of_each = zip(layout.reactions, layout.reaction_bodies, strict=True)
        self._reactions: list[Any] = [
            msg.Reaction(constraint=name, body=body) for name, body in of_each
        ]
        self._places: list[tuple[Any, bool]] = []
        for one in self._bodies:
            self._places += [(one.pose.position, False), (one.pose.orientation, True)]
            self._places += [(one.twist.linear, False), (one.twist.angular, False)]
        for one in self._reactions:
            vectors = one.anchor, one.wrench.force, one.wrench.torque
            self._places += [(vector, False) for vector in vectors]
        """target of each vector, in the order of the values, and whether it has a w component."""
        size = sum(3 + turns for _, turns in self._places) + 2
        numbers = Topic("", "", Layout().doubles(size).codec(), _numbers(layout))
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


def _numbers(layout: SampleLayout) -> list[int]:
    """Source columns of all values of an answer, in the order of its vectors."""
    of = columns_of(layout)
    moving = np.hstack([of.position, of.orientation, of.velocity, of.spin])
    acting = np.hstack([of.anchor, of.reaction_force, of.reaction_torque])
    return [*moving.ravel(), *acting.ravel(), *of.energy, *of.residual]


GIVEN_TWICE = "given twice"


class Lockstep:
    """Serves ~/advance. loop: the node's."""

    def __init__(
        self,
        node: Node,
        loop: Loop,
        simulation: Simulation,
        stepper: Stepper,
    ) -> None:
        from rb_sim_interfaces import msg  # type: ignore[import-not-found]
        from rb_sim_interfaces.srv import Advance  # type: ignore[import-not-found]

        self._msg = msg
        self._loop, self._simulation = loop, simulation
        self._commands, self._stepper = loop.commands, stepper
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
        """Apply the wrenches; returns the reason if they are refused, else ""."""
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
        """Fill in state, reactions and events of the last sample."""
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
            one.impulse.x, one.impulse.y, one.impulse.z = event.impulse
            answer.events.append(one)


def _vector(of: Any) -> Vector:
    return (of.x, of.y, of.z)


# ~/reset and ~/step (std_srvs/Trigger), ~/pause (std_srvs/SetBool).
#
# They exist from the start: during compilation ~/pause sets how the node starts, and the other two
# are refused. A request checks in its own turn whether there is a loop, so that the loop cannot
# change before it is answered.


COMPILING = "refused: still compiling, or not configured (wait for ~/state paused or running)"
INACTIVE = "refused: the node is inactive (ros2 lifecycle set NODE activate)"


class Services:
    """Serves the three services; answers are sent after the action.

    paused: whether the node is to start paused.
    """

    def __init__(self, node: Node, *, paused: bool) -> None:
        self.turns = Turns()
        """lock shared by requests and the thread that prepares, runs and ends the loop."""
        self.paused = paused
        """how the node is to start, as last requested."""
        self._loop: Loop | None = None
        serve(node, Trigger, "~/reset", self._reset)
        serve(node, SetBool, "~/pause", self._pause)
        serve(node, Trigger, "~/step", self._step)

    def serve(self, loop: Loop | None) -> None:
        """Let the services act on this loop from here on; None: on no loop, as at first.

        To be called in a turn, after the loop has published its initial state.
        """
        self._loop = loop

    def _answered(self, answer: Any, act: Callable[[], str]) -> Any:
        """Call `act` in a turn and answer with its message, or with the reason of refusal."""
        with self.turns:
            try:
                answer.message, answer.success = act(), True
            except RbSimError as error:
                answer.message = str(error)
        return answer

    def _there(self) -> Loop:
        """The loop. Raises RbSimError if there is none yet."""
        if self._loop is None:
            raise RbSimError(COMPILING)
        return self._loop

    def _reset(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        def act() -> str:
            loop = self._there()
            loop.reset()
            return f"initial state at t = {loop.t:.9g} s, no wrench"

        return self._answered(answer, act)

    def _pause(self, request: SetBool.Request, answer: SetBool.Response) -> SetBool.Response:
        def act() -> str:
            how = "paused" if request.data else "running"
            if self._loop is None:
                self.paused = request.data
                return f"compiling; it will start {how}"
            self._loop.pause(request.data)
            return f"{how} at t = {self._loop.t:.9g} s"

        return self._answered(answer, act)

    def _step(self, _: Trigger.Request, answer: Trigger.Response) -> Trigger.Response:
        def act() -> str:
            loop = self._there()
            if loop.inactive:
                raise RbSimError(INACTIVE)
            if not loop.paused:
                raise RbSimError("refused: only while paused (call ~/pause with true first)")
            loop.step_once()
            return f"t = {loop.t:.9g} s"

        return self._answered(answer, act)


# ~/set_state (rb_sim_interfaces/SetState): sets the state of bodies, checked or projected.
#
# The state becomes the next sample, one period later, as after ~/reset; commands continue. Poses
# and twists are those of the body origins, all in world axes.


class SetStateService:
    """Serves ~/set_state. loop: the node's."""

    def __init__(self, node: Node, loop: Loop, simulation: Simulation, stepper: Stepper) -> None:
        from rb_sim_interfaces.srv import SetState  # type: ignore[import-not-found]

        self._loop, self._stepper = loop, stepper
        self._state = StateMessages(simulation.scene, simulation.layout)
        serve(node, SetState, "~/set_state", self._set)

    def _set(self, request: Any, answer: Any) -> Any:
        with self._loop.turns:
            if self._loop.failure:
                answer.message = f"{self._loop.failure}; ~/reset goes first"
                return answer
            try:
                bodies = {one.body: _placement(one) for one in request.bodies}
                if len(bodies) < len(request.bodies):
                    raise RbSimError("bodies: one is given twice")
                self._loop.set_state(bodies, project=request.project)
            except RbSimError as error:
                answer.message = str(error)
                return answer
            answer.success = True
            answer.message = f"set at t = {self._stepper.t:.9g} s"
            answer.stamp = Time(nanoseconds=round(self._stepper.t * 1e9)).to_msg()
            row = self._stepper.last_row
            assert row is not None  # it has just been emitted
            answer.bodies = self._state.of(row).bodies
        return answer


def _placement(one: Any) -> Placement:
    """A BodyState as placement (angular velocity in body axes). Raises RbSimError if invalid."""
    pose, twist = one.pose, one.twist
    q = np.array([getattr(pose.orientation, name) for name in "xyzw"])
    if not q.any():
        raise RbSimError(f"{one.body}.orientation: got (0, 0, 0, 0); must have length 1")
    return {
        "position": _numbers_of(pose.position),
        "orientation": q.tolist(),
        "linear_velocity": _numbers_of(twist.linear),
        "angular_velocity": rotate(conjugate(q), np.array(_numbers_of(twist.angular))).tolist(),
    }


def _numbers_of(of: Any) -> list[float]:
    return [of.x, of.y, of.z]


# Services of simulation_interfaces that this node supports, if that package is installed.
#
# Under the node's name: ~/get_simulator_features, ~/get_simulation_state, ~/set_simulation_state,
# ~/step_simulation, ~/reset_simulation. They do what ~/pause, ~/step and ~/reset do; simulated time
# never goes back. STOPPED is paused at the initial state; QUITTING ends the node.


PACKAGE = "simulation_interfaces"
FEATURES = (
    "SIMULATION_RESET",
    "SIMULATION_RESET_STATE",
    "SIMULATION_STATE_GETTING",
    "SIMULATION_STATE_SETTING",
    "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE",
    "STEP_SIMULATION_MULTIPLE",
)
TIME_GOES_ON = "simulated time goes on"


class SimulationServices:
    """Serves simulation_interfaces. may_quit: whether a request may end the node."""

    def __init__(self, node: Node, loop: Loop, *, may_quit: bool) -> None:
        from simulation_interfaces import msg, srv  # type: ignore[import-not-found]

        self._loop, self._may_quit = loop, may_quit
        self._result, self._states = msg.Result, msg.SimulationState
        self._features, self._srv = msg.SimulatorFeatures, srv
        self._stopped_at = -1.0
        """stamp of the initial state after STOPPED [s]."""
        for name, act in (
            ("GetSimulatorFeatures", self._tell_features),
            ("GetSimulationState", self._tell_state),
            ("SetSimulationState", self._set_state),
            ("StepSimulation", self._step),
            ("ResetSimulation", self._reset),
        ):
            topic = "".join(f"_{c.lower()}" if c.isupper() else c for c in name).lstrip("_")
            serve(node, getattr(srv, name), f"~/{topic}", act)

    @property
    def _state(self) -> int:
        """State constant of simulation_interfaces; paused if time stands for any reason."""
        loop, states = self._loop, self._states
        if not (loop.paused or loop.inactive or loop.failure):
            return states.STATE_PLAYING
        return states.STATE_STOPPED if loop.t == self._stopped_at else states.STATE_PAUSED

    def _tell_features(self, _: Any, answer: Any) -> Any:
        answer.features.features = [getattr(self._features, name) for name in FEATURES]
        answer.features.custom_info = TIME_GOES_ON
        return answer

    def _tell_state(self, _: Any, answer: Any) -> Any:
        with self._loop.turns:
            answer.state.state = self._state
            return self._answered(answer, self._result.RESULT_OK, self._loop.failure)

    def _set_state(self, request: Any, answer: Any) -> Any:
        target = request.state.state
        with self._loop.turns:
            try:
                return self._answered(answer, *self._go_to(target))
            except RbSimError as error:
                return self._answered(answer, self._result.RESULT_INCORRECT_STATE, str(error))

    def _go_to(self, target: int) -> tuple[int, str]:
        """Change to a state; returns result code and reason."""
        loop, states, result = self._loop, self._states, self._result
        # if an error or the lifecycle stops time, it would continue afterwards unless paused too
        if target == self._state and (loop.paused or target != states.STATE_PAUSED):
            return self._srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE, ""
        if target == states.STATE_QUITTING and self._may_quit:
            loop.leave()
        elif target == states.STATE_PLAYING:
            if loop.failure or loop.inactive:
                return result.RESULT_INCORRECT_STATE, loop.failure or INACTIVE
            loop.pause(False)
        elif target == states.STATE_PAUSED:
            self._stopped_at = -1.0
            loop.pause(True)
        elif target == states.STATE_STOPPED:
            loop.pause(True)
            loop.reset()
            self._stopped_at = loop.t
        else:
            allowed = "must be stopped, playing or paused"
            return result.RESULT_FEATURE_UNSUPPORTED, f"got state {target}; {allowed}"
        return result.RESULT_OK, ""

    def _step(self, request: Any, answer: Any) -> Any:
        loop, result = self._loop, self._result
        with loop.turns:
            if loop.inactive or not loop.paused:
                why = INACTIVE if loop.inactive else "refused: only while paused"
                return self._answered(answer, result.RESULT_INCORRECT_STATE, why)
            for k in range(request.steps):
                try:
                    loop.step_once()
                except RbSimError as error:
                    why = f"{error} (after {k} of {request.steps} steps)"
                    return self._answered(answer, result.RESULT_OPERATION_FAILED, why)
            return self._answered(answer, result.RESULT_OK, "")

    def _reset(self, request: Any, answer: Any) -> Any:
        kind, result = type(request), self._result
        if request.scope and not request.scope & kind.SCOPE_STATE:
            why = "only the state can be reset"
            return self._answered(answer, result.RESULT_FEATURE_UNSUPPORTED, why)
        with self._loop.turns:
            try:
                self._loop.reset()
            except RbSimError as error:
                return self._answered(answer, result.RESULT_INCORRECT_STATE, str(error))
        return self._answered(answer, result.RESULT_OK, TIME_GOES_ON)

    @staticmethod
    def _answered(answer: Any, result: int, why: str) -> Any:
        answer.result.result, answer.result.error_message = result, why
        return answer


OWN = "rb_sim_interfaces"


def offer_services(
    node: Node, loop: Loop, simulation: Simulation, stepper: Stepper, *, may_quit: bool
) -> None:
    """Create ~/advance, ~/set_state and simulation_interfaces' services, if their types exist."""

    def own() -> None:
        Lockstep(node, loop, simulation, stepper)
        SetStateService(node, loop, simulation, stepper)

    def common() -> None:
        SimulationServices(node, loop, may_quit=may_quit)

    for package, offer in ((OWN, own), (PACKAGE, common)):
        if not is_there(package):
            continue
        try:
            offer()
        except Exception as error:
            node.get_logger().warning(f"no services of {package}: {unusable(package, error)}")
