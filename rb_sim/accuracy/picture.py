# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""accuracy.png: error in pose, in reaction, and energy drift against CPU time."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator

from rb_sim.accuracy.ladder import Accuracy, Ladder
from rb_sim.accuracy.report import front
from rb_sim.base.palette import FAINT, GRID, TEXT, of_method

MARKS = {
    "euler": "*",
    "rk4": "^",
    "dopri853": "s",
    "gauss6": "D",
    "radau5": "v",
    "taylor": "o",
    "time_stepping": "P",
}
"""Of methods, so that curves differ without colours, too."""

FIXED, ADAPTIVE = (0, (4, 2)), "-"
"""Lines of methods with a fixed step, whose marks are hollow, and with a tolerance."""

USELESS = 1.0
"""Error [rad, m, relative] from which on a run shows nothing of the motion: of a curve that begins
above it the last such point is drawn."""

BAND = "#E3E3E3"
"""Below the floor."""

QUANTITIES = (
    ("pose", "global error: rotation [rad] or centre [m]"),
    ("reaction", "reactions, relative to the largest"),
    ("energy", "energy drift, relative to the energy exchanged"),
)


def save_picture(accuracy: Accuracy, path: Path, target: float | None = None) -> None:
    """Write the work-precision diagrams of all methods. Raises OSError if it cannot be written."""
    diagrams(accuracy, target).savefig(path)


def diagrams(accuracy: Accuracy, target: float | None = None) -> Figure:
    """The figure: a panel for the pose, one for reactions if there are any, one for the energy."""
    shown = [q for q in QUANTITIES if q[0] != "reaction" or accuracy.layout.reactions]
    figure = Figure(figsize=(1.0 + 4.3 * len(shown), 5.6), dpi=150)
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, len(shown), squeeze=False, sharex=True)[0]
    for axis, (quantity, title) in zip(axes, shown, strict=True):
        draw(axis, accuracy, quantity)
        axis.set_title(title, fontsize=10, color=TEXT, loc="left")
    if target is not None:
        axes[0].axhline(target, color=TEXT, linewidth=0.8, linestyle=(0, (4, 3)))
        axes[0].annotate(
            "target", (1.0, target), xycoords=("axes fraction", "data"), xytext=(-3, 3),
            textcoords="offset points", ha="right", fontsize=8, color=TEXT,
        )  # fmt: skip
    axes[0].set_ylabel("largest error over the run", color=TEXT)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=len(labels), frameon=False, fontsize=9,
        bbox_to_anchor=(0.5, 0.06), columnspacing=1.4, handletextpad=0.5,
    )  # fmt: skip
    figure.suptitle(
        f"{accuracy.scene}: error against CPU time over {accuracy.duration:g} s",
        x=0.012, ha="left", fontsize=13, color=TEXT,
    )  # fmt: skip
    figure.text(0.012, 0.015, footnote(accuracy), fontsize=7.5, color=FAINT)
    figure.tight_layout(rect=(0, 0.115, 1, 0.98))
    return figure


def footnote(accuracy: Accuracy) -> str:
    """What the errors are measured against, and which methods have no usable run."""
    true = accuracy.reference
    names = ", ".join(ladder.name for ladder in accuracy.ladders if not usable(ladder))
    nothing = f" Without a usable run: {names}." if names else ""
    return (
        f"Errors against {true.kind}; {true.check} agrees to {true.agreement.pose:.0e}; one ulp "
        f"at the start grows to {true.ulp_growth.pose:.0e} (dotted). Points on the grey band are "
        "at or below the floor.\n"
        "Dashed, hollow: fixed step; solid, filled: tolerance. CPU time of stepping alone, best of "
        f"several runs.{nothing}"
    )


def draw(axis: Any, accuracy: Accuracy, quantity: str) -> None:
    """One panel: a line per method, the Pareto front ringed, the floor shaded."""
    top = math.sqrt(10.0) * USELESS
    # infinite where the scene could not be run twice to its end
    floor = min(getattr(accuracy.reference.floors, quantity), top)
    points: list[tuple[float, float]] = []
    for ladder in filter(usable, accuracy.ladders):
        line = drawable(ladder, quantity, floor)
        points += line
        method, colour = ladder.name.split()[0], of_method(ladder.name)
        fixed = any(rung.setting.step is not None for rung in ladder.rungs)
        axis.plot(
            [cost for _, cost in line], [error for error, _ in line],
            color=colour, marker=MARKS.get(method, "X"), markersize=5,
            markerfacecolor="white" if fixed else colour,
            linestyle=FIXED if fixed else ADAPTIVE, linewidth=1.3, label=ladder.name, zorder=3,
        )  # fmt: skip
    best = [points[i] for i in front(points) if points[i][0] < USELESS]
    axis.scatter(
        [cost for _, cost in best], [error for error, _ in best], s=70, facecolors="none",
        edgecolors=TEXT, linewidths=0.8, zorder=4, label="cheapest for its error",
    )  # fmt: skip
    axis.set_xscale("log")
    axis.set_yscale("log")
    if not points:  # the time given was too short for any method: an empty panel, but a panel
        axis.set_xlim(1e-6, 1.0)
    bottom = 10.0 ** math.floor(math.log10(floor) - 1.2)
    axis.set_ylim(bottom, top)
    axis.axhspan(bottom, floor, color=BAND, linewidth=0, zorder=0)
    grown = getattr(accuracy.reference.ulp_growth, quantity)
    if grown > bottom:
        axis.axhline(grown, color="#777777", linewidth=0.9, linestyle=":", zorder=1)
    name = "chaos or instability" if floor > 1e-6 else "round-off"
    axis.annotate(
        f"{name} {floor:.0e}", (0.02, bottom), xycoords=("axes fraction", "data"),
        xytext=(0, 4), textcoords="offset points", va="bottom", fontsize=8, color=TEXT, zorder=5,
        bbox={"facecolor": BAND, "edgecolor": "none", "pad": 1.5},  # the dotted line ends at it
    )  # fmt: skip
    axis.set_xlabel("CPU seconds per simulated second", color=TEXT)
    axis.yaxis.set_major_locator(LogLocator(base=100.0, numticks=12))
    axis.grid(True, which="major", color=GRID, linewidth=0.7)
    axis.tick_params(colors=TEXT, labelsize=9, which="both")
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def drawable(ladder: Ladder, quantity: str, floor: float) -> list[tuple[float, float]]:
    """(error, cost) of the rungs that say something: from the last useless one to the first that
    reaches the floor, on which it is drawn. Below it figures are those of the reference."""
    found: list[tuple[float, float]] = []
    for rung in ladder.rungs:
        error = getattr(rung.errors, quantity)
        if not (math.isfinite(error) and math.isfinite(rung.cost)):
            continue
        if error >= USELESS and all(before >= USELESS for before, _ in found):
            found.clear()
        found.append((max(error, floor), rung.cost))
        if error <= floor:
            break
    return [] if all(error >= USELESS for error, _ in found) else found


def usable(ladder: Ladder) -> bool:
    """Whether a run of it shows anything of the motion."""
    return bool(drawable(ladder, "pose", 0.0))
