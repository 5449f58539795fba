"""Statements of a function, for arguments of given kinds, as LLVM IR.

A variable has one kind all through a function; where it turns out that an integer becomes a real
number later, the function is translated anew with what is known then.
"""

from __future__ import annotations

import ast

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler import arrays
from rb_sim.compiler.builder import Block, Builder, Value, entries, known
from rb_sim.compiler.expressions import Expressions
from rb_sim.compiler.kinds import (
    HERE,
    INTEGER,
    NOTHING,
    Kind,
    KindError,
    Object,
    from_places,
    origins_of,
)
from rb_sim.compiler.signatures import result_type
from rb_sim.compiler.source import tree_of
from rb_sim.compiler.variables import HANDED, RESULT, AgainError


class Translation(Expressions):
    """One function for arguments of some kinds."""

    def function_text(self, name: str, arguments: dict[str, Value]) -> tuple[str, Kind]:
        """The definition of the function, and the kind of what it returns."""
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
        """Return the value."""
        if value.kind.leaves or RESULT in self.variables:
            self.assign(RESULT, value)
        self.go(self.after)

    def body(self, statements: list[ast.stmt]) -> None:
        """One after another, up to one that goes elsewhere."""
        for statement in statements:
            if self.block.ended:
                return
            try:
                getattr(self, f"do_{type(statement).__name__}", self.refuse)(statement)
            except (KindError, AssertionError, ValueError, KeyError, TypeError) as reason:
                raise self.error(statement, reason) from reason

    def do_Pass(self, node: ast.Pass) -> None:  # noqa: N802
        """Nothing."""

    def do_Expr(self, node: ast.Expr) -> None:  # noqa: N802
        if not isinstance(node.value, ast.Constant):
            self.value(node.value)

    def do_Return(self, node: ast.Return) -> None:  # noqa: N802
        self.finish(known(None) if node.value is None else self.value(node.value))

    def do_Break(self, node: ast.Break) -> None:  # noqa: N802
        self.go(self.loops[-1][1])

    def do_Continue(self, node: ast.Continue) -> None:  # noqa: N802
        self.go(self.loops[-1][0])

    def do_Assign(self, node: ast.Assign) -> None:  # noqa: N802
        value = self.value(node.value)
        for target in node.targets:
            self.give(target, value)

    def do_AnnAssign(self, node: ast.AnnAssign) -> None:  # noqa: N802
        if node.value is not None:
            self.give(node.target, self.value(node.value))

    def do_AugAssign(self, node: ast.AugAssign) -> None:  # noqa: N802
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
        """The target of an assignment gets the value."""
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
        yes, no, after = self.label("yes"), self.label("no"), self.label("then")
        self.test(node.test, yes, no)
        for block, statements in ((yes, node.body), (no, node.orelse)):
            self.begin(block)
            self.body(statements)
            self.go(after)
        self.begin(after)

    def do_While(self, node: ast.While) -> None:  # noqa: N802
        look, inside, after = self.label("while"), self.label("do"), self.label("done")
        self.go(look)
        self.begin(look)
        self.test(node.test, inside, after)
        self.begin(inside)
        self.around(node.body, look, after)
        self.go(look)
        self.begin(after)

    def around(self, statements: list[ast.stmt], again: Block, after: Block) -> None:
        """The statements of a loop."""
        self.loops.append((again, after))
        self.body(statements)
        self.loops.pop()

    def do_For(self, node: ast.For) -> None:  # noqa: N802
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
        room = self.room("i64")
        self.store("i64", first.leaf, room)
        look, inside, more, after = (self.label(w) for w in ("for", "each", "more", "done"))
        self.go(look)
        self.begin(look)
        at = self.load("i64", room)
        word = "slt" if step > 0 else "sgt"
        self.part(self.get(f"icmp {word} i64 {at}, {last.leaf}"), inside, after)
        self.begin(inside)
        self.give(node.target, Value(INTEGER, (at,)))
        self.around(node.body, more, after)
        self.go(more)
        self.begin(more)
        self.store("i64", self.get(f"add i64 {self.load('i64', room)}, {step}"), room)
        self.go(look)
        self.begin(after)
        return None

    def each(self, node: ast.For) -> None:
        """A loop over a tuple, written out."""
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
