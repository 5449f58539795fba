# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The peer benchmarks measure what they say: scenes, references, errors, verdicts."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
import pytest

from benchmarks.hard_cases import compare
from benchmarks.hard_cases.compare import PeerRow, judged_checks, said, table_of
from benchmarks.hard_cases.described import CannotExpressError, described
from benchmarks.peers import __main__ as command
from benchmarks.peers import check, engine_scipy, measure, report, scenes
from benchmarks.peers.engine import steps
from benchmarks.peers.reference import Reference, pose_error
from rb_sim import Simulation, load_scene
from rb_sim.base.errors import RbSimError
from rb_sim.cli.verbs.hard_cases import shipped
from rb_sim.sweeps.hard_cases import Row, load_cases


@pytest.mark.parametrize("name", scenes.NAMES)
def test_scene_numbers_are_those_that_rb_sim_reads(name: str) -> None:
    scene = scenes.load(name)
    ((_, body),) = load_scene(scene.path).bodies.items()
    assert body.mass == scene.mass
    np.testing.assert_allclose(body.inertia, np.diag(scene.inertia), rtol=1e-15, atol=0)
    np.testing.assert_array_equal(body.center_of_mass, scene.center)
    np.testing.assert_array_equal(body.position, scene.origin)
    np.testing.assert_allclose(body.orientation, scene.quaternion, rtol=0, atol=1e-16)
    np.testing.assert_array_equal(body.linear_velocity, scene.velocity)
    np.testing.assert_array_equal(body.angular_velocity, scene.spin)


@pytest.mark.parametrize("name", scenes.NAMES)
def test_steps_of_a_ladder_divide_the_sample_interval(name: str) -> None:
    scene = scenes.load(name)
    for step in steps(scene):
        assert scene.interval / step == pytest.approx(round(scene.interval / step), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "form"),
    [
        ("free_tumble", "quaternion"),
        ("heavy_top", "quaternion"),
        ("pendulum", "angle"),
        ("rolling_sphere", "quaternion"),
        ("rolling_disk", "quaternion"),
        ("rolling_disk", "angles"),
    ],
)
def test_minimal_equations_follow_the_reference(name: str, form: str) -> None:
    scene = scenes.load(name)._replace(duration=0.2)
    run = engine_scipy.build(scene, f"DOP853/{form}", 1e-12)
    samples = run.samples(scene.times)
    true = Reference(scene).pose(samples.t)
    # 30 rad of spin in the top at a local tolerance of 1e-12
    assert pose_error(samples.position, samples.quaternion, *true).max() < 1e-9
    run.start()
    run.advance(scene.duration)
    position, quaternion = run.pose()
    end = Reference(scene).pose(np.array([scene.duration]))
    assert pose_error(position[None], quaternion[None], *end)[0] < 1e-9


def test_a_ladder_ends_after_round_off_and_reports_its_points() -> None:
    scene = scenes.load("rolling_sphere")._replace(duration=0.5)
    reported: list[tuple[str, object]] = []
    measure.measure(
        scene,
        Reference(scene),
        engine_scipy,
        1.5,
        lambda kind, value: reported.append((kind, value)),
    )
    points = [value for kind, value in reported if kind == "point"]
    assert min(point.error for point in points) < 1e-9
    assert all(point.cost > 0 and point.runs >= 2 for point in points)


def test_the_cheapest_point_is_the_cheapest_that_is_good_enough() -> None:
    points = [
        {"method": "a", "knob": 1.0, "error": 1e-3, "cost": 1.0},
        {"method": "b", "knob": 1.0, "error": 1e-5, "cost": 3.0},
        {"method": "c", "knob": 1.0, "error": 1e-6, "cost": 2.0},
        {"method": "d", "knob": 1.0, "error": None, "cost": 0.1},
    ]
    assert report.cheapest(points, 1e-3)["method"] == "a"
    assert report.cheapest(points, 1e-5)["method"] == "c"
    assert report.cheapest(points, 1e-7) is None
    assert [point["method"] for point in report.front(points)] == ["a", "c"]


