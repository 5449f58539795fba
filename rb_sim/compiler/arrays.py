# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Arrays in compiled functions: elements, parts, new arrays."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from rb_sim.compiler.arithmetic import converted, integer, real, truth
from rb_sim.compiler.builder import (
    BOOLEAN,
    ELEMENTS,
    HERE,
    INTEGER,
    INTEGERS,
    REAL,
    SIZES,
    VECTOR,
    Array,
    Builder,
    Kind,
    KindError,
    PackedSystem,
    Pointer,
    Value,
)

FIELDS: dict[str, tuple[Any, int]] = {}
"""(kind, first slot) of each field of a packed layout, by name."""

Index = Value | tuple[Value | None, Value | None]
"""A number, or both ends of a slice (None for an omitted end)."""


def checked() -> bool:
    """True if indices are checked, and one out of bounds aborts the process
    (RB_SIM_CHECK_BOUNDS)."""
    return os.environ.get("RB_SIM_CHECK_BOUNDS", "0") not in ("", "0")


def lengths(value: Value) -> tuple[str, ...]:
    """Length of an array along each axis."""
    assert isinstance(value.kind, Array)
    return value.leaves[1 : 1 + value.kind.ndim]


def product(f: Builder, factors: Sequence[str]) -> str:
    """The product of integers."""
    result = "1"
    for factor in factors:
        result = factor if result == "1" else f.get(f"mul i64 {result}, {factor}")
    return result


def whole(f: Builder, value: Value, length: str | None) -> str:
    """An index as an LLVM value; a negative constant counts from the end."""
    if value.kind != INTEGER:
        raise KindError("an index is an integer")
    if isinstance(value.number, int) and value.number < 0:
        if length is None:
            raise KindError("a pointer has no end to count from")
        return f.get(f"add i64 {length}, {value.number}")
    if length is not None and checked():
        inside = f.get(f"icmp ult i64 {value.leaf}, {length}")
        yes, no = f.label("inside"), f.label("outside")
        f.part(inside, yes, no)
        f.begin(no)
        f.do("call void @abort()")
        f.go(yes)
        f.begin(yes)
    return value.leaf


def loaded(f: Builder, element: str, place: str) -> Value:
    """The element of an array at an address."""
    leaf = f.load(ELEMENTS[element], place)
    if element == "real":
        return Value(REAL, (leaf,))
    if element == "flag":
        return Value(BOOLEAN, (f.get(f"trunc i8 {leaf} to i1"),))
    if element == "short":
        leaf = f.get(f"sext i32 {leaf} to i64")
    return Value(INTEGER, (leaf,))


def stored(f: Builder, element: str, place: str, value: Value) -> None:
    """Store the value at an address, converted to the array's element type."""
    if element == "real":
        leaf = real(f, value).leaf
    elif element == "flag":
        leaf = f.get(f"zext i1 {truth(f, value).leaf} to i8")
    else:
        leaf = integer(f, value).leaf
        if element == "short":
            leaf = f.get(f"trunc i64 {leaf} to i32")
    f.store(ELEMENTS[element], leaf, place)


def part_of(f: Builder, array: Value, indices: Sequence[Index]) -> tuple[str, Array | None, Value]:
    """(address, kind or None for a single number, value) of the part of an array chosen by indices.

    One slice is allowed: in the last or only axis after numbers, or in the first axis.
    """
    kind = array.kind
    assert isinstance(kind, Array)
    sizes = lengths(array)
    if len(indices) > kind.ndim:
        raise KindError(f"{len(indices)} indices for {kind.ndim} axes")
    strides = [product(f, sizes[axis + 1 :]) for axis in range(kind.ndim)]
    if kind.strided:
        strides[-1] = array.leaves[-1]
    at, left = "0", []
    for axis in range(kind.ndim):
        index = indices[axis] if axis < len(indices) else (None, None)
        if isinstance(index, tuple):
            first = whole(f, index[0], None) if index[0] is not None else "0"
            last = sizes[axis] if index[1] is None else whole(f, index[1], None)
            if isinstance(index[1], Value) and isinstance(index[1].number, int):
                last = whole(f, index[1], sizes[axis])
            if first != "0":
                last = f.get(f"sub i64 {last}, {first}")
            left.append((axis, last, index != (None, None)))
        else:
            first = whole(f, index, sizes[axis])
        if first != "0":
            step = first if strides[axis] == "1" else f.get(f"mul i64 {first}, {strides[axis]}")
            at = step if at == "0" else f.get(f"add i64 {at}, {step}")
    place = array.leaves[0] if at == "0" else f.place(ELEMENTS[kind.element], array.leaves[0], at)
    if not left:
        return place, None, array
    return place, *_rest(kind, strides, left, place)


def _rest(
    kind: Array, strides: list[str], left: list[tuple[int, str, bool]], place: str
) -> tuple[Array, Value]:
    """(kind, value) of the remaining axes of an array, whose part begins at this address."""
    axes = [axis for axis, _, _ in left]
    counts = tuple(length for _, length, _ in left)
    if len(axes) == 1 and (axes[0] < kind.ndim - 1 or kind.strided):
        found = Array(kind.element, 1, strided=True, origins=kind.origins)
        return found, Value(found, (place, *counts, strides[axes[0]]))
    whole_after_first = all(not cut for _, _, cut in left[1:])
    together = axes == list(range(axes[0], kind.ndim))
    if not together or not whole_after_first or kind.strided:
        # rows with gaps: only reading them would be right
        raise KindError("a part of an array that does not lie in one piece")
    found = Array(kind.element, len(axes), origins=kind.origins)
    return found, Value(found, (place, *counts))


