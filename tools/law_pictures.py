"""Draws a picture for the page of each law: docs/laws/pictures/KIND.png.

    python -m tools.law_pictures [FOLDER]

The example of the page, set moving: its body is thrown and spun as far as the law lets it, under
gravity. Left the way of the centre of mass with the law's force on the body along it, right that
force (full) and its torque about the anchor (dashed) over time, world axes.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from rb_sim import Simulation, load_scene
from rb_sim.base.palette import AXES, GRID, REACTION
from tools.law_examples import EXAMPLES

FOLDER = Path(__file__).parents[1] / "docs" / "laws" / "pictures"
THROWN = {"linear_velocity": [1.0, 0.5, 1.5], "angular_velocity": [0.5, 1.0, 2.0]}
"""Of the body, where the law does not hold it [m/s, rad/s]."""
DURATION, SAMPLES = 2.0, 200
ARROWS = 9
COLORS = 96
"""Of a picture."""


def moving(kind: str) -> Any:
    """The example of the law as a scene that moves."""
    scene = yaml.safe_load(EXAMPLES[kind])
    (body,) = scene["bodies"].values()
    body |= THROWN
    effects = scene.setdefault("effects", {})
    if all(spec["type"] != "gravity" for spec in effects.values()):
        effects["gravity"] = {"type": "gravity"}
    scene["simulation"] = {"duration": DURATION, "rate": SAMPLES / DURATION,
                           "project_initial": True}  # fmt: skip
    return load_scene(scene)


def acting(kind: str, scene: Any, simulation: Simulation) -> tuple[Any, Any]:
    """The run, and the law's wrench on the body over time (None for one that exerts none)."""
    named = [*scene.constraints.items(), *scene.effects.items()]
    name = next(name for name, spec in named if spec.type == kind)
    if kind == "commanded_wrench":
        simulation.apply_wrench("b", force=[3.0, 0.0, 5.0], torque=[0.0, 0.5, 0.0])
    run = simulation.run()
    return run, run.reaction.get(name) if name in scene.constraints else run.effect[name]


def picture(kind: str) -> Image.Image:
    """The picture of a law."""
    scene = moving(kind)
    run, wrench = acting(kind, scene, Simulation(scene))
    figure = Figure(figsize=(7.8, 2.7), dpi=100)
    FigureCanvasAgg(figure)
    path = run.position["b"]
    way: Any = figure.add_axes((0.0, 0.02, 0.42, 0.96), projection="3d")
    _way(way, path, None if wrench is None else wrench.force)
    plot = figure.add_axes((0.50, 0.19, 0.38, 0.69))
    if wrench is not None:
        for k, (label, color) in enumerate(zip("xyz", AXES[:3], strict=True)):
            plot.plot(run.t, wrench.force[:, k], color=color, label=f"F{label} [N]")
        if np.abs(wrench.torque).max() > 1e-9 * max(1.0, np.abs(wrench.force).max()):
            for k, (label, color) in enumerate(zip("xyz", AXES[:3], strict=True)):
                plot.plot(run.t, wrench.torque[:, k], "--", color=color, label=f"K{label} [N m]")
        plot.legend(fontsize=7, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    else:
        plot.set_axis_off()
    plot.set_title(f"{kind}: on the body" if wrench is not None else f"{kind}: exerts nothing",
                   fontsize=9, loc="left")  # fmt: skip
    plot.set_xlabel("t [s]", fontsize=8)
    plot.tick_params(labelsize=7)
    plot.grid(color=GRID, linewidth=0.6)
    plot.margins(x=0)
    data = io.BytesIO()
    figure.savefig(data, format="png")
    image = Image.open(data).convert("RGB")
    return image.quantize(COLORS, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def _way(axes: Any, path: np.ndarray, force: np.ndarray | None) -> None:
    axes.plot(*path.T, color="#555555", linewidth=1.2)
    axes.scatter(*path[:1].T, color="#202020", s=12)
    size = max(float(np.ptp(path, axis=0).max()), 0.2)
    if force is not None:
        rows = np.linspace(0, len(path) - 1, ARROWS).astype(int)
        longest = float(np.linalg.norm(force[rows], axis=1).max())
        if longest > 0.0:
            arrows = force[rows] / longest * 0.35 * size
            axes.quiver(*path[rows].T, *arrows.T, color=REACTION, linewidth=1.2)
    middle = 0.5 * (path.max(axis=0) + path.min(axis=0))
    for k, set_limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        set_limits(middle[k] - 0.6 * size, middle[k] + 0.6 * size)
    for axis, label in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_tick_params(labelsize=6, pad=-3)
        axis.set_label_text(f"{label} [m]", fontsize=7)
        axis.labelpad = -8
    axes.set_box_aspect((1, 1, 1), zoom=0.95)


def main(folder: Path = FOLDER) -> int:
    """Draw all; returns 0."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind in EXAMPLES:
        picture(kind).save(folder / f"{kind}.png", optimize=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(*map(Path, sys.argv[1:2])))
