# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Exact derivatives of a graph, again as graphs, without entries that are always zero.

Forward mode over the operations; the chain rule of each operation is one entry of `RULES`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from string import Template
from typing import Any, NamedTuple

import numpy as np

from rb_sim.compiler.graph.emit import RARELY, Pieces
from rb_sim.compiler.graph.machine import Law, PlainLaw, interpreted, linked, named_law
from rb_sim.compiler.graph.symbols import (
    INPUTS,
    Condition,
    Graph,
    Symbol,
    cos,
    graph_of,
    in_order,
    maximum,
    sin,
    where,
)
from rb_sim.compiler.graph.vector_code import LANES, VECTOR, Vectors, splat


class Sparse(NamedTuple):
    """A sparse matrix of graphs, row by row, without entries that are always zero."""

    shape: tuple[int, int]
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    values: tuple[Any, ...]
    """entries, as symbols or numbers."""


def jacobian(outputs: Sequence[Any], inputs: Sequence[Symbol]) -> Sparse:
    """d outputs[i] / d inputs[j] as graphs; inputs: arguments such as `graph.vector("y", n)`.

    A selection is differentiated on the selected side; a step (floor) has derivative zero. Raises
    TypeError for functions called by address without known slopes.
    """
    smooth = _smooth(outputs)
    changes = [_changes(smooth, {x.number: 1.0}) for x in inputs]
    entries = [
        (i, j, change[x.number])
        for i, x in enumerate(outputs)
        for j, change in enumerate(changes)
        if isinstance(x, Symbol) and x.number in change
    ]
    rows, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
    return Sparse((len(outputs), len(inputs)), rows, columns, values)


def slopes_of(x: Symbol) -> Sequence[Any]:
    """d x / d arguments, for a result x of a function called by address; () if x is stepwise
    constant.

    Raises TypeError if the slopes are not known.
    """
    call, result = x.operands
    function, *arguments = call.operands
    if function.slopes is None:
        raise TypeError(f"no derivative: {function.name} does not tell its slopes")
    rows = function.slopes(*arguments)
    return rows[result] if rows else ()


def _quotient(x: Any, a: Any, b: Any, da: Any, db: Any) -> Any:
    """Derivative of a quotient: (a / b)' = (a' - (a / b) b') / b."""
    return (da - x * db) / b


def _root(x: Any, a: Any, da: Any) -> Any:
    """(sqrt a)' = a' / (2 sqrt a), and 0 if a' is 0 as well.

    A length |v| has no derivative at v = 0, but |v| v has one there, which is 0.
    """
    return 0.5 * da / maximum(x, sys.float_info.min)


def _angle(x: Any, y: Any, z: Any, dy: Any, dz: Any) -> Any:
    """Derivative of an angle: atan2(y, z)' = (y' z - y z') / (y^2 + z^2)."""
    return (dy * z - y * dz) / (y * y + z * z)


RULES: dict[str, Callable[..., Any]] = {
    "add": lambda x, a, b, da, db: da + db,
    "sub": lambda x, a, b, da, db: da - db,
    "mul": lambda x, a, b, da, db: da * b + a * db,
    "div": _quotient,
    "neg": lambda x, a, da: -da,
    "sqrt": _root,
    "sin": lambda x, a, da: cos(a) * da,
    "cos": lambda x, a, da: -(sin(a) * da),
    "atan2": _angle,
    "fabs": lambda x, a, da: where(a < 0.0, -da, da),
    "rarely": lambda x, c, a, b, dc, da, db: where(c, da, db),
    "select": lambda x, c, a, b, dc, da, db: where(c, da, db),
}


# Directional derivative of a graph: one more number for every operation. `derivative.jacobian`
# gives all entries of a matrix; this gives the matrix times a vector, at about the cost of the
# graph itself for any size of the matrix.


def tangent(outputs: Sequence[Any], direction: Mapping[Symbol, Any]) -> list[Any]:
    """d outputs along a direction, given by the change of each argument (0 if absent).

    Selections and steps as in `derivative.jacobian`. Raises TypeError for functions called by
    address without known slopes.
    """
    known = _changes(_smooth(outputs), {x.number: change for x, change in direction.items()})
    return [known.get(x.number, 0.0) if isinstance(x, Symbol) else 0.0 for x in outputs]


def _smooth(outputs: Sequence[Any]) -> list[tuple[Symbol, list[int]]]:
    """The operations with a derivative, each with the numbers of the operands on which it depends.

    For the result of a function called by address these are the function's arguments.
    """
    return [
        (x, [o.number for o in _operands(x) if isinstance(o, Symbol)])
        for x in in_order(outputs)
        if not (x.op in INPUTS or isinstance(x, Condition) or x.op in ("floor", "call"))
    ]


def _operands(x: Symbol) -> Sequence[Any]:
    return x.operands[0].operands[1:] if x.op == "item" else x.operands


