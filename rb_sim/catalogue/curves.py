# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Guide curves c(s): position and its derivatives by the parameter s; splines as one table."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from rb_sim.base.rounding import SUM_ROUNDING
from rb_sim.catalogue.spec import Vec3
from rb_sim.compiler.graph.machine import bound
from rb_sim.compiler.graph.symbols import External, call, stepwise
from rb_sim.numerics.kernels import Routine, dispatch, place_of, routine, table_at
from rb_sim.numerics.vectors import add, atan2, cos, dot, scale, sin, sub

# A spline c(s) as data: its pieces in one table, which compiled functions read by address.
#
# A traced law calls for the coefficients of the piece at a parameter and evaluates them itself: the
# same code serves every spline of a degree, and its derivatives are those of the piece.


# The table of a spline as compiled functions read it: pieces, points along the curve and breaks.


HEAD = 4
"""Length of the head of a spline table: pieces m, degree k, period (0 for an open curve), number of
points. m + 1 breaks follow, m + 1 jumps, the coefficients (by piece, axis and power, highest power
first), and points (s, c(s)) from which the search for the nearest point starts."""
SHARE = 0.1
"""Fraction of the tolerance that the breaks crossed within one step may cost."""
SWEEPS = 30


def breaks_of(table):
    """The m + 1 breaks of a table: parameters at which its pieces begin, and the end of the last
    one."""
    return table[HEAD : HEAD + int(table[0]) + 1]


def piece_at(breaks, s):
    """Index of the piece that contains s; the first and the last piece extend beyond the ends."""
    low, high = 0, breaks.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if breaks[middle] <= s:
            low = middle
        else:
            high = middle
    return low


def turns_before(period, s):
    """Number of whole periods before s; 0 for an open curve."""
    return math.floor(s / period) if period > 0.0 and math.isfinite(s) else 0.0


def put_piece(table, s, results):
    """Write the parameter at which the piece of s begins, then the coefficients of the piece."""
    breaks, turns = breaks_of(table), turns_before(table[2], s)
    i = piece_at(breaks, s - table[2] * turns)
    results[0] = breaks[i] + table[2] * turns
    width = 3 * (int(table[1]) + 1)
    first = HEAD + 2 * breaks.shape[0] + i * width
    for j in range(width):
        results[1 + j] = table[first + j]


def along(table, s, x, y, z):
    """((c - p) . c', c' . c', (c - p) . c'') at the parameter s for the point p = (x, y, z)."""
    breaks, turns, k = breaks_of(table), turns_before(table[2], s), int(table[1])
    i = piece_at(breaks, s - table[2] * turns)
    u = s - (breaks[i] + table[2] * turns)
    first = HEAD + 2 * breaks.shape[0] + 3 * i * (k + 1)
    gap, square, bend = 0.0, 0.0, 0.0
    for axis in range(3):
        c0, c1, c2 = 0.0, 0.0, 0.0
        for j in range(k + 1):
            c2 = c2 * u + 2.0 * c1
            c1 = c1 * u + c0
            c0 = c0 * u + table[first + axis * (k + 1) + j]
        off = c0 - (x if axis == 0 else y if axis == 1 else z)
        gap, square, bend = gap + off * c1, square + c1 * c1, bend + off * c2
    return gap, square, bend


def nearest_to(table, x, y, z):
    """Parameter of the curve point nearest to (x, y, z), for a point close to the curve.

    Starts at the nearest point of the table; Newton's iteration on (c - p) . c' = 0.
    """
    count = int(table[3])
    first = table.shape[0] - 4 * count
    best, s = math.inf, table[first]
    for i in range(count):
        at = first + 4 * i
        dx, dy, dz = table[at + 1] - x, table[at + 2] - y, table[at + 3] - z
        square = dx * dx + dy * dy + dz * dz
        if square < best:
            best, s = square, table[at]
    for _ in range(SWEEPS):
        gap, square, bend = along(table, s, x, y, z)
        step = gap / (square + max(bend, -0.5 * square))
        s -= step
        if abs(step) <= SUM_ROUNDING * (1.0 + abs(s)):
            break
    return s


