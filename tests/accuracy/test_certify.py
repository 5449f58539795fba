# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A certificate is never below the true error, and at most a hundred times above it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.accuracy.certify import Certificate, certify, growth_of, rounded_at_impacts
from rb_sim.base.errors import SimulationError
from rb_sim.numerics.rotations import angle_between
from tests.accuracy import double_pendulum
from tests.oracles.compare import reaction_of
from tests.oracles.to_scene import scene_of

FILE = Path(__file__).resolve().parents[1] / "oracles" / "cases_public.json"
CASES = {case["id"]: case for case in json.loads(FILE.read_text())["cases"]}
"""Closed forms, and motions in quadruple precision."""

SETTINGS: dict[str, dict[str, Any]] = {
    "free_separatrix": {"tolerance": 1e-10},
    "inertia_ratio_1e6": {"tolerance": 1e-8},
    "heavytop_bruls_cardona": {"tolerance": 1e-10},
    "lagrange_cuspidal": {"method": "rk4", "step": 0.001},
    "thin_rod_pendulum": {"tolerance": 1e-9},
    "pendulum_3rad": {"tolerance": 1e-13},
    "gate_inclined_axis": {"tolerance": 1e-6},
    "trans_cycloid": {"tolerance": 1e-8},
    "disk_wobble": {"method": "gauss6", "step": 0.02},
    "rattleback_kl_minus": {"tolerance": 1e-8},
    "ball_eccentric": {"tolerance": 1e-10},
    "cylinder_unbalanced": {"method": "rk4", "step": 0.003},
    "chaplygin_sleigh": {"tolerance": 1e-8},
}

SPLINES = ("trans_cycloid",)
"""Cases whose reactions are not compared: the scene's guide is a spline through points of the
reference's, and its curvature, with it the reaction, is not quite that of the reference."""

FLOOR = 1e-15
"""Share of the largest value below which an error is its last bits."""


def certified(
    mapping: dict[str, Any], times: np.ndarray, **options: Any
) -> tuple[Certificate, Any]:
    """The certificate at the times, and the run at the same."""
    span = {"duration": float(times[-1]), "rate": 50.0}
    scene = load_scene(mapping | {"simulation": span | options})
    simulation = Simulation(scene)
    found = certify(simulation.compiled, simulation.setting, scene.simulation, times)
    return found, simulation.run(at=times, checks=False)


def judge(certificate: Certificate, true: list[np.ndarray], largest: list[float]) -> None:
    """true: errors at the instants of position, rotation, velocity, spin, force and torque."""
    for bound, errors, size in zip(certificate.errors, true, largest, strict=False):
        error = float(errors.max())
        assert bound >= error or error <= FLOOR * size
        assert bound <= 100.0 * max(error, FLOOR * max(size, 1.0))


@pytest.mark.parametrize("name", SETTINGS)
def test_the_true_error_is_bracketed(name: str) -> None:
    case = CASES[name]
    samples = {key: np.array(values) for key, values in case["samples"].items()}
    found, run = certified(scene_of(case), samples["t"], **SETTINGS[name])
    assert found.known_until == samples["t"][-1]
    own = run.block
    true = [
        np.linalg.norm(own.position[:, 0] - samples["position"], axis=1),
        angle_between(own.orientation[:, 0], samples["quaternion_xyzw"]),
        np.linalg.norm(own.linear_velocity[:, 0] - samples["velocity_world"], axis=1),
        np.linalg.norm(own.angular_velocity[:, 0] - samples["omega_body"], axis=1),
    ]
    columns = ("position", "quaternion_xyzw", "velocity_world", "omega_body")
    largest = [float(np.abs(samples[key]).max()) for key in columns]
    if name not in SPLINES:
        forces, torques, sizes = reactions(case, run, samples)
        true, largest = [*true, *forces, *torques], [*largest, *sizes]
    judge(found, true, largest)


def reactions(case: Any, run: Any, samples: Any) -> tuple[list[Any], list[Any], list[float]]:
    """Errors of the reaction's force and torque at the instants, and the size of what each rounds
    off at: the largest force, and that times the largest arm of its anchor."""
    found = reaction_of(case, run)
    errors = [
        [np.linalg.norm(found[key] - samples[key], axis=1)] if key in found else []
        for key in ("reaction_force", "reaction_torque")
    ]
    force = float(np.abs(samples["reaction_force"]).max())
    length = float(np.abs(samples["position"]).max())
    return errors[0], errors[1], [force, force * length]


