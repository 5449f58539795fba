# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bags of others whose `nanosec` holds microseconds or milliseconds."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.bags.analysis.run import analyze
from rb_sim.bags.tracks import tracks_of_bag
from tests.bags.analysis import foreign


def written(folder, unit: int, rate: float, n: int = 250):
    """A motion whose stamps hold the part of each second in units of `unit` nanoseconds."""
    t = 0.25 + np.arange(n) / rate
    wrong = np.floor(t) + np.round(t % 1.0 * 1e9 / unit) * 1e-9
    position, q = foreign.swing(n, rate)[1:]

    def pose(k, p, attitude):
        return foreign.pose_stamped(wrong[round((k - t[0]) * rate)], p, attitude)

    return foreign.write(folder, pose, t, position, q), t


@pytest.mark.parametrize(
    ("unit", "name"), [(1, ""), (1_000, "microseconds"), (1_000_000, "milliseconds")]
)
@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_the_unit_of_nanosec_is_recognised_by_the_times_of_the_log(tmp_path, unit, name, rate):
    bag, t = written(tmp_path / "bag", unit, rate)
    found = tracks_of_bag(bag)
    np.testing.assert_allclose(found.bodies["/body"].t - foreign.EPOCH, t, atol=1e-6)
    said = [note for note in found.notes if "nanosec" in note]
    assert len(said) == bool(name) and all(f"holds {name}" in note for note in said)
    rates = analyze(bag).figures["/body"].rates.as_dict()
    assert rates["rate"] == pytest.approx(rate, rel=1e-6) and rates["gaps"] == 0


def test_messages_at_whole_seconds_are_what_they_say(tmp_path):
    """Their `nanosec` is 0, in every unit."""
    bag, t = written(tmp_path / "bag", 1, 1.0, 20)
    found = tracks_of_bag(bag)
    assert found.notes == [] and np.allclose(found.bodies["/body"].t - foreign.EPOCH, t)
