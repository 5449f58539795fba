# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fewer points in bounded memory, with every peak kept."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim.io.sink import Envelope, Thinned, Timeline


def feed(envelope: Envelope, t, values, sizes) -> None:
    first = 0
    while first < len(t):
        n = int(sizes.integers(1, 700))
        envelope.add(t[first : first + n], values[first : first + n])
        first += n


@pytest.mark.parametrize("n", [0, 1, 7, 63, 64, 65, 1000, 30_011])
def test_envelope_keeps_the_extremes(n):
    """Buckets of 2^k samples hold exactly the least and greatest of theirs."""
    random = np.random.default_rng(n)
    t, values = np.arange(n) * 0.5, random.normal(size=(n, 3))
    envelope = Envelope(3, capacity=32)
    feed(envelope, t, values, random)
    times, curves = envelope.curves()
    if n < 64:
        np.testing.assert_array_equal(times, t)
        np.testing.assert_array_equal(curves, values)
        return
    assert len(times) <= 2 * 64
    stride = 2 ** int(np.log2(n / 64) + 1)
    starts = np.arange(0, n, stride)
    np.testing.assert_array_equal(times[::2], t[starts])
    np.testing.assert_array_equal(curves[::2], np.minimum.reduceat(values, starts))
    np.testing.assert_array_equal(curves[1::2], np.maximum.reduceat(values, starts))


def test_envelope_takes_single_samples():
    envelope = Envelope(1, capacity=16)
    for k in range(5000):
        envelope.add(np.array([float(k)]), np.array([[1.0 if k == 3333 else 0.0]]))
    _, curves = envelope.curves()
    assert curves.max() == 1.0 and len(curves) <= 64


def test_thinned_keeps_both_ends():
    random = np.random.default_rng(0)
    rows = np.c_[np.arange(10_007.0), np.arange(10_007.0) ** 2]
    thinned, first = Thinned(2, capacity=50), 0
    while first < len(rows):
        n = int(random.integers(0, 300))
        thinned.add(rows[first : first + n])
        first += n
    kept = thinned.rows
    assert len(kept) <= 51
    np.testing.assert_array_equal(kept[0], rows[0])
    np.testing.assert_array_equal(kept[-1], rows[-1])
    assert set(np.diff(kept[:-1, 0])) == {256.0}


def test_timeline_goes_on_after_a_reset():
    timeline = Timeline()
    follow = [timeline.follow(np.array(t)) for t in ([0.0, 1, 2], [], [2.0, 3, 0, 1], [0.0, 5])]
    expected = [0, 1, 2, 2, 3, 3, 4, 4, 9]
    np.testing.assert_array_equal(np.concatenate(follow), expected)
