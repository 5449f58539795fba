# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Fits to recordings made with known numbers and noise find them within their errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from rb_sim.bags.fit.fit import outliers
from rb_sim.bags.fit.unknowns import free_numbers
from rb_sim.base.errors import RbSimError
from rb_sim.cli.main import app
from rb_sim.simulation.sensitivity import NotSmoothError
from tests.cli.process import invoke

TIMES = {"duration": 1.0, "rate": 40, "method": "rk4", "step": 0.0125}
BOX = {"mass": 2.0, "inertia": [0.1, 0.2, 0.3]}
SCENES: dict[str, tuple[dict[str, Any], dict[str, float]]] = {
    "drag": (
        {"bodies": {"ball": BOX | {"linear_velocity": [3.0, 0.0, 4.0]}},
         "effects": {"weight": {"type": "gravity"},
                     "air": {"type": "quadratic_drag", "body": "ball", "coefficient": 0.3}}},
        {"effects.air.coefficient": 0.2},
    ),
    "spring": (
        {"bodies": {"ball": BOX | {"position": [0.3, 0.0, 0.2]}},
         "effects": {"hook": {"type": "spring", "body": "ball", "point_A": [0, 0, 1],
                              "stiffness": 50.0, "damping": 1.0, "rest_length": 0.5}}},
        {"effects.hook.stiffness": 60.0, "effects.hook.damping": 0.7},
    ),
    "throw": (
        {"bodies": {"ball": BOX | {"linear_velocity": [1.0, 0.5, 2.0],
                                   "angular_velocity": [0.3, 3.0, 0.2]}},
         "effects": {"weight": {"type": "gravity"}}},
        {"bodies.ball.linear_velocity": 0.0, "bodies.ball.angular_velocity": 0.0},
    ),
    "top": (
        {"bodies": {"top": {"mass": 1.5, "inertia": [0.1, 0.1, 0.05],
                            "center_of_mass": [0, 0, 0.3],
                            "orientation": {"axis": [1, 0, 0], "angle": 0.5},
                            "angular_velocity": [0.0, 0.0, 40.0]}},
         "constraints": {"tip": {"type": "fixed_point", "body": "top"}},
         "effects": {"weight": {"type": "gravity"}}},
        {"bodies.top.mass": 1.2},
    ),
    "table": (
        {"bodies": {"cart": BOX},
         "effects": {"push": {"type": "wrench_table", "body": "cart", "times": [0.0, 0.4, 1.0],
                              "forces": [[0, 0, 0], [9.0, 4.0, 0], [2.0, 0, 0]]}}},
        {"bodies.cart.mass": 1.5},
    ),
    "attitude": (
        {"bodies": {"nut": BOX | {"angular_velocity": [0.1, 2.0, 0.1]}}},
        {"bodies.nut.orientation": 0.0},
    ),
    "shares": (
        {"bodies": {"nut": {"mass": 2.0, "inertia": [0.1, 0.2, 0.25],
                            "angular_velocity": [0.3, 4.0, 0.2]}}},
        {"bodies.nut.inertia": 0.0},
    ),
}  # fmt: skip
NOISE = (1e-3, 2e-3)


def refit(name: str, seed: int, noise: tuple[float, float] | None) -> dict[str, Any]:
    """Simulate the truth, spoil it, start elsewhere, fit; what came out and what it should be."""
    from scipy.spatial.transform import Rotation

    from rb_sim import Simulation, load_scene
    from rb_sim.bags.fit.fit import Recording, fit
    from rb_sim.bags.tracks import tracks_of_blocks
    from rb_sim.scene.values import value_at

    truth, starts = SCENES[name]
    scene = load_scene(truth | {"simulation": TIMES})
    simulation = Simulation(scene)
    block = simulation.run(checks=False).block
    tracks = tracks_of_blocks([block], scene, simulation.layout, "truth")
    (body,) = tracks.bodies
    track, rng = tracks.bodies[body], np.random.default_rng(seed)
    track.position = track.position + rng.normal(0, NOISE[0], track.position.shape)
    turn = Rotation.from_rotvec(rng.normal(0, NOISE[1], (len(track.t), 3)))
    track.orientation = (turn * Rotation.from_quat(track.orientation)).as_quat()
    data = _plain(truth | {"simulation": TIMES})
    for key, value in starts.items():
        *path, last = key.split(".")
        if last == "orientation":
            data["bodies"][body]["orientation"] = [0.02, -0.03, 0.01, 1.0]
            data["bodies"][body]["orientation"] /= np.linalg.norm([0.02, -0.03, 0.01, 1.0])
            data["bodies"][body]["orientation"] = data["bodies"][body]["orientation"].tolist()
            continue
        at = value_at(data, ".".join(path))
        wanted = at[last]
        at[last] = [0.9 * x + 0.02 for x in wanted] if isinstance(wanted, list) else value
    started = load_scene(data)
    keys = list(starts)
    recording = Recording(tracks, {body: body})
    found = fit(recording, started, data, keys, noise)
    values = []
    for number in found.free:
        if number.turn:
            q0 = Rotation.from_quat(started.bodies[body].orientation)
            values.append(q0.inv().as_rotvec()[number.index])
        else:
            at = value_at(truth, number.key)
            values.append(at if number.index is None else at[number.index])
    return {"names": [n.name for n in found.free], "found": found.values, "errors": found.errors,
            "truth": np.array(values), "noise": found.noise,
            "undetermined": found.undetermined}  # fmt: skip


