# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Results of a ladder, and the balance of reactions at rest: terminal tables, JSON, accuracy.png.

The picture shows the error in pose, in reaction, and the energy drift against CPU time.
"""

from __future__ import annotations

import math
import platform
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rb_sim.accuracy.choice import Setting
from rb_sim.accuracy.ladder import OUT_OF_TIME, Accuracy, Ladder, Rung
from rb_sim.accuracy.runs import cpu_time
from rb_sim.base.palette import FAINT, GRID, TEXT, of_method
from rb_sim.base.plain_data import finite
from rb_sim.equilibrium.equilibrium import eliminate
from rb_sim.equilibrium.statics import solve
from rb_sim.equilibrium.statics_of_scene import at_rest
from rb_sim.equilibrium.statics_tables import StaticsResult
from rb_sim.scene.schema import Scene

# The cheapest setting for each error: Pareto front and decades.


def front(points: Sequence[tuple[float, float]]) -> list[int]:
    """Indices of the Pareto-optimal points (error, cost), by falling error."""
    order = sorted(range(len(points)), key=lambda i: (points[i][1], points[i][0]))
    kept: list[int] = []
    for i in order:
        error, cost = points[i]
        if math.isfinite(error) and math.isfinite(cost):
            if not kept or error < points[kept[-1]][0]:
                kept.append(i)
    return kept


class Decade(NamedTuple):
    """The cheapest setting within one error."""

    error: float
    best: Rung | None
    """None: no setting reaches it."""
    factors: dict[str, float]
    """cost relative to the best, for each ladder that reaches the error."""


def decades(accuracy: Accuracy, last: int = -15) -> list[Decade]:
    """For each decade of global error from 0.1 to the floor: the cheapest setting, others' factors.

    The last line has no setting: that error is below the floor, or nothing reached it.
    """
    table = []
    for exponent in range(-1, last - 1, -1):
        error = 10.0**exponent
        if error < accuracy.reference.floor:
            table.append(Decade(error, None, {}))
            break
        cheapest = {
            ladder.name: rung
            for ladder in accuracy.ladders
            if (rung := cheapest_within(ladder.rungs, error)) is not None
        }
        if not cheapest:
            table.append(Decade(error, None, {}))
            break
        best = min(cheapest.values(), key=lambda rung: rung.cost)
        factors = {name: rung.cost / best.cost for name, rung in cheapest.items()}
        table.append(Decade(error, best, factors))
    return table


def cheapest_within(rungs: Sequence[Rung], error: float) -> Rung | None:
    """The cheapest rung whose global error is at most `error`."""
    able = [rung for rung in rungs if rung.errors.pose <= error and math.isfinite(rung.cost)]
    return min(able, key=lambda rung: rung.cost, default=None)


def print_report(accuracy: Accuracy, console: Console, target: float | None = None) -> None:
    """Print the cheapest setting, and the cost of the other methods, for each decade of error."""
    lines = decades(accuracy, last=last_decade(target))
    reached = {name for decade in lines for name in decade.factors}
    names = shown(lines, [ladder.name for ladder in accuracy.ladders if ladder.name in reached])
    title = f"{accuracy.scene}: cost of each global error over {accuracy.duration:g} s"
    console.print(Text(title, style="italic"))
    table = Table(
        box=box.SIMPLE_HEAD,  # all of it fits a terminal of 80 columns
        pad_edge=False,
        padding=0,
    )
    table.add_column("global\nerror\nrad, m", justify="right", no_wrap=True, min_width=6)
    table.add_column("cheapest", no_wrap=True)
    table.add_column("CPU s\nper s", justify="right", no_wrap=True, min_width=7)
    for name in names:
        table.add_column(heading(name), justify="right", no_wrap=True)
    for decade in lines:
        if decade.best is None:
            why = (
                "not measurable"
                if decade.error < accuracy.reference.floor
                else "not reached (--budget)"
            )
            table.add_row(f"{decade.error:.0e}", why, "", *[""] * len(names), style="dim")
            continue
        factors = [_factor(decade.factors.get(name)) for name in names]
        setting = short(decade.best.setting)
        table.add_row(f"{decade.error:.0e}", setting, f"{decade.best.cost:.2g}", *factors)
    console.print(table)
    key = "s: fixed step; tol: local tolerance; ×: cost relative to the cheapest; –: not reached"
    console.print(Text(key, style="dim"))
    console.print(Text(accuracy.reference.words))
    for ladder in accuracy.ladders:
        if ladder.name not in names or ladder.end == OUT_OF_TIME:
            console.print(Text(ending(ladder), style="dim"))
    if target is not None:
        console.print(Text(target_line(accuracy, target), style="bold"))


MOST_COLUMNS = 5
"""Maximum number of columns of factors in a terminal of 80 columns."""


def shown(lines: Sequence[Any], names: list[str]) -> list[str]:
    """The methods with a column; if there are too many, those that reach most decades."""
    counts = {name: sum(name in decade.factors for decade in lines) for name in names}
    kept = sorted(names, key=lambda name: -counts[name])[:MOST_COLUMNS]
    return [name for name in names if name in kept]


def heading(name: str) -> str:
    """Heading of a column of factors: the method, and its form if it has two."""
    method, _, form = name.partition(" ")
    short_form = {"fixed": "step", "adaptive": "tol"}.get(form, form)
    return "\n".join(filter(None, (*method.replace("_", "_ ").split(), short_form)))


def short(setting: Setting) -> str:
    """A method and its step [s] or tolerance."""
    if setting.step is not None:
        return f"{setting.name} {setting.step:.3g} s"
    return f"{setting.name} tol {setting.tolerance:.0e}"


def ending(ladder: Ladder) -> str:
    """The smallest error of a method, and why its ladder ended."""
    if not ladder.rungs:
        return f"{ladder.name} did not run: {ladder.end}"
    best = min(rung.errors.pose for rung in ladder.rungs)
    reached = (
        f"stopped at {best:.1e}" if math.isfinite(best) else "did not reach the end of the run"
    )
    return f"{ladder.name} {reached}: {ladder.end}"


def last_decade(target: float | None) -> int:
    """Exponent of the last decade of the table."""
    return -15 if target is None else math.floor(math.log10(target) + 1e-9)


def _factor(value: float | None) -> Text:
    if value is None:
        return Text("–", style="dim")
    if value < 1.005:
        return Text("1", style="bold green")
    digits = 1 if value < 99.95 else 0
    return Text(f"{value:.{digits}f}×" if value < 9999.5 else ">10⁴×")


def target_line(accuracy: Accuracy, target: float) -> str:
    """The setting for the scene that keeps the target."""
    best = cheapest_within(accuracy.rungs, target)
    if target < accuracy.reference.floor:
        return (
            f"{target:g} is below the smallest error measurable for this scene, "
            f"{accuracy.reference.floor:.1e}"
        )
    if best is None:
        return f"{target:g} was not reached within --budget; raise it"
    knob = "step" if best.setting.step is not None else "tolerance"
    return (
        f"for {target:g}: {{method: {best.setting.name}, {knob}: {best.setting.knob:.6g}}} costs "
        f"{best.cost:.2g} CPU s per s, global error {best.errors.pose:.1e} (rad, m); "
        f"or set {{method: auto, tolerance: {target:g}}}"
    )


def as_dict(accuracy: Accuracy, target: float | None = None) -> dict[str, Any]:
    """All results in plain types; infinite values become null."""
    true = accuracy.reference
    return {
        "scene": accuracy.scene,
        "duration_s": accuracy.duration,
        "target": target,
        "reference": {
            "kind": true.kind,
            "checked_by": true.check,
            "agreement": finite(true.agreement._asdict()),
            "ulp_growth": finite(true.ulp_growth._asdict()),
            "floor": finite(true.floors._asdict()),
            "words": true.words,
        },
        "ladders": [
            {"name": ladder.name, "end": ladder.end, "rungs": [_rung(r) for r in ladder.rungs]}
            for ladder in accuracy.ladders
        ],
        "decades": [
            {
                "error": decade.error,
                "best": None if decade.best is None else _rung(decade.best),
                "factors": finite(decade.factors),
            }
            for decade in decades(accuracy, last=last_decade(target))
        ],
        "seconds_spent": accuracy.spent,
        "machine": machine(),
    }


def machine() -> dict[str, str]:
    """Machine and versions of the measurement."""
    return {
        "processor": platform.processor() or platform.machine(),
        "system": platform.system(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "llvmlite": llvmlite.__version__,
    }


def _rung(rung: Rung) -> dict[str, Any]:
    return {
        "method": rung.setting.name,
        "step_s": rung.setting.step,
        "tolerance": rung.setting.tolerance,
        "steps": rung.steps,
        **finite(rung.errors._asdict()),
        "cpu_s_per_s": finite(rung.cost),
    }


# How exact the reactions of bodies at rest are, and what they cost.
#
# Nothing is integrated, so there is no ladder: what is left of the balance of forces and torques,
# the bound of the solver, and the time of the solution.


SPELL = 0.2
"""CPU time for which a solution is repeated [s]; the best time counts."""


@dataclass(frozen=True)
class Answer:
    """One quantity of a statics solution; errors relative to the largest load."""

    name: str
    forces: float
    """largest residual of a body's force balance; nan without equilibrium."""
    torques: float
    """largest residual of a body's torque balance, divided by the largest lever arm."""
    cost: float
    """CPU time of one solution [s]."""


