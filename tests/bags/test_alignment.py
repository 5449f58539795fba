# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What is known of a motion between its samples: nothing across an impact, nor of many turns."""

from __future__ import annotations

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.bags.alignment import Interpolated
from rb_sim.bags.compare import differences, summary, unit_note
from rb_sim.bags.tracks import Track, Tracks, tracks_of_blocks


def bounced(rate: float) -> Tracks:
    simulation = Simulation(load_scene("bouncing_ball", duration=1.2, rate=rate))
    block = simulation.run(checks=False).block
    return tracks_of_blocks([block], simulation.scene, simulation.layout, "ball")


def test_a_ball_that_bounces_is_not_apart_from_itself():
    """A spline across an impact is off by centimetres, and another order of it by the same; in
    between the ball falls on a parabola, which three samples tell exactly."""
    found = differences(bounced(250.0), bounced(37.0))
    (rows,) = (row for name, row in summary(found)["differences"].items() if name == "ball")
    assert rows["position"]["max"] < 1e-12 and rows["position"]["first_above"] is None
    assert rows["velocity"]["max"] < 1e-11 and rows["velocity"]["first_above"] is None
    (line,) = [note for note in found.notes if note.startswith("ball: ")]
    assert line.endswith("samples skipped (gap, impact or reset in B)")


def spinning(rate: float, spin: float, told: bool) -> Tracks:
    """A body that turns evenly about z."""
    t = np.arange(0.0, 2.0, 1.0 / rate)
    zero = np.zeros_like(t)
    q = np.stack([zero, zero, np.sin(0.5 * spin * t), np.cos(0.5 * spin * t)], axis=1)
    w = np.stack([zero, zero, zero + spin], axis=1)
    rates = (np.zeros((len(t), 3)), w) if told else (None, None)
    return Tracks("x", {"rotor": Track(t, np.zeros((len(t), 3)), q, *rates)})


@pytest.mark.parametrize(("spin", "told"), [(100.0, False), (160.0, True), (310.0, True)])
def test_nothing_is_known_between_samples_of_many_turns(spin, told):
    """At 40 Hz it turns by 2.5, 4 and 7.75 rad between samples, the last two of which attitudes
    show as less: its spin tells it."""
    found = differences(spinning(1000.0, spin, told), spinning(40.0, spin, told))
    angle = summary(found)["differences"]["rotor"]["angle"]
    assert angle["first_above"] is None and angle["growth"] is None
    assert angle["interpolation"] == pytest.approx(np.pi)
    assert any(
        "interpolation between the samples of B causes differences up to 3.1 rad of angle" in n
        for n in found.notes
    )


def test_slower_turns_are_compared():
    found = differences(spinning(1000.0, 100.0, True), spinning(400.0, 101.0, True))
    angle = summary(found)["differences"]["rotor"]["angle"]
    assert angle["max"] == pytest.approx(2.0, rel=0.01) and angle["first_above"] < 0.01


def test_two_samples_between_impacts_tell_nothing_between_them():
    t = np.arange(10) * 0.1
    still = np.tile([0.0, 0.0, 0.0, 1.0], (10, 1))
    curve = Interpolated(Track(t, np.zeros((10, 3)), still, anew=(4, 6)))
    known = curve.known(np.array([0.15, 0.35, 0.4, 0.45, 0.5, 0.55, 0.65]))
    assert known.tolist() == [True, False, True, False, True, False, True]


# Motions that are one another in other units.


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
        times = f"about {factor:.0f} times those of {rest}"
        assert line == f"ball: the positions of {which} are {times}: is {which} in {unit}?"


@pytest.mark.parametrize(
    "other", [P, 0.0 * P, 10.0 * P, 1000.0 * P[:, ::-1], 300.0 * P, -1000.0 * P]
)
def test_other_differences_are_none_of_units(other):
    assert not unit_note(P, other) and not unit_note(other, P)


def test_what_stands_still_says_nothing():
    assert not unit_note(0.0 * P, 0.0 * P) and not unit_note(P[:1], 1000.0 * P[:1])