def test_a_program_that_is_not_installed_is_skipped_by_name(
    capsys: pytest.CaptureFixture[str],
) -> None:
    found, skipped = command._load(["scipy", "no_such_program"])
    assert list(found) == ["scipy"]
    assert skipped == ["no_such_program"]
    assert "skipped no_such_program" in capsys.readouterr().err


def point(method: str, knob: float, error: float, cost: float) -> dict:
    return {"method": method, "knob": knob, "error": error, "cost": cost}


RESULTS = {
    "machine": {"versions": {}},
    "machine_line": "a machine",
    "skipped": [],
    "kinds": {"rb_sim": "rb_sim", "mujoco": "engine", "scipy": "equations"},
    "scenes": {
        "rod": {
            "engines": {
                "rb_sim": {
                    "notes": [],
                    "points": [point("rk4", 0.1, 0.09, 6e-6), point("auto", 1e-2, 1e-12, 7e-6)],
                },
                "mujoco": {"notes": [], "points": [point("RK4", 0.1, 0.05, 7.3e-3)]},
                "scipy": {"notes": [], "points": [point("DOP853", 1e-2, 5e-3, 2e-4)]},
            }
        }
    },
}


def test_a_page_shows_costs_and_ways_in_tables_that_fit_on_it() -> None:
    lines = report.markdown(RESULTS).splitlines()
    assert lines[:3] == ["---", "search: {exclude: true}", "---"]  # as docs/peers.md begins
    assert "| 1e-01 | 7.3e-03 | 2.0e-04 | 6.0e-06 |" in lines
    assert "| 1e-01 | mujoco RK4 1e-01 | rk4 1e-01 | 1.2e+03 | - |" in lines
    assert "| 1e-02 | none | auto 1e-02 | - | - |" in lines


# The reference motions of the peer benchmark agree with independent derivations.


SHORT = {"free_tumble": 2.0, "gazebo_boxes": 2.0, "pendulum": 3.0, "rolling_sphere": 2.0}
"""Horizon of the comparison with the closed form [s]: within it doubles keep 13 digits."""


def short(name: str, duration: float) -> scenes.Scene:
    return scenes.load(name)._replace(duration=duration)


@pytest.mark.parametrize("name", sorted(check.CLOSED_FORMS))
def test_reference_agrees_with_the_closed_form(name: str) -> None:
    scene = short(name, SHORT[name])
    closed = check.CLOSED_FORMS[name](scene, scene.times)
    true = Reference(scene).pose(scene.times)
    assert pose_error(*closed, *true).max() < 2e-13


@pytest.mark.parametrize("name", ["heavy_top", "rolling_disk"])
def test_reference_agrees_with_newton_euler_where_no_closed_form_exists(name: str) -> None:
    scene = short(name, 0.1 if name == "heavy_top" else 0.5)
    other = check.constrained(scene, scene.times)
    true = Reference(scene).pose(scene.times)
    # 1e-13 per unit of state over 15 rad of spin (top) and a metre of path (disk)
    assert pose_error(*other, *true).max() < 1e-11


def test_pose_error_takes_the_sign_of_a_quaternion_and_counts_nan_as_infinite() -> None:
    half = 0.5 * 1e-9
    identity = np.array([[0.0, 0.0, 0.0, 1.0]])
    turned = -np.array([[np.sin(half), 0.0, 0.0, np.cos(half)]])
    zero = np.zeros((1, 3))
    assert pose_error(zero, turned, zero, identity)[0] == pytest.approx(1e-9, rel=1e-12)
    assert pose_error(zero + 3.0, turned, zero, identity)[0] == pytest.approx(np.sqrt(27.0))
    assert pose_error(zero + np.nan, turned, zero, identity)[0] == np.inf


# Cases on other engines: the same motion in each, honest verdicts, a line where one lacks.