def pendulum() -> dict[str, Any]:
    """The scene of `double_pendulum`: rods along x, which turn about y."""
    inertia = [0.001, double_pendulum.ABOUT_CENTRE, double_pendulum.ABOUT_CENTRE]
    rod = {"mass": 1.0, "inertia": inertia}
    hinge = {
        "type": "fixed_axis",
        "point_B": [-0.5, 0, 0],
        "axis_B": [0, 1, 0],
        "axis_A": [0, 1, 0],
    }
    return {
        "bodies": {
            "upper": rod | {"position": [0.5, 0, 0]},
            "lower": rod | {"position": [1.5, 0, 0]},
        },
        "constraints": {
            "wall": hinge | {"body": "upper"},
            "joint": hinge | {"body": "lower", "parent": "upper", "point_A": [0.5, 0, 0]},
        },
        "effects": {
            "weight": {"type": "gravity", "acceleration": [0, 0, -double_pendulum.GRAVITY]}
        },
    }


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return double_pendulum.solution(16)


@pytest.mark.parametrize(
    "options", [{"tolerance": 1e-11}, {"method": "rk4", "step": 0.01}], ids=str
)
def test_a_chaotic_run_is_certified_up_to_where_it_means_anything(
    truth: np.ndarray, options: dict[str, Any]
) -> None:
    times = np.arange(len(truth)) / double_pendulum.STEPS_PER_SECOND
    found, run = certified(pendulum(), times, **options)
    a, b = truth[:, 0], truth[:, 1]
    places = np.stack(
        [
            0.5 * np.stack([np.cos(a), 0 * a, -np.sin(a)], axis=1),
            np.stack(
                [np.cos(a) + 0.5 * np.cos(b), 0 * a, -np.sin(a) - 0.5 * np.sin(b)],
                axis=1,
            ),
        ],
        axis=1,
    )
    attitudes = np.stack(
        [np.stack([0 * x, np.sin(x / 2), 0 * x, np.cos(x / 2)], axis=1) for x in (a, b)], axis=1
    )
    block = run.block
    position = np.linalg.norm(block.position - places, axis=2).max(axis=1)
    rotation = angle_between(block.orientation, attitudes).max(axis=1)
    known = times <= found.known_until
    judge(found, [position[known], rotation[known]], [1.5, 1.0])
    follows = times <= found.follows_until
    assert rotation[follows].max() <= 0.1  # what it says it follows, it does
    if found.follows_until < times[-1]:
        assert rotation[times <= found.follows_until + 2.0].max() > 0.02
    assert 0.7 < found.lyapunov_time < 1.5


def test_growth_as_a_power_of_time_is_no_chaos() -> None:
    t = np.linspace(0.0, 100.0, 500)
    assert growth_of(t, 1e-16 * (1.0 + t) ** 3).lyapunov_time == math.inf
    assert growth_of(t, 1e-16 * np.exp(0.25 * t)).lyapunov_time == pytest.approx(4.0, rel=1e-6)


def test_a_run_that_ends_early_is_certified_up_to_there() -> None:
    """A bead leaves its guide, a parabola in space without weight, after a second or so."""
    points = [[x, 0.0, x * x] for x in np.linspace(-1.0, 1.0, 41).tolist()]
    joint = {"type": "translation", "body": "bead", "guide": {"type": "curve", "points": points}}
    bead = {"mass": 1.0, "inertia": [0.1] * 3, "linear_velocity": [0.5, 0.0, 0.0]}
    options = {"duration": 4.0, "rate": 50.0}
    scene = load_scene(
        {"bodies": {"bead": bead}, "constraints": {"guide": joint}, "simulation": options}
    )
    simulation = Simulation(scene)
    found = certify(simulation.compiled, simulation.setting, scene.simulation)
    with pytest.raises(SimulationError, match="passed the end of its guide"):
        simulation.run()
    assert 0.9 * simulation.time < found.known_until <= simulation.time + 0.02
    assert 0.0 < found.errors[0] < 1e-8


@pytest.mark.parametrize("options", [{"tolerance": 1e-6}, {"method": "rk4", "step": 0.1}])
def test_a_motion_without_a_series_is_certified_by_others(options: dict[str, Any]) -> None:
    """A fall from rest through quadratic drag, z = -v^2/g ln cosh(g t / v); the sharpest method
    sums the series of the motion, and there is none where the speed vanishes."""
    ball = {"mass": 1.0, "inertia": [0.1, 0.1, 0.1]}
    drag = {"type": "quadratic_drag", "body": "ball", "coefficient": 0.3}
    scene = {"bodies": {"ball": ball}, "effects": {"weight": {"type": "gravity"}, "drag": drag}}
    times = np.linspace(0.0, 5.0, 51)
    certificate, run = certified(scene, times, **options)
    v = math.sqrt(9.81 / 0.3)
    true = -v * v / 9.81 * np.log(np.cosh(9.81 * times / v))
    error = float(np.abs(run.position["ball"][:, 2] - true).max())
    assert certificate.known_until == 5.0
    assert error <= certificate.errors[0] <= 100.0 * error


