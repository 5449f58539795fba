# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writes a page for each law of the catalogue from its spec: docs/laws/*.md.

Run by `make docs`; a test sees that the pages in the tree are those of the sources.
"""

from __future__ import annotations

import ast
import inspect
import sys
import textwrap
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic_core import PydanticUndefined

from rb_sim.catalogue import constraints, effects
from rb_sim.catalogue.spec import Spec
from tools.law_examples import EXAMPLES, TORQUE_ONLY

FOLDER = Path(__file__).parents[1] / "docs" / "laws"

ABOUT = {
    "type": "name of the law",
    "body": "body on which it acts",
    "parent": "other body, which gets the opposite wrench",
    "bodies": "bodies on which it acts",
}
"""Of keys that mean the same everywhere."""

SYMBOLS = """\
| symbol | meaning |
|---|---|
| C, O | centre of mass, body origin |
| $\\mathbf p$, $\\mathbf V$, $\\mathbf a$ | position, velocity, acceleration (of C by default) |
| $q$, $R$, $\\boldsymbol\\omega$ | attitude, rotation from body to world axes, angular velocity |
| $\\mathbf r_{CP}$ | vector from C to P |
| $m$, $\\mathbf I$, $J$ | mass, inertia about C, moment of inertia about the axis |
| $\\mathbf F$, $\\mathbf K$ | force, torque about C |
| $\\lambda$, $U$ | multiplier of a constraint equation, potential energy |
| index $B$, index $A$ | of the body, of its parent or the world |

A reaction acts BY the constraint ON the body; the opposite wrench acts on the parent.\
"""

MISSING = {
    "parent": "the world",
    "point_A": "from the initial pose",
    "axis_A": "from the initial pose",
    "length": "from the initial pose",
    "bodies": "all",
}
"""What null means for keys that may be left out."""


def pages() -> dict[str, str]:
    """Text of each page, by file name."""
    made: dict[str, str] = {}
    lines = [
        "# Constraints and effects",
        "",
        "Made from the sources by `make docs`; every example is a whole scene.",
        "",
        SYMBOLS,
        "",
    ]
    for heading, specs in (("Constraints", constraints.SPECS), ("Effects", effects.SPECS)):
        lines += [f"## {heading}", ""]
        for kind, spec in specs.items():
            made[f"{kind}.md"] = page(kind, spec)
            lines.append(f"- [`{kind}`]({kind}.md): {summary(spec)}")
        lines.append("")
    return {"index.md": "\n".join(lines).rstrip() + "\n", **made}


def page(kind: str, spec: type[Any]) -> str:
    """What it does, the equation, keys with units and defaults, an example."""
    parts = [f"# {kind}", inspect.cleandoc(spec.__doc__ or "")]
    parts += ["## Equation", inspect.cleandoc(spec.EQUATION).strip()]
    parts += [*about(spec), "Other symbols: [Constraints and effects](index.md)."]
    parts += ["## Keys", "\n".join(keys(spec))]
    for name, field in spec.model_fields.items():
        for choice in choices(field.annotation):
            parts.append(choice_heading(field.alias or name, choice))
            rows = [row for row in keys(choice) if not row.startswith("| `type`")]
            parts += ["\n".join(rows)] if len(rows) > 2 else []
    parts += ["## Example", f"```yaml\n{EXAMPLES[kind].strip()}\n```"]
    parts += [
        "The motion of a body with spin, without weight, and the torque of this law on it:"
        if kind in TORQUE_ONLY
        else "The motion of a body thrown with spin, under gravity and this law:",
        f"![Path of the body, and wrench of {kind} on it](pictures/{kind}.png)",
    ]
    return "\n\n".join(parts) + "\n"


def about(spec: type[Any]) -> list[str]:
    """What the module says, behind its first line, of a law that has it to itself."""
    module = inspect.getmodule(spec)
    listed = (*constraints.SPECS.values(), *effects.SPECS.values())
    alone = sum(inspect.getmodule(other) is module for other in listed) == 1
    return (inspect.getdoc(module) or "").strip().split("\n\n")[1:] if alone else []


def choices(annotation: Any) -> list[type[Any]]:
    """The specs that a value of this type may be."""
    if isinstance(annotation, type) and issubclass(annotation, Spec):
        return [annotation]
    return [choice for inner in get_args(annotation) for choice in choices(inner)]


def choice_heading(key: str, choice: type[Any]) -> str:
    """What stands above the keys of a value that is a mapping itself."""
    kind = choice.model_fields.get("type")
    named = key if kind is None else f"{key}: {{type: {get_args(kind.annotation)[0]}}}"
    return f"### `{named}`\n\n{inspect.cleandoc(choice.__doc__ or '')}"


def summary(spec: type[Any]) -> str:
    """First line of what it does."""
    return inspect.cleandoc(spec.__doc__ or "").splitlines()[0].rstrip(".")


def keys(spec: type[Any]) -> list[str]:
    """Rows of the table of keys."""
    reported = attribute_docs(spec)
    rows = ["| key | needed | default | meaning |", "|---|---|---|---|"]
    for name, field in spec.model_fields.items():
        key = field.alias or name
        need = "required" if field.is_required() else "optional"
        meaning = reported.get(name) or field.description or ABOUT.get(name, "")
        meaning = meaning.replace("] [", r"] \[")  # a unit behind a vector is no link of Markdown's
        words = [f"`{word}`" for word in words_of(field.annotation)]
        if len(words) > 1:
            meaning = f"{meaning.rstrip('.')}. One of {', '.join(words)}."
        rows.append(
            f"| `{key}` | {need} | {default(name, field)} | {meaning} |".replace("|c|", "c")
        )
    return rows


def words_of(annotation: Any) -> list[str]:
    """The words that a value of this type may be; none of numbers and mappings."""
    inner = get_args(annotation)
    if get_origin(annotation) is Literal:
        return [word for word in inner if isinstance(word, str)]
    return [word for part in inner for word in words_of(part)] if not choices(annotation) else []


def default(name: str, field: Any) -> str:
    """The default value, as it would be written in a scene."""
    if field.is_required() or field.default is PydanticUndefined:
        return ""
    value = field.default
    if value is None:
        return MISSING.get(name, "none")
    if hasattr(value, "model_dump"):
        inner = ", ".join(
            f"{k}: {plain(v)}" for k, v in value.model_dump().items() if v is not None
        )
        return f"`{{{inner}}}`"
    return f"`{plain(value)}`"


def plain(value: Any) -> str:
    """As in YAML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f"[{', '.join(plain(v) for v in value)}]"
    return f"{value:g}" if isinstance(value, float) else str(value)


def attribute_docs(spec: type[Any]) -> dict[str, str]:
    """The text below each field in the source, those of base classes included."""
    found: dict[str, str] = {}
    for base in reversed(spec.__mro__):
        if base.__module__.startswith("rb_sim"):
            found |= _docs_of(base)
    return found


def _docs_of(base: type[Any]) -> dict[str, str]:
    tree = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0]
    assert isinstance(tree, ast.ClassDef)
    found: dict[str, str] = {}
    for field, text in zip(tree.body, tree.body[1:], strict=False):
        named = isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if named and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
            assert isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
            found[field.target.id] = " ".join(str(text.value.value).split()).replace("|", "\\|")
    return found


def write(folder: Path, made: dict[str, str]) -> int:
    """Write pages, by file name; returns 0."""
    folder.mkdir(exist_ok=True)
    for name, text in made.items():
        (folder / name).write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(write(FOLDER, pages()))
