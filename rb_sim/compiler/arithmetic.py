# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Numbers in compiled functions: conversions, operators, comparisons.

Semantics are those of Python's floats, but nothing is raised: a quotient by zero is infinite or
NaN, as in IEEE 754.
"""

from __future__ import annotations

import ast
from typing import Any

from rb_sim.compiler.builder import (
    BOOLEAN,
    COMPLEX,
    INTEGER,
    RANKS,
    REAL,
    Array,
    Builder,
    Complex,
    Kind,
    KindError,
    Number,
    Object,
    Tuple,
    Value,
    common,
    entries,
    kind_text,
    known,
    real_text,
    tuple_of,
)


def constant(value: Any) -> Value:
    """The value of a Python number, or of a tuple of numbers; of any other object a known value."""
    if isinstance(value, bool):
        return Value(BOOLEAN, ("true" if value else "false",), value)
    if isinstance(value, int):
        return Value(INTEGER, (str(value),), value)
    if isinstance(value, float):
        return Value(REAL, (real_text(value),), value)
    if isinstance(value, tuple):
        of = type(value) if type(value) is not tuple else None
        return tuple_of([constant(entry) for entry in value], of)
    return known(value)


def converted(f: Builder, value: Value, kind: Kind) -> Value:
    """The value converted to a kind. Raises KindError if there is no conversion."""
    if value.kind == kind:
        return value
    if isinstance(kind, Tuple) and isinstance(value.kind, Tuple):
        parts = zip(entries(value), kind.kinds, strict=True)
        return tuple_of([converted(f, part, to) for part, to in parts], kind.of)
    if isinstance(kind, Array) and isinstance(value.kind, Array):
        leaves = value.leaves
        if kind.strided and not value.kind.strided:
            leaves = (*leaves, "1")
        return Value(kind, leaves)
    if isinstance(kind, Complex) and isinstance(value.kind, Number):
        return Value(COMPLEX, (real(f, value).leaf, real_text(0.0)))
    if kind == REAL:
        return real(f, value)
    if kind == INTEGER and value.kind == BOOLEAN:
        return integer(f, value)
    raise KindError(f"{kind_text(value.kind)} where {kind_text(kind)} is expected")


def real(f: Builder, value: Value) -> Value:
    """float(value)."""
    if value.kind == REAL:
        return value
    if isinstance(value.number, (int, bool)):
        return constant(float(value.number))
    if value.kind == INTEGER:
        return Value(REAL, (f.get(f"sitofp i64 {value.leaf} to double"),))
    if value.kind == BOOLEAN:
        return Value(REAL, (f.get(f"uitofp i1 {value.leaf} to double"),))
    raise KindError(f"{kind_text(value.kind)} is no real number")


def integer(f: Builder, value: Value) -> Value:
    """int(value): towards zero."""
    if value.kind == INTEGER:
        return value
    if value.kind == BOOLEAN:
        return Value(INTEGER, (f.get(f"zext i1 {value.leaf} to i64"),))
    if value.kind == REAL:
        return Value(INTEGER, (f.get(f"fptosi double {value.leaf} to i64"),))
    raise KindError(f"{kind_text(value.kind)} is no number")


def truth(f: Builder, value: Value) -> Value:
    """The value as a condition."""
    if value.kind == BOOLEAN:
        return value
    if value.kind == INTEGER:
        if value.number is not None:
            return constant(bool(value.number))
        return Value(BOOLEAN, (f.get(f"icmp ne i64 {value.leaf}, 0"),))
    if value.kind == REAL:
        zero = real_text(0.0)
        return Value(BOOLEAN, (f.get(f"fcmp une double {value.leaf}, {zero}"),))
    if isinstance(value.kind, Object):
        return constant(bool(value.kind.value))
    raise KindError(f"{kind_text(value.kind)} is no condition")


def negated(f: Builder, value: Value) -> Value:
    """`not value`."""
    holds = truth(f, value)
    if holds.number is not None:
        return constant(not holds.number)
    return Value(BOOLEAN, (f.get(f"xor i1 {holds.leaf}, true"),))


_REAL: dict[Any, str] = {ast.Add: "fadd", ast.Sub: "fsub", ast.Mult: "fmul", ast.Div: "fdiv"}
_INTEGER: dict[type, str] = {
    ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.BitAnd: "and", ast.BitOr: "or",
    ast.BitXor: "xor", ast.LShift: "shl", ast.RShift: "ashr",
}  # fmt: skip


def binary(f: Builder, operator: ast.operator, a: Value, b: Value) -> Value:
    """The value of a binary operator. Raises KindError for kinds without it."""
    kind = type(operator)
    if isinstance(a.kind, Tuple) and isinstance(b.kind, Tuple) and kind is ast.Add:
        return tuple_of([*entries(a), *entries(b)])
    if isinstance(a.kind, Complex) or isinstance(b.kind, Complex):
        return _complex(f, kind, converted(f, a, COMPLEX), converted(f, b, COMPLEX))
    if a.kind not in RANKS or b.kind not in RANKS:
        raise KindError(f"{kind.__name__} of {kind_text(a.kind)} and {kind_text(b.kind)}")
    if a.number is not None and b.number is not None:
        return constant(
            _folded(ast.BinOp(ast.Constant(a.number), operator, ast.Constant(b.number)))
        )
    if kind is ast.Pow:
        return power(f, a, b)
    if a.kind == BOOLEAN == b.kind and kind in (ast.BitAnd, ast.BitOr, ast.BitXor):
        return Value(BOOLEAN, (f.get(f"{_INTEGER[kind]} i1 {a.leaf}, {b.leaf}"),))
    if REAL in (a.kind, b.kind) or kind is ast.Div:
        x, y = real(f, a).leaf, real(f, b).leaf
        if kind in (ast.FloorDiv, ast.Mod):
            return _floored(f, kind, x, y)
        return Value(REAL, (f.get(f"{_REAL[kind]} double {x}, {y}"),))
    x, y = integer(f, a).leaf, integer(f, b).leaf
    if kind in (ast.FloorDiv, ast.Mod):
        return _whole(f, kind, x, y)
    return Value(INTEGER, (f.get(f"{_INTEGER[kind]} i64 {x}, {y}"),))


def _folded(expression: ast.expr) -> Any:
    """The value of an expression of constants, by Python."""
    tree = ast.fix_missing_locations(ast.Expression(expression))
    return eval(compile(tree, "constant", "eval"))


def _floored(f: Builder, kind: type, x: str, y: str) -> Value:
    """x // y or x % y of reals, rounded as in Python."""
    rest = f.get(f"frem double {x}, {y}")
    zero = real_text(0.0)
    apart = f.get(f"fmul double {rest}, {y}")
    off = f.get(f"fcmp olt double {apart}, {zero}")
    more = f.get(f"fadd double {rest}, {y}")
    rest = f.get(f"select i1 {off}, double {more}, double {rest}")
    if kind is ast.Mod:
        return Value(REAL, (rest,))
    less = f.get(f"fsub double {x}, {rest}")
    quotient = f.get(f"fdiv double {less}, {y}")
    return Value(REAL, (f.get(f"call double @llvm.rint.f64(double {quotient})"),))


