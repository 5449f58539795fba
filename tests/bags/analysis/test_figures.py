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

import tracemalloc

import numpy as np

from rb_sim.bags.analysis.figures import COLUMNS, Figures
from rb_sim.bags.sources import POSE

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
