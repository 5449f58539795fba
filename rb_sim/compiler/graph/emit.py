# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A graph as text: LLVM IR in pieces of bounded length, Python source, or a function in C."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from rb_sim.compiler.graph.symbols import INPUTS, Condition, External, Symbol, in_order

PIECE = 4000
"""Most operations of one function."""

_DOUBLE = struct.Struct(">d")
RARELY = '!0 = !{!"branch_weights", i32 1, i32 1000000}'
_BINARY = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv"}
_COMPARE = {"lt": "olt", "le": "ole"}


def constant(x: float) -> str:
    """The number as an LLVM constant, exactly."""
    return f"0x{_DOUBLE.pack(x).hex().upper()}"


class Pieces:
    """The operations of the outputs, cut into pieces; `frame` counts the numbers passed between
    pieces.

    operations: those to be cut, in order, if others are computed elsewhere; None: all.
    """

    def __init__(
        self, outputs: Sequence[Any], piece: int = 0, operations: Sequence[Symbol] | None = None
    ) -> None:
        self.outputs, piece = outputs, piece or PIECE
        if operations is None:
            operations = [x for x in in_order(outputs) if x.op not in INPUTS]
        order = list(operations)
        self.parts = [order[i : i + piece] for i in range(0, len(order), piece)] or [[]]
        self.part_of = {x.number: k for k, part in enumerate(self.parts) for x in part}
        self.slots: dict[int, int] = {}
        self.frame = 0
        cut = len(self.parts) > 1
        for k, part in enumerate(self.parts):
            for x in part:
                if x.op == "call":
                    self._reserve(x, x.operands[0].results)
                for o in x.operands if cut else ():
                    if isinstance(o, Symbol) and self.part_of.get(o.number, k) != k:
                        self._reserve(o, 1)

    def _reserve(self, x: Symbol, count: int) -> None:
        if x.number not in self.slots:
            self.slots[x.number] = self.frame
            self.frame += count

    def part_of_output(self, x: Any) -> int:
        """Index of the piece that writes an output; arguments and numbers belong to the first."""
        return self.part_of.get(x.number, 0) if isinstance(x, Symbol) else 0

    @property
    def externals(self) -> list[External]:
        """External functions that the graph calls, each once."""
        calls = (x.operands[0] for part in self.parts for x in part if x.op == "call")
        return list(dict.fromkeys(calls))


def modules(pieces: Pieces) -> list[str]:
    """LLVM IR of the law, one text per module."""
    if len(pieces.parts) == 1:
        return [Piece(pieces, 0).module(whole=True)]
    texts = [Piece(pieces, k).module() for k in range(len(pieces.parts))]
    arguments = "double %t, ptr %y, ptr %p, ptr %out"
    declared, calls = [], []
    for k in range(len(pieces.parts)):
        declared.append(f"declare void @piece{k}(double, ptr, ptr, ptr, ptr)")
        calls.append(f"  call void @piece{k}({arguments}, ptr %frame)")
    body = [
        f"define void @law({arguments}) {{",
        _array("%frame", pieces.frame),
        *calls,
        "  ret void",
        "}",
    ]
    return [*texts, "\n".join([*declared, *body, ""])]


def _array(name: str, count: int) -> str:
    """Instruction that reserves an array of `count` numbers on the stack."""
    return f"  {name} = alloca [{max(1, count)} x double], align 16"