def refit_by_differences(*arguments: Any) -> dict[str, Any]:
    """The same, where the motion has no derivatives."""
    with mock.patch("rb_sim.bags.fit.fit.raw_jacobian", side_effect=NotSmoothError("none")):
        return refit(*arguments)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    return list(value) if isinstance(value, (list, tuple)) else value


@pytest.mark.parametrize("name", [n for n in SCENES if n not in ("attitude", "shares")])
def test_truth_within_its_errors(name):
    """Four standard errors of each number; noise as it was put in."""
    reported = refit(name, 5, None)
    off = np.abs(reported["found"] - reported["truth"]) / reported["errors"]
    assert (off < 4.0).all(), dict(zip(reported["names"], off, strict=True))
    assert (reported["errors"] > 0).all() and np.isfinite(reported["errors"]).all()
    assert reported["noise"]["position"] == pytest.approx(NOISE[0], rel=0.4)
    assert reported["noise"]["angle"] == pytest.approx(NOISE[1], rel=0.4)


def test_an_orientation_at_the_start():
    reported = refit("attitude", 2, NOISE)
    off = np.abs(reported["found"] - reported["truth"]) / reported["errors"]
    assert (off < 4.0).all(), off
    assert (reported["errors"] < NOISE[1]).all()


@pytest.mark.parametrize("exact", [True, False])
def test_what_the_motion_does_not_tell_is_named_and_stays(exact):
    """The inertia of a body that nothing turns has no size, only shares."""
    reported = (refit if exact else refit_by_differences)("shares", 3, NOISE)
    name = "bodies.nut.inertia"
    assert reported["undetermined"] == [f"{name}[0] and {name}[1] and {name}[2]"]
    assert np.isinf(reported["errors"]).all()
    size = reported["found"] / reported["truth"]
    assert size == pytest.approx(size.mean(), rel=0.03) and 0.8 < size.mean() < 1.2


def test_errors_are_as_wide_as_they_say():
    """Over five recordings of the drag scene the fitted values scatter as the errors say."""
    reported = [refit("drag", seed, NOISE) for seed in range(5)]
    off = np.array([(t["found"] - t["truth"])[0] / t["errors"][0] for t in reported])
    assert 0.3 < np.sqrt(np.mean(off**2)) < 2.0


@pytest.mark.parametrize(
    ("key", "line"),
    [
        ("effects.wind.coefficient", "--free effects.wind.coefficient: there is no 'wind'"),
        ("effects.air.type", "must be a number or a vector"),
        ("bodies.ball", "must be a number or a vector"),
    ],
)
def test_a_key_that_will_not_do(key, line):
    with pytest.raises(RbSimError, match=line):
        free_numbers(SCENES["drag"][0], [key])


def two_bodies(truth: dict[str, Any]):
    """A recording of two bodies, each at its own instants, with noise in the positions only."""
    from rb_sim import Simulation, load_scene
    from rb_sim.bags.tracks import Track, tracks_of_blocks

    scene = load_scene(truth)
    simulation = Simulation(scene)
    tracks = tracks_of_blocks(
        [simulation.run(checks=False).block], scene, simulation.layout, "truth"
    )
    rng = np.random.default_rng(4)
    for name, which in (("a", slice(0, None, 2)), ("b", slice(5, None, 3))):
        whole = tracks.bodies[name]
        position = whole.position[which]
        noisy = position + rng.normal(0, NOISE[0], position.shape)
        tracks.bodies[name] = Track(100.0 + whole.t[which], noisy, whole.orientation[which])
    return tracks