@dataclass(frozen=True)
class StaticsAccuracy:
    """Errors and times of the static reactions of one scene."""

    scene: str
    result: StaticsResult
    load: float
    """largest force, or torque divided by `lever` [N]."""
    lever: float
    """largest distance of a point of application from the mean of those on its body [m]."""
    answers: tuple[Answer, ...]


def measure(scene: Scene, spell: float = SPELL) -> StaticsAccuracy:
    """Solve the scene, measure the balance of its bodies, and time it for `spell` [s]."""
    system = at_rest(scene)
    load, lever = eliminate(system).force, system.lever
    result = solve(scene)
    names = ["reactions" if result.reactions else "the verdict"]
    if result.reactions and not result.determinate:
        names.append("with their ranges")
    force, torque = (
        max((float(np.linalg.norm(part[i])) for part in result.balance.values()), default=math.nan)
        for i in (0, 1)
    )
    answers = tuple(
        Answer(
            name,
            force / load,
            torque / (load * lever),
            cpu_time(lambda ranges=bool(i): solve(scene, ranges=ranges), spell),
        )
        for i, name in enumerate(names)
    )
    return StaticsAccuracy(scene.name, result, load, lever, answers)


def print_statics(accuracy: StaticsAccuracy, console: Console) -> None:
    """Print one line per quantity, then what they are."""
    title = f"{accuracy.scene}: accuracy and cost of the static reactions"
    console.print(Text(title, style="italic"))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("answer", no_wrap=True)
    for heading in ("left of\nforces", "left of\ntorques", "CPU s"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=7)
    for answer in accuracy.answers:
        left = (answer.forces, answer.torques)
        table.add_row(answer.name, *map(figure, left), f"{answer.cost:.1e}")
    console.print(table)
    for line in words(accuracy):
        console.print(Text(line))