class Operations:
    """Writer of operations on values of one LLVM type: numbers, or vectors of them."""

    kind, truth, true, suffix = "double", "i1", "true", "f64"
    """LLVM's types of a value and of a condition, its constant true, and the suffix of intrinsic
    functions."""
    intrinsic: tuple[str, ...] = ("sqrt", "sin", "cos", "fabs", "floor")

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.names: dict[int, str] = {}
        """names of the results by the numbers of their symbols."""
        self.declared: set[str] = set()

    def line(self, text: str) -> str:
        """Write one instruction; returns the name of its result."""
        name = f"%v{len(self.lines)}"
        self.lines.append(f"  {name} = {text}")
        return name

    def operation_on(self, x: Symbol, a: list[str]) -> str:
        """Write an operation on operands with these names; returns the name of its result."""
        if x.op in _BINARY:
            return self.line(f"{_BINARY[x.op]} {self.kind} {a[0]}, {a[1]}")
        if x.op == "neg":
            return self.line(f"fneg {self.kind} {a[0]}")
        if x.op in _COMPARE:
            return self.line(f"fcmp {_COMPARE[x.op]} {self.kind} {a[0]}, {a[1]}")
        if x.op in ("and", "or"):
            return self.line(f"{x.op} {self.truth} {a[0]}, {a[1]}")
        if x.op == "not":
            return self.line(f"xor {self.truth} {a[0]}, {self.true}")
        if x.op in ("select", "rarely"):
            return self.selected(x, *a)
        if x.op in self.intrinsic:
            name = f"llvm.{x.op}.{self.suffix}"
            self.declared.add(f"declare {self.kind} @{name}({self.kind})")
            return self.called(name, a)
        return self.by_library(x.op, a)

    def selected(self, x: Symbol, condition: str, one: str, other: str) -> str:
        """Write a selection: `one` if the condition holds, else `other`."""
        odds = ", !prof !0" if x.op == "rarely" and self.truth == "i1" else ""
        values = f"{self.kind} {one}, {self.kind} {other}"
        return self.line(f"select {self.truth} {condition}, {values}{odds}")

    def called(self, name: str, a: list[str]) -> str:
        """Write a call of a function of values; returns the name of its result."""
        return self.line(f"call {self.kind} @{name}({', '.join(f'{self.kind} {v}' for v in a)})")

    def by_library(self, name: str, a: list[str]) -> str:
        """Write a call of a function of the C library; returns the name of its result."""
        self.declared.add(f"declare double @{name}({', '.join(['double'] * len(a))})")
        return self.called(name, a)


class Piece(Operations):
    """Writer of one piece as a function."""

    def __init__(self, pieces: Pieces, number: int) -> None:
        super().__init__()
        self.pieces, self.number = pieces, number

    def module(self, whole: bool = False) -> str:
        """LLVM IR of the function as a module; `whole`: it is the entire law."""
        names, slots = self.names, self.pieces.slots
        for x in self.pieces.parts[self.number]:
            names[x.number] = self.operation(x)
            if slots and x.op != "call" and x.number in slots:
                value = names[x.number]
                if isinstance(x, Condition):  # a condition becomes 1.0 or 0.0
                    value = self.line(f"uitofp i1 {value} to double")
                self.store(value, "%frame", slots[x.number])
        for i, x in enumerate(self.pieces.outputs):
            if self.pieces.part_of_output(x) == self.number:
                self.store(self.value(x), "%out", i)
        name, frame = ("law", "") if whole else (f"piece{self.number}", ", ptr noalias %frame")
        head = (
            f"define void @{name}(double %t, ptr noalias readonly %y, "
            f"ptr noalias readonly %p, ptr noalias %out{frame}) nounwind {{"
        )
        if whole and self.pieces.frame:
            self.lines.insert(0, _array("%frame", self.pieces.frame))
        lines = [*sorted(self.declared), head, *self.lines, "  ret void", "}", RARELY, ""]
        return "\n".join(lines)

    def place(self, base: str, index: int) -> str:
        """Name of the address of the number at an index."""
        return self.line(f"getelementptr double, ptr {base}, i64 {index}")

    def load(self, base: str, index: int) -> str:
        """Load the number at an index."""
        return self.line(f"load double, ptr {self.place(base, index)}, align 8")

    def store(self, value: str, base: str, index: int) -> None:
        """Store a number at an index."""
        at = self.place(base, index)
        self.lines.append(f"  store double {value}, ptr {at}, align 8")

    def value(self, x: Any) -> str:
        """Name of an operand in this function, loaded if it is an input or from another piece."""
        if not isinstance(x, Symbol):
            return constant(x)
        name = self.names.get(x.number)
        if name is None:
            name = self.names[x.number] = self.from_outside(x)
        return name

    def from_outside(self, x: Symbol) -> str:
        """Load an input, or the result of another piece from the frame."""
        if x.op == "t":
            return "%t"
        if x.op in INPUTS:
            return self.load(f"%{x.op}", x.operands[0])
        loaded = self.load("%frame", self.pieces.slots[x.number])
        if isinstance(x, Condition):
            return self.line(f"fcmp one double {loaded}, {constant(0.0)}")
        return loaded

    def operation(self, x: Symbol) -> str:
        """Write one operation; returns the name of its result."""
        if x.op in _BINARY:  # nearly all of a law
            a, b = x.operands
            return self.line(f"{_BINARY[x.op]} {self.kind} {self.value(a)}, {self.value(b)}")
        if x.op == "call":
            return self.call(x)
        if x.op == "item":
            call, index = x.operands
            return self.load("%frame", self.pieces.slots[call.number] + index)
        return self.operation_on(x, [self.value(o) for o in x.operands])

    def call(self, x: Symbol) -> str:
        """Write a call by address: arguments in a local array, results in the frame."""
        function, *arguments = x.operands
        start = self.line(f"alloca [{max(1, len(arguments))} x double], align 16")
        for i, argument in enumerate(arguments):
            self.store(self.value(argument), start, i)
        results = self.place("%frame", self.pieces.slots[x.number])
        self.declared.add(f"declare void @{function.name}(ptr, ptr)")
        self.lines.append(f"  call void @{function.name}(ptr {start}, ptr {results})")
        return results


