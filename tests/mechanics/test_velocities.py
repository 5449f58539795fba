# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The measure of a body's velocities: beside its energy, its momenta, and in turned axes."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.mechanics.error_scales import spin_lengths


def test_a_sphere_has_the_speed_of_its_energy() -> None:
    mass, moment = 3.0, 0.4
    (lengths,) = spin_lengths(moment * np.eye(3)[None], np.array([mass]))
    w = np.array([1.0, -2.0, 0.5])
    assert 0.5 * mass * np.sum((lengths @ w) ** 2) == pytest.approx(0.5 * moment * w @ w)


def test_it_is_the_angular_momentum_over_the_largest_radius_of_gyration() -> None:
    """m |A w| = |I w| / R of two bodies at once, R = sqrt(largest moment / m)."""
    inertia, mass = np.array([np.diag([4.0, 3.0, 1e-6]), np.diag([0.5, 2.0, 2.0])]), [1.0, 0.5]
    w, radius = np.array([0.3, -0.2, 1e4]), [2.0, 2.0]
    lengths = spin_lengths(inertia, np.array(mass))
    for k in range(2):
        expected = np.linalg.norm(inertia[k] @ w) / radius[k] / mass[k]
        assert np.linalg.norm(lengths[k] @ w) == pytest.approx(expected)


def test_it_does_not_depend_on_the_axes_of_the_body() -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    own, w, mass = np.diag([2.0, 1.0, 0.01]), np.array([0.3, -0.2, 4.0]), np.array([0.7])
    (one,), (other,) = (spin_lengths(i[None], mass) for i in (own, turn @ own @ turn.T))
    assert np.linalg.norm(other @ turn @ w) == pytest.approx(np.linalg.norm(one @ w))
