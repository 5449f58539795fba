# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A law over tables: kernels traced once per kind, each called in a loop over its instances.

A long law made of equal parts is slow to trace, to compile and, beyond the instruction cache, to
run. A program instead calls the kernel of each kind for the rows of a table. A kernel maps input
fields to output fields, each of them consecutive numbers of one of the arrays in BASES; a row of
the table holds the places of the fields of one instance. Kernels are separate machine code shared
by all programs; a program consists of its tables and one call per kind.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rb_sim.compiler.graph import machine
from rb_sim.compiler.graph.emit import RARELY, Piece, Pieces, constant, python_source
from rb_sim.compiler.graph.machine import Law
from rb_sim.compiler.graph.symbols import External, Graph, Symbol

# LLVM IR of a kernel in a loop over a table, and of the tables.


BASES = ("y", "p", "const", "frame", "out")
"""Arrays of a program: the arguments of a law, its constants, workspace for intermediate results,
output."""


def arrays(name: str, kind: str, entries: Sequence[Any]) -> str:
    """LLVM IR of a constant array."""
    inner = ", ".join(f"{kind} {x}" for x in entries)
    return f"{name} = internal constant [{len(entries)} x {kind}] [{inner}], align 16"


def declared(name: str) -> str:
    """LLVM declaration of a kernel's loop."""
    return f"declare void @{name}(double, {', '.join(['ptr'] * 6)}, i64)"