def _changes(
    smooth: Sequence[tuple[Symbol, list[int]]], given: Mapping[int, Any]
) -> dict[int, Any]:
    """Changes of arguments and operations by their numbers, without exact zeros."""
    known = {number: change for number, change in given.items() if not _is_zero(change)}
    for x, numbers in smooth:
        if known.keys().isdisjoint(numbers):
            continue
        changes = [known.get(o.number, 0.0) if isinstance(o, Symbol) else 0.0 for o in _operands(x)]
        change = _change_of(x, changes)
        if not _is_zero(change):
            known[x.number] = change
    return known


def _change_of(x: Symbol, changes: list[Any]) -> Any:
    """Change of one operation from the changes of its operands."""
    if x.op != "item":
        rule = RULES.get(x.op)
        if rule is None:
            raise TypeError(f"no derivative of {x.op}")
        return rule(x, *x.operands, *changes)
    call, result = x.operands
    function, *arguments = call.operands
    if function.along is not None:
        return function.along(*arguments, *changes)[result]
    terms = [slope * change for slope, change in zip(slopes_of(x), changes, strict=False)]
    return sum(terms[1:], terms[0]) if terms else 0.0


def _is_zero(x: Any) -> bool:
    return not isinstance(x, Symbol) and x == 0.0


# The Jacobian of a graph column by column: the code grows with the graph, not with the matrix.
#
# Quantities of the graph itself are computed once. Then the tangents (`tangent`), about as many
# operations as the graph has, are evaluated for LANES directions at a time, one per vector lane; a
# matrix of n columns takes n / LANES such passes.


PIECE = 500
"""Vector operations per function; LLVM splits each into as many as the processor needs."""


def compile_columns(outputs: Sequence[Any], n: int) -> Law | PlainColumns:
    """The law that writes d outputs / d y, row by row; n: number of coordinates.

    Raises TypeError for functions called by address without known slopes.
    """
    tangents = Tangents(outputs, n)
    if interpreted():
        return PlainColumns(tangents)
    once = Pieces(tangents.once)
    name, first = named_law("once", once, 2 if len(once.parts) == 1 else 0)
    parts = [_Part(tangents, k).text() for k in range(len(tangents.pieces.parts))]
    # called once per step with a factorisation: not worth more of LLVM's time
    return linked([*parts, _driver(tangents, name)], level=0, others={name: first})


class Tangents:
    """Tangents of a graph, divided into operations computed once and parts that depend on
    directions."""

    def __init__(self, outputs: Sequence[Any], n: int) -> None:
        graph = graph_of(outputs) or Graph()
        y, directions, self.n = graph.vector("y", n), graph.vector("y", n, n), n
        self.outputs = tangent(outputs, dict(zip(y, directions, strict=True)))
        moving = {x.number for x in directions}
        order: list[Symbol] = []
        for x in in_order(self.outputs):
            if any(isinstance(o, Symbol) and o.number in moving for o in x.operands):
                moving.add(x.number)
                order.append(x)
        used = [o for x in order for o in x.operands if isinstance(o, Symbol)]
        fixed = dict.fromkeys(o for o in used if o.number not in moving)
        self.place = {o.number: i for i, o in enumerate(fixed)}
        self.once = [where(o, 1.0, 0.0) if isinstance(o, Condition) else o for o in fixed]
        self.pieces = Pieces(self.outputs, PIECE, order)


