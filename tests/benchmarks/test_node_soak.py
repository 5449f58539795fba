"""Samples lost: by a subscriber that did not look, or because the node sent them in a burst."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.node_soak import judged

PERIOD = 0.002


def test_what_was_sent_in_time_is_not_the_nodes_loss():
    """Thirty samples are lacking, and were sent as they were due."""
    ticks = np.delete(np.arange(200), np.arange(50, 80))
    lost, hurried, eleven = judged(ticks, PERIOD * ticks, PERIOD)
    assert (lost, hurried) == (30, 0)
    assert eleven == pytest.approx(20.0)


def test_what_was_sent_in_a_burst_is():
    """Fifteen samples come at once, after 30 ms, and the subscriber keeps the last ten."""
    ticks = np.delete(np.arange(200), np.arange(50, 55))
    sent = PERIOD * ticks
    sent[(ticks >= 50) & (ticks < 65)] = PERIOD * 65
    sent[ticks == 49] = PERIOD * 64.5
    lost, hurried, eleven = judged(ticks, sent, PERIOD)
    assert (lost, hurried) == (5, 5)
    assert eleven == 0.0
