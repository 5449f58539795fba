"""Shows a trajectory in the Rerun viewer: in a window, in a notebook, or saved for later."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from rb_sim.errors import MissingExtraError, RbSimError

if TYPE_CHECKING:
    from rb_sim.trajectory import Trajectory


def view(trajectory: Trajectory, save: Path | None = None) -> None:
    """Save the run as .rrd, or show it: in a notebook its widget, else the viewer in a window.

    Raises MissingExtraError, SinkError; RbSimError for a trajectory without a scene.
    """
    if save is not None:
        record(trajectory, save)
        return
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = Path(folder) / f"{getattr(trajectory.scene, 'name', 'run')}.rrd"
        record(trajectory, recording)
        if in_notebook():
            _widget(recording)
            return
        from rb_sim.sinks.rerun_window import show

        show(recording)


def record(trajectory: Trajectory, path: Path) -> None:
    """Write the run as a Rerun recording."""
    from rb_sim.sinks.rerun import RerunSink

    if trajectory.scene is None:
        raise RbSimError("view: the trajectory has no scene")
    sink = RerunSink(path)
    sink.open(trajectory.scene, trajectory.layout)
    try:
        sink.write(trajectory.block)
    finally:
        sink.close()


def in_notebook() -> bool:
    """Whether a notebook's kernel runs this."""
    ipython = sys.modules.get("IPython")
    shell = None if ipython is None else ipython.get_ipython()
    return shell is not None and getattr(shell, "kernel", None) is not None


def _widget(recording: Path) -> None:
    """Rerun's viewer as a notebook shows it."""
    from importlib.util import find_spec

    if find_spec("rerun_notebook") is None:
        raise MissingExtraError("rerun-notebook", "notebook", "a viewer in a notebook")
    import rerun

    stream = rerun.RecordingStream("rb_sim")
    stream.log_file_from_path(recording)
    stream.notebook_show(width=1200, height=700)
