# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Recordings of an exact motion with noise: what follows is the motion, and how much is noise."""

from __future__ import annotations

import json

import numpy as np
import pytest

from rb_sim.bags.analysis.analysis_page import tables
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.scene.load import scene_from_mapping
from tests.bags.analysis import foreign
from tests.cli.process import invoke

M, G = 2.0, 1.0
BODY = {"mass": M, "inertia": [0.1, 0.2, 0.3]}
POSES, TURNS, TWISTS = 2e-3, 5e-4, 5e-3
"""Noise of each component: [m], [rad], [m/s] and [rad/s]."""
WEIGHT = {"weight": {"type": "gravity", "acceleration": [0.0, 0.0, -G]}}


def thrown(n: int = 600, rate: float = 100.0):
    """Free fall with a steady spin about z: t, position, quaternion, velocity."""
    t, _, q = foreign.swing(n, rate)
    position = np.c_[2.0 * t, np.zeros(n), 3.0 * t - 0.5 * G * t**2]
    return t, position, q, np.c_[np.full(n, 2.0), np.zeros(n), 3.0 - G * t]


def driven(n: int = 600, rate: float = 100.0):
    """As `thrown`, at a steady 2 m/s along x."""
    t, position, q, velocity = thrown(n, rate)
    return t, position * [1.0, 0.0, 0.0], q, velocity * [1.0, 0.0, 0.0]


def odometry(folder, seed: int, twists: float = TWISTS, factor: float = 1.0, motion=thrown):
    """The throw as noisy Odometry, its twist in the body's axes times `factor`."""
    t, p, q, v = motion()
    random = np.random.default_rng(seed)
    p = p + POSES * random.standard_normal(p.shape)
    turned = q + np.hstack([0.5 * TURNS * random.standard_normal((len(t), 3)), 0.0 * t[:, None]])
    c, s = np.cos(0.8 * t), np.sin(0.8 * t)
    own = np.c_[c * v[:, 0] + s * v[:, 1], -s * v[:, 0] + c * v[:, 1], v[:, 2]]
    own = factor * (own + twists * random.standard_normal(own.shape))
    spin = np.array([0.0, 0.0, 0.8]) + twists * random.standard_normal((len(t), 3))

    def message(at, position, attitude):
        k = round(at * 100.0)
        return foreign.odometry(at, position, attitude, own[k], spin[k])

    return foreign.write(folder, message, t, p, turned), v


def scene(constraints=None):
    parts = {"bodies": {"body": BODY}, "effects": WEIGHT}
    return scene_from_mapping(parts | {"constraints": constraints or {}}, name="made")


def test_the_twist_of_an_odometry_is_taken_where_it_is_less_noisy(tmp_path):
    """The spread of vx and wz, constant in truth: of the filtered twist, not of filtered poses."""
    bag, _ = odometry(tmp_path / "bag", 1)
    found = analyze(bag, scene=scene()).bodies["/body"].as_dict()
    assert found["by_twist"] == {"velocity": True, "spin": True}
    for name, exact in (("vx", 2.0), ("wz", 0.8)):
        row = found["motion"][name]
        assert row["mean"] == pytest.approx(exact, abs=2e-3)
        spread = np.sqrt(row["rms"] ** 2 - row["mean"] ** 2)
        assert spread < TWISTS  # from the poses: 0.06 and 0.016


def test_noisy_poses_say_nothing_of_accelerations_that_are_the_twist_s(tmp_path):
    """A throw has no peak: where the acceleration follows from the twist, it is not called
    uncertain by what noise of the poses would make of it; where it follows from them, neither."""
    for twists in (TWISTS, 0.5):
        bag, _ = odometry(tmp_path / f"bag{twists}", 3, twists)
        found = analyze(bag, scene=scene()).bodies["/body"]
        assert found.as_dict()["by_twist"]["velocity"] == (twists == TWISTS)
        assert not [note for note in found.notes if "peak acceleration" in note]


@pytest.mark.parametrize(("twists", "factor"), [(0.5, 1.0), (TWISTS, 57.3), (TWISTS, 0.0)])
def test_a_twist_that_is_worse_or_another_one_is_not_taken(tmp_path, twists, factor):
    bag, _ = odometry(tmp_path / "bag", 2, twists, factor)
    found = analyze(bag, scene=scene()).bodies["/body"].as_dict()
    assert not found["by_twist"]["velocity"]
    assert found["motion"]["vx"]["mean"] == pytest.approx(2.0, abs=0.02)


