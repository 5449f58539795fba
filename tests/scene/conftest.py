# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A scene that is valid, as YAML text, for the tests to break."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from rb_sim.base.errors import SceneError
from rb_sim.scene.load import scene_from_mapping

VALID = """\
description: a ball on a floor
  and a rod
bodies:
  ball:
    mass: 2
    shape: {type: sphere, radius: 0.1}
    position: [0, 0, 0.1]
  rod:
    mass: 1.5
    inertia: [0.2, 0.2, 0.01]
    center_of_mass: [0, 0, 0.5]
    orientation: {axis: [0, 0, 1], angle: 0.3}
constraints:
  floor: {type: rolling, body: ball}
  tip: {type: fixed_point, body: rod, parent: ball, point_B: [0, 0, 0.1]}
effects:
  weight: {type: gravity, bodies: [ball, rod]}
simulation: {duration: 2, step: 1e-3, method: rk4, rate: 50}
"""


@pytest.fixture
def valid() -> str:
    """YAML of a valid scene."""
    return VALID


@pytest.fixture
def broken() -> Callable[[str, str], str]:
    """Text of the error after replacing a part of the valid scene; checked to be one line."""

    def message(old: str, new: str) -> str:
        assert old in VALID
        with pytest.raises(SceneError) as caught:
            scene_from_mapping(VALID.replace(old, new, 1), file="s.yaml")
        text = str(caught.value)
        assert len(text.splitlines()) == 1
        assert text.startswith("s.yaml: ")
        return text.removeprefix("s.yaml: ")

    return message
