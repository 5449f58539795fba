# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The process that writes a node's logs: `python -m rb_sim.ros.log_writer`, started by LogProcess.

Frames (`log_process.py`) arrive on standard input, answers go to standard output. When the input
ends, for any reason, the logs are finished: also if the node was killed. Signals are ignored, since
the node handles them. Existing logs are replaced only on request, and a folder is used by one node.
"""

from __future__ import annotations

import fcntl
import os
import select
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError
from rb_sim.ros.log_process import (
    RECORDING,
    Begin,
    Count,
    End,
    Finished,
    Notice,
    Opened,
    Plan,
    Rows,
    State,
    frame,
    take_frame,
)
from rb_sim.simulation.outputs import refuse_logs

if TYPE_CHECKING:
    from rb_sim.simulation.outputs import Output


TIME_FIELD = "{time}"
INSIST = f"put {TIME_FIELD} in its name, or use overwrite:=true"


def out_folder(out: str, *, overwrite: bool) -> Path:
    """The folder for the logs. Raises RbSimError if it contains logs that may not be replaced.

    {time} in its name becomes date and time; `own_folder` handles an existing folder of that name.
    """
    if TIME_FIELD in out:
        return Path(out.replace(TIME_FIELD, time.strftime("%Y_%m_%d-%H_%M_%S")))
    folder = Path(out)
    if not overwrite:
        refuse_logs(folder, "parameter out", INSIST)
    return folder


def own_folder(named: Path) -> Path:
    """Create the folder; if it exists, one with a number appended.

    Two nodes started in the same second get different folders, since creating one succeeds only
    once.
    """
    for k in range(1000):
        folder = named.with_name(f"{named.name}-{k + 1}") if k else named
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError:
            pass  # reported when a log cannot be started there
        return folder
    return named


def claim(folder: Path, *, overwrite: bool) -> None:
    """Lock the folder until this process ends.

    Raises RbSimError if another process uses it, or has written logs there meanwhile; not with
    `overwrite`. A folder that cannot be created or locked is reported when a log cannot be started
    there.
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


IDLE = 0.25
"""[s] without samples after which pending messages of the bag are written."""
NICENESS = 5
"""Lower priority than the simulation."""


class Writer:
    """Processes frames until the end, and answers."""

    def __init__(self, source: int, answers: int) -> None:
        self._source, self._answers = source, answers
        self._outputs: dict[str, Output] = {}
        self._written = 0
        self._reported: Count | None = None

    def run(self) -> None:
        """Write the samples; finish the logs at the end."""
        import numpy as np

        # a diverging run has samples near overflow before it ends with an error
        with np.errstate(all="ignore"):
            self._run()

    def _run(self) -> None:
        summary = None
        try:
            for message in self._messages():
                if isinstance(message, Begin):
                    self._open(message)
                elif isinstance(message, Rows):
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
        os.nice(NICENESS)  # only now, since the node waited for the answer

    def _chosen(self, plan: Plan) -> dict[str, Output]:
        """Outputs for bag, recording and plots, the slowest to finish last."""
        from rb_sim.io.bag.bag_sink import BagSink
        from rb_sim.io.rerun.rerun_sink import RerunSink
        from rb_sim.io.run_plots import PlotSink
        from rb_sim.simulation.outputs import Output
        from rb_sim.simulation.record import accelerating

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
            except MissingExtraError as error:  # Ubuntu 24.04 has no Rerun: write the others
                self._say(f"no {path}: {error}")
        return chosen

    def _keep(self) -> None:
        """Flush the bag while no frames arrive."""
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
        self._answer(Notice(line))

    def _answer(self, message: Any) -> None:
        try:
            os.write(self._answers, frame(message))  # short enough to be written at once
        except OSError:  # the node has ended; the logs are finished anyway
            if isinstance(message, Notice):  # e.g. about plots that the node did not wait for
                print(message.line, file=sys.stderr, flush=True)


def load_rerun() -> None:
    """Import the modules of a recording while the node compiles; pyarrow imports pandas too."""
    for name in ("rb_sim.io.rerun.view", "pandas"):
        with suppress(ImportError):  # reported when the recording is started
            import_module(name)


def main() -> None:
    """Entry point of the process."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGPIPE):
        signal.signal(number, signal.SIG_IGN)
    answers = os.dup(sys.stdout.fileno())
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # keeps prints out of the answers
    if RECORDING in sys.argv:
        load_rerun()
    Writer(sys.stdin.fileno(), answers).run()


if __name__ == "__main__":
    main()