def _whole(f: Builder, kind: type, x: str, y: str) -> Value:
    """x // y or x % y of integers, rounded down; y is not 0."""
    rest = f.get(f"srem i64 {x}, {y}")
    nonzero = f.get(f"icmp ne i64 {rest}, 0")
    apart = f.get(f"xor i64 {rest}, {y}")
    sign = f.get(f"icmp slt i64 {apart}, 0")
    off = f.get(f"and i1 {nonzero}, {sign}")
    if kind is ast.Mod:
        more = f.get(f"add i64 {rest}, {y}")
        return Value(INTEGER, (f.get(f"select i1 {off}, i64 {more}, i64 {rest}"),))
    quotient = f.get(f"sdiv i64 {x}, {y}")
    one = f.get(f"zext i1 {off} to i64")
    return Value(INTEGER, (f.get(f"sub i64 {quotient}, {one}"),))


def power(f: Builder, a: Value, b: Value) -> Value:
    """a ** b; by repeated squaring if b is a whole constant."""
    if isinstance(b.number, int) and b.number >= 0:
        left, square, result = b.number, a, None
        while left:
            if left & 1:
                result = square if result is None else binary(f, ast.Mult(), result, square)
            left >>= 1
            if left:
                square = binary(f, ast.Mult(), square, square)
        return constant(1) if result is None else result
    x, y = real(f, a).leaf, real(f, b).leaf
    if b.number == 0.5:  # x is not negative, or NaN
        return Value(REAL, (f.get(f"call double @llvm.sqrt.f64(double {x})"),))
    return Value(REAL, (f.get(f"call double @llvm.pow.f64(double {x}, double {y})"),))


