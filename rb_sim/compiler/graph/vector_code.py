# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A graph as SIMD code that evaluates LANES laws at once, one per vector lane.

A law in lanes is void law(double, const double *y, const double *p, double *out) like any other;
number i of lane l is at [LANES i + l], and the time is one of the p. Every lane executes the
operations of a single law and gets the same bits, except for sines and cosines, which have no
vector instructions: they are computed as below.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rb_sim.compiler.graph.emit import RARELY, Operations, constant
from rb_sim.compiler.graph.machine import Law, interpreted, linked
from rb_sim.compiler.graph.symbols import INPUTS, Graph, Symbol, floor, in_order, where

# Sine and cosine from arithmetic alone, for vector code.
#
# x = k pi/2 + r with |r| <= pi/4: pi/2 is subtracted in three parts, of which k times the first two
# is exact (Cody and Waite 1980), and r is the argument of the polynomials of FDLIBM (k_sin.c,
# k_cos.c; Sun Microsystems 1993). Accurate to two units in the last place of the larger of both.


NEAR = 2.0**20
"""Largest |x| for which `sine_and_cosine` is accurate [rad]."""

PARTS = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624879595063154e-21)
"""pi / 2 in three parts: 33 bits, 33 bits, and the rest."""
TWO_OVER_PI = 6.36619772367581382433e-01
SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)


def polynomial(coefficients: tuple[float, ...], z: Any) -> Any:
    """c0 + c1 z + c2 z^2 ... by Horner's rule."""
    value: Any = coefficients[-1]
    for c in reversed(coefficients[:-1]):
        value = c + z * value
    return value


def sine_and_cosine(x: Any) -> tuple[Any, Any]:
    """(sin x, cos x) for |x| <= NEAR [rad]; x: a float or a symbol."""
    k = floor(x * TWO_OVER_PI + 0.5)
    r = ((x - k * PARTS[0]) - k * PARTS[1]) - k * PARTS[2]
    z = r * r
    s = r + r * z * polynomial(SINE, z)
    half = 0.5 * z
    w = 1.0 - half
    c = w + (((1.0 - w) - half) + z * (z * polynomial(COSINE, z)))
    quadrant = k - 4.0 * floor(0.25 * k)
    odd = (quadrant - 2.0 * floor(0.5 * quadrant)) > 0.5
    sine, cosine = where(odd, c, s), where(odd, s, c)
    below = quadrant > 1.5
    left = (quadrant > 0.5) & (quadrant < 2.5)
    return where(below, -sine, sine), where(left, -cosine, cosine)


LANES = 8
"""Numbers per vector: one vector of AVX-512, two of AVX2, four of SSE2 or Neon; LLVM splits it."""

MOST_OPERATIONS = 8000
"""Most operations of a law in lanes: beyond that LLVM's time grows faster than the code."""

VECTOR, MASK = f"<{LANES} x double>", f"<{LANES} x i1>"
PAIR = f"{{{VECTOR}, {VECTOR}}}"


def compile_lanes(outputs: Sequence[Any], time: int) -> Law | None:
    """The law in lanes that writes the outputs, symbols of one graph and numbers.

    time: index of t among the p. None if the law calls functions by address, is too long, or
    nothing is compiled.
    """
    order = [x for x in in_order(outputs) if x.op not in INPUTS]
    if interpreted() or len(order) > MOST_OPERATIONS or any(x.op == "call" for x in order):
        return None
    return linked([module(outputs, time)])


def module(outputs: Sequence[Any], time: int) -> str:
    """LLVM IR of the law in lanes."""
    law = Vectors(time)
    for x in in_order(outputs):
        law.add(x)
    for i, x in enumerate(outputs):
        law.store(law.value(x), i)
    head = (
        "define void @law(double %t, ptr noalias readonly %y, "
        "ptr noalias readonly %p, ptr noalias %out) nounwind {"
    )
    functions = _sine_and_cosine(law.declared) if law.turns else []
    for name in sorted(law.scalar):
        functions += _by_lane(name, law.scalar[name], law.declared)
    body = [head, *law.lines, "  ret void", "}", RARELY, ""]
    return "\n".join([*sorted(law.declared), *functions, *body])


def splat(x: float) -> str:
    """LLVM constant with x in every lane."""
    return "<" + ", ".join([f"double {constant(x)}"] * LANES) + ">"


