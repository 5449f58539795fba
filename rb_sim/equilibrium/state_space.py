# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A linear model x' = A x + B f, y = C x + D f with named components, and its plots.

poles.png shows the poles of the model, bode.png its frequency responses.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from scipy.linalg import matrix_balance, null_space, qr

from rb_sim.base.names import first_few
from rb_sim.base.palette import AXES, BAD, CYCLE, FAINT, GOOD, GRID, TEXT
from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING
from rb_sim.mechanics.samples import Array


class Mode(NamedTuple):
    """One eigenvalue of A, or a complex pair."""

    real: float
    """[1/s]; the mode grows if it is positive."""
    imaginary: float
    """[rad/s], >= 0."""
    frequency: float
    """eigenvalue| / 2 pi [Hz]; nan for a real eigenvalue, which does not oscillate."""
    damping: float
    """damping ratio - real / |eigenvalue|; nan for the eigenvalue 0."""
    state: str
    """the state with the largest component in the mode."""


@dataclass(frozen=True, repr=False)
class LinearModel:
    """Small deviations from a motion, in minimal coordinates on the constraint manifold.

    A state BODY/position_x is the deviation of the centre of mass, BODY/angle_x that of the
    orientation (a small rotation vector), BODY/velocity_x and BODY/spin_x the deviations of the
    linear and the angular velocity, all in the axes that were requested. Deviations that
    the constraints determine by the others are not states; they are among the outputs.
    """

    t: float
    """Instant of the motion [s]."""
    A: Array
    """Matrix of the states, shape (n, n)."""
    B: Array
    """Matrix of the inputs, shape (n, m)."""
    C: Array
    """Outputs by states, shape (p, n)."""
    D: Array
    """Outputs by inputs, shape (p, m)."""
    states: tuple[str, ...]
    """Names of the states, n."""
    inputs: tuple[str, ...]
    """Names of the commanded forces [N] and torques [N m] about the body origin, m."""
    outputs: tuple[str, ...]
    """Names of the outputs, p: pose and twist of every body, then force [N] and torque [N m] of
    every reaction (world axes)."""

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        found = first_few([f"{value:.4g}" for value in self.eigenvalues], most=8)
        return f"<LinearModel at t = {self.t:g} s: {sizes}; eigenvalues {found or 'none'} 1/s>"

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, complex [1/s], fastest growth first; multiple zeros are exactly 0."""
        return np.array([value for value, _ in self._eigen], complex)

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Eigenvalues with frequency and damping; one entry per complex pair and per zero."""
        found = []
        for value, state in self._eigen:
            if value.imag >= 0.0:
                size, nan = abs(value), float("nan")
                frequency = size / (2.0 * np.pi) if value.imag > 0.0 else nan
                damping = -value.real / size if size > 0.0 else nan
                found.append(Mode(value.real, value.imag, frequency, damping, self.states[state]))
        return tuple(found)

    @cached_property
    def _eigen(self) -> list[tuple[complex, int]]:
        """Each eigenvalue with the state of the largest component in its mode.

        A multiple zero (a free body along x: position and velocity) would come out of a solver as a
        pair of about 1e-8, so zeros are removed first by repeated null spaces. So would a multiple
        eigenvalue on the imaginary axis (the motion of a free body in axes that turn): a real part
        is 0 if the rounding of A may have made it, i.e. if A is that near to a matrix with the
        eigenvalue on the axis.
        """
        if not self.states:
            return []
        found: list[tuple[complex, int]] = []
        basis, left = np.eye(len(self.A)), np.array(self.A, float)
        while left.size:
            zero: Any = null_space(left, rcond=COMPUTED_ROUNDING)
            if not zero.shape[1]:
                break
            factors: Any = qr((basis @ zero).T, mode="r", pivoting=True)
            order = factors[1]
            found += [(0j, int(k)) for k in order[: zero.shape[1]]]
            rest: Any = null_space(zero.T)
            basis, left = basis @ rest, rest.T @ left @ rest
        values: Any = np.linalg.eigvals(left) if left.size else []
        balanced: Any = matrix_balance(left)[0] if left.size else left
        for value in map(complex, values):
            from_axis = balanced - 1j * value.imag * np.eye(len(left))
            distance = np.linalg.svd(from_axis, compute_uv=False)[-1]
            if distance <= COMPUTED_ROUNDING * np.linalg.norm(balanced):
                value = 1j * value.imag
            near = np.linalg.svd(self.A - value * np.eye(len(self.A)))[2][-1]
            found.append((value, int(np.argmax(np.abs(near)))))
        return sorted(found, key=lambda mode: (-mode[0].real, -mode[0].imag))

    @property
    def fastest(self) -> float:
        """Largest absolute eigenvalue [1/s]; 0 without states."""
        return float(np.max(np.abs(self.eigenvalues), initial=0.0))

    def change(self, later: LinearModel, turned: float = 0.0) -> float:
        """Largest difference between the rates of deviations here and a little later on the motion,
        relative to them, the axes having turned about z by `turned` [rad].

        If it is not 0, the motion is not steady in these axes, and eigenvalues at one instant do
        not show whether deviations grow. The choice of the states does not matter.
        """
        here, there = self._deviations(), later._deviations()
        c, s = math.cos(turned), math.sin(turned)
        turn = np.kron(np.eye(len(here) // 3), [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        chosen = [later.outputs.index(state) for state in later.states]
        moved = (turn @ here)[chosen]
        rates = turn.T @ there @ later.A @ moved
        size = float(np.max(np.abs(self.A), initial=0.0))
        off = float(np.max(np.abs(turn.T @ there @ moved - here), initial=0.0))
        change = float(np.max(np.abs(rates - here @ self.A), initial=0.0))
        return max(off, change / size) if size else 0.0

    def _deviations(self) -> Array:
        """Matrix from the states to the deviations of all bodies, shape (12 N, n)."""
        kinds = [name.rsplit("/", 1)[1].split("_")[0] for name in self.outputs]
        return self.C[: sum(kind not in ("force", "torque") for kind in kinds)]

    def as_dict(self) -> dict[str, Any]:
        """A, B, C, D as lists with their names, t and the modes; None for undefined values."""
        plain: dict[str, Any] = {"t": self.t}
        plain |= {name: list(getattr(self, name)) for name in ("states", "inputs", "outputs")}
        plain |= {name: getattr(self, name).tolist() for name in "ABCD"}
        modes = [mode._asdict() for mode in self.modes]
        plain["modes"] = [{k: None if v != v else v for k, v in mode.items()} for mode in modes]
        return plain

    def to_npz(self, path: str | PathLike[str]) -> None:
        """Write A, B, C, D, their names, t and the eigenvalues to a numpy archive.

        Compatible with python-control: control.ss(f["A"], f["B"], f["C"], f["D"]).
        """
        names: dict[str, Any] = {
            key: np.array(getattr(self, key), dtype=str) for key in ("states", "inputs", "outputs")
        }
        np.savez_compressed(
            path,
            A=self.A,
            B=self.B,
            C=self.C,
            D=self.D,
            **names,
            eigenvalues=self.eigenvalues,
            t=np.array(self.t),
        )


DAMPING = (0.2, 0.4, 0.6, 0.8)
"""Damping ratios whose lines are drawn."""


NAMED = 8
"""Maximum number of labelled poles."""

POINTS = 1200
"""Number of frequencies of a response."""

MOST_INPUTS, MOST_OUTPUTS = 3, 7
"""Maximum number of columns (inputs) of the Bode plot, and of curves in each, the largest."""


def poles(name: str, model: LinearModel, is_steady: bool = True) -> Figure:
    """Plot of the s-plane with lines of equal damping and circles of equal natural frequency.

    is_steady: whether the motion is steady; else the title states that poles hold for this instant
    only.
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
    """The value with parts below rounding set to 0, so that coinciding poles become one mark."""
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
    """Draw circles of equal natural frequency at round values."""
    step = 10.0 ** np.floor(np.log10(max(width, height)))
    step *= 0.5 if max(width, height) < 4.0 * step else 2.0 if max(width, height) > 8 * step else 1
    angle = np.linspace(0.5 * np.pi, 1.5 * np.pi, 181)
    for radius in np.arange(step, np.hypot(width, height), step):
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), color=GRID, lw=0.8, zorder=1)


class Response(NamedTuple):
    """Frequency response from one input to one output."""

    output: str
    values: np.ndarray
    """complex, at the given frequencies."""


def frequencies(model: LinearModel) -> np.ndarray:
    """Frequencies [rad/s], 0.1 times the slowest to 10 times the fastest pole, denser near
    poles."""
    sizes = np.abs(model.eigenvalues)
    sizes = (
        sizes[sizes > WRITTEN_ROUNDING * model.fastest] if model.fastest > 0.0 else np.array([1.0])
    )
    grid = np.geomspace(0.1 * sizes.min(), 10.0 * sizes.max(), POINTS)
    beside = 1.0 + np.concatenate([-np.geomspace(1e-4, 0.1, 25), np.geomspace(1e-4, 0.1, 25)])
    return np.unique(np.concatenate([grid, np.outer(sizes, beside).ravel()]))


def responses(model: LinearModel, at: np.ndarray) -> dict[str, list[Response]]:
    """Responses of the pose outputs to each input, largest first, at frequencies `at` [rad/s]."""
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
    """Bode plot from each input to the poses that respond; None if there is none."""
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
    """Line styles: positions solid, angles dashed; axis colours for a single body."""
    one_body = len({output.rpartition("/")[0] for output in outputs}) == 1
    found = {}
    for k, output in enumerate(outputs):
        colour = AXES["xyz".index(output[-1])] if one_body else CYCLE[k % len(CYCLE)]
        line = "--" if output.rpartition("/")[2].startswith("angle") else "-"
        found[output] = {"color": colour, "linestyle": line, "label": output, "lw": 1.4}
    return found


def phase(values: np.ndarray) -> np.ndarray:
    """Continuous phase over increasing frequencies, starting in (-270, 90] [degrees]."""
    turned = np.degrees(np.unwrap(np.angle(values)))
    return turned - 360.0 * np.ceil((turned[0] - 90.0) / 360.0)