TWO: dict[str, Any] = {
    "bodies": {"a": BOX | {"linear_velocity": [1.0, 0.0, 3.0]},
               "b": BOX | {"position": [1.0, 1.0, 0.0], "linear_velocity": [0.0, 2.0, 3.0]}},
    "effects": {"weight": {"type": "gravity"},
                "air": {"type": "linear_drag", "body": "b", "coefficient": 0.3}},
    "simulation": TIMES,
}  # fmt: skip


def refit_two() -> dict[str, Any]:
    from rb_sim import load_scene
    from rb_sim.bags.fit.fit import Recording, fit

    recording = Recording(two_bodies(TWO), {"a": "a", "b": "b"})
    data = TWO | {"effects": {"air": TWO["effects"]["air"] | {"coefficient": 0.1}}}
    data["effects"]["weight"] = TWO["effects"]["weight"]
    keys = ["effects.air.coefficient", "bodies.a.mass"]
    found = fit(recording, load_scene(data), data, keys)
    seen = 3 * sum(len(track.t) for track in recording.tracks.bodies.values())
    residuals = np.concatenate([r[1].ravel() for r in found.residuals.values()])
    return {"found": found, "seen": seen, "residuals": residuals}


def test_an_angle_in_degrees_starts_from_its_radians():
    turn = {"orientation": {"axis": [0, 1, 0], "angle": "20 deg"}}
    (number,) = free_numbers({"bodies": {"rod": turn}}, ["bodies.rod.orientation.angle"])
    assert number.start == pytest.approx(np.pi / 9.0, rel=1e-15)


def test_bodies_at_instants_of_their_own():
    """Neither body is laid beside the instants of the other; attitudes without noise do not make
    the positions' smaller; a mass that has no effect stays where it was."""
    reported = refit_two()
    found = reported["found"]
    assert abs(found.values[0] - 0.3) < 4.0 * found.errors[0]
    assert found.noise["position"] == pytest.approx(NOISE[0], rel=0.2)
    assert found.values[1] == BOX["mass"] and np.isinf(found.errors[1])
    assert found.undetermined == ["bodies.a.mass"]
    assert found.errors[0] == pytest.approx(expected_error(), rel=0.2)


def expected_error() -> float:
    """Of the coefficient: x(t) = x_0 + v m/c (1 - exp(-c t/m)), with the noise of the positions."""
    m, c, h = BOX["mass"], 0.3, 1e-6
    t = np.arange(41)[5::3] / 40.0

    def place(c: float) -> np.ndarray:
        k = m / c
        fall = 9.81 * k
        run = k * (1.0 - np.exp(-t / k))
        return np.concatenate([2.0 * run, (3.0 + fall) * run - fall * t])

    slope = (place(c + h) - place(c - h)) / (2.0 * h)
    return NOISE[0] / float(np.linalg.norm(slope))


def test_free_given_twice_means_both(tmp_path):
    """The last one alone was fitted, without a word."""
    options = ("--duration", "0.2", "--no-plots", "--no-rerun", "--quiet", "--out", tmp_path)
    assert invoke("run", "pendulum", *options).exit_code == 0
    free = ("--free", "bodies.nobody.mass", "--free", "bodies.nobody.inertia")
    assert "bodies.nobody.mass: there is no" in invoke("fit", tmp_path / "bag", *free).output


# The Jacobian of a fit is the derivative of its residuals, and does not take runs beside.


KEYS = {
    "drag": ["effects.air.coefficient", "bodies.ball.mass", "bodies.ball.linear_velocity"],
    "spring": ["effects.hook.stiffness", "effects.hook.damping", "effects.hook.point_A"],
    "throw": ["bodies.ball.angular_velocity", "effects.weight.acceleration"],
    "top": ["bodies.top.mass", "bodies.top.center_of_mass", "bodies.top.angular_velocity"],
    "attitude": ["bodies.nut.orientation"],
}


def both(name: str, method: dict[str, Any]) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """The Jacobian as a fit takes it, the one of differences of order six, runs, smooth."""
    from rb_sim import Simulation, load_scene
    from rb_sim.bags.fit.fit import Recording, _Problem
    from rb_sim.bags.fit.unknowns import free_numbers
    from rb_sim.bags.tracks import tracks_of_blocks

    data = _plain(SCENES[name][0] | {"simulation": TIMES | method})
    if name == "top":
        data["effects"]["weight"] |= {"acceleration": [0.0, 0.0, -9.81]}
    if name == "throw":
        data["effects"]["weight"] |= {"acceleration": [0.3, 0.0, -9.81]}
    scene = load_scene(data)
    simulation = Simulation(scene)
    tracks = tracks_of_blocks(
        [simulation.run(checks=False).block], scene, simulation.layout, "truth"
    )
    (body,) = tracks.bodies
    problem = _Problem(Recording(tracks, {body: body}), scene, data, free_numbers(data, KEYS[name]))
    return beside(problem)


