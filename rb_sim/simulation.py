"""Simulation: owns the compiled scene and its state; the outer loop over blocks of samples."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import groupby
from os import PathLike
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rb_sim.accuracy.choice import Choice, Setting
from rb_sim.accuracy.remembered import remembered_choice
from rb_sim.announce import Announce, Announced, tell
from rb_sim.catalogue.types import Placed
from rb_sim.contact.events.motion import ContactMotion
from rb_sim.contact.motion import motion_of
from rb_sim.contact.stepping.motion import SteppedContacts
from rb_sim.engine.family import Family
from rb_sim.engine.samples import (
    Array,
    ContactEvent,
    Input,
    SampleBlock,
    SampleLayout,
    SampleRow,
    block_of,
    concatenate,
)
from rb_sim.errors import RbSimError, SimulationError, StepTooLargeError
from rb_sim.forecast import Forecast
from rb_sim.given import give
from rb_sim.instants import (
    SAME_INSTANT,
    instants_at_rate,
    instants_beside,
    instants_given,
    samples_at_rate,
)
from rb_sim.motion import Motion, nothing
from rb_sim.placing import Placement, compiled_at, present_states, read_placement
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.compiled import Compiled
from rb_sim.scene.load import load_scene
from rb_sim.scene.scales import at_its_size
from rb_sim.scene.schema import Scene
from rb_sim.sinks.sink import Sink
from rb_sim.step_advice import advice
from rb_sim.step_probe import Coarseness, StepProbe
from rb_sim.trajectory import State, Trajectory, method_text
from rb_sim.watch import NO_LIMITS, Limits, Watch, WatchEndedError, Watcher

if TYPE_CHECKING:
    from rb_sim.linear import LinearModel

BLOCK = 1024
"""Samples per block: the sinks' unit of work."""

MOST_INPUTS = 1 << 16
"""Commands and resets that are kept for the next sample."""

Progress = Callable[[float, float], None]


