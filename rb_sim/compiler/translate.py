# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Translation of a function to LLVM IR: variables, expressions, statements."""

from __future__ import annotations

import ast
from types import FunctionType, ModuleType
from typing import Any

import numpy as np

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.builder import (
    BOOLEAN,
    DTYPES,
    HERE,
    INTEGER,
    NOTHING,
    REAL,
    Array,
    Block,
    Builder,
    Complex,
    Kind,
    KindError,
    Object,
    PackedSystem,
    Pointer,
    Tuple,
    Value,
    common,
    entries,
    from_nowhere,
    from_places,
    kind_text,
    known,
    origins_of,
    tuple_of,
)
from rb_sim.compiler.calls import METHODS, meaning_of
from rb_sim.compiler.source import (
    in_order,
    names_of,
    plain_function,
    result_type,
    taken_apart,
    tree_of,
)

# The variables of a function being translated: each has one kind throughout.


class CompileError(TypeError):
    """Raised for a function that cannot be compiled; the text has file, line and reason."""


class AgainError(Exception):
    """Raised if a variable needs another kind than assumed: the translation is repeated."""


class Variable:
    """A variable of the function: its kind, and a stack slot for each leaf."""

    def __init__(self, f: Builder, kind: Kind) -> None:
        self.kind, self.slots = kind, [f.slot(leaf) for leaf in kind.leaves]


RESULT = "return"
"""Name of the variable that holds the returned value."""
HANDED = "new arrays"
"""Key among the known kinds: the function returns arrays that it has made."""


class Variables(Builder):
    """Writer of a function with variables; `unit` translates the functions that it calls.

    kinds: of variables, known from earlier attempts.
    """

    def __init__(self, unit: Any, function: FunctionType, kinds: dict[str, Kind]) -> None:
        super().__init__()
        self.unit, self.function, self.kinds = unit, function, kinds
        self.names = names_of(function)
        self.variables: dict[str, Variable] = {}
        self.loops: list[tuple[Block, Block]] = []
        """(target of `continue`, target of `break`) of the enclosing loops."""
        self.hands_over = HANDED in kinds
        """whether it returns an array that it has made: then its caller frees its arrays."""
        self.list = ""
        self.after = self.label("end")

    def error(self, node: ast.AST, reason: Exception) -> CompileError:
        """The reason as a CompileError with file and line."""
        if isinstance(reason, CompileError):
            return reason
        line = getattr(node, "lineno", 0)
        path = self.function.__code__.co_filename
        return CompileError(f"{path}:{line}: {self.function.__qualname__}: {reason}")

    def assign(self, name: str, value: Value) -> None:
        """Assign a value to a variable. Raises AgainError if its kind changes."""
        variable = self.variables.get(name)
        if variable is None:
            kind = self.kinds.get(name, value.kind)
            variable = self.variables[name] = Variable(self, common(kind, value.kind))
            if name in self.kinds and variable.kind != kind:
                self.kinds[name] = variable.kind
        elif variable.kind != value.kind:
            kind = common(variable.kind, value.kind)
            if kind != variable.kind:
                self.kinds[name] = kind
                raise AgainError
        leaves = numbers.converted(self, value, variable.kind).leaves
        for leaf, slot, type_ in zip(leaves, variable.slots, variable.kind.leaves, strict=True):
            self.store(type_, leaf, slot)

    def read(self, name: str) -> Value:
        """The value of a variable."""
        variable = self.variables[name]
        leaves = tuple(
            self.load(kind, slot)
            for kind, slot in zip(variable.kind.leaves, variable.slots, strict=True)
        )
        return Value(variable.kind, leaves)

    def owner(self) -> str:
        """Address of the list of arrays that are freed when the function, or its caller, ends."""
        if self.hands_over:
            return "%owner"
        if not self.list:
            self.list = self.slot("ptr")
            self.slots.append(f"store ptr null, ptr {self.list}, align 8")
        return self.list

    def refuse(self, node: ast.AST) -> Any:
        """Refuse a node of the syntax tree that has no translation. Raises KindError."""
        raise KindError(f"{type(node).__name__} is not compiled")


# Expressions of a function as LLVM IR.


