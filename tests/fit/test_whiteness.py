# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fits that would end in a wrong minimum find the truth; what is left and no noise is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from rb_sim.cli.main import app
from rb_sim.fit.fit import correlation

NOISE = (1e-3, 2e-3)
T = np.linspace(0.0, 2.0, 81)


def fitted(position: np.ndarray, turn: np.ndarray, effects: dict, keys: list[str]) -> Any:
    """Fit a body that starts with 20 rad/s about z to these positions and turns about z [rad]."""
    from rb_sim import load_scene
    from rb_sim.bags.tracks import Track, Tracks
    from rb_sim.fit.fit import Recording, fit

    rng = np.random.default_rng(3)
    exact = Rotation.from_rotvec(np.c_[0.0 * turn, 0.0 * turn, turn])
    seen = Rotation.from_rotvec(rng.normal(0, NOISE[1], (len(T), 3))) * exact
    p = position + rng.normal(0, NOISE[0], position.shape)
    track = Track(T, p, seen.as_quat())
    body = {"mass": 2.0, "inertia": [0.1, 0.2, 0.3], "angular_velocity": [0.0, 0.0, 20.0]}
    steps = {"duration": 2.0, "rate": 40, "method": "rk4", "step": 0.0125}
    data = {"bodies": {"rotor": body}, "effects": effects, "simulation": steps}
    recording = Recording(Tracks("seen", {"rotor": track}), {"rotor": "rotor"})
    return fit(recording, load_scene(data), data, keys)


def test_a_turn_is_not_missed_by_a_whole_one():
    """It turns at 31 rad/s: what the start misses goes round three and a half times in 2 s."""
    told = fitted(np.zeros((len(T), 3)), 31.0 * T, {}, ["bodies.rotor.angular_velocity"])
    assert told.values[2] == pytest.approx(31.0, abs=4.0 * told.errors[2])
    assert told.errors[2] < 1e-3 and told.correlation_left == 0.0


def test_another_law_is_told():
    """It is pulled by a spring, and the scene knows only a steady force: no force follows that."""
    steady = {"pull": {"type": "wrench", "body": "rotor", "force": [0.5, 0.0, 0.0]}}
    position = np.c_[0.1 * (1.0 - np.cos(5.0 * T)), 0.0 * T, 0.0 * T]
    told = fitted(position, 20.0 * T, steady, ["effects.pull.force"])
    assert told.correlation_left > 0.8
    assert told.as_dict()["correlation_left"] == told.correlation_left


def test_a_single_number_without_effect_is_named_and_stays():
    """The mass of a free body, which is the largest effect of all there are."""
    told = fitted(np.zeros((len(T), 3)), 20.0 * T, {}, ["bodies.rotor.mass"])
    assert told.undetermined == ["bodies.rotor.mass"]
    assert told.values[0] == 2.0 and np.isinf(told.errors[0])


def test_a_pose_that_is_far_off_is_told():
    position = np.zeros((len(T), 3))
    told = fitted(position, 20.0 * T, {}, ["bodies.rotor.angular_velocity"])
    assert told.outliers == ()
    position[30, 1] = 0.2
    told = fitted(position, 20.0 * T, {}, ["bodies.rotor.angular_velocity"])
    assert told.outliers == (
        "rotor: 1 of 81 poses are off by more than 10 times the noise of the others (t = 0.75 s): "
        "they distort the fit and enlarge its errors",
    )
    assert told.as_dict()["outliers"] == list(told.outliers)


def test_correlation():
    """0 for noise, cos(w h) for an oscillation, nothing from few samples."""
    rng = np.random.default_rng(0)
    assert abs(correlation([rng.normal(size=(4000, 3))])) < 4.0 / np.sqrt(12_000)
    wave = np.sin(0.3 * np.arange(4000))[:, None] * np.ones(3)
    assert correlation([wave]) == pytest.approx(np.cos(0.3), abs=1e-3)
    assert correlation([np.ones((5, 3))]) == 0.0


@pytest.mark.parametrize(
    ("scene", "number", "value"),
    [("heavy_top", "bodies.top.mass", 17), ("pendulum", "effects.weight.acceleration[2]", -9.7)],
)
def test_a_body_whose_origin_is_held_leaves_rounding(scene, number, value, tmp_path):
    """Its origin goes nowhere; its turn says what is rounding."""
    made = ["run", scene, "--duration", "0.5", "--out", str(tmp_path / "out"), "--no-rerun",
            "--set", f"{number}={value}", "--no-plots", "--quiet"]  # fmt: skip
    assert CliRunner().invoke(app, made).exit_code == 0
    bag = str(tmp_path / "out" / "bag")
    done = CliRunner().invoke(app, ["fit", bag, "--scene", scene, "--free", number])
    assert done.exit_code == 0 and "correlated" not in done.output and "noise" not in done.output