class Vectors(Operations):
    """Writer of operations on vectors of LANES numbers."""

    kind, truth, suffix = VECTOR, MASK, f"v{LANES}f64"
    true = "<" + ", ".join(["i1 true"] * LANES) + ">"
    intrinsic = ("sqrt", "fabs", "floor")

    def __init__(self, time: int) -> None:
        super().__init__()
        self.time = time
        self.pairs: dict[str, str] = {}
        self.scalar: dict[str, int] = {}
        self.turns = False

    def value(self, x: Any) -> str:
        """Name of an operand, or a constant vector."""
        return self.names[x.number] if isinstance(x, Symbol) else splat(x)

    def place(self, base: str, index: int) -> str:
        """Name of the address of the vector at an index."""
        return self.line(f"getelementptr double, ptr {base}, i64 {LANES * index}")

    def load(self, base: str, index: int) -> str:
        """Load the vector at an index."""
        return self.line(f"load {VECTOR}, ptr {self.place(base, index)}, align 8")

    def store(self, value: str, index: int, base: str = "%out") -> None:
        """Store a vector at an index."""
        at = self.place(base, index)
        self.lines.append(f"  store {VECTOR} {value}, ptr {at}, align 8")

    def add(self, x: Symbol) -> None:
        """Write the operation; its operands must exist."""
        if x.op in INPUTS:
            base, index = ("%p", self.time) if x.op == "t" else (f"%{x.op}", x.operands[0])
            self.names[x.number] = self.load(base, index)
        else:
            self.names[x.number] = self.operation_on(x, [self.value(o) for o in x.operands])

    def by_library(self, name: str, a: list[str]) -> str:
        """Write a call of a library function lane by lane; sines and cosines by
        `sine_and_cosine`."""
        if name in ("sin", "cos"):
            return self.turn(name, a[0])
        self.scalar[name] = len(a)
        return self.called(f"lanes_{name}", a)

    def turn(self, op: str, angle: str) -> str:
        """Name of the sine or cosine; both come from one call."""
        self.turns = True
        if angle not in self.pairs:
            self.pairs[angle] = self.line(f"call {PAIR} @sine_and_cosine({VECTOR} {angle})")
        return self.line(f"extractvalue {PAIR} {self.pairs[angle]}, {0 if op == 'sin' else 1}")


def _by_lane(name: str, arguments: int, declared: set[str]) -> list[str]:
    """LLVM IR of a function of the C library applied to each lane in turn."""
    declared.add(f"declare double @{name}({', '.join(['double'] * arguments)})")
    given = ", ".join(f"{VECTOR} %a{k}" for k in range(arguments))
    lines, result = [f"define internal {VECTOR} @lanes_{name}({given}) nounwind {{"], "undef"
    for lane in range(LANES):
        for k in range(arguments):
            lines.append(f"  %x{lane}_{k} = extractelement {VECTOR} %a{k}, i32 {lane}")
        values = ", ".join(f"double %x{lane}_{k}" for k in range(arguments))
        lines.append(f"  %y{lane} = call double @{name}({values})")
        lines.append(f"  %r{lane} = insertelement {VECTOR} {result}, double %y{lane}, i32 {lane}")
        result = f"%r{lane}"
    return [*lines, f"  ret {VECTOR} {result}", "}"]


def _sine_and_cosine(declared: set[str]) -> list[str]:
    """LLVM IR of the pair for all lanes: by arithmetic; by the library for |x| > NEAR or not
    finite.

    The result of a lane does not depend on the others.
    """
    near = Vectors(0)
    graph = Graph()
    x = graph.input("t")
    near.names[x.number] = "%x"
    outputs = sine_and_cosine(x)
    for symbol in in_order(outputs):
        if symbol is not x:
            near.add(symbol)
    sine, cosine = (near.value(output) for output in outputs)
    declared |= near.declared | {f"declare {VECTOR} @llvm.fabs.v{LANES}f64({VECTOR})"}
    return [
        *_by_lane("sin", 1, declared),
        *_by_lane("cos", 1, declared),
        f"define internal {PAIR} @sine_and_cosine({VECTOR} %x) nounwind {{",
        f"  %size = call {VECTOR} @llvm.fabs.v{LANES}f64({VECTOR} %x)",
        f"  %within = fcmp ole {VECTOR} %size, {splat(NEAR)}",
        f"  %bits = bitcast {MASK} %within to i{LANES}",
        f"  %all = icmp eq i{LANES} %bits, -1",
        *near.lines,
        "  br i1 %all, label %near, label %far",
        "near:",
        f"  %n0 = insertvalue {PAIR} undef, {VECTOR} {sine}, 0",
        f"  %n1 = insertvalue {PAIR} %n0, {VECTOR} {cosine}, 1",
        f"  ret {PAIR} %n1",
        "far:",
        f"  %s1 = call {VECTOR} @lanes_sin({VECTOR} %x)",
        f"  %c1 = call {VECTOR} @lanes_cos({VECTOR} %x)",
        f"  %s = select {MASK} %within, {VECTOR} {sine}, {VECTOR} %s1",
        f"  %c = select {MASK} %within, {VECTOR} {cosine}, {VECTOR} %c1",
        f"  %f0 = insertvalue {PAIR} undef, {VECTOR} %s, 0",
        f"  %f1 = insertvalue {PAIR} %f0, {VECTOR} %c, 1",
        f"  ret {PAIR} %f1",
        "}",
    ]
