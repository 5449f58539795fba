# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Outputs of a run in its folder: bag, recording, plots; one may fail without the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import MissingExtraError, RbSimError

if TYPE_CHECKING:
    from rb_sim.io.sink import Sink
    from rb_sim.mechanics.samples import SampleBlock, SampleLayout
    from rb_sim.scene.schema import Scene

Say = Callable[[str], None]


class Output:
    """A sink that is dropped at its first failure, which is reported in one line; lost samples are
    counted."""

    def __init__(self, sink: Sink, path: Path, say: Say) -> None:
        self.path = path
        self.lost = 0
        """number of samples lost with or after the failure; those buffered in the sink are lost,
        too."""
        self.failure = ""
        self.left_out = ""
        """reason why no file was written although nothing failed."""
        self._sink = sink
        self._say = say

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Open the sink. Errors are not caught: the user must correct them before the start."""
        self._sink.open(scene, layout)

    def write(self, block: SampleBlock) -> None:
        """Write the samples, or count them as lost after a failure."""
        if self.failure:
            self.lost += len(block)
            return
        try:
            self._sink.write(block)
        except (OSError, RbSimError) as error:
            self.lost += len(block)
            self._fail(error, f"; the run continues without {self.path.name}")

    def note_state(self, state: str) -> None:
        """Record the state of the node, in a bag."""
        try:
            if not self.failure:
                self._sink.note_state(state)  # type: ignore[attr-defined]  # bags have it
        except OSError as error:
            self._fail(error, f"; the run goes on without {self.path.name}")

    def leave_out(self, reason: str) -> None:
        """Skip the file, which would only be written on closing. reason: text for the summary."""
        self.left_out = reason

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish the file; samples written so far shall be readable."""
        if self.left_out:
            return
        try:
            self._sink.close(summary)
        except (OSError, RbSimError) as error:
            if not self.failure:
                self._fail(error)

    def as_dict(self) -> dict[str, Any]:
        """Path and losses as JSON data."""
        return {
            "path": str(self.path),
            "failure": self.failure or None,
            "left_out": self.left_out or None,
            "lost_at_least": self.lost,
        }

    def _fail(self, error: Exception, consequence: str = "") -> None:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        self.failure = reason
        self._say(f"warning: {reason}{consequence}")


def choose(
    folder: Path | None,
    say: Say,
    *,
    bag: bool,
    rerun: bool | None,
    plots: bool,
    accelerations: bool = False,
    start_ns: int = 0,
    options: Mapping[str, Any] | None = None,
    split: Mapping[str, Any] | None = None,
) -> dict[str, Output]:
    """The requested outputs, not yet opened. folder: None writes nothing; start_ns: see BagSink.

    accelerations: record and draw them, too. options: of the command line, stored in the bag.
    split: size and duration of bag files, as in BagSink. rerun: None records if rerun-sdk is
    installed and prints a note otherwise; True requires it.

    Raises RbSimError for a folder that cannot be created; MissingExtraError.
    """
    if folder is None:
        return {}
    from rb_sim.simulation.record import accelerating

    make_folder(folder)
    chosen: dict[str, Output] = {}
    if bag:
        from rb_sim.io.bag.bag_sink import BagSink

        run = {"by": "run", "options": dict(options or {})}
        asked = accelerating if accelerations else None
        sink = BagSink(
            folder / "bag", start_ns=start_ns, run=run, accelerations=asked, **(split or {})
        )
        chosen["bag"] = Output(sink, folder / "bag", say)
    if rerun is not False:
        from rb_sim.io.rerun.rerun_sink import RerunSink

        path = folder / "recording.rrd"
        try:
            chosen["recording"] = Output(RerunSink(path), path, say)
        except MissingExtraError as error:
            if rerun:
                raise
            say(f"note: no recording.rrd: {error} (or give --no-rerun)")
    if plots:
        from rb_sim.io.run_plots import PlotSink

        path = folder / "plots.png"
        try:
            sink = PlotSink(path, accelerating if accelerations else None)
            chosen["plots"] = Output(sink, path, say)
        except MissingExtraError as error:
            say(f"note: no plots.png: {error} (or give --no-plots)")
    return chosen


def folder_logs(folder: Path) -> list[str]:
    """Names of the logs that exist in the folder."""
    return [name for name in ("bag", "recording.rrd", "plots.png") if (folder / name).exists()]


def refuse_logs(folder: Path, what: str, instead: str) -> None:
    """Raise RbSimError if the folder has logs of another run.

    what: option that names the folder; instead: alternative to another folder, for the message.
    """
    try:
        there = folder_logs(folder)
    except OSError as error:  # e.g. a name of 300 characters
        raise RbSimError(f"{what}: {folder}: cannot be read: {error.strerror}") from None
    if there:
        raise RbSimError(
            f"{what}: {folder} already contains {', '.join(there)}; use another folder, {instead}"
        )


def make_folder(folder: Path) -> None:
    """Create the folder of the outputs and check that it is writable. Raises RbSimError."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".rb_sim"
        probe.touch()
        probe.unlink()
    except FileExistsError:  # a file, a pipe, a link to nothing
        raise RbSimError(
            f"--out {folder}: is not a folder; must be one, or a name for a new one"
        ) from None
    except OSError as error:
        raise RbSimError(f"--out {folder}: cannot write there: {error.strerror}") from None


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Context that creates the folder and turns OSError within it into RbSimError, e.g. for a full
    disk."""
    make_folder(folder)
    try:
        yield
    except OSError as error:
        raise RbSimError(f"--out {folder}: cannot write there: {error.strerror}") from None
