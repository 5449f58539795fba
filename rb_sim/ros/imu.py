"""~/BODY/imu (sensor_msgs/Imu): what an inertial sensor at a point of the body would measure.

    f = R^T (a_P - g)        a_P = a_C + R (dw/dt x r + w x (w x r)),   r = P - C in body axes

f is the specific force in body axes (at rest it points up, by 9.81 m/s^2), g the sum of the scene's
uniform gravity on the body. Accelerations are those of Newton's and Euler's equations with the
reactions of the sample (rb_sim.accelerations); an impact shows in none.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.accelerations import accelerations
from rb_sim.catalogue.effects.gravity import Gravity
from rb_sim.errors import RbSimError
from rb_sim.ros.offers import offer
from rb_sim.sinks import cdr
from rb_sim.sinks.cdr import stamp_of
from rb_sim.sinks.frames import conjugate, cross, rotate
from rb_sim.trajectory import Trajectory

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from rb_sim.engine.samples import Array, SampleBlock, SampleLayout
    from rb_sim.ros.parameters import Settings
    from rb_sim.scene.schema import Scene

COVARIANCE = 9
"""Numbers of a 3 x 3 covariance; all zero, which says that none is told."""


class Sensor(NamedTuple):
    """An inertial sensor."""

    body: str
    point_B: tuple[float, float, float]
    """from the body origin, body axes [m]."""


def read_sensors(text: str) -> list[Sensor]:
    """'BODY' or 'BODY X Y Z', several of them with ';' in between. RbSimError: it is neither."""
    sensors = []
    for part in text.split(";"):
        name, *numbers = part.split() or [""]
        try:
            point = tuple(float(number) for number in numbers) or (0.0, 0.0, 0.0)
        except ValueError:
            point = ()
        if not name or len(point) != 3 or not np.isfinite(point).all():
            raise RbSimError(
                f"parameter imu: got {part.strip()!r}; must be BODY, or BODY X Y Z with a point"
                " in body axes [m]; several with ';' in between"
            )
        sensors.append(Sensor(name, point))
    names = [sensor.body for sensor in sensors]
    if len(set(names)) < len(names):
        raise RbSimError(f"parameter imu: got {text!r}; a body has one sensor at most")
    return sensors


class Imu:
    """Publishes what the sensors measure. RbSimError: one of them is on no body of the scene."""

    def __init__(self, node: Node, settings: Settings) -> None:
        self._node, self._settings = node, settings
        self._sensors = read_sensors(settings.imu)
        self._publishers: list[tuple[Publisher, cdr.Codec]] = []

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers."""
        self._scene, self._layout = scene, layout
        if scene.simulation.method == "time_stepping":
            raise RbSimError(
                "parameter imu: method time_stepping has no accelerations; must be another method"
            )
        kind = import_module("sensor_msgs.msg").Imu
        for body, _ in self._sensors:
            if body not in layout.bodies:
                known = ", ".join(layout.bodies)
                raise RbSimError(f"parameter imu: got body {body!r}; must be one of {known}")
            name, frame = f"~/{body}/imu", self._settings.frame_prefix + body
            publisher = offer(self._node, kind, name, self._settings.publish_depth)
            self._publishers.append((publisher, imu_codec(frame)))

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block."""
        found = accelerations(Trajectory(block, self._layout, self._scene))
        for sensor, (publisher, codec) in zip(self._sensors, self._publishers, strict=True):
            i = self._layout.bodies.index(sensor.body)
            arm = np.array(sensor.point_B) - self._scene.bodies[sensor.body].center_of_mass
            turn, spin = block.orientation[:, i], block.angular_velocity[:, i]
            free = found.linear[:, i] - self._gravity(sensor.body)
            force = rotate(conjugate(turn), free)
            force += cross(found.angular[:, i], arm[None]) + cross(spin, cross(spin, arm[None]))
            none = np.zeros((len(block), COVARIANCE))
            rows = np.concatenate([turn, none, spin, none, force, none], axis=1)
            for t, row in zip(block.t, rows, strict=True):
                publisher.publish(codec.pack(stamp_of(t), row))

    def _gravity(self, body: str) -> Array:
        """Of all uniform fields on the body, world axes [m/s^2]."""
        total = np.zeros(3)
        for effect in self._scene.effects.values():
            if isinstance(effect, Gravity) and (effect.bodies is None or body in effect.bodies):
                total += effect.acceleration
        return total

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publishers."""
        for publisher, _ in self._publishers:
            self._node.destroy_publisher(publisher)
        self._publishers = []


def imu_codec(frame_id: str) -> cdr.Codec:
    """sensor_msgs/Imu: orientation, angular velocity, linear acceleration, each with covariance."""
    layout = cdr.Layout().stamp().text(frame_id)
    return layout.doubles(4 + COVARIANCE + 3 + COVARIANCE + 3 + COVARIANCE).codec()