def _complex(f: Builder, kind: type, p: Value, q: Value) -> Value:
    """Sum, difference, product or quotient of complex numbers; the quotient by Smith's method."""
    (a, b), (c, d) = p.leaves, q.leaves

    def do(word: str, x: str, y: str) -> str:
        return f.get(f"{word} double {x}, {y}")

    if kind in (ast.Add, ast.Sub):
        return Value(COMPLEX, (do(_REAL[kind], a, c), do(_REAL[kind], b, d)))
    if kind is ast.Mult:
        re = do("fsub", do("fmul", a, c), do("fmul", b, d))
        return Value(COMPLEX, (re, do("fadd", do("fmul", a, d), do("fmul", b, c))))
    sizes = [f.get(f"call double @llvm.fabs.f64(double {x})") for x in (c, d)]
    large = f.get(f"fcmp oge double {sizes[0]}, {sizes[1]}")

    def either(x: str, y: str) -> str:
        return f.get(f"select i1 {large}, double {x}, double {y}")

    # |c| >= |d|: r = d/c, den = c + d r, ((a + b r) + i (b - a r)) / den; else with roles exchanged
    most, least = either(c, d), either(d, c)
    ratio = do("fdiv", least, most)
    below = do("fadd", most, do("fmul", least, ratio))
    first, second = either(a, b), either(b, a)
    re = do("fadd", first, do("fmul", second, ratio))
    turned = do("fmul", first, ratio)
    im = either(do("fsub", second, turned), do("fsub", turned, second))
    return Value(COMPLEX, (do("fdiv", re, below), do("fdiv", im, below)))


_ORDERED = {
    ast.Lt: ("olt", "slt"), ast.LtE: ("ole", "sle"), ast.Gt: ("ogt", "sgt"),
    ast.GtE: ("oge", "sge"), ast.Eq: ("oeq", "eq"), ast.NotEq: ("une", "ne"),
}  # fmt: skip


def compared(f: Builder, operator: ast.cmpop, a: Value, b: Value) -> Value:
    """The value of a comparison. Raises KindError for kinds without one."""
    kind = type(operator)
    if kind in (ast.Is, ast.IsNot, ast.Eq, ast.NotEq) and (
        isinstance(a.kind, Object) or isinstance(b.kind, Object)
    ):
        return constant((a.kind == b.kind) == (kind in (ast.Is, ast.Eq)))
    if a.kind not in RANKS or b.kind not in RANKS or kind not in _ORDERED:
        raise KindError(f"{kind.__name__} of {kind_text(a.kind)} and {kind_text(b.kind)}")
    reals, wholes = _ORDERED[kind]
    if REAL in (a.kind, b.kind):
        x, y = real(f, a).leaf, real(f, b).leaf
        return Value(BOOLEAN, (f.get(f"fcmp {reals} double {x}, {y}"),))
    if a.number is not None and b.number is not None:
        tree = ast.Compare(ast.Constant(a.number), [operator], [ast.Constant(b.number)])
        return constant(_folded(tree))
    x, y = integer(f, a).leaf, integer(f, b).leaf
    return Value(BOOLEAN, (f.get(f"icmp {wholes} i64 {x}, {y}"),))


def minus(f: Builder, value: Value) -> Value:
    """-value."""
    if value.number is not None:
        return constant(-value.number)
    if isinstance(value.kind, Complex):
        return Value(COMPLEX, tuple(f.get(f"fneg double {leaf}") for leaf in value.leaves))
    if value.kind == REAL:
        return Value(REAL, (f.get(f"fneg double {value.leaf}"),))
    return Value(INTEGER, (f.get(f"sub i64 0, {integer(f, value).leaf}"),))


def absolute(f: Builder, value: Value) -> Value:
    """abs(value)."""
    if value.kind == REAL:
        return Value(REAL, (f.get(f"call double @llvm.fabs.f64(double {value.leaf})"),))
    x = integer(f, value).leaf
    return Value(INTEGER, (f.get(f"call i64 @llvm.abs.i64(i64 {x}, i1 false)"),))


def extreme(f: Builder, operator: ast.cmpop, values: list[Value]) -> Value:
    """min or max of numbers as in Python: a later one counts only if it is strictly beyond."""
    kind = values[0].kind
    for value in values[1:]:
        kind = common(kind, value.kind)
    best = converted(f, values[0], kind)
    for value in values[1:]:
        other = converted(f, value, kind)
        beyond, type_ = compared(f, operator, other, best).leaf, kind.leaves[0]
        best = Value(
            kind, (f.get(f"select i1 {beyond}, {type_} {other.leaf}, {type_} {best.leaf}"),)
        )
    return best


def selected(f: Builder, condition: str, a: Value, b: Value) -> Value:
    """a if the condition holds, else b; both of one kind."""
    leaves = [
        x if x == y else f.get(f"select i1 {condition}, {kind} {x}, {kind} {y}")
        for kind, x, y in zip(a.kind.leaves, a.leaves, b.leaves, strict=True)
    ]
    return Value(a.kind, tuple(leaves))
