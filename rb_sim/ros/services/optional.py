"""Services that take interface packages which not every installation has."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from rclpy.node import Node
from rclpy.time import Time

from rb_sim.base.errors import RbSimError
from rb_sim.numerics.rotations import conjugate, rotate
from rb_sim.ros.build_interfaces import is_there
from rb_sim.ros.services.lockstep import Advancing, Commands, Lockstep, StateMessages
from rb_sim.ros.services.services import INACTIVE
from rb_sim.ros.serving import Turns, serve

if TYPE_CHECKING:
    from rb_sim.ros.stepper import Stepper
    from rb_sim.simulation.simulation import Simulation
    from rb_sim.simulation.state_override import Placement


# ~/set_state (rb_sim_interfaces/SetState): bodies put elsewhere, checked or projected.
#
# The state is the next sample, one period on, as after ~/reset; commands go on. Poses and twists
# are those of the body origins in world axes, angular velocities too.


class Placing(Protocol):
    """What the service acts on."""

    failure: str
    turns: Turns

    def set_state(self, bodies: dict[str, Placement], *, project: bool) -> None:
        """Put bodies into new states; project: onto the constraints first."""
        ...


class SetStateService:
    """Serves ~/set_state. loop: the node's."""

    def __init__(self, node: Node, loop: Placing, simulation: Simulation, stepper: Stepper) -> None:
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
    """A BodyState as a placement: the angular velocity in body axes. RbSimError: it cannot be."""
    pose, twist = one.pose, one.twist
    q = np.array([getattr(pose.orientation, name) for name in "xyzw"])
    if not q.any():
        raise RbSimError(f"{one.body}.orientation: got (0, 0, 0, 0); must have length 1")
    return {
        "position": _vector(pose.position),
        "orientation": q.tolist(),
        "linear_velocity": _vector(twist.linear),
        "angular_velocity": rotate(conjugate(q), np.array(_vector(twist.angular))).tolist(),
    }


def _vector(of: Any) -> list[float]:
    return [of.x, of.y, of.z]


# The services of simulation_interfaces that this node can serve, where that package is installed.
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


class Steered(Protocol):
    """What the services act on."""

    paused: bool
    inactive: bool
    failure: str
    turns: Turns

    @property
    def t(self) -> float:
        """Simulated time [s]."""
        ...

    def pause(self, paused: bool) -> None:
        """Pause, or go on."""
        ...

    def reset(self) -> None:
        """Begin anew from the scene's initial state."""
        ...

    def step_once(self) -> None:
        """Take one sample period while paused."""
        ...

    def leave(self) -> None:
        """End the node."""
        ...


class SimulationServices:
    """Serves them. may_quit: whether the node may end by a request (a lifecycle node may not)."""

    def __init__(self, node: Node, loop: Steered, *, may_quit: bool) -> None:
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
        """As simulation_interfaces counts them: what stands, for whatever reason, is paused."""
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
        """Go to a state; the result, and why."""
        loop, states, result = self._loop, self._states, self._result
        # what an error or the lifecycle holds goes on afterwards, unless it is paused, too
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
            return result.RESULT_FEATURE_UNSUPPORTED, f"state {target} is none to go to here"
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


class Served(Placing, Steered, Advancing, Protocol):
    """What all optional services act on: the loop of the node."""

    @property
    def commands(self) -> Commands:
        """The commanded wrenches."""
        ...


def offer_services(
    node: Node, loop: Served, simulation: Simulation, stepper: Stepper, *, may_quit: bool
) -> None:
    """~/advance and ~/set_state, and those of simulation_interfaces, as far as there are types."""

    def own() -> None:
        Lockstep(node, loop, simulation, loop.commands, stepper)
        SetStateService(node, loop, simulation, stepper)

    def common() -> None:
        SimulationServices(node, loop, may_quit=may_quit)

    for package, offer in ((OWN, own), (PACKAGE, common)):
        if not is_there(package):
            continue
        try:
            offer()
        except Exception as error:  # what its compiled parts raise shares no base class
            words = " ".join(str(error).split()) or type(error).__name__
            node.get_logger().warning(
                f"no services of {package}: the package is there, but cannot be loaded: {words}"
            )