@pytest.mark.parametrize("factor", [1.0, 0.0])
def test_the_noise_of_a_balance_bounds_it(tmp_path, factor):
    """What acted is known: all that is left of the energy and momenta is noise. Over 12 recordings
    the error is as large as the bound says: below it mostly, and not far below always."""
    ratios = []
    for seed in range(12):
        bag, _ = odometry(tmp_path / f"bag{seed}", seed, TWISTS, factor)
        found = analyze(bag, scene=scene())
        (balance,) = found.balances.values()
        rows = [balance["energy"], *balance["momentum"].values()]
        ratios.append([abs(row["error"]) / row["noise"] for row in rows])
    assert np.mean(np.array(ratios) < 1.0) > 0.85
    assert (np.max(ratios, axis=0) > 0.2).all()
    (table,) = [table for table in tables(found) if table.title == "Balance errors"]
    assert [float(row[-1]) for row in table.rows] == pytest.approx(
        [row["noise"] for row in rows], rel=0.01
    )


def test_the_noise_of_what_supplies_a_balance_bounds_it(tmp_path):
    """A drag of 100 N s/m that a force of 200 N makes up for: noise of the velocity changes the
    energy by 0.02 J, and the work of the drag, summed over 6 s, by twenty times as much."""
    effects = {
        "drag": {"type": "linear_drag", "body": "body", "coefficient": 100.0},
        "drive": {"type": "wrench", "body": "body", "force": [200.0, 0.0, 0.0]},
    }
    made = scene_from_mapping({"bodies": {"body": BODY}, "effects": effects}, name="made")
    ratios = []
    for seed in range(12):
        bag, _ = odometry(tmp_path / f"bag{seed}", seed, motion=driven)
        (balance,) = analyze(bag, scene=made).balances.values()
        ratios.append(abs(balance["energy"]["error"]) / balance["energy"]["noise"])
    assert np.mean(np.array(ratios) < 1.0) > 0.85
    assert np.max(ratios) > 0.2


def test_without_the_reactions_there_is_no_balance_of_momentum(tmp_path):
    """A body that a plane at y = 0.1 holds: its reaction is not recorded, and does no work."""
    t, _, q = foreign.swing()
    p = np.c_[2.0 * t, 0.1 * np.ones_like(t), 3.0 * t - 0.5 * G * t**2]
    bag = foreign.write(tmp_path / "bag", t=t, position=p, q=q)
    plane = {"type": "plane", "body": "body", "normal_A": [0, 1, 0], "point_A": [0, 0.1, 0]}
    parts = {"bodies": {"body": BODY | {"position": [0, 0.1, 0]}}, "effects": WEIGHT}
    parts |= {"constraints": {"wall": plane}}
    made = scene_from_mapping(parts, name="made")
    (balance,) = analyze(bag, scene=made).balances.values()
    assert balance["momentum"] is None and balance["momentum_lacks_reactions_of"] == ["wall"]
    assert abs(balance["energy"]["error"]) < 1e-7
    (tmp_path / "made.yaml").write_text(json.dumps(parts))
    printed = invoke("analyze", bag, "--masses", tmp_path / "made.yaml").stdout
    assert "momentum error not available: no reactions of wall" in printed


@pytest.mark.parametrize("every", [7, 50])
def test_single_lost_messages_are_no_gaps(tmp_path, every):
    """One in seven lost leaves no eleven poses in a row; the balance goes on across them."""
    t, p, q, _ = thrown()
    keep = np.arange(len(t)) % every != 3
    bag = foreign.write(tmp_path / "bag", t=t[keep], position=p[keep], q=q[keep])
    found = analyze(bag, scene=scene())
    rates = found.figures["/body"].rates.as_dict()
    assert rates["gaps"] == 0 and rates["lost"] == (~keep).sum()
    assert rates["rate"] == pytest.approx(100.0, rel=1e-6)
    (balance,) = found.balances.values()
    assert balance["stretches"] == 1
    assert abs(balance["energy"]["error"]) < 1e-6 * balance["energy"]["scale"]
    twice = keep & (np.arange(len(t)) != 304)  # beside the lost sample 303 of every = 50
    bag = foreign.write(tmp_path / "gap", t=t[twice], position=p[twice], q=q[twice])
    assert analyze(bag).figures["/body"].rates.as_dict()["gaps"] == (every == 50)
