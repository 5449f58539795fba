# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Topics that other ROS programs expect, published on request by a parameter.

The messages are those of the bag (`rb_sim.io.messages.topics`), except `imu`, which is derived and
not recorded.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rb_sim.base.errors import RbSimError
from rb_sim.base.names import ros_name
from rb_sim.catalogue.effects.gravity import Gravity
from rb_sim.io.messages import cdr
from rb_sim.io.messages.packing import stamps_of
from rb_sim.io.messages.robot_description import JointTable, marker_array, urdf
from rb_sim.io.messages.topic_names import MARKERS, ROBOT_DESCRIPTION, body_frame, body_topic
from rb_sim.io.messages.topics import AccelTable, OdometryTable
from rb_sim.numerics.rotations import conjugate, cross, rotate
from rb_sim.ros.serving import message_class, offer
from rb_sim.ros.topics.topic_sink import Latest
from rb_sim.simulation.record import accelerating, accelerations
from rb_sim.simulation.trajectory import Trajectory

if TYPE_CHECKING:
    from rclpy.node import Node
    from rclpy.publisher import Publisher

    from rb_sim.io.messages.packing import MessageTable
    from rb_sim.mechanics.samples import Array, SampleBlock, SampleLayout
    from rb_sim.ros.parameters import Settings
    from rb_sim.scene.schema import Scene

    Make = Callable[[Scene, SampleLayout, str], MessageTable]
    MakeOnce = Callable[[Scene, SampleLayout, SampleBlock], bytes]


# Robot description (URDF) and markers, latched for late viewers.


class Once:
    """Publishes one latched message, with the first sample. make: the message, from that sample."""

    def __init__(self, node: Node, name: str, ros_type: str, make: MakeOnce) -> None:
        self._node, self._make = node, make
        self._topic = name, ros_type
        self._publisher: Publisher | None = None
        self._published = False

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publisher."""
        self._scene, self._layout = scene, layout
        name, ros_type = self._topic
        self._publisher = offer(self._node, message_class(ros_type), name, 1, latched=True)

    def write(self, block: SampleBlock) -> None:
        """Publish with the first sample."""
        if self._publisher is not None and not self._published:
            self._published = True
            self._publisher.publish(self._make(self._scene, self._layout, block))

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publisher."""
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)
        self._publisher = None


# ~/BODY/accel, ~/BODY/odometry, ~/BODY/imu and joint_states, on request.


class OfTable:
    """Publishes the messages of a table. make: creates it for scene, layout and frame prefix."""

    def __init__(self, node: Node, settings: Settings, make: Make) -> None:
        self._node, self._settings, self._make = node, settings, make
        self._publishers: list[Publisher] = []
        self.latest = Latest()

    def open(self, scene: Scene, layout: SampleLayout) -> None:
        """Create the publishers. Raises RbSimError as `make` does."""
        self._table = self._make(scene, layout, self._settings.frame_prefix)
        depth = self._settings.publish_depth
        self._publishers = [
            offer(
                self._node, message_class(ros_type), f"~/{name}", depth, latched=self._table.latched
            )
            for name, ros_type in self._table.topics
        ]
        self.latest.open(self._publishers)

    def write(self, block: SampleBlock) -> None:
        """Publish every sample of the block."""
        rows = self._table.rows(block)
        for k in range(len(block)):
            messages = [row[k].tobytes() for row in rows]
            for publisher, data in zip(self._publishers, messages, strict=True):
                publisher.publish(data)
            self.latest.sent(messages)

    def close(self, summary: dict[str, Any] | None = None) -> None:
        """Remove the publishers."""
        self.latest.close()
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        self._publishers = []


def accel_table(scene: Scene, layout: SampleLayout, prefix: str) -> AccelTable:
    """The table of accelerations of all bodies. Raises RbSimError if the method provides none."""
    _need_accelerations(scene, "accelerations")
    return AccelTable(scene, layout, accelerating, prefix)


def _need_accelerations(scene: Scene, parameter: str) -> None:
    """Raise RbSimError if the method of the scene has no accelerations."""
    if scene.simulation.method == "time_stepping":
        raise RbSimError(
            f"parameter {parameter}: method time_stepping has no accelerations; must be another"
            " method"
        )


