"""A film of a recording: pictures by the Rerun viewer without a window, joined by ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np

from rb_sim.errors import SinkError

RATE = 25
"""Pictures per second."""
SHORTEST, LONGEST = 4.0, 20.0
"""Of a film [s]; runs that are shorter or longer are played slower or faster."""
SIZE = (960, 540)
"""Of a picture; H.264 wants even numbers."""


class Film(NamedTuple):
    """What was made."""

    pictures: int
    seconds: float
    speed: float
    """simulated seconds in one of the film."""


def find_ffmpeg() -> str:
    """The program. Raises SinkError where there is none."""
    found = shutil.which("ffmpeg")
    if found is None:
        raise SinkError("--video: needs the program ffmpeg (on Debian and Ubuntu: apt install "
                        "ffmpeg)")  # fmt: skip
    return found


def length_of(duration: float) -> float:
    """Seconds of the film of a run of this duration [s]."""
    return float(np.clip(duration, SHORTEST, LONGEST))


def save_video(recording: Path, path: Path, duration: float, size: tuple[int, int] = SIZE) -> Film:
    """Film `recording` (.rrd, of `duration` seconds) into `path` (.mp4), which is never half there.

    Raises SinkError without ffmpeg or where it fails, and as `save_screenshot` does.
    """
    from rb_sim.sinks.rerun_screenshot import frames

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
                pass  # it ended early; its last line says why
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
