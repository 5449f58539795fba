# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Draws the picture of the page of each law, docs/laws/pictures/KIND.png.

The example of the page, set moving: its body is thrown and spun as far as the law lets it, under
gravity; where the law exerts a torque only, it drifts without weight. Left the body at three
instants (a box, unless its shape is a sphere), the joint (pivot, axis with bearings, rail, rod,
spring, plane), the path of the centre of mass, and the law's force on the body along it, or its
torque. Right that force (full) and its torque about the anchor (dashed) over time, world axes.
"""

from __future__ import annotations

import io
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.base.palette import AXES, GRID, REACTION
from tools.colors import few_colors
from tools.law_examples import EXAMPLES, TORQUE_ONLY

THROWN = {"linear_velocity": [1.0, 0.5, 1.5], "angular_velocity": [0.5, 1.0, 2.0]}
"""Of the body, where the law does not hold it [m/s, rad/s]."""
DRIFT = {"linear_velocity": [0.6, 0.0, 0.0]}
"""Of a body under a law that exerts a torque only [m/s]."""
UNBALANCED = {"parallel": [[1.2, 0.0, 0.3], [0.0, 1.0, 0.0], [0.3, 0.0, 0.8]]}
"""Inertia [kg m^2] of a body on which the law would exert nothing if its axis were principal."""
DURATION, SAMPLES = 2.0, 200
ARROWS = 9
JOINT = "#0072b2"


def moving(kind: str) -> Any:
    """The example of the law as a scene that moves."""
    scene = yaml.safe_load(EXAMPLES[kind])
    (body,) = scene["bodies"].values()
    body |= THROWN | (DRIFT if kind in TORQUE_ONLY else {})
    body["inertia"] = UNBALANCED.get(kind, body.get("inertia"))
    effects = scene.setdefault("effects", {})
    if kind not in TORQUE_ONLY and all(spec["type"] != "gravity" for spec in effects.values()):
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
    specs = [*scene.constraints.values(), *scene.effects.values()]
    spec = next(spec for spec in specs if spec.type == kind)
    seen = path
    if wrench is not None and kind in ("fixed_point", "distance", "spring", "string"):
        end = wrench.anchor[0] if kind == "fixed_point" else np.array(spec.point_A)
        seen = np.vstack([path, end])
    middle, size = _view(way, seen)
    acts = None if wrench is None else wrench.torque if kind in TORQUE_ONLY else wrench.force
    _draw_path(way, path, acts, size)
    _draw_body(way, run, _edges(scene.bodies["b"].shape, 0.12 * size))
    if wrench is not None:
        _draw_joint(way, spec, wrench.anchor[0], run.position["b"][0], middle, size)
    plot = figure.add_axes((0.50, 0.19, 0.38, 0.69))
    if wrench is not None:
        for k, (label, color) in enumerate(zip("xyz", AXES[:3], strict=True)):
            if kind not in TORQUE_ONLY:
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
    return Image.open(data).convert("RGB")


def _view(axes: Any, seen: np.ndarray) -> tuple[np.ndarray, float]:
    """Sets the limits to the points `seen`; the middle and the width of the view [m]."""
    size = max(float(np.ptp(seen, axis=0).max()), 0.2)
    middle = 0.5 * (seen.max(axis=0) + seen.min(axis=0))
    for k, set_limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
        set_limits(middle[k] - 0.6 * size, middle[k] + 0.6 * size)
    for axis, label in zip((axes.xaxis, axes.yaxis, axes.zaxis), "xyz", strict=True):
        axis.set_tick_params(labelsize=6, pad=-3)
        axis.set_label_text(f"{label} [m]", fontsize=7)
        axis.labelpad = -8 if label != "z" else -5
    axes.set_box_aspect((1, 1, 1), zoom=0.95)
    return middle, size


def _draw_path(axes: Any, path: np.ndarray, force: np.ndarray | None, size: float) -> None:
    axes.plot(*path.T, color="#555555", linewidth=1.2)
    if force is not None:
        rows = np.linspace(0, len(path) - 1, ARROWS).astype(int)
        longest = float(np.linalg.norm(force[rows], axis=1).max())
        if longest > 0.0:
            arrows = force[rows] / longest * 0.35 * size
            axes.quiver(*path[rows].T, *arrows.T, color=REACTION, linewidth=1.2)


def _edges(shape: Any, half: float) -> list[np.ndarray]:
    """Lines of the body, body axes [m]: circles of a sphere, else a box of half length `half`."""
    if shape is not None and shape.type == "sphere":
        turn = np.linspace(0.0, 2.0 * np.pi, 37)
        circle = shape.radius * np.array([np.cos(turn), np.sin(turn), 0.0 * turn])
        return [np.roll(circle, k, axis=0).T for k in range(3)]
    corners = half * np.array([1.0, 0.6, 0.3]) * np.array(list(product((-1, 1), repeat=3)))
    pairs = combinations(corners, 2)
    return [np.array(pair) for pair in pairs if np.sum(pair[0] != pair[1]) == 1]


def _draw_body(axes: Any, run: Any, edges: list[np.ndarray]) -> None:
    """The lines of the body at three instants, dark at the first."""
    for k, color in ((-1, "#c8c8c8"), (len(run) // 3, "#a0a0a0"), (0, "#303030")):
        turned = Rotation.from_quat(run.orientation["b"][k])
        for edge in edges:
            at = run.position["b"][k] + turned.apply(edge)
            axes.plot(*at.T, color=color, linewidth=0.9)


def _draw_joint(
    axes: Any, spec: Any, anchor: np.ndarray, start: np.ndarray, middle: np.ndarray, size: float
) -> None:
    """The joint at the start.

    anchor: point about which its reaction is given, start: centre of mass, world [m].
    """

    def line(*points: Any, width: float = 1.2, style: str = "-") -> None:
        axes.plot(*np.array(points, dtype=float).T, style, color=JOINT, linewidth=width)

    match spec.type:
        case "fixed_point" | "weld":
            foot = 0.12 * size
            axes.scatter(*anchor[:, None], s=24, color=JOINT)
            for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
                line(anchor, anchor + foot * np.array([0.6 * x, 0.6 * y, -1.0]))
        case "fixed_axis":
            axis = np.array(spec.axis_B, dtype=float)
            axis /= np.linalg.norm(axis)
            line(anchor - 0.3 * size * axis, anchor + 0.6 * size * axis, style="--")
            for s in (0.0, spec.bearing_distance):
                at = anchor + s * axis
                line(at - 0.04 * size * axis, at + 0.04 * size * axis, width=6.0)
        case "translation":
            along = size * np.array(spec.guide.direction)
            line(anchor - 0.3 * along, anchor + 1.2 * along, width=2.5)
        case "distance" | "string" | "spring":
            end = np.array(spec.point_A)
            parts = np.linspace(start, end, 13)
            if spec.type == "spring":
                parts[1:-1:2] += [0.03 * size, 0.0, 0.0]
                parts[2:-1:2] -= [0.03 * size, 0.0, 0.0]
            line(*parts, style="--" if spec.type == "string" else "-")
            axes.scatter(*end[:, None], s=18, color=JOINT)
        case "plane" | "rolling" | "contact":
            x, y = np.meshgrid(*(m + np.array([-0.6, 0.6]) * size for m in middle[:2]))
            axes.plot_surface(x, y, np.full((2, 2), anchor[2]), color=JOINT, alpha=0.12)


def draw(kind: str, folder: Path) -> None:
    """Write KIND.png into the folder."""
    few_colors(picture(kind)).save(folder / f"{kind}.png", optimize=True)