ROD = {"mass": 1.0, "inertia": [0.02, 0.1, 0.09], "center_of_mass": [0.0, 0.1, -0.5]}
HINGE = {"type": "fixed_axis", "body": "a", "axis_B": [0.0, 1.0, 0.0]}
LINK = {"type": "fixed_axis", "body": "b", "parent": "a", "axis_B": [0.0, 1.0, 0.0]}
SCENES: dict[str, Any] = {
    "thrown": {
        "bodies": {
            "a": ROD
            | {
                "orientation": {"axis": [1.0, 2.0, 3.0], "angle": 0.7},
                "angular_velocity": [1.0, -2.0, 0.5],
                "linear_velocity": [0.3, 0.0, 2.0],
            }
        },
        "effects": {"weight": {"type": "gravity"}},
    },
    "two rods": {
        "bodies": {
            "a": ROD | {"angular_velocity": [0.0, 1.0, 0.0]},
            "b": ROD | {"position": [0.0, 0.0, -1.0], "linear_velocity": [-1.0, 0.0, 0.0],
                        "angular_velocity": [0.0, 1.0, 0.0]},
        },
        "constraints": {"hinge": HINGE, "link": LINK},
        "effects": {"weight": {"type": "gravity"}},
    },
}  # fmt: skip


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("engine", compare.ENGINES)
def test_an_engine_is_reported_the_same_scene(engine: str, name: str) -> None:
    """Pose and twist of every body agree with rb_sim to the engine's order."""
    pytest.importorskip("pydrake" if engine == "drake" else engine)
    module = compare.loaded(engine)
    scene = load_scene(SCENES[name] | {"simulation": {"duration": 0.5, "rate": 10.0}})
    method = "TrapezoidalIndex2" if engine == "exudyn" else module.METHODS[0]
    rows = module.run(described(scene), method, 1e-3, 6, 100)
    block = Simulation(scene, announce=None).run(checks=False).block
    columns = (block.position, block.orientation, block.linear_velocity, block.angular_velocity)
    ours = np.concatenate(columns, axis=2)
    sign = np.sign((rows[:, :, 3:7] * ours[:, :, 3:7]).sum(axis=2, keepdims=True))
    rows[:, :, 3:7] *= sign
    np.testing.assert_allclose(rows, ours, atol=1e-4)


def test_what_an_engine_has_no_word_for_is_named() -> None:
    scene = load_scene(shipped_case("bennett_linkage"))
    with pytest.raises(CannotExpressError, match="constraint j3"):
        described(scene)


def shipped_case(name: str) -> Any:
    (case,) = load_cases(shipped(), [name])
    return case.scene


def test_figures_of_reactions_are_left_out() -> None:
    (case,) = load_cases(shipped(), ["rotor_1e4"])
    layout = Simulation(load_scene(case.scene), announce=None).layout
    assert [check.formula for check in judged_checks(case, layout)] == ["rotor_wz/1e4 - 1"]


def test_an_engine_that_is_better_is_said_to_be() -> None:
    assert said(1e-9, 1e-8, 1e-7) == "holds, better than rb_sim"
    assert said(1e-7, 1e-8, 1e-7) == "fails by 10, equal to rb_sim"
    assert said(1e-5, 1e-8, 1e-7) == "fails by 1e+03"
    row = PeerRow("c", "drake", "energy", "m", 1e-3, 1e-9, 1e-8, 1e-7, 0.1, "holds")
    assert "| c | drake | energy | m | 0.001 | 1e-09 | 1e-08 | 1e-07 | 0.1 | holds |" in table_of(
        [row]
    )


def test_an_engine_that_is_not_installed_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> Any:
        raise ImportError("No module named 'mujoco'")

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(
        RbSimError, match=r"mujoco cannot be imported .* pip install 'rb_sim\[peers\]'"
    ):
        compare.loaded("mujoco")


def test_a_check_is_compared_with_its_own_rows() -> None:
    """Two formulas of one bound, two settings: the rows come check by check."""
    (case,) = load_cases(shipped(), ["nanometre_beside_metre"])
    ours = [
        Row("c", "m", "h", "formula", figure, 1e-8, 0.1, "holds", "") for figure in (3, 1, 2, 4)
    ]
    assert [compare.least_of(case, check, ours) for check in case.checks] == [2, 1]