def beside(problem: Any) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """What `both` gives, of a problem."""
    x = np.array([number.start / number.scale for number in problem.free])
    x = x + 0.01 * np.linspace(-1.0, 1.0, len(x))
    before = problem.runs
    exact = problem.jacobian(x)
    runs, h, columns = problem.runs - before, 2e-3, []
    for k in range(len(x)):
        e = np.eye(len(x))[k] * h
        sides = [problem.weighted(x + j * e) - problem.weighted(x - j * e) for j in (1, 2, 3)]
        columns.append((45 * sides[0] - 9 * sides[1] + sides[2]) / (60 * h))
    return exact, np.stack(columns, axis=1), runs, problem.smooth


@pytest.mark.parametrize("name", KEYS)
def test_the_jacobian_is_that_of_high_order_differences(name: str) -> None:
    """Fixed steps: the derivative of the very numbers that a run gives."""
    exact, differences, runs, smooth = both(name, {})
    assert smooth and runs == 1
    scale = np.abs(differences).max()
    np.testing.assert_allclose(exact, differences, rtol=0.0, atol=3e-8 * scale)
    assert (np.abs(exact).max(axis=0) > 1e-3 * scale).all()  # no column is trivial


def of_node(folder: Path, set_at: int = 0) -> tuple[np.ndarray, np.ndarray, int, bool]:
    """Of a bag of the node with commands in both frames and a reset; set_at: a state is set
    before that sample, too."""
    from rb_sim.bags.fit.fit import _Problem
    from rb_sim.bags.fit.unknowns import free_numbers
    from rb_sim.cli.verbs.fit import FitOptions, set_up
    from rb_sim.mechanics.samples import Input
    from tests.bags.scenes import record_node

    keys = ["bodies.box.mass", "bodies.box.angular_velocity"]
    scene, data, recording = set_up(FitOptions(record_node(folder), keys))
    if set_at:
        assert recording.inputs is not None
        state = (0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.5, 0.0)
        given = Input(0, set_at / 50.0, "box", state=state, together=1, project=False)
        recording.inputs[set_at] = [given]
    return beside(_Problem(recording, scene, data, free_numbers(data, keys)))


def test_a_reset_begins_with_the_derivatives_of_the_start(tmp_path: Path) -> None:
    """What comes after it depends on the numbers as what came before; it ended in a traceback."""
    exact, differences, runs, smooth = of_node(tmp_path / "bag")
    assert smooth and runs == 1
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(exact - differences).max(axis=0) < 3e-8 * scale).all()
    after = exact.reshape(61, 6, -1)[42:]
    assert (np.abs(after).max(axis=(0, 1))[1:] > 0.1 * scale[1:]).all()  # the mass: no command


def test_a_state_that_was_set_takes_differences(tmp_path: Path) -> None:
    """No derivative is carried across it."""
    found, differences, _, smooth = of_node(tmp_path / "bag", 20)
    assert not smooth
    scale = np.abs(differences).max(axis=0)
    assert (np.abs(found - differences).max(axis=0) < 1e-5 * scale).all()


# Which residuals are outliers, and which are noise, rounding or another motion.


T = np.arange(400) / 100.0