class Expressions(Variables):
    """Writer of the expressions of a function."""

    def value(self, node: ast.expr) -> Value:
        """The value of an expression."""
        return getattr(self, f"of_{type(node).__name__}", self.refuse)(node)

    def of_Constant(self, node: ast.Constant) -> Value:  # noqa: N802
        """A constant of the source."""
        return numbers.constant(node.value)

    def of_Name(self, node: ast.Name) -> Value:  # noqa: N802
        """A variable of the function, else an object of its module.

        Raises KindError for a name that has no value.
        """
        if node.id in self.variables:
            return self.read(node.id)
        if node.id not in self.names:
            raise KindError(f"{node.id} has no value here")
        return self.outside(self.names[node.id])

    def outside(self, value: Any) -> Value:
        """The value of an object from outside the function; numbers and arrays are constants."""
        if isinstance(value, np.ndarray):
            kind = Array(DTYPES[value.dtype], value.ndim)
            return Value(kind, (self.unit.table(value), *map(str, value.shape)))
        if isinstance(value, (np.floating, np.integer)):
            return numbers.constant(value.item())
        return numbers.constant(value)

    def of_Tuple(self, node: ast.Tuple) -> Value:  # noqa: N802
        """A tuple of values."""
        return tuple_of(self.several(node.elts))

    def several(self, nodes: list[ast.expr]) -> list[Value]:
        """Values of the nodes in order; a starred tuple gives its entries."""
        found = []
        for node in nodes:
            if isinstance(node, ast.Starred):
                found += entries(self.value(node.value))
            else:
                found.append(self.value(node))
        return found

    def of_BinOp(self, node: ast.BinOp) -> Value:  # noqa: N802
        """An operation on two values."""
        return numbers.binary(self, node.op, self.value(node.left), self.value(node.right))

    def of_UnaryOp(self, node: ast.UnaryOp) -> Value:  # noqa: N802
        """`not`, minus or plus."""
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            return numbers.negated(self, value)
        if isinstance(node.op, ast.USub):
            return numbers.minus(self, value)
        return value if isinstance(node.op, ast.UAdd) else self.refuse(node.op)

    def of_Compare(self, node: ast.Compare) -> Value:  # noqa: N802
        """A chain of comparisons that must all hold; unlike in Python each operand is evaluated."""
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
        """`and`, `or`: the second operand is evaluated only if necessary."""
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
        """Jump by a condition; returns its value if that is known at compile time, else None."""
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
        """As `test`, for `and` and `or`: operands are evaluated in order as far as necessary."""
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
        """One of two values of a common kind; only that one is evaluated."""
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
        """An attribute: of a module, a packed system, a named tuple, an array or a complex number.

        Raises KindError for any other.
        """
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
        raise KindError(f"{kind_text(kind)} has no {node.attr}")

    def of_Subscript(self, node: ast.Subscript) -> Value:  # noqa: N802
        """An entry of a tuple, of an array or behind a pointer.

        Raises KindError for any other kind.
        """
        value = self.value(node.value)
        if isinstance(value.kind, Tuple):
            return self.of_tuple(value, node.slice)
        if not isinstance(value.kind, (Array, Pointer)):
            raise KindError(f"{kind_text(value.kind)} has no entries")
        return arrays.entry(self, value, self.indices(node.slice))

    def of_tuple(self, value: Value, index: ast.expr) -> Value:
        """An entry or a slice of a tuple."""
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
        """The indices in brackets."""
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
        """A call of an array method, of `_replace`, or of a function known at compile time.

        Raises KindError for any other.
        """
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
        """The NamedTuple with some entries replaced."""
        assert isinstance(value.kind, Tuple) and value.kind.of is not None
        names = value.kind.of._fields  # type: ignore[attr-defined]
        parts = [words.get(n, e) for n, e in zip(names, entries(value), strict=True)]
        return tuple_of(parts, value.kind.of)

    def call(self, called: Any, arguments: list[Value], words: dict[str, Value]) -> Value:
        """Translate a call of the object; returns its value. Raises KindError if it cannot be
        compiled."""
        handler = meaning_of(called)
        if handler is not None:
            return handler(self, *arguments, **words)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return tuple_of(in_order(called, arguments, words), called)
        chosen = getattr(called, "chosen", None)  # a variant by argument kinds
        if chosen is not None:
            called = chosen([value.kind for value in arguments])
        function = plain_function(called)
        if function is None or isinstance(called, ModuleType):
            raise KindError(f"{called!r} is not compiled")
        return self.call_function(function, in_order(function, arguments, words))

    def call_function(self, function: FunctionType, arguments: list[Value]) -> Value:
        """Translate a call of another compiled function; returns its value."""
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


