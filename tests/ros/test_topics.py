# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What the node publishes: names, types, stamps, frames, numbers."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String, UInt8

from rb_sim import Simulation
from rb_sim.ros.topics.topic_sink import TopicSink
from tests.ros import bags
from tests.ros.client import NAME, Client, seconds, vector

# A body whose centre of mass lies 0.3 m from its origin O, free: C moves uniformly, and with all
# moments of inertia equal the spin is constant, so O = C - R r_OC in closed form.
OFFSET = """\
bodies:
  ball:
    mass: 2.0
    inertia: [0.1, 0.1, 0.1]
    center_of_mass: [0.3, 0.0, 0.0]
    position: [0.0, 0.0, 0.0]
    linear_velocity: [0.5, 0.6, 0.0]
    angular_velocity: [0.0, 0.0, 2.0]
effects:
  drive: {type: commanded_wrench, body: ball}
simulation: {duration: 1.0, method: dopri853, tolerance: 1.0e-12, rate: 50}
"""


# A ball dropped from h = 0.05 m on a floor with restitution 0.5.
BOUNCE = """\
bodies:
  ball: {mass: 0.5, shape: {type: sphere, radius: 0.05}, position: [0, 0, 0.1]}
  puck: {mass: 1.0, inertia: [0.1, 0.1, 0.1], position: [1, 0, 0]}
constraints:
  floor: {type: contact, body: ball, restitution: 0.5}
  ice: {type: contact, body: puck, points: [[0.2, 0, 0], [-0.1, 0.1, 0], [-0.1, -0.1, 0]]}
effects:
  weight: {type: gravity, acceleration: [0, 0, -9.81]}
simulation: {duration: 100.0, rate: 50, tolerance: 1.0e-10}
"""


@pytest.fixture
def offset(tmp_path: Path) -> Path:
    path = tmp_path / "offset.yaml"
    path.write_text(OFFSET)
    return path


def test_a_command_acts_at_the_body_origin_not_at_the_centre_of_mass(
    offset, start, client: Client, tmp_path
):
    """m a_C = F and I alpha = -r x F, at the first step, about C."""
    node = start(offset, out=tmp_path, start_paused=True, rate=1000)
    client.send(force=(0.0, 4.0, 0.0))
    assert client.trigger("step").success
    assert client.trigger("step").success
    assert node.stop() == 0
    twist = bags.read(tmp_path / "bag")[f"{NAME}/ball/twist"].twist
    r, dt = 0.3, 1e-3
    alpha = -r * 4.0 / 0.1  # torque of F at O about C: (-r) x F, over I
    assert (twist[1, 5] - twist[0, 5]) / dt == pytest.approx(alpha, rel=1e-4)


def test_the_topics_and_the_bag_hold_the_same_bytes(sphere, start, client: Client, tmp_path):
    node = start(sphere, out=tmp_path, start_paused=True, odometry=True)
    kinds = {"ball/pose": PoseStamped, "reactions/floor": WrenchStamped, "ball/odometry": Odometry}
    received = {topic: client.listen(kind, topic, raw=True) for topic, kind in kinds.items()}
    client.send(force=(1.0, 2.0, 0.0), torque=(0.0, 0.1, 0.2))
    client.step_until(lambda: all(len(messages) >= 5 for messages in received.values()))
    client.pause(False)
    client.until(lambda: all(len(messages) >= 15 for messages in received.values()), "samples")
    stopped = float(client.pause(True).message.split()[4])

    def all_here() -> bool:  # samples that were sent before
        last = [deserialize_message(received[topic][-1], kinds[topic]) for topic in kinds]
        return all(seconds(message.header.stamp) > stopped - 1e-6 for message in last)

    client.until(all_here, "the last samples")
    assert node.stop() == 0
    recorded = bags.read(tmp_path / "bag")
    states = [message.data for message in recorded[f"{NAME}/state"].messages]
    assert states[:3] == ["paused", "running", "paused"]
    for topic, messages in received.items():
        raw = recorded[f"{NAME}/{topic}"].raw
        places = [raw.index(bytes(m)) for m in messages]  # each is in the bag, ...
        assert places == sorted(places)  # ... one once that a late joiner gets again in a pause


def test_states_work_and_events_of_contacts(
    start, client: Client, tmp_path, monkeypatch: pytest.MonkeyPatch
):
    """The first impact is at sqrt(2 h / g), with the impulse m (1 + e) sqrt(2 g h)."""
    monkeypatch.setenv("RB_SIM_INTERPRETED", "1")  # compiling takes longer than these few steps
    path = tmp_path / "bounce.yaml"
    path.write_text(BOUNCE)
    node = start(path, out=tmp_path, start_paused=True)
    events = client.listen(DiagnosticArray, "contact_events")
    raw = client.listen(DiagnosticArray, "contact_events", raw=True)
    states = client.listen(UInt8, "contacts/floor/state")
    points = client.listen(UInt8, "contacts/ice/point_2/state")
    work = client.listen(Float64, "contact_work")
    reactions = client.listen(WrenchStamped, "reactions/ice/point_2")
    impacts: list[DiagnosticArray] = []
    for _ in range(20):  # a subscription that is still being matched gets nothing
        client.trigger("reset")
        for _ in range(6):
            client.trigger("step")
        client.spin(0.1)
        reported = [array for array in events if array.status[0].name == "floor"]
        impacts = [array for array in reported if array.status[0].message == "impact"]
        if impacts and work and states and points and reactions:
            break
    client.until_it_stands(client.listen(Clock, "/clock"))  # with all that was sent before
    v, g = math.sqrt(2.0 * 9.81 * 0.05), 9.81
    (last,) = impacts[-1].status
    since_reset = seconds(impacts[-1].header.stamp) - v / g  # stamps go on at a reset
    assert 50.0 * since_reset == pytest.approx(round(50.0 * since_reset), abs=1e-6)
    values = {pair.key: float(pair.value) for pair in last.values}
    assert values["t"] == pytest.approx(seconds(impacts[-1].header.stamp), abs=1e-9)
    assert values["impulse_z"] == pytest.approx(0.5 * 1.5 * v, rel=1e-10)
    assert work[-1].data == pytest.approx(-0.75 * 0.5 * g * 0.05, rel=1e-9)
    assert states[-1].data == 0 and points[-1].data == 1
    assert reactions[-1].wrench.force.z == pytest.approx(g / 3.0, rel=1e-9)
    assert node.stop() == 0
    recorded = bags.read(tmp_path / "bag")[f"{NAME}/contact_events"]
    assert bytes(raw[-1]).startswith(recorded.raw[-1])  # DDS fills up to four bytes
    closed = [m.status[0].name for m in recorded.messages if m.status[0].message == "closes"]
    assert closed[:3] == ["ice/1", "ice/2", "ice/3"]


