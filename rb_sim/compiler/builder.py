# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Blocks and instructions of a function as LLVM IR text, and the kinds of its values."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

ELEMENTS = {"real": "double", "integer": "i64", "short": "i32", "flag": "i8"}
"""LLVM types of array elements."""

DTYPES = {
    np.dtype(np.float64): "real",
    np.dtype(np.int64): "integer",
    np.dtype(np.int32): "short",
    np.dtype(np.bool_): "flag",
}
SIZES = {"real": 8, "integer": 8, "short": 4, "flag": 1}


@dataclass(frozen=True)
class Kind:
    """The type of a value in compiled functions; `leaves` are the LLVM types that represent it."""

    @property
    def leaves(self) -> tuple[str, ...]:
        """Empty by default."""
        return ()


@dataclass(frozen=True)
class Number(Kind):
    """A real number, a 64-bit integer or a boolean."""

    name: str
    type: str

    @property
    def leaves(self) -> tuple[str, ...]:
        """One leaf: the LLVM type itself."""
        return (self.type,)


REAL, INTEGER, BOOLEAN = Number("real", "double"), Number("integer", "i64"), Number("boolean", "i1")
RANKS = {BOOLEAN: 0, INTEGER: 1, REAL: 2}


@dataclass(frozen=True)
class Complex(Kind):
    """A complex number."""

    @property
    def leaves(self) -> tuple[str, ...]:
        """Two leaves: real and imaginary part."""
        return "double", "double"


COMPLEX = Complex()


@dataclass(frozen=True)
class Pointer(Kind):
    """Address of numbers, without a length."""

    element: str

    @property
    def leaves(self) -> tuple[str, ...]:
        """One leaf: the address."""
        return ("ptr",)


HERE = -1

VECTOR, INTEGERS = Pointer("real"), Pointer("integer")


@dataclass(frozen=True)
class Array(Kind):
    """An array, represented by its address and its lengths; C-contiguous unless `strided`.

    For a strided array the last leaf is the distance of the elements along its last axis. origins:
    possible sources of the array: HERE if it is made in the function, and the indices of arguments
    from which it may come.
    """

    element: str
    ndim: int
    strided: bool = False
    origins: frozenset[int] = frozenset()

    @property
    def leaves(self) -> tuple[str, ...]:
        """Address, length of each axis, and the distance of elements if strided."""
        return ("ptr",) + ("i64",) * (self.ndim + self.strided)


@dataclass(frozen=True)
class PackedSystem(Kind):
    """A system behind the address of its packed layout; see `rb_sim.integrate.layout`."""

    fields: Any = field(compare=False, default=None)

    @property
    def leaves(self) -> tuple[str, ...]:
        """One leaf: the address of the layout."""
        return ("ptr",)


@dataclass(frozen=True)
class Tuple(Kind):
    """A tuple, or an instance of a NamedTuple class."""

    kinds: tuple[Kind, ...]
    of: type | None = None

    @property
    def leaves(self) -> tuple[str, ...]:
        """The leaves of its entries in order."""
        return tuple(leaf for kind in self.kinds for leaf in kind.leaves)


class Object(Kind):
    """A value known at compile time: a function, class, module, string, or None."""

    def __init__(self, value: Any) -> None:
        object.__setattr__(self, "value", value)

    value: Any

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Object) and (
            self.value is other.value or (isinstance(self.value, str) and self.value == other.value)
        )

    def __hash__(self) -> int:
        return hash(self.value) if isinstance(self.value, str) else id(self.value)


NOTHING = Object(None)


class KindError(TypeError):
    """Raised for a value whose kind is not allowed, or for kinds without a common one."""


def common(a: Kind, b: Kind) -> Kind:
    """The kind to which values of both kinds can be converted. Raises KindError if there is
    none."""
    if a == b:
        return a
    if isinstance(a, Number) and isinstance(b, Number):
        return a if RANKS[a] > RANKS[b] else b
    if isinstance(a, Array) and isinstance(b, Array) and (a.element, a.ndim) == (b.element, b.ndim):
        return Array(a.element, a.ndim, a.strided or b.strided, a.origins | b.origins)
    if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.kinds) == len(b.kinds):
        kinds = tuple(common(x, y) for x, y in zip(a.kinds, b.kinds, strict=True))
        return Tuple(kinds, a.of if a.of is b.of else None)
    raise KindError(f"{kind_text(a)} and {kind_text(b)}")


