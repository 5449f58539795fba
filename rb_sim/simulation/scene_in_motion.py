# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A scene in motion: the compiled scene, its state, commands and other inputs."""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from math import isnan
from os import PathLike
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accuracy.auto import remembered_choice
from rb_sim.accuracy.choice import Choice, Setting
from rb_sim.base.errors import RbSimError
from rb_sim.catalogue.spec import STRONGEST, Placed
from rb_sim.contact.choose_motion import motion_of
from rb_sim.mechanics.compiled import Compiled
from rb_sim.mechanics.inputs import Family
from rb_sim.mechanics.samples import (
    Array,
    ContactEvent,
    Input,
    SampleBlock,
    SampleLayout,
    SampleRow,
    block_of,
    concatenate,
    in_order,
)
from rb_sim.motion.motion import NO_LIMITS, Limits, Motion, Watch, Watcher, is_finite
from rb_sim.numerics.kernels import on_compilation
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import load_scene
from rb_sim.scene.place import at_its_size
from rb_sim.scene.schema import Scene
from rb_sim.simulation.record import State
from rb_sim.simulation.state_override import Placement, compiled_at, present_states, read_placement
from rb_sim.simulation.trajectory import Trajectory, method_text

if TYPE_CHECKING:
    from rb_sim.contact.grid_motion import LeftOpen


# Announcement of compilations, which take seconds, once per simulation.


Announce = Callable[[str], None]


def tell(line: str) -> None:
    """Print a line to standard error."""
    print(f"rb_sim: {line}", file=sys.stderr, flush=True)


def compiling(name: str) -> str:
    """The line that announces the compilation of a scene."""
    return f"compiling {name} (first use only; takes some seconds, later runs use the cache)"


class Announced:
    """Context that announces a compilation within it, only once.

    name: of the scene. announce: function that gets the line; None for no announcement.
    """

    def __init__(self, name: str, announce: Announce | None) -> None:
        self._name, self._announce = name, announce
        self._stack = ExitStack()
        self._entered = False

    def __enter__(self) -> None:
        if self._announce is not None:
            self._entered = True
            self._stack.enter_context(on_compilation(self._say))

    def __exit__(self, *_: Any) -> None:
        if self._entered:
            self._announce, self._entered = None, False  # a second call needs no compilation
            self._stack.close()

    def _say(self) -> None:
        announce, self._announce = self._announce, None
        if announce is not None:
            announce(compiling(self._name))


# Statistics of the integration so far: number of steps and their errors.


class InSteps:
    """Statistics of the steps of a motion since its start."""

    _motion: Motion

    @property
    def steps(self) -> int:
        """Number of steps since the start, including those beyond the last sample."""
        return self._motion.steps

    @property
    def rejected_steps(self) -> int:
        """Number of rejected attempts of an adaptive method since the start."""
        return self._motion.rejected_steps

    @property
    def cut_steps(self) -> int:
        """Number of rejected attempts within the tolerance, which only crossed the end of a spline
        piece."""
        return self._motion.cut_steps

    @property
    def unsolved_steps(self) -> tuple[int, float]:
        """(number of time-stepping steps with an unsolved friction problem, largest relative
        residual).

        The residual is relative to the largest impulse; (0, 0.0) for other methods.
        """
        return self._motion.unsolved_steps, self._motion.solver_residual

    @property
    def solver_give(self) -> float:
        """Largest violation of a contact law accepted by time stepping in a moving heap.

        Natural map relative to the largest impulse of its step: a jammed heap has no closer
        solution. Above 1e-2 the step counts as unsolved; 0.0 for other methods.
        """
        return self._motion.solver_give

    @property
    def circling_steps(self) -> int:
        """Number of time-stepping steps in which a contact point ran around its body, as under a
        disk that falls flat.

        They lose energy that shorter steps keep; 0 for other methods.
        """
        return self._motion.circling_steps

    @property
    def restruck_energy(self) -> float:
        """Energy lost by time stepping in spurious impacts of contacts that were already closed
        [J].

        An error that decreases with the step; 0.0 for other methods.
        """
        return self._motion.restruck_energy

    @property
    def made_energy(self) -> float:
        """Energy gained in rigid contacts under time stepping, if a slip stops or reverses within a
        step [J].

        An error that decreases with the step; 0.0 for other methods.
        """
        return self._motion.made_energy

    @property
    def astray(self) -> tuple[float, float, str]:
        """(speed, time [s], contact) of the largest velocity given along a normal that rotated
        within the step.

        Time stepping only; the speed is relative to the scene's. A body that passes a round surface
        in few steps is deflected where a shorter step would not deflect it. 0.0 for other methods.
        """
        figure, t, c = self._motion.astray
        return figure, t, self._motion.layout.contacts[c] if figure > 0.0 else ""

    @property
    def paradox_steps(self) -> int:
        """Number of time-stepping steps with Painleve's paradox in a slipping contact: several
        impulses satisfy its laws, or none; 0 for other methods."""
        return self._motion.paradox_steps

    @property
    def slipping_steps(self) -> int:
        """Number of time-stepping steps in which a perfectly rough contact slipped, since friction
        would have lifted it; 0 for other methods."""
        return self._motion.slipping_steps

    @property
    def left_open(self) -> LeftOpen | None:
        """Largest non-uniqueness of the contact laws so far: distance of two admissible motions,
        time and contact; None without contacts."""
        return self._motion.left_open

    @property
    def held_bodies(self) -> frozenset[str]:
        """Bodies whose errors are relative to their own small motion, not to max(1, |y|)."""
        return self._motion.held