# ~/BODY/imu (sensor_msgs/Imu): the reading of an ideal inertial sensor at a point of the body.
#
#     f = R^T (a_P - g)        a_P = a_C + R (dw/dt x r + w x (w x r)),   r = P - C in body axes
#
# f is the specific force in body axes (at rest 9.81 m/s^2 upwards), g the sum of the scene's
# uniform gravity on the body. Accelerations follow from Newton's and Euler's equations with the
# reactions of the sample (rb_sim.simulation.record); impacts are not included.


IMU = "sensor_msgs/msg/Imu"
COVARIANCE_3X3 = 9
"""Elements of a 3 x 3 covariance; all zero: unknown."""


class Sensor(NamedTuple):
    """An inertial sensor."""

    body: str
    point_B: tuple[float, float, float]
    """from the body origin, body axes [m]."""


def read_sensors(text: str) -> list[Sensor]:
    """Sensors in 'BODY' or 'BODY X Y Z', several separated by ';'. Raises RbSimError."""
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


class ImuTable:
    """BODY/imu messages of the sensors. Raises RbSimError for an unknown body."""

    latched = False

    def __init__(
        self, sensors: list[Sensor], scene: Scene, layout: SampleLayout, prefix: str
    ) -> None:
        _need_accelerations(scene, "imu")
        self._scene, self._layout = scene, layout
        called = {ros_name(body): body for body in layout.bodies}
        self._sensors = []
        for body, point_B in sensors:
            if body not in layout.bodies and body not in called:
                known = ", ".join(called)
                raise RbSimError(f"parameter imu: got body {body!r}; must be one of {known}")
            self._sensors.append(Sensor(called.get(body, body), point_B))
        self.topics = [(body_topic(body, "imu"), IMU) for body, _ in sensors]
        self._codecs = [imu_codec(prefix + body_frame(body)) for body, _ in sensors]

    def rows(self, block: SampleBlock) -> list[Any]:
        """As in MessageTable."""
        found = accelerations(Trajectory(block, self._layout, self._scene))
        none = np.zeros((len(block), COVARIANCE_3X3))
        rows = []
        for sensor, codec in zip(self._sensors, self._codecs, strict=True):
            i = self._layout.bodies.index(sensor.body)
            arm = np.array(sensor.point_B) - self._scene.bodies[sensor.body].center_of_mass
            turn, spin = block.orientation[:, i], block.angular_velocity[:, i]
            free = found.linear[:, i] - self._gravity(sensor.body)
            force = rotate(conjugate(turn), free)
            force += cross(found.angular[:, i], arm[None]) + cross(spin, cross(spin, arm[None]))
            values = np.concatenate([turn, none, spin, none, force, none], axis=1)
            rows.append(codec.pack_rows(stamps_of(block), values))
        return rows

    def _gravity(self, body: str) -> Array:
        """Sum of the uniform gravity fields on the body, world axes [m/s^2]."""
        total = np.zeros(3)
        for effect in self._scene.effects.values():
            if isinstance(effect, Gravity) and (effect.bodies is None or body in effect.bodies):
                total += effect.acceleration
        return total


def imu_codec(frame_id: str) -> cdr.Codec:
    """sensor_msgs/Imu: orientation, angular velocity, linear acceleration, each with covariance."""
    layout = cdr.Layout().stamp().text(frame_id)
    return layout.doubles(4 + COVARIANCE_3X3 + 3 + COVARIANCE_3X3 + 3 + COVARIANCE_3X3).codec()


def asked_for(node: Node, settings: Settings) -> list[Any]:
    """The sinks for all conventions requested by parameters. Raises RbSimError as read_sensors."""
    prefix = settings.frame_prefix
    sensors = read_sensors(settings.imu) if settings.imu else []
    tables: list[tuple[bool, Make]] = [
        (settings.joint_states, lambda scene, layout, _: JointTable(scene, layout)),
        (settings.odometry, OdometryTable),
        (settings.accelerations, accel_table),
        (bool(sensors), partial(ImuTable, sensors)),
    ]
    latched: list[tuple[bool, str, str, MakeOnce]] = [
        (settings.markers, f"~/{MARKERS}", cdr.MARKER_ARRAY,
         lambda scene, layout, first: marker_array(scene, prefix)),
        (settings.robot_description, ROBOT_DESCRIPTION, cdr.STRING,
         lambda scene, layout, first: cdr.string(urdf(scene, layout, first))),
    ]  # fmt: skip
    return [
        *(OfTable(node, settings, make) for wanted, make in tables if wanted),
        *(Once(node, name, kind, make) for wanted, name, kind, make in latched if wanted),
    ]
