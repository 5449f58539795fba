# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Plans that the tests of sweeps share: small scenes whose answers are known in closed form."""

from __future__ import annotations

from pathlib import Path
from typing import Any

THROWN = """\
description: a body thrown upwards, z(t) = z0 + v t - g t^2 / 2
bodies:
  stone: {mass: 2.0, inertia: [0.1, 0.1, 0.1], linear_velocity: [0.0, 0.0, 3.0]}
effects:
  weight: {type: gravity, acceleration: [0.0, 0.0, -9.81]}
simulation: {duration: 0.5, rate: 20, method: rk4, step: 0.05}
"""

THROW = {
    "vary": {
        "speed": {"path": "bodies.stone.linear_velocity[2]", "normal": {"mean": 3.0, "std": 0.5}},
        "start": {"path": "bodies.stone.position[2]", "uniform": [0.0, 1.0]},
    },
    "draws": 40,
    "outputs": {
        "height": {"value": "last(position.stone.z)", "unit": "m"},
        "top": "max(position.stone.z)",
    },
}


def plan(folder: Path, **changes: Any) -> dict[str, Any]:
    """The plan THROW with the changes, its scene written into the folder."""
    scene = folder / "thrown.yaml"
    scene.write_text(THROWN)
    return {"scene": str(scene), **THROW, **changes}


def height(speed: Any, start: Any) -> Any:
    """The closed form of the output `height`."""
    return start + 0.5 * speed - 0.5 * 9.81 * 0.25