# Statements of a function, for arguments of given kinds.
#
# A variable has one kind throughout a function; if an integer turns out to become a real number
# later, the translation is repeated with that knowledge.


class Translation(Expressions):
    """Translation of one function for arguments of given kinds."""

    def function_text(self, name: str, arguments: dict[str, Value]) -> tuple[str, Kind]:
        """(definition of the function, kind of its result)."""
        tree = tree_of(self.function)
        for place, (word, value) in enumerate(arguments.items()):
            kind = from_places(value.kind, lambda _, place=place: frozenset({place}))
            self.assign(word, Value(kind, value.leaves))
        self.body(tree.body)
        if not self.block.ended:
            self.finish(known(None))
        self.begin(self.after)
        result = self.variables.get(RESULT)
        kind: Kind = NOTHING if result is None else result.kind
        if HERE in origins_of(kind) and not self.hands_over:
            self.kinds[HANDED] = NOTHING
            raise AgainError
        value = self.read(RESULT) if kind.leaves else known(None)
        if self.list and not self.hands_over:
            self.do(f"call void @release(ptr {self.list})")
        self.do(returned(self, kind, value))
        leaves = [f"{leaf} {at}" for value in arguments.values()
                  for leaf, at in zip(value.kind.leaves, value.leaves, strict=True)]  # fmt: skip
        if HERE in origins_of(kind):
            leaves.append("ptr %owner")
        head = f"define internal fastcc {result_type(kind)} {name}({', '.join(leaves)})"
        return f"{head} nounwind {{\n{self.text()}\n}}\n", kind

    def finish(self, value: Value) -> None:
        """Write a return of the value."""
        if value.kind.leaves or RESULT in self.variables:
            self.assign(RESULT, value)
        self.go(self.after)

    def body(self, statements: list[ast.stmt]) -> None:
        """Translate statements in sequence, up to one that leaves the block."""
        for statement in statements:
            if self.block.ended:
                return
            try:
                getattr(self, f"do_{type(statement).__name__}", self.refuse)(statement)
            except (KindError, AssertionError, ValueError, KeyError, TypeError) as reason:
                raise self.error(statement, reason) from reason

    def do_Pass(self, node: ast.Pass) -> None:  # noqa: N802
        """Write nothing."""

    def do_Expr(self, node: ast.Expr) -> None:  # noqa: N802
        """Translate an expression statement; docstrings are skipped."""
        if not isinstance(node.value, ast.Constant):
            self.value(node.value)

    def do_Return(self, node: ast.Return) -> None:  # noqa: N802
        """Return a value from the function."""
        self.finish(known(None) if node.value is None else self.value(node.value))

    def do_Break(self, node: ast.Break) -> None:  # noqa: N802
        """Jump out of the innermost loop."""
        self.go(self.loops[-1][1])

    def do_Continue(self, node: ast.Continue) -> None:  # noqa: N802
        """Jump to the next iteration of the innermost loop."""
        self.go(self.loops[-1][0])

    def do_Assign(self, node: ast.Assign) -> None:  # noqa: N802
        """Assign a value to one or several targets."""
        value = self.value(node.value)
        for target in node.targets:
            self.give(target, value)

    def do_AnnAssign(self, node: ast.AnnAssign) -> None:  # noqa: N802
        """Assign a value to an annotated target, if there is one."""
        if node.value is not None:
            self.give(node.target, self.value(node.value))

    def do_AugAssign(self, node: ast.AugAssign) -> None:  # noqa: N802
        """Update a variable, or an array element, whose indices are evaluated once."""
        if isinstance(node.target, ast.Name):
            before = self.value(node.target)
            self.give(node.target, numbers.binary(self, node.op, before, self.value(node.value)))
            return
        assert isinstance(node.target, ast.Subscript)
        array, indices = self.value(node.target.value), self.indices(node.target.slice)
        before = arrays.entry(self, array, indices)
        after = numbers.binary(self, node.op, before, self.value(node.value))
        arrays.put(self, array, indices, after)

    def give(self, target: ast.expr, value: Value) -> None:
        """Assign the value to a target."""
        if isinstance(target, ast.Name):
            if target.id != "_":
                self.assign(target.id, value)
        elif isinstance(target, ast.Subscript):
            arrays.put(self, self.value(target.value), self.indices(target.slice), value)
        elif isinstance(target, (ast.Tuple, ast.List)):
            for one, part in zip(target.elts, entries(value), strict=True):
                self.give(one, part)
        else:
            self.refuse(target)

    def do_If(self, node: ast.If) -> None:  # noqa: N802
        """Translate both branches of an `if`."""
        yes, no, after = self.label("yes"), self.label("no"), self.label("then")
        self.test(node.test, yes, no)
        for block, statements in ((yes, node.body), (no, node.orelse)):
            self.begin(block)
            self.body(statements)
            self.go(after)
        self.begin(after)

    def do_While(self, node: ast.While) -> None:  # noqa: N802
        """Translate a `while` loop."""
        look, inside, after = self.label("while"), self.label("do"), self.label("done")
        self.go(look)
        self.begin(look)
        self.test(node.test, inside, after)
        self.begin(inside)
        self.around(node.body, look, after)
        self.go(look)
        self.begin(after)

    def around(self, statements: list[ast.stmt], again: Block, after: Block) -> None:
        """Translate the body of a loop; again, after: targets of `continue` and `break`."""
        self.loops.append((again, after))
        self.body(statements)
        self.loops.pop()

    def do_For(self, node: ast.For) -> None:  # noqa: N802
        """Translate a loop over a range with a constant step; over a tuple, see `each`.

        Raises KindError for a step that is not a constant.
        """
        call = node.iter
        if not (isinstance(call, ast.Call) and self.value(call.func).kind == Object(range)):
            return self.each(node)
        ends = [numbers.converted(self, self.value(a), INTEGER) for a in call.args]
        first = ends[0] if len(ends) > 1 else numbers.constant(0)
        last, step = ends[min(1, len(ends) - 1)], 1
        if len(ends) == 3:
            if not isinstance(ends[2].number, int) or not ends[2].number:
                raise KindError("the step of a range is a constant")
            step = ends[2].number
        slot = self.slot("i64")
        self.store("i64", first.leaf, slot)
        look, inside, more, after = (self.label(w) for w in ("for", "each", "more", "done"))
        self.go(look)
        self.begin(look)
        at = self.load("i64", slot)
        word = "slt" if step > 0 else "sgt"
        self.part(self.get(f"icmp {word} i64 {at}, {last.leaf}"), inside, after)
        self.begin(inside)
        self.give(node.target, Value(INTEGER, (at,)))
        self.around(node.body, more, after)
        self.go(more)
        self.begin(more)
        self.store("i64", self.get(f"add i64 {self.load('i64', slot)}, {step}"), slot)
        self.go(look)
        self.begin(after)
        return None

    def each(self, node: ast.For) -> None:
        """Translate an unrolled loop over a tuple."""
        values, after = entries(self.value(node.iter)), self.label("done")
        for value in values:
            more = self.label("more")
            self.give(node.target, value)
            self.around(node.body, more, after)
            self.go(more)
            self.begin(more)
        self.go(after)
        self.begin(after)


def returned(f: Builder, kind: Kind, value: Value) -> str:
    """The instruction that returns a value."""
    if not kind.leaves:
        return "ret void"
    whole = value.leaves[0]
    if len(kind.leaves) > 1:
        whole = "undef"
        for i, (type_, leaf) in enumerate(zip(kind.leaves, value.leaves, strict=True)):
            whole = f.get(f"insertvalue {result_type(kind)} {whole}, {type_} {leaf}, {i}")
    return f"ret {result_type(kind)} {whole}"