# Commands: wrenches commanded on bodies, held until the next command.


Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


class HeldWrench(NamedTuple):
    """Commanded wrench on a body, about its origin: in world axes (W), or in body axes (B)."""

    force_W: Vector
    """force [N]."""
    torque_W: Vector
    """torque [N m]."""
    force_B: Vector
    torque_B: Vector

    @property
    def in_body(self) -> bool:
        """Whether the wrench turns with the body."""
        return any(self.force_B) or any(self.torque_B)


NOTHING = HeldWrench(ZERO, ZERO, ZERO, ZERO)


class Commands:
    """The commanded wrenches of the bodies of a compiled scene; initially zero."""

    def __init__(self, compiled: Compiled) -> None:
        self._effects = compiled.commands
        self._layout = compiled.layout
        self.clear()

    def clear(self) -> None:
        """Set all commands to zero."""
        self._held = dict.fromkeys(self._layout.commanded, NOTHING)
        self.any = False
        """whether any command is not zero."""

    def read(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str
    ) -> HeldWrench:
        """A command in the axes of "world" or "body".

        Raises RbSimError for a body that takes no command, an unknown frame, or a value that is not
        finite or exceeds STRONGEST.
        """
        if body not in self._effects:
            allowed = f": {', '.join(self._held)}" if self._held else ", and the scene has none"
            raise RbSimError(
                f"body: got {body!r}; must be a body with an effect commanded_wrench{allowed}"
            )
        if frame not in ("world", "body"):
            raise RbSimError(f"frame: got {frame!r}; must be 'world' or 'body'")
        wrench = _vector("force", force), _vector("torque", torque)
        return (
            HeldWrench(*wrench, ZERO, ZERO) if frame == "world" else HeldWrench(ZERO, ZERO, *wrench)
        )

    def hold(self, body: str, held: HeldWrench) -> bool:
        """Set the command of a body to a result of `read`; returns whether it has changed."""
        if held == self._held[body]:
            return False
        self._held[body] = held
        self.any = any(values != NOTHING for values in self._held.values())
        return True

    def in_law(self, system: Any, effects: dict[str, tuple[int, ...]] | None = None) -> Any:
        """The system under these commands.

        effects: indices of the command rows of each body; None: those of the compiled scene.
        """
        rows = list(system.effects)
        for body, indices in (self._effects if effects is None else effects).items():
            for i in indices:
                rows[i] = _with_command(rows[i], self._held[body])
        return system._replace(effects=tuple(rows))

    def applied(self, body: Array) -> Array:
        """Commanded wrenches in world axes, shape (n, M, 6), for poses and twists of all bodies,
        shape (n, N, 13)."""
        names = self._layout.commanded
        command = np.zeros((len(body), len(names), 6))
        if not self.any:
            return command
        for m, name in enumerate(names):
            held = self._held[name]
            command[:, m] = (*held.force_W, *held.torque_W)
            if held.in_body:
                q = body[:, self._layout.bodies.index(name), 3:7]
                for k, own in ((0, held.force_B), (3, held.torque_B)):
                    command[:, m, k : k + 3] += _turned(q, np.array(own))
        return command


