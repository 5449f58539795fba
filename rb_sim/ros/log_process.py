# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A node's logs, seen from its loop: a bounded queue to the process that writes them.

The loop never waits for a disk: it sends samples in batches through a pipe. Data that the pipe does
not accept at once are queued here; if more than `depth` samples are queued, a simulation paced by
the wall clock drops and counts the newest, any other waits.

The protocol consists of frames, a length and a pickle: Begin, then Rows of samples and
States, then End, to the process; Opened, Notice, Count and Finished back.
"""

from __future__ import annotations

import fcntl
import os
import pickle
import select
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import SinkError
from rb_sim.mechanics.samples import block_of

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


LENGTH = struct.Struct("<Q")

RECORDING = "--recording"
"""Argument of the process if it also records for Rerun."""


class Plan(NamedTuple):
    """The logs to write."""

    folder: Path
    overwrite: bool
    """replace existing logs."""
    namespace: str
    bag: bool
    recording: bool
    plots: bool
    start_ns: int
    run: dict[str, Any]
    """settings stored in the bag."""
    split: dict[str, float | None]
    """limits at which the bag is split, as in BagSink."""
    accelerations: bool = False
    """record BODY/accel."""
    odometry: bool = False
    """record BODY/odometry."""


class Begin(NamedTuple):
    """First frame: plan, scene and layout."""

    plan: Plan
    scene: Scene
    layout: SampleLayout


class Rows(NamedTuple):
    """n samples, the arrays of SampleRow stacked."""

    t: Array
    """[s], shape (n,)."""
    rows: Array
    """shape (n, width)."""
    command: Array
    """shape (n, M, 6)."""
    events: tuple[ContactEvent, ...]
    inputs: tuple[Input, ...]

    def block(self, layout: SampleLayout) -> SampleBlock:
        """The samples as a block."""
        block = block_of(self.t, self.rows, layout, self.command)
        return replace(block, events=self.events, inputs=self.inputs)


class State(NamedTuple):
    """State of the node from the present sample on."""

    state: str


class End(NamedTuple):
    """Last frame."""

    summary: dict[str, Any] | None


class Opened(NamedTuple):
    """Answer to Begin; error: why a log cannot be started, or ""."""

    error: str


class Notice(NamedTuple):
    """A line for the user."""

    line: str


class Count(NamedTuple):
    """State of the logs."""

    written: int
    """number of samples processed so far."""
    lost: dict[str, int]
    """number of samples lost by each log."""
    failures: dict[str, str]


class Finished(NamedTuple):
    """The log of this name is complete."""

    name: str


def rows_of(samples: Sequence[SampleRow]) -> Rows:
    """Samples in order of time, stacked."""
    return Rows(
        np.array([one.t for one in samples]),
        np.array([one.row for one in samples]),
        np.array([one.command for one in samples]),
        tuple(event for one in samples for event in one.events),
        tuple(g._replace(index=k) for k, one in enumerate(samples) for g in one.inputs),
    )


def frame(message: Any) -> bytes:
    """A message encoded for the pipe."""
    data = pickle.dumps(message, protocol=pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(data)) + data


def take_frame(buffer: bytearray) -> Any:
    """Remove and decode the first message in the buffer; None if it is incomplete."""
    if len(buffer) < LENGTH.size:
        return None
    (length,) = LENGTH.unpack_from(buffer)
    end = LENGTH.size + length
    if len(buffer) < end:
        return None
    message = pickle.loads(bytes(buffer[LENGTH.size : end]))
    del buffer[:end]
    return message


BATCH = 1024
"""Number of samples per batch."""
FLUSH_PERIOD = 0.25
"""[s] of wall-clock time after which a smaller batch is sent."""
PIPE = 1 << 20
"""Size of the pipe's buffer [bytes]."""
PATIENCE = 120.0
"""Timeout [s] for the process to start, and for bag and recording to be finished."""
SOON = 1.0
"""[s] of waiting after a request to end before the reason is reported."""
SLOW = ("plots.png",)
"""Logs drawn at the end; after a signal the node does not wait for them."""


