# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What a run writes into its folder: bag, recording, plots; one may fail without the others."""

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
    """A sink, dropped at its first failure, which is said in one line; what is lost is counted."""

    def __init__(self, sink: Sink, path: Path, say: Say) -> None:
        self.path = path
        self.lost = 0
        """samples that came with or after the failure; what the sink held back is lost too."""
        self.failure = ""
        self.left_out = ""
        """why there is no file though nothing failed."""
        self._sink = sink
        self._say = say

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Errors here are for the user to mend before the start: they are not caught."""
        self._sink.open(scene, layout)

    def write(self, block: SampleBlock) -> None:
        """Pass the samples on, or count them."""
        if self.failure:
            self.lost += len(block)
            return
        try:
            self._sink.write(block)
        except (OSError, RbSimError) as error:
            self.lost += len(block)
            self._fail(error, f"; the run continues without {self.path.name}")

    def note_state(self, state: str) -> None:
        """Record the state of the node in a bag."""
        try:
            if not self.failure:
                self._sink.note_state(state)  # type: ignore[attr-defined]  # bags have it
        except OSError as error:
            self._fail(error, f"; the run goes on without {self.path.name}")

    def leave_out(self, reason: str) -> None:
        """Close without a file that only closing would write. reason: in words, for the summary."""
        self.left_out = reason

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Finish the file; what was written so far is to be readable."""
        if self.left_out:
            return
        try:
            self._sink.close(summary)
        except (OSError, RbSimError) as error:
            if not self.failure:
                self._fail(error)

    def as_dict(self) -> dict[str, Any]:
        """For JSON: where it is and what it lost."""
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
    """The outputs wanted, not yet open. folder: None writes nothing; start_ns: see BagSink.

    accelerations: record and draw them, too. options: of the command line, for the bag. split:
    where to split it, as BagSink has it.
    rerun: None records if rerun-sdk is there, and says so if it is not; True insists.
    Raises RbSimError for a folder that cannot be made; MissingExtraError.
    """
    if folder is None:
        return {}
    from rb_sim.trajectory.record import accelerating

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
    """Names of the logs that are in the folder."""
    return [name for name in ("bag", "recording.rrd", "plots.png") if (folder / name).exists()]


def refuse_logs(folder: Path, what: str, instead: str) -> None:
    """Raise RbSimError if the folder has the logs of another run. what: that names the folder;
    instead: what can be done besides naming another one."""
    try:
        there = folder_logs(folder)
    except OSError as error:  # a name of 300 characters, say
        raise RbSimError(f"{what}: {folder}: cannot be read: {error.strerror}") from None
    if there:
        raise RbSimError(
            f"{what}: {folder} has {', '.join(there)} already; use another folder, {instead}"
        )


def make_folder(folder: Path) -> None:
    """Make the folder of the outputs and see that files can be made there."""
    if folder.is_file():
        raise RbSimError(f"--out {folder}: is a file; must be a folder, or a name for a new one")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".rb_sim"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise RbSimError(f"--out {folder}: cannot write there: {error.strerror}") from None


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Makes the folder; RbSimError where it or a file in it cannot be written: a full disk."""
    make_folder(folder)
    try:
        yield
    except OSError as error:
        raise RbSimError(f"--out {folder}: cannot write there: {error.strerror}") from None
