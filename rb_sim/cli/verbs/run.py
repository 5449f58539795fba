# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim run`: integrate a scene, log it, and print a summary."""

from __future__ import annotations

import math
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import (
    RbSimError,
    SceneError,
    SceneWarning,
    SimulationError,
    StepTooLargeError,
    lines_of,
)
from rb_sim.cli.options import RunOptions
from rb_sim.simulation.signals import BrokenOffError, Interruption

if TYPE_CHECKING:
    from rb_sim.accuracy.checks.check import Effort
    from rb_sim.accuracy.checks.check_list import CheckList
    from rb_sim.cli.summary import Clocks
    from rb_sim.mechanics.samples import SampleBlock
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.outputs import Output
    from rb_sim.simulation.simulation import Simulation


# Options of a run, and the scene with these options applied.


def given(options: RunOptions) -> dict[str, Any]:
    """Values of the scene that command-line options override."""
    from rb_sim.scene.load import OVERRIDES

    values = {name: getattr(options, name) for name in OVERRIDES}
    return {name: value for name, value in values.items() if value is not None}


def splitting(options: RunOptions) -> dict[str, Any]:
    """Size [bytes] and duration [s] at which BagSink splits the bag. Raises RbSimError."""
    from rb_sim.io.bag.bag_sink import LEAST_SPLIT

    size, duration = options.split_size, options.split_duration
    if size is not None and size < LEAST_SPLIT:
        raise RbSimError(f"--split-size: got {size}; must be at least {LEAST_SPLIT} bytes")
    if duration is not None and not duration > 0.0:
        raise RbSimError(f"--split-duration: got {duration:g}; must be > 0 s")
    return {"split_size": size, "split_duration": duration}


def scene_of(options: RunOptions) -> Scene:
    """The scene with the options applied. Raises SceneError, RbSimError."""
    from rb_sim.cli.verbs.scenes import of_option, scene_to_run
    from rb_sim.io.bag.reader import with_values
    from rb_sim.scene import yaml_reader
    from rb_sim.scene.load import OVERRIDES, as_run_text, scene_from_mapping

    overrides = {name: getattr(options, name) for name in OVERRIDES}
    try:
        with warnings.catch_warnings():
            if options.change:  # the changed scene warns itself
                warnings.simplefilter("ignore", SceneWarning)
            scene = scene_to_run(options.scene, overrides)
        if not options.change:
            return scene
        data = with_values(yaml_reader.parse(as_run_text(scene), scene.file), options.change)
        with SceneError.after(options.change):
            return scene_from_mapping(data, name=scene.name, file=scene.file)
    except SceneError as error:
        raise of_option(error) from None


def check_accelerations(options: RunOptions, scene: Scene) -> None:
    """Refuse --accelerations without an output for them, or with time stepping. Raises
    RbSimError."""
    if not options.accelerations:
        return
    written = options.out is not None and not (options.no_plots and options.no_bag)
    if options.npz is None and not written:
        raise RbSimError("--accelerations: give --out DIR for bag and plots, or --npz FILE.npz")
    if scene.simulation.method == "time_stepping":
        raise RbSimError("--accelerations: method time_stepping has none; give another --method")


def check_npz(path: Path | None) -> None:
    """Refuse a file name that numpy would change; create the folder. Raises RbSimError."""
    if path is None:
        return
    if path.suffix != ".npz":
        raise RbSimError(f"--npz {path}: the name must end in .npz")
    try:
        path.absolute().parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RbSimError(f"--npz {path}: cannot make its folder: {error.strerror}") from None


# Progress bar of the simulated time in the terminal.


@contextmanager
def progress_bar(end: float, quiet: bool) -> Iterator[Callable[[float], None]]:
    """Progress bar on standard error, if that is a terminal; yields a function of the simulated
    time [s]."""
    if quiet or not sys.stderr.isatty():
        yield lambda t: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.completed:.4g} of {task.total:.4g} s"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, auto_refresh=False) as bar:
        task = bar.add_task("", total=end)

        def show(t: float) -> None:
            bar.update(task, completed=t)
            bar.refresh()

        yield show


FAILED = 1
"""Exit code for a failed simulation or an incomplete log."""

INACCURATE = 3
"""Exit code with --strict of a completed run that failed an accuracy check."""


def run(options: RunOptions) -> int:
    """Run a scene; returns the exit code: 0, 1 (FAILED), 3 (INACCURATE), 130 after SIGINT, 143
    after SIGTERM.

    Raises RbSimError for an invalid scene, option or output folder.
    """
    import numpy as np

    # a diverging run has samples near the largest double before it ends with an error
    with Interruption() as interruption, np.errstate(all="ignore"):
        return _Run(options, interruption).run()