class LogProcess:
    """A sink that passes samples to a process. say: for lines from the logs.

    depth: maximum number of queued samples. blocking: True if samples may not be dropped.
    """

    def __init__(self, plan: Plan, depth: int, say: Callable[[str], None]) -> None:
        self.plan = plan
        self.blocking = True
        self.dropped = 0
        """number of samples dropped because the queue was full."""
        self.finished: list[str] = []
        """names of the complete logs."""
        self.ending: Callable[[], bool] = lambda: False
        """whether the node was requested to end: then waiting is reported, and samples do not wait
        for space in the queue."""
        self._closing = self._reported = False
        self._state = ""
        self._cut_off: list[str] = []
        """names of the logs that the process left incomplete."""
        self._depth, self._say = depth, say
        self._count = Count(0, {}, {})
        self._opened: Opened | None = None
        self._waiting: list[SampleRow] = []
        self._queue: deque[tuple[memoryview, int]] = deque()
        self._sent = 0
        self._flushed = time.monotonic()
        self._answers = bytearray()
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                "rb_sim.ros.log_writer",
                *([RECORDING] if plan.recording else []),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C goes only to the node
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        try:
            fcntl.fcntl(self._to, fcntl.F_SETPIPE_SZ, PIPE)
        except OSError:
            pass  # a smaller pipe suffices

    @property
    def names(self) -> list[str]:
        """Names of the requested logs."""
        plan = self.plan
        wanted = {"bag": plan.bag, "recording.rrd": plan.recording, "plots.png": plan.plots}
        return [name for name, there in wanted.items() if there]

    @property
    def queued(self) -> int:
        """Number of samples not yet written."""
        return max(0, self._sent - self._count.written) + len(self._waiting)

    @property
    def lost(self) -> dict[str, int]:
        """Number of samples missing in each log, for any reason."""
        return {name: self._count.lost.get(name, 0) + self.dropped for name in self.names}

    @property
    def failures(self) -> list[str]:
        """Paths of the logs that failed."""
        failed = [name for name, why in self._count.failures.items() if why]
        return [str(self.plan.folder / name) for name in (self._cut_off or failed)]

    @property
    def incomplete(self) -> list[str]:
        """Paths of the incomplete logs after `close`: those that failed or timed out."""
        missing = [name for name in self.names if name not in (*self.finished, *SLOW)]
        left = [str(self.plan.folder / name) for name in missing]
        return self.failures or left

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Start the logs. Raises SinkError if one cannot be started."""
        self._layout = layout
        self._enqueue(frame(Begin(self.plan, scene, layout)), 0)
        self._wait_until(lambda: self._opened is not None or self.ending())
        if self._opened is None:
            why = "the node was to end" if self.ending() else "it did not begin"
            raise SinkError(f"{self.plan.folder}: the process that writes the logs: {why}")
        if self._opened.error:
            raise SinkError(self._opened.error)

    def write_row(self, row: SampleRow) -> None:
        """Add the sample to the next batch, which is sent when full or by `tick`."""
        self._waiting.append(row)
        if len(self._waiting) >= BATCH:
            self.flush()

    def note_state(self, state: str) -> None:
        """Send the state of the node if it changed."""
        if state != self._state:
            self._state = state
            self.flush()
            self._enqueue(frame(State(state)), 0)

    def tick(self) -> bool:
        """To be called regularly: send a batch older than FLUSH_PERIOD; whether one was due."""
        due = time.monotonic() - self._flushed >= FLUSH_PERIOD
        if due:
            self.flush()
        return due

    def flush(self) -> None:
        """Send the present batch, as far as there is space, and read the answers."""
        self._flushed = time.monotonic()
        if self._waiting:
            batch, self._waiting = self._waiting, []
            self._pass(rows_of(batch))
        self._pump()
        self._listen()

    def _pass(self, rows: Rows) -> None:
        """Enqueue the samples if there is space; otherwise wait for it, or drop them."""
        if self._sent - self._count.written >= self._depth:
            self._listen()
            self._pump()
        if self.blocking:
            self._wait_until(
                lambda: self._sent - self._count.written < self._depth or self.ending()
            )
        if self.blocking or self._sent - self._count.written < self._depth:
            self._enqueue(frame(rows), len(rows.t))
        else:
            self.dropped += len(rows.t)

    def close(
        self, summary: dict[str, Any] | None = None, *, patient: Callable[[], bool] = lambda: True
    ) -> None:
        """Finish the logs. patient: whether to wait for slow ones (plots); called repeatedly."""
        self.flush()
        self._closing = True
        self._enqueue(frame(End(summary)), 0)
        if self._opened is not None or not self.ending():
            self._wait_until(lambda: not self._queue and self._is_finished(slow=patient()))
        if self._process.stdin is not None:
            self._process.stdin.close()
        if patient():
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(PATIENCE)

    def _is_finished(self, *, slow: bool) -> bool:
        """Whether all logs are finished, or all but the slow ones."""
        missing = set(self.names) - set(self.finished)
        return not (missing if slow else missing - set(SLOW))

    def _enqueue(self, data: bytes, samples: int) -> None:
        self._queue.append((memoryview(data), samples))
        self._sent += samples
        self._pump()

    def _pump(self) -> None:
        """Write as much to the pipe as it accepts."""
        while self._queue:
            data, samples = self._queue[0]
            try:
                written = os.write(self._to, data)
            except BlockingIOError:
                return
            except OSError:  # the process has ended; reported by `_listen`
                self._lose()
                return
            if written < len(data):
                self._queue[0] = data[written:], samples
            else:
                self._queue.popleft()

    def _listen(self) -> None:
        ended = False
        try:
            while data := os.read(self._from, 1 << 16):
                self._answers += data
            ended = True
        except BlockingIOError:
            pass
        while (message := take_frame(self._answers)) is not None:
            if isinstance(message, Notice):
                self._say(message.line)
            elif isinstance(message, Count):
                self._count = message
            elif isinstance(message, Opened):
                self._opened = message
            elif isinstance(message, Finished):
                self.finished.append(message.name)
        if ended:
            self._note_end()

    def _note_end(self) -> None:
        """Report the unexpected end of the process, once."""
        self._lose()
        whole = self.finished if self._closing else []
        missing = [name for name in self.names if name not in whole]
        begun = self._opened is not None and not self._opened.error
        if not begun or not missing or self._cut_off:
            return
        self._cut_off = missing
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(1.0)
        bag = self.plan.folder / "bag"
        broken = "bag" in missing and "bag" not in self.finished
        cure = f"; read the bag with: rb_sim recover {bag}" if broken else ""
        self._say(
            f"warning: the process that writes the logs has ended ({self._process.returncode});"
            f" the run continues without {', '.join(missing)}{cure}"
        )

    def _lose(self) -> None:
        """Count all unwritten samples as dropped."""
        self._queue.clear()
        self.dropped += self._sent - self._count.written
        self._sent = self._count.written

    def _tell_what_is_waited_for(self) -> None:
        """Report once that a hanging disk or process delays the end of the node."""
        if self._reported:
            return
        self._reported = True
        missing = [name for name in self.names if name not in self.finished]
        self._say(
            f"warning: waits up to {PATIENCE:g} s for the process that writes {', '.join(missing)}"
            f" in {self.plan.folder} ({self.queued} samples left); send another signal to end"
            " without them"
        )

    def _wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait until the condition holds, the process has ended, or PATIENCE has passed."""
        end = time.monotonic() + PATIENCE
        asked: float | None = None
        while True:
            ended = self._process.poll() is not None
            self._pump()
            self._listen()
            if condition() or ended or time.monotonic() > end:
                return
            if self.ending():
                asked = asked or time.monotonic()
                if time.monotonic() - asked > SOON:
                    self._tell_what_is_waited_for()
            writing = [self._to] if self._queue else []
            select.select([self._from], writing, [], 0.05)


def unfinished(logs: LogProcess | None) -> str:
    """Text on the logs that would be incomplete if the node ended now; "" if none."""
    if logs is None:
        return ""
    missing = [name for name in logs.names if name not in logs.finished]
    slow = [name for name in missing if name in SLOW]
    if missing and missing == slow:
        return f"{', '.join(slow)} is still being drawn, by a process of its own"
    return f"{', '.join(missing)}: finished by a process of its own" if missing else ""
