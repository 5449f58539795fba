# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Names of topics and frames in the table of topics (`topics.py`).

Arguments are names in the scene; characters that ROS does not allow are replaced
(`rb_sim.base.names`).
"""

from __future__ import annotations

from rb_sim.base.names import ros_name

NAMESPACE = "/rb_sim"
WORLD = "world"
TF = "/tf"
CLOCK = "/clock"
CONTACT_WORK = "contact_work"
CONTACT_EVENTS = "contact_events"
RESETS = "resets"
JOINT_STATES = "joint_states"
DESCRIPTION = "description"
ROBOT_DESCRIPTION = "robot_description"
MARKERS = "markers"
STATE = "state"
STATE_COMMAND = "state_command"


def topic_path(name: str) -> str:
    """Part of a topic name for a reaction or contact point."""
    own, *parts = name.split("/")
    points = (f"point_{part}" if part[0].isdigit() else part for part in parts)
    return "/".join((ros_name(own), *points))


def body_topic(body: str, what: str) -> str:
    """Topic of a body's quantity, e.g. BODY/pose."""
    return f"{ros_name(body)}/{what}"


def body_frame(body: str) -> str:
    """Frame of a body: at its origin, with its axes."""
    return ros_name(body)


def state_topic(contact: str) -> str:
    """Topic of the state of a contact point."""
    return f"contacts/{topic_path(contact)}/state"


def reaction_topic(reaction: str) -> str:
    """Topic of a reaction."""
    return f"reactions/{topic_path(reaction)}"


def origin_frame(body: str) -> str:
    """Frame with world axes at the origin of `body`."""
    return f"{body_frame(body)}/origin"


def anchor_frame(reaction: str) -> str:
    """Frame with world axes at the anchor of `reaction`."""
    own, *parts = reaction.split("/")
    return "/".join((ros_name(own), *parts, "anchor"))


def command_topic(body: str) -> str:
    """Topic of the commands for a body, as received."""
    return body_topic(body, "wrench_command")
