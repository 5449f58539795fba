# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the poses of a body tell: peaks, free falls, impacts, and the twist beside them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.bags.analysis.analysis_page import write_report
from rb_sim.bags.analysis.bodies import STRETCH, BodyFigures, jumps
from rb_sim.bags.analysis.derivatives import Body
from rb_sim.bags.analysis.recorded_run import analyze
from rb_sim.io.bag.bag_sink import BagSink
from rb_sim.scene.listing import find_scene
from tests.bags.analysis import foreign
from tests.bags.analysis.foreign import pose_stamped as pose
from tests.bags.analysis.foreign import writing
from tests.bags.analysis.test_foreign import T

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


T_BODIES = 1e-3 * np.arange(1000)
W = 2.0 * np.pi / 16e-3
HARD = 9806.65


@pytest.mark.parametrize(
    "position",
    [
        HARD / 400.0 * np.c_[np.cos(20 * T_BODIES), np.sin(20 * T_BODIES), 0 * T_BODIES],
        HARD / 400.0 * np.c_[np.cos(20 * T_BODIES), 0 * T_BODIES, 0 * T_BODIES],
        HARD * np.c_[0.5 * T_BODIES**2 - np.cos(W * T_BODIES) / W**2, 0 * T_BODIES, 0 * T_BODIES],
        1.05 * HARD * np.c_[0.5 * T_BODIES**2, 0 * T_BODIES, 0 * T_BODIES],
    ],
    ids=["turns", "swings", "pulses", "another one"],
)
def test_what_is_as_hard_but_no_even_fall(tmp_path, position) -> None:
    """A thousand times gravity whose direction turns, or whose size does not stay."""
    q = np.tile([0.0, 0.0, 0.0, 1.0], (len(T_BODIES), 1))
    bag = foreign.write(tmp_path / "bag", t=T_BODIES, position=position, q=q)
    assert not any("gravity" in line for line in analyze(bag).notes)


# Impacts, beside which poses tell no accelerations: of a ball whose bounces are closed forms.


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
def test_figures_are_those_of_the_flight(bag: Path, tmp_path: Path, ours: bool) -> None:
    """Without the impacts, which events or jumps tell, all that is left of the force is weight."""
    topics = None if ours else frozenset({"/rb_sim/ball/pose"})
    found = analyze(bag, topics=topics)
    told = found.as_dict()["bodies"]["ball" if ours else "/rb_sim/ball/pose"]
    expected = bounces(np.sqrt(2.0 / G), np.sqrt(2.0 * G), 10)
    expected = expected[expected < 2.4 - 0.05]
    assert told["struck"]["count"] == len(expected) == 4
    middles = np.mean(told["struck"]["intervals"], axis=1)
    assert middles == pytest.approx(expected, abs=0.01)
    word = "has 4 impacts" if ours else "jumps, or moves too fast for the sample rate, 4 times"
    (line,) = [note for note in (found.events if ours else found.notes) if word in note]
    assert f"{word} (t = 0.45" in line and "of 233 samples are excluded" in line
    if ours:  # an impact is nothing that is wrong with a recording
        assert found.notes == []
        write_report(found, page := tmp_path / "report.html")
        text = page.read_text(encoding="utf-8")
        assert '<p class="verdict good"><b>Problems.</b> none found' in text and line in text
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


# A twist beside the derivative of the poses: other axes, units or signs than it says are told.


TURN = Rotation.from_rotvec(np.c_[0.3 * np.sin(T), 0.0 * T, 0.8 * T])
P = np.c_[0.5 * np.sin(3.0 * T), 0.1 + 0.3 * T, 0.2 * T]
V = np.c_[1.5 * np.cos(3.0 * T), 0.3 + 0.0 * T, 0.2 + 0.0 * T]
STEP = 1e-5
SPIN = (
    Rotation.from_rotvec(np.c_[0.3 * np.sin(T + STEP), 0.0 * T, 0.8 * (T + STEP)])
    * Rotation.from_rotvec(np.c_[0.3 * np.sin(T - STEP), 0.0 * T, 0.8 * (T - STEP)]).inv()
).as_rotvec() / (2.0 * STEP)


