# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which residuals are outliers, and which are noise, rounding or another motion."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.fit.fit import outliers

T = np.arange(400) / 100.0


def residuals(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    return {"ball": (T, rng.normal(0, 1e-3, (400, 3)), rng.normal(0, 2e-3, (400, 3)))}


@pytest.mark.parametrize("seed", range(20))
def test_noise_has_none(seed) -> None:
    assert outliers(residuals(seed), 0.0) == ()


@pytest.mark.parametrize("part", [1, 2])
def test_they_are_counted_with_their_times(part) -> None:
    found = residuals(0)
    found["ball"][part][[7, 100, 250, 333], 1] = 0.5
    (line,) = outliers(found, 0.0)
    assert line.startswith("ball: 4 of 400 poses") and "(t = 0.07, 1, 2.5, ... s)" in line
    assert outliers(found, 1.0) == ()  # on the scale of this motion they are rounding


def test_many_are_another_motion() -> None:
    found = residuals(0)
    found["ball"][1][:60, 0] += 0.5
    assert outliers(found, 0.0) == ()
