# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The Rerun viewer as a subprocess: a window, a screenshot, a film."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.errors import MissingExtraError, SinkError

# Viewer process that ends with this process.


FATAL = (signal.SIGTERM, signal.SIGHUP)
"""Signals that would end this process without cleanup (SIGINT raises KeyboardInterrupt)."""


@contextlib.contextmanager
def viewer_process(command: Sequence[str], **options: Any) -> Iterator[subprocess.Popen[Any]]:
    """A viewer process; terminated with its children when the block is left, also by a signal."""
    with _signals_as_exits():
        # a process group of its own, since the command is a wrapper and the viewer its child
        process = subprocess.Popen(command, start_new_session=True, **options)
        try:
            yield process
        finally:
            _end_group(process)


@contextlib.contextmanager
def _signals_as_exits() -> Iterator[None]:
    """Convert the FATAL signals to SystemExit, unless they have handlers."""
    numbers: list[signal.Signals] = []
    if threading.current_thread() is threading.main_thread():
        numbers = [n for n in FATAL if signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, _leave)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)


def _leave(number: int, _: FrameType | None) -> None:
    sys.exit(128 + number)


def _end_group(process: subprocess.Popen[Any]) -> None:
    """Terminate the process and its children, even if it has ended already."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(timeout=5)
        except (ProcessLookupError, subprocess.TimeoutExpired):
            continue
    process.wait()


# Picture of a recording, rendered by a headless Rerun viewer.


SCREENSHOT_SIZE = (1600, 1000)
"""Size of the viewer in points; the picture has more pixels if the viewer scales."""

MOMENT = 0.6
"""Time shown, as a fraction of the recording."""

PATIENCE = 90.0
"""Timeout of the viewer [s]."""

LOCAL = "127.0.0.1"
"""Address on which viewers listen; the default would be every network interface."""

MOTION = "motion"
"""Name of the 3D view."""

_PAUSE = 1.0

_GREETING = 5.0
"""Time for which the viewer shows a notice over the view [s]."""


def save_screenshot(
    recording: Path, picture: Path, size: tuple[int, int] = SCREENSHOT_SIZE
) -> None:
    """Render `recording` (.rrd) to `picture` (.png).

    Raises MissingExtraError without rerun-sdk; SinkError if the viewer cannot render (it needs
    Vulkan; Mesa's software driver suffices) or the picture cannot be written.
    """
    with _viewer(recording, size) as viewer:
        data = _loaded_picture(viewer)
    try:
        picture.parent.mkdir(parents=True, exist_ok=True)
        picture.write_bytes(data)
    except OSError as error:
        raise SinkError(f"{picture}: cannot write the picture: {error.strerror}") from None


def frames(recording: Path, moments: Sequence[float], size: tuple[int, int]) -> Iterator[bytes]:
    """Pictures (PNG) of the motion in `recording` at these moments, as fractions of its time span.

    Raises as `save_screenshot` does.
    """
    with _viewer(recording, size) as viewer:
        first, last = _loaded_span(viewer)
        _loaded_picture(viewer)
        views = [view.view_id for view in viewer.ask("get_state").views if view.name == MOTION]
        view = views[0] if len(views) == 1 else None
        for moment in moments:
            viewer.patient()
            when = first + moment * (last - first)
            viewer.ask("set_time", "sim_time", duration=when, play_state="paused")
            viewer.ask("take_screenshot", view)  # may still show the preceding time
            yield viewer.ask("take_screenshot", view)


def rerun_executable() -> str:
    """Path of the viewer installed with this Python, else of the one on PATH. Raises
    MissingExtraError."""
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise MissingExtraError("rerun-sdk", "rerun", "the Rerun viewer")
    return found


class _Viewer:
    """A viewer process and the connection to it."""

    def __init__(self, process: subprocess.Popen[bytes], log: Path, port: int) -> None:
        self._process = process
        self._log = log
        self._url = f"rerun+http://{LOCAL}:{port}/proxy"
        self._deadline = time.monotonic() + PATIENCE
        self._client: Any = None

    def ask(self, question: str, *arguments: Any, **options: Any) -> Any:
        """Call a method of the viewer until it answers. Raises SinkError as `check` does."""
        from rerun.experimental import ViewerClient

        while True:
            self.check()
            try:
                if self._client is None:
                    self._client = ViewerClient.connect(self._url)
                return getattr(self._client, question)(*arguments, **options)
            except Exception:  # not ready yet: rerun raises various errors
                self._client = None
            time.sleep(0.3)

    def patient(self) -> None:
        """Restart the timeout."""
        self._deadline = time.monotonic() + PATIENCE

    def check(self) -> None:
        """Raise SinkError if the viewer has ended or the timeout has passed."""
        if self._process.poll() is not None:
            raise SinkError(f"the Rerun viewer cannot draw here: {self._reason()}")
        if time.monotonic() > self._deadline:
            raise SinkError(f"the Rerun viewer gave no picture within {PATIENCE:g} s")

    def _reason(self) -> str:
        text = self._log.read_text(errors="replace")
        if "render context" in text or "No graphics adapter" in text:
            return "no Vulkan driver (on Debian and Ubuntu: apt install mesa-vulkan-drivers)"
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        return lines[-1] if lines else f"it ended with code {self._process.returncode}"


@contextlib.contextmanager
def _viewer(recording: Path, size: tuple[int, int]) -> Iterator[_Viewer]:
    """A headless viewer of `recording`, terminated afterwards."""
    port = _free_port()
    command = [rerun_executable(), str(recording), "--headless"]
    command += ["--window-size", f"{size[0]}x{size[1]}", "--bind", LOCAL, "--port", str(port)]
    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "log"
        own = {**os.environ, "TMPDIR": folder}  # it leaves temporary files when terminated
        with (
            log.open("wb") as output,
            viewer_process(command, env=own, stdout=output, stderr=subprocess.STDOUT) as process,
        ):
            yield _Viewer(process, log, port)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((LOCAL, 0))
        return int(probe.getsockname()[1])


def _loaded_picture(viewer: _Viewer) -> bytes:
    """Picture (PNG) of the recording, once it is loaded and no longer changes."""
    first, last = _loaded_span(viewer)
    moment = first + MOMENT * (last - first)
    viewer.ask("set_time", "sim_time", duration=moment, play_state="paused")
    time.sleep(_GREETING)
    before, now = b"", viewer.ask("take_screenshot")
    while now != before:
        time.sleep(_PAUSE)
        before, now = now, viewer.ask("take_screenshot")
    return now


def _loaded_span(viewer: _Viewer) -> tuple[float, float]:
    """First and last simulated time [s], once the viewer has loaded the recording."""
    while True:
        viewer.check()
        state = viewer.ask("get_state")
        if not state.loading:
            for recording in state.recordings:
                for timeline in recording.timelines:
                    if timeline.name == "sim_time" and timeline.end is not None:
                        return timeline.start / 1e9, timeline.end / 1e9
        time.sleep(0.3)


# The Rerun viewer in a window.


SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables of which a Linux program needs one to open a window."""


def show(recording: Path) -> None:
    """Open the viewer and wait until it is closed. Raises SinkError."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in SCREENS):
        raise SinkError("no screen for the Rerun viewer: use --save or --screenshot")
    viewer = [rerun_executable(), str(recording), "--bind", LOCAL, "--port", "auto"]
    with viewer_process(viewer, stderr=subprocess.PIPE, text=True) as process:
        _, messages = process.communicate()
    if process.returncode:
        lines = [line.strip() for line in messages.splitlines() if "rror:" in line]
        reason = lines[-1] if lines else f"it ended with code {process.returncode}"
        raise SinkError(f"the Rerun viewer did not open: {reason}")


# Film of a recording: pictures by a headless Rerun viewer, encoded by ffmpeg.


RATE = 25
"""Frames per second."""
SHORTEST, LONGEST = 4.0, 20.0
"""Duration limits of a film [s]; shorter or longer runs are played slower or faster."""
FILM_SIZE = (960, 540)
"""Size of a frame [pixels]; H.264 requires even numbers."""


class Film(NamedTuple):
    """Properties of a film."""

    pictures: int
    seconds: float
    speed: float
    """simulated seconds per second of film."""


def find_ffmpeg() -> str:
    """Path of ffmpeg. Raises SinkError if it is not installed."""
    found = shutil.which("ffmpeg")
    if found is None:
        raise SinkError("--video: needs the program ffmpeg (on Debian and Ubuntu: apt install "
                        "ffmpeg)")  # fmt: skip
    return found


def length_of(duration: float) -> float:
    """Duration of the film [s] of a run of this duration [s]."""
    return float(np.clip(duration, SHORTEST, LONGEST))


def save_video(
    recording: Path, path: Path, duration: float, size: tuple[int, int] = FILM_SIZE
) -> Film:
    """Film `recording` (.rrd, of `duration` seconds) to `path` (.mp4), written only when complete.

    Raises SinkError without ffmpeg or if it fails, and as `save_screenshot` does.
    """

    ffmpeg = find_ffmpeg()
    seconds = length_of(duration)
    count = round(RATE * seconds) + 1
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        draft = Path(folder) / "film.mp4"
        command = [ffmpeg, "-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png",
                   "-framerate", str(RATE), "-i", "-", "-c:v", "libx264", "-crf", "23",
                   "-pix_fmt", "yuv420p", "-vf", "scale=trunc(iw/2)*2:trunc(ih/2)*2",
                   "-movflags", "+faststart", str(draft)]  # fmt: skip
        log = Path(folder) / "log"
        with log.open("wb") as errors:
            joining = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=errors)
            assert joining.stdin is not None
            try:
                for picture in frames(recording, np.linspace(0.0, 1.0, count).tolist(), size):
                    joining.stdin.write(picture)
                joining.stdin.close()
            except BrokenPipeError:
                pass  # ffmpeg ended early; its log has the reason
            except BaseException:
                joining.kill()
                raise
            finally:
                joining.wait()
        if joining.returncode:
            lines = log.read_text(errors="replace").strip().splitlines()
            raise SinkError(f"ffmpeg made no film: {lines[-1] if lines else joining.returncode}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            shutil.move(draft, path)
        except OSError as error:
            raise SinkError(f"{path}: cannot write the film: {error.strerror}") from None
    return Film(count, seconds, duration / seconds)
