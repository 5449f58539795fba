# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Principal axes against tensors made from known ones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim.scene.reduced import principal_axes

MOMENTS = [
    [1.0, 2.0, 2.7],
    [3.0, 1.0, 2.5],
    [1.0, 1.0, 1.7],
    [1.0, 1.0, 1.0],
    [0.1, 0.1, 1e-4],
    [1e-6, 2e-6, 2.5e-6],
]


def six(tensor: np.ndarray) -> tuple[float, ...]:
    i = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
    return tuple(float(tensor[k]) for k in i)


def test_a_diagonal_tensor_keeps_its_axes() -> None:
    assert principal_axes((3.0, 1.0, 2.5, 0.0, 0.0, 0.0)) == (
        (3.0, 1.0, 2.5),
        (0.0, 0.0, 0.0, 1.0),
    )


@pytest.mark.parametrize("moments", MOMENTS)
@pytest.mark.parametrize("seed", range(8))
def test_axes_and_moments(moments: list[float], seed: int) -> None:
    R = Rotation.random(random_state=seed).as_matrix()
    tensor = R @ np.diag(moments) @ R.T
    tensor = 0.5 * (tensor + tensor.T)
    found, q = principal_axes(six(tensor))
    assert_allclose(sorted(found), sorted(moments), atol=1e-15 * max(moments))
    P = Rotation.from_quat(q).as_matrix()
    assert_allclose(P @ np.diag(found) @ P.T, tensor, atol=1e-15 * max(moments))
    assert abs(np.linalg.norm(q) - 1.0) <= 4e-16


def test_equal_moments_are_equal_to_the_last_digit() -> None:
    R = Rotation.from_rotvec([0.3, 0.9, -0.5]).as_matrix()
    found, _ = principal_axes(six(R @ np.diag([1.0, 1.0, 1.7]) @ R.T))
    assert len(set(found)) == 2
