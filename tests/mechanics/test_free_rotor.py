# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Free bodies: in principal axes, beside others, and beside the general equations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from rb_sim import Simulation, load_scene
from rb_sim.motion.traced import TracedMotion
from rb_sim.scene.compile import compile_method, compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.interpreted import interpreted
from tests.runs import trajectory

TURN = Rotation.from_rotvec([0.7, -1.1, 0.4])
"""Body axes in the tests of full tensors, from the principal axes."""
NUT = {"mass": 1.0, "inertia": [1.0, 2.0, 3.0], "angular_velocity": [1e-3, 5.0, 1e-3]}
SPINS: dict[str, tuple[list[float], list[float]]] = {
    "generic": ([1.0, 2.0, 2.7], [0.7, -1.1, 0.4]),
    "next to the separatrix": ([1.0, 2.0, 3.0], [1e-3, 5.0, 1e-3]),
    "on the separatrix": ([1.0, 2.0, 3.0], [3.0**0.5, 5.0, 1.0]),
    "about the smallest": ([1.0, 2.0, 2.7], [3.0, 1e-9, 0.0]),
    "about the largest": ([1.0, 2.0, 2.7], [1e-9, 1e-9, 3.0]),
    "exactly about the middle": ([1.0, 2.0, 2.7], [0.0, 3.0, 0.0]),
    "body of revolution": ([1.0, 1.0, 1.7], [0.7, -1.1, 0.4]),
    "revolution about the first": ([1.7, 1.0, 1.0], [0.7, -1.1, 0.4]),
    "sphere": ([1.0, 1.0, 1.0], [0.7, -1.1, 0.4]),
    "nearly a sphere": ([1.0, 1.0 + 2e-16, 1.0 - 1e-16], [0.7, -1.1, 0.4]),
    "needle": ([0.1, 0.1, 1e-10], [0.7, -1.1, 4.0]),
    "barely turning": ([1.0, 2.0, 2.7], [1e-160, 2e-160, 1e-160]),
    "at rest": ([1.0, 2.0, 2.7], [0.0, 0.0, 0.0]),
}


def scene(turned: bool = False, **body: Any) -> dict[str, Any]:
    """A free body in a uniform field, its axes the principal ones or turned by TURN."""
    own = NUT | body
    if turned:
        R = TURN.as_matrix()
        own["inertia"] = (R @ np.diag(own["inertia"]) @ R.T).tolist()
        own["angular_velocity"] = (R @ own["angular_velocity"]).tolist()
        own["orientation"] = TURN.inv().as_quat().tolist()
    return {"bodies": {"b": own}, "effects": {"weight": {"type": "gravity"}}}


@pytest.mark.parametrize("name", SPINS)
@pytest.mark.parametrize("method", ["rk4", "gauss6"])
def test_energy_and_angular_momentum_stay(name: str, method: str) -> None:
    inertia, w = SPINS[name]
    run = trajectory(
        scene(inertia=inertia, angular_velocity=w),
        duration=5.0, rate=4.0, method=method, step=0.01,
    )  # fmt: skip
    spin = run.angular_velocity[:, 0]
    twice_energy, square = spin**2 @ inertia, spin**2 @ np.square(inertia)
    assert np.isfinite(spin).all()
    assert_allclose(twice_energy, twice_energy[0], rtol=5e-15, atol=0.0)
    assert_allclose(square, square[0], rtol=5e-15, atol=0.0)


def test_the_small_difference_of_the_invariants_keeps_its_digits() -> None:
    """2 E I2 - M^2 = I1 (I2 - I1) w1^2 - I3 (I3 - I2) w3^2 where the spin is back at the saddle."""
    run = trajectory(scene(), duration=60.0, rate=10.0, method="gauss6", step=0.02)
    spin = run.angular_velocity[:, 0]
    excess = 1.0 * spin[:, 0] ** 2 - 3.0 * spin[:, 2] ** 2
    near = np.hypot(spin[:, 0], spin[:, 2]) < 0.01
    assert 20 < near.sum() < 400
    assert np.sign(spin[near, 1]).min() == -1.0
    assert_allclose(excess[near], excess[0], rtol=1e-11)


@pytest.mark.parametrize("name", ["generic", "body of revolution", "sphere", "needle"])
def test_axes_of_the_body_are_free(name: str) -> None:
    inertia, w = SPINS[name]
    options = {"duration": 2.0, "rate": 10.0, "tolerance": 1e-13}
    straight = trajectory(scene(inertia=inertia, angular_velocity=w), **options)
    turned = trajectory(scene(turned=True, inertia=inertia, angular_velocity=w), **options)
    back = Rotation.from_quat(turned.orientation[:, 0]) * TURN
    apart = (Rotation.from_quat(straight.orientation[:, 0]).inv() * back).magnitude()
    sensitive = (
        1e-5 if name == "needle" else 1e-11
    )  # its tensor is rounded by 1e-7 of the small one
    assert apart.max() <= sensitive
    spin = TURN.inv().apply(turned.angular_velocity[:, 0])
    assert_allclose(spin, straight.angular_velocity[:, 0], atol=sensitive)
    assert_allclose(turned.angular_momentum, straight.angular_momentum, atol=1e-13)


