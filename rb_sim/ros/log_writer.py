# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The process that writes the logs of a node: `python -m rb_sim.ros.log_writer`, by LogProcess.

Frames (`log_frames.py`) come in on standard input and answers go out on standard output. Where the
input ends, for whatever reason, the logs are finished: also when the node was killed. Signals are
the node's to answer, so this process hears none.

What the node and the process of its logs tell each other: each a pickle behind its length.

Begin, then Rows and Blocks of samples and States, then End, to the process; Opened, Said, Count and
Finished back.

The folder that a node logs into: nothing in it is replaced unasked, and one node has it.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import select
import signal
import struct
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.mechanics.samples import block_of
from rb_sim.simulation.outputs import refuse_logs

if TYPE_CHECKING:
    from rb_sim.mechanics.samples import (
        Array,
        ContactEvent,
        Input,
        SampleBlock,
        SampleLayout,
        SampleRow,
    )
    from rb_sim.scene.schema import Scene
    from rb_sim.simulation.outputs import Output


LENGTH = struct.Struct("<Q")


class Plan(NamedTuple):
    """What is to be written."""

    folder: Path
    overwrite: bool
    """replace what is there."""
    namespace: str
    bag: bool
    recording: bool
    plots: bool
    start_ns: int
    run: dict[str, Any]
    """settings that the bag carries."""
    split: dict[str, float | None]
    """where the bag is split, as BagSink has it."""
    accelerations: bool = False
    """record BODY/accel."""
    odometry: bool = False
    """record BODY/odometry."""


class Begin(NamedTuple):
    """First frame."""

    plan: Plan
    scene: Scene
    layout: SampleLayout


class Rows(NamedTuple):
    """Samples as SampleRow has them, n of them in one piece."""

    t: Array
    """[s], shape (n,)."""
    rows: Array
    """shape (n, width)."""
    command: Array
    """shape (n, M, 6)."""
    events: tuple[ContactEvent, ...]
    inputs: tuple[Input, ...]

    def block(self, layout: SampleLayout) -> SampleBlock:
        """The samples by name."""
        block = block_of(self.t, self.rows, layout, self.command)
        return replace(block, events=self.events, inputs=self.inputs)


class Block(NamedTuple):
    """Samples by name already."""

    samples: SampleBlock

    def block(self, _: SampleLayout) -> SampleBlock:
        """The samples."""
        return self.samples


class State(NamedTuple):
    """State of the node from the samples so far on."""

    state: str


class End(NamedTuple):
    """Last frame."""

    summary: dict[str, Any] | None


class Opened(NamedTuple):
    """Answer to Begin; error: why a log cannot be begun, or ""."""

    error: str


class Said(NamedTuple):
    """A line for the user."""

    line: str


class Count(NamedTuple):
    """How the logs stand."""

    written: int
    """samples taken so far."""
    lost: dict[str, int]
    """samples that a log lost, by its name."""
    failures: dict[str, str]


class Finished(NamedTuple):
    """The log of this name is complete."""

    name: str


def rows_of(samples: Sequence[SampleRow]) -> Rows:
    """Samples in time order, in one piece."""
    return Rows(
        np.array([one.t for one in samples]),
        np.array([one.row for one in samples]),
        np.array([one.command for one in samples]),
        tuple(event for one in samples for event in one.events),
        tuple(g._replace(index=k) for k, one in enumerate(samples) for g in one.inputs),
    )


