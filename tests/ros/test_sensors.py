# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Inertial sensors, URDF and markers of a running node, each against what it must agree with."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import AccelStamped, PoseStamped
from mcap.reader import make_reader
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import String
from visualization_msgs.msg import Marker, MarkerArray

from rb_sim.base.errors import RbSimError
from rb_sim.ros.topics.conventions import read_sensors
from tests.ros.client import NAME, Client, vector

LATCHED = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)

# A body that falls while it spins about its centre of mass, and one that is held on its side.
FALLING = """\
bodies:
  ball: {mass: 2.0, inertia: [0.1, 0.1, 0.1], center_of_mass: [0.3, 0, 0],
    linear_velocity: [0.5, 0.6, 0.0], angular_velocity: [0.0, 0.0, 2.0]}
  box: {mass: 1.0, shape: {type: box, size: [0.1, 0.2, 0.3]}, position: [5, 0, 0],
    orientation: {axis: [1, 0, 0], angle: 1.5707963267948966}}
constraints:
  wall: {type: weld, body: box}
effects:
  weight: {type: gravity}
simulation: {duration: 100.0, rate: 50, method: rk4, step: 0.01}
"""

# A wheel on an arm on a post: both axes beside the origins, one of them tilted.
ARM = """\
bodies:
  arm: {mass: 1.0, shape: {type: rod, length: 1.0, axis_B: [1, 0, 0]}, position: [0.5, 0.2, 1.0],
    orientation: {axis: [0, 0, 1], angle: 0.4}}
  wheel: {mass: 0.5, shape: {type: disk, radius: 0.2}, position: [0.9, 0.6, 1.1],
    orientation: {axis: [0, 1, 0], angle: 0.3}}
  moon: {mass: 1.0, shape: {type: sphere, radius: 0.1}, position: [3, 0, 0]}
constraints:
  post: {type: fixed_axis, body: arm, point_B: [-0.5, 0, 0], axis_B: [0, 0, 1]}
  axle: {type: fixed_axis, body: wheel, parent: arm, point_B: [0, 0, 0.05], axis_B: [0, 0.6, 0.8]}
effects:
  motor: {type: wrench, body: arm, torque: [0, 0, 0.3]}
  spin: {type: wrench, body: wheel, torque: [0, 0.06, 0.08], frame: body}
simulation: {duration: 100.0, rate: 20, method: rk4, step: 0.01, project_initial: true}
"""


