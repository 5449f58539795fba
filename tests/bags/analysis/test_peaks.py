# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Peaks of few samples: how far off they are that the filter makes, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim.bags.analysis.bodies import BodyFigures
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.run import analyze
from tests.bags.analysis import foreign

H = 1e-2
CUBE = Body(2.0, np.diag([0.1, 0.2, 0.3]), np.zeros(3))


def figures(position: np.ndarray, turn: np.ndarray) -> BodyFigures:
    """Of poses at H: along x, and turned about z by angles."""
    q = Rotation.from_rotvec(np.outer(turn, [0.0, 0.0, 1.0])).as_quat()
    found = BodyFigures(CUBE)
    pose = np.hstack([np.outer(position, [1.0, 0.0, 0.0]), q])
    found.add(H * np.arange(len(pose)), pose)
    found.finish()
    return found


def bump(count: int, width: float, at: float) -> np.ndarray:
    """exp(-t^2 / 2 s^2), whose largest second derivative is 1 / s^2, with s of `width` samples."""
    return np.exp(-0.5 * ((np.arange(count) - at) / width) ** 2)


@pytest.mark.parametrize("width", [2.5, 3.0, 3.5])
@pytest.mark.parametrize("moves", ["position", "attitude"])
def test_a_narrow_peak_tells_how_far_it_is_off(width: float, moves: str) -> None:
    rows = 0.01 * bump(400, width, 200.0), np.zeros(400)
    found = figures(*(rows if moves == "position" else rows[::-1]))
    key, exact = 0 if moves == "position" else 1, 0.01 / (width * H) ** 2
    values = found.as_dict()["wrench"]["Fx" if key == 0 else "Kz"]
    largest = max(-values["least"], values["largest"]) / (2.0 if key == 0 else 0.3)
    error = exact - largest
    told = found.as_dict()["peaks"]["acceleration" if key == 0 else "angular_acceleration"]
    assert error > 0.01 * exact and told["largest"] == pytest.approx(largest)
    assert 0.6 * error < told["off"] < 1.1 * error
    (note,) = found.notes
    assert "peak acceleration uncertain by about" in note
    assert f"{told['off']:.2g} of {largest:.3g} {'m/s^2' if key == 0 else 'rad/s^2'}" in note
    assert " and " not in note.partition("about")[2]


def test_a_wide_peak_is_as_it_is() -> None:
    found = figures(0.01 * bump(400, 12.0, 200.0), 0.01 * bump(400, 12.0, 100.0))
    assert found.notes == []
    for told in found.as_dict()["peaks"].values():
        assert told["off"] < 1e-3 * told["largest"]


def test_a_peak_at_an_end_is_the_largest_but_not_judged() -> None:
    """The filter has no sample more on that side."""
    found = figures(0.01 * bump(400, 3.0, 5.0), np.zeros(400))
    told = found.as_dict()
    assert told["peaks"]["acceleration"]["largest"] == pytest.approx(
        max(abs(told["wrench"]["Fx"][key]) for key in ("least", "largest")) / 2.0
    )
    assert told["peaks"]["acceleration"]["off"] is None
    assert found.notes == []


def test_noise_and_rounding_are_no_peaks() -> None:
    """What stands still, or moves evenly, has accelerations of rounding only."""
    random = np.random.default_rng(3)
    still = figures(np.full(4000, 5.0), np.zeros(4000))
    even = figures(5.0 + H * np.arange(4000), 0.3 * H * np.arange(4000))
    noisy = figures(1e-4 * random.standard_normal(4000), 1e-4 * random.standard_normal(4000))
    for found in (still, even, noisy):
        assert not any("peaks" in line for line in found.notes)
        assert [of["off"] for of in found.as_dict()["peaks"].values()] == [None, None]


def falls(t: np.ndarray, size: float) -> np.ndarray:
    """A throw in units of which `size` are a metre."""
    return size * np.c_[2.0 * t, 0.1 * np.sin(3.0 * t), 3.0 * t - 0.5 * 9.81 * t**2]


@pytest.mark.parametrize(("size", "unit"), [(1000.0, "mm"), (100.0, "cm"), (1.0, "")])
@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_a_free_fall_tells_in_which_unit_poses_are(tmp_path, size, unit, noise) -> None:
    """Without a twist beside them, and with noise of a tenth of a millimetre."""
    t, _, q = foreign.swing(100)
    position = falls(t, size)
    position += noise * size * np.random.default_rng(1).standard_normal(position.shape)
    bag = foreign.write(tmp_path / "bag", t=t, position=position, q=q)
    lines = [line for line in analyze(bag).notes if "gravity" in line]
    if unit:
        told = f"/body: falls at {size * 9.80665:.0f} m/s^2, {size:.0f} times gravity: "
        assert lines == [told + f"are its poses in {unit}?"]
    else:
        assert lines == []


T = 1e-3 * np.arange(1000)
W = 2.0 * np.pi / 16e-3
HARD = 9806.65


@pytest.mark.parametrize(
    "position",
    [
        HARD / 400.0 * np.c_[np.cos(20 * T), np.sin(20 * T), 0 * T],
        HARD / 400.0 * np.c_[np.cos(20 * T), 0 * T, 0 * T],
        HARD * np.c_[0.5 * T**2 - np.cos(W * T) / W**2, 0 * T, 0 * T],
        1.05 * HARD * np.c_[0.5 * T**2, 0 * T, 0 * T],
    ],
    ids=["turns", "swings", "pulses", "another one"],
)
def test_what_is_as_hard_but_no_even_fall(tmp_path, position) -> None:
    """A thousand times gravity whose direction turns, or whose size does not stay."""
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(T), 1))
    bag = foreign.write(tmp_path / "bag", t=T, position=position, q=q)
    assert not any("gravity" in line for line in analyze(bag).notes)
