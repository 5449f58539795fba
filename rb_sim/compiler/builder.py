# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Blocks and instructions of a function, as the text of LLVM IR."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from rb_sim.compiler.kinds import Kind, Object, Tuple


@dataclass(frozen=True)
class Value:
    """A value of a kind, by its LLVM values.

    number: a constant of Python's, where it is one.
    """

    kind: Kind
    leaves: tuple[str, ...]
    number: Any = field(default=None, compare=False)

    @property
    def leaf(self) -> str:
        """The only leaf of a value whose kind has one."""
        (leaf,) = self.leaves
        return leaf


def entries(value: Value) -> list[Value]:
    """The entries of a tuple."""
    assert isinstance(value.kind, Tuple)
    at, found = 0, []
    for kind in value.kind.kinds:
        count = len(kind.leaves)
        found.append(Value(kind, value.leaves[at : at + count]))
        at += count
    return found


def tuple_of(values: Sequence[Value], of: type | None = None) -> Value:
    """The tuple of the values."""
    leaves = tuple(leaf for value in values for leaf in value.leaves)
    return Value(Tuple(tuple(value.kind for value in values), of), leaves)


def known(value: Any) -> Value:
    """An object that is known while compiling."""
    return Value(Object(value), ())


def real_text(x: float) -> str:
    """A double to the bit."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Block:
    """Instructions that run one after another; the last of them goes elsewhere.

    ended: nothing more comes in it; reached: another block goes to it.
    """

    def __init__(self, label: str) -> None:
        self.label, self.lines = label, list[str]()
        self.ended, self.reached = False, False


class Builder:
    """A function that is being written."""

    def __init__(self) -> None:
        self._count = 0
        self.slots: list[str] = []
        """What stands at the very begin."""
        self.blocks: list[Block] = []
        first = self.label("begin")
        first.reached = True
        self.block = self.begin(first)

    def label(self, word: str) -> Block:
        """A block that begins later."""
        self._count += 1
        return Block(f"{word}{self._count}")

    def begin(self, block: Block) -> Block:
        """Write into the block from now on; nothing is written where no other block goes to it."""
        self.blocks.append(block)
        self.block = block
        block.ended = not block.reached
        return block

    def name(self) -> str:
        """A new name of a value."""
        self._count += 1
        return f"%v{self._count}"

    def do(self, text: str) -> None:
        """An instruction without a result; what cannot be reached is left out."""
        if not self.block.ended:
            self.block.lines.append(text)
            self.block.ended = text.startswith("ret ")

    def get(self, text: str) -> str:
        """The result of an instruction."""
        name = self.name()
        self.do(f"{name} = {text}")
        return name

    def go(self, block: Block) -> None:
        """Jump to the block."""
        if not self.block.ended:
            self.do(f"br label %{block.label}")
            self.block.ended = block.reached = True

    def part(self, condition: str, yes: Block, no: Block) -> None:
        """Jump to one block or the other."""
        if not self.block.ended:
            self.do(f"br i1 {condition}, label %{yes.label}, label %{no.label}")
            self.block.ended = yes.reached = no.reached = True

    def slot(self, kind: str) -> str:
        """A place for a value of the LLVM type, as long as the function runs."""
        name = self.name()
        self.slots.append(f"{name} = alloca {kind}, align 8")
        return name

    def place(self, kind: str, pointer: str, index: str) -> str:
        """Where the entry at the index is."""
        return self.get(f"getelementptr {kind}, ptr {pointer}, i64 {index}")

    def load(self, kind: str, pointer: str) -> str:
        """Load the value at a pointer."""
        return self.get(f"load {kind}, ptr {pointer}, align {size_of(kind)}")

    def store(self, kind: str, value: str, pointer: str) -> None:
        """Store a value at a pointer."""
        self.do(f"store {kind} {value}, ptr {pointer}, align {size_of(kind)}")

    def text(self) -> str:
        """The body of the function."""
        lines = []
        for i, block in enumerate(self.blocks):
            if block.reached:
                lines.append(f"{block.label}:")
                lines += [f"  {line}" for line in (self.slots if i == 0 else ())]
                lines += [f"  {line}" for line in block.lines]
                if not block.ended:
                    lines.append("  unreachable")
        return "\n".join(lines)


def size_of(kind: str) -> int:
    """Bytes of an LLVM type, which are its alignment too."""
    return {"i32": 4, "i8": 1, "i1": 1}.get(kind, 8)
