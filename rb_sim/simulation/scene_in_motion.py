# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A scene in motion: the compiled scene, its state, and what comes from outside while it moves."""

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
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.load import load_scene
from rb_sim.scene.place import at_its_size
from rb_sim.scene.schema import Scene
from rb_sim.simulation.state_override import Placement, compiled_at, present_states, read_placement
from rb_sim.trajectory.record import State
from rb_sim.trajectory.trajectory import Trajectory, method_text

if TYPE_CHECKING:
    from rb_sim.contact.grid_motion import LeftOpen


# Says that machine code is being made, which takes seconds, once for each simulation.


Announce = Callable[[str], None]


def tell(line: str) -> None:
    """To standard error."""
    print(f"rb_sim: {line}", file=sys.stderr, flush=True)


def compiling(name: str) -> str:
    """The line about a scene."""
    return f"compiling {name} (first use only; takes some seconds, later runs use the cache)"


class Announced:
    """A context in which compiling is announced when it is first entered; later it costs nothing.

    name: of the scene. announce: gets the line; None tells nobody.
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
            self._announce, self._entered = None, False  # what is called again is compiled
            self._stack.close()

    def _say(self) -> None:
        announce, self._announce = self._announce, None
        if announce is not None:
            announce(compiling(self._name))


# How a motion has been integrated so far: what its steps cost and what they had to leave.


class InSteps:
    """Counts of the steps of a motion since its start."""

    _motion: Motion

    @property
    def steps(self) -> int:
        """Steps taken since the start, those not needed for a sample included."""
        return self._motion.steps

    @property
    def rejected_steps(self) -> int:
        """Attempts that an adaptive method gave up since the start."""
        return self._motion.rejected_steps

    @property
    def cut_steps(self) -> int:
        """Of these the ones within the tolerance, which only went beyond the end of a piece of a
        spline."""
        return self._motion.cut_steps

    @property
    def unsolved_steps(self) -> tuple[int, float]:
        """Steps of time stepping whose friction problem was not solved within their bound of work,
        and the worst of their residuals, relative to the largest impulse; (0, 0.0) of others."""
        return self._motion.unsolved_steps, self._motion.solver_residual

    @property
    def solver_give(self) -> float:
        """How far time stepping let the law of a contact of a moving heap give way at most, as
        natural map relative to the largest impulse of its step: a heap that wedges itself has no
        solution nearer by.  Above 1e-2 the step counts as unsolved; 0.0 of other methods."""
        return self._motion.solver_give

    @property
    def circling_steps(self) -> int:
        """Steps of time stepping in which a contact point ran around its body, as of a disk that
        falls flat: they lose energy that shorter steps keep; 0 of other methods."""
        return self._motion.circling_steps

    @property
    def restruck_energy(self) -> float:
        """Energy lost by time stepping in spurious impacts of contacts that were closed [J]: an
        error, which a shorter step makes smaller; 0.0 of other methods."""
        return self._motion.restruck_energy

    @property
    def made_energy(self) -> float:
        """Energy gained in rigid contacts under time stepping, if a slip stops or reverses within a
        step [J]: an error, which a shorter step makes smaller; 0.0 of other methods."""
        return self._motion.made_energy

    @property
    def astray(self) -> tuple[float, float, str]:
        """The largest velocity that an impulse of time stepping gave in a direction which the
        normal had left by the end of its step, over the scene's speed; when [s], and which contact:
        what passes a round surface in few steps is sent off where a shorter step would not; 0.0 of
        other methods."""
        figure, t, c = self._motion.astray
        return figure, t, self._motion.layout.contacts[c] if figure > 0.0 else ""

    @property
    def paradox_steps(self) -> int:
        """Steps of time stepping in which a contact that slips has Painleve's paradox, so that
        several impulses fit its laws, or none; 0 of others."""
        return self._motion.paradox_steps

    @property
    def slipping_steps(self) -> int:
        """Steps of time stepping in which a perfectly rough contact slipped, since friction would
        have lifted it; 0 of others."""
        return self._motion.slipping_steps

    @property
    def left_open(self) -> LeftOpen | None:
        """The widest choice that the laws of contact left: how far two motions that both obey them
        are apart, when, and where; None of what has no contacts."""
        return self._motion.left_open

    @property
    def held_bodies(self) -> frozenset[str]:
        """Bodies whose errors are held to their own small motion, not to max(1, |y|)."""
        return self._motion.held


# Commands: the wrenches that bodies are commanded, held until the next one comes.


Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


class HeldWrench(NamedTuple):
    """What a body is commanded, about its origin: in world axes (W), or in its own (B)."""

    force_W: Vector
    """[N]."""
    torque_W: Vector
    """[N m]."""
    force_B: Vector
    torque_B: Vector

    @property
    def in_body(self) -> bool:
        """Whether it turns with the body."""
        return any(self.force_B) or any(self.torque_B)


NOTHING = HeldWrench(ZERO, ZERO, ZERO, ZERO)


class Commands:
    """What the bodies of a compiled scene are commanded; nothing at first."""

    def __init__(self, compiled: Compiled) -> None:
        self._effects = compiled.commands
        self._layout = compiled.layout
        self.clear()

    def clear(self) -> None:
        """Nothing is commanded any more."""
        self._held = dict.fromkeys(self._layout.commanded, NOTHING)
        self.any = False
        """whether one of them is not zero."""

    def read(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str
    ) -> HeldWrench:
        """A command in the axes of "world" or "body".

        Raises RbSimError for a body that takes no command, an unknown frame, a value not finite
        or beyond STRONGEST.
        """
        if body not in self._effects:
            allowed = ", ".join(self._held) or "none (no commanded_wrench effect)"
            raise RbSimError(f"body: got {body!r}; bodies that take a command: {allowed}")
        if frame not in ("world", "body"):
            raise RbSimError(f"frame: got {frame!r}; must be 'world' or 'body'")
        wrench = _vector("force", force), _vector("torque", torque)
        return (
            HeldWrench(*wrench, ZERO, ZERO) if frame == "world" else HeldWrench(ZERO, ZERO, *wrench)
        )

    def hold(self, body: str, held: HeldWrench) -> bool:
        """Command a body what `read` gave; whether that is another command than before."""
        if held == self._held[body]:
            return False
        self._held[body] = held
        self.any = any(values != NOTHING for values in self._held.values())
        return True

    def in_law(self, system: Any, effects: dict[str, tuple[int, ...]] | None = None) -> Any:
        """The system under these commands. effects: of each body, the indices of those that take
        its command; None: as in the compiled scene."""
        rows = list(system.effects)
        for body, indices in (self._effects if effects is None else effects).items():
            for i in indices:
                rows[i] = _with_command(rows[i], self._held[body])
        return system._replace(effects=tuple(rows))

    def applied(self, body: Array) -> Array:
        """Commanded wrenches in world axes, shape (n, M, 6), where the bodies are in `body`: poses
        and twists, shape (n, N, 13)."""
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
    """Raises RbSimError unless it is three numbers, none beyond STRONGEST."""
    try:
        x, y, z = np.asarray(value, dtype=float).tolist()
        if max(abs(x), abs(y), abs(z)) <= STRONGEST and not isnan(x + y + z):
            return x, y, z
    except (TypeError, ValueError):
        pass
    raise RbSimError(f"{name}: got {value!r}; must be 3 finite numbers, none beyond {STRONGEST:g}")


def _with_command(effect: Any, held: HeldWrench) -> Any:
    """The command row (or the placed one) with new held wrenches."""
    if isinstance(effect, Placed):
        return effect._replace(row=_with_command(effect.row, held))
    return effect._replace(**held._asdict())


def _turned(q: Array, a: Array) -> Array:
    """R(q) a for quaternions (n, 4) and one vector (3,)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)


