# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Views of a trajectory: matplotlib figures, and the Rerun viewer."""

from __future__ import annotations

import base64
import io
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.base.errors import MissingExtraError, RbSimError, SinkError, check_ending
from rb_sim.io.plots.plots import Plots, save

if TYPE_CHECKING:
    from rb_sim.trajectory.record import Record


# The plots of a trajectory as matplotlib figures, shown in a notebook or saved.


class Pages(Mapping[str, Any]):
    """Matplotlib figures by page: "" is the first, the others are named by a body.

    A notebook shows them all.
    """

    def __init__(self, figures: dict[str, Any]) -> None:
        self._figures = figures

    def __getitem__(self, name: str) -> Any:
        return self._figures[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._figures)

    def __len__(self) -> int:
        return len(self._figures)

    def __repr__(self) -> str:
        bodies = [name for name in self._figures if name]
        return f"<plots: {'one page' if not bodies else 'the whole, ' + ', '.join(bodies)}>"

    def _repr_html_(self) -> str:
        return "".join(f'<img src="data:image/png;base64,{_png(f)}">' for f in self.values())

    def save(self, path: Path) -> None:
        """Write the pages as PNG: the first to `path`, those of bodies beside it; folders are made.

        Raises SinkError.
        """
        check_ending(path, ".png")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{path}: cannot be written: {error.strerror}") from None
        save(self._figures, path)


def pages_of(trajectory: Record) -> Pages:
    """The pages of a trajectory. Raises RbSimError without samples or a scene."""
    if trajectory.scene is None or not len(trajectory):
        missing = "samples" if trajectory.scene is not None else "scene"
        raise RbSimError(f"plot: the trajectory has no {missing}")
    plots = Plots(trajectory.scene, trajectory.layout)
    plots.add(trajectory.block)
    return Pages(plots.figures())


def _png(figure: Any) -> str:
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return base64.b64encode(file.getvalue()).decode("ascii")


# Shows a trajectory in the Rerun viewer: in a window, in a notebook, or saved for later.


def view(trajectory: Record, save: Path | None = None) -> None:
    """Save the run as .rrd, or show it: in a notebook its widget, else the viewer in a window.

    Raises MissingExtraError, SinkError; RbSimError for a trajectory without a scene.
    """
    if save is not None:
        check_ending(save, ".rrd")
        record(trajectory, save)
        return
    with tempfile.TemporaryDirectory(prefix="rb_sim_") as folder:
        recording = Path(folder) / f"{getattr(trajectory.scene, 'name', 'run')}.rrd"
        record(trajectory, recording)
        if in_notebook():
            _widget(recording)
            return
        from rb_sim.io.rerun.viewer import show

        show(recording)


def record(trajectory: Record, path: Path) -> None:
    """Write the run as a Rerun recording."""
    from rb_sim.io.rerun.sink import RerunSink

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