def test_inertial_sensors_and_accelerations_are_those_of_a_fall(
    tmp_path: Path, start, client: Client
):
    """A sensor measures the specific force at its point; accelerations are in the bag as well."""
    scene = tmp_path / "falling.yaml"
    scene.write_text(FALLING)
    node = start(scene, imu="ball 0.8 0 0.1; box", start_paused=True, frame_prefix="r/",
                 accelerations=True, out=str(tmp_path / "out"))  # fmt: skip
    falling, held = client.listen(Imu, "ball/imu"), client.listen(Imu, "box/imu")
    found = client.listen(AccelStamped, "ball/accel")
    client.step_until(lambda: min(len(falling), len(held), len(found)) >= 5)
    assert node.stop() == 0
    for message in falling[-5:]:
        assert message.header.frame_id == "r/ball"
        # it falls freely: what is left is w x (w x r) with r = (0.5, 0, 0.1)
        np.testing.assert_allclose(vector(message.linear_acceleration), (-2.0, 0, 0), atol=1e-8)
        np.testing.assert_allclose(vector(message.angular_velocity), (0, 0, 2.0), atol=1e-9)
    for message in held[-5:]:
        # up in the world is y of the box
        np.testing.assert_allclose(vector(message.linear_acceleration), (0, 9.81, 0), atol=1e-8)
        q = message.orientation
        assert (q.x, q.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    for message in found[-5:]:
        turn = 2.0 * (message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec)
        expected = (1.2 * math.cos(turn), 1.2 * math.sin(turn), -9.81)
        np.testing.assert_allclose(vector(message.accel.linear), expected, atol=1e-8)
        np.testing.assert_allclose(vector(message.accel.angular), (0, 0, 0), atol=1e-9)
        assert message.header.frame_id == "r/world"
    with (tmp_path / "out/bag/bag_0.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    channels = summary.channels.values()
    assert {f"{NAME}/ball/accel", f"{NAME}/box/accel"} <= {c.topic for c in channels}


@pytest.mark.parametrize("wrong", ["ball 1 2", "ball a b c", ";", "ball; ball", "ball nan 0 0"])
def test_a_sensor_that_cannot_be_read_is_refused(wrong: str):
    with pytest.raises(RbSimError, match="parameter imu: got"):
        read_sensors(wrong)


def test_urdf_and_joint_states_give_the_poses(tmp_path: Path, start, client: Client):
    """The poses of the bodies, from the document and the angles alone."""
    scene = tmp_path / "arm.yaml"
    scene.write_text(ARM)
    start(scene, robot_description=True, joint_states=True, markers=True, start_paused=True)
    documents: list[Any] = []
    arrays: list[Any] = []
    client.node.create_subscription(String, "/robot_description", documents.append, LATCHED)
    client.node.create_subscription(MarkerArray, f"{NAME}/markers", arrays.append, LATCHED)
    states = client.listen(JointState, "joint_states")
    poses = {body: client.listen(PoseStamped, f"{body}/pose") for body in ("arm", "wheel")}
    client.step_for(25, states, *poses.values())
    client.until(lambda: documents and arrays, "what is latched, though late")
    robot = ElementTree.fromstring(documents[0].data.split("?>", 1)[1])
    last = states[-1]
    angles = dict(zip(last.name, last.position, strict=True))
    assert min(map(abs, angles.values())) > 0.02
    for body, found in poses.items():
        assert found[-1].header.stamp == last.header.stamp
        point, turn = forward(robot, body, angles)
        pose = found[-1].pose
        np.testing.assert_allclose(point, vector(pose.position), atol=1e-7)
        q = pose.orientation
        apart = turn.inv() * Rotation.from_quat((q.x, q.y, q.z, q.w))
        assert apart.magnitude() < 1e-7
    joints = {joint.get("name"): joint.get("type") for joint in robot.findall("joint")}
    assert joints["post"] == joints["axle"] == "continuous" and joints["moon/free"] == "floating"
    check_inertia(robot)
    markers = {marker.ns: marker for marker in arrays[0].markers}
    assert {name: m.type for name, m in markers.items()} == {
        "arm": Marker.CYLINDER,
        "wheel": Marker.CYLINDER,
        "moon": Marker.SPHERE,
    }
    assert all(m.frame_locked and m.header.frame_id == name for name, m in markers.items())
    assert vector(markers["moon"].scale) == (0.2, 0.2, 0.2)
    q = markers["arm"].pose.orientation
    along = Rotation.from_quat((q.x, q.y, q.z, q.w)).apply((0, 0, 1))
    np.testing.assert_allclose(along, (1, 0, 0), atol=1e-12)
    assert vector(markers["arm"].scale)[2] == 1.0


def check_inertia(robot: ElementTree.Element) -> None:
    """Of the ball: 2/5 m a^2; of the thin rod: m l^2 / 12 across."""
    links = {link.get("name"): link for link in robot.findall("link")}
    for body, key, value in (
        ("moon", "ixx", 0.004),
        ("arm", "izz", 1 / 12),
        ("arm", "iyy", 1 / 12),
    ):
        inertia = links[body].find("inertial/inertia")
        assert inertia is not None
        assert float(inertia.get(key, "nan")) == pytest.approx(value)


def forward(
    robot: ElementTree.Element, link: str, angles: dict[str, float]
) -> tuple[np.ndarray, Rotation]:
    """Pose of a link in the world, joint by joint from there, as URDF has it."""
    joints = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}  # type: ignore[union-attr]
    if link == "world":
        return np.zeros(3), Rotation.identity()
    joint = joints[link]
    point, turn = forward(robot, joint.find("parent").get("link"), angles)  # type: ignore[union-attr, arg-type]
    origin = joint.find("origin")
    assert origin is not None
    xyz, rpy = (np.array(origin.get(key, "").split(), dtype=float) for key in ("xyz", "rpy"))
    point = point + turn.apply(xyz)
    turn = turn * Rotation.from_euler("xyz", rpy)
    axis = joint.find("axis")
    if axis is not None:
        along = np.array(axis.get("xyz", "").split(), dtype=float)
        turn = turn * Rotation.from_rotvec(angles[joint.get("name", "")] * along)
    return point, turn
