# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Odometry, joint states and prefixed frames, against closed forms and the pendulum's energy."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from tests.ros.client import NAME, Client, seconds, vector
from tests.ros.test_topics import OFFSET

# A wheel that turns uniformly about an axis on a table that does, too: 4 rad/s and 1 rad/s, both
# about z through their centres of mass, without any torque.
TABLE = """\
bodies:
  table: {mass: 1.0, inertia: [0.1, 0.1, 0.1], angular_velocity: [0, 0, 1]}
  wheel: {mass: 1.0, inertia: [0.1, 0.1, 0.1], angular_velocity: [0, 0, 4],
    orientation: {axis: [0, 0, 1], angle: 0.7}}
constraints:
  spindle: {type: fixed_axis, body: table, axis_B: [0, 0, 1]}
  axle: {type: fixed_axis, body: wheel, parent: table, axis_B: [0, 0, 1]}
simulation: {duration: 100.0, rate: 5, method: rk4, step: 0.01}
"""


SPIN, BRAKING = 420.0, 350.0
"""Of the wheel at the start [rad/s], and by what it is braked [rad/s^2]."""
WHEEL = f"""\
bodies:
  wheel: {{mass: 1.0, inertia: [0.1, 0.1, 0.1], angular_velocity: [0, 0, {SPIN}]}}
constraints:
  axle: {{type: fixed_axis, body: wheel, axis_B: [0, 0, 1]}}
effects:
  motor: {{type: wrench, body: wheel, torque: [0, 0, {-0.1 * BRAKING}]}}
simulation: {{duration: 100.0, rate: 100, method: rk4, step: 0.001}}
"""


def test_odometry_has_the_twist_in_the_axes_of_the_body(tmp_path: Path, start, client: Client):
    scene = tmp_path / "offset.yaml"
    scene.write_text(OFFSET)
    start(scene, odometry=True, frame_prefix="robot1/", start_paused=True)
    found = client.listen(Odometry, "ball/odometry")
    poses = client.listen(PoseStamped, "ball/pose")
    client.step_for(10, found, poses)
    for odometry, pose in zip(found[-10:], poses[-10:], strict=True):
        assert odometry.header.stamp == pose.header.stamp
        assert odometry.header.frame_id == pose.header.frame_id == "robot1/world"
        assert odometry.child_frame_id == "robot1/ball"
        assert odometry.pose.pose == pose.pose
        t, arm, spin = seconds(odometry.header.stamp), 0.3, 2.0
        # v_O = v_C - w x r, with v_C = (0.5, 1.2) in the world, and r = (arm, 0) in the body
        turned = np.array([math.cos(spin * t), math.sin(spin * t)])
        v_C = np.array([np.dot(turned, (0.5, 1.2)), np.dot((-turned[1], turned[0]), (0.5, 1.2))])
        linear, angular = odometry.twist.twist.linear, odometry.twist.twist.angular
        np.testing.assert_allclose(vector(linear), (v_C[0], v_C[1] - spin * arm, 0), atol=1e-9)
        np.testing.assert_allclose(vector(angular), (0, 0, spin), atol=1e-10)
        assert not any(odometry.pose.covariance) and not any(odometry.twist.covariance)


def test_commands_take_the_prefixed_frames_and_no_others(sphere, start, client: Client):
    start(sphere, frame_prefix="robot1/", start_paused=True)
    applied = client.listen(WrenchStamped, "ball/wrench_applied")
    client.send(force=(1, 0, 0), frame="robot1/world")
    client.step_until(lambda: applied and applied[-1].wrench.force.x == 1.0)
    assert applied[-1].header.frame_id == "robot1/ball/origin"
    client.send(force=(2, 0, 0), frame="world")
    client.trigger("step")
    client.diagnostics(lambda values: values.get("commands unknown frame") == "1", "refusal")
    assert applied[-1].wrench.force.x == 1.0


def joint_states(
    text: str, until: float, tmp_path: Path, start, client: Client
) -> list[JointState]:
    """All messages of a scene that is stepped beyond a time [s]; those that come later, too."""
    scene = tmp_path / "scene.yaml"
    scene.write_text(text)
    start(scene, joint_states=True, start_paused=True)
    found = client.listen(JointState, "joint_states")
    client.step_until(lambda: found and seconds(found[-1].header.stamp) > until)
    return found


