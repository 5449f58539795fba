"""A graph as a function in C, to be used outside: `python -m tools.c_law SCENE` prints one.

The operations stand in the order of the graph, one a line; a compiler that joins none of them (no
fused multiply-add) gives the numbers of the machine code of `emit`, except that sines and the like
are those of its own library.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rb_sim.graph.symbols import INPUTS, Condition, Symbol, in_order

_OPERATION = {
    "add": "{} + {}",
    "sub": "{} - {}",
    "mul": "{} * {}",
    "div": "{} / {}",
    "neg": "-{}",
    "lt": "{} < {}",
    "le": "{} <= {}",
    "and": "{} && {}",
    "or": "{} || {}",
    "not": "!{}",
    "select": "{} ? {} : {}",
    "rarely": "{} ? {} : {}",
}


def c_function(name: str, outputs: Sequence[Any]) -> str | None:
    """void name(double t, const double *y, const double *p, double *out), with its headers.

    outputs: symbols of one graph and numbers. None where the graph calls functions by address.
    """
    order = in_order(outputs)
    if any(x.op == "call" for x in order):
        return None
    head = f"void {name}(double t, const double *y, const double *p, double *out)"
    lines = ["#include <math.h>", "#include <stdbool.h>", "", head, "{"]
    for x in order:
        if x.op not in INPUTS:
            kind = "bool" if isinstance(x, Condition) else "double"
            lines.append(f"    const {kind} v{x.number} = {_operation(x)};")
    lines += [f"    out[{i}] = {_operand(x)};" for i, x in enumerate(outputs)]
    return "\n".join([*lines, "}", ""])


def _operation(x: Symbol) -> str:
    operands = [_operand(o) for o in x.operands]
    if x.op in _OPERATION:
        return _OPERATION[x.op].format(*operands)
    return f"{x.op}({', '.join(operands)})"  # of C's library


def _operand(x: Any) -> str:
    if not isinstance(x, Symbol):
        return _number(x)
    if x.op in INPUTS:
        return "t" if x.op == "t" else f"{x.op}[{x.operands[0]}]"
    return f"v{x.number}"


def _number(x: float) -> str:
    """The number without rounding, in parentheses where it is not finite or below zero."""
    if x != x:
        return "(0.0 / 0.0)"
    if x - x != 0.0:
        return "(1.0 / 0.0)" if x > 0.0 else "(-1.0 / 0.0)"
    return repr(float(x)) if str(float(x))[0] != "-" else f"({float(x)!r})"