def residuals(seed: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(seed)
    return {"ball": (T, rng.normal(0, 1e-3, (400, 3)), rng.normal(0, 2e-3, (400, 3)))}


@pytest.mark.parametrize("seed", range(20))
def test_noise_has_none(seed) -> None:
    assert outliers(residuals(seed), 0.0) == ()


@pytest.mark.parametrize("part", [1, 2])
def test_they_are_counted_with_their_times(part) -> None:
    found = residuals(0)
    found["ball"][part][[7, 100, 250, 333], 1] = 0.5
    (line,) = outliers(found, 0.0)
    assert line.startswith("ball: 4 of 400 poses") and "(t = 0.07, 1, 2.5, ... s)" in line
    assert outliers(found, 1.0) == ()  # on the scale of this motion they are rounding


def test_many_are_another_motion() -> None:
    found = residuals(0)
    found["ball"][1][:60, 0] += 0.5
    assert outliers(found, 0.0) == ()


# Fits that would end in a wrong minimum find the truth; what is left and no noise is told.


T_WHITENESS = np.linspace(0.0, 2.0, 81)


def fitted(position: np.ndarray, turn: np.ndarray, effects: dict, keys: list[str]) -> Any:
    """Fit a body that starts with 20 rad/s about z to these positions and turns about z [rad]."""
    from rb_sim import load_scene
    from rb_sim.bags.fit.fit import Recording, fit
    from rb_sim.bags.tracks import Track, Tracks

    rng = np.random.default_rng(3)
    exact = Rotation.from_rotvec(np.c_[0.0 * turn, 0.0 * turn, turn])
    seen = Rotation.from_rotvec(rng.normal(0, NOISE[1], (len(T_WHITENESS), 3))) * exact
    p = position + rng.normal(0, NOISE[0], position.shape)
    track = Track(T_WHITENESS, p, seen.as_quat())
    body = {"mass": 2.0, "inertia": [0.1, 0.2, 0.3], "angular_velocity": [0.0, 0.0, 20.0]}
    steps = {"duration": 2.0, "rate": 40, "method": "rk4", "step": 0.0125}
    data = {"bodies": {"rotor": body}, "effects": effects, "simulation": steps}
    recording = Recording(Tracks("seen", {"rotor": track}), {"rotor": "rotor"})
    return fit(recording, load_scene(data), data, keys)


def test_a_turn_is_not_missed_by_a_whole_one():
    """It turns at 31 rad/s: what the start misses goes round three and a half times in 2 s."""
    reported = fitted(
        np.zeros((len(T_WHITENESS), 3)), 31.0 * T_WHITENESS, {}, ["bodies.rotor.angular_velocity"]
    )
    assert reported.values[2] == pytest.approx(31.0, abs=4.0 * reported.errors[2])
    assert reported.errors[2] < 1e-3 and reported.correlation_left == 0.0


def test_another_law_is_reported():
    """It is pulled by a spring, and the scene knows only a steady force: no force follows that."""
    steady = {"pull": {"type": "wrench", "body": "rotor", "force": [0.5, 0.0, 0.0]}}
    position = np.c_[0.1 * (1.0 - np.cos(5.0 * T_WHITENESS)), 0.0 * T_WHITENESS, 0.0 * T_WHITENESS]
    reported = fitted(position, 20.0 * T_WHITENESS, steady, ["effects.pull.force"])
    assert reported.correlation_left > 0.8
    assert reported.as_dict()["correlation_left"] == reported.correlation_left


def test_a_single_number_without_effect_is_named_and_stays():
    """The mass of a free body, which is the largest effect of all there are."""
    reported = fitted(
        np.zeros((len(T_WHITENESS), 3)), 20.0 * T_WHITENESS, {}, ["bodies.rotor.mass"]
    )
    assert reported.undetermined == ["bodies.rotor.mass"]
    assert reported.values[0] == 2.0 and np.isinf(reported.errors[0])


def test_a_pose_that_is_far_off_is_reported():
    position = np.zeros((len(T_WHITENESS), 3))
    reported = fitted(position, 20.0 * T_WHITENESS, {}, ["bodies.rotor.angular_velocity"])
    assert reported.outliers == ()
    position[30, 1] = 0.2
    reported = fitted(position, 20.0 * T_WHITENESS, {}, ["bodies.rotor.angular_velocity"])
    assert reported.outliers == (
        "rotor: 1 of 81 poses are off by more than 10 times the noise of the others (t = 0.75 s): "
        "they distort the fit and enlarge its errors",
    )
    assert reported.as_dict()["outliers"] == list(reported.outliers)


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
    assert done.exit_code == 0 and "residuals are correlated" not in done.output
    assert "noise" not in done.output


def test_the_command_names_a_number_on_which_the_poses_do_not_depend(tmp_path):
    scene = tmp_path / "swing.yaml"
    scene.write_text(
        "bodies: {bob: {mass: 1.0, center_of_mass: [0.5, 0, 0],"
        " shape: {type: rod, length: 1, axis_B: [1, 0, 0], center_B: [0.5, 0, 0]}}}\n"
        "constraints: {hinge: {type: fixed_axis, body: bob, axis_B: [0, 1, 0]}}\n"
        "effects: {weight: {type: gravity}}\n"
    )
    made = ["run", str(scene), "--duration", "0.5", "--out", str(tmp_path / "out"), "--no-rerun",
            "--set", "bodies.bob.mass=1.1", "--no-plots", "--quiet"]  # fmt: skip
    assert CliRunner().invoke(app, made).exit_code == 0
    asked = ["fit", str(tmp_path / "out"), "--scene", str(scene), "--free", "bodies.bob.mass"]
    done = CliRunner().invoke(app, asked)
    assert "not determined by the recorded poses: bodies.bob.mass\n" in done.output
