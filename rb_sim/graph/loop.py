"""LLVM IR of a kernel in a loop over a table, and of the tables themselves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rb_sim.graph.emit import RARELY, Piece, Pieces
from rb_sim.graph.symbols import Symbol

BASES = ("y", "p", "const", "frame", "out")
"""Arrays of a program: the arguments of a law, its constants, and room for what is in between."""


def arrays(name: str, kind: str, entries: Sequence[Any]) -> str:
    """A constant array."""
    inner = ", ".join(f"{kind} {x}" for x in entries)
    return f"{name} = internal constant [{len(entries)} x {kind}] [{inner}], align 16"


def room(array: str, kind: str, count: int, name: str, pointer: str) -> list[str]:
    """`name` becomes the pointer to the first element of an array."""
    whole = f"[{count} x {kind}]"
    at = "ptr" if pointer == "ptr" else f"{whole}*"
    return [f"  {name} = getelementptr {whole}, {at} {array}, i64 0, i64 0"]


def declared(name: str, pointer: str) -> str:
    """The declaration of a kernel's loop."""
    integers = "ptr" if pointer == "ptr" else "i32*"
    return f"declare void @{name}(double, {', '.join([pointer] * 5)}, {integers}, i64)"


def loop_module(
    pieces: Pieces,
    widths: Sequence[int],
    made: Sequence[int],
    bases: Sequence[str],
    pointer: str,
) -> str:
    """A function `law` that runs the kernel on each row of its table."""
    return _Loop(pieces, widths, made, bases, pointer).text()


class _Loop(Piece):
    """Writes the loop; the coordinates of the graph are the fields of an instance in turn."""

    def __init__(
        self,
        pieces: Pieces,
        widths: Sequence[int],
        made: Sequence[int],
        bases: Sequence[str],
        pointer: str,
    ) -> None:
        super().__init__(pieces, 0, pointer)
        self.bases, self.fields = bases, len(widths)
        self.where = [(k, j) for k, width in enumerate(widths) for j in range(width)]
        self.to = [(k, j) for k, width in enumerate(made) for j in range(width)]

    def from_outside(self, x: Symbol) -> str:
        if x.op == "t":
            return "%t"
        k, j = self.where[x.operands[0]]
        return self.load(f"%field{k}", j)

    def text(self) -> str:
        for x in self.pieces.parts[0]:
            self.names[x.number] = self.operation(x)
        values = [self.value(x) for x in self.pieces.outputs]
        for value, (k, j) in zip(values, self.to, strict=True):
            self.store(value, f"%field{self.fields + k}", j)
        return "\n".join([*sorted(self.declared), *self._head(), *self.lines, *self._tail()])

    def _head(self) -> list[str]:
        p, count = self.pointer, len(self.bases)
        integers = "ptr" if p == "ptr" else "i32*"
        arguments = ", ".join(f"{p} %{base}" for base in BASES)
        lines = [
            f"define void @law(double %t, {arguments}, {integers} %rows, i64 %count) nounwind {{",
            "start:",
            "  br label %again",
            "again:",
            "  %i = phi i64 [ 0, %start ], [ %next, %again ]",
            f"  %row = mul i64 %i, {count}",
            f"  %entries = getelementptr i32, {integers} %rows, i64 %row",
        ]
        for k, base in enumerate(self.bases):
            lines += [
                f"  %entry{k} = getelementptr i32, {integers} %entries, i64 {k}",
                f"  %short{k} = load i32, {integers} %entry{k}, align 4",
                f"  %at{k} = zext i32 %short{k} to i64",
                f"  %field{k} = getelementptr double, {p} %{base}, i64 %at{k}",
            ]
        return lines

    def _tail(self) -> list[str]:
        return [
            "  %next = add i64 %i, 1",
            "  %more = icmp slt i64 %next, %count",
            "  br i1 %more, label %again, label %done",
            "done:",
            "  ret void",
            "}",
            RARELY,
            "",
        ]
