# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Source of a function to compile: syntax tree, names, arguments and results."""

from __future__ import annotations

import ast
import builtins
import inspect
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler.builder import Builder, Kind, KindError, Value

# The syntax tree of a function, and the objects behind its names.


@cache
def _functions_in(path: str) -> dict[tuple[int, str], ast.FunctionDef]:
    """The functions of a file by first line (of a decorator, if there is one) and name."""
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read(), path)
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            found[first, node.name] = node
    return found


def tree_of(function: FunctionType) -> ast.FunctionDef:
    """The syntax tree of a function. Raises TypeError if it has no source."""
    code: CodeType = function.__code__
    try:
        return _functions_in(code.co_filename)[code.co_firstlineno, code.co_name]
    except (KeyError, OSError):
        raise TypeError(f"{function.__qualname__}: no source to compile it from") from None


@cache
def parameters_of(function: Any) -> tuple[tuple[str, Any], ...]:
    """(name, default or inspect.Parameter.empty) of each parameter."""
    return tuple((p.name, p.default) for p in inspect.signature(function).parameters.values())


def names_of(function: FunctionType) -> dict[str, Any]:
    """Objects behind names that the function does not assign: closure, module, builtins."""
    space = {**vars(builtins), **function.__globals__}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        space[name] = cell.cell_contents
    return space


def plain_function(value: Any) -> FunctionType | None:
    """The Python function that a call of the value runs: itself, or the one it wraps; else None."""
    while not isinstance(value, FunctionType):
        inner = getattr(value, "function", None)
        if inner is None or isinstance(value, (type, ModuleType)):
            return None
        value = inner
    wrapped = getattr(value, "compiled_as", None)
    return value if wrapped is None else wrapped


# Arguments in the order of the parameters, and results.


def in_order(function: Any, arguments: list[Value], words: dict[str, Value]) -> list[Value]:
    """The arguments in the order of the parameters, with defaults. Raises KindError if some are
    missing."""
    found = list(arguments)
    for name, default in parameters_of(function)[len(arguments) :]:
        found.append(words[name] if name in words else numbers.constant(default))
    if len(found) != len(parameters_of(function)):
        raise KindError(f"{function.__name__} takes {len(parameters_of(function))} arguments")
    return found


def result_type(kind: Kind) -> str:
    """LLVM return type of a function with a result of this kind."""
    leaves = kind.leaves
    if not leaves:
        return "void"
    return leaves[0] if len(leaves) == 1 else f"{{ {', '.join(leaves)} }}"


def taken_apart(f: Builder, whole: str, kind: Kind) -> Value:
    """The value of a result, from the name of the returned LLVM aggregate."""
    if len(kind.leaves) == 1:
        return Value(kind, (whole,))
    type_ = result_type(kind)
    return Value(
        kind, tuple(f.get(f"extractvalue {type_} {whole}, {i}") for i in range(len(kind.leaves)))
    )
