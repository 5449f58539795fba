# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""Commanded wrenches: frames, refusals, hold, timeout, the step at which they act."""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message

from rb_sim.cli.verbs.resim import ResimOptions, resim
from rb_sim.ros.serving import executor_for
from rb_sim.ros.topics import command, inbox
from tests.ros import bags
from tests.ros.client import NAME, Client

MANY = inbox.DEPTH * 9 // 10
"""Commands at once, of which none may be lost while the node is kept from running."""

# turned a quarter about z: the body's x axis is the world's y axis
TURNED = """\
bodies:
  ball:
    mass: 2.0
    inertia: [0.1, 0.1, 0.1]
    orientation: {axis: [0, 0, 1], angle: 1.5707963267948966}
effects:
  drive: {type: commanded_wrench, body: ball}
simulation: {duration: 1.0, method: dopri853, tolerance: 1.0e-12, rate: 100}
"""


def applied(folder: Path) -> np.ndarray:
    """The wrench in each sample of a bag, (n, 6)."""
    return bags.read(folder / "bag")[f"{NAME}/ball/wrench_applied"].wrench


def test_equal_commands_are_recorded_as_they_came_each_with_its_stamp(
    sphere, start, client: Client, tmp_path
):
    """A controller that repeats itself is seen to be alive: a command equal to the one in force is
    recorded with the time from which on it acts, and so is one of zero before any other."""
    node = start(sphere, out=tmp_path, start_paused=True)
    for push in (0, 2, 2, None, 2, 2, 0, 0):
        if push is not None:
            client.send(force=(push, 0, 0))
        client.trigger("step")
    assert node.stop() == 0
    sent = bags.read(tmp_path / "bag")[f"{NAME}/ball/wrench_command"]
    np.testing.assert_array_equal(sent.wrench[:, 0], [0, 2, 2, 2, 2, 0, 0])
    np.testing.assert_allclose(sent.t, 0.01 * np.array([0, 1, 2, 4, 5, 6, 7]), atol=1e-9)
    np.testing.assert_array_equal(applied(tmp_path)[:, 0], [0, 0, 2, 2, 2, 2, 2, 0, 0])


BAD = [
    ("map", (1, 0, 0), command.UNKNOWN_FRAME, "frame_id 'map' is neither 'world' nor 'ball'"),
    ("x" * 5000, (1, 0, 0), command.UNKNOWN_FRAME, "xxx... (5000 characters) is neither"),
    ("", (1, 0, 0), command.NO_FRAME, "frame_id is empty; must be 'world' or 'ball'"),
    ("ball/origin", (1, 0, 0), command.OWN_FRAME, "'ball/origin' is a frame that the node"),
    ("floor/anchor", (1, 0, 0), command.OWN_FRAME, "'floor/anchor' is a frame that the node"),
    ("world", (math.nan, 0, 0), command.NOT_FINITE, "is not a finite number"),
    ("world", (0, -math.inf, 0), command.NOT_FINITE, "is not a finite number"),
    ("world", (0, 0, -1e101), command.TOO_STRONG, "a component is beyond 1e+100"),
]


def test_bad_commands_are_refused_and_counted(sphere, start, client: Client, tmp_path):
    """Each twice: said once, counted twice; those before go on acting."""
    node = start(sphere, out=tmp_path, start_paused=True)
    for push in (1, 2, 3):  # the newest counts
        client.send(force=(push, 0, 0))
    client.trigger("step")
    for frame, force, _, _ in BAD:
        client.send(force=force, frame=frame)
        client.send(force=force, frame=frame)
    client.trigger("step")
    counts = Counter(f"commands {reason}" for _, _, reason, _ in BAD)
    counts[f"commands {command.OVERTAKEN}"] = 1  # of two
    values = client.diagnostics(
        lambda v: all(v.get(reason) == str(2 * count) for reason, count in counts.items()), "counts"
    )
    assert values["commands applied"] == "1"
    assert node.stop() == 0
    for _, _, _, line in BAD:
        assert node.text.count(line) == 1, line
    np.testing.assert_array_equal(applied(tmp_path)[:, 0], [0, 3, 3])


