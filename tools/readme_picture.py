# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The moving picture of README, docs/pictures/heavy_top.gif; tools/pictures.py calls it.

The heavy top, the way of its centre of mass, the reaction of its fixed point, and how far the run
is from one with a tolerance of 1e-13.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter

from rb_sim import Simulation, load_scene
from rb_sim.base.palette import AXES, BLUE, GREY, GRID, REACTION

FRAMES, PER_SECOND = 75, 15
DURATION = 2.0
ARROW = 1.0 / 1500.0
"""Length of an arrow per force [m/N]."""


def draw(folder: Path) -> None:
    """Draw heavy_top.gif in the folder."""
    run, sharp = (
        Simulation(load_scene("heavy_top", tolerance=tolerance)).run(DURATION, rate=500.0)
        for tolerance in (1e-10, 1e-13)
    )
    t, centre, force = run.t, run.position["top"], run.reaction["tip"].force
    apart = np.linalg.norm(centre - sharp.position["top"], axis=1)
    figure = plt.figure(figsize=(7.6, 3.1), dpi=100, layout="constrained")
    space: Any = figure.add_subplot(1, 2, 1, projection="3d")
    plots = figure.add_gridspec(1, 2)[0, 1].subgridspec(2, 1, height_ratios=(2, 1))
    upper, lower = (figure.add_subplot(plots[k]) for k in (0, 1))
    for k, (axis, colour) in enumerate(zip("xyz", AXES[:3], strict=True)):
        upper.plot(t, force[:, k] / 1e3, colour, lw=1.0, label=axis)
    upper.set_ylabel("reaction of the tip [kN]", fontsize=8)
    upper.legend(fontsize=7, loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False)
    lower.semilogy(t[1:], np.maximum(apart[1:], 1e-16), color=GREY, lw=1.0)
    lower.set_ylabel("error [m]", fontsize=8)
    lower.set_xlabel("t [s]", fontsize=8)
    for axes in (upper, lower):
        axes.tick_params(labelsize=7)
        axes.set_xlim(0.0, DURATION)
    marks = [axes.axvline(0.0, color="black", lw=0.8) for axes in (upper, lower)]
    space.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1.1, 0.9))
    space.set_box_aspect((1, 1, 1), zoom=1.45)
    space.set_axis_off()
    space.view_init(elev=18, azim=-50)
    grid = np.linspace(-1, 1, 9)
    for x in grid:
        space.plot([x, x], [-1, 1], [-1.1, -1.1], color=GRID, lw=0.5)
        space.plot([-1, 1], [x, x], [-1.1, -1.1], color=GRID, lw=0.5)
    (way,) = space.plot([], [], [], color=BLUE, lw=1.0)
    (stem,) = space.plot([], [], [], color="#333333", lw=2.5)
    (rim,) = space.plot([], [], [], color="#333333", lw=2.0)
    (arrow,) = space.plot([], [], [], color=REACTION, lw=2.5)
    space.plot([0], [0], [0], "o", color="black", ms=5)
    space.text(0.0, 0.0, 0.75, "reaction (orange)", color=REACTION, fontsize=8, ha="center")

    def show(frame: int) -> None:
        k = round(frame / (FRAMES - 1) * (len(t) - 1))
        way.set_data_3d(*centre[: k + 1].T)
        stem.set_data_3d(*np.array([[0, 0, 0], centre[k]]).T)
        axis = centre[k] / np.linalg.norm(centre[k])
        u = np.cross(axis, [0.3, 0.5, 0.8])
        u /= np.linalg.norm(u)
        turn = np.linspace(0.0, 2.0 * np.pi, 40)[:, None]
        circle = centre[k] + 0.25 * (np.cos(turn) * u + np.sin(turn) * np.cross(axis, u))
        rim.set_data_3d(*circle.T)
        arrow.set_data_3d(*np.array([[0, 0, 0], ARROW * force[k]]).T)
        for mark in marks:
            mark.set_xdata([t[k], t[k]])

    film = FuncAnimation(figure, show, frames=FRAMES)
    film.save(folder / "heavy_top.gif", writer=PillowWriter(fps=PER_SECOND))
    plt.close(figure)
