# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Do the tests notice?  `python -m benchmarks.mutants MODULE ...`: small faults, one at a time.

Each mutant changes one operator, comparison, constant or call of one module; tests run on it, as
plain Python, in a copy of the package: those of `--tests`, else the file or folder of tests/ that
mirrors the module.  What they pass is printed: a line that no test would miss, or a mutant that
changes nothing.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
COPIED = ("rb_sim", "tests", "benchmarks", "config", "examples", "package.xml", "pyproject.toml")
OPERATORS: dict[Any, Any] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}
COMPARISONS: dict[Any, Any] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
}  # fmt: skip
CALLS = {"add": "sub", "sub": "add", "min": "max", "max": "min", "abs": "float"}
SWAPPED = ("cross", "quaternion_product")
"""Calls whose two arguments change places."""


class Mutant(NamedTuple):
    """One fault."""

    line: int
    what: str
    source: str
    """of the whole module with it."""


def faults(node: Any) -> Iterator[tuple[str, ast.expr]]:
    """(what is changed, the node in its place)."""
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        changed = OPERATORS[type(node.op)]()
        yield "operator", ast.BinOp(node.left, changed, node.right)
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in COMPARISONS:
        changed = [COMPARISONS[type(node.ops[0])](), *node.ops[1:]]
        yield "comparison", ast.Compare(node.left, changed, node.comparators)
    elif isinstance(node, ast.BoolOp):
        other = ast.And() if isinstance(node.op, ast.Or) else ast.Or()
        yield "and/or", ast.BoolOp(other, node.values)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub | ast.Not):
        yield "sign", node.operand
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        if isinstance(node.value, bool):
            yield "constant", ast.Constant(not node.value)
        else:
            yield "constant", ast.Constant(node.value + 1)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        name = node.func.id
        if name in CALLS and not node.keywords:
            yield f"call {name}", ast.Call(ast.Name(CALLS[name], ast.Load()), node.args, [])
        elif name in SWAPPED:
            yield f"arguments of {name}", ast.Call(node.func, node.args[::-1], [])


def mutants(text: str) -> list[Mutant]:
    """All of a module's functions; thresholds and annotations are left alone."""
    functions = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef)]
    found = []
    for function in functions:
        nodes = (n for statement in function.body for n in ast.walk(statement))
        for node in (n for n in nodes if isinstance(n, ast.expr)):
            for what, new in faults(node):
                before, after = ast.unparse(node), ast.unparse(new)
                source = changed_source(text, node, after)
                reported = f"{what}: `{before}` becomes `{after}`"
                found.append(Mutant(node.lineno, reported, source))
    return found


def changed_source(text: str, node: Any, after: str) -> str:
    """The text with one expression, in brackets, in the place of another."""
    lines = text.encode().splitlines(keepends=True)
    start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
    end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
    whole = text.encode()
    return (whole[:start] + f"({after})".encode() + whole[end:]).decode()


def passes(tests: list[str], seconds: float) -> bool:
    """Whether the tests pass, in a process of their own; False where they take longer."""
    child = os.fork()
    if child == 0:
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        import pytest

        code = pytest.main(["-q", "-x", "-p", "no:cacheprovider", *tests])
        os._exit(int(code))
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.05)
    os.kill(child, 9)
    os.waitpid(child, 0)
    return False


def mirror_of(module: str) -> str:
    """tests/a/b/test_c.py of rb_sim/a/b/c.py; where there is none, the nearest folder."""
    path = Path("tests", *Path(module).parts[1:])
    mirror = path.with_name(f"test_{path.name}")
    while not (ROOT / mirror).exists():
        mirror = mirror.parent
    return str(mirror)


def run(module: str, options: argparse.Namespace) -> tuple[int, list[Mutant]]:
    """(mutants tried, those that the tests passed) of one module, in the copy."""
    text = (ROOT / module).read_text(encoding="utf-8")
    tests = options.tests or [mirror_of(module)]
    if not passes(tests, options.seconds):
        sys.exit(f"{module}: its tests fail, or take longer than {options.seconds:g} s, as it is")
    found = mutants(text)
    if len(found) > options.most:
        found = sorted(random.Random(options.seed).sample(found, options.most))
    survivors = []
    for mutant in found:
        Path(module).write_text(mutant.source, encoding="utf-8")
        if passes(tests, options.seconds):
            survivors.append(mutant)
            print(f"{module}:{mutant.line}: {mutant.what}", flush=True)
    Path(module).write_text(text, encoding="utf-8")
    return len(found), survivors


def keep_what_is_compiled(modules: list[str]) -> None:
    """Let all mutants find what the tests have compiled, though a source has changed: processes
    that are forked from this one have its name of the folder."""
    from rb_sim.compiler import program
    from rb_sim.compiler.graph import store

    program.folder(str(store.cache_root()))
    loaded = [m for m in modules if m.removesuffix(".py").replace("/", ".") in sys.modules]
    if loaded:
        sys.exit(f"{', '.join(loaded)}: imported before it is changed; use --compiled")


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("modules", nargs="+", help="files of rb_sim/")
    parser.add_argument("--tests", nargs="+", help="files, or a test as FILE::NAME")
    parser.add_argument("--most", type=int, default=10_000, help="mutants of one module")
    parser.add_argument("--seed", type=int, default=0, help="of the choice of so many")
    parser.add_argument("--compiled", action="store_true", help="run compiled, not plain Python")
    parser.add_argument(
        "--around", action="store_true",
        help="as --compiled, of modules that compile nothing: what is compiled is made once",
    )  # fmt: skip
    parser.add_argument("--seconds", type=float, default=300.0, help="of one run of the tests")
    options = parser.parse_args()
    chosen = options.modules
    os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    if not options.compiled and not options.around:
        os.environ["RB_SIM_INTERPRETED"] = "1"
    sys.dont_write_bytecode = True
    import hypothesis
    import numpy as np
    import pytest
    from scipy.spatial.transform import Rotation

    print("with", hypothesis.__name__, pytest.__name__, np.__name__, Rotation.__name__, "loaded")
    with tempfile.TemporaryDirectory() as folder:
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, Path(folder) / name)
            elif source.exists():
                shutil.copy(source, folder)
        os.environ["RB_SIM_CACHE"] = str(Path(folder) / "cache")
        os.chdir(folder)
        sys.path.insert(0, folder)
        if options.around:
            keep_what_is_compiled(chosen)
        for module in chosen:
            tried, survivors = run(module, options)
            print(f"{module}: {tried} mutants, {len(survivors)} survive", flush=True)
        os.chdir(ROOT)


if __name__ == "__main__":
    main()