def kind_text(kind: Kind) -> str:
    """The kind in words."""
    if isinstance(kind, Number):
        return kind.name
    if isinstance(kind, Tuple):
        inside = ", ".join(kind_text(k) for k in kind.kinds)
        return f"{kind.of.__name__ if kind.of else ''}({inside})"
    if isinstance(kind, Array):
        return f"array of {kind.element} of {kind.ndim} axes"
    if isinstance(kind, Object):
        return f"{kind.value!r}"
    return type(kind).__name__.lower()


def origins_of(kind: Kind) -> frozenset[int]:
    """Possible sources of all arrays in a value of this kind."""
    if isinstance(kind, Tuple):
        return frozenset().union(*(origins_of(k) for k in kind.kinds))
    return kind.origins if isinstance(kind, Array) else frozenset()


def from_places(kind: Kind, places: Callable[[frozenset[int]], frozenset[int]]) -> Kind:
    """The kind with the origins of its arrays replaced by `places(origins)`."""
    if isinstance(kind, Tuple):
        return Tuple(tuple(from_places(k, places) for k in kind.kinds), kind.of)
    if isinstance(kind, Array):
        return Array(kind.element, kind.ndim, kind.strided, places(kind.origins))
    return kind


def from_nowhere(kind: Kind) -> Kind:
    """The kind without the origins of its arrays."""
    return from_places(kind, lambda origins: frozenset())


@dataclass(frozen=True)
class Value:
    """A value in a compiled function: its kind and its LLVM values.

    number: the Python constant, if it is one.
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
    """The tuple of these values; of: its NamedTuple class."""
    leaves = tuple(leaf for value in values for leaf in value.leaves)
    return Value(Tuple(tuple(value.kind for value in values), of), leaves)


def known(value: Any) -> Value:
    """The value of an object known at compile time."""
    return Value(Object(value), ())


def real_text(x: float) -> str:
    """The exact LLVM constant of a double."""
    return f"0x{struct.unpack('<Q', struct.pack('<d', x))[0]:016X}"


class Block:
    """A basic block: instructions in sequence, the last of which leaves it.

    ended: it is complete; reached: another block jumps to it.
    """

    def __init__(self, label: str) -> None:
        self.label, self.lines = label, list[str]()
        self.ended, self.reached = False, False


class Builder:
    """Writer of one function."""

    def __init__(self) -> None:
        self._count = 0
        self.slots: list[str] = []
        """Instructions at the beginning of the function (stack slots)."""
        self.blocks: list[Block] = []
        first = self.label("begin")
        first.reached = True
        self.block = self.begin(first)

    def label(self, word: str) -> Block:
        """A new block that begins later."""
        self._count += 1
        return Block(f"{word}{self._count}")

    def begin(self, block: Block) -> Block:
        """Write into the block from now on; an unreachable block stays empty."""
        self.blocks.append(block)
        self.block = block
        block.ended = not block.reached
        return block

    def name(self) -> str:
        """A new name for an LLVM value."""
        self._count += 1
        return f"%v{self._count}"

    def do(self, text: str) -> None:
        """Write an instruction without a result; nothing in unreachable code."""
        if not self.block.ended:
            self.block.lines.append(text)
            self.block.ended = text.startswith("ret ")

    def get(self, text: str) -> str:
        """Write an instruction; returns the name of its result."""
        name = self.name()
        self.do(f"{name} = {text}")
        return name

    def go(self, block: Block) -> None:
        """End the block with a jump."""
        if not self.block.ended:
            self.do(f"br label %{block.label}")
            self.block.ended = block.reached = True

    def part(self, condition: str, yes: Block, no: Block) -> None:
        """End the block with a conditional jump."""
        if not self.block.ended:
            self.do(f"br i1 {condition}, label %{yes.label}, label %{no.label}")
            self.block.ended = yes.reached = no.reached = True

    def slot(self, kind: str) -> str:
        """A stack slot for a value of an LLVM type, for the duration of the function."""
        name = self.name()
        self.slots.append(f"{name} = alloca {kind}, align 8")
        return name

    def place(self, kind: str, pointer: str, index: str) -> str:
        """Address of the element at an index."""
        return self.get(f"getelementptr {kind}, ptr {pointer}, i64 {index}")

    def load(self, kind: str, pointer: str) -> str:
        """Load the value at a pointer."""
        return self.get(f"load {kind}, ptr {pointer}, align {size_of(kind)}")

    def store(self, kind: str, value: str, pointer: str) -> None:
        """Store a value at a pointer."""
        self.do(f"store {kind} {value}, ptr {pointer}, align {size_of(kind)}")

    def text(self) -> str:
        """LLVM IR of the body of the function."""
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
    """Size of an LLVM type [bytes], which is also its alignment."""
    return {"i32": 4, "i8": 1, "i1": 1}.get(kind, 8)