def test_two_nodes_in_one_domain_do_not_disturb_each_other(sphere, start, client: Client):
    """One tells the time, the other stands still beside it."""
    start(sphere, ros=("-r", "__ns:=/one"), tf=False)
    start(sphere, ros=("-r", "__ns:=/two"), tf=False, publish_clock=False, start_paused=True)
    clocks = client.listen(Clock, "/clock")
    energy = client.listen(Float64, "/one/rb_sim/energy")
    still = client.listen(Float64, "/two/rb_sim/energy")
    client.until(lambda: len(clocks) >= 50 and len(energy) >= 20, "time")
    assert len(still) <= 1  # the last sample, for who comes in a pause
    (info,) = client.node.get_publishers_info_by_topic("/clock")
    assert info.node_namespace == "/one"
    assert client.node.count_publishers("/tf") == 0
    times = [seconds(message.clock) for message in clocks]
    assert times == sorted(set(times))


@pytest.mark.parametrize(
    ("broken", "words"),
    [
        ("class TFMessage:\n    pass\n", "should be a ROS 2 message type"),
        ("raise OSError('libtf2_msgs.so: undefined symbol: x')\n", "undefined symbol: x"),
    ],
)
def test_a_tf2_msgs_that_cannot_be_loaded_costs_its_topic_alone(
    broken: str, words: str, context, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line says so, and blames nothing else; all other topics are there."""
    (tmp_path / "tf2_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "tf2_msgs" / "__init__.py").touch()
    (tmp_path / "tf2_msgs" / "msg" / "__init__.py").write_text(broken)
    monkeypatch.syspath_prepend(str(tmp_path))
    # what is imported here is gone afterwards, and one that was there before is there again
    monkeypatch.setitem(sys.modules, "tf2_msgs", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == "tf2_msgs"]:
        monkeypatch.delitem(sys.modules, name)
    said: list[str] = []
    monkeypatch.setattr(Node, "get_logger", lambda _: SimpleNamespace(warning=said.append))
    node = Node("rb_sim", context=context)
    simulation = Simulation("rolling_sphere_commanded", announce=None)
    sink = TopicSink(node, 10)
    sink.open(simulation.scene, simulation.layout)
    topics = {name for name, _ in node.get_publisher_names_and_types_by_node("rb_sim", "/")}
    sink.close()
    node.destroy_node()
    (line,) = said
    assert "no topic /tf" in line and words in line and "qos_overrides" not in line
    assert "/tf" not in topics and {"/clock", f"{NAME}/ball/pose"} <= topics


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
    # commands take the prefixed frames and no others
    applied = client.listen(WrenchStamped, "ball/wrench_applied")
    client.send(force=(1, 0, 0), frame="robot1/world")
    client.step_until(lambda: applied and applied[-1].wrench.force.x == 1.0)
    assert applied[-1].header.frame_id == "robot1/ball/origin"
    client.send(force=(2, 0, 0), frame="world")
    client.trigger("step")
    client.diagnostics(lambda values: values.get("commands unknown frame") == "1", "refusal")
    assert applied[-1].wrench.force.x == 1.0


def test_joint_states_are_angles_against_the_parent_beyond_a_turn(
    tmp_path: Path, start, client: Client
):
    scene = tmp_path / "scene.yaml"
    scene.write_text(TABLE)
    node = start(scene, joint_states=True, start_paused=True)
    found = client.listen(JointState, "joint_states")
    # no body is commanded: none has a topic for it
    assert "takes commands on: nothing (no commanded_wrench in the scene)" in node.text
    topics = [name for name, _ in client.node.get_topic_names_and_types()]
    assert not any(name.endswith("/wrench") for name in topics)
    client.step_until(lambda: found and seconds(found[-1].header.stamp) > 3.0)
    for message in found:
        t = seconds(message.header.stamp)
        assert message.name == ["spindle", "axle"]
        np.testing.assert_allclose(message.position, [t, 3.0 * t], atol=1e-7)
        np.testing.assert_allclose(message.velocity, [1.0, 3.0], atol=1e-9)
    assert found[-1].position[1] > 3.0 * math.pi
    client.trigger("reset")
    client.until(lambda: found[-1].position[1] < 1.0, "the initial state")
    assert found[-1].position == pytest.approx([0.0, 0.0], abs=1e-12)


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
