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

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#7F5539", "#444444")
"""Okabe and Ito's colours, told apart with any colour vision."""

MARKS = "osD^vPX*"
TEXT = "#333333"
QUANTITIES = (
    ("pose", "global error: rotation [rad] or centre [m]"),
    ("reaction", "reactions, relative to the largest"),
    ("energy", "energy drift, relative to the energy exchanged"),
)


def save_picture(accuracy: Accuracy, path: Path, target: float | None = None) -> None:
    """Draw the work-precision diagrams of all methods. Raises OSError if it cannot be written."""
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
    axes[0].set_ylabel("largest over the run", color=TEXT)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="lower center", ncols=len(labels), frameon=False, fontsize=9,
        bbox_to_anchor=(0.5, 0.06), columnspacing=1.4, handletextpad=0.5,
    )  # fmt: skip
    figure.suptitle(
        f"{accuracy.scene}: what accuracy costs over {accuracy.duration:g} s",
        x=0.012, ha="left", fontsize=13, color=TEXT,
    )  # fmt: skip
    figure.text(0.012, 0.015, footnote(accuracy), fontsize=7.5, color="#666666")
    figure.tight_layout(rect=(0, 0.115, 1, 0.98))
    figure.savefig(path)


def footnote(accuracy: Accuracy) -> str:
    true = accuracy.reference
    return (
        f"Errors against {true.kind}; {true.check} agrees to {true.agreement.pose:.0e}, one ulp at "
        f"the start grows to {true.ulp_growth.pose:.0e} (dotted).\n"
        "CPU time of stepping alone, best of several runs."
    )


def draw(axis: Any, accuracy: Accuracy, quantity: str) -> None:
    """One panel: a line per method, the Pareto front ringed, the floor shaded."""
    points: list[tuple[float, float]] = []
    for i, ladder in enumerate(accuracy.ladders):
        line = drawable(ladder, quantity)
        points += line
        if line:
            axis.plot(
                [cost for _, cost in line], [error for error, _ in line],
                color=COLOURS[i % len(COLOURS)], marker=MARKS[i % len(MARKS)], markersize=4.5,
                linewidth=1.3, label=ladder.name, zorder=3,
            )  # fmt: skip
    best = [points[i] for i in front(points)]
    floor = getattr(accuracy.reference.floors, quantity)
    axis.plot(
        [cost for _, cost in best], [error for error, _ in best],
        color="#222222", linewidth=7, alpha=0.14, solid_capstyle="round", zorder=1,
    )  # fmt: skip
    axis.scatter(
        [cost for _, cost in best], [error for error, _ in best], s=58, facecolors="none",
        edgecolors="#222222", linewidths=0.9, zorder=4, label="Pareto front",
    )  # fmt: skip
    axis.set_xscale("log")
    axis.set_yscale("log")
    if not points:  # the time given was too short for any method: an empty panel, but a panel
        axis.set_xlim(1e-6, 1.0)
    top = 10.0
    floor = min(floor, top)  # infinite where the scene could not be run twice to its end
    lowest = min([floor, *(error for error, _ in points if error >= 1e-3 * floor)])
    bottom = 10.0 ** math.floor(math.log10(lowest) - 0.5)
    axis.set_ylim(bottom, top)
    axis.axhspan(bottom, floor, color="#B0B0B0", alpha=0.35, linewidth=0, zorder=0)
    name = "chaos or instability" if floor > 1e-6 else "round-off"
    axis.annotate(
        f"{name} {floor:.0e}", (0.02, floor), xycoords=("axes fraction", "data"),
        xytext=(0, -4), textcoords="offset points", va="top", fontsize=8, color="#555555", zorder=5,
    )  # fmt: skip
    grown = getattr(accuracy.reference.ulp_growth, quantity)
    if grown > bottom:
        axis.axhline(grown, color="#777777", linewidth=0.9, linestyle=":", zorder=1)
    axis.set_xlabel("CPU seconds per simulated second", color=TEXT)
    axis.yaxis.set_major_locator(LogLocator(base=100.0, numticks=12))
    axis.grid(True, which="major", color="#E4E4E4", linewidth=0.7)
    axis.tick_params(colors=TEXT, labelsize=9, which="both")
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)


def drawable(ladder: Ladder, quantity: str) -> list[tuple[float, float]]:
    """(error, cost) of the rungs that a logarithmic scale can show."""
    pairs = ((getattr(rung.errors, quantity), rung.cost) for rung in ladder.rungs)
    return [
        (max(error, 1e-17), cost)
        for error, cost in pairs
        if math.isfinite(error) and math.isfinite(cost) and error < 10.0
    ]