def figure(value: float) -> str:
    """An error, or a dash if it is not known."""
    if math.isnan(value):
        return "–"
    return "0" if value == 0.0 else f"{value:.1e}"


def words(accuracy: StaticsAccuracy) -> list[str]:
    """Explanations of the measured quantities, one line each."""
    result = accuracy.result
    if not result.reactions:
        return [result.explanation, "there are no reactions to measure"]
    return [
        result.explanation,
        f"relative to the largest load, {accuracy.load:.6g} N (torques: times the lever, "
        f"{accuracy.lever:.3g} m); the solver's own bound is {result.accuracy:.0e}",
        "nothing is integrated, so there is no step or tolerance to choose",
    ]


def statics_as_dict(accuracy: StaticsAccuracy) -> dict[str, Any]:
    """All results in plain types; unknown values become null."""
    return {
        "scene": accuracy.scene,
        "verdict": accuracy.result.verdict,
        "explanation": accuracy.result.explanation,
        "largest_load_N": accuracy.load,
        "lever_m": accuracy.lever,
        "bound": accuracy.result.accuracy,
        "answers": [
            {
                "name": answer.name,
                "left_of_forces": finite(answer.forces),
                "left_of_torques": finite(answer.torques),
                "cpu_s": answer.cost,
            }
            for answer in accuracy.answers
        ],
        "machine": machine(),
    }


MARKS = {
    "euler": "*",
    "rk4": "^",
    "dopri853": "s",
    "gauss6": "D",
    "radau5": "v",
    "taylor": "o",
    "time_stepping": "P",
}
"""Markers of methods, so that curves differ without colours."""

FIXED, ADAPTIVE = (0, (4, 2)), "-"
"""Line styles of fixed steps, whose marks are hollow, and of adaptive methods."""

USELESS = 1.0
"""Error [rad, m, relative] above which a run shows nothing of the motion; only the last such point
of a curve is drawn."""

BAND = "#E3E3E3"
"""Colour of the region below the floor."""

QUANTITIES = (
    ("pose", "global error: rotation [rad] or centre [m]"),
    ("reaction", "reactions, relative to the largest"),
    ("energy", "energy drift, relative to the energy exchanged"),
)


def save_picture(accuracy: Accuracy, path: Path, target: float | None = None) -> None:
    """Write the work-precision diagrams of all methods. Raises OSError if it cannot be written."""
    diagrams(accuracy, target).savefig(path)


def diagrams(accuracy: Accuracy, target: float | None = None) -> Figure:
    """The figure: panels for the pose, for reactions if there are any, and for the energy."""
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
    """Caption: the reference of the errors, and methods without a usable run."""
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
    """Draw one panel: a line per method, rings on the Pareto front, the floor shaded."""
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
    """(error, cost) of the rungs from the last USELESS one to the first that reaches the floor,
    where it is drawn: errors below the floor are those of the reference."""
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
    """Whether the error of a rung is below USELESS."""
    return bool(drawable(ladder, "pose", 0.0))
