# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Bodies, options and scenes as models: derived values, defaults, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from rb_sim.scene.schema import METHODS, Body, Scene, SimulationOptions
from rb_sim.scene.shapes import Box, Sphere


def test_inertia_of_the_shape_scales_with_the_mass() -> None:
    body = Body(mass=3.0, shape=Sphere(radius=0.1))
    assert np.allclose(body.inertia, 3.0 * 0.4 * 0.01 * np.eye(3), rtol=1e-15)
    assert body.inertia.shape == (3, 3)


def test_inertia_is_read_only() -> None:
    for body in (Body(mass=1, inertia=(1, 1, 1)), Body(mass=1, shape=Sphere(radius=1))):
        with pytest.raises(ValueError, match="read-only"):
            body.inertia[0, 0] = 2.0


def test_shape_around_the_centre_of_mass() -> None:
    """The inertia is about the shape's centre, so the centre of mass has to be there."""
    shape = Box(size=(1, 1, 1), center_B=(0.1, 0.2, 0.3))
    body = Body(mass=6.0, shape=shape, center_of_mass=(0.1, 0.2, 0.1 + 0.2))
    assert np.allclose(body.inertia, np.eye(3))
    with pytest.raises(ValidationError, match="the centre of the shape"):
        Body(mass=6.0, shape=shape)
    with pytest.raises(ValidationError, match="the centre of the shape"):
        Body(mass=6.0, shape=Box(size=(1, 1, 1)), center_of_mass=(0.1, 0.2, 0.3))


@pytest.mark.parametrize(
    ("mass", "radius"), [(1e300, 1e10), (1.0, 1e200), (1.0, 1e-200), (1e-300, 1e-5)]
)
def test_inertia_beyond_the_range_of_numbers(mass: float, radius: float) -> None:
    with pytest.raises(ValidationError, match="finite and > 0"):
        Body(mass=mass, shape=Sphere(radius=radius))


@pytest.mark.parametrize("field", ["position", "linear_velocity", "angular_velocity"])
def test_a_start_whose_squares_overflow_is_refused(field: str) -> None:
    """Its energy was infinite, and the run ended with a word about singularities."""
    with pytest.raises(ValidationError, match="less than or equal to 10{100}"):
        Body.model_validate({"mass": 1.0, "inertia": (1, 1, 1), field: (0.0, 1e101, 0.0)})


@pytest.mark.parametrize("method", METHODS)
def test_exactly_one_of_step_and_tolerance(method: str) -> None:
    """Each method, given neither, one and both."""
    fixed = {"euler": "s", "rk4": "s", "gauss6": "s", "time_stepping": "s"}
    adaptive = {"dopri853": "st", "radau5": "st", "taylor": "t", "auto": "t"}
    accepted = (fixed | adaptive)[method]
    data = {"method": method}
    if method == "auto":
        with pytest.raises(ValidationError):
            SimulationOptions.model_validate(data)
    else:
        options = SimulationOptions.model_validate(data)
        assert (options.step is None) != (options.tolerance is None)
        assert options.adaptive == (method in ("dopri853", "radau5", "taylor"))
    for letter, key in (("s", "step"), ("t", "tolerance")):
        if letter in accepted:
            assert getattr(SimulationOptions.model_validate(data | {key: 1e-4}), key) == 1e-4
        else:
            with pytest.raises(ValidationError):
                SimulationOptions.model_validate(data | {key: 1e-4})
    with pytest.raises(ValidationError):
        SimulationOptions.model_validate(data | {"step": 1e-3, "tolerance": 1e-4})


def test_a_body_and_a_constraint_may_share_a_name() -> None:
    scene = Scene.model_validate(
        {
            "bodies": {"a": {"mass": 1.0, "inertia": [1, 1, 1]}},
            "constraints": {"a": {"type": "fixed_point", "body": "a"}},
            "effects": {"a": {"type": "gravity"}},
        }
    )
    assert set(scene.constraints) == set(scene.bodies) == set(scene.effects) == {"a"}
