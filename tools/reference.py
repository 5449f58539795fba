# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writes the reference pages that follow from the sources: scene, cli, node and messages in
docs/reference.

Run by `make docs`; a test sees that the pages in the tree are those of the sources.
"""

from __future__ import annotations

import inspect
import json
import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

from typer.main import get_command

from rb_sim.catalogue import constraints, effects
from rb_sim.cli.main import app
from rb_sim.ros.parameters import Settings
from rb_sim.scene.schema import Body, SimulationOptions
from rb_sim.scene.shapes import AnyShape
from tools import messages
from tools.law_pages import choice_heading, choices, keys, summary, write

FOLDER = Path(__file__).parents[1] / "docs" / "reference"
BAR = r"\|"
"""A vertical bar in a cell of a table."""

MADE = "Made from the sources by `make docs`."
TYPES = {str: "string", bool: "bool", int: "integer", float: "double"}
"""Names of ROS for types of parameters."""


def pages() -> dict[str, str]:
    """Text of each page, by file name."""
    return {
        "scene.md": scene_page(),
        "cli.md": cli_page(),
        "node.md": node_page(),
        "messages.md": messages.page(MADE),
    }


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
        "| `supports`, `loads` | optional | constraints and effects in a short form"
        " ([Statics](../statics.md)) |\n"
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
    parts = ["# Commands and options", MADE, _prose(group.help)]
    parts.append(_prose(group.epilog))
    for name, command in group.commands.items():
        parts += [f"## `rb_sim {name}`", _prose(command.help)]
        arguments = [p for p in command.params if p.param_type_name == "argument"]
        usage = " ".join(["rb_sim", name, "[OPTIONS]", *map(_argument, arguments)])
        parts.append(f"```text\n{usage}\n```")
        rows = [_row(p) for p in command.params if p.name != "help"]
        head = ["| argument, option | default | meaning |", "|---|---|---|"]
        parts += ["\n".join([*head, *rows])] if rows else []
    return "\n\n".join(part for part in parts if part) + "\n"


def _prose(text: str | None) -> str:
    """Options in it as code: others would break at their hyphens, or become dashes."""
    option = re.compile(r"`[^`]*`|(?<![\w-])--[a-z][a-z-]*")
    return option.sub(lambda hit: f"`{hit[0].strip('`')}`", inspect.cleandoc(text or "").strip())


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
    help_text = _prose(" ".join((parameter.help or "").split()))
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


def node_page() -> str:
    """Every parameter of the node."""
    head = ["| parameter | type | default | allowed | meaning |", "|---|---|---|---|---|"]
    rows = [_parameter(known) for known in fields(Settings)]
    return "\n\n".join(
        [
            "# Parameters of the node",
            f"{MADE} Topics and services: [the node](../node.md). Set one with `--ros-args -p"
            " NAME:=VALUE`, or all in a file with `--ros-args --params-file FILE`;"
            " `config/rb_sim_node.params.yaml` is one with the defaults. Those marked *live* may"
            " change while the node runs (`ros2 param set /rb_sim NAME VALUE`).",
            "\n".join([*head, *rows]),
        ]
    ) + "\n"  # fmt: skip


def _parameter(known: Any) -> str:
    """One line of the table."""
    about = known.metadata
    allowed = ", ".join(f"`{choice}`" for choice in about["choices"] if choice)
    if about["low"] is not None:
        allowed = f"{about['low']:g} to {about['high']:g}"
    shown = json.dumps(known.default)
    name = f"`{known.name}`" + (" *live*" if about["live"] else "")
    cells = (name, TYPES[type(known.default)], f"`{shown}`", allowed, about["description"])
    return "| " + " | ".join(cell.replace("|", BAR) for cell in cells) + " |"


if __name__ == "__main__":
    sys.exit(write(FOLDER, pages()))