def break_between(table, a, b, weight, limit):
    """The first break between a and b that a step may not cross; NaN if it may cross all.

    Each crossed break adds weight times the error of c'', which is its jump times u^(k - 2) with u
    the parameter distance on the shorter side; their sum may not exceed `limit`.
    """
    breaks, k, period = breaks_of(table), int(table[1]), table[2]
    m = breaks.shape[0] - 1
    turns = int(turns_before(period, a))
    i = piece_at(breaks, a - period * turns)
    ahead = 1 if b > a else -1
    j = i + 1 if b > a else i
    total = 0.0
    for _ in range(m + 1):
        if period == 0.0 and (j < 1 or j > m - 1):
            break
        if j > m - 1:
            j, turns = j - m, turns + 1
        elif j < 0:
            j, turns = j + m, turns - 1
        at = breaks[j] + period * turns
        if not (b - at) * ahead > 0.0:
            break
        u = min(abs(b - at), abs(at - a))
        total += weight * table[HEAD + m + 1 + j] * u ** (k - 2)
        if total > limit:
            return at
        j += ahead
    return math.nan


def way(x, s, first, second, third):
    """The cubic s + first x + second x^2 + third x^3."""
    return s + x * (first + x * (second + x * third))


def share_of_step(table, s0, v0, s1, v1, h, tolerance):
    """Fraction of a step after which it reaches a break that it may not cross; 1 if there is none.

    s changes from s0 with ds/dt = v0 to s1 with v1 in the time h [s]; in between it is the cubic
    through them, searched on each interval in which it is monotonic (ds/dt may change sign).
    """
    period = table[2]
    if period > 0.0:
        s1 += period * math.floor((s0 + 0.5 * h * (v0 + v1) - s1) / period + 0.5)
    first, gone = h * v0, s1 - s0
    second, third = 3.0 * gone - h * (2.0 * v0 + v1), h * (v0 + v1) - 2.0 * gone
    fastest = max(abs(v0), abs(v1))
    weight, limit = h * fastest * min(1.0, fastest), SHARE * tolerance
    root = second * second - 3.0 * third * first
    turn = math.sqrt(root) if root > 0.0 else 0.0
    begin = 0.0
    for i in range(3):
        end = 1.0
        if i < 2 and turn > 0.0:  # zeros of the slope first + 2 second x + 3 third x^2, in order
            sign = -1.0 if (i == 0) == (third > 0.0) else 1.0
            end = (sign * turn - second) / (3.0 * third) if third != 0.0 else -0.5 * first / second
        if not begin < end <= 1.0:
            continue
        a, b = way(begin, s0, first, second, third), way(end, s0, first, second, third)
        at = break_between(table, a, b, weight, limit)
        if at == at:
            low, high = begin, end
            for _ in range(60):
                middle = 0.5 * (low + high)
                if (way(middle, s0, first, second, third) - at) * (b - a) < 0.0:
                    low = middle
                else:
                    high = middle
            return high
        begin = end
    return 1.0


@routine
def piece_routine(arguments, results):
    """arguments: address and length of the table, s; results: see put_piece."""
    put_piece(table_at(arguments[0], int(arguments[1])), arguments[2], results)


@routine
def nearest_routine(arguments, results):
    """arguments: address and length of the table, a point; results: s."""
    table = table_at(arguments[0], int(arguments[1]))
    results[0] = nearest_to(table, arguments[2], arguments[3], arguments[4])


@routine
def share_routine(arguments, results):
    """arguments: address and length of the table, s0, v0, s1, v1, h, tolerance; results: a
    fraction."""
    table = table_at(arguments[0], int(arguments[1]))
    results[0] = share_of_step(
        table,
        arguments[2],
        arguments[3],
        arguments[4],
        arguments[5],
        arguments[6],
        arguments[7],
    )


LEAST_POINTS = 64
"""Least number of points from which the nearest is searched; at least one for each piece."""


