# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The peer benchmark measures what it says: scenes, error, choice of the cheapest, skipping."""

import numpy as np
import pytest

from benchmarks.peers import __main__ as command
from benchmarks.peers import engine_scipy, measure, report, scenes
from benchmarks.peers.engine import steps
from benchmarks.peers.reference import Reference, pose_error
from rb_sim import load_scene


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
    told: list[tuple[str, object]] = []
    measure.measure(
        scene, Reference(scene), engine_scipy, 1.5, lambda kind, value: told.append((kind, value))
    )
    points = [value for kind, value in told if kind == "point"]
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
