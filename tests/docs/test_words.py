# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plain technical English in all that users read: pages, and strings of the package."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import pytest

from tests.docs.blocks import PAGES, ROOT, name_of

WORDS = re.compile(
    r"\b[Tt]old\b|\basked for\b|\bleast reactions?\b|\bdead point|\blittle motion\b|\bstranger\b"
    r"|\bleft out\b|\bsays so\b|\bis said\b|(?:^|[.;:!|] )Of (?:a|an|the|many|what)\b"
    r"|(?:^|[.;:!|] )Where (?!.*\?)",
    re.MULTILINE,
)
"""Words with a plainer one; `docs/reference/glossary.md` has the terms."""
GENERATED = ROOT / "docs" / "thresholds.md"
"""Comments of constants, for developers."""
NOUN = re.compile(r"(?<!/)\b[Ww]hat\b(?! (?:to|if|happens if)\b)")
"""`what` as a noun: name the quantity. It may begin a question."""


def prose(page: Path) -> Iterator[tuple[int, str]]:
    """(line, text) outside of blocks of code, without code, links and formulas."""
    fenced = False
    for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
        elif not fenced and not line.startswith("    "):
            yield number, re.sub(r"`[^`]*`|\]\([^)]*\)", "", line)


def questions_out(line: str) -> str:
    """Without its headings and questions, which may ask `what`."""
    return "" if line.startswith("#") else re.sub(r"[^.|?]*\?", "", line)


@pytest.mark.parametrize("page", [page for page in PAGES if page != GENERATED], ids=name_of)
def test_pages(page):
    found = [
        (number, hit[0])
        for number, line in prose(page)
        for hit in [*WORDS.finditer(line), *NOUN.finditer(questions_out(line))]
    ]
    assert found == []


def strings(source: str) -> Iterator[tuple[int, str]]:
    """(line, text) of strings that are no docstrings: messages, help, tables, descriptions."""
    tree = ast.parse(source)
    docstrings = {
        id(node.value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) not in docstrings:
                yield node.lineno, node.value


def test_strings_of_the_package():
    found = [
        (str(path.relative_to(ROOT)), number, hit[0])
        for path in sorted((ROOT / "rb_sim").rglob("*.py"))
        for number, text in strings(path.read_text(encoding="utf-8"))
        if " " in text
        for hit in [*WORDS.finditer(text), *NOUN.finditer(questions_out(text))]
    ]
    assert found == []


def test_a_forbidden_word_is_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("It is told.\n\n```\ntold\n```\nWhat is `told`? See what acts.\n")
    hits = [hit[0] for _, line in prose(page) for hit in WORDS.finditer(line)]
    assert hits == ["told"]
    assert [len(NOUN.findall(questions_out(line))) for _, line in prose(page)] == [0, 0, 1]
    assert list(strings('"""told"""\nprint("told")\n')) == [(2, "told")]


def test_docstrings_on_the_page_of_the_api():
    """Those of the names that docs/reference/python.md lists, and of their members."""
    page = (ROOT / "docs" / "reference" / "python.md").read_text(encoding="utf-8")
    found = []
    for name in re.findall(r"^::: (\S+)$", page, re.MULTILINE):
        module, _, key = name.rpartition(".")
        of = getattr(import_module(module), key)
        members = (
            [getattr(of, key) for key in dir(of) if key[0] != "_"] if isinstance(of, type) else []
        )
        for text in {inspect.getdoc(part) or "" for part in (of, *members)}:
            found += [(name, hit[0]) for line in text.splitlines() for hit in WORDS.finditer(line)]
    assert found == []
