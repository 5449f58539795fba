# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Cases that engines get wrong: a right answer or a plain refusal, never a silent wrong one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from rb_sim.base.errors import RbSimError
from tests.one_body_scenes import JOINTS
from tests.runs import trajectory

G = 9.81
DOWN = {"type": "gravity", "acceleration": [0.0, 0.0, -G]}


def test_needle_keeps_its_spin() -> None:
    """Axial inertia 1e-9 of the transverse one: w3 stays constant, the energy too."""
    body = {
        "mass": 1.0,
        "inertia": [0.1, 0.1, 1e-10],
        "orientation": {"axis": [1.0, 0.0, 0.0], "angle": 1.2},
        "center_of_mass": [0.0, 0.0, -0.5],
        "angular_velocity": [0.0, 2.0, 7.0],
    }
    scene = {
        "bodies": {"rod": body},
        "constraints": {"hinge": {"type": "fixed_point", "body": "rod"}},
        "effects": {"weight": DOWN},
    }
    for coordinates in ("auto", "maximal"):
        run = trajectory(scene, coordinates, duration=1.0, rate=20.0, tolerance=1e-12)
        assert_allclose(run.angular_velocity[:, 0, 2], 7.0, rtol=1e-6)
        assert_allclose(run.energy, run.energy[0], atol=1e-9)


def outcome(mapping: Any, coordinates: str, options: dict[str, Any]) -> Any:
    """The run's samples, or the message of the refusal."""
    from rb_sim import Simulation, load_scene

    own = {key: value for key, value in mapping["simulation"].items() if key != "tolerance"}
    scene = load_scene(mapping | {"simulation": own | options})
    try:
        return Simulation(scene, coordinates=coordinates).run(checks=False).block
    except RbSimError as error:
        return str(error)
    except ZeroDivisionError:  # plain Python raises where compiled code gets infinity, then NaN
        return f"step {options['step']:g} s is too large for {options['method']}"


@pytest.mark.parametrize("coordinates", ["auto", "maximal"])
@pytest.mark.parametrize("method", ["euler", "rk4", "dopri853", "gauss6"])
@pytest.mark.parametrize("step", [0.5, 20.0])
@pytest.mark.usefixtures("no_advice")
def test_absurd_steps(method: str, step: float, coordinates: str) -> None:
    """A fixed step of several turns: refused by name, or finite and on the joint."""
    options = {"method": method, "step": step, "duration": 40.0, "rate": 0.5}
    for name in ("free", "fixed_point", "rolling disk"):
        got = outcome(JOINTS[name], coordinates, options)
        if isinstance(got, str):
            assert f"step {step:g} s is too large for {method}" in got
            continue
        for column in (got.position, got.orientation, got.linear_velocity, got.reaction_force):
            assert np.isfinite(column).all()
        assert got.residual.max() <= 1e-12 * max(1.0, np.abs(got.position).max())
