# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Small functions in the Python that is compiled, a construct or two in each; plain Python is the
reference of what they give."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rb_sim.compiler.graph import symbols as functions
from rb_sim.numerics.kernels import branching, dispatch

WEIGHTS = np.array([[0.5, -1.25], [3.0, 0.125]])
PLACES = np.array([1, 0])


class Point(NamedTuple):
    x: float
    y: float


class Ring(NamedTuple):
    centre: Point
    radius: float


@dispatch
def area(shape):
    """The area of a shape."""


@area.register(Point)
def area_of_point(shape):
    return 0.0


@area.register(Ring)
def area_of_ring(shape):
    return math.pi * shape.radius**2


@branching
def clipped(x):
    if x > 1.0:
        return 1.0
    return x


def arithmetic(a, b, n):
    return a + b * n - a / b, -a, a**2, abs(a) ** 0.5, abs(b) ** n, n**3, 7 // 2, -n, +a


def rounding(a, b, n, m):
    return n // m, n % m, a // b, a % b, int(a), float(n), math.floor(a), math.fmod(a, b)


def comparisons(a, b, n):
    return a < b <= 3.0, a != b, not a > b, n == 2 and a > 0.0, n == 2 or a / 0.5 > b, bool(n)


def extremes(a, b, n):
    return max(a, b), min(a, b, 0.5), max(n, 2), max((a, b)), min(n, a)


def elementary(a):
    x = abs(a) + 0.1
    return (
        math.sin(a), math.cos(a), math.exp(a), math.log(x), math.sqrt(x), math.atan2(a, x),
        math.hypot(a, x), math.tan(a), math.atan(a), math.copysign(x, a), math.isfinite(a),
        math.isnan(a), functions.sqrt(x), functions.where(a > 0.0, x, a),
    )  # fmt: skip


def sums(n):
    """An integer that becomes a real number on the way."""
    total, last = 0, 0
    for i in range(n):
        if i == 3:
            continue
        if i > 7:
            break
        total += 0.5 * i
        last = i
    for i in range(n, 0, -2):
        total -= i
    while last > 0:
        last -= 2
        if last == 1:
            return total, -1
    return total, last


def branches(a, n):
    x = 1 if a > 0.0 else 2.5
    if n > 2:
        if a > 0.0:
            return x, 0
        n = 5
    elif n > 0:
        x = 3
    else:
        x = 4.0
    return x, n


def tuples(a, b):
    p, q = Point(a, b), (a, b, 2.0)
    ring = Ring(p, 2.0)
    moved = ring._replace(radius=3.0)
    total = 0.0
    for i in range(3):
        total += q[i] * i
    for one in (a, b):
        total += one
    u, (v, w) = ring.radius, moved.centre
    _, _ = u, p
    return total, moved, q[1:], q[-1], (*p, u), area(p), area(ring), v + w, len(q), clipped(a)


def constants(i):
    return WEIGHTS[i, 1] + WEIGHTS[PLACES[i], 0], WEIGHTS.shape[0], math.inf


def helper_of(a, factor=2.0):
    """Returns nothing where a is large."""
    if a > 1e3:
        return a
    return a * factor


def calls(a):
    return helper_of(a), helper_of(a, 3.0), helper_of(factor=4.0, a=a)


def vectors(a, b, n):
    """In place: b from the rows of a."""
    for i in range(a.shape[0]):
        row = a[i]
        for j in range(row.shape[0]):
            b[i] += row[j] * a[i, j]
    b[0], b[1] = b[1], b[0]
    b[n] *= 2.0
    b[-1] -= 1.0
    return b[n], len(b)


def parts(a, b):
    """A column, a row's end, rows from the second on."""
    column, end, rest = a[:, 1], a[0, 1:], a[1:]
    for i in range(column.shape[0]):
        column[i] = b[i]
    total = 0.0
    for i in range(rest.shape[0]):
        total += rest[i, 0]
    return total + end[0], end.shape[0], rest.shape


def squares_of(b):
    made = np.empty(b.shape[0])
    for i in range(b.shape[0]):
        made[i] = b[i] * b[i]
    return made


def made_here(b):
    """New arrays of several kinds, also one made by another function, in a loop."""
    zeros, full, like = np.zeros((2, 3)), np.full(3, 1.5), np.zeros_like(b)
    total = 0.0
    for _ in range(3):
        squares = squares_of(b)
        total += squares[0]
    kept = b.copy()
    kept[0] = 7.0
    whole = kept.astype(np.int64)
    return total + zeros[1, 2] + full[1] + like[0], kept[0] + b[0], whole[1]


def made_and_returned(b):
    return squares_of(b), 1.0


def given_back(b, c):
    """One of the arrays that it has got."""
    other = c
    if b[0] > 0.0:
        other = b
    other[0] += 1.0
    return other, 2.0


def perhaps_made(b, count):
    """Something new, or what it has got; counts its calls."""
    count[0] += 1.0
    found = b
    if b[0] > 0.0:
        found = squares_of(b)
    return found


def given_back_beside(b, view, c):
    return b, c[0, 0]


def integers_in(n):
    """Short ones, and truth values."""
    numbers, flags = np.zeros(2), np.zeros(2, np.bool_)
    halves = numbers.view(np.int32)
    halves[1] = n
    flags[0] = n > 1
    return halves[1], flags[0], flags[1]


def complex_ones(a, b):
    z = complex(a, b)
    w = 1.0 / z + z * 2.0 - complex(b, a) / z
    return w.real, w.imag


def no_end(n: Any):
    while True:
        n += 1
        if n > 10:
            return n