def _vector(name: str, value: Sequence[float]) -> Vector:
    """Three numbers as a vector. Raises RbSimError if they are not finite or exceed STRONGEST."""
    try:
        x, y, z = np.asarray(value, dtype=float).tolist()
        if max(abs(x), abs(y), abs(z)) <= STRONGEST and not isnan(x + y + z):
            return x, y, z
    except (TypeError, ValueError):
        pass
    raise RbSimError(f"{name}: got {value!r}; must be 3 finite numbers, none beyond {STRONGEST:g}")


def _with_command(effect: Any, held: HeldWrench) -> Any:
    """The command row (or the placed one) with another wrench."""
    if isinstance(effect, Placed):
        return effect._replace(row=_with_command(effect.row, held))
    return effect._replace(**held._asdict())


def _turned(q: Array, a: Array) -> Array:
    """R(q) a for quaternions (n, 4) and one vector a (3,), shape (n, 3)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)


MOST_INPUTS = 1 << 16
"""Most commands and resets stored for the next sample."""


class SceneInMotion(InSteps):
    """A compiled scene with its state: the base of `Simulation`, without runs.

    Arguments and errors are those of `Simulation`.
    """

    def __init__(
        self,
        scene: Scene | str | PathLike[str] | Mapping[str, Any],
        *,
        coordinates: str = "auto",
        announce: Announce | None = tell,
        family: Family | None = None,
        **overrides: Any,
    ) -> None:
        if coordinates not in ("auto", "maximal"):
            raise RbSimError(f"coordinates: got {coordinates!r}; must be 'auto' or 'maximal'")
        if not isinstance(scene, Scene):
            scene = load_scene(scene, **overrides)
        elif overrides:
            given = ", ".join(f"{key}=..." for key in overrides)
            raise RbSimError(f"the scene is loaded already; give {given} to load_scene")
        self.scene = scene
        self._made_with: dict[str, Any] = {"coordinates": coordinates, "family": family}
        self._announced = Announced(scene.name, announce)
        self._tell = announce
        compiled = compile_scene(scene, coordinates=coordinates)
        self.compiled: Compiled = compiled if family is None else compiled.sharing(family)
        self.layout: SampleLayout = self.compiled.layout
        options = scene.simulation
        self.choice: Choice | None = None
        """reason for the chosen method and setting with `method: auto`; else None."""
        if options.method == "auto":
            with Announced(scene.name, announce):
                self.choice = remembered_choice(scene, self.compiled)
            self.method = self.choice.build(options.duration)
        else:
            self.method = compile_method(at_its_size(scene).simulation, options.duration)
        self._motion = self._first = motion_of(self.compiled, self.method)
        if self._motion.held and self.choice is None:
            self.method = self._motion.take(compile_method(options, options.duration))
            self._motion.reset()
        self._general: Motion | None = None
        self._inputs: deque[Input] = deque(maxlen=MOST_INPUTS)
        self._history: deque[Input] = deque(maxlen=MOST_INPUTS)
        self._commands = Commands(self.compiled)
        self.stepping_time = 0.0
        """wall-clock time of all runs so far, without compiling [s]."""
        self._start_anew()

    def __repr__(self) -> str:
        bodies = ", ".join(self.layout.bodies)
        return f"<Simulation of {self.scene.name}: {bodies}; t = {self.time:g} s; {self._how}>"

    @property
    def setting(self) -> Setting:
        """The method with its step or tolerance."""
        if self.choice is not None:
            return self.choice.setting
        method = self.method
        step, tolerance = getattr(method, "step", None), getattr(method, "tolerance", None)
        return Setting(self.scene.simulation.method, step, tolerance)

    @property
    def _how(self) -> str:
        """Method and setting as text."""
        if self.choice is None:
            return method_text(self.scene.simulation)
        return f"auto: {method_text(self.choice)}"

    def reset(self) -> None:
        """Back to the initial state at time 0; commands become zero."""
        self._first.reset()
        self._start_anew()
        self._inputs.append(Input(0, 0.0, ""))

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool = False) -> None:
        """Set the state of bodies; time and commands are kept, earlier events are dropped.

        From here until a reset one body with a joint moves in maximal coordinates, too.

        Args:
            bodies: Body -> its state with the keys of a scene: `position` [m] and
                `linear_velocity` [m/s] of the body origin (world axes), `orientation`
                [x, y, z, w], `angular_velocity` [rad/s] (body axes); missing keys keep their value.
            project: Move the state onto the constraints.

        Raises:
            RbSimError: Unknown body, invalid number, or a state that violates a constraint.
        """
        if (unknown := [name for name in bodies if name not in self.layout.bodies]) or not bodies:
            known = ", ".join(self.layout.bodies)
            raise RbSimError(f"bodies: got {unknown}; must be one or more of {known}")
        states = present_states(self.scene, self.layout, self.sample().block)
        for name, given in bodies.items():
            states[name] = read_placement(name, given, states[name])
        time = self.time
        compiled = compiled_at(self.scene, states, time, project=project)
        if self.compiled.reduced:
            if self._general is None:
                self._general = motion_of(compiled, self.method)
            self._motion = self._general
        self._motion.reset(compiled.y, time)
        self._events_taken = 0
        if self._commands.any:
            self._change_law()
        for name in bodies:
            state = tuple(states[name].tolist())
            given = Input(0, time, name, state=state, together=len(bodies), project=project)
            self._note_input(given)

    def moved(self, other: Motion, inputs: Sequence[Input]) -> Motion:
        """Another motion of the scene at its current time [s], with states that were set on bodies
        of this one.

        A motion in reduced coordinates continues in maximal ones. Raises RbSimError if its other
        bodies are not compatible with these states.
        """
        time, block = other.time, self._block(np.array([other.time]), other.sample())
        states = present_states(self.scene, self.layout, block)
        states |= {given.body: np.array(given.state) for given in inputs}
        compiled = compiled_at(self.scene, states, time, project=True)
        if other.compiled.reduced:
            compiled = replace(compiled, breakpoints=other.compiled.breakpoints)
            other = motion_of(compiled, other.method)
        other.reset(compiled.y, time)
        return other

    def _start_anew(self) -> None:
        """Return to the motion from the scene's initial state, and forget the past."""
        self._motion = self._first
        self._events_taken = 0
        self._history.clear()
        self._commands.clear()

    @property
    def motion(self) -> Motion:
        """The motion that is integrated."""
        return self._motion

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._motion.time

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """Contact events since the start, by time; at least the last 100,000."""
        return in_order(self._motion.events)

    def take_events(self) -> tuple[ContactEvent, ...]:
        """Contact events since the last call; `run` and `blocks` put them into their blocks."""
        motion = self._motion
        new = motion.events[max(0, self._events_taken - motion.forgotten) :]
        self._events_taken = motion.forgotten + len(motion.events)
        return in_order(new)

    def take_inputs(self) -> tuple[Input, ...]:
        """Commands and resets since the last call (the last MOST_INPUTS); as `take_events`."""
        taken = tuple(self._inputs)
        self._inputs.clear()
        return taken

    @property
    def state(self) -> State:
        """State of all bodies at the current time."""
        return self.sample().state(0)

    def warm(self) -> None:
        """Compile everything that `advance` and `run` call."""
        with self._announced:
            self._motion.warm()

    def advance(
        self, duration: float, watch: Watch | None = None, limits: Limits = NO_LIMITS
    ) -> bool:
        """Integrate over `duration` [s] without sampling.

        Args:
            duration: Simulated time to integrate over [s].
            watch: Called about every 50 ms; if it returns False the integration stops, and a later
                call continues from the time reached.
            limits: Largest number of steps and wall-clock time.

        Returns:
            False if `watch` ended the integration; `state` is then that before the call.

        Raises:
            SimulationError: The integration cannot go on, or exceeds `limits`.
        """
        _check_duration(duration)
        return self._carried(np.array([self.time + duration]), watch, limits, None)

    def _carried(
        self, times: Array, watch: Watch | None, limits: Limits, out: Array | None
    ) -> bool:
        """Integrate to the times and sample into the rows of `out`; False if the watch stopped
        it."""
        motion = self._motion
        with self._announced:
            if watch is None and limits is NO_LIMITS:  # fast path without a watch
                motion.run_to(times, out)
                return True
            duration = float(times[-1]) - motion.time
            watcher = Watcher(motion, watch, duration, limits, in_pieces=False)
            return watcher.carry(times, out)

    def step_rows(
        self, times: Array, watch: Watch | None = None, limits: Limits = NO_LIMITS
    ) -> list[SampleRow]:
        """Samples at increasing times [s] in one call of the kernel; empty if the watch stopped it.

        For loops that sample after every step, where two calls cost more than the step. Raises the
        errors of `advance`.
        """
        out = np.zeros((len(times), self._motion.width))
        if not self._carried(times, watch, limits, out):
            return []
        return list(map(SampleRow, times.tolist(), out, self._applied(out)))

    def keep(self) -> Any:
        """State for `back_to`, exact to the last bit; None if that is not supported, as with
        contacts.

        Not valid across a command, a reset or a state that is set.
        """
        return self._motion.keep()

    def back_to(self, kept: Any) -> None:
        """Restore a state from `keep`."""
        self._motion.back_to(kept)

    def sample(self) -> Trajectory:
        """Sample all quantities at the present time: a trajectory of length 1."""
        with self._announced:
            row = self._motion.sample()
        return self._trajectory([self._block(np.array([self.time]), row)])

    def sample_row(self) -> SampleRow:
        """The sample at the current time as a row of the kernel, which is cheap."""
        with self._announced:
            out = self._motion.sample()
        return SampleRow(self.time, out[0], self._applied(out)[0])

    def apply_wrench(
        self,
        body: str,
        force: Sequence[float] = (0.0, 0.0, 0.0),
        torque: Sequence[float] = (0.0, 0.0, 0.0),
        frame: str = "world",
    ) -> None:
        """Command a wrench on a body, held until the next call for that body or a reset.

        Args:
            body: Body with a `commanded_wrench` effect.
            force: Force at the body origin [N], 3 numbers.
            torque: Torque about the body origin [N m], 3 numbers.
            frame: "world", or "body" for components that turn with the body.

        Raises:
            RbSimError: The body takes no command, the frame is unknown, or a value is not finite.
        """
        held = self._commands.read(body, force, torque, frame)
        frame, wrench = ("body", held[2:]) if held.in_body else ("world", held[:2])
        self._note_input(Input(0, self.time, body, frame, *wrench))
        if self._commands.hold(body, held):  # an unchanged command changes no law
            self._change_law()

    def _note_input(self, given: Input) -> None:
        self._inputs.append(given)
        self._history.append(given)

    def _change_law(self) -> None:
        """Continue the motion under the current commands."""
        self._motion.change_law(self._commands.in_law(self._motion.system))

    def _block(self, t: Array, out: Array) -> SampleBlock:
        """Rows of the kernel as a block, with the current commands."""
        return block_of(t, out, self.layout, self._applied(out))

    def _applied(self, out: Array) -> Array:
        """The current commands for rows of the kernel, in world axes, shape (n, M, 6)."""
        bodies = out[:, : 13 * len(self.layout.bodies)]
        return self._commands.applied(bodies.reshape(len(out), -1, 13))

    def _trajectory(
        self, blocks: Iterable[SampleBlock], findings: Sequence[Any] = (), error: Any = None
    ) -> Trajectory:
        block = concatenate(blocks, self.layout)
        return Trajectory(block, self.layout, self.scene, self._how, findings, error)


def _check_duration(duration: float) -> None:
    """Raise RbSimError for an invalid duration."""
    if not (is_finite(duration) and duration >= 0.0):
        raise RbSimError(f"duration: got {duration!r}; must be a finite number >= 0 [s]")