def frame(message: Any) -> bytes:
    """A message as it goes over the pipe."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(data)) + data


def take_frame(buffer: bytearray) -> Any:
    """The first message in the buffer, taken off it; None if it is not whole."""
    if len(buffer) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack_from(buffer)
    end = LENGTH.size + length
    if len(buffer) < end:
        return None
    message = pickle.loads(bytes(buffer[LENGTH.size : end]))
    del buffer[:end]
    return message


IDLE = 0.25
"""[s] without samples after which what waits in the bag is looked after."""
NICENESS = 5
"""The simulation goes first where both want the processor."""
RECORDING = "--recording"
"""Argument of the process that is to record for Rerun."""


class Writer:
    """Takes frames until the end, and answers."""

    def __init__(self, source: int, answers: int) -> None:
        self._source, self._answers = source, answers
        self._outputs: dict[str, Output] = {}
        self._written = 0
        self._reported: Count | None = None

    def run(self) -> None:
        """Write what comes; finish the logs."""
        import numpy as np

        # a run that blows up has samples near the largest number before it ends with an error
        with np.errstate(all="ignore"):
            self._run()

    def _run(self) -> None:
        summary = None
        try:
            for message in self._messages():
                if isinstance(message, Begin):
                    self._open(message)
                elif isinstance(message, (Rows, Block)):
                    block = message.block(self._layout)
                    for output in self._outputs.values():
                        output.write(block)
                    self._written += len(block)
                    self._count()
                elif isinstance(message, State):
                    if "bag" in self._outputs:
                        self._outputs["bag"].note_state(message.state)
                elif isinstance(message, End):
                    summary = message.summary
                    break
        finally:
            for name, output in self._outputs.items():
                output.close(summary)
                self._count()
                self._answer(Finished(name))

    def _messages(self) -> Iterator[Any]:
        buffer = bytearray()
        while True:
            message = take_frame(buffer)
            if message is not None:
                yield message
                continue
            if not select.select([self._source], [], [], IDLE)[0]:
                self._keep()
                continue
            data = os.read(self._source, 1 << 20)
            if not data:
                return
            buffer += data

    def _open(self, begin: Begin) -> None:
        self._layout = begin.layout
        error = ""
        try:
            claim(begin.plan.folder, overwrite=begin.plan.overwrite)
            self._outputs = self._chosen(begin.plan)
            for output in self._outputs.values():
                output.open(begin.scene, begin.layout)
        except (OSError, RbSimError) as failed:
            error = str(failed)
        self._answer(Opened(error))
        os.nice(NICENESS)  # not before: the node waits for that answer

    def _chosen(self, plan: Plan) -> dict[str, Output]:
        """Bag, recording and plots, the slowest to finish last."""
        from rb_sim.io.bag.sink import BagSink
        from rb_sim.io.rerun.sink import RerunSink
        from rb_sim.io.run_plots import PlotSink
        from rb_sim.simulation.outputs import Output
        from rb_sim.trajectory.record import accelerating

        def bag(path: Path) -> BagSink:
            asked = accelerating if plan.accelerations else None
            own: dict[str, Any] = {"start_ns": plan.start_ns, "run": plan.run, **plan.split}
            own |= {"accelerations": asked, "odometry": plan.odometry}
            return BagSink(path, namespace=plan.namespace, **own)

        chosen: dict[str, Output] = {}
        for wanted, name, sink in (
            (plan.bag, "bag", bag),
            (plan.recording, "recording.rrd", RerunSink),
            (plan.plots, "plots.png", PlotSink),
        ):
            path = plan.folder / name
            try:
                if wanted:
                    chosen[name] = Output(sink(path), path, self._say)
            except MissingExtraError as error:  # Ubuntu 24.04 has no Rerun: the rest goes on
                self._say(f"no {path}: {error}")
        return chosen

    def _keep(self) -> None:
        """While nothing comes: see that what came is safe."""
        from rb_sim.mechanics.samples import empty_block

        bag = self._outputs.get("bag")
        if bag is not None:
            bag.write(empty_block(0, self._layout))
            self._count()

    def _count(self) -> None:
        lost = {name: output.lost for name, output in self._outputs.items()}
        failures = {name: output.failure for name, output in self._outputs.items()}
        now = Count(self._written, lost, failures)
        if now != self._reported:
            self._reported = now
            self._answer(now)

    def _say(self, line: str) -> None:
        self._answer(Said(line))

    def _answer(self, message: Any) -> None:
        try:
            os.write(self._answers, frame(message))  # short enough to go in one piece
        except OSError:  # the node is gone; the logs are finished all the same
            if isinstance(message, Said):  # of plots that nobody waits for, say
                print(message.line, file=sys.stderr, flush=True)


def load_rerun() -> None:
    """Import what a recording takes while the node still compiles; pyarrow takes pandas, too."""
    for name in ("rb_sim.io.rerun.view", "pandas"):
        with suppress(ImportError):  # reported where the recording is begun
            import_module(name)


def main() -> None:
    """Entry point of the process."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    answers = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # nobody prints into the answers
    if RECORDING in sys.argv:
        load_rerun()
    Writer(sys.stdin.fileno(), answers).run()


if __name__ == "__main__":
    main()


TIME_FIELD = "{time}"
INSIST = f"put {TIME_FIELD} in its name, or use overwrite:=true"


def out_folder(out: str, *, overwrite: bool) -> Path:
    """The folder for the logs. RbSimError: there are some in it, and they are not to be replaced.

    {time} in its name becomes the date and time; see `own_folder` for where that exists, too.
    """
    if TIME_FIELD in out:
        return Path(out.replace(TIME_FIELD, time.strftime("%Y_%m_%d-%H_%M_%S")))
    folder = Path(out)
    if not overwrite:
        refuse_logs(folder, "parameter out", INSIST)
    return folder


def own_folder(named: Path) -> Path:
    """Make the folder; where it exists, one with a number behind its name. Two nodes that were
    started in the same second each get one: making a folder succeeds for one of them only.
    """
    for k in range(1000):
        folder = named.with_name(f"{named.name}-{k + 1}") if k else named
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError:
            pass  # reported by the log that cannot be begun there
        return folder
    return named


def claim(folder: Path, *, overwrite: bool) -> None:
    """Have the folder until this process ends. RbSimError: another process logs there, or has since
    it was chosen; with `overwrite` that does not matter.

    A folder that cannot be made, or locked, is reported by the log that cannot be begun there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        held = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        if not overwrite:
            raise SinkError(f"{folder}: another process is logging there") from None
    except OSError:
        pass
    if not overwrite:
        refuse_logs(folder, "parameter out", INSIST)
