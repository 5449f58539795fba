# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""`rb_sim explain SCENE [--out DIR]`: parts of a scene and the CPU time of each per step."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rb_sim.accuracy.costs import Cost, Explanation, Item, RunCost
from rb_sim.accuracy.costs import explain as explain_scene
from rb_sim.base.errors import AccuracyWarning
from rb_sim.base.plain_data import write_json
from rb_sim.cli.plain import plain_console, progress
from rb_sim.cli.verbs.scenes import with_changes
from rb_sim.scene.load import load_scene
from rb_sim.scene.schema import Scene
from rb_sim.simulation.outputs import writing

NO_PRICE = "-"


def explain(scene: str | Path, out: Path | None = None, changes: Sequence[str] = ()) -> int:
    """Print bodies, constraints, degrees of freedom, effects, method and measured costs.

    scene: YAML file, or name of a shipped scene. out: folder for explain.json, created if absent.
    changes: KEY=VALUE of the scene.

    Returns the exit code 0. Raises RbSimError for a scene that cannot be simulated or a folder
    that cannot be written.
    """
    described = with_changes(scene, changes, load_scene)
    with progress() as show:
        result = explain_scene(described, show, cost_of_run)
    console = plain_console()
    print_explanation(result, console)
    if out is not None:
        with writing(out):
            write_json(asdict(result), out / "explain.json")
        console.print(f"wrote {out / 'explain.json'}")
    return 0


def cost_of_run(scene: Scene) -> RunCost:
    """CPU time [s] of the scene's run without and with accuracy checks, compilation excluded."""
    from rb_sim.simulation.simulation import Simulation

    simulation = Simulation(scene, announce=None)
    spent: dict[bool, float] = {}
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore", AccuracyWarning)
        for checks in (True, False, True):
            simulation.reset()
            began = time.process_time()
            simulation.run(checks=checks)
            spent[checks] = time.process_time() - began
    return RunCost(spent[False], spent[True])


OPENING = ("contact", "string")
"""Types of constraints that may open and close."""


def print_explanation(result: Explanation, console: Console) -> None:
    """Print the parts of a scene and the cost of each as a table."""
    masses = ", ".join(f"{name} ({mass:g} kg)" for name, mass in result.bodies)
    console.print(Text.assemble((f"{result.scene}: ", "bold"), masses))
    if result.indeterminate:
        determinacy = "not determined by statics: " + ", ".join(result.indeterminate)
    else:
        determinacy = "all reactions determined" if result.rows else "no reactions"
    freedom = counted(result.degrees_of_freedom, "degree", "of freedom")
    console.print(f"{freedom}{at_start(result)}, {rows_of(result)}, {determinacy}", soft_wrap=True)
    console.print(f"coordinates  {result.coordinates}", markup=False)
    console.print(Text(f"method       {result.choice or result.method}"))
    table = Table(title="Measured cost of a step", title_justify="left")
    for heading in ("", "type", "on"):
        table.add_column(heading, no_wrap=True)
    for heading in ("equations", "ns per step", "±"):
        table.add_column(heading, justify="right", no_wrap=True)
    _add_items(table, result.constraints)
    _add_items(table, result.effects)
    table.add_row("the whole step", "", "", "", *figures(result.step), style="bold")
    console.print(table)
    console.print(
        Text(
            f"Cost of a part: CPU time of a step of {result.step_length:.3g} s with it minus "
            "without it, median of interleaved runs, ± half the interquartile range.",
            style="dim",
        )
    )
    for line in notes(result):
        console.print(Text(line, style="dim"))
    missing = ("constraints", result.absent_constraints), ("effects", result.absent_effects)
    for what, names in missing:
        console.print(Text(f"absent {what}, not compiled and free: {', '.join(names)}"))


def at_start(result: Explanation) -> str:
    """Note that the degrees of freedom count the initially closed contacts; empty without
    contacts."""
    return " with the contacts of the start" if opening(result) else ""


def opening(result: Explanation) -> int:
    """Number of rows of constraints that may open."""
    return sum(entry.rows for entry in result.constraints if entry.type in OPENING)


def rows_of(result: Explanation) -> str:
    """Text of the number of constraint rows; those of closed contacts separately."""
    more = opening(result)
    rows = counted(result.rows - more, "constraint equation")
    if not more:
        return rows
    if result.rows == more:
        return f"{counted(more, 'constraint equation')} of closed contacts"
    return f"{rows} and {more} of closed contacts"


def counted(number: int, what: str, rest: str = "") -> str:
    """Number with a noun in singular or plural: 1 degree of freedom, 2 degrees of freedom."""
    return f"{number} {what}{'' if number == 1 else 's'} {rest}".rstrip()


def notes(result: Explanation) -> list[str]:
    """Lines that explain the figures: unmeasured costs, range of the measurement, events."""
    lines = []
    items = (*result.constraints, *result.effects)
    lines += [
        f"{entry.name}: cost not measurable: {entry.reason}."
        for entry in items
        if entry.cost is None
    ]
    events = result.events
    if result.seen_until < result.duration:
        lines.append(
            f"Measured up to t = {result.seen_until:.3g} s of {result.duration:g} s: a run ends "
            "there or takes too long."
        )
    if result.run is not None:
        without, checked = result.run.unchecked, result.run.checked
        lines.append(
            f"A run takes {without:.2g} s, or {checked:.2g} s with its accuracy checks, "
            "which include "
            "a second run for the global error (--no-check omits it)."
        )
    if events is not None:
        lines.append(
            f"Steps are measured between events, from t = {result.measured_from:.3g} s on; "
            "the cost of "
            "a part includes that of the contacts that it keeps closed."
        )
        steps = counted(round(events.nanoseconds / result.step.nanoseconds), "step")
        if events.count and not events.nanoseconds > 0.0:
            lines.append(
                f"Cost of {counted(events.count, 'event')}: not measurable (small compared with "
                "the steps)."
            )
        elif events.count:
            lines.append(
                f"Cost of {counted(events.count, 'event')}: "
                f"{1e-6 * events.nanoseconds:.2g} ms each (location, impacts, choice of modes), "
                f"as much as {steps}."
            )
        else:
            lines.append("The scene has no event after its start.")
    return lines


def _add_items(table: Table, items: Sequence[Item]) -> None:
    for i, entry in enumerate(items):
        rows = str(entry.rows) if entry.rows else ""
        last = i == len(items) - 1
        cells = (entry.name, entry.type, entry.on, rows, *figures(entry.cost))
        table.add_row(*cells, end_section=last)


def figures(cost: Cost | None) -> tuple[str, str]:
    """Median and spread of a cost [ns] as the cells of a row."""
    if cost is None:
        return NO_PRICE, ""
    return f"{cost.nanoseconds:.0f}", f"{cost.spread:.0f}"
