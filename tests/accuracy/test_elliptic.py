# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Jacobi's functions in long doubles, against scipy, their identities and a quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipj, ellipk

from rb_sim.accuracy.closed_forms.exact import (
    EPS,
    Long,
    argument,
    carlson_rf,
    gauss_legendre,
    jacobi,
    long,
    quarter_period,
)

COMPLEMENTS = [1.0, 0.75, 0.3, 1e-3, 1e-8]


@pytest.mark.parametrize("m1", COMPLEMENTS)
def test_jacobi_functions_agree_with_scipy(m1: float) -> None:
    u = np.linspace(-7.0, 9.0, 101)
    for own, other in zip(jacobi(long(u), Long(m1)), ellipj(u, 1.0 - m1)[:3], strict=True):
        # scipy takes m, so its error grows with the lost digits of 1 - m
        assert np.abs(own.astype(float) - other).max() < 1e-13 / max(m1, 1e-3)


@pytest.mark.parametrize("m1", COMPLEMENTS)
def test_jacobi_functions_satisfy_their_identities(m1: float) -> None:
    u = long(np.linspace(-7.0, 9.0, 101))
    sn, cn, dn = jacobi(u, Long(m1))
    assert np.abs(sn * sn + cn * cn - 1).max() < 20 * EPS
    assert np.abs(dn * dn - (cn * cn + Long(m1) * sn * sn)).max() < 200 * EPS
    step = Long(2) ** -20
    slope = (jacobi(u + step, Long(m1))[0] - jacobi(u - step, Long(m1))[0]) / (2 * step)
    assert np.abs(slope - cn * dn).max() < 1e-11  # step^2 and EPS / step


@pytest.mark.parametrize("m1", COMPLEMENTS)
def test_argument_inverts_and_the_period_is_the_integral(m1: float) -> None:
    K = quarter_period(Long(m1))
    assert float(K) == pytest.approx(ellipk(1.0 - m1), rel=1e-9 if m1 < 1e-6 else 1e-13)
    u = np.linspace(-1.99, 1.99, 41) * K
    sn, cn, _ = jacobi(u, Long(m1))
    back = long([argument(s, c, Long(m1)) for s, c in zip(sn, cn, strict=True)])
    # near u = 2K a change of u by EPS changes sn and cn by as little as sqrt(m1) EPS
    assert np.abs(back - u).max() < 500 * EPS * K / np.sqrt(m1)


def test_carlson_integral_agrees_with_quadrature() -> None:
    def integrand(x: float) -> float:  # t = x / (1 - x)
        t = x / (1.0 - x)
        return 0.5 / np.sqrt((t + 0.3) * (t + 1.7) * (t + 1.0)) / (1.0 - x) ** 2

    value, doubt = quad(integrand, 0.0, 1.0, epsabs=1e-13, epsrel=1e-13)
    assert float(carlson_rf(Long(0.3), Long(1.7), Long(1))) == pytest.approx(value, abs=10 * doubt)


def test_gauss_legendre_is_exact_for_polynomials() -> None:
    nodes, weights = gauss_legendre(24)
    for power in (0, 2, 20, 46):
        assert abs((weights * nodes**power).sum() - Long(2) / (power + 1)) < 50 * EPS
