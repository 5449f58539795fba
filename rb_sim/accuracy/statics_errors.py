"""Errors and costs of the reactions of bodies at rest, as a table and as JSON."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rb_sim.accuracy.closed_forms.statics import ExactReactions, exact_reactions
from rb_sim.accuracy.report import machine
from rb_sim.scene.schema import Scene
from rb_sim.statics.admissible import eliminate
from rb_sim.statics.of_scene import at_rest
from rb_sim.statics.result import StaticsResult
from rb_sim.statics.solve import solve

# How exact the reactions of bodies at rest are, and what they cost.
#
# Nothing is integrated, so there is no ladder: what is left of the balance of forces and torques,
# the error against a closed form where one is known, and the time of the solution.


SPELL = 0.2
"""CPU time over which a solution is repeated [s]; the best counts."""


@dataclass(frozen=True)
class Answer:
    """One question put to the solver; errors relative to the largest load."""

    name: str
    forces: float
    """what is left of the balance of forces, of the worst body; nan without equilibrium."""
    torques: float
    """the same of torques, over the largest lever arm."""
    error: float
    """against the closed form: force of the worst support, or end of a range; nan without one."""
    cost: float
    """CPU time of one solution [s]."""


@dataclass(frozen=True)
class StaticsAccuracy:
    """What the reactions of one scene are worth."""

    scene: str
    result: StaticsResult
    exact: ExactReactions | None
    load: float
    """the largest: force, or torque over `lever` [N]."""
    lever: float
    """largest distance of a point of application from the middle of those on its body [m]."""
    answers: tuple[Answer, ...]


def measure(scene: Scene, spell: float = SPELL) -> StaticsAccuracy:
    """Solve the scene, compare with its closed form, and time it for a spell [s]."""
    system = at_rest(scene)
    load, lever = eliminate(system).force, system.lever
    result, exact = solve(scene), exact_reactions(scene)
    names = ["reactions" if result.reactions else "the verdict"]
    if result.reactions and not result.determinate:
        names.append("with their ranges")
    force, torque = (
        max((float(np.linalg.norm(part[i])) for part in result.balance.values()), default=math.nan)
        for i in (0, 1)
    )
    errors = error_of_reactions(result, exact), error_of_ranges(result, exact)
    answers = tuple(
        Answer(
            name,
            force / load,
            torque / (load * lever),
            error / load,
            cpu_time(lambda ranges=bool(i): solve(scene, ranges=ranges), spell),
        )
        for i, (name, error) in enumerate(zip(names, errors, strict=False))
    )
    return StaticsAccuracy(scene.name, result, exact, load, lever, answers)


def error_of_reactions(result: StaticsResult, exact: ExactReactions | None) -> float:
    """Of the worst support [N]; nan where nothing is known."""
    if exact is None or not result.reactions:
        return math.nan
    return max(
        float(np.linalg.norm(result.reactions[name].force - force))
        for name, force in exact.forces.items()
    )


def error_of_ranges(result: StaticsResult, exact: ExactReactions | None) -> float:
    """Of the worst end of a range of normal forces [N]; nan where nothing is known."""
    if exact is None or not exact.ranges or not result.reactions:
        return math.nan
    ends = ((result.ranges[name].along, span) for name, span in exact.ranges.items())
    return max(
        math.inf if found is None else float(np.abs(found - np.array(span)).max())
        for found, span in ends
    )


def cpu_time(act: Callable[[], object], spell: float) -> float:
    """CPU time of one call, the best of those that fit into the spell; one is made at least [s]."""
    best, total = math.inf, 0.0
    while True:
        start = time.process_time()
        act()
        spent = time.process_time() - start
        best, total = min(best, spent), total + max(spent, 1e-6)
        if total >= spell:
            return best


# What the reactions of bodies at rest are worth: a table for the terminal, and JSON.


def print_statics(accuracy: StaticsAccuracy, console: Console) -> None:
    """One line per question, then what was compared with what."""
    title = f"{accuracy.scene}: accuracy and cost of the static reactions"
    console.print(Text(title, style="italic"))
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("answer", no_wrap=True)
    for heading in ("error", "left of\nforces", "left of\ntorques", "CPU s"):
        table.add_column(heading, justify="right", no_wrap=True, min_width=7)
    for answer in accuracy.answers:
        errors = (answer.error, answer.forces, answer.torques)
        table.add_row(answer.name, *map(figure, errors), f"{answer.cost:.1e}")
    console.print(table)
    for line in words(accuracy):
        console.print(Text(line))


def figure(value: float) -> str:
    """An error, or a dash where nothing is known."""
    if math.isnan(value):
        return "–"
    return "0" if value == 0.0 else f"{value:.1e}"


def words(accuracy: StaticsAccuracy) -> list[str]:
    """What was measured, in one line each."""
    result, exact = accuracy.result, accuracy.exact
    if not result.reactions:
        return [result.explanation, "there are no reactions to measure"]
    if exact is None:
        error = "no closed form is known: only the balance of forces and torques is checked"
    else:
        error = f"error: against the closed form ({exact.name})"
    return [
        result.explanation,
        error,
        f"relative to the largest load, {accuracy.load:.6g} N (torques: times the lever, "
        f"{accuracy.lever:.3g} m); the solver's own bound is {result.accuracy:.0e}",
        "nothing is integrated, so there is no step or tolerance to choose",
    ]


def as_dict(accuracy: StaticsAccuracy) -> dict[str, Any]:
    """Everything that was measured, in plain types; what is not known becomes null."""
    return {
        "scene": accuracy.scene,
        "verdict": accuracy.result.verdict,
        "explanation": accuracy.result.explanation,
        "reference": None if accuracy.exact is None else accuracy.exact.name,
        "largest_load_N": accuracy.load,
        "lever_m": accuracy.lever,
        "bound": accuracy.result.accuracy,
        "answers": [
            {
                "name": answer.name,
                "error": known(answer.error),
                "left_of_forces": known(answer.forces),
                "left_of_torques": known(answer.torques),
                "cpu_s": answer.cost,
            }
            for answer in accuracy.answers
        ],
        "machine": machine(),
    }


def known(value: float) -> float | None:
    return value if math.isfinite(value) else None


def write_statics(accuracy: StaticsAccuracy, path: Path) -> None:
    """Write accuracy.json. Raises OSError if the file cannot be written."""
    text = json.dumps(as_dict(accuracy), indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")