class Simulation:
    """A scene in motion.

    scene: as loaded, or anything that `load_scene` takes; its `simulation` section gives method,
        step or tolerance.
    coordinates: "auto", or "maximal" to force the general formulation.
    announce: told in one line where machine code has to be made, which takes seconds; None: nobody.
    family: the laws that scenes which differ only in numbers share; None: this one has its own.
    Raises SceneError if the scene cannot be simulated.
    """

    def __init__(
        self,
        scene: Scene | str | PathLike[str] | Mapping[str, Any],
        *,
        coordinates: str = "auto",
        announce: Announce | None = tell,
        family: Family | None = None,
    ) -> None:
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
        if self._motion.sized and self.choice is None:
            self.method = self._motion.method = compile_method(options, options.duration)
        self._general: Motion | None = None
        self._inputs: deque[Input] = deque(maxlen=MOST_INPUTS)
        self._history: deque[Input] = deque(maxlen=MOST_INPUTS)
        self._start()

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
        self._start()
        self._inputs.append(Input(0, 0.0, ""))

    def set_state(self, bodies: Mapping[str, Placement], *, project: bool = False) -> None:
        """Put bodies elsewhere; time and commands go on, events so far are forgotten.

        bodies: of each, `position` and `linear_velocity` of its origin (world), `orientation`
        [x, y, z, w], `angular_velocity` (body axes), as in a scene; what is left out stays.
        project: move the state onto the constraints. From here on, until a reset, one body with a
        joint moves in maximal coordinates, too.
        Raises RbSimError for an unknown body, numbers that cannot be, a state off the constraints.
        """
        unknown = [name for name in bodies if name not in self.layout.bodies]
        if unknown or not bodies:
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
        if self._commanded_now:
            self._change_law()
        for name in bodies:
            state = tuple(states[name].tolist())
            given = Input(0, time, name, state=state, together=len(bodies), project=project)
            self._note_input(given)

    def _start(self) -> None:
        self._motion = self._first
        self._motion.reset()
        self._probe: StepProbe | None = None
        self._events_taken = 0
        self._history.clear()
        self._commands = {name: np.zeros((2, 6)) for name in self.layout.commanded}
        self._commanded_now = False

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._motion.time

    @property
    def steps(self) -> int:
        """Steps taken since the start, those not needed for a sample included."""
        return self._motion.steps

    @property
    def rejected_steps(self) -> int:
        """Attempts that an adaptive method gave up since the start."""
        return self._motion.rejected_steps

    @property
    def unsolved_steps(self) -> tuple[int, float]:
        """Steps of time stepping whose friction problem was not solved within their bound of work,
        and the worst of their residuals, relative to the largest impulse; (0, 0.0) of others."""
        motion = self._motion
        if not isinstance(motion, SteppedContacts):
            return 0, 0.0
        return motion.unsolved_steps, motion.solver_residual

    @property
    def solver_give(self) -> float:
        """How far time stepping let the law of a contact of a moving heap give way at most, as
        natural map relative to the largest impulse of its step: a heap that wedges itself has no
        solution nearer by.  Above 1e-2 the step counts as unsolved; 0.0 of other methods."""
        motion = self._motion
        return motion.solver_give if isinstance(motion, SteppedContacts) else 0.0

    @property
    def turned_steps(self) -> int:
        """Steps of time stepping that were too long for a contact whose only point ran around its
        body while it bore, as that of a disk that comes to lie: energy is lost there that a shorter
        step keeps; 0 of others."""
        motion = self._motion
        return motion.turned_steps if isinstance(motion, SteppedContacts) else 0

    @property
    def paradox_steps(self) -> int:
        """Steps of time stepping in which a contact that slips has Painleve's paradox, so that
        several impulses fit its laws, or none; 0 of others."""
        motion = self._motion
        return motion.paradox_steps if isinstance(motion, SteppedContacts) else 0

    @property
    def coarseness(self) -> Coarseness:
        """How much of the motion a fixed step misses, from some steps taken beside the run now and
        then; nothing of an adaptive method, or where there are contacts."""
        if self._probe is None or self._probe.run is not self._motion:
            self._probe = StepProbe(self.scene, self._motion)
        return self._probe.look()

    @property
    def events(self) -> tuple[ContactEvent, ...]:
        """What happened to the contacts since the start (the last MOST_EVENTS at least)."""
        motion = self._motion
        return tuple(motion.events) if isinstance(motion, ContactMotion) else ()

    def take_events(self) -> tuple[ContactEvent, ...]:
        """The events since the last call; `run` and `blocks` put them into their blocks."""
        motion = self._motion
        if not isinstance(motion, ContactMotion):
            return ()
        new = motion.events[max(0, self._events_taken - motion.forgotten) :]
        self._events_taken = motion.forgotten + len(motion.events)
        return tuple(new)

    def take_inputs(self) -> tuple[Input, ...]:
        """Commands and resets since the last call (the last MOST_INPUTS); as `take_events`."""
        taken = tuple(self._inputs)
        self._inputs.clear()
        return taken

    @property
    def state(self) -> State:
        """The present state."""
        return self.sample().state(0)

    def warm(self) -> None:
        """Compile everything that `advance` and `run` will call."""
        with self._announced:
            self._motion.warm()

    def advance(
        self, duration: float, watch: Watch | None = None, limits: Limits = NO_LIMITS
    ) -> bool:
        """Integrate over `duration` [s] without sampling.

        watch: asked every 50 ms or so whether to go on; returns False where it said no: the state
        is then still that before, and a later call goes on from where this one has come to.
        Raises SimulationError if the integration cannot go on, or costs more than `limits`.
        """
        _check_duration(duration)
        return self._carried(np.array([self.time + duration]), watch, limits, None)

    def _carried(
        self, times: Array, watch: Watch | None, limits: Limits, out: Array | None
    ) -> bool:
        """Integrate to the times and sample there into the rows of `out`; False if the watch ended
        it."""
        motion = self._motion
        watcher = Watcher(motion, watch, float(times[-1]) - motion.time, limits)
        watcher.begin(times)
        motion.watch = watcher.look
        try:
            with self._announced:
                motion.run_to(times, out)
        except WatchEndedError:
            return False
        finally:
            motion.watch = nothing
        return True

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
        command = self._commanded(out[:, : 13 * len(self.layout.bodies)].reshape(len(out), -1, 13))
        return list(map(SampleRow, times.tolist(), out, command))

    def keep(self) -> Any:
        """What `back_to` takes to come back to this instant, to the last bit; None: there is no way
        back, as with contacts. Not across a command, a reset or a state that is set."""
        return self._motion.keep()

    def back_to(self, kept: Any) -> None:
        """The motion as it was when this was kept."""
        self._motion.back_to(kept)

    def sample(self) -> Trajectory:
        """A trajectory of one sample, at the present time."""
        with self._announced:
            row = self._motion.sample()
        return self._trajectory([self._block(np.array([self.time]), row)])

    def sample_row(self) -> SampleRow:
        """What `sample` has, at the present time, as the kernel leaves it: cheap to make."""
        with self._announced:
            out = self._motion.sample()
        return self._row(out)

    def _row(self, out: Array) -> SampleRow:
        """The kernel's row of the present time, shape (1, width), with the commands in force."""
        body = out[:, : 13 * len(self.layout.bodies)].reshape(1, -1, 13)
        return SampleRow(self._motion.time, out[0], self._commanded(body)[0])

    def _trajectory(self, blocks: Iterable[SampleBlock]) -> Trajectory:
        return Trajectory(concatenate(blocks, self.layout), self.layout, self.scene, self._how)

    def linearize(self, axes: str = "world", turning: float = 0.0) -> LinearModel:
        """The linear model of small deviations from the motion, about the present state.

        axes: of states, poses, twists and inputs, "world" or "body" (they turn with each body).
        turning: rate [rad/s] at which the world's axes turn about z, for a motion that is steady
        as seen from there (a disk that rolls in a circle).
        Raises RbSimError for other axes and for scenes with contacts, SimulationError where a law
        has no derivative.
        """
        from rb_sim.linear import linearize  # scipy loads when it is used

        if axes not in ("world", "body"):
            raise RbSimError(f"axes: got {axes!r}; must be 'world' or 'body'")
        if not math.isfinite(turning) or (turning and axes == "body"):
            raise RbSimError(f"turning: got {turning!r}; must be finite, and 0 for axes 'body'")
        if self.layout.contacts:
            raise RbSimError(
                "linearize: the scene has contacts, which open and slip; must have joints only "
                "(a body that rolls: constraint rolling)"
            )
        compiled = compile_scene(self.scene, coordinates="maximal")
        effects = list(compiled.system.effects)
        for body, indices in compiled.commands.items():
            for i in indices:
                effects[i] = with_command(effects[i], self._held_values(body))
        system = compiled.system._replace(effects=tuple(effects))
        block = self.sample().block
        columns = (
            block.position,
            block.orientation,
            block.linear_velocity,
            block.angular_velocity,
        )
        y = np.concatenate([column[0] for column in columns], axis=1).ravel()
        return linearize(
            system, self.layout, self.time, y, compiled.commands, cast(Any, axes), turning
        )

    def _held_values(self, body: str) -> tuple[Any, ...]:
        """The command of a body: force and torque in world axes, then in body axes."""
        world, own = self._commands[body].tolist()
        return tuple(map(tuple, (world[:3], world[3:], own[:3], own[3:])))

    def run(
        self,
        duration: float | None = None,
        rate: float | None = None,
        sinks: Iterable[Sink] = (),
        progress: Progress | None = None,
        *,
        at: Sequence[float] | Array | None = None,
        events: bool = False,
    ) -> Trajectory:
        """Integrate and sample at `rate` [Hz] for `duration` [s], both ends included.

        Defaults come from the scene.  Sinks are opened here and get every block; the caller closes
        them.
        at: sample at these instants [s] instead, increasing, from the present time on.
        events: also sample just before and just after each event of a contact (a few roundings of
            the time away), so that `Trajectory.at_events` has the states there. They are found by
            doing everything since the start once more, commands included.
        A run that will take more than ten minutes is told once, where `announce` says; one that
        would take more than a year is given up after some time.
        Raises SimulationError if the integration cannot go on, or is given up; the samples so far
        are then in the sinks.
        """
        if at is None:
            times = instants_at_rate(self.time, *self._span(duration, rate))
        elif duration is None and rate is None:
            times = instants_given(at, self.time)
        else:
            raise RbSimError("at: it gives the instants; must be without duration and rate")
        if events:
            times = self._with_events(times)
        end = float(times[-1])
        outlets = list(sinks)
        for sink in outlets:
            sink.open(self.scene, self.layout)
        blocks: list[SampleBlock] = []
        for block in self._blocks_at(times):
            blocks.append(block)
            for sink in outlets:
                sink.write(block)
            if progress is not None:
                progress(float(block.t[-1]), end)
        return self._trajectory(blocks)

    def _span(self, duration: float | None, rate: float | None) -> tuple[float, float]:
        """Duration and rate of a run, the scene's where None. Raises RbSimError."""
        options = self.scene.simulation
        duration = options.duration if duration is None else duration
        rate = options.rate if rate is None else rate
        for name, value in (("duration", duration), ("rate", rate)):
            if not (math.isfinite(value) and value > 0.0):
                raise RbSimError(f"{name}: got {value!r}; must be a finite number > 0")
        return duration, rate

    def _blocks_at(self, times: Array) -> Iterator[SampleBlock]:
        start, duration = self.time, float(times[-1]) - self.time
        forecast = Forecast(duration, self._tell)

        def goes_on(t: float) -> bool:
            return forecast.goes_on(t - start)

        watcher = Watcher(self._motion, goes_on, duration, in_pieces=False)
        for first in range(0, len(times), BLOCK):
            yield from self._sampled(times[first : first + BLOCK], watcher)
            if not goes_on(self.time):
                raise SimulationError(forecast.given_up)

    def _with_events(self, times: Array) -> Array:
        """The instants and those beside events, which a simulation like this one finds."""
        twin = self._twin()
        with suppress(SimulationError):  # the run that follows ends there, too, and says so
            twin._run_to(float(times[-1]))
        found = [event.t for event in twin.events if event.t > self.time]
        return np.union1d(times, instants_beside(found, self.time, float(times[-1])))

    def _twin(self) -> Simulation:
        """A simulation that has come to where this one is by itself: the steps are the same."""
        if len(self._history) == MOST_INPUTS:
            raise RbSimError(
                f"events=True: got {MOST_INPUTS} or more commands since the start; must be fewer "
                "(reset)"
            )
        twin = Simulation(self.scene, announce=None, **self._made_with)
        for t, inputs in groupby(self._history, lambda given: given.t):
            twin._run_to(t)
            give(twin, list(inputs))
        twin._run_to(self.time)
        return twin

    def _run_to(self, t: float) -> None:
        """Integrate up to the time t [s] without sampling; nothing where it is there already.

        Raises SimulationError if the integration cannot go on.
        """
        if t > self.time:
            with self._announced:
                self._motion.run_to([t])

    def blocks(
        self,
        duration: float,
        rate: float,
        watch: Watch | None = None,
        limits: Limits = NO_LIMITS,
    ) -> Iterator[SampleBlock]:
        """The samples of a run, block by block; memory does not grow with its length.

        watch: asked every 50 ms or so, inside a block too, whether to go on; where it returns
        False the run ends with the samples so far.
        Raises SimulationError as `run` does, after the block with the last samples before it; also
        where the way to the next sample costs more than `limits`.
        """
        start, end = self.time, self.time + duration
        count = samples_at_rate(duration, rate)
        watcher = Watcher(self._motion, watch, duration, limits)
        for first in range(0, count, BLOCK):
            index = np.arange(first, min(first + BLOCK, count))
            yield from self._sampled(np.minimum(start + index / rate, end), watcher)
            if watcher.stopped:
                return
        last = start + (count - 1) / rate
        if end - last > SAME_INSTANT / rate:
            yield from self._sampled(np.array([end]), watcher)

    def apply_wrench(
        self, body: str, force: Sequence[float], torque: Sequence[float], frame: str = "world"
    ) -> None:
        """Command a wrench about the body origin, held until the next call.

        frame: "world", or "body" for components that turn with the body.
        Raises RbSimError for a body that takes no command, an unknown frame, a value not finite.
        """
        if body not in self.compiled.commands:
            allowed = ", ".join(self.layout.commanded) or "none (no commanded_wrench effect)"
            raise RbSimError(f"body: got {body!r}; bodies that take a command: {allowed}")
        if frame not in ("world", "body"):
            raise RbSimError(f"frame: got {frame!r}; must be 'world' or 'body'")
        wrench = np.zeros(6)
        for name, value, part in (("force", force, slice(0, 3)), ("torque", torque, slice(3, 6))):
            try:
                vector = np.asarray(value, dtype=float)
            except (TypeError, ValueError):
                vector = np.zeros(0)
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise RbSimError(f"{name}: got {value!r}; must be 3 finite numbers")
            wrench[part] = vector
        held = np.zeros((2, 6))
        held[0 if frame == "world" else 1] = wrench
        self._hold(body, held)

    def _hold(self, body: str, held: Array) -> None:
        """Command [force, torque] in world and in body axes, shape (2, 6)."""
        if np.array_equal(held, self._commands[body]):
            return
        self._commands[body] = held
        self._commanded_now = any(values.any() for values in self._commands.values())
        world, own = held.tolist()
        frame, given = ("body", own) if any(own) else ("world", world)
        fx, fy, fz, tx, ty, tz = given
        self._note_input(Input(0, self.time, body, frame, (fx, fy, fz), (tx, ty, tz)))
        self._change_law()

    def _note_input(self, given: Input) -> None:
        self._inputs.append(given)
        self._history.append(given)

    def _change_law(self) -> None:
        """Let the motion go on under the commands that are held."""
        system = self._motion.system
        effects = list(system.effects)
        for body in self._commands:
            values = self._held_values(body)
            for i in self.compiled.commands[body]:
                effects[i] = with_command(effects[i], values)
        self._motion.change_law(system._replace(effects=tuple(effects)))

    @contextmanager
    def _watched_by(self, watcher: Watcher) -> Iterator[None]:
        """Inside the block the motion is looked after; it may end early, at the last sample."""
        self._motion.watch = watcher.look
        try:
            yield
        except WatchEndedError:
            pass
        finally:
            self._motion.watch = nothing

    def _sampled(self, times: Array, watcher: Watcher) -> Iterator[SampleBlock]:
        """Integrate to each of the times and sample there, as far as it goes."""
        out = np.zeros((len(times), self._motion.width))
        failure = None
        try:
            watcher.begin(times)
            with self._announced, self._watched_by(watcher):
                if watcher.in_pieces:
                    self._run_in_pieces(times, out, watcher)
                else:
                    self._motion.run_to(times, out)
        except SimulationError as error:
            failure = self._advised(error, float(times[-1]))
        reached = int(np.searchsorted(times, self.time, side="right"))
        if reached:
            block = self._block(times[:reached], out[:reached])
            yield replace(block, events=self.take_events(), inputs=self.take_inputs())
        if failure is not None:
            raise failure

    def _advised(self, error: SimulationError, end: float) -> SimulationError:
        """The error with a step that would do, where it is one about the step."""
        commanded = any(values.any() for values in self._commands.values())
        if not isinstance(error, StepTooLargeError) or commanded:  # commands are not repeated
            return error
        return StepTooLargeError(f"{error}; {advice(self.compiled, self.method, self.time, end)}")

    def _run_in_pieces(self, times: Array, out: Array, watcher: Watcher) -> None:
        """As run_to of the motion, but only as long as the watcher says; the steps are the same."""
        done = 0
        while done < len(times):
            target = watcher.end_of_piece(self.time)
            upto = int(np.searchsorted(times, target, side="right"))
            if upto > done:
                self._motion.run_to(times[done:upto], out[done:upto])
                done = upto
            else:
                self._motion.run_to([target])
            if not watcher.goes_on(self.time):
                break

    def _block(self, t: Array, out: Array) -> SampleBlock:
        """Rows of the kernel as a block, with the commands in force."""
        body = out[:, : 13 * len(self.layout.bodies)].reshape(len(t), -1, 13)
        return block_of(t, out, self.layout, self._commanded(body))

    def _commanded(self, body: Array) -> Array:
        """Commanded wrenches in world axes, shape (n, M, 6)."""
        command = np.zeros((len(body), len(self.layout.commanded), 6))
        if not self._commanded_now:
            return command
        for m, name in enumerate(self.layout.commanded):
            world, own = self._commands[name]
            command[:, m] = world
            if own.any():
                q = body[:, self.layout.bodies.index(name), 3:7]
                for k in (0, 3):
                    command[:, m, k : k + 3] += turned(q, own[k : k + 3])
        return command


def _check_duration(duration: float) -> None:
    """Raises RbSimError."""
    if not (math.isfinite(duration) and duration >= 0.0):
        raise RbSimError(f"duration: got {duration!r}; must be a finite number >= 0 [s]")


def with_command(effect: Any, values: tuple[Any, ...]) -> Any:
    """The command row (or the placed one) with new held wrenches."""
    if isinstance(effect, Placed):
        return effect._replace(row=with_command(effect.row, values))
    return effect._replace(
        force_W=values[0], torque_W=values[1], force_B=values[2], torque_B=values[3]
    )


def turned(q: Array, a: Array) -> Array:
    """R(q) a for quaternions (n, 4) and one vector (3,)."""
    u, w = q[:, :3], q[:, 3:]
    t = 2.0 * np.cross(u, a)
    return a + w * t + np.cross(u, t)