class _Run:
    """State of one run, shared by its phases."""

    def __init__(self, options: RunOptions, interruption: Interruption) -> None:
        self.options, self.interruption = options, interruption
        self.outputs: dict[str, Output] = {}
        self.kept: list[SampleBlock] = []
        self.failure = ""
        self.advised = False
        """whether the failure message already suggests a step, or states that none passes."""

    def run(self) -> int:
        from rb_sim.accuracy.checks.check_list import CheckList
        from rb_sim.accuracy.checks.second_run import SecondRun
        from rb_sim.simulation.outputs import choose, refuse_logs
        from rb_sim.simulation.simulation import compiled

        options = self.options
        check_npz(options.npz)
        if options.max_wall is not None and not options.max_wall > 0.0:
            raise RbSimError(f"--max-wall: got {options.max_wall:g}; must be > 0 s")
        if options.out is not None and not options.overwrite:
            refuse_logs(options.out, "--out", "or use --overwrite")
        scene = scene_of(options)
        check_accelerations(options, scene)
        start = time.time_ns() if options.wall_stamps else 0
        split = splitting(options)
        outputs = choose(
            options.out,
            _say,
            bag=not options.no_bag,
            rerun=options.rerun,
            plots=not options.no_plots,
            accelerations=options.accelerations,
            start_ns=start,
            options=given(options),
            split=split,
        )
        simulation = compiled(scene, _quiet if options.quiet else _say)
        self.interruption.logging = True
        if outputs:
            self.interruption.left_over = lambda: "the logs are not finished; use rb_sim recover"
        self._open(outputs, simulation)
        check_list = CheckList(scene, simulation.layout, simulation.compiled)
        self.second = SecondRun(simulation)
        clocks = self._integrate(simulation, check_list)
        return self._finish(simulation, check_list, clocks)

    def _open(self, outputs: dict[str, Output], simulation: Simulation) -> None:
        """Open all outputs, or none. Raises SinkError."""
        for name, output in outputs.items():
            self.outputs[name] = output
            try:
                output.open(simulation.scene, simulation.layout)
            except RbSimError:
                for opened in self.outputs.values():
                    opened.close()
                raise

    def _integrate(self, simulation: Simulation, check_list: CheckList) -> Clocks:
        """Step, sample and log until the end, a signal or a failure; returns the times."""
        from rb_sim.accuracy.checks.check import effort_of
        from rb_sim.accuracy.checks.step_search import forecast_for
        from rb_sim.cli.summary import Clocks

        settings = simulation.scene.simulation
        watching = 0.0
        wall = math.inf if self.options.max_wall is None else self.options.max_wall
        forecast = forecast_for(
            simulation.scene, settings.duration, lambda line: _say(f"warning: {line}"), wall=wall
        )
        integrating, began = time.thread_time(), time.perf_counter()
        logging = 0.0
        with progress_bar(settings.duration, self.options.quiet) as show:

            def watch(t: float) -> bool:
                nonlocal watching
                entered = time.thread_time()
                show(t)
                watching += time.thread_time() - entered
                return self.interruption.cause is None and forecast.goes_on(t)

            try:
                for block in simulation.blocks(settings.duration, settings.rate, watch):
                    entered = time.thread_time()
                    self._log(block, check_list, partial(effort_of, simulation))
                    logging += time.thread_time() - entered
            except SimulationError as error:
                self.failure, self.advised = str(error), isinstance(error, StepTooLargeError)
        self.failure = self.failure or forecast.given_up
        integrating = time.thread_time() - integrating - logging - watching
        return Clocks(max(integrating, 0.0), time.perf_counter() - began)

    def _log(self, block: SampleBlock, check_list: CheckList, effort: Callable[[], Effort]) -> None:
        check_list.add(block, effort)
        self.second.add(block)
        for output in self.outputs.values():
            output.write(block)
        if self.options.npz is not None:
            self.kept.append(block)

    def _finish(self, simulation: Simulation, check_list: CheckList, clocks: Clocks) -> int:
        """Close the logs and print the summary; returns the exit code."""
        from rb_sim.accuracy.checks.step_search import quiet_step
        from rb_sim.cli.plain import facts, plain_console
        from rb_sim.cli.summary import lines, summarize

        outcome, cause = self.failure or "finished", self.interruption.cause
        if cause is not None:
            outcome = f"interrupted by {cause.name}"
        error = None
        if not self.failure and cause is None:
            error = self.second.result(self.options.check, self._look, check_list.singular)
            check_list.check(error, simulation, self.second.exchanged)
            check_list.advise(quiet_step(simulation, check_list.findings, self._undisturbed))
        summary = summarize(simulation, check_list, clocks, outcome, error, timed=cause is None)
        if self.options.certify and self.interruption.cause is None and simulated(summary):
            summary["certificate"] = self._certified(simulation)
        self._close(summary)
        summary["outputs"] = {name: output.as_dict() for name, output in self.outputs.items()}
        complete = self._write_files(simulation, summary)
        complete &= not any(output.failure for output in self.outputs.values())
        if not self.options.quiet:
            plain_console(highlight=False).print(facts(lines(summary)))
            self._say_what_is_written()
        return self._exit_code(check_list, complete)

    def _close(self, summary: dict[str, Any]) -> None:
        """Finish the logs; plots, which take seconds, are skipped after a signal."""
        for name, output in self.outputs.items():
            if name != "plots":
                output.close(summary)
                continue
            try:
                with self.interruption.dropping():
                    output.close(summary)
            except BrokenOffError:
                assert self.interruption.cause is not None
                output.leave_out(f"not drawn after {self.interruption.cause.name}")

    def _undisturbed(self) -> bool:
        """True if no signal was received."""
        return self.interruption.cause is None

    def _look(self) -> None:
        """Raise WatchEndedError if a signal was received."""
        from rb_sim.motion.motion import WatchEndedError

        if self.interruption.cause is not None:
            raise WatchEndedError

    def _certified(self, simulation: Simulation) -> dict[str, Any] | None:
        """The certificate of the run; None if a signal interrupted it."""
        from rb_sim.accuracy.certify import certify
        from rb_sim.motion.motion import WatchEndedError

        options, look = simulation.scene.simulation, self._look
        try:
            return certify(simulation.compiled, simulation.setting, options, look=look).as_dict()
        except WatchEndedError:
            return None

    def _exit_code(self, check_list: CheckList, complete: bool) -> int:
        """Print findings of the checks and the reason of an early end; returns the exit code."""
        where = f"; the samples up to then are in {self.options.out}" if self.options.out else ""
        found = check_list.findings
        for line in [each.seen for each in found] if self.advised else lines_of(found):
            _say(f"warning: {line}")
        if self.failure:
            _say(f"error: {self.failure}{where}")
            return FAILED
        if self.interruption.cause is not None:
            _say(f"interrupted at t = {check_list.ledger.end or 0.0:.6g} s{where}")
            return self.interruption.exit_code
        if not complete:
            return FAILED
        return INACCURATE if self.options.strict and check_list.findings else 0

    def _write_files(self, simulation: Simulation, summary: dict[str, Any]) -> bool:
        """Write summary.json and the .npz file; returns whether both succeeded."""
        from rb_sim.base.plain_data import write_json

        complete = True
        if self.options.out is not None:
            path = self.options.out / "summary.json"
            complete &= _write(path, lambda: write_json(summary, path))
        npz = self.options.npz
        if npz is not None:
            from rb_sim.mechanics.samples import concatenate
            from rb_sim.simulation.trajectory import Trajectory

            block = concatenate(self.kept, simulation.layout)
            run = Trajectory(block, simulation.layout, simulation.scene)
            also = self.options.accelerations
            complete &= _write(npz, lambda: run.to_npz(npz, accelerations=also))
        return complete

    def _say_what_is_written(self) -> None:
        paths = [output.path for output in self.outputs.values() if output.path.exists()]
        if self.options.out is not None:
            paths.append(self.options.out / "summary.json")
        if self.options.npz is not None:
            paths.append(self.options.npz)
        existing = [str(path) for path in paths if path.exists()]
        print(
            f"wrote {', '.join(existing)}"
            if existing
            else "wrote nothing; use --out DIR to keep a run"
        )
        for output in self.outputs.values():
            if output.left_out:
                how = "; draw it with rb_sim.Trajectory.from_bag(BAG).plot(FILE)"
                print(
                    f"{output.path.name}: {output.left_out}{how if 'bag' in self.outputs else ''}"
                )


def simulated(summary: dict[str, Any]) -> bool:
    """Whether the run advanced beyond its start."""
    return summary["simulated"] > 0.0


def _write(path: Path, write: Callable[[], None]) -> bool:
    """Write a file; returns whether it succeeded, else prints a warning."""
    try:
        write()
    except OSError as error:
        _say(f"warning: {path}: cannot be written: {error.strerror}")
        return False
    return True


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _quiet(line: str) -> None:
    """Print nothing."""