class Pieces:
    """The pieces of a spline; equal to others with the same numbers.

    breaks: (m + 1,); coefficients: highest power first, (m, 3, degree + 1); period: length of the
    parameter range of a closed curve, 0 for an open one.
    """

    def __init__(self, breaks: np.ndarray, coefficients: np.ndarray, period: float) -> None:
        self.breaks, self.coefficients, self.period = breaks, coefficients, period
        m, _, width = coefficients.shape
        points = points_of(breaks, coefficients)
        head = [float(m), float(width - 1), period, float(len(points))]
        jumps = jumps_of(breaks, coefficients, period)
        parts = [head, breaks, jumps, coefficients.ravel(), points.ravel()]
        self.table = np.concatenate(parts)
        self._digest = hashlib.sha256(self.table.tobytes()).hexdigest()[:32]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Pieces) and self._digest == other._digest

    def __hash__(self) -> int:
        return hash(self._digest)

    def point(self, s: Any) -> tuple[Any, Any, Any]:
        """(c, c', c'') at the parameter s."""
        start, *numbers = call(self.piece, s)
        u, width = s - start, len(numbers) // 3
        x, y, z = (derivatives(numbers[i * width : (i + 1) * width], u) for i in range(3))
        c, slope, bend = zip(x, y, z, strict=True)
        return c, slope, bend

    @cached_property
    def piece(self) -> External:
        """s -> parameter at which its piece begins, and the coefficients of the piece."""
        width = 3 * self.coefficients.shape[2]

        def plainly(s: float) -> tuple[float, ...]:
            results = [0.0] * (1 + width)
            put_piece(self.table, s, results)
            return tuple(map(float, results))

        return External(
            f"rb_sim_piece_{self._digest}",
            1 + width,
            plainly,
            lambda: self._address("_piece_law", piece_routine, 1),
            stepwise,
        )

    @cached_property
    def nearest(self) -> External:
        """A point -> the parameter of the nearest point of the curve."""

        def slope(x: float, y: float, z: float) -> list[tuple[float, ...]]:
            """ds/dp = c' / (c' . c' + (c - p) . c'')."""
            p = (x, y, z)
            c, c1, c2 = self.point(call(self.nearest, *p)[0])
            below = sum(a * a for a in c1) + sum(
                (a - b) * d for a, b, d in zip(c, p, c2, strict=True)
            )
            return [tuple(a / below for a in c1)]

        return External(
            f"rb_sim_nearest_{self._digest}",
            1,
            lambda *p: (float(nearest_to(self.table, *p)),),
            lambda: self._address("_nearest_law", nearest_routine, 3),
            slope,
        )

    @cached_property
    def share(self) -> External:
        """s0, v0, s1, v1, h, tolerance -> fraction of the step up to a break it may not cross."""
        return External(
            f"rb_sim_share_{self._digest}",
            1,
            lambda *step: (float(share_of_step(self.table, *step)),),
            lambda: self._address("_share_law", share_routine, 6),
            stepwise,
        )

    def _address(self, name: str, does: Routine, arguments: int) -> int:
        """Address of the routine bound to this table; made once."""
        if name not in self.__dict__:
            numbers = (place_of(self.table), float(len(self.table)))
            self.__dict__[name] = bound(does.address, numbers, arguments)
        return self.__dict__[name].address


def derivatives(coefficients: Sequence[Any], u: Any) -> tuple[Any, Any, Any]:
    """Value, first and second derivative of a polynomial at u; highest power first (Horner)."""
    c0: Any = 0.0
    c1: Any = 0.0
    c2: Any = 0.0
    for a in coefficients:
        c0, c1, c2 = c0 * u + a, c1 * u + c0, c2 * u + 2.0 * c1
    return c0, c1, c2


def jumps_of(breaks: np.ndarray, coefficients: np.ndarray, period: float) -> np.ndarray:
    """|c'' after - c'' before| / (|c'| u^(k - 2)) at each break, u beyond it; 0 at the ends.

    Only the highest derivative of a spline jumps at a break.
    """
    m, _, width = coefficients.shape
    k = width - 1
    before = coefficients[np.arange(-1, m - 1)]
    jump = k * (k - 1) * np.linalg.norm(coefficients[:, :, 0] - before[:, :, 0], axis=1)
    jump /= np.linalg.norm(coefficients[:, :, k - 1], axis=1)
    jumps = np.append(jump, jump[0])
    if period == 0.0:
        jumps[[0, -1]] = 0.0
    return jumps


