"""The plots of a trajectory as matplotlib figures, shown in a notebook or saved."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rb_sim.errors import RbSimError, SinkError
from rb_sim.sinks.plots import Plots, save

if TYPE_CHECKING:
    from rb_sim.trajectory import Trajectory


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
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise SinkError(f"{path}: cannot write it: {error.strerror}") from None
        save(self._figures, path)


def pages_of(trajectory: Trajectory) -> Pages:
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
