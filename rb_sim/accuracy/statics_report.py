"""What the reactions of bodies at rest are worth: a table for the terminal, and JSON."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from rb_sim.accuracy.report import machine
from rb_sim.accuracy.statics import StaticsAccuracy


def print_statics(accuracy: StaticsAccuracy, console: Console) -> None:
    """One line per question, then what was compared with what."""
    title = f"{accuracy.scene}: how exact the reactions of bodies at rest are, and what they cost"
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
