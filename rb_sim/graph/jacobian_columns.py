"""The Jacobian of a graph column by column: code that grows as the graph, not as the matrix.

What the derivatives need of the graph itself is computed once.  Then LANES directions at a time, a
vector of the machine, go through the tangents (`tangent`), which are about as many operations as
the graph has; the matrix of n columns takes n / LANES such passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from string import Template
from typing import Any

import numpy as np

from rb_sim.graph.derivative import tangent
from rb_sim.graph.emit import RARELY, Pieces
from rb_sim.graph.functions import where
from rb_sim.graph.machine import Law, PlainLaw, interpreted, linked, named_law, pointer_type
from rb_sim.graph.symbols import INPUTS, Condition, Graph, Symbol, graph_of, in_order
from rb_sim.graph.vector_code import LANES, VECTOR, Vectors, splat

PIECE = 500
"""Operations on vectors per function; LLVM splits each into as many as the machine needs."""


def compile_columns(outputs: Sequence[Any], n: int) -> Law | PlainColumns:
    """The law that writes d outputs / d y, row by row; n: of coordinates.

    Raises TypeError for functions called by address that do not tell their slopes.
    """
    tangents = Tangents(outputs, n)
    if interpreted():
        return PlainColumns(tangents)
    pointer = pointer_type()
    once = Pieces(tangents.once)
    name, first = named_law("once", once, 2 if len(once.parts) == 1 else 0)
    parts = [_Part(tangents, k, pointer).text() for k in range(len(tangents.pieces.parts))]
    # once in a step of which the matrix is factorised: not worth more of LLVM's time
    return linked([*parts, _driver(tangents, name, pointer)], level=0, others={name: first})


class Tangents:
    """The tangents of a graph, divided into what is computed once and parts that see directions."""

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
    """The same in Python, a direction at a time."""

    def __init__(self, tangents: Tangents) -> None:
        self._n, self._law = tangents.n, PlainLaw(tangents.outputs)

    def __call__(self, t: float, y: Any, p: Any, out: Any) -> None:
        n = self._n
        both, column = np.concatenate([y[:n], np.zeros(n)]), np.zeros(len(out) // n)
        for j in range(n):
            both[n:] = 0.0
            both[n + j] = 1.0
            self._law(t, both, p, column)
            out[j::n] = column


class _Part(Vectors):
    """Writes one part: %y are the directions, %p what was computed once, %frame what passes."""

    def __init__(self, tangents: Tangents, number: int, pointer: str) -> None:
        super().__init__(pointer, 0)
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
        at = f"getelementptr double, {self.pointer} %p, i64 {tangents.place[x.number]}"
        number = self.line(f"load double, {self.pointer} {self.line(at)}, align 8")
        alone = self.line(f"insertelement {VECTOR} undef, double {number}, i32 0")
        one = f"<{LANES} x i32> zeroinitializer"
        everywhere = self.line(f"shufflevector {VECTOR} {alone}, {VECTOR} undef, {one}")
        if isinstance(x, Condition):
            return self.line(f"fcmp one {VECTOR} {everywhere}, {splat(0.0)}")
        return everywhere

    def text(self) -> str:
        """The function as a module."""
        tangents, p = self.tangents, self.pointer
        for x in tangents.pieces.parts[self.number]:
            self.add(x)
            if x.number in tangents.pieces.slots:
                self.store(self.names[x.number], tangents.pieces.slots[x.number], "%frame")
        for i, x in enumerate(tangents.outputs):
            if tangents.pieces.part_of_output(x) == self.number:
                self.store(self.value(x), i)
        head = (
            f"define void @part{self.number}({p} noalias readonly %y, {p} noalias readonly %p, "
            f"{p} noalias %out, {p} noalias %frame) nounwind {{"
        )
        return "\n".join([*sorted(self.declared), head, *self.lines, "  ret void", "}", RARELY, ""])


DRIVER = """
declare $byte @calloc(i64, i64)
declare void @free($byte)
declare void @$once(double, $p, $p, $p)
$declared
define void @law(double %t, $p %y, $p %p, $p %out) nounwind {
entry:
  $given = call $byte @calloc(i64 $size, i64 8)
  $places
  call void @$once(double %t, $p %y, $p %p, $p %known)
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
  %source = getelementptr double, $p %result, i64 %from_l
  %goal = getelementptr double, $p %out, i64 %to_l
  %x = load double, $p %source, align 8
  store double %x, $p %goal, align 8
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
  call void @free($byte $given)
  ret void
}
"""
"""The law: what is computed once, then all columns, LANES at a time, each put into its place.

The room is calloc's, since the stack of a thread may be small where bodies are many.
"""


def _driver(tangents: Tangents, once: str, pointer: str) -> str:
    """DRIVER for these tangents; once: the name of the law of what is computed once."""
    p, n, rows, typed = pointer, tangents.n, len(tangents.outputs), pointer != "ptr"
    given, places, at = "%given" if typed else "%room", [], 0
    for name, count in (
        ("known", len(tangents.once)),
        ("directions", (n + LANES) * LANES),
        ("result", rows * LANES),
        ("frame", tangents.pieces.frame * LANES),
    ):
        places.append(f"%{name} = getelementptr double, {p} %room, i64 {at}")
        at += count
    arguments = f"{p} %directions, {p} %known, {p} %result, {p} %frame"
    parts = range(len(tangents.pieces.parts))
    return Template(DRIVER).substitute(
        p=p,
        byte="i8*" if typed else "ptr",
        given=given,
        once=once,
        n=n,
        rows=rows,
        lanes=LANES,
        size=at,
        declared="\n".join(f"declare void @part{k}({p}, {p}, {p}, {p})" for k in parts),
        places="\n  ".join(([f"%room = bitcast i8* {given} to {p}"] if typed else []) + places),
        calls="\n  ".join(f"call void @part{k}({arguments})" for k in parts),
        on="\n  ".join(_unit_directions(p, "on", "1.0")),
        off="\n  ".join(_unit_directions(p, "off", "0.0")),
    )


def _unit_directions(pointer: str, name: str, value: str) -> list[str]:
    """Lines that write the value to coordinate j + l in lane l, for every lane."""
    lines = [f"%{name} = mul i64 %j, {LANES}"]
    for lane in range(LANES):
        lines += [
            f"%{name}{lane} = add i64 %{name}, {lane * LANES + lane}",
            f"%{name}at{lane} = getelementptr double, {pointer} %directions, i64 %{name}{lane}",
            f"store double {value}, {pointer} %{name}at{lane}, align 8",
        ]
    return lines
