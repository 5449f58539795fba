# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""poles.png and bode.png: the poles of a linear model, and its frequency responses."""

from __future__ import annotations

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator

from rb_sim.base.palette import AXES, BAD, CYCLE, FAINT, GOOD, GRID, TEXT
from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING
from rb_sim.linear.state_space import LinearModel

DAMPING = (0.2, 0.4, 0.6, 0.8)
"""Ratios whose lines are drawn."""


NAMED = 8
"""Poles that are named at most."""

POINTS = 1200
"""Frequencies of a response."""

MOST_INPUTS, MOST_OUTPUTS = 3, 7
"""Columns of the Bode plots, and curves in each: the largest."""


def poles(name: str, model: LinearModel, is_steady: bool = True) -> Figure:
    """The s-plane with lines of equal damping and circles of equal natural frequency.

    is_steady: whether the motion is; else the poles hold for this instant, as the title says.
    """
    figure = Figure(figsize=(7.6, 5.6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    values: Any = model.eigenvalues
    size = model.fastest or 1.0
    width = max(1.35 * float(np.abs(values.real).max(initial=0.0)), 0.7 * size)
    height = max(1.15 * float(np.abs(values.imag).max(initial=0.0)), 0.7 * size)
    _damping_lines(axes, width, height)
    _circles(axes, width, height)
    axes.axvspan(0.0, width, color="0.95", zorder=0)
    axes.axhline(0.0, color=FAINT, lw=0.7)
    axes.axvline(0.0, color=FAINT, lw=0.7)
    axes.annotate("grows", (width, -height), xytext=(-4, 4), textcoords="offset points", ha="right",
                  fontsize=8, color=FAINT)  # fmt: skip
    counts = Counter(_rounded(value, size) for value in values)
    for value, count in counts.items():
        colour = BAD if value.real > WRITTEN_ROUNDING * size else GOOD
        axes.plot(value.real, value.imag, "x", color=colour, ms=9, mew=2.2, zorder=4)
        if count > 1:
            axes.annotate(f"{count}×", (value.real, value.imag), xytext=(-7, 7), ha="right",
                          textcoords="offset points", fontsize=8, color=colour)  # fmt: skip
    labels: dict[complex, list[str]] = {}
    for mode in model.modes[:NAMED]:
        at = _rounded(complex(mode.real, mode.imaginary), size)
        labels.setdefault(at, []).append(mode.state)
    for at, states in labels.items():
        text = "\n".join(dict.fromkeys(states))
        axes.annotate(text, (at.real, at.imag), xytext=(8, 6), textcoords="offset points",
                      fontsize=8, color=TEXT, zorder=5)  # fmt: skip
    axes.set_xlim(-width, width)
    axes.set_ylim(-height, height)
    axes.set_xlabel("real part [1/s]")
    axes.set_ylabel("imaginary part [rad/s]")
    axes.spines[["top", "right"]].set_visible(False)
    steady = "" if is_steady else ": not a steady motion, poles of this instant only"
    axes.set_title(f"{name}: poles at t = {model.t:g} s{steady}", loc="left", fontsize=11,
                   color=TEXT)  # fmt: skip
    return figure


def _rounded(value: complex, size: float) -> complex:
    """The value with parts that are rounding as 0: poles at one place are one mark."""
    return complex(*(round(part / size, 7) * size + 0.0 for part in (value.real, value.imag)))


def _damping_lines(axes: Any, width: float, height: float) -> None:
    for ratio in DAMPING:
        slope = np.sqrt(1.0 - ratio**2) / ratio
        along = min(width, height / slope)
        for side in (1.0, -1.0):
            axes.plot([0.0, -along], [0.0, side * slope * along], ":", color="0.65", lw=0.8)
        axes.annotate(f"ζ = {ratio:g}", (-along, slope * along), xytext=(2, -2), va="top",
                      textcoords="offset points", fontsize=7, color=FAINT)  # fmt: skip


def _circles(axes: Any, width: float, height: float) -> None:
    """Of equal natural frequency, in round numbers."""
    step = 10.0 ** np.floor(np.log10(max(width, height)))
    step *= 0.5 if max(width, height) < 4.0 * step else 2.0 if max(width, height) > 8 * step else 1
    angle = np.linspace(0.5 * np.pi, 1.5 * np.pi, 181)
    for radius in np.arange(step, np.hypot(width, height), step):
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=GRID, lw=0.8, zorder=1)


class Response(NamedTuple):
    """One input to one output, over frequencies."""

    output: str
    values: np.ndarray
    """complex, at the frequencies."""


def frequencies(model: LinearModel) -> np.ndarray:
    """From a tenth of the slowest pole to ten times the fastest, denser beside each [rad/s]."""
    sizes = np.abs(model.eigenvalues)
    sizes = (
        sizes[sizes > WRITTEN_ROUNDING * model.fastest] if model.fastest > 0.0 else np.array([1.0])
    )
    grid = np.geomspace(0.1 * sizes.min(), 10.0 * sizes.max(), POINTS)
    beside = 1.0 + np.concatenate([-np.geomspace(1e-4, 0.1, 25), np.geomspace(1e-4, 0.1, 25)])
    return np.unique(np.concatenate([grid, np.outer(sizes, beside).ravel()]))


def responses(model: LinearModel, at: np.ndarray) -> dict[str, list[Response]]:
    """By input the outputs that it moves, poses only, the largest first; at `at` [rad/s]."""
    rows = [k for k, name in enumerate(model.outputs)
            if name.rsplit("/", 1)[-1].split("_")[0] in ("position", "angle")]  # fmt: skip
    n = len(model.states)
    s = 1j * at[:, None, None] * np.eye(n)
    both = model.C[rows] @ np.linalg.solve(s - model.A, model.B[None]) + model.D[rows]
    largest = float(np.abs(both).max(initial=0.0))
    found: dict[str, list[Response]] = {}
    for k, name in enumerate(model.inputs):
        sizes = np.abs(both[:, :, k]).max(axis=0)
        order = [
            int(r)
            for r in np.argsort(-sizes, kind="stable")
            if sizes[r] > COMPUTED_ROUNDING * largest
        ]
        if order:
            found[name] = [Response(model.outputs[rows[r]], both[:, r, k]) for r in order]
    return found


def bode(name: str, model: LinearModel) -> Figure | None:
    """Magnitude and phase from each input to the poses that it moves; None without such a pair."""
    if not (model.inputs and model.states):
        return None
    at = frequencies(model)
    found = responses(model, at)
    ranked = sorted(found, key=lambda one: -np.abs(found[one][0].values).max())[:MOST_INPUTS]
    shown = [one for one in found if one in ranked]
    if not shown:
        return None
    outputs = list(dict.fromkeys(r.output for one in shown for r in found[one][:MOST_OUTPUTS]))
    styles = _styles(outputs)
    figure = Figure(figsize=(1.2 + 5.0 * len(shown), 6.4), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(shown), sharex=True, sharey="row", squeeze=False)
    for column, one in zip(panels.T, shown, strict=True):
        for response in found[one][:MOST_OUTPUTS]:
            column[0].loglog(at, np.abs(response.values), **styles[response.output])
            column[1].semilogx(at, phase(response.values), **styles[response.output])
        unit = "N m" if "torque" in one else "N"
        column[0].set_title(f"from {one} [{unit}]", loc="left", fontsize=10, color=TEXT)
        column[1].set_xlabel("ω [rad/s]")
        column[1].yaxis.set_major_locator(MultipleLocator(90.0))
        for axes in column:
            axes.grid(which="major", color=GRID, lw=0.7)
            axes.spines[["top", "right"]].set_visible(False)
            axes.margins(x=0)
    panels[0, 0].set_ylabel("magnitude [m or rad, per N or N m]")
    panels[1, 0].set_ylabel("phase [°]")
    handles = {h.get_label(): h for axes in panels[0] for h in axes.get_lines()}
    figure.legend(handles=[handles[o] for o in outputs], loc="outside lower center", ncols=4,
                  frameon=False, fontsize=8)  # fmt: skip
    figure.suptitle(f"{name}: frequency responses at t = {model.t:g} s", x=0.01, ha="left",
                    fontsize=11, color=TEXT)  # fmt: skip
    return figure


def _styles(outputs: list[str]) -> dict[str, dict[str, Any]]:
    """Positions solid, angles dashed; x, y and z of a single body have their colours."""
    one_body = len({output.rpartition("/")[0] for output in outputs}) == 1
    found = {}
    for k, output in enumerate(outputs):
        colour = AXES["xyz".index(output[-1])] if one_body else CYCLE[k % len(CYCLE)]
        line = "--" if output.rpartition("/")[2].startswith("angle") else "-"
        found[output] = {"color": colour, "linestyle": line, "label": output, "lw": 1.4}
    return found


def phase(values: np.ndarray) -> np.ndarray:
    """Of a response over rising frequencies, without leaps, from (-270, 90] on [degrees]."""
    turned = np.degrees(np.unwrap(np.angle(values)))
    return turned - 360.0 * np.ceil((turned[0] - 90.0) / 360.0)