def test_agrees_with_the_general_free_body() -> None:
    """The same motion where a couple of zero makes it a body with torque."""
    body = {"inertia": [1.0, 2.0, 2.7], "angular_velocity": [0.7, -1.1, 0.4]}
    nothing = {"type": "angular_damping", "body": "b", "coefficient": 0.0}
    options = {"duration": 3.0, "rate": 10.0, "tolerance": 1e-14}
    one = trajectory(scene(turned=True, **body), **options)
    other = scene(turned=True, **body)
    other["effects"]["nothing"] = nothing
    two = trajectory(other, **options)
    for column in ("position", "orientation", "linear_velocity", "angular_velocity", "energy"):
        assert_allclose(getattr(one, column), getattr(two, column), atol=1e-11, err_msg=column)


def spins_from_elsewhere() -> tuple[np.ndarray, np.ndarray]:
    """A motion that is reset to another spin, and the motion of a scene that starts there."""
    rows = []
    for w, y_w in (((0.7, -1.1, 0.4), (0.3, 1.2, -0.8)), ((0.3, 1.2, -0.8), None)):
        options = {"simulation": {"duration": 1.0, "method": "rk4", "step": 0.01}}
        full = scene_from_mapping(scene(angular_velocity=list(w)) | options)
        compiled = compile_scene(full)
        motion = TracedMotion(compiled, compile_method(full.simulation, 1.0))
        if y_w is not None:
            motion.reset(compiled.y[:10] + y_w)
        out = np.zeros((1, motion.width))
        motion.run_to([1.0], out)
        rows.append(out[0])
    return rows[0], rows[1]


def test_a_motion_reset_to_another_spin_stays_on_its_polhode() -> None:
    moved, direct = interpreted(spins_from_elsewhere)
    assert_allclose(moved, direct, rtol=0.0, atol=0.0)


# A free body beside an unrelated one is as exact as alone: flips about the middle axis, 1000 s.
#
# The reference is the case free_dzhanibekov_long of the oracle, integrated in quadruple precision.


CASES = Path(__file__).parents[1] / "oracles" / "cases_public.json"
BYSTANDER = {"mass": 2.0, "inertia": [1.0, 1.5, 2.0], "position": [50.0, 0.0, 0.0]}
DROP = {"type": "gravity", "bodies": ["far"]}


@pytest.fixture(scope="module")
def case() -> Any:
    cases = json.loads(CASES.read_text())
    listed = cases["cases"] if isinstance(cases, dict) else cases
    return next(case for case in listed if case["id"] == "free_dzhanibekov_long")


def scene_of_spin(case: Any, **more: Any) -> Any:
    """The case; more: constraints and effects of a scene with a bystander 50 m away."""
    start = case["initial"]
    body = {
        "mass": 1.0,
        "inertia": [1.0, 2.0, 3.0],
        "position": start["position"],
        "orientation": start["quaternion_xyzw"],
        "linear_velocity": start["velocity_world"],
        "angular_velocity": start["omega_body"],
    }
    options = {"method": "dopri853", "step": 0.005, "duration": 1000.0, "rate": 1}
    bodies = {"body": body} | ({"far": BYSTANDER} if more else {})
    return {"bodies": bodies, "simulation": options} | more


def error(case: Any, mapping: Any) -> float:
    """Largest, of the spin, relative to its largest."""
    samples = case["samples"]
    run = Simulation(load_scene(mapping)).run(at=samples["t"], checks=False)
    apart = np.abs(run.angular_velocity["body"] - np.array(samples["omega_body"]))
    return float(apart.max()) / 5.0


def test_beside_an_unrelated_body(case):
    """1.5e-6 without the polhode; a joint and an effect elsewhere do not matter."""
    alone = error(case, scene_of_spin(case))
    assert alone < 2e-11
    assert error(case, scene_of_spin(case, effects={"weight": DROP})) < 2e-11
    pin = {"pin": {"type": "fixed_point", "body": "far", "point_B": [0.2, 0.0, 0.0]}}
    assert error(case, scene_of_spin(case, effects={"weight": DROP}, constraints=pin)) < 2e-11


# A jointed body beside a bystander moves as alone: reduced coordinates alone, maximal ones beside.
#
# The two are independent derivations, so what they share at 1e-11 is the motion, not an error.


CONFIG = Path(__file__).parents[2] / "config"
OPTIONS = {"duration": 2.0, "rate": 10.0, "method": "dopri853", "tolerance": 1e-13}
OTHER_BODY = {
    "mass": 1.0,
    "inertia": [0.1, 0.2, 0.3],
    "position": [50.0, 0.0, 0.0],
    "angular_velocity": [0.3, 0.2, 1.0],
}


def run(mapping: dict[str, Any]) -> Any:
    return Simulation(scene_from_mapping(mapping | {"simulation": OPTIONS})).run(checks=False).block


@pytest.mark.parametrize("name", ["heavy_top", "pendulum", "rolling_disk", "rolling_sphere"])
def test_a_bystander_changes_nothing(name):
    scene = yaml.safe_load((CONFIG / f"{name}.yaml").read_text())
    alone = run(scene)
    beside = run(scene | {"bodies": scene["bodies"] | {"bystander": OTHER_BODY}})
    assert beside.position.shape[1] == 2, "the stranger is there"
    for field in ("position", "orientation", "linear_velocity", "angular_velocity"):
        expected, found = getattr(alone, field)[:, 0], getattr(beside, field)[:, 0]
        size = max(1.0, float(np.abs(expected).max()))
        assert np.abs(found - expected).max() < 1e-11 * size, field
    weight = float(np.abs(alone.reaction_force).max())
    for field in ("reaction_force", "reaction_torque"):
        expected, found = getattr(alone, field), getattr(beside, field)
        assert np.abs(found - expected).max() < 1e-11 * weight, field
