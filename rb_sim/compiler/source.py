"""The syntax tree of a function, and what the names in it mean."""

from __future__ import annotations

import ast
import builtins
import inspect
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any


@cache
def _functions_in(path: str) -> dict[tuple[int, str], ast.FunctionDef]:
    """The functions of a file by their first line (a decorator's, where there is one) and name."""
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read(), path)
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            first = min([node.lineno, *(d.lineno for d in node.decorator_list)])
            found[first, node.name] = node
    return found


def tree_of(function: FunctionType) -> ast.FunctionDef:
    """The syntax tree of a function."""
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
    """The meaning of names that the function does not assign: closure, module, builtins."""
    space = {**vars(builtins), **function.__globals__}
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        space[name] = cell.cell_contents
    return space


def plain_function(value: Any) -> FunctionType | None:
    """The Python function that a call of the value runs: itself, or what it wraps; None of none."""
    while not isinstance(value, FunctionType):
        inner = getattr(value, "function", None)
        if inner is None or isinstance(value, (type, ModuleType)):
            return None
        value = inner
    wrapped = getattr(value, "compiled_as", None)
    return value if wrapped is None else wrapped
