# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A free body beside an unrelated one is as exact as alone: flips about the middle axis, 1000 s.

The reference is the case free_dzhanibekov_long of the oracle, integrated in quadruple precision.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rb_sim import Simulation, load_scene
from rb_sim.mechanics.systems.free import untouched

CASES = Path(__file__).parents[1] / "oracles" / "cases_public.json"
BYSTANDER = {"mass": 2.0, "inertia": [1.0, 1.5, 2.0], "position": [50.0, 0.0, 0.0]}
DROP = {"type": "gravity", "bodies": ["far"]}


@pytest.fixture(scope="module")
def case() -> Any:
    cases = json.loads(CASES.read_text())
    listed = cases["cases"] if isinstance(cases, dict) else cases
    return next(case for case in listed if case["id"] == "free_dzhanibekov_long")


def scene(case: Any, **more: Any) -> Any:
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
    run = Simulation(load_scene(mapping)).run(at=samples["t"], watched=False)
    apart = np.abs(run.angular_velocity["body"] - np.array(samples["omega_body"]))
    return float(apart.max()) / 5.0


def test_beside_an_unrelated_body(case):
    """1.5e-6 without the polhode; a joint and an effect elsewhere do not matter."""
    alone = error(case, scene(case))
    assert alone < 2e-11
    assert error(case, scene(case, effects={"weight": DROP})) < 2e-11
    pin = {"pin": {"type": "fixed_point", "body": "far", "point_B": [0.2, 0.0, 0.0]}}
    assert error(case, scene(case, effects={"weight": DROP}, constraints=pin)) < 2e-11


def test_principal_axes_that_are_not_the_body_axes(case):
    """The same motion seen from axes of the body that are turned by 40 degrees."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_rotvec([0.3, -0.4, 0.5])
    mapping = scene(case, effects={"weight": DROP})
    body, axes = mapping["bodies"]["body"], turn.as_matrix()
    tensor = axes @ np.diag([1.0, 2.0, 3.0]) @ axes.T
    body["inertia"] = (0.5 * (tensor + tensor.T)).tolist()
    body["orientation"] = turn.inv().as_quat().tolist()
    body["angular_velocity"] = turn.apply(body["angular_velocity"]).tolist()
    run = Simulation(load_scene(mapping)).run(at=case["samples"]["t"], watched=False)
    found = turn.inv().apply(run.angular_velocity["body"])
    # the tensor is rounded: its axes are off by 1e-16, which 90 flips make 1e-16 * 3e5 at most
    np.testing.assert_allclose(found, case["samples"]["omega_body"], atol=1e-9)


def test_a_split_run_is_the_same_to_the_last_bit(case):
    mapping = scene(case, effects={"weight": DROP})
    whole, split = (Simulation(load_scene(mapping)) for _ in range(2))
    whole.advance(20.0)
    split.advance(7.3)
    split.advance(12.7)
    for name in ("position", "orientation", "linear_velocity", "angular_velocity"):
        a, b = (getattr(s.sample().block, name) for s in (whole, split))
        assert a.tobytes() == b.tobytes()
    whole.reset()
    whole.advance(20.0)
    assert whole.sample().block.angular_velocity.tobytes() == b.tobytes()


def test_which_bodies_are_left_alone(case):
    """Those without joints, on which no effect acts but such as pull at the centre of mass."""
    spring = {"type": "spring", "body": "far", "parent": "body", "stiffness": 1.0}
    drive = {"type": "commanded_wrench", "body": "body"}

    def free(**more: Any) -> list[int]:
        mapping = scene(case, **more)
        mapping["simulation"] = mapping["simulation"] | {"project_initial": True}
        compiled = Simulation(load_scene(mapping), coordinates="maximal").compiled
        assert [spin.body for spin in compiled.system.spins] == untouched(compiled.system)
        return untouched(compiled.system)

    assert free(effects={"weight": {"type": "gravity"}}) == [0, 1]
    assert free(effects={"tie": spring}) == []
    assert free(effects={"drive": drive}) == [1]
    joint = {"type": "distance", "body": "far", "parent": "body", "point_A": [0.0, 0.0, 0.0]}
    assert free(constraints={"rod": joint}) == []
