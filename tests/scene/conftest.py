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
