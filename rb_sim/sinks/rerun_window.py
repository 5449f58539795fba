"""The Rerun viewer in a window of its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

from rb_sim.errors import SinkError
from rb_sim.sinks.rerun_screenshot import LOCAL, rerun_executable
from rb_sim.sinks.viewer_process import viewer_process

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables, one of which a program on Linux needs to open a window."""


def show(recording: Path) -> None:
    """Open the viewer and wait until it is closed. Raises SinkError."""
    if sys.platform == "linux" and not any(os.environ.get(name) for name in SCREENS):
        raise SinkError("no screen for the Rerun viewer: use --save or --screenshot")
    viewer = [rerun_executable(), str(recording), "--bind", LOCAL, "--port", "auto"]
    with viewer_process(viewer, stderr=subprocess.PIPE, text=True) as process:
        _, said = process.communicate()
    if process.returncode:
        lines = [line.strip() for line in said.splitlines() if "rror:" in line]
        reason = lines[-1] if lines else f"it ended with code {process.returncode}"
        raise SinkError(f"the Rerun viewer did not open: {reason}")
