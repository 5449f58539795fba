# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Formulas of cases: arithmetic on the samples, and nothing else of Python."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rb_sim.base.errors import RbSimError
from rb_sim.hard_cases.judge import largest
from rb_sim.mechanics.samples import SampleLayout, empty_block

LAYOUT = SampleLayout(("bob",), ("pin",), ("bob",), ())


@pytest.fixture
def block():
    base = empty_block(3, LAYOUT)
    force = np.zeros((3, 1, 3))
    force[:, 0, 1] = [1.0, -4.0, 2.0]
    return replace(base, t=np.array([0.0, 1.0, 2.0]), reaction_force=force)


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("t", 2.0),
        ("-t**2 + 1", 3.0),
        ("pin_fy", 4.0),
        ("hypot(pin_fx, pin_fy)", 4.0),
        ("max(abs(bob_x - 3), t)", 3.0),
        ("cos(pi*t) - 1", 2.0),
        ("where(t > 1.5, 10, 0)", 10.0),
        ("1/bob_x", np.inf),
        ("log(-t)", np.inf),
    ],
)
def test_the_largest_size_over_the_samples(formula: str, value: float, block) -> None:
    assert largest(formula, block, LAYOUT) == pytest.approx(value)


@pytest.mark.parametrize(
    "formula",
    ["bill_x", "t +", "__import__('os')", "t.real", "(lambda: 1)()", "'t'", "[t]", "eval(t)"],
)
def test_anything_else_is_refused(formula: str, block) -> None:
    with pytest.raises(RbSimError, match="formula"):
        largest(formula, block, LAYOUT)