MOST_INPUTS = 1 << 16
"""Commands and resets that are kept for the next sample."""


class SceneInMotion(InSteps):
    """A compiled scene with its state: what `Simulation` is between two runs.

    Arguments and errors are those of `Simulation`.
    """

    def __init__(
        self,
        scene: Scene | str | PathLike[str] | Mapping[str, Any],
        *,
        coordinates: str = "auto",
        announce: Announce | None = tell,
        family: Family | None = None,
    ) -> None:
        if coordinates not in ("auto", "maximal"):
            raise RbSimError(f"coordinates: got {coordinates!r}; must be 'auto' or 'maximal'")
        scene = scene if isinstance(scene, Scene) else load_scene(scene)
        self.scene = scene
        self._made_with: dict[str, Any] = {"coordinates": coordinates, "family": family}
        self._announced = Announced(scene.name, announce)
        self._tell = announce
        compiled = compile_scene(scene, coordinates=coordinates)
        self.compiled: Compiled = compiled if family is None else compiled.sharing(family)
        self.layout: SampleLayout = self.compiled.layout
        options = scene.simulation
        self.choice: Choice | None = None
        """why this method and setting, where the scene says `method: auto`."""
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
        """what runs have taken so far, compiling left out [s]."""
        self._start_anew()

    def __repr__(self) -> str:
        bodies = ", ".join(self.layout.bodies)
        return f"<Simulation of {self.scene.name}: {bodies}; t = {self.time:g} s; {self._how}>"

    @property
    def setting(self) -> Setting:
        """The method with the step or the tolerance that it works with."""
        if self.choice is not None:
            return self.choice.setting
        method = self.method
        step, tolerance = getattr(method, "step", None), getattr(method, "tolerance", None)
        return Setting(self.scene.simulation.method, step, tolerance)

    @property
    def _how(self) -> str:
        """Method and setting, in words."""
        if self.choice is None:
            return method_text(self.scene.simulation)
        return f"auto: {method_text(self.choice)}"

    def reset(self) -> None:
        """Back to the initial state at time 0; commands are zero again."""
        self._first.reset()
        self._start_anew()
        self._inputs.append(Input(0, 0.0, ""))

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool = False) -> None:
        """Set the state of bodies; time and commands go on, earlier events are dropped.

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
        """Another motion of the scene, with the states that were given to bodies of this one at the
        time [s] at which it stands; one in reduced coordinates goes on in maximal ones.

        Raises RbSimError where its other bodies cannot be with these states.
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
        """Go on with the motion that begins at the scene's initial state, as it was made or reset;
        what happened so far is forgotten."""
        self._motion = self._first
        self._events_taken = 0
        self._history.clear()
        self._commands.clear()

    @property
    def motion(self) -> Motion:
        """What is carried from instant to instant."""
        return self._motion

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._motion.time

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """Events of contacts since the start, by time; at least the last 100,000."""
        return in_order(self._motion.events)

    def take_events(self) -> tuple[ContactEvent, ...]:
        """The events since the last call; `run` and `blocks` put them into their blocks."""
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
        """State of all bodies at the present time."""
        return self.sample().state(0)

    def warm(self) -> None:
        """Compile everything that `advance` and `run` will call."""
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
            False if `watch` ended the integration: `state` is still that before the call.

        Raises:
            SimulationError: The integration cannot go on, or exceeds `limits`.
        """
        _check_duration(duration)
        return self._carried(np.array([self.time + duration]), watch, limits, None)

    def _carried(
        self, times: Array, watch: Watch | None, limits: Limits, out: Array | None
    ) -> bool:
        """Integrate to the times and sample there into the rows of `out`; False if the watch ended
        it."""
        motion = self._motion
        with self._announced:
            if watch is None and limits is NO_LIMITS:  # nobody to ask, and nothing to hold
                motion.run_to(times, out)
                return True
            duration = float(times[-1]) - motion.time
            watcher = Watcher(motion, watch, duration, limits, in_pieces=False)
            return watcher.carry(times, out)

    def step_row(
        self, duration: float, watch: Watch | None = None, limits: Limits = NO_LIMITS
    ) -> SampleRow | None:
        """`advance` over `duration` [s], then `sample_row`, in one call of the kernel.

        For loops that sample after every step, where the two calls cost more than the step. None
        where the watch ended it. Raises as `advance` does.
        """
        _check_duration(duration)
        rows = self.step_rows(np.array([self._motion.time + duration]), watch, limits)
        return rows[0] if rows else None

    def step_rows(
        self, times: Array, watch: Watch | None = None, limits: Limits = NO_LIMITS
    ) -> list[SampleRow]:
        """As `step_row` to each of the times [s], which increase; none where the watch ended it."""
        out = np.zeros((len(times), self._motion.width))
        if not self._carried(times, watch, limits, out):
            return []
        return list(map(SampleRow, times.tolist(), out, self._applied(out)))

    def keep(self) -> Any:
        """What `back_to` takes to come back to this instant, to the last bit; None: there is no way
        back, as with contacts. Not across a command, a reset or a state that is set."""
        return self._motion.keep()

    def back_to(self, kept: Any) -> None:
        """The motion as it was when this was kept."""
        self._motion.back_to(kept)

    def sample(self) -> Trajectory:
        """Sample all quantities at the present time: a trajectory of length 1."""
        with self._announced:
            row = self._motion.sample()
        return self._trajectory([self._block(np.array([self.time]), row)])

    def sample_row(self) -> SampleRow:
        """What `sample` has, at the present time, as the kernel leaves it: cheap to make."""
        with self._announced:
            out = self._motion.sample()
        return SampleRow(self.time, out[0], self._applied(out)[0])

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
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
        if self._commands.hold(body, held):  # one that is in force already changes no law
            self._change_law()

    def _note_input(self, given: Input) -> None:
        self._inputs.append(given)
        self._history.append(given)

    def _change_law(self) -> None:
        """Let the motion go on under the commands that are held."""
        self._motion.change_law(self._commands.in_law(self._motion.system))

    def _block(self, t: Array, out: Array) -> SampleBlock:
        """Rows of the kernel as a block, with the commands in force."""
        return block_of(t, out, self.layout, self._applied(out))

    def _applied(self, out: Array) -> Array:
        """The commands in force at rows of the kernel, in world axes, shape (n, M, 6)."""
        bodies = out[:, : 13 * len(self.layout.bodies)]
        return self._commands.applied(bodies.reshape(len(out), -1, 13))

    def _trajectory(
        self, blocks: Iterable[SampleBlock], findings: Sequence[Any] = (), error: Any = None
    ) -> Trajectory:
        block = concatenate(blocks, self.layout)
        return Trajectory(block, self.layout, self.scene, self._how, findings, error)


def _check_duration(duration: float) -> None:
    """Raises RbSimError."""
    if not (is_finite(duration) and duration >= 0.0):
        raise RbSimError(f"duration: got {duration!r}; must be a finite number >= 0 [s]")
