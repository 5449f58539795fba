# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Extremes and spectra of numbers as they come from anybody's bag."""

from __future__ import annotations

import csv
import tracemalloc

import numpy as np

from rb_sim.bags.analysis import analysis_page as table
from rb_sim.bags.analysis.analysis_page import Analysis
from rb_sim.bags.analysis.figures import COLUMNS, Figures
from rb_sim.bags.transforms import POSE

T = np.arange(400) / 100.0


def poses(rate: float, flipped: bool) -> np.ndarray:
    """A body that swings about z by 0.4 rad at `rate` [Hz]; flipped: q and -q in turns."""
    half = 0.2 * np.sin(2.0 * np.pi * rate * T)
    zero = np.zeros_like(T)
    q = np.stack([zero, zero, np.sin(half), np.cos(half)], axis=1)
    if flipped:
        q[1::2] *= -1.0
    return np.concatenate([np.zeros((len(T), 3)), q], axis=1)


def followed(values: np.ndarray) -> Figures:
    """In pieces of 7 samples."""
    figures = Figures(COLUMNS[POSE])
    for first in range(0, len(T), 7):
        figures.add(T[first : first + 7], values[first : first + 7])
    return figures


def test_signs_of_quaternions_that_change_are_no_motion() -> None:
    plain, flipped = (followed(poses(0.5, by)) for by in (False, True))
    np.testing.assert_array_equal(flipped.spread, plain.spread)
    assert not followed(poses(0.0, True)).moves


def test_the_values_of_the_caller_stay_as_they_are() -> None:
    values = poses(0.5, True)
    before = values.copy()
    followed(values)
    np.testing.assert_array_equal(values, before)


def test_a_topic_of_few_messages_takes_little_memory() -> None:
    """A bag may have ten thousand of them, with five figures each."""
    t, values = np.arange(12) * 0.01, np.zeros((12, 7))
    tracemalloc.start()
    try:
        kept = [Figures(COLUMNS[POSE]) for _ in range(100)]
        for figures in kept:
            figures.add(t, values)
        taken = tracemalloc.get_traced_memory()[0] / len(kept)
    finally:
        tracemalloc.stop()
    assert taken < 12_000


# What is rounding beside other numbers of its unit has no frequency.


RATE = 100.0
T_SIZES = np.arange(400) / RATE
WAVE = np.sin(2.0 * np.pi * 5.0 * T_SIZES)


def peaks(sources: dict[str, dict[str, float]], length: float = 0.0) -> dict[str, dict[str, float]]:
    """The peak frequencies of waves of 5 Hz, by source and number; given: their amplitudes."""
    found = Analysis("bag", length=length)
    for name, amplitudes in sources.items():
        figures = found.figures[name] = Figures(tuple(amplitudes))
        figures.add(T_SIZES, np.stack([a * WAVE for a in amplitudes.values()], axis=1))
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


# The table of aligned samples.


def test_text_is_made_piece_by_piece(tmp_path, monkeypatch) -> None:
    """Numbers as Python has them take four times their room: never those of a whole table."""
    monkeypatch.setattr(table, "AT_ONCE", 4_000)
    t = np.arange(20_000) / 100.0
    values = np.column_stack([np.sin(k * t) for k in range(7)])
    made = table.Aligned()
    made.add("/body", table_columns(), t, values)
    size = 8 * values.size
    tracemalloc.start()
    try:
        made.write_csv(tmp_path / "samples.csv")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 4 * size
    with (tmp_path / "samples.csv").open() as file:
        _, *rows = csv.reader(file)
    np.testing.assert_array_equal(np.array(rows, float), np.column_stack([t, values]))


def table_columns() -> tuple[str, ...]:
    from rb_sim.bags.analysis.figures import COLUMNS

    return COLUMNS["pose"]
