# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Which reactions statics alone does not determine, where bodies are in contact."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from rb_sim.contact.events.shares import undetermined_at_start
from rb_sim.scene.compile import compile_scene
from rb_sim.scene.load import scene_from_mapping
from tests.contact.scenes import ball, body, box, scene, touch
from tests.interpreted import interpreted

FEET = [[0.4, 0.3, -0.5], [-0.4, 0.3, -0.5], [-0.4, -0.3, -0.5], [0.4, -0.3, -0.5]]
ROUGH = {"type": "rough"}


def found(mapping: dict[str, Any]) -> tuple[str, ...]:
    return undetermined_at_start(compile_scene(scene_from_mapping(mapping)))


def names_of(*mappings: dict[str, Any]) -> list[tuple[str, ...]]:
    return [found(mapping) for mapping in mappings]


def table(feet: int, **more: Any) -> dict[str, Any]:
    shape = {"type": "box", "size": [1.0, 0.8, 1.0]}
    return scene(body(shape, [0.0, 0.0, 0.5]), touch(points=FEET[:feet]) | more)


def test_redundant_contacts_are_named() -> None:
    upright = {"upright": {"type": "translation", "body": "body"}}
    standing = box([0.2, 0.2, 0.2], [0.0, 0.0, 0.1])
    flying = box([0.2, 0.2, 0.2], [0.0, 0.0, 0.5])
    held = scene(standing, upright | {"floor": touch()}, gravity=True)
    got = interpreted(
        names_of,
        table(4),
        table(3),
        table(3, friction={"type": "coulomb", "static": 0.5}),
        scene(ball([0.0, 0.0, 0.1]), touch(friction=ROUGH)),
        scene(standing, touch()),
        scene(flying, touch()),
        held,
    )
    four = tuple(f"floor/{i}" for i in (1, 2, 3, 4))
    assert got[0] == four  # their total, floor, is determined
    assert got[1] == ()
    assert got[2] == four[:3]  # three tangential forces more than a body has freedoms to hold
    assert got[3] == ()
    assert got[4] == four  # the lower corners
    assert got[5] == ()
    # what keeps it upright may take up any torque that the corners leave
    assert set(got[6]) == {"upright", "floor", *got[4]}


@pytest.mark.parametrize("size", [1e-3, 1e3])
@pytest.mark.parametrize("mass", [1e-9, 1e9])
def test_whether_they_are_does_not_hang_on_units(mass: float, size: float) -> None:
    """A table of three legs and one of four, of any mass and size."""
    mappings = []
    for feet in (3, 4):
        shape = {"type": "box", "size": [size, 0.8 * size, size]}
        points = (size * np.array(FEET[:feet])).tolist()
        thing = body(shape, [0.0, 0.0, 0.5 * size]) | {"mass": mass}
        mappings.append(scene(thing, touch(points=points)))
    assert interpreted(names_of, *mappings) == [(), tuple(f"floor/{i}" for i in (1, 2, 3, 4))]
