"""The variables of a function that is being translated: each has one kind all through it."""

from __future__ import annotations

import ast
from types import FunctionType
from typing import Any

from rb_sim.compiler import arithmetic as numbers
from rb_sim.compiler.builder import Block, Builder, Value
from rb_sim.compiler.kinds import Kind, KindError, common
from rb_sim.compiler.source import names_of


class CompileError(TypeError):
    """Tells what is wrong with a function, and in which line."""


class AgainError(Exception):
    """A variable has another kind than was thought."""


class Variable:
    """A variable of the function: its kind, and where each of its leaves is kept."""

    def __init__(self, f: Builder, kind: Kind) -> None:
        self.kind, self.rooms = kind, [f.room(leaf) for leaf in kind.leaves]


RESULT = "return"
"""The name under which what is returned is a variable like others."""
HANDED = "new arrays"
"""Among the kinds that are known: the function returns arrays that it has made."""


class Variables(Builder):
    """A function with its variables; `unit` makes the functions that it calls.

    kinds: of variables that are known from an earlier try.
    """

    def __init__(self, unit: Any, function: FunctionType, kinds: dict[str, Kind]) -> None:
        super().__init__()
        self.unit, self.function, self.kinds = unit, function, kinds
        self.names = names_of(function)
        self.variables: dict[str, Variable] = {}
        self.loops: list[tuple[Block, Block]] = []
        """(where `continue` goes, where `break` goes) of the loops around."""
        self.hands_over = HANDED in kinds
        """Whether it returns an array that it has made: its caller frees what it makes."""
        self.list = ""
        self.after = self.label("end")

    def error(self, node: ast.AST, reason: Exception) -> CompileError:
        """The reason with its place."""
        if isinstance(reason, CompileError):
            return reason
        line = getattr(node, "lineno", 0)
        path = self.function.__code__.co_filename
        return CompileError(f"{path}:{line}: {self.function.__qualname__}: {reason}")

    def assign(self, name: str, value: Value) -> None:
        """The variable gets the value."""
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
        for leaf, room, type_ in zip(leaves, variable.rooms, variable.kind.leaves, strict=True):
            self.store(type_, leaf, room)

    def read(self, name: str) -> Value:
        """The value of a variable."""
        variable = self.variables[name]
        leaves = tuple(
            self.load(kind, room)
            for kind, room in zip(variable.kind.leaves, variable.rooms, strict=True)
        )
        return Value(variable.kind, leaves)

    def owner(self) -> str:
        """Where the list of the arrays is that are freed when the function ends, or its caller."""
        if self.hands_over:
            return "%owner"
        if not self.list:
            self.list = self.room("ptr")
            self.rooms.append(f"store ptr null, ptr {self.list}, align 8")
        return self.list

    def refuse(self, node: ast.AST) -> Any:
        raise KindError(f"{type(node).__name__} is not compiled")