def python_source(outputs: Sequence[Any]) -> str:
    """The law as Python source, `def law(t, y, p, out)`; it uses functions of `symbols` and
    `external`."""
    names: dict[int, str] = {}
    lines = ["def law(t, y, p, out):"]

    def name(x: Any) -> str:
        return names[x.number] if isinstance(x, Symbol) else _python_number(x)

    for x in in_order(outputs):
        if x.op in INPUTS:
            names[x.number] = "t" if x.op == "t" else f"{x.op}{x.operands[0]}"
            if x.op != "t":
                lines.append(f"    {x.op}{x.operands[0]} = float({x.op}[{x.operands[0]}])")
            continue
        names[x.number] = f"v{x.number}"
        lines.append(f"    v{x.number} = {_python_operation(x, name)}")
    lines += [f"    out[{i}] = {name(x)}" for i, x in enumerate(outputs)]
    return "\n".join([*lines, "    return None", ""])


def _python_number(x: float) -> str:
    return repr(float(x)) if x - x == 0.0 else f"float('{x!r}')"


_PYTHON = {
    "add": "{} + {}",
    "sub": "{} - {}",
    "mul": "{} * {}",
    "neg": "-{}",
    "lt": "{} < {}",
    "le": "{} <= {}",
    "and": "{} and {}",
    "or": "{} or {}",
    "not": "not {}",
    "select": "{1} if {0} else {2}",
    "rarely": "{1} if {0} else {2}",
    "div": "divide({}, {})",
    "fabs": "abs({})",
}


def _python_operation(x: Symbol, name: Any) -> str:
    if x.op == "call":
        function, *arguments = x.operands
        return f"external['{function.name}']({', '.join(map(name, arguments))})"
    if x.op == "item":
        return f"{name(x.operands[0])}[{x.operands[1]}]"
    operands = [f"({name(o)})" for o in x.operands]
    if x.op in _PYTHON:
        return _PYTHON[x.op].format(*operands)
    return f"{x.op}({', '.join(operands)})"


# A graph as a C function for use outside rb_sim: `python -m tools.c_law SCENE` prints one.
#
# The operations are in the order of the graph, one per line; a compiler without fused multiply-add
# gives the numbers of the machine code of `emit`, except for sines and similar functions of its own
# library.


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


def c_function(outputs: Sequence[Any]) -> str | None:
    """C function void rate(double t, const double *y, const double *p, double *out), with headers.

    outputs: symbols of one graph and numbers. None if the graph calls functions by address.
    """
    order = in_order(outputs)
    if any(x.op == "call" for x in order):
        return None
    head = "void rate(double t, const double *y, const double *p, double *out)"
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
    """The exact number in C, in parentheses if it is negative or not finite."""
    if x != x:
        return "(0.0 / 0.0)"
    if x - x != 0.0:
        return "(1.0 / 0.0)" if x > 0.0 else "(-1.0 / 0.0)"
    return repr(float(x)) if str(float(x))[0] != "-" else f"({float(x)!r})"