Long = np.longdouble


def superball(times: np.ndarray) -> np.ndarray:
    """(x, z, vx, vz) of a spinning ball of radius 0.1 that bounces with friction, in long doubles:
    parabolas, and at each impact the normal impulse by Newton's restitution and the tangential one
    that sticks, or Coulomb's."""
    radius, g, e, mu = Long(0.1), Long(9.81), Long(0.995), Long(0.5)
    x, z, vx, vz, w, since = (Long(value) for value in (0.0, 1.0, 1.5, 0.5, 200.0, 0.0))
    rows = []
    for t in times.astype(Long):
        while since + (hit := (vz + np.sqrt(vz**2 + 2 * g * (z - radius))) / g) <= t:
            since, x, z, vz = since + hit, x + vx * hit, radius, vz - g * hit
            push, slip = -(1 + e) * vz, vx - w * radius
            drag = -np.sign(slip) * min(abs(slip) / Long(3.5), mu * push)
            vz, vx, w = -e * vz, vx + drag, w - drag / (Long(0.4) * radius)
        h = t - since
        rows.append((x + vx * h, z + vz * h - g * h**2 / 2, vx, vz - g * h))
    return np.array(rows)


def test_the_roundings_of_many_impacts_are_certified() -> None:
    """Two methods meet the same impacts and round them alike, which their difference does not show:
    of 53 of them the velocity was wrong by 1.5 times what was certified."""
    ball = {"mass": 1.0, "shape": {"type": "sphere", "radius": 0.1}, "position": [0.0, 0.0, 1.0]}
    ball |= {"linear_velocity": [1.5, 0.0, 0.5], "angular_velocity": [0.0, 200.0, 0.0]}
    rub = {"type": "coulomb", "static": 0.5, "kinetic": 0.5}
    floor = {"type": "contact", "body": "ball", "friction": rub, "restitution": 0.995}
    scene = {"bodies": {"ball": ball}, "constraints": {"floor": floor}}
    times = np.linspace(0.0, 40.0, 357)
    found, run = certified(scene | {"effects": {"weight": {"type": "gravity"}}}, times)
    true = superball(times)
    assert sum(event.kind == "impact" for event in run.events) == 53
    for bound, own, columns in (
        (found.errors[0], run.position["ball"], true[:, :2]),
        (found.errors[2], run.linear_velocity["ball"], true[:, 2:]),
    ):
        error = float(np.linalg.norm((own[:, [0, 2]] - columns).astype(float), axis=1).max())
        assert error <= bound <= 100.0 * error


def test_an_impact_is_rounded_as_the_start_is_and_only_for_what_follows() -> None:
    times = np.linspace(0.0, 10.0, 101)
    ulp = np.stack([np.ones(101), times, times**2], axis=1)
    rounded = rounded_at_impacts(times, ulp, np.array([2.0, 5.0]))
    after = [np.maximum(times - t, 0.0) for t in (2.0, 5.0)]
    np.testing.assert_allclose(rounded[:, 0], 1.0 * (times >= 2.0) + 1.0 * (times >= 5.0))
    np.testing.assert_allclose(rounded[:, 1], after[0] + after[1], atol=1e-12)
    np.testing.assert_allclose(rounded[:, 2], after[0] ** 2 + after[1] ** 2, atol=1e-9)
    assert not rounded_at_impacts(times, ulp, np.zeros(0)).any()


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1.0, 1e3])
def test_an_oscillator_of_any_size_is_certified_in_its_own(size: float) -> None:
    """x = L cos 10 t; of a nanometre a rounding of a metre in y and z was certified, 400 times the
    error."""
    bob = {"mass": 1.0, "inertia": [size**2] * 3, "position": [size, 0.0, 0.0]}
    spring = {"type": "spring", "body": "bob", "stiffness": 100.0}
    times = np.linspace(0.0, 1.0, 41)
    found, run = certified({"bodies": {"bob": bob}, "effects": {"spring": spring}}, times)
    true = np.stack([size * np.cos(10.0 * times), 0.0 * times, 0.0 * times], axis=1)
    error = float(np.linalg.norm(run.position["bob"] - true, axis=1).max())
    assert error <= found.errors[0] <= 100.0 * error


