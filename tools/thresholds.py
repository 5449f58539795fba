# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Writes the page of all thresholds from the sources: docs/thresholds.md.

Run by `make docs`; a test sees that the page in the tree is that of the sources.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PACKAGE, PAGE = ROOT / "rb_sim", ROOT / "docs" / "thresholds.md"

LARGEST = 1e-5
"""Number up to which a named constant is taken for a threshold."""

NONE_OF_THEM = {
    ("accuracy/choice.py", "REDUCED"), ("accuracy/choice.py", "BODY"),
    ("accuracy/choice.py", "ROW"), ("accuracy/choice.py", "SOLVE"),
    ("accuracy/choice.py", "OPEN_ROW"), ("accuracy/choice.py", "SWEEP"),  # seconds of CPU
    ("bags/info.py", "NANO"),  # a unit
    ("scene/schema.py", "DEFAULT_TOLERANCE"),  # accuracies to ask
    ("simulation/sensitivity.py", "TOLERANCE"),
    ("bags/fit/unknowns.py", "TOLERANCE"),
    ("motion/motion.py", "FIRST_PIECE"),  # a length to begin with
    ("bags/fit/unknowns.py", "STEP"), ("sweeps/slopes.py", "LEAST_SIDE"),  # lengths of differences
    ("mechanics/contact/contact_bodies.py", "NUDGE"),
}  # fmt: skip
"""Small constants that decide nothing."""

HEAD = """\
---
search: {exclude: true}
---

# Thresholds

Made from the sources by `make docs`: all named constants up to 1e-5 by which the package decides
between two cases. Each row states to what the constant is relative; *natural units* are made of the
length and the speed of the scene.

Whether constraint equations depend on each other is decided in one file, `numerics/rank.py`, after
they are scaled to length 1, so that neither units nor mass ratios influence it.
"""


class Threshold(NamedTuple):
    """A named constant."""

    module: str
    name: str
    value: float
    meaning: str
    """its docstring on one line, "" without one."""


@cache
def thresholds() -> tuple[Threshold, ...]:
    """All of them, by module."""
    return tuple(_thresholds())


def _thresholds() -> Iterator[Threshold]:
    for path in sorted(PACKAGE.rglob("*.py")):
        module = path.relative_to(PACKAGE).as_posix()
        body = ast.parse(path.read_text(encoding="utf-8")).body
        for i, node in enumerate(body):
            for name, value in small_constants(node):
                if (module, name) not in NONE_OF_THEM:
                    yield Threshold(module, name, value, meaning(body[i + 1 :]))


def small_constants(node: ast.stmt) -> Iterator[tuple[str, float]]:
    """Names and sizes of what an assignment at the top of a module says, if it is a number."""
    if not isinstance(node, ast.Assign):
        return
    for target in node.targets:
        pairs = [(target, node.value)]
        if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
            pairs = list(zip(target.elts, node.value.elts, strict=True))
        for name, number in pairs:
            if isinstance(number, ast.UnaryOp):
                number = number.operand
            value = number.value if isinstance(number, ast.Constant) else None
            if isinstance(name, ast.Name) and isinstance(value, float) and 0.0 < value <= LARGEST:
                yield name.id, value


def meaning(following: list[ast.stmt]) -> str:
    """The docstring after an assignment, which may be that of several."""
    for node in following:
        if isinstance(node, ast.Assign):
            continue
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            return " ".join(str(node.value.value).split())
        break
    return ""


def page() -> str:
    """The text of the page."""
    parts = [HEAD]
    of_package = groupby(thresholds(), lambda found: found.module.split("/")[0])
    for package, found in of_package:
        rows = [
            f"| `{one.module}` | `{one.name}` | {one.value:g} | {reported(one.meaning)} |"
            for one in found
        ]
        head = "| module | name | value | what it decides |\n|---|---|---|---|"
        parts.append(f"## {package.removesuffix('.py')}\n\n{head}\n" + "\n".join(rows) + "\n")
    return "\n".join(parts)


def reported(text: str) -> str:
    """As a cell of a table, which begins with a capital."""
    return (text[:1].upper() + text[1:]).replace("|", "\\|")


def main() -> int:
    PAGE.write_text(page(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
