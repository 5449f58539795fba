# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Counts the package and the tests: python -m tools.count

Lines are all lines of a file; code is lines with more than blanks, comments and docstrings, by
Python's own tokens. Thresholds are those of docs/thresholds.md.
"""

from __future__ import annotations

import ast
import io
import sys
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SPACE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}


def docstring_lines(tree: ast.AST) -> set[int]:
    """Lines of strings that stand as statements: docstrings and those below constants."""
    found: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                found.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return found


def code_lines(text: str) -> int:
    """Lines of code proper."""
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type not in SPACE:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - docstring_lines(ast.parse(text)))


def main() -> int:
    """Print the counts; returns 0."""
    modules: Counter[str] = Counter()
    lines: Counter[str] = Counter()
    code: Counter[str] = Counter()
    for path in sorted((ROOT / "rb_sim").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        workspace = path.relative_to(ROOT / "rb_sim").parts
        name = workspace[0] if len(workspace) > 1 else "(no package)"
        modules[name] += 1
        lines[name] += text.count("\n")
        code[name] += code_lines(text)
    print(f"{'package':15s} modules   lines    code")
    for name in sorted(modules):
        print(f"{name:15s} {modules[name]:7d} {lines[name]:7d} {code[name]:7d}")
    print(f"{'rb_sim':15s} {modules.total():7d} {lines.total():7d} {code.total():7d}")
    tests = [path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py")]
    print(f"{'tests':15s} {len(tests):7d} {sum(text.count(chr(10)) for text in tests):7d}")
    page = (ROOT / "docs" / "thresholds.md").read_text(encoding="utf-8")
    print(f"thresholds {sum(line.startswith('| `') for line in page.splitlines())}")
    folders = Counter(path.parent for path in (ROOT / "rb_sim").rglob("*.py"))
    largest, files = folders.most_common(1)[0]
    print(f"largest folder {largest.relative_to(ROOT)} with {files} files")
    return 0


if __name__ == "__main__":
    sys.exit(main())