def entry(f: Builder, array: Value, indices: Sequence[Index]) -> Value:
    """The element or part chosen by indices, of an array or behind a pointer."""
    if isinstance(array.kind, Pointer):
        return loaded(f, array.kind.element, _at_pointer(f, array, indices))
    place, _, rest = part_of(f, array, indices)
    if rest is array:
        assert isinstance(array.kind, Array)
        return loaded(f, array.kind.element, place)
    return rest


def put(f: Builder, array: Value, indices: Sequence[Index], value: Value) -> None:
    """Store a number in the element chosen by indices."""
    if isinstance(array.kind, Pointer):
        return stored(f, array.kind.element, _at_pointer(f, array, indices), value)
    if not isinstance(array.kind, Array):
        raise KindError("only arrays have entries that change")
    place, _, rest = part_of(f, array, indices)
    if rest is not array:
        raise KindError("a part of an array is filled by a loop")
    return stored(f, array.kind.element, place, value)


def _at_pointer(f: Builder, array: Value, indices: Sequence[Index]) -> str:
    """Address of an element behind a pointer."""
    assert isinstance(array.kind, Pointer)
    (index,) = indices
    if isinstance(index, tuple):
        raise KindError("a pointer has parts by `part`")
    return f.place(ELEMENTS[array.kind.element], array.leaf, whole(f, index, None))


def first_of(f: Builder, array: Value) -> Value:
    """Pointer to the first element of a contiguous array."""
    if isinstance(array.kind, Pointer):
        return array
    if not isinstance(array.kind, Array) or array.kind.strided:
        raise KindError("no array in one piece")
    return Value(Pointer(array.kind.element), (array.leaves[0],))


def shaped(
    pointer: str, element: str, counts: Sequence[Value], origins: frozenset[int] = frozenset()
) -> Value:
    """The array with these lengths whose elements begin at the pointer."""
    kind = Array(element, len(counts), origins=origins)
    return Value(kind, (pointer, *(count.leaf for count in counts)))


def made(f: Any, element: str, counts: Sequence[Value]) -> Value:
    """A new uninitialised array, on the list of arrays that the function frees when it ends."""
    size = product(f, [*(count.leaf for count in counts), str(SIZES[element])])
    pointer = f.get(f"call ptr @obtain(i64 {size}, ptr {f.owner()})")
    return shaped(pointer, element, counts, frozenset({HERE}))


def filled(f: Builder, array: Value, value: Value) -> Value:
    """The array, with every element set to this number."""
    assert isinstance(array.kind, Array)
    element, kind = array.kind.element, ELEMENTS[array.kind.element]
    count = product(f, lengths(array))
    if value.number is not None and not value.number and str(value.number)[0] != "-":
        size = f.get(f"mul i64 {count}, {SIZES[element]}")
        f.do(
            f"call void @llvm.memset.p0.i64(ptr align 8 {array.leaves[0]}, i8 0, i64 {size}, "
            "i1 false)"
        )
        return array
    number = real(f, value) if element == "real" else value

    def put_one(at: str) -> None:
        stored(f, element, f.place(kind, array.leaves[0], at), number)

    counted(f, count, put_one)
    return array


def copied(f: Builder, to: Value, of: Value) -> Value:
    """`to`, with the elements of `of` copied into it; both have the same lengths."""
    assert isinstance(to.kind, Array) and isinstance(of.kind, Array)
    if of.kind.strided:

        def copy_one(at: str) -> None:
            index = Value(INTEGER, (at,))
            put(f, to, [index], entry(f, of, [index]))

        counted(f, lengths(of)[0], copy_one)
        return to
    count = product(f, [*lengths(of), str(SIZES[of.kind.element])])
    f.do(
        f"call void @llvm.memcpy.p0.p0.i64(ptr align 8 {to.leaves[0]}, "
        f"ptr align 8 {of.leaves[0]}, i64 {count}, i1 false)"
    )
    return to


def counted(f: Builder, count: str, does: object) -> None:
    """Loop that calls does(i) for i from 0 to count - 1."""
    slot = f.slot("i64")
    f.store("i64", "0", slot)
    look, inside, after = f.label("look"), f.label("each"), f.label("after")
    f.go(look)
    f.begin(look)
    at = f.load("i64", slot)
    f.part(f.get(f"icmp slt i64 {at}, {count}"), inside, after)
    f.begin(inside)
    does(at)  # type: ignore[operator]
    f.store("i64", f.get(f"add i64 {at}, 1"), slot)
    f.go(look)
    f.begin(after)


def field_of(f: Builder, system: Value, name: str) -> Value:
    """A field of a system, read from its packed layout."""
    assert isinstance(system.kind, PackedSystem)
    kind, at = FIELDS[name]

    def slot(k: int, type_: str) -> str:
        place = f.place("i64", system.leaf, str(k))
        return f.get(f"load {type_}, ptr {place}, align 8, !invariant.load !0")

    if kind in (REAL, INTEGER):
        return Value(kind, (slot(at, kind.leaves[0]),))
    pointer = slot(at, "ptr")
    return Value(kind, (pointer, *(slot(at + 1 + axis, "i64") for axis in range(kind.ndim))))


def as_kind(f: Builder, value: Value, kind: Kind) -> Value:
    """An address, or a pointer of another kind, as a pointer of this kind."""
    if value.kind in (VECTOR, INTEGERS) or isinstance(value.kind, PackedSystem):
        return Value(kind, value.leaves)
    return Value(kind, (f.get(f"inttoptr i64 {converted(f, value, INTEGER).leaf} to ptr"),))


def length_of(value: Value) -> Value:
    """len(value) for an array."""
    return Value(INTEGER, (lengths(value)[0],))
