"""Lists files and functions that may have grown beyond what a reader holds in the head.

    python -m tools.signs

Signs, no laws: over 300 lines in a file, 40 in a function, 14 arguments. A test keeps the list of
those that are known: it fails where another place passes a sign, or where one of them does no more.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "rb_sim"
LINES, BODY, ARGUMENTS = 300, 40, 14


def signs() -> Iterator[tuple[str, str]]:
    """(place, what is beyond): a module, or module:function."""
    for path in sorted(PACKAGE.rglob("*.py")):
        module, text = path.relative_to(PACKAGE).as_posix(), path.read_text(encoding="utf-8")
        lines = text.count("\n")
        if lines > LINES:
            yield module, f"{lines} lines"
        for node in ast.walk(ast.parse(text)):
            if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                continue
            body = (node.end_lineno or node.lineno) - node.lineno + 1
            asked = node.args
            count = len(asked.posonlyargs) + len(asked.args) + len(asked.kwonlyargs)
            if body > BODY or count > ARGUMENTS:
                yield f"{module}:{node.name}", f"{body} lines, {count} arguments"


def main() -> int:
    for place, beyond in signs():
        print(f"{place}: {beyond}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
