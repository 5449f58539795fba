# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is rounding beside other numbers of its unit has no frequency."""

from __future__ import annotations

import numpy as np

from rb_sim.bags.analysis.figures import Figures
from rb_sim.bags.analysis.result import Analysis

RATE = 100.0
T = np.arange(400) / RATE
WAVE = np.sin(2.0 * np.pi * 5.0 * T)


def peaks(sources: dict[str, dict[str, float]], length: float = 0.0) -> dict[str, dict[str, float]]:
    """The peak frequencies of waves of 5 Hz, by source and number; given: their amplitudes."""
    found = Analysis("bag", length=length)
    for name, amplitudes in sources.items():
        figures = found.figures[name] = Figures(tuple(amplitudes))
        figures.add(T, np.stack([a * WAVE for a in amplitudes.values()], axis=1))
        found.kinds[name] = "of no matter"
    return {
        name: {
            key: entry["peak_frequency"]
            for key, entry in source["values"].items()
            if entry["peak_frequency"] is not None
        }
        for name, source in found.as_dict()["sources"].items()
    }


def test_a_force_of_rounding_has_none_beside_others_wherever_they_are() -> None:
    found = peaks({"a": {"fx": 1e-15, "fy": 0.1}, "b": {"fx": 3e-16, "tx": 1e-3}})
    assert set(found["a"]) == {"fy"} and set(found["b"]) == {"tx"}


def test_a_torque_is_small_beside_a_force_at_the_end_of_the_body() -> None:
    assert set(peaks({"a": {"fy": 10.0, "tx": 1e-14}}, length=0.2)["a"]) == {"fy"}
    assert set(peaks({"a": {"fy": 10.0, "tx": 1e-14}})["a"]) == {"fy", "tx"}


def test_residuals_are_rounding_beside_one_and_topics_of_others_beside_themselves() -> None:
    found = peaks({"residual": {"value": 1e-15}, "/a": {"value": 1e-15}, "/b": {"value": 1.0}})
    assert not found["residual"] and set(found["/a"]) == set(found["/b"]) == {"value"}
