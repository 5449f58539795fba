# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What ships with the node: the cart-pole controller in lockstep, and `make run`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from tests.ros import bags
from tests.ros.conftest import ROOT

EXAMPLE = ROOT / "examples" / "cart_pole"
CART, POLE, HALF, G = 1.0, 0.2, 0.5, 9.81
INERTIA = POLE * (2 * HALF) ** 2 / 12
SECONDS = 2.0


def rates(_: float, y: np.ndarray, force: float) -> list[float]:
    """Lagrange's equations; y = (x, angle from upright, their rates)."""
    _, angle, v, w = y
    coupling = POLE * HALF * np.cos(angle)
    mass = [[CART + POLE, coupling], [coupling, INERTIA + POLE * HALF**2]]
    pull = [force + POLE * HALF * np.sin(angle) * w**2, POLE * G * HALF * np.sin(angle)]
    return [v, w, *np.linalg.solve(mass, pull)]


def expected(gain: list[float]) -> np.ndarray:
    """The same controller with the force held over each sample, shape (n, 4)."""
    states = [np.zeros(4)]
    for k in range(round(SECONDS * 100)):
        force = 5.0 if k < 10 else -float(np.dot(gain, states[-1]))
        step = solve_ivp(rates, (0, 0.01), states[-1], args=(force,), rtol=1e-10, atol=1e-13)
        states.append(step.y[:, -1])
    return np.array(states)


def gain_of(printed: str) -> list[float]:
    """The controller's gain, as it prints it."""
    return [float(word) for word in printed.splitlines()[0][6:-1].split(",")]


def test_the_pole_is_balanced_as_the_equations_say(advance: type, start, tmp_path: Path):
    start(EXAMPLE / "cart_pole.yaml", start_paused=True)
    saved = tmp_path / "states.npy"
    command = [sys.executable, EXAMPLE / "balance.py", "--save", saved, "--seconds", str(SECONDS)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    gain = gain_of(done.stdout)
    states = np.load(saved)
    # the printed gain has four decimals
    np.testing.assert_allclose(states, expected(gain), atol=2e-5)
    assert np.max(np.abs(states[:, 1])) > np.radians(3.0)
    assert abs(states[-1, 1]) < np.radians(0.5)
    # without the controller the same push lets the pole fall
    fallen = solve_ivp(rates, (0, 1.0), states[10], args=(0.0,), rtol=1e-8).y[1, -1]
    assert abs(fallen) > np.radians(60.0)


def test_over_topics_each_command_is_the_gain_times_what_a_sample_says(start, tmp_path: Path):
    """How late it acts is up to the machine, and so is whether the pole stays up."""
    out = tmp_path / "run"
    node = start(EXAMPLE / "cart_pole.yaml", start_paused=True, real_time_factor=0.2, out=out)
    command = [sys.executable, EXAMPLE / "balance.py", "--topics", "--seconds", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr
    assert node.stop() == 0
    bag = bags.read(out / "bag")
    turns = [message.pose.orientation for message in bag["/rb_sim/pole/pose"].messages]
    angle = np.array([2.0 * np.arctan2(q.y, q.w) for q in turns])
    x, v = bag["/rb_sim/cart/pose"].position[:, 0], bag["/rb_sim/cart/twist"].twist[:, 0]
    states = np.stack([x, angle, v, bag["/rb_sim/pole/twist"].twist[:, 4]], axis=1)
    by_sample = -states @ gain_of(done.stdout)
    force = bag["/rb_sim/cart/wrench_command"].wrench[:, 0]
    pushed = np.count_nonzero(force == 5.0)
    assert pushed > 0 and len(force) > pushed
    closest = np.abs(force[pushed:, None] - by_sample).min(axis=1)
    assert closest.max() < 1e-3 * np.abs(force).max()  # the printed gain has four decimals


# `make run`: what it says is there is there, the second time, too.


def demonstrated(out: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "rb_sim.ros.demo", "--out", str(out)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def test_it_replaces_what_it_left_and_shows_plots_that_are_drawn(tmp_path: Path) -> None:
    (tmp_path / "node.log").write_text("of an earlier one")
    plots = tmp_path / "plots.png"
    plots.write_text("old")
    os.utime(plots, (1e9, 1e9))
    done = demonstrated(tmp_path)
    assert done.returncode == 0, done.stderr
    assert str(plots) in done.stdout.replace("\n", "")
    assert plots.read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "bag/metadata.yaml").is_file()


def test_logs_of_somebody_else_stay(tmp_path: Path) -> None:
    (tmp_path / "plots.png").write_text("mine")
    done = demonstrated(tmp_path)
    assert done.returncode == 1 and "already contains plots.png" in done.stderr
    assert (tmp_path / "plots.png").read_text() == "mine"