def notes(path: Path, v: np.ndarray, w: np.ndarray, p: np.ndarray = P, **options: Any) -> list[str]:
    """What is told of an Odometry with these velocities."""
    with writing(path) as bag:
        for k, t in enumerate(T):
            bag.add("/body", *foreign.odometry(t, p[k], TURN.as_quat()[k], v[k], w[k]), t)
    return [line for line in analyze(path, **options).notes if "velocity" in line]


def in_body(values: np.ndarray) -> np.ndarray:
    return TURN.inv().apply(values)


INNER = slice(4, -4)  # where the filter has a whole window
OFF = float(np.sqrt(np.sum((V - in_body(V))[INNER] ** 2) / np.sum(V[INNER] ** 2)))


def test_the_derivative_in_the_body_s_axes_is_reported_nowhere(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    v, w = (
        in_body(V) + rng.normal(0, 0.05, V.shape),
        in_body(SPIN) + rng.normal(0, 0.02, SPIN.shape),
    )
    assert notes(tmp_path / "x.mcap", v, w) == []
    masses = {"base_link": Body(1.0, np.eye(3), np.array([1.4, 0.1, 0.2]))}
    assert notes(tmp_path / "c.mcap", in_body(V), in_body(SPIN), masses=masses) == []
    noisy = P + rng.normal(0, 0.1, P.shape)  # whose derivative is noise, which tells nothing
    assert notes(tmp_path / "n.mcap", 0.0 * V, in_body(SPIN), noisy) == []


@pytest.mark.parametrize(
    ("v", "w", "p", "line"),
    [
        (V, in_body(SPIN), P, "linear velocity is not the derivative of its poses in the body's "
                              f"axes ({OFF:.0%} off), but in the axes of the poses (0.0% off)"),
        (1e3 * in_body(V), in_body(SPIN), P, "but in the body's axes times 1000 (is it in mm?)"),
        (in_body(V), in_body(SPIN), 1e3 * P, "body's axes over 1000 (are the poses in mm?)"),
        (1e3 * V, in_body(SPIN), P, "but in the axes of the poses times 1000 (is it in mm?)"),
        (-in_body(V), in_body(SPIN), P, "but in the body's axes with the other sign"),
        (in_body(V), np.degrees(in_body(SPIN)), P, "axes times 57.3 (is it in degrees?)"),
        (0.0 * V, in_body(SPIN), P, "linear velocity is zero, though its poses move"),
        (np.roll(in_body(V), 1, axis=1), in_body(SPIN), P,
         "linear velocity is not the derivative of its poses in the body's axes: "),
    ],
)  # fmt: skip
def test_what_it_is_instead_is_reported(tmp_path: Path, v, w, p, line: str) -> None:
    (told,) = notes(tmp_path / "x.mcap", v, w, p)
    assert told.startswith("/body:twist: its ") and line in told


@pytest.mark.parametrize(("frame", "told"), [("map", 0), ("body", 1), ("camera", 0)])
def test_a_topic_of_its_own(tmp_path: Path, frame: str, told: int) -> None:
    """In the axes of the poses, at half of their stamps; its frame says which axes it has."""
    path = tmp_path / "x.mcap"
    with writing(path) as bag:
        for k, t in enumerate(T):
            bag.add("/body/pose", *pose(t, P[k], TURN.as_quat()[k]), t)
            if k % 2:
                twist = foreign.twist_stamped(t + 3e-3, V[k], SPIN[k], frame)
                bag.add("/body/twist", *twist, t + 3e-3)
    lines = [line for line in analyze(path).notes if "linear velocity" in line]
    assert len(lines) == told
    assert all("but in the axes of the poses (" in line for line in lines)
