# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cubic (Hermite) interpolation through values and rates."""

from __future__ import annotations

# The cubic through values a, b and rates ra, rb at the ends of an interval, on s in 0..1 (Hermite).


def cubic_at(a, ra, b, rb, width, s):
    """(value, derivative by s) of the cubic at s."""
    m0, m1 = ra * width, rb * width
    q, r = 3.0 * (b - a) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (b - a)
    return a + s * (m0 + s * (q + s * r)), m0 + s * (2.0 * q + 3.0 * s * r)


def tangents_meet(a, ra, b, rb, width):
    """(position s in 0..1, value) where the tangents at the ends intersect, for ra < 0 < rb.

    A convex function with these tangents is nowhere below that value.
    """
    s = (b - a - rb * width) / ((ra - rb) * width)
    s = min(max(s, 0.0), 1.0)
    return s, max(a + ra * width * s, b - rb * width * (1.0 - s))


def cubic_range(a, ra, b, rb, width):
    """(lower, upper) bound of the cubic: the extreme Bernstein coefficients."""
    x, z = a + ra * width / 3.0, b - rb * width / 3.0
    return min(min(a, b), min(x, z)), max(max(a, b), max(x, z))


def cubic_minimum(a, ra, b, rb, width):
    """Position s of the minimum of the cubic inside the interval; -1 if there is none."""
    m0, m1 = ra * width, rb * width
    q, r = 3.0 * (b - a) - 2.0 * m0 - m1, m0 + m1 - 2.0 * (b - a)
    inner = q * q - 3.0 * r * m0
    if not inner >= 0.0:
        return -1.0
    turn = inner**0.5
    if q >= 0.0:
        s = -m0 / (q + turn) if q + turn > 0.0 else -1.0
    else:
        s = (turn - q) / (3.0 * r) if r != 0.0 else -1.0
    return s if 0.0 < s < 1.0 else -1.0
