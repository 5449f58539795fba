# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The six scenes as plain numbers, read from config/*.yaml without the help of rb_sim.

Every engine is given these numbers, and the reference integrates them, so that all compute the
motion of the same doubles.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

Array = NDArray[np.float64]

CONFIG = Path(__file__).resolve().parents[2] / "config"

SAMPLE_INTERVAL = {
    "free_tumble": 0.1,
    "gazebo_boxes": 0.1,
    "heavy_top": 0.01,
    "pendulum": 0.1,
    "rolling_sphere": 0.05,
    "rolling_disk": 0.05,
}
"""Time between the samples at which an error is measured [s]; fixed steps divide it."""

NAMES = tuple(SAMPLE_INTERVAL)


class Scene(NamedTuple):
    """One rigid body. SI units, world axes unless a field says otherwise."""

    name: str
    path: Path
    duration: float
    """[s]."""
    interval: float
    """time between samples [s]."""
    mass: float
    """[kg]."""
    inertia: Array
    """principal moments about the centre of mass, body axes [kg m^2], shape (3,)."""
    center: Array
    """centre of mass from the body origin, body axes [m], shape (3,)."""
    origin: Array
    """body origin at the start [m], shape (3,)."""
    quaternion: Array
    """[x, y, z, w] body to world at the start, shape (4,)."""
    velocity: Array
    """of the body origin at the start [m/s], shape (3,)."""
    spin: Array
    """angular velocity at the start, body axes [rad/s], shape (3,)."""
    gravity: Array
    """[m/s^2], shape (3,)."""
    force: Array
    """constant, at the centre of mass [N], shape (3,)."""
    torque: Array
    """constant, about the centre of mass [N m], shape (3,)."""
    size: Array
    """radius (sphere, disk) or edges (box) [m]; zeros where the scene has no shape."""

    @property
    def times(self) -> Array:
        """Sample times from the start to the end [s]."""
        count = round(self.duration / self.interval)
        return self.duration * np.arange(count + 1) / count

    @property
    def position(self) -> Array:
        """Centre of mass at the start [m], shape (3,)."""
        return self.origin + rotation(self.quaternion) @ self.center


def rotation(quaternion: Array) -> Array:
    """Matrix of the unit quaternion [x, y, z, w], shape (3, 3)."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def load(name: str) -> Scene:
    """The scene of config/NAME.yaml as numbers.

    Raises KeyError when `name` is none of NAMES.
    """
    interval = SAMPLE_INTERVAL[name]
    path = CONFIG / f"{name}.yaml"
    text = yaml.safe_load(path.read_text(encoding="utf-8"))
    ((_, body),) = text["bodies"].items()
    effects = list(text.get("effects", {}).values())
    of_kind = {effect["type"]: effect for effect in effects}
    vector = _vector_of(body)
    return Scene(
        name=name,
        path=path,
        duration=float(text["simulation"]["duration"]),
        interval=interval,
        mass=float(body["mass"]),
        inertia=_inertia(body),
        center=vector("center_of_mass"),
        origin=vector("position"),
        quaternion=_quaternion(body.get("orientation", [0.0, 0.0, 0.0, 1.0])),
        velocity=vector("linear_velocity"),
        spin=vector("angular_velocity"),
        gravity=_vector_of(of_kind.get("gravity", {}))("acceleration"),
        force=_vector_of(of_kind.get("wrench", {}))("force"),
        torque=_vector_of(of_kind.get("wrench", {}))("torque"),
        size=_size(body.get("shape", {})),
    )


def _vector_of(mapping: dict[str, Any]) -> Any:
    return lambda key: np.array(mapping.get(key, (0.0, 0.0, 0.0)), dtype=float)


def _quaternion(value: Any) -> Array:
    if isinstance(value, dict):
        half = 0.5 * float(value["angle"])
        return np.append(np.sin(half) * np.array(value["axis"], dtype=float), np.cos(half))
    return np.array(value, dtype=float)


def _size(shape: dict[str, Any]) -> Array:
    if "size" in shape:
        return np.array(shape["size"], dtype=float)
    return np.full(3, float(shape.get("radius", 0.0)))


def _inertia(body: dict[str, Any]) -> Array:
    """Principal moments: as given, or of the homogeneous box, sphere or thin disk."""
    if "inertia" in body:
        return np.array(body["inertia"], dtype=float)
    mass, shape = float(body["mass"]), body["shape"]
    if shape["type"] == "box":
        x, y, z = np.square(np.array(shape["size"], dtype=float))
        return mass / 12.0 * np.array([y + z, x + z, x + y])
    square = float(shape["radius"]) ** 2
    if shape["type"] == "sphere":
        return np.full(3, 0.4 * mass * square)
    return mass * square * np.array([0.25, 0.25, 0.5])
