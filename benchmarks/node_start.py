# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How soon a node that starts is seen: its state, its description, /clock, an answer.

`python -m benchmarks.node_start [--scene NAME] [--starts N] [--empty] [--logs]`: a client that is
there already notes when the first of each arrives, in wall time from starting Python and in CPU
time that the node had taken by then, in all its threads. Medians over the starts. --empty: each
with an empty cache, so that the engine compiles. --logs: with bag, recording and plots.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from benchmarks.machine import alone, describe, line
from benchmarks.node import SCENE, own_cpu

SEEN = ("state", "description", "/clock", "parameter", "running")
PATIENCE = 120.0
"""[s] for a node to be seen and to run."""
ASKING = "real_time_factor"
"""The parameter that is asked for."""


@contextmanager
def started(scene: str, values: dict[str, Any]) -> Iterator[subprocess.Popen[bytes]]:
    """A node, ended at the end of the block."""
    given = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    command = [sys.executable, "-m", "rb_sim.ros.main", scene, "--ros-args", *given]
    node = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield node
    finally:
        node.terminate()
        node.wait(PATIENCE)


def first_seen(scene: str, values: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Of each of SEEN: wall time from the start, CPU time of the node by then [s]."""
    import rclpy
    from rcl_interfaces.srv import GetParameters
    from rclpy.qos import QoSDurabilityPolicy, QoSProfile
    from rosgraph_msgs.msg import Clock
    from std_msgs.msg import String

    client = rclpy.create_node("onlooker")
    latched = QoSProfile(depth=10, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
    found: dict[str, tuple[float, float]] = {}

    def note(name: str) -> None:
        if name not in found:
            found[name] = time.monotonic() - begun, own_cpu(node.pid)

    def note_state(message: String) -> None:
        note("state")
        if message.data == "running":
            note("running")

    client.create_subscription(String, "/rb_sim/state", note_state, latched)
    client.create_subscription(
        String, "/rb_sim/description", lambda _: note("description"), latched
    )
    client.create_subscription(Clock, "/clock", lambda _: note("/clock"), 10)
    asked = client.create_client(GetParameters, "/rb_sim/get_parameters")
    rclpy.spin_once(client, timeout_sec=1.0)
    begun, answer = time.monotonic(), None
    with started(scene, values) as node:
        while len(found) < len(SEEN):
            if time.monotonic() - begun > PATIENCE or node.poll() is not None:
                raise SystemExit(f"seen: {', '.join(found) or 'nothing'}, and no more")
            rclpy.spin_once(client, timeout_sec=0.01)
            if answer is None and asked.service_is_ready():
                answer = asked.call_async(GetParameters.Request(names=[ASKING]))
            if answer is not None and answer.done():
                note("parameter")
    client.destroy_node()
    return found


def main() -> None:
    """Measure and print."""
    import rclpy

    parser = argparse.ArgumentParser(prog="python -m benchmarks.node_start")
    parser.add_argument("--scene", default=SCENE)
    parser.add_argument("--starts", type=int, default=5)
    parser.add_argument("--empty", action="store_true", help="an empty cache each time")
    parser.add_argument("--logs", action="store_true", help="with bag, recording and plots")
    given = parser.parse_args()
    every = []
    with alone(), tempfile.TemporaryDirectory() as folder:
        print(line(describe()))
        rclpy.init()
        for k in range(given.starts):
            if given.empty:
                os.environ["RB_SIM_CACHE"] = f"{folder}/cache{k}"
            values = {"out": f"{folder}/run{k}"} if given.logs else {}
            every.append(first_seen(given.scene, values))
        rclpy.shutdown()
    for name in SEEN:
        wall, cpu = zip(*(one[name] for one in every), strict=True)
        print(
            f"{name:12s} wall {statistics.median(wall):.2f} s ({min(wall):.2f} to {max(wall):.2f}),"
            f" CPU {statistics.median(cpu):.2f} s ({min(cpu):.2f} to {max(cpu):.2f})"
        )


if __name__ == "__main__":
    main()
