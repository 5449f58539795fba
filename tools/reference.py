# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writes the reference pages that follow from the sources: docs/reference/{scene,cli,messages}.md.

Run by `make docs`; a test sees that the pages in the tree are those of the sources.
"""

from __future__ import annotations

import inspect
import re
import sys
from pathlib import Path
from typing import Any

from typer.main import get_command

from rb_sim.catalogue import constraints, effects
from rb_sim.cli.main import app
from rb_sim.scene.schema import Body, SimulationOptions
from rb_sim.scene.shapes import AnyShape
from tools import messages
from tools.law_pages import choice_heading, choices, keys, summary, write

FOLDER = Path(__file__).parents[1] / "docs" / "reference"
BAR = r"\|"
"""A vertical bar in a cell of a table."""

MADE = "Made from the sources by `make docs`."


def pages() -> dict[str, str]:
    """Text of each page, by file name."""
    return {"scene.md": scene_page(), "cli.md": cli_page(), "messages.md": messages.page(MADE)}


def scene_page() -> str:
    """Every key of a scene file."""
    parts = [
        "# Scene schema",
        f"{MADE} SI units; W: world axes, B: body axes; quaternions are [x, y, z, w], body to"
        " world. A scene file is a YAML mapping with these sections.",
        "| section | needed | holds |\n|---|---|---|\n"
        "| `description` | optional | one line of text |\n"
        "| `bodies` | required | NAME: a body, at least one |\n"
        "| `constraints` | optional | NAME: a constraint |\n"
        "| `effects` | optional | NAME: an effect |\n"
        "| `supports`, `loads` | optional | the same in short ([Statics](../statics.md)) |\n"
        "| `simulation` | optional | method, accuracy, duration, sampling |",
        "## `bodies.NAME`",
        inspect.cleandoc(Body.__doc__ or "") + " It needs `mass`, and `shape` or `inertia`.",
        "\n".join(keys(Body)),
    ]
    for shape in choices(AnyShape):
        parts.append(choice_heading("shape", shape))
        rows = [row for row in keys(shape) if not row.startswith("| `type`")]
        parts += ["\n".join(rows)] if len(rows) > 2 else []
    for section, specs in (("constraints", constraints.SPECS), ("effects", effects.SPECS)):
        parts.append(f"## `{section}.NAME`")
        parts.append("`type` selects it; each has a page with its equation and its keys.")
        rows = [
            f"| [`{kind}`](../laws/{kind}.md) | {summary(s).replace('|', BAR)} |"
            for kind, s in specs.items()
        ]
        parts.append("\n".join(["| type | meaning |", "|---|---|", *rows]))
    parts += ["## `simulation`", "\n".join(keys(SimulationOptions))]
    return "\n\n".join(parts) + "\n"


def cli_page() -> str:
    """Every command with every option."""
    group: Any = get_command(app)
    parts = ["# Command line", MADE, inspect.cleandoc(group.help or "")]
    parts.append((group.epilog or "").strip())
    for name, command in group.commands.items():
        parts += [f"## `rb_sim {name}`", inspect.cleandoc(command.help or "")]
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join(["rb_sim", name, "[OPTIONS]", *map(_argument, arguments)])
        parts.append(f"```text\n{usage}\n```")
        rows = [_row(p) for p in command.params if p.name != "help"]
        head = ["| | default | meaning |", "|---|---|---|"]
        parts += ["\n".join([*head, *rows])] if rows else []
    return "\n\n".join(part for part in parts if part) + "\n"


def _argument(parameter: Any) -> str:
    name = _metavar(parameter)
    several = "..." if parameter.nargs == -1 else ""
    return f"{name}{several}" if parameter.required else f"[{name}{several}]"


def _metavar(parameter: Any) -> str:
    return (parameter.metavar or parameter.name.upper()).strip("{}")


def _row(parameter: Any) -> str:
    """One line of the table of a command."""
    if parameter.param_type_name == "argument":
        name = f"`{_metavar(parameter)}`"
    else:
        names = ", ".join([*parameter.opts, *parameter.secondary_opts])
        value = "" if parameter.is_flag else f" {_metavar(parameter)}"
        name = f"`{names}{value}`"
    shown = parameter.show_default
    default = shown if isinstance(shown, str) else _default(parameter)
    help_text = " ".join((parameter.help or "").split())
    cells = (name, default, help_text)
    return "| " + " | ".join(re.sub(r"(?<!\\)\|", r"\\|", cell) for cell in cells) + " |"


def _default(parameter: Any) -> str:
    value = parameter.default
    if parameter.required:
        return "required"
    if value is None or value is False or callable(value) or not is_shown(value):
        return ""
    return f"`{value}`"


def is_shown(value: Any) -> bool:
    """Whether a default is worth showing: numbers, words and paths."""
    return isinstance(value, (int, float, str, Path)) and str(value) != ""


if __name__ == "__main__":
    sys.exit(write(FOLDER, pages()))
