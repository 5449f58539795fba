# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""A program without ROS: speaks DDS by Eclipse Cyclone, reads poses and sends a wrench.

`python dds_client.py DOMAIN COUNT`: prints one line of JSON: the stamps and positions of the COUNT
poses that came first, and the force and stamp of the first sample that shows its command.
"""

import json
import os
import sys
import time
from dataclasses import dataclass, field

# Before cyclonedds is imported; ROS speaks to this machine alone here, by unicast.
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
  <General><Interfaces><NetworkInterface name="lo" multicast="false"/></Interfaces>
    <AllowMulticast>false</AllowMulticast></General>
  <Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>60
    </MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""

from cyclonedds.core import Policy, Qos  # noqa: E402
from cyclonedds.domain import DomainParticipant  # noqa: E402
from cyclonedds.idl import IdlStruct, annotations  # noqa: E402
from cyclonedds.idl.types import float64, int32, uint32  # noqa: E402
from cyclonedds.pub import DataWriter  # noqa: E402
from cyclonedds.sub import DataReader  # noqa: E402
from cyclonedds.topic import Topic  # noqa: E402
from cyclonedds.util import duration  # noqa: E402

PATIENCE = 60.0
"""[s] for everything."""
FORCE = 1.5
"""[N], along x."""
QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=10)),
    Policy.History.KeepLast(1000),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)


@dataclass
@annotations.final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
@annotations.final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
@annotations.final
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@annotations.final
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0


@dataclass
@annotations.final
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64 = 0.0
    y: float64 = 0.0
    z: float64 = 0.0
    w: float64 = 1.0


@dataclass
@annotations.final
class Pose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
@annotations.final
class PoseStamped(IdlStruct, typename="geometry_msgs::msg::dds_::PoseStamped_"):
    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
@annotations.final
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    force: Vector = field(default_factory=Vector)
    torque: Vector = field(default_factory=Vector)


@dataclass
@annotations.final
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    header: Header = field(default_factory=Header)
    wrench: Wrench = field(default_factory=Wrench)


def main() -> None:
    """See the module."""
    domain, count = int(sys.argv[1]), int(sys.argv[2])
    end = time.monotonic() + PATIENCE
    participant = DomainParticipant(domain)

    def topic(name: str, kind: type) -> Topic:
        return Topic(participant, f"rt/rb_sim/ball/{name}", kind, qos=QOS)

    poses = DataReader(participant, topic("pose", PoseStamped), qos=QOS)
    applied = DataReader(participant, topic("wrench_applied", WrenchStamped), qos=QOS)
    writer = DataWriter(participant, topic("wrench", WrenchStamped), qos=QOS)
    seen: list[PoseStamped] = []
    while len(seen) < count or not writer.get_matched_subscriptions():
        assert time.monotonic() < end, f"{len(seen)} poses"
        seen += poses.take(N=100)
        time.sleep(0.005)
    writer.write(WrenchStamped(Header(frame_id="world"), Wrench(force=Vector(x=FORCE))))
    shown: list[WrenchStamped] = []
    while not shown:
        assert time.monotonic() < end, "the wrench never shows"
        shown = [one for one in applied.take(N=100) if one.wrench.force.x]
        time.sleep(0.005)
    stamps = [one.header.stamp for one in seen]
    print(json.dumps({
        "frame": seen[0].header.frame_id,
        "t": [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps],
        "z": [one.pose.position.z for one in seen],
        "force": shown[0].wrench.force.x,
        "applied_frame": shown[0].header.frame_id,
    }))  # fmt: skip


if __name__ == "__main__":
    main()