def test_joint_states_are_angles_against_the_parent_beyond_a_turn(
    tmp_path: Path, start, client: Client
):
    found = joint_states(TABLE, 3.0, tmp_path, start, client)
    for message in found:
        t = seconds(message.header.stamp)
        assert message.name == ["spindle", "axle"]
        np.testing.assert_allclose(message.position, [t, 3.0 * t], atol=1e-7)
        np.testing.assert_allclose(message.velocity, [1.0, 3.0], atol=1e-9)
    assert found[-1].position[1] > 3.0 * math.pi
    client.trigger("reset")
    client.until(lambda: found[-1].position[1] < 1.0, "the initial state")
    assert found[-1].position == pytest.approx([0.0, 0.0], abs=1e-12)


def test_joint_states_count_the_turns_between_two_samples(tmp_path: Path, start, client: Client):
    """A wheel at 4000 revolutions per minute turns by 4.2 rad from sample to sample: the shorter
    way, by the poses alone, would be backwards. Its motor brakes it to the other direction."""
    found = joint_states(WHEEL, 2.4, tmp_path, start, client)
    for message in found:
        t = seconds(message.header.stamp)
        angle = SPIN * t - 0.5 * BRAKING * t**2
        np.testing.assert_allclose(message.position, [angle], atol=1e-6)
        np.testing.assert_allclose(message.velocity, [SPIN - BRAKING * t], atol=1e-8)
    assert found[-1].velocity[0] < -400.0


def test_what_nobody_asked_for_is_not_there(sphere, start, client: Client):
    start(sphere, start_paused=True)
    client.listen(PoseStamped, "ball/pose")
    client.listen(TwistStamped, "ball/twist")
    topics = {name for name, _ in client.node.get_topic_names_and_types()}
    assert not topics & {f"{NAME}/ball/odometry", f"{NAME}/joint_states"}


CAD = """\
bodies:
  left-wheel: {mass: 1, inertia: [1, 1, 1], angular_velocity: [0, 0, 1]}
  2nd gear: {mass: 2, inertia: [1, 1, 1], position: [1, 0, 0]}
constraints:
  hinge:1: {type: fixed_axis, body: left-wheel, axis_B: [0, 0, 1]}
effects:
  drive: {type: commanded_wrench, body: 2nd gear}
simulation: {duration: 100, rate: 100}
"""


def test_names_from_cad_programs_are_called_as_ros_allows(tmp_path, start, client: Client):
    scene = tmp_path / "scene.yaml"
    scene.write_text(CAD)
    asked = {"joint_states": True, "odometry": True, "imu": "left_wheel", "markers": True}
    node = start(scene, robot_description=True, start_paused=True, **asked)
    line = "left-wheel -> left_wheel, 2nd gear -> x2nd_gear, hinge:1 -> hinge_1"
    assert len([each for each in node.text.splitlines() if line in each]) == 1
    joints = client.listen(JointState, "joint_states")
    applied = client.listen(WrenchStamped, "x2nd_gear/wrench_applied")
    odometry = client.listen(Odometry, "left_wheel/odometry")
    client.send(force=(1, 0, 0), frame="x2nd_gear", body="x2nd_gear")
    client.step_until(lambda: joints and odometry and applied and applied[-1].wrench.force.x == 1.0)
    assert joints[-1].name == ["hinge_1"]
    assert odometry[-1].child_frame_id == "left_wheel"
    assert applied[-1].header.frame_id == "x2nd_gear/origin"
    topics = {name for name, _ in client.node.get_topic_names_and_types()}
    assert {f"{NAME}/left_wheel/imu", f"{NAME}/reactions/hinge_1"} <= topics
    texts: list[String] = []
    latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(String, "robot_description", texts.append, latched)
    client.until(lambda: texts, "robot_description")
    robot = ElementTree.fromstring(texts[0].data)
    assert {link.get("name") for link in robot.iter("link")} == {"world", "left_wheel", "x2nd_gear"}
    assert {joint.get("name") for joint in robot.iter("joint")} == {"hinge_1", "x2nd_gear/free"}
