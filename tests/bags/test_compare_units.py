# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Motions that are one another in other units."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.bags.compare import differences, summary, unit_note
from rb_sim.bags.tracks import Track, Tracks

T = np.arange(200) / 100.0
P = np.c_[0.5 * np.sin(3.0 * T), 0.1 * np.ones(200), 0.2 * T]
Q = np.tile([0.0, 0.0, 0.0, 1.0], (200, 1))


def moved(position: np.ndarray) -> Tracks:
    return Tracks("x", {"ball": Track(T, position, Q)})


@pytest.mark.parametrize(("factor", "unit"), [(100.0, "cm"), (1000.0, "mm")])
def test_the_one_in_other_units_is_named(factor, unit):
    """Whichever of both it is, with noise and another origin."""
    noise = np.random.default_rng(1).normal(0.0, 1e-3, P.shape)
    large = factor * (P + noise + [1.0, 2.0, 3.0])
    for one, other, which in ((P, large, "B"), (large, P, "A")):
        (line,) = summary(differences(moved(one), moved(other)))["notes"]
        rest = "A" if which == "B" else "B"
        assert line == (f"ball: the positions of {which} are {factor:.0f} times those of {rest}: "
                        f"is {which} in {unit}?")  # fmt: skip


@pytest.mark.parametrize(
    "other", [P, 0.0 * P, 10.0 * P, 1000.0 * P[:, ::-1], 600.0 * P, -1000.0 * P]
)
def test_other_differences_are_none_of_units(other):
    assert not unit_note(P, other) and not unit_note(other, P)


def test_what_stands_still_says_nothing():
    assert not unit_note(0.0 * P, 0.0 * P) and not unit_note(P[:1], 1000.0 * P[:1])