class _Loop(Piece):
    """Writer of the loop; the coordinates of the graph are the fields of an instance in order."""

    def __init__(
        self,
        pieces: Pieces,
        widths: Sequence[int],
        made: Sequence[int],
        bases: Sequence[str],
    ) -> None:
        super().__init__(pieces, 0)
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
        count = len(self.bases)
        arguments = ", ".join(f"ptr %{base}" for base in BASES)
        lines = [
            f"define void @law(double %t, {arguments}, ptr %rows, i64 %count) nounwind {{",
            "start:",
            "  br label %again",
            "again:",
            "  %i = phi i64 [ 0, %start ], [ %next, %again ]",
            f"  %row = mul i64 %i, {count}",
            "  %entries = getelementptr i32, ptr %rows, i64 %row",
        ]
        for k, base in enumerate(self.bases):
            lines += [
                f"  %entry{k} = getelementptr i32, ptr %entries, i64 {k}",
                f"  %short{k} = load i32, ptr %entry{k}, align 4",
                f"  %at{k} = zext i32 %short{k} to i64",
                f"  %field{k} = getelementptr double, ptr %{base}, i64 %at{k}",
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


MOST_WORKSPACE = 600_000
"""Most numbers in the frame, which lies on the stack: 5 MB of the 8 MB of a thread."""
NO_CUT = 10**9
"""Operations of a piece: never reached, as a kernel is one function."""


class Field(NamedTuple):
    """Places of one field of all instances of a kernel."""

    base: str
    """array of the field, one of BASES."""
    width: int
    at: Sequence[int]
    """place of the first number for each instance."""


class Kernel:
    """The traced kernel of one kind: output fields from input fields."""

    def __init__(self, function: Callable[..., Any], widths: Sequence[int]) -> None:
        graph, first = Graph(), 0
        fields = []
        for width in widths:
            fields.append(graph.vector("y", width, first))
            first += width
        made = [tuple(field) for field in function(graph.input("t"), *fields)]
        self.widths = tuple(widths)
        self.made = tuple(len(field) for field in made)
        self.outputs = [x for field in made for x in field]
        self._modules: dict[Hashable, str] = {}

    def module(self, bases: tuple[str, ...]) -> str:
        """LLVM IR of the loop for fields in these arrays."""
        if bases not in self._modules:
            loop = _Loop(Pieces(self.outputs, NO_CUT), self.widths, self.made, bases)
            self._modules[bases] = loop.text()
        return self._modules[bases]

    @cached_property
    def plain(self) -> Callable[..., None]:
        """The kernel as a Python function law(t, y, p, out) on the numbers of one instance."""
        return machine.plain_function(python_source(self.outputs), Pieces(self.outputs))


_KERNELS: dict[Hashable, Kernel] = {}


def kernel(key: Hashable, function: Callable[..., Any], widths: Sequence[int]) -> Kernel:
    """The kernel of f(t, *fields), traced once for each key and field widths."""
    whole = key, tuple(widths)
    found = _KERNELS.get(whole)
    if found is None:
        found = _KERNELS.setdefault(whole, Kernel(function, widths))
    return found


class _Call(NamedTuple):
    """A kernel over a table, or an external function on parts of the frame."""

    does: Kernel | External
    fields: tuple[Field, ...]
    count: int


class Program:
    """A law as a sequence of calls."""

    def __init__(self) -> None:
        self.constants: list[float] = []
        self.frame = 0
        self._calls: list[_Call] = []

    def workspace(self, width: int) -> int:
        """Reserve `width` numbers in the frame; returns their place."""
        self.frame += width
        return self.frame - width

    def keep(self, numbers: Sequence[float]) -> int:
        """Store the numbers among the constants; returns their place."""
        self.constants += map(float, numbers)
        return len(self.constants) - len(numbers)

    def run(
        self,
        key: Hashable,
        function: Callable[..., Any],
        inputs: Sequence[Field],
        outputs: Sequence[tuple[str, Sequence[int]]],
    ) -> None:
        """Add a call of f(t, *inputs) for every instance; outputs: base and places of each output
        field.

        key: identifies the function among all programs.
        """
        count = len(inputs[0].at) if inputs else len(outputs[0][1])
        if count == 0:
            return
        does = kernel(key, function, [field.width for field in inputs])
        made = [
            Field(base, width, at) for (base, at), width in zip(outputs, does.made, strict=True)
        ]
        self._calls.append(_Call(does, (*inputs, *made), count))

    def call(self, function: External, arguments: int, results: int) -> None:
        """Add a call of an external function on parts of the frame."""
        places = (Field("frame", 0, (arguments,)), Field("frame", 0, (results,)))
        self._calls.append(_Call(function, places, 1))

    def compiled(self) -> Law | PlainProgram:
        """The compiled law, as from `compile_law`."""
        if machine.interpreted():
            return PlainProgram(self)
        if self.frame > MOST_WORKSPACE:
            raise ValueError(
                f"a law with a workspace of {self.frame} numbers; must be at most {MOST_WORKSPACE}:"
                " the scene is too large, or has too many constraint rows that depend on each other"
            )
        head, calls, externals, kernels = [], [], [], {}
        for number, call in enumerate(self._calls):
            if isinstance(call.does, External):
                name, own = call.does.name, ""
                externals.append(call.does)
                places = []
                for k in (0, 1):
                    places.append(f"ptr %place{number}_{k}")
                    at = f"getelementptr double, ptr %frame, i64 {call.fields[k].at[0]}"
                    calls.append(f"  %place{number}_{k} = {at}")
                head.append(f"declare void @{name}(ptr, ptr)")
                calls.append(f"  call void @{name}({', '.join(places)})")
                continue
            bases = tuple(field.base for field in call.fields)
            text = call.does.module(bases)
            name = f"rb_sim_{hashlib.sha256(text.encode()).hexdigest()[:40]}"
            law = machine.loaded_module(name, text)
            kernels[name] = law
            head.append(declared(name))
            own = f"@table{number}"
            table = np.array([field.at for field in call.fields], dtype=np.int32).T
            head.append(arrays(own, "i32", table.ravel().tolist()))
            calls.append(
                f"  call void @{name}(double %t, ptr %y, ptr %p, ptr @const, "
                f"ptr %frame, ptr %out, ptr {own}, i64 {call.count})"
            )
        text = self._text(list(dict.fromkeys(head)), calls)
        return machine.linked([text], externals, 0, kernels)

    def _text(self, head: list[str], calls: list[str]) -> str:
        """LLVM IR of the law."""
        numbers = self.constants or [0.0]
        return "\n".join(
            [
                *head,
                arrays("@const", "double", [constant(x) for x in numbers]),
                "define void @law(double %t, ptr %y, ptr %p, ptr %out) {",
                f"  %frame = alloca [{max(1, self.frame)} x double], align 16",
                *calls,
                "  ret void",
                "}",
                "",
            ]
        )


class PlainProgram:
    """A program as a Python function of arrays: law(t, y, p, out)."""

    def __init__(self, program: Program) -> None:
        self._calls, self._frame = tuple(program._calls), program.frame
        self._constants = tuple(program.constants)

    def __call__(self, t: float, y: Any, p: Any, out: Any) -> None:
        """Write the law at (t, y) with the inputs p into out, by all calls of the program in
        order."""
        frame = [0.0] * self._frame
        bases: dict[str, Any] = {
            "y": y,
            "p": p,
            "const": self._constants,
            "frame": frame,
            "out": out,
        }
        for does, fields, count in self._calls:
            if isinstance(does, External):
                first, last = fields[0].at[0], fields[1].at[0]
                frame[last : last + does.results] = does.plain(*frame[first:last])
                continue
            taken, given = fields[: len(does.widths)], fields[len(does.widths) :]
            made = [0.0] * sum(does.made)
            for i in range(count):
                numbers = [bases[f.base][f.at[i] + j] for f in taken for j in range(f.width)]
                does.plain(float(t), numbers, (), made)
                each = iter(made)
                for f in given:
                    for j in range(f.width):
                        bases[f.base][f.at[i] + j] = next(each)
