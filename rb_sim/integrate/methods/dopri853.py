# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Dormand-Prince method of order 8 with error estimates of orders 5 and 3.

Hairer, Norsett, Wanner I, section II.5 and the code DOP853. Between grid points the state is found
by one more step of the required length from the grid point before: order 8 at every sample time, at
no cost without samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rb_sim.compiler.graph.symbols import maximum, sqrt, where
from rb_sim.integrate.layout import AT, SLOPES, size_of
from rb_sim.numerics.kernels import call_law, part, step

# Coefficients of the Dormand-Prince method of order 8(5, 3), as published by E. Hairer.
#
# Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, section II.10 and the code
# DOP853; row i of A has the i coefficients of stage i, E5 and E3 weigh the slopes in the error
# estimates.  A test compares them with those of scipy.


PUBLISHED_A = (
    (),
    (0.05260015195876773,),
    (0.0197250569845379, 0.0591751709536137),
    (0.02958758547680685, 0.0, 0.08876275643042054),
    (0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792),
    (0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242),
    (0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125),
    (
        0.03709200011850479,
        0.0,
        0.0,
        0.17038392571223998,
        0.10726203044637328,
        -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757,
        0.0,
        0.0,
        -3.3608926294469414,
        -0.868219346841726,
        27.59209969944671,
        20.154067550477894,
        -43.48988418106996,
    ),
    (
        0.47766253643826434,
        0.0,
        0.0,
        -2.4881146199716677,
        -0.590290826836843,
        21.230051448181193,
        15.279233632882423,
        -33.28821096898486,
        -0.020331201708508627,
    ),
    (
        -0.9371424300859873,
        0.0,
        0.0,
        5.186372428844064,
        1.0914373489967295,
        -8.149787010746927,
        -18.52006565999696,
        22.739487099350505,
        2.4936055526796523,
        -3.0467644718982196,
    ),
    (
        2.273310147516538,
        0.0,
        0.0,
        -10.53449546673725,
        -2.0008720582248625,
        -17.9589318631188,
        27.94888452941996,
        -2.8589982771350235,
        -8.87285693353063,
        12.360567175794303,
        0.6433927460157636,
    ),
)
PUBLISHED_B = (
    0.054293734116568765,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    0.3111643669578199,
    -0.1521609496625161,
    0.20136540080403034,
    0.04471061572777259,
)
PUBLISHED_C = (
    0.0,
    0.05260015195876773,
    0.0789002279381516,
    0.1183503419072274,
    0.2816496580927726,
    0.3333333333333333,
    0.25,
    0.3076923076923077,
    0.6512820512820513,
    0.6,
    0.8571428571428571,
    1.0,
)
PUBLISHED_E5 = (
    0.01312004499419488,
    0.0,
    0.0,
    0.0,
    0.0,
    -1.2251564463762044,
    -0.4957589496572502,
    1.6643771824549864,
    -0.35032884874997366,
    0.3341791187130175,
    0.08192320648511571,
    -0.022355307863886294,
)
PUBLISHED_E3 = (
    -0.18980075407240762,
    0.0,
    0.0,
    0.0,
    0.0,
    4.450312892752409,
    1.8915178993145003,
    -5.801203960010585,
    -0.4226823213237919,
    -0.1521609496625161,
    0.20136540080403034,
    0.02265179219836082,
)


# Step of Dormand-Prince 8(5,3) (Hairer, Norsett, Wanner I, section II.10): increment and error.


STAGES = 12
A = np.zeros((STAGES, STAGES))
for _i, _row in enumerate(PUBLISHED_A):
    A[_i, : len(_row)] = _row
B, C = np.array(PUBLISHED_B), np.array(PUBLISHED_C)
E5, E3 = np.array(PUBLISHED_E5), np.array(PUBLISHED_E3)
OVERFLOWS = 1e300
"""Sum of squared estimates from which on the error is set to this value: the quotient of infinities
would be NaN."""


@step(STAGES)
def dopri853(law, jacobian, n, t, y, h, p, dy, work):
    """Step with the error estimate of DOP853, e5^2 / sqrt(e5^2 + e3^2 / 100), root mean square over
    y.

    The error of each coordinate is relative to max(1, |y_i|), or to less for small motions
    (`size_of`).
    """
    at, k = part(work, AT * n), part(work, SLOPES * n)
    call_law(law, t, y, p, k)
    for i in range(1, STAGES):
        for m in range(n):
            at[m] = A[i, 0] * k[m]
        for j in range(1, i):
            a = A[i, j]
            if a != 0.0:
                for m in range(n):
                    at[m] += a * k[j * n + m]
        for m in range(n):
            at[m] = y[m] + h * at[m]
        call_law(law, t + C[i] * h, at, p, part(k, i * n))
    e5, e3 = 0.0, 0.0
    for m in range(n):
        s, s5, s3 = 0.0, 0.0, 0.0
        for j in range(STAGES):
            s += B[j] * k[j * n + m]
            s5 += E5[j] * k[j * n + m]
            s3 += E3[j] * k[j * n + m]
        dy[m] = h * s
        scale = h / size_of(n, y, work, m)
        e5 += (scale * s5) ** 2
        e3 += (scale * s3) ** 2
    if e5 == 0.0 and e3 == 0.0:
        return 0.0
    total = e5 + 0.01 * e3
    return e5 / math.sqrt(total * n) if total < OVERFLOWS else OVERFLOWS


def combination(weights, slopes):
    """Weighted sum of the slopes for each coordinate."""
    terms = [(float(w), k) for w, k in zip(weights, slopes, strict=False) if w != 0.0]
    sums = [0.0] * len(slopes[0])
    for w, k in terms:
        sums = [s + w * x for s, x in zip(sums, k, strict=True)]
    return sums


@dopri853.on_tuples
def dopri853_traced(rate, t, y, h, velocities):
    """The step on tuples, for traced laws: (change of y, error relative to max(1, |y|))."""
    slopes = [rate(t, y)]
    for i in range(1, STAGES):
        move = combination(A[i], slopes)
        at = tuple(a + h * m for a, m in zip(y, move, strict=True))
        slopes.append(rate(t + float(C[i]) * h, at))
    dy = tuple(h * m for m in combination(B, slopes))
    e5, e3 = 0.0, 0.0
    estimates = zip(y, combination(E5, slopes), combination(E3, slopes), strict=True)
    for a, s5, s3 in estimates:
        scale = h / maximum(1.0, abs(a))
        e5, e3 = e5 + (scale * s5) ** 2, e3 + (scale * s3) ** 2
    total = e5 + 0.01 * e3
    none = total <= 0.0
    error = where(none, 0.0, e5 / sqrt(where(none, 1.0, total) * len(y)))
    return dy, where(total < OVERFLOWS, error, OVERFLOWS)


class Dopri853(NamedTuple):
    """Dormand-Prince 8(5,3) with a fixed step [s]."""

    step: float


class AdaptiveDopri853(NamedTuple):
    """Dormand-Prince 8(5,3) with steps such that the estimated local error is within the
    tolerance."""

    tolerance: float
    """local error relative to max(1, |y_i|) of each coordinate."""
    largest_step: float
    """largest step [s]."""
