# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""The node under a flood of commands.

`python -m benchmarks.node_commands [--seconds S] [--rate HZ] [--commands N]`: SENDERS programs
publish N wrenches per second together, as bytes (0: as many as they can); then one sends a last
one. Shown: how many were sent per second, what the node made of them (applied: one per sample;
overtaken: a newer one was there; the rest the middleware dropped, since a queue keeps the newest
10), how many samples per second it kept, and how long the last command took to act.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from typing import Any

from benchmarks.machine import alone, describe, line
from benchmarks.node import SCENE, cpu
from benchmarks.node_requests import Client, start, stop

SENDERS = 2
LAST = 0.125
"""[N], along x: of the last command."""
SENDER = """
import json, struct, sys, time
import rclpy
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import serialize_message
rclpy.init()
node = rclpy.create_node("sender" + sys.argv[1])
publisher = node.create_publisher(WrenchStamped, "/rb_sim/ball/wrench", 1000)
message = WrenchStamped()
message.header.frame_id = "world"
message.wrench.force.y = 1.0
data = bytearray(serialize_message(message))
at = len(data) - 48
while not publisher.get_subscription_count():
    time.sleep(0.01)
time.sleep(0.5)
sent, began = 0, time.monotonic()
end = began + float(sys.argv[2])
pause = float(sys.argv[3])
while time.monotonic() < end:
    for _ in range(10):
        sent += 1
        struct.pack_into("<d", data, at, 1e-6 * (sent % 1000))
        publisher.publish(bytes(data))
    if pause:
        time.sleep(max(0.0, began + pause * sent - time.monotonic()))
print(json.dumps([sent, time.monotonic() - began]))
time.sleep(1.0)
"""


def flood(seconds: float, commands: float) -> tuple[float, int]:
    """Commands that were sent per second, and in all. commands: wanted per second; 0: any."""
    pause = SENDERS / commands if commands else 0.0
    senders = [
        subprocess.Popen(
            [sys.executable, "-c", SENDER, str(k), str(seconds), str(pause)],
            stdout=subprocess.PIPE,
        )
        for k in range(SENDERS)
    ]
    reported = [json.loads(sender.communicate()[0]) for sender in senders]
    return sum(sent / took for sent, took in reported), sum(sent for sent, _ in reported)


def counters(client: Client) -> dict[str, str]:
    """The newest values of /diagnostics."""
    from diagnostic_msgs.msg import DiagnosticArray

    heard: list[Any] = []
    subscription = client.node.create_subscription(
        DiagnosticArray, "/diagnostics", heard.append, 10
    )
    client.until(lambda: len(heard) >= 2)
    client.node.destroy_subscription(subscription)
    return {pair.key: pair.value for pair in heard[-1].status[0].values}


def last_one(client: Client) -> float:
    """[ms] from a last command until the samples show it. SystemExit: they do not."""
    from geometry_msgs.msg import WrenchStamped

    shown: list[float] = []
    message: Any = WrenchStamped()

    def hear(message: Any) -> None:
        shown.append(message.wrench.force.x)

    applied = client.node.create_subscription(
        WrenchStamped, "/rb_sim/ball/wrench_applied", hear, 10
    )
    publisher = client.node.create_publisher(WrenchStamped, "/rb_sim/ball/wrench", 10)
    client.until(lambda: publisher.get_subscription_count() and shown)
    message.header.frame_id = "world"
    message.wrench.force.x = LAST
    began = time.monotonic()
    publisher.publish(message)
    client.until(lambda: shown[-1] == LAST)
    took = time.monotonic() - began
    client.node.destroy_subscription(applied)
    client.node.destroy_publisher(publisher)
    return took * 1e3


def main() -> None:
    """Print the figures."""
    import rclpy

    parser = argparse.ArgumentParser(description="The node under a flood of commands.")
    parser.add_argument("--seconds", type=float, default=5.0, help="of the flood")
    parser.add_argument("--rate", type=float, default=1000.0, help="samples per second")
    parser.add_argument("--commands", type=float, default=20e3, help="per second; 0: any number")
    given = parser.parse_args()
    rclpy.init()
    client = Client()
    rate = ["--ros-args", "-p", f"rate:={given.rate}"]
    with alone():
        node = start([sys.executable, "-m", "rb_sim.ros.main", SCENE, *rate])
        try:
            counters(client)  # it runs
            before, spent, began = counters(client), cpu(node.pid), time.monotonic()
            sent, total = flood(given.seconds, given.commands)
            after, wall = counters(client), time.monotonic() - began
            spent = (cpu(node.pid) - spent) / wall
            took = last_one(client)
        finally:
            stop(node)
    print(line(describe()))
    took_cpu = f"the node took {spent * 100:.0f} % of a core"
    print(f"sent {sent:.0f} commands per second, {total} in all; {took_cpu}")
    for name in (
        "commands received",
        "commands applied",
        "commands overtaken",
        "samples",
        "overruns",
    ):
        print(f"{name}: {int(after.get(name, 0)) - int(before.get(name, 0))} in {wall:.1f} s")
    print(f"the last command acted after {took:.1f} ms")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
