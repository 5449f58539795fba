# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Impacts, beside which poses tell no accelerations: of a ball whose bounces are closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.bags.analysis.bodies import STRETCH, BodyFigures, jumps
from rb_sim.bags.analysis.run import analyze
from rb_sim.io.bag.sink import BagSink
from rb_sim.scene.listing import find_scene

G, E, MASS = 9.81, 0.8, 0.5


def bounces(first: float, speed: float, count: int) -> np.ndarray:
    """Instants of the impacts of a ball that reaches the floor at `first` with `speed`."""
    return first + np.concatenate([[0.0], np.cumsum(2.0 * speed / G * E ** np.arange(1, count))])


def bouncing(rate: float, noise: float, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """t, poses of a ball that bounces three times while it turns, with noise, and the bounces."""
    t = np.arange(round(2.0 * rate)) / rate
    struck = bounces(0.4515, 4.4294, 4)
    after = np.concatenate([[0.4515 - 2.0 * 4.4294 / G], struck])
    speed = 4.4294 * E ** np.maximum(0, np.arange(-1, len(struck)))
    k = np.searchsorted(after, t, side="right") - 1
    since = t - after[k]
    p = np.c_[0.5 * t, 0.1 + 0.0 * t, speed[k] * since - 0.5 * G * since**2]
    q = np.c_[0.0 * t, 0.0 * t, np.sin(0.2 * t), np.cos(0.2 * t)]
    rng = np.random.default_rng(seed)
    rows = np.hstack([p, q]) + noise * rng.normal(size=(len(t), 7))
    return t, rows, struck[struck < t[-1]]


@pytest.mark.parametrize(("rate", "noise"), [(100, 0.0), (100, 1e-4), (100, 1e-3), (1000, 1e-5)])
def test_bounces_are_found_and_nothing_else(rate: float, noise: float) -> None:
    t, rows, struck = bouncing(rate, noise, 1)
    found = t[jumps(rows.T)]
    assert np.abs(found[:, None] - struck).min(axis=1).max() <= 1.0 / rate
    assert np.abs(found[:, None] - struck).min(axis=0).max() <= 1.0 / rate


@pytest.mark.parametrize("turn", [0.01, 0.3, 1.0])
@pytest.mark.parametrize("noise", [0.0, 1e-6, 1e-3])
def test_what_only_turns_is_noisy_or_starts_from_rest_is_not_struck(turn, noise) -> None:
    k = np.arange(20_000)
    p = np.c_[np.sin(turn * k), np.cos(turn * k), 0.0 * k]
    q = np.c_[0.0 * k, np.sin(0.1 * turn * k), 0.0 * k, np.cos(0.1 * turn * k)]
    rows = np.hstack([p, q]) + noise * np.random.default_rng(2).normal(size=(len(k), 7))
    assert not len(jumps(rows.T))
    rows[:, 0] = np.where(k > 9000, 1e-4 * (k - 9000.0) ** 2, 0.0)  # an acceleration sets in
    rows[:, 1:] = [1e-17, 0.0, 0.0, 0.0, 0.0, 1.0]
    rows[::7, 1] *= -1.0  # a point at rest but for rounding
    assert not len(jumps(rows.T))


def test_stretches_hide_no_bounce_and_tell_none_twice() -> None:
    """A bounce at each of the samples around the end of a stretch, where the next one begins."""
    for k in range(STRETCH - 11, STRETCH + 5, 2):
        n = np.arange(STRETCH + 500)
        p = np.c_[np.abs(n - k - 0.3), 0.0 * n, 0.0 * n]
        figures = BodyFigures(None)
        figures.add(0.01 * n, np.hstack([p, np.tile([0.0, 0.0, 0.0, 1.0], (len(n), 1))]))
        figures.finish()
        found = figures.as_dict()
        assert found["struck"]["count"] == 1, k
        [[begin, end]] = found["struck"]["intervals"]
        assert begin <= 0.01 * (k - 3) and end >= 0.01 * (k + 4)
        speed = found["motion"]["vx"]
        assert -100.0 <= speed["least"] + 1e-6 and speed["largest"] - 1e-6 <= 100.0


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    scene = load_scene(find_scene("bouncing_ball"), duration=2.4)
    simulation = Simulation(scene)
    sink = BagSink(tmp_path_factory.mktemp("struck") / "bag")
    sink.open(scene, simulation.layout)
    for block in simulation.blocks(2.4, scene.simulation.rate):
        sink.write(block)
    sink.close({})
    return tmp_path_factory.getbasetemp() / "struck0" / "bag"


@pytest.mark.parametrize("ours", [True, False])
def test_figures_are_those_of_the_flight(bag: Path, ours: bool) -> None:
    """Without the impacts, which events or jumps tell, all that is left of the force is weight."""
    topics = None if ours else frozenset({"/rb_sim/ball/pose"})
    found = analyze(bag, topics=topics)
    told = found.as_dict()["bodies"]["ball" if ours else "/rb_sim/ball/pose"]
    expected = bounces(np.sqrt(2.0 / G), np.sqrt(2.0 * G), 10)
    expected = expected[expected < 2.4 - 0.05]
    assert told["struck"]["count"] == len(expected) == 4
    middles = np.mean(told["struck"]["intervals"], axis=1)
    assert middles == pytest.approx(expected, abs=0.01)
    word = "has impacts" if ours else "jumps, or moves too fast for the sample rate,"
    (line,) = [note for note in found.notes if word in note]
    assert f"{word} 4 times (t = 0.45" in line and "of 233 samples are excluded" in line
    if ours:
        force = told["wrench"]["Fz"]
        assert force["least"] == pytest.approx(-MASS * G, abs=1e-6)
        assert force["largest"] == pytest.approx(-MASS * G, abs=1e-6)
        assert told["apart"]["force"] < 1e-6


def test_nothing_but_impacts_is_one_line() -> None:
    t, rows, _ = bouncing(100, 0.0, 1)
    figures = BodyFigures(None)
    figures.struck(np.arange(0.0, 2.0, 0.05))
    figures.add(t, rows)
    figures.finish()
    assert figures.as_dict()["note"].startswith("not differentiated: it jumps")
    assert len(figures.as_dict()) == 1
