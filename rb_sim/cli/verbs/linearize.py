# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim linearize SCENE [--at T] [--out DIR]`: A, B, C, D, eigenvalues and damping."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from math import isnan
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from rb_sim.accuracy.checks.step_search import forecast_for
from rb_sim.base.errors import RbSimError, SimulationError
from rb_sim.base.rounding import COMPUTED_ROUNDING, WRITTEN_ROUNDING
from rb_sim.cli.plain import plain_console
from rb_sim.cli.verbs.scenes import with_changes
from rb_sim.equilibrium.state_space import LinearModel
from rb_sim.scene.load import load_scene
from rb_sim.simulation.outputs import writing
from rb_sim.simulation.simulation import Simulation, check_smooth

WIDEST = 8
"""Most columns of a printed matrix."""

TALLEST = 60
"""Most rows of a printed matrix."""


AXES = ("world", "body")
"""Of the states."""

LATER = 0.01
"""Time after which the model is computed again, in times of the fastest mode, or in durations of
the scene if all its eigenvalues are 0 (a pendulum let go from the horizontal)."""

STEADY = 1e-6
"""Change of A over LATER, relative to A, up to which the motion counts as steady."""


def linearize(
    scene: str | Path,
    at: float,
    axes: str,
    turning: float,
    out: Path | None,
    as_json: bool = False,
    changes: Sequence[str] = (),
) -> int:
    """Print A, B, C, D and the modes of the linear model at `at` [s], or all of it as JSON.

    With `out` also write linear_model.npz, poles.png and, for a model with inputs, bode.png.
    Returns the exit code 0. Raises RbSimError for a scene that cannot be linearised, a negative
    `at` or a folder that cannot be written; SimulationError if the motion ends before `at` or would
    take more than a year.
    """
    if not at >= 0.0:
        raise RbSimError(f"--at: got {at!r}; must be a number >= 0 [s]")
    if axes not in AXES:
        raise RbSimError(f"--axes: got {axes!r}; must be {' or '.join(AXES)}")
    simulation = Simulation(with_changes(scene, changes, load_scene))
    check_smooth(simulation.layout)  # before contacts are compiled
    forecast = forecast_for(
        simulation.scene, at, lambda line: print(f"warning: {line}", file=sys.stderr, flush=True)
    )
    if not simulation.advance(at, forecast.goes_on):
        raise SimulationError(forecast.given_up)
    model = simulation.linearize(axes, turning)
    console = plain_console()
    is_steady = steady(simulation, model, axes, turning)
    if as_json:
        print(json.dumps({"scene": simulation.scene.name, "steady": is_steady} | model.as_dict()))
    else:
        print_model(simulation.scene.name, model, console, is_steady)
    if out is not None:
        written = write(out, simulation.scene.name, model, is_steady)
        if not as_json:
            console.print(f"wrote {', '.join(map(str, written))}", markup=False)
    return 0


def write(folder: Path, name: str, model: LinearModel, is_steady: bool) -> list[Path]:
    """Write linear_model.npz, poles.png and, for a model with effective inputs, bode.png; returns
    paths."""
    from rb_sim.equilibrium import state_space as picture  # imports matplotlib, when used

    written = [folder / "linear_model.npz"]
    figures = {"poles.png": picture.poles(name, model, is_steady),
               "bode.png": picture.bode(name, model)}  # fmt: skip
    with writing(folder):
        model.to_npz(written[0])
        for file, figure in figures.items():
            if figure is not None:
                figure.savefig(folder / file)
                written.append(folder / file)
    return written


def steady(simulation: Simulation, model: LinearModel, axes: str, turning: float) -> bool:
    """Whether the linear model is constant along the motion; advances the simulation."""
    time = 1.0 / model.fastest if model.fastest else simulation.scene.simulation.duration
    simulation.advance(LATER * time)
    turned = turning * (simulation.time - model.t)
    return model.change(simulation.linearize(axes, turning), turned) <= STEADY


def print_model(name: str, model: LinearModel, console: Console, is_steady: bool = True) -> None:
    """Print states, inputs, matrices and the table of modes."""
    console.print(f"{name} at t = {model.t:g} s", style="bold", markup=False)
    console.print(f"states   {', '.join(model.states) or 'none'}", markup=False)
    inputs = ", ".join(model.inputs) or "none (effect commanded_wrench makes some)"
    console.print(f"inputs   {inputs}", markup=False)
    console.print(f"outputs  {len(model.outputs)}: poses, twists, reactions", markup=False)
    print_matrices(model, console)
    table = Table(title="Modes", title_justify="left")
    units = "real\n[1/s]", "imaginary\n[rad/s]", "frequency\n[Hz]", "damping", "mostly", "stability"
    for heading in units:
        left = heading in ("mostly", "stability")
        table.add_column(heading, justify="left" if left else "right", no_wrap=True)
    fastest = model.fastest
    for mode in model.modes:
        grows = mode.real > WRITTEN_ROUNDING * fastest
        figures = [
            0.0 if abs(x) <= WRITTEN_ROUNDING * size else x
            for x, size in (
                (mode.real, fastest),
                (mode.imaginary, fastest),
                (mode.frequency, fastest),
                (mode.damping, 1.0),
            )
        ]
        note = "grows" if grows and is_steady else ""
        # NaN: a mode at zero has no damping
        cells = ("" if isnan(x) else f"{x:.6g}" for x in figures)
        table.add_row(*cells, mode.state, note)
    console.print(table)
    if not is_steady:
        console.print(
            "The motion is not steady in these axes: the model holds at this instant only, and its "
            "eigenvalues do not show whether deviations grow. Start the scene in an equilibrium at "
            "rest; for a steady motion try --axes body or --turning."
        )


def print_matrices(model: LinearModel, console: Console) -> None:
    """Print A, B, C, D, one line per row; a matrix that is too large only with its size."""
    for name, rows in (("A", "states"), ("B", "states"), ("C", "outputs"), ("D", "outputs")):
        matrix, labels = getattr(model, name), getattr(model, rows)
        if not matrix.size:
            continue
        if matrix.shape[1] > WIDEST or matrix.shape[0] > TALLEST:
            console.print(f"{name}  {matrix.shape[0]} x {matrix.shape[1]}: see --json")
            continue
        least = COMPUTED_ROUNDING * float(np.abs(matrix).max())
        matrix, width = np.where(np.abs(matrix) <= least, 0.0, matrix), max(map(len, labels))
        shown = [
            (label, row)
            for label, row in zip(labels, matrix, strict=True)
            if row.any() or name == "A"
        ]
        zero = len(labels) - len(shown)
        console.print(f"{name}{f' ({zero} rows of zeros not shown)' if zero else ''}", style="bold")
        for label, row in shown:
            numbers = " ".join(f"{value:11.5g}" for value in row)
            console.print(f"  {label:{width}} {numbers}", markup=False)