def test_refusals_that_go_on_are_reported_again_with_their_number(
    client: Client, polling_node, monkeypatch
):
    """Also where the frame is a new one each time, of which a hundred are told by name."""
    said: list[str] = []
    now = [100.0]
    monkeypatch.setattr(command, "time", SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(inbox.PollingNode, "get_logger", lambda _: Heard(said))
    commands = command.Commands(polling_node, ["ball"])

    def reported(frames: list[str]) -> list[str]:
        said.clear()
        total = commands.received + len(frames)
        for frame in frames:
            client.send(frame=frame)
        while commands.received < total:
            commands.collect()
        return [line.removeprefix("ball/wrench refused: ") for line in said]

    first = reported(["map", "map", "odom", ""])
    assert [line[:21] for line in first] == [
        "frame_id 'map' is nei",
        "frame_id 'odom' is ne",
        "frame_id is empty; mu",
    ]
    assert not any("so far" in line for line in first)
    now[0] += command.REMINDER
    again = reported(["map", "map", ""])
    assert [line[-25:] for line in again] == [
        " (4 unknown frame so far)",
        "ball' (2 no frame so far)",
    ]
    reported([f"frame_{k}" for k in range(command.MOST_KINDS)])
    reported([f"other_{k}" for k in range(3)])
    now[0] += command.REMINDER
    (line,) = reported([f"another_{k}" for k in range(3)])
    assert "'another_0' is neither" in line and line.endswith("(109 unknown frame so far)")


class Heard:
    """A logger that keeps the warnings."""

    def __init__(self, said: list[str]) -> None:
        self.warning = said.append


def test_a_huge_command_ends_the_run_with_one_line_if_asked(
    sphere, start, client: Client, tmp_path
):
    node = start(
        sphere,
        out=tmp_path,
        real_time_factor=100,  # as fast as it can, the bag would be long when the command comes
        method="rk4",
        step=0.01,
        exit_on_error=True,
    )
    client.send(force=(1e100, 1e100, 0), torque=(1e100, 1e100, 1e100))  # the most that is taken
    assert node.wait() == 1
    assert "Traceback" not in node.text and "no longer finite" in node.text
    starts = [line for line in node.text.splitlines() if "[INFO]" in line][0]
    assert "looks 0 s for another node of this name" in starts
    assert len(applied(tmp_path)) >= 1


@pytest.mark.parametrize("by_handle", [True, False])
def test_both_ways_to_take_messages_lose_none(by_handle, client: Client, context, monkeypatch):
    """take_message is undocumented; without it the executor that spins the node fills the inbox."""
    monkeypatch.setattr(inbox, "_can_take", lambda: by_handle)
    node = Node("rb_sim", context=context)
    client._executor.add_node(node)
    own = inbox.Inbox(node, "~/ball/wrench", inbox.Polled())
    taken: list[bytes] = []

    def all_here() -> bool:
        taken.extend(own.take())
        return len(taken) == 5

    for k in range(5):
        publisher = client.commander()
        message = WrenchStamped()
        message.wrench.force.x = float(k)
        publisher.publish(message)
    client.until(all_here, "5 commands")
    messages = [deserialize_message(data, WrenchStamped) for data in taken]
    assert [message.wrench.force.x for message in messages] == [0, 1, 2, 3, 4]
    client._executor.remove_node(node)
    node.destroy_node()


@pytest.fixture
def polling_node(context) -> Iterator[inbox.PollingNode]:
    """A node of the name that clients expect, in this process."""
    node = inbox.PollingNode("rb_sim", context=context)
    yield node
    node.destroy_node()


def test_no_executor_takes_a_command(client: Client, polling_node):
    """Taken by two threads, an older command could come behind a newer one."""
    node = polling_node
    taken_by_executor: list[WrenchStamped] = []

    def note(message: WrenchStamped) -> None:
        taken_by_executor.append(message)

    subscription = node.create_subscription(
        WrenchStamped, "~/ball/wrench", note, 10, callback_group=inbox.Polled()
    )
    executor = executor_for(node)
    executor.add_node(node)
    for _ in range(5):
        client.send()
    for _ in range(50):
        executor.spin_once(timeout_sec=0.01)
    assert not taken_by_executor
    with subscription.handle:
        assert subscription.handle.take_message(WrenchStamped, False)
    executor.remove_node(node)
    executor.shutdown()
    node.destroy_subscription(subscription)


@pytest.mark.parametrize("frame", ["world", "robot1/world", "robot1/ball", "robot1/wor", ""])
def test_numbers_are_read_from_the_bytes_of_a_message(frame):
    """Wherever the text before them puts them; the other order of bytes is read by rclpy."""
    message = WrenchStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = 7, 256
    for vector, first in ((message.wrench.force, 1.0), (message.wrench.torque, 4.0)):
        vector.x, vector.y, vector.z = first, first + 1.0, first + 2.0
    data = serialize_message(message)
    reader = command.Reader("ball", "robot1/")
    found = reader.read(data)
    axes = {"robot1/world": "world", "robot1/ball": "body"}.get(frame)
    if axes is None:
        assert isinstance(found, command.Refusal)
    else:
        assert found == command.Command(axes, (1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    cut = reader.read(data[:40])
    assert isinstance(cut, command.Refusal) and cut.reason == command.UNREADABLE


def test_a_message_in_the_other_order_of_bytes_is_read():
    text = struct.pack(">iII", 7, 256, 6) + b"world\0"
    numbers = struct.pack(">6d", 1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    data = b"\0\0\0\0" + text + bytes(-len(text) % 8) + numbers
    assert command.Reader("ball").read(data) == command.Command(
        "world", (1.0, 2.0, 3.0), (4.0, 5.0, 6.0)
    )


def test_every_command_is_counted_however_rare_samples_are(sphere, start, client: Client):
    """A hundred seconds between samples: the queue of the middleware is emptied in between."""
    start(sphere, rate=0.01)
    publisher = client.commander(depth=MANY)
    data = bytes(serialize_message(WrenchStamped()))
    for sent in range(MANY, 4 * inbox.DEPTH, MANY):
        for _ in range(MANY):
            publisher.publish(data)
        values = client.diagnostics(lambda v, n=sent: int(v["commands received"]) >= n, "all")
        assert values["commands received"] == values["commands no frame"] == str(sent)
        assert values["commands applied"] == values["samples"] == "0"


def test_what_a_node_recorded_is_simulated_again_to_the_last_bit(
    start, client: Client, tmp_path: Path, capsys
):
    """Held commands in body axes, which turn with the body, a reset, a timeout."""
    scene = tmp_path / "turned.yaml"
    scene.write_text(TURNED)
    node = start(scene, out=tmp_path, start_paused=True, wrench_timeout=0.05)
    client.send(force=(4, 0, 1), torque=(0.1, 0.2, 0.3), frame="ball")
    for _ in range(8):
        client.trigger("step")
    client.trigger("reset")
    client.send(force=(0, 1, 0), torque=(0.1, 0, 0))
    for _ in range(4):
        client.trigger("step")
    assert node.stop() == 0
    assert "no command for 0.05 s: the wrench is now zero" in node.text
    wrench = applied(tmp_path)
    # in the first step the torque turns it by less than 1e-3 rad
    np.testing.assert_allclose(wrench[1], [0, 4, 1, -0.2, 0.1, 0.3], atol=2e-3)
    np.testing.assert_array_equal(wrench.any(axis=1), [0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 1, 1, 1, 1])
    twist = bags.read(tmp_path / "bag")[f"{NAME}/ball/twist"].twist
    np.testing.assert_allclose(twist[1, :3], [0, 0.01 * 4 / 2.0, 0.01 * 1 / 2.0], atol=1e-5)
    assert resim(ResimOptions(tmp_path / "bag")) == 0
    assert "14 of 14 samples are identical" in capsys.readouterr().out
