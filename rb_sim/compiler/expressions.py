"""Expressions of a function as LLVM IR."""

from __future__ import annotations

import ast
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.builder import Block, Value, entries, tuple_of
from rb_sim.compiler.calls import METHODS, meaning_of
from rb_sim.compiler.kinds import (
    BOOLEAN,
    DTYPES,
    HERE,
    INTEGER,
    REAL,
    Array,
    Complex,
    KindError,
    Object,
    PackedSystem,
    Pointer,
    Tuple,
    common,
    from_nowhere,
    from_places,
    origins_of,
    told,
)
from rb_sim.compiler.signatures import in_order, result_type, taken_apart
from rb_sim.compiler.source import plain_function
from rb_sim.compiler.variables import Variables


class Expressions(Variables):
    """Translates the expressions of a function."""

    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""
        return getattr(self, f"of_{type(node).__name__}", self.refuse)(node)

    def of_Constant(self, node: ast.Constant) -> Value:  # noqa: N802
        return numbers.constant(node.value)

    def of_Name(self, node: ast.Name) -> Value:  # noqa: N802
        if node.id in self.variables:
            return self.read(node.id)
        if node.id not in self.names:
            raise KindError(f"{node.id} has no value here")
        return self.outside(self.names[node.id])

    def outside(self, value: Any) -> Value:
        """An object of the module: numbers and arrays are constants."""
        if isinstance(value, np.ndarray):
            kind = Array(DTYPES[value.dtype], value.ndim)
            return Value(kind, (self.unit.table(value), *map(str, value.shape)))
        if isinstance(value, (np.floating, np.integer)):
            return numbers.constant(value.item())
        return numbers.constant(value)

    def of_Tuple(self, node: ast.Tuple) -> Value:  # noqa: N802
        return tuple_of(self.several(node.elts))

    def several(self, nodes: list[ast.expr]) -> list[Value]:
        """Values in turn; a tuple after a star is its entries."""
        found = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                found += entries(self.value(node.value))
            else:
                found.append(self.value(node))
        return found

    def of_BinOp(self, node: ast.BinOp) -> Value:  # noqa: N802
        return numbers.binary(self, node.op, self.value(node.left), self.value(node.right))

    def of_UnaryOp(self, node: ast.UnaryOp) -> Value:  # noqa: N802
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return numbers.negated(self, value)
        if isinstance(node.op, ast.USub):
            return numbers.minus(self, value)
        return value if isinstance(node.op, ast.UAdd) else self.refuse(node.op)

    def of_Compare(self, node: ast.Compare) -> Value:  # noqa: N802
        left, found = self.value(node.left), []
        for operator, right in zip(node.ops, node.comparators, strict=True):
            other = self.value(right)
            found.append(numbers.compared(self, operator, left, other))
            left = other
        result = found[0]
        for one in found[1:]:
            result = numbers.binary(self, ast.BitAnd(), result, one)
        return result

    def of_BoolOp(self, node: ast.BoolOp) -> Value:  # noqa: N802
        yes, no, after = self.label("yes"), self.label("no"), self.label("both")
        holds = self.test(node, yes, no)
        if holds is not None:
            self.begin(yes if holds else no)
            return numbers.constant(holds)
        ways = []
        for block, word in ((yes, "true"), (no, "false")):
            self.begin(block)
            self.go(after)
            if block.reached:
                ways.append(f"[ {word}, %{block.label} ]")
        self.begin(after)
        return Value(BOOLEAN, (self.get(f"phi i1 {', '.join(ways)}"),))

    def test(self, node: ast.expr, yes: Block, no: Block) -> bool | None:
        """Jump to one block or the other; returns whether it holds, where that is known."""
        if isinstance(node, ast.BoolOp):
            return self.test_several(node, yes, no)
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            holds = self.test(node.operand, no, yes)
            return None if holds is None else not holds
        holds = numbers.truth(self, self.value(node))
        if holds.number is not None:
            self.go(yes if holds.number else no)
            return bool(holds.number)
        self.part(holds.leaf, yes, no)
        return None

    def test_several(self, node: ast.BoolOp, yes: Block, no: Block) -> bool | None:
        """As `test`, of operands that are looked at in turn as far as need be."""
        every, known_all = isinstance(node.op, ast.And), True
        for operand in node.values[:-1]:
            more = self.label("and" if every else "or")
            holds = self.test(operand, more if every else yes, no if every else more)
            if holds is (not every):
                return holds if known_all else None
            known_all = known_all and holds is not None
            self.begin(more)
        holds = self.test(node.values[-1], yes, no)
        return holds if known_all else None

    def of_IfExp(self, node: ast.IfExp) -> Value:  # noqa: N802
        yes, no, after = self.label("yes"), self.label("no"), self.label("either")
        holds = self.test(node.test, yes, no)
        if holds is not None:
            self.begin(yes if holds else no)
            return self.value(node.body if holds else node.orelse)
        self.begin(yes)
        a, end_a = self.value(node.body), self.block
        self.begin(no)
        b, end_b = self.value(node.orelse), self.block
        kind = common(a.kind, b.kind)
        found = []
        for value, end in ((a, end_a), (b, end_b)):
            self.block = end
            found.append(numbers.converted(self, value, kind))
            self.go(after)
        self.begin(after)
        leaves = tuple(
            self.get(f"phi {type_} [ {x}, %{end_a.label} ], [ {y}, %{end_b.label} ]")
            for type_, x, y in zip(kind.leaves, found[0].leaves, found[1].leaves, strict=True)
        )
        return Value(kind, leaves)

    def of_Attribute(self, node: ast.Attribute) -> Value:  # noqa: N802
        value = self.value(node.value)
        kind = value.kind
        if isinstance(kind, Object):
            return self.outside(getattr(kind.value, node.attr))
        if isinstance(kind, PackedSystem):
            return arrays.field_of(self, value, node.attr)
        if isinstance(kind, Tuple) and kind.of is not None:
            return entries(value)[kind.of._fields.index(node.attr)]  # type: ignore[attr-defined]
        if isinstance(kind, Array) and node.attr == "shape":
            return tuple_of([Value(INTEGER, (length,)) for length in arrays.lengths(value)])
        if isinstance(kind, Complex) and node.attr in ("real", "imag"):
            return Value(REAL, (value.leaves[node.attr == "imag"],))
        raise KindError(f"{told(kind)} has no {node.attr}")

    def of_Subscript(self, node: ast.Subscript) -> Value:  # noqa: N802
        value = self.value(node.value)
        if isinstance(value.kind, Tuple):
            return self.of_tuple(value, node.slice)
        if not isinstance(value.kind, (Array, Pointer)):
            raise KindError(f"{told(value.kind)} has no entries")
        return arrays.entry(self, value, self.indices(node.slice))

    def of_tuple(self, value: Value, index: ast.expr) -> Value:
        """An entry or a part of a tuple."""
        parts = entries(value)
        if isinstance(index, ast.Slice):
            ends = [None if e is None else self.value(e).number for e in (index.lower, index.upper)]
            return tuple_of(parts[slice(*ends)])
        at = self.value(index)
        if isinstance(at.number, int):
            return parts[at.number]
        found = numbers.converted(self, parts[-1], parts[0].kind)
        for k in range(len(parts) - 2, -1, -1):
            here = self.get(f"icmp eq i64 {at.leaf}, {k}")
            found = numbers.selected(self, here, parts[k], found)
        return found

    def indices(self, node: ast.expr) -> list[arrays.Index]:
        """The indices that stand in brackets."""
        nodes = node.elts if isinstance(node, ast.Tuple) else [node]
        found: list[arrays.Index] = []
        for one in nodes:
            if isinstance(one, ast.Slice):
                ends = (one.lower, one.upper)
                first, last = (None if end is None else self.value(end) for end in ends)
                found.append((first, last))
            else:
                value = self.value(one)
                found += entries(value) if isinstance(value.kind, Tuple) else [value]
        return found

    def of_Call(self, node: ast.Call) -> Value:  # noqa: N802
        arguments = self.several(node.args)
        words = {word.arg: self.value(word.value) for word in node.keywords if word.arg}
        if isinstance(node.func, ast.Attribute):
            on = self.value(node.func.value)
            if isinstance(on.kind, Array):
                return METHODS[node.func.attr](self, on, *arguments, **words)
            if isinstance(on.kind, Tuple) and node.func.attr == "_replace":
                return self.replaced(on, words)
        called = self.value(node.func).kind
        if not isinstance(called, Object):
            raise KindError("only functions that are known are called")
        return self.call(called.value, arguments, words)

    def replaced(self, value: Value, words: dict[str, Value]) -> Value:
        """The NamedTuple with other entries."""
        assert isinstance(value.kind, Tuple) and value.kind.of is not None
        names = value.kind.of._fields  # type: ignore[attr-defined]
        parts = [words.get(n, e) for n, e in zip(names, entries(value), strict=True)]
        return tuple_of(parts, value.kind.of)

    def call(self, called: Any, arguments: list[Value], words: dict[str, Value]) -> Value:
        """Translate a call of the object; returns its value."""
        handler = meaning_of(called)
        if handler is not None:
            return handler(self, *arguments, **words)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return tuple_of(in_order(called, arguments, words), called)
        chosen = getattr(called, "chosen", None)  # by the kinds of its arguments
        if chosen is not None:
            called = chosen([value.kind for value in arguments])
        function = plain_function(called)
        if function is None or isinstance(called, ModuleType):
            raise KindError(f"{called!r} is not compiled")
        return self.call_function(function, in_order(function, arguments, words))

    def call_function(self, function: FunctionType, arguments: list[Value]) -> Value:
        """A call of another compiled function."""
        name, result = self.unit.instance(function, tuple(from_nowhere(v.kind) for v in arguments))

        def here(places: frozenset[int]) -> frozenset[int]:
            return frozenset().union(
                *(
                    {HERE} if place == HERE else origins_of(arguments[place].kind)
                    for place in places
                )
            )

        new = HERE in origins_of(result)
        leaves = ", ".join(
            f"{kind} {leaf}"
            for value in arguments
            for kind, leaf in zip(value.kind.leaves, value.leaves, strict=True)
        )
        if new:
            leaves += f"{', ' if leaves else ''}ptr {self.owner()}"
        call = f"call fastcc {result_type(result)} {name}({leaves})"
        if not result.leaves:
            self.do(call)
            return Value(result, ())
        return taken_apart(self, self.get(call), from_places(result, here))