@pytest.mark.parametrize(("drag", "tolerance"), [(1e4, 1e-8), (1e8, 1e-6)])
def test_what_dies_out_at_once_is_certified_to_rounding(drag: float, tolerance: float) -> None:
    """v = exp(-c t) of radau5, whose error is gone with the motion; explicit runs err by a million
    times as much in the velocity, and through a drag of 1e8 kg/s do not come to the end, so that
    nothing was certain. Below one unit in the last place of 1 m/s no run tells anything."""
    body = {"mass": 1.0, "inertia": [1.0] * 3, "linear_velocity": [1.0, 0.0, 0.0]}
    oil = {"type": "linear_drag", "body": "b", "coefficient": drag}
    times = np.linspace(0.0, 1.0, 101)
    scene = {"bodies": {"b": body}, "effects": {"oil": oil}}
    found, run = certified(scene, times, method="radau5", tolerance=tolerance)
    assert found.known_until == 1.0
    speed = run.linear_velocity["b"][:, 0] - np.exp(-drag * times)
    place = run.position["b"][:, 0] + np.expm1(-drag * times) / drag
    for bound, errors, size in (
        (found.errors[0], place, 1.0 / drag),
        (found.errors[2], speed, 1.0),
    ):
        error = float(np.abs(errors).max())
        assert error <= bound <= 100.0 * max(error, 1e-14 * size)


def test_where_nothing_is_certain_no_error_is_stated() -> None:
    """The errors up to t = 0 are those of the start, and would be read as those of the run."""
    six = (math.inf,) * 6
    found = Certificate("a", ("b", "c"), six, six, (0.0,) * 6, 1.0, 0.0, 0.0, False, 1.0, 1.0, 3)
    reported = json.loads(json.dumps(found.as_dict(), allow_nan=False))
    assert set(reported["errors"].values()) == set(reported["uncertainty"].values()) == {None}
    assert "not certified" in reported["text"][0]


def test_where_only_one_method_ends_it_is_compared_with_itself() -> None:
    """Four bodies in a drag of 1e9 kg/s: explicit steps are too short, and gauss6 iterates."""
    bodies = {
        f"b{i}": {"mass": 1.0, "inertia": [1.0] * 3, "position": [0.0, float(i), 0.0]}
        | {"linear_velocity": [1.0, 0.0, 0.0]}
        for i in range(4)
    }
    oils = {
        f"oil{i}": {"type": "linear_drag", "body": f"b{i}", "coefficient": 1e9} for i in range(4)
    }
    spring = {"type": "spring", "body": "b0", "parent": "b1", "stiffness": 1.0}
    times = np.linspace(0.0, 1.0, 101)
    scene = {"bodies": bodies, "effects": {"spring": spring, **oils}}
    found, run = certified(scene, times, method="radau5", tolerance=1e-8)
    assert found.known_until == 1.0 and all("radau5" in each for each in found.checked_by)
    speed = run.linear_velocity["b0"][:, 0] - np.exp(-1e9 * times)
    error = float(np.abs(speed).max())
    assert 1e-8 < error <= found.errors[2] <= 100.0 * error


def test_steps_that_agree_on_an_impact_that_none_of_them_tells() -> None:
    """A thin disk lands nearly flat: its low point runs round it in less than a step, and all steps
    down to 10 us lose most of the energy, where Newton's law of the impact keeps two thirds."""
    turn = {"axis": [-0.7383662611574611, 0.606793375230223, -0.2943077711530326], "angle": 0.359}
    disk = {
        "mass": 1.599,
        "shape": {"type": "disk", "radius": 0.099, "axis_B": [0, 0, 1]},
        "position": [-0.141, -0.16, 0.6],
        "orientation": turn,
        "linear_velocity": [-0.292, -0.368, -2.39],
        "angular_velocity": [0.84, -0.917, 0.342],
    }
    floor = {"type": "contact", "body": "disk", "friction": {"type": "smooth"}, "restitution": 0.0}
    weight = {"type": "gravity", "acceleration": [0, 0, -9.81]}
    scene = {"bodies": {"disk": disk}, "constraints": {"floor": floor}, "effects": {"w": weight}}
    times = np.linspace(0.0, 0.6, 121)
    found, run = certified(scene, times, method="time_stepping", step=1e-4)
    span = {"duration": 0.6, "method": "dopri853", "tolerance": 1e-11}
    true = Simulation(load_scene(scene | {"simulation": span})).run(at=times, checks=False)
    assert run.energy[-1] < 0.1 * run.energy[0] and true.energy[-1] > 0.7 * true.energy[0]
    off = np.linalg.norm(run.position["disk"] - true.position["disk"], axis=1)
    assert off.max() > 0.1
    upto = times <= found.known_until
    assert off[upto].max() <= found.errors[0] and found.follows_until < 0.2