def points_of(breaks: np.ndarray, coefficients: np.ndarray) -> np.ndarray:
    """Rows (s, c(s)): equally spaced points of each piece from its beginning, and the end; (n,
    4)."""
    m, _, width = coefficients.shape
    inner = np.arange(-(-LEAST_POINTS // m)) / -(-LEAST_POINTS // m)
    u = np.diff(breaks)[:, None] * inner
    powers = u[:, :, None] ** np.arange(width - 1, -1, -1)
    c = np.einsum("iak,ijk->ija", coefficients, powers).reshape(-1, 3)
    last = coefficients[-1] @ (breaks[-1] - breaks[-2]) ** np.arange(width - 1.0, -1.0, -1.0)
    s = np.append((breaks[:-1, None] + u).ravel(), breaks[-1])
    return np.column_stack([s, np.vstack([c, last])])


SPLINE_DEGREE = 7
"""Degree of guide splines: curvature, and with it the reaction, is sixth-order accurate in the
spacing of the points."""


class LineCurve(NamedTuple):
    """A straight line."""

    point: Vec3
    direction: Vec3
    """unit vector; s is the length along it [m]."""


class CircleCurve(NamedTuple):
    """A circle c(s) = centre + radius (cos s e1 + sin s e2), s in rad."""

    centre: Vec3
    e1: Vec3
    e2: Vec3
    """e1, e2: orthonormal vectors in the plane of the circle."""
    radius: float


class SplineCurve(NamedTuple):
    """A spline through points."""

    pieces: Pieces
    """polynomials in s, the length along the chords of the points [m]."""


def spline_through(points: np.ndarray, closed: bool) -> SplineCurve:
    """Interpolating spline through points (n, 3), parametrised by chord length [m].

    For a closed curve the first point is appended as the last.
    """
    from scipy.interpolate import make_interp_spline  # slow to import, few scenes need it

    p = np.asarray(points, dtype=float)
    if closed and not np.array_equal(p[0], p[-1]):
        p = np.vstack([p, p[:1]])
    chord = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    degree = min(SPLINE_DEGREE, len(p) - 1)
    degree -= 1 - degree % 2  # an odd degree, whose breaks are at points
    spline = make_interp_spline(chord, p, k=degree, bc_type="periodic" if closed else None)
    breaks = np.unique(spline.t[degree : len(spline.t) - degree])
    powers = [
        spline(breaks[:-1], nu=order) / math.factorial(order) for order in range(degree, -1, -1)
    ]
    coefficients = np.ascontiguousarray(np.stack(powers, axis=-1))
    return SplineCurve(Pieces(breaks, coefficients, float(chord[-1]) if closed else 0.0))


@dispatch
def curve_point(curve, s):
    """(c, c', c'') at the parameter s."""


@dispatch
def curve_nearest(curve, p):
    """Parameter of the curve point nearest to p, for p close to the curve."""


@curve_point.register(LineCurve)
def line_point(curve, s):
    """point + s direction, its constant tangent, and no curvature."""
    return add(curve.point, scale(s, curve.direction)), curve.direction, (0.0, 0.0, 0.0)


@curve_nearest.register(LineCurve)
def line_nearest(curve, p):
    """Foot of the perpendicular from p: distance from `point` along the line [m]."""
    return dot(sub(p, curve.point), curve.direction)


@curve_point.register(CircleCurve)
def circle_point(curve, s):
    """The point at the angle s from e1 towards e2; derivatives by the angle."""
    c, q = curve.radius * cos(s), curve.radius * sin(s)
    radial = add(scale(c, curve.e1), scale(q, curve.e2))
    tangent = add(scale(-q, curve.e1), scale(c, curve.e2))
    return add(curve.centre, radial), tangent, scale(-1.0, radial)


@curve_nearest.register(CircleCurve)
def circle_nearest(curve, p):
    """The angle of p about the centre, in (-pi, pi]."""
    d = sub(p, curve.centre)
    return atan2(dot(d, curve.e2), dot(d, curve.e1))


@curve_point.register(SplineCurve)
def spline_point(curve, s):
    """(c, c', c'') from the piece that contains s."""
    return curve.pieces.point(s)


@curve_nearest.register(SplineCurve)
def spline_nearest(curve, p):
    """Parameter of the nearest point, by the routine of the table."""
    return call(curve.pieces.nearest, *p)[0]