class PlainColumns:
    """The Jacobian law in Python, one direction at a time."""

    def __init__(self, tangents: Tangents) -> None:
        self._n, self._law = tangents.n, PlainLaw(tangents.outputs)

    def __call__(self, t: float, y: Any, p: Any, out: Any) -> None:
        """Write the Jacobian at (t, y), row by row, into out: n calls of the law."""
        n = self._n
        both, column = np.concatenate([y[:n], np.zeros(n)]), np.zeros(len(out) // n)
        for j in range(n):
            both[n:] = 0.0
            both[n + j] = 1.0
            self._law(t, both, p, column)
            out[j::n] = column


class _Part(Vectors):
    """Writer of one part: %y holds the directions, %p the numbers computed once, %frame
    intermediates."""

    def __init__(self, tangents: Tangents, number: int) -> None:
        super().__init__(0)
        self.tangents, self.number = tangents, number

    def value(self, x: Any) -> str:
        if isinstance(x, Symbol) and x.number not in self.names:
            self.names[x.number] = self.from_outside(x)
        return super().value(x)

    def from_outside(self, x: Symbol) -> str:
        tangents = self.tangents
        if x.number in tangents.pieces.slots:
            return self.load("%frame", tangents.pieces.slots[x.number])
        if x.op in INPUTS and x.number not in tangents.place:
            return self.load("%y", x.operands[0] - tangents.n)
        at = f"getelementptr double, ptr %p, i64 {tangents.place[x.number]}"
        number = self.line(f"load double, ptr {self.line(at)}, align 8")
        alone = self.line(f"insertelement {VECTOR} undef, double {number}, i32 0")
        one = f"<{LANES} x i32> zeroinitializer"
        everywhere = self.line(f"shufflevector {VECTOR} {alone}, {VECTOR} undef, {one}")
        if isinstance(x, Condition):
            return self.line(f"fcmp one {VECTOR} {everywhere}, {splat(0.0)}")
        return everywhere

    def text(self) -> str:
        """LLVM IR of the function as a module."""
        tangents = self.tangents
        for x in tangents.pieces.parts[self.number]:
            self.add(x)
            if x.number in tangents.pieces.slots:
                self.store(self.names[x.number], tangents.pieces.slots[x.number], "%frame")
        for i, x in enumerate(tangents.outputs):
            if tangents.pieces.part_of_output(x) == self.number:
                self.store(self.value(x), i)
        head = (
            f"define void @part{self.number}(ptr noalias readonly %y, ptr noalias readonly %p, "
            f"ptr noalias %out, ptr noalias %frame) nounwind {{"
        )
        return "\n".join([*sorted(self.declared), head, *self.lines, "  ret void", "}", RARELY, ""])


DRIVER = """
declare ptr @calloc(i64, i64)
declare void @free(ptr)
declare void @$once(double, ptr, ptr, ptr)
$declared
define void @law(double %t, ptr %y, ptr %p, ptr %out) nounwind {
entry:
  %workspace = call ptr @calloc(i64 $size, i64 8)
  $places
  call void @$once(double %t, ptr %y, ptr %p, ptr %known)
  br label %columns
columns:
  %j = phi i64 [ 0, %entry ], [ %j_next, %written ]
  $on
  $calls
  $off
  %left = sub i64 $n, %j
  %few = icmp slt i64 %left, $lanes
  %count = select i1 %few, i64 %left, i64 $lanes
  br label %row
row:
  %i = phi i64 [ 0, %columns ], [ %i_next, %row_end ]
  %from = mul i64 %i, $lanes
  %row_at = mul i64 %i, $n
  %to = add i64 %row_at, %j
  br label %in_row
in_row:
  %l = phi i64 [ 0, %row ], [ %l_next, %in_row ]
  %from_l = add i64 %from, %l
  %to_l = add i64 %to, %l
  %source = getelementptr double, ptr %result, i64 %from_l
  %goal = getelementptr double, ptr %out, i64 %to_l
  %x = load double, ptr %source, align 8
  store double %x, ptr %goal, align 8
  %l_next = add i64 %l, 1
  %more_l = icmp slt i64 %l_next, %count
  br i1 %more_l, label %in_row, label %row_end
row_end:
  %i_next = add i64 %i, 1
  %more_i = icmp slt i64 %i_next, $rows
  br i1 %more_i, label %row, label %written
written:
  %j_next = add i64 %j, $lanes
  %more_j = icmp slt i64 %j_next, $n
  br i1 %more_j, label %columns, label %done
done:
  call void @free(ptr %workspace)
  ret void
}
"""
"""Template of the law: numbers computed once, then all columns, LANES at a time, stored by row.

The workspace comes from calloc: the stack of a thread may be too small for many bodies.
"""


def _driver(tangents: Tangents, once: str) -> str:
    """DRIVER filled in for these tangents; once: name of the law of the numbers computed once."""
    n, rows, places, at = tangents.n, len(tangents.outputs), [], 0
    for name, count in (
        ("known", len(tangents.once)),
        ("directions", (n + LANES) * LANES),
        ("result", rows * LANES),
        ("frame", tangents.pieces.frame * LANES),
    ):
        places.append(f"%{name} = getelementptr double, ptr %workspace, i64 {at}")
        at += count
    arguments = "ptr %directions, ptr %known, ptr %result, ptr %frame"
    parts = range(len(tangents.pieces.parts))
    return Template(DRIVER).substitute(
        once=once,
        n=n,
        rows=rows,
        lanes=LANES,
        size=at,
        declared="\n".join(f"declare void @part{k}(ptr, ptr, ptr, ptr)" for k in parts),
        places="\n  ".join(places),
        calls="\n  ".join(f"call void @part{k}({arguments})" for k in parts),
        on="\n  ".join(_unit_directions("on", "1.0")),
        off="\n  ".join(_unit_directions("off", "0.0")),
    )


def _unit_directions(name: str, value: str) -> list[str]:
    """Instructions that write the value to coordinate j + l in lane l, for every lane l."""
    lines = [f"%{name} = mul i64 %j, {LANES}"]
    for lane in range(LANES):
        lines += [
            f"%{name}{lane} = add i64 %{name}, {lane * LANES + lane}",
            f"%{name}at{lane} = getelementptr double, ptr %directions, i64 %{name}{lane}",
            f"store double {value}, ptr %{name}at{lane}, align 8",
        ]
    return lines
