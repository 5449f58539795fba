# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""What reaches a subscriber: overrides of QoS, bursts of events, and /tf beside the poses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.qos import (
    QoSDurabilityPolicy,
    QoSHistoryPolicy,
    QoSProfile,
    QoSReliabilityPolicy,
)

from tests.ros import bags
from tests.ros.client import NAME, Client, seconds

# A lively ball: its bounces, one in a hundred samples, all come between two of these samples.
LIVELY = """\
bodies:
  ball: {mass: 0.5, shape: {type: sphere, radius: 0.05}, position: [0, 0, 0.1]}
constraints:
  floor: {type: contact, body: ball, restitution: 0.9}
effects:
  weight: {type: gravity}
simulation: {duration: 100.0, rate: 0.25, tolerance: 1.0e-10}
"""
MANY = QoSProfile(depth=10_000, history=QoSHistoryPolicy.KEEP_LAST)
OVERRIDES = "qos_overrides./rb_sim/ball/pose.publisher"


def test_the_standard_parameters_override_the_quality_of_service(sphere, start, client: Client):
    overrides = (
        "-p", f"{OVERRIDES}.durability:=transient_local", "-p", f"{OVERRIDES}.depth:=3",
        "-p", "qos_overrides./rb_sim/ball/twist.publisher.reliability:=best_effort",
        "-p", "qos_overrides./rb_sim/ball/wrench.subscription.reliability:=best_effort",
        "-p", "qos_overrides./diagnostics.publisher.reliability:=best_effort",
    )  # fmt: skip
    start(sphere, start_paused=True, ros=overrides, odometry=True, joint_states=True,
          accelerations=True, imu="ball", markers=True, robot_description=True)  # fmt: skip
    for _ in range(5):
        assert client.trigger("step").success
    late: list[Any] = []
    latched = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(PoseStamped, f"{NAME}/ball/pose", late.append, latched)
    client.until(lambda: len(late) >= 3, "what a late joiner gets")
    stamps = [message.header.stamp.nanosec for message in late]
    # the last three that were published; in a pause the last one is published again
    assert stamps == sorted(stamps) and stamps[-1] == 50_000_000
    assert set(stamps) <= {30_000_000, 40_000_000, 50_000_000}
    (twist,) = client.node.get_publishers_info_by_topic(f"{NAME}/ball/twist")
    assert twist.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    (wrench,) = client.node.get_subscriptions_info_by_topic(f"{NAME}/ball/wrench")
    assert wrench.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    (report,) = client.node.get_publishers_info_by_topic("/diagnostics")
    assert report.qos_profile.reliability == QoSReliabilityPolicy.BEST_EFFORT
    asked = client.call(ListParameters, "list_parameters", prefixes=["qos_overrides"], depth=0)
    overridable = {name.removeprefix("qos_overrides.").split(".")[0] for name in asked.result.names}
    topics = client.node.get_publisher_names_and_types_by_node("rb_sim", "/")
    theirs = {"/rosout", "/parameter_events"}  # of rclpy itself
    assert {name for name, _ in topics} - overridable == theirs


def test_no_event_of_a_cascade_is_lost(tmp_path: Path, start, client: Client):
    scene = tmp_path / "lively.yaml"
    scene.write_text(LIVELY)
    node = start(scene, out=tmp_path / "run", start_paused=True)
    events: list[DiagnosticArray] = []
    name = f"{NAME}/contact_events"
    client.node.create_subscription(DiagnosticArray, name, events.append, MANY)
    client.until(lambda: client.node.count_publishers(name), "events")
    # a machine that is quick enough loses none with a depth of 10 either
    asked = client.call(
        GetParameters, "get_parameters", names=[f"qos_overrides.{name}.publisher.depth"]
    )
    assert asked.values[0].integer_value >= 10_000
    while not events:  # the subscription is still being matched
        assert client.trigger("reset").success and client.trigger("step").success
        client.spin(0.2)
    begun = float(client.trigger("reset").message.split("t = ")[1].split()[0])
    assert client.trigger("step").success
    assert node.stop() == 0

    def of_the_last_step(messages: list[Any]) -> list[Any]:
        return [message for message in messages if seconds(message.header.stamp) > begun]

    recorded = of_the_last_step(bags.read(tmp_path / "run" / "bag")[name].messages)
    assert len(recorded) > 50
    client.until(lambda: len(of_the_last_step(events)) >= len(recorded), "all events")

    def reported(messages: list[Any]) -> list[tuple[str, str]]:
        return sorted((m.status[0].values[0].value, m.status[0].message) for m in messages)

    assert reported(of_the_last_step(events)) == reported(recorded)
