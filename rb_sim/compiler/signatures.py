"""What compiled functions take and return: arguments in their order, results as a whole."""

from __future__ import annotations

from typing import Any

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler.builder import Builder, Value
from rb_sim.compiler.kinds import Kind, KindError
from rb_sim.compiler.source import parameters_of


def in_order(function: Any, arguments: list[Value], words: dict[str, Value]) -> list[Value]:
    """The arguments as the function has its parameters, defaults filled in."""
    found = list(arguments)
    for name, default in parameters_of(function)[len(arguments) :]:
        found.append(words[name] if name in words else numbers.constant(default))
    if len(found) != len(parameters_of(function)):
        raise KindError(f"{function.__name__} takes {len(parameters_of(function))} arguments")
    return found


def result_type(kind: Kind) -> str:
    """LLVM's type of what a function returns."""
    leaves = kind.leaves
    if not leaves:
        return "void"
    return leaves[0] if len(leaves) == 1 else f"{{ {', '.join(leaves)} }}"


def taken_apart(f: Builder, whole: str, kind: Kind) -> Value:
    """The value that a function has returned as a whole."""
    if len(kind.leaves) == 1:
        return Value(kind, (whole,))
    type_ = result_type(kind)
    return Value(
        kind, tuple(f.get(f"extractvalue {type_} {whole}, {i}") for i in range(len(kind.leaves)))
    )
