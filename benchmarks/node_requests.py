# Copyright 2026 rb_sim contributors
# Licensed under the Apache License, Version 2.0 (the "License"); you may not use this file except
# in compliance with the License. You may obtain a copy of the License at
# http://www.apache.org/licenses/LICENSE-2.0
# Unless required by applicable law or agreed to in writing, software distributed under the License
# is distributed on an "AS IS" BASIS, WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express
# or implied. See the License for the specific language governing permissions and limitations under
# the License.

"""How soon the node answers: a wrench until it shows, beside a bare echo, and lockstep requests.

`python -m benchmarks.node_requests [--count N] [--rate HZ]`: latencies from a wrench to the first
message that shows it, of the node at this rate and of a bare rclpy program that publishes on
receipt; then requests of ~/advance with one sample each, per second, and the CPU that the node
spends on each: from one rclpy client that waits for every answer, from one that has WAITING
requests on the way, so that the node and not the client sets the pace, and from a client in C
(lockstep_client.c) that waits for every answer, where there is a compiler.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import lockstep_client
from benchmarks.machine import alone, describe, line
from benchmarks.node import SCENE, cpu

ECHO = """
import rclpy
from geometry_msgs.msg import WrenchStamped
rclpy.init()
node = rclpy.create_node("rb_sim")
publisher = node.create_publisher(WrenchStamped, "~/ball/wrench_applied", 10)
node.create_subscription(WrenchStamped, "~/ball/wrench", publisher.publish, 10)
rclpy.spin(node)
"""
WAITING = 8
"""Requests on the way at once."""
WARM = 20
"""Requests before those that count."""
PATIENCE = 120.0
"""[s] for a program to be there, and for each answer."""


class Client:
    """A node that waits for things."""

    def __init__(self) -> None:
        import rclpy

        from rb_sim.ros.serving import executor_for

        self.node = rclpy.create_node("client")
        self._executor = executor_for(self.node)
        self._executor.add_node(self.node)

    def until(self, condition: Callable[[], Any]) -> None:
        """Spin until it holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            if time.monotonic() > end:
                raise SystemExit("no answer")
            self._executor.spin_once(timeout_sec=0.05)


def latencies(client: Client, count: int) -> np.ndarray:
    """From a wrench sent to its force seen in BODY/wrench_applied [ms]."""
    from geometry_msgs.msg import WrenchStamped

    shown: list[float] = []

    def hear(message: Any) -> None:
        shown.append(message.wrench.force.x)

    applied = client.node.create_subscription(
        WrenchStamped, "/rb_sim/ball/wrench_applied", hear, 10
    )
    publisher = client.node.create_publisher(WrenchStamped, "/rb_sim/ball/wrench", 10)
    client.until(publisher.get_subscription_count)
    client.until(lambda: client.node.count_publishers("/rb_sim/ball/wrench_applied"))
    command, found = WrenchStamped(), []
    command.header.frame_id = "world"
    for k in range(1, count + 1):
        command.wrench.force.x = 1e-6 * k
        time.sleep(0.0137)  # at no fixed place between two samples
        began = time.monotonic()
        publisher.publish(command)
        client.until(lambda force=command.wrench.force.x: shown and shown[-1] == force)
        found.append(time.monotonic() - began)
    client.node.destroy_publisher(publisher)
    client.node.destroy_subscription(applied)
    return np.array(found[count // 10 :]) * 1e3


def requests(client: Client, pid: int, count: int, waiting: int) -> tuple[float, float]:
    """Requests per second, and CPU of the node for each [us]. waiting: on the way at once."""
    from rb_sim_interfaces.srv import Advance  # type: ignore[import-not-found]

    service = client.node.create_client(Advance, "/rb_sim/advance")
    client.until(service.service_is_ready)
    on_the_way: deque[Any] = deque()
    for k in range(count + WARM):
        if k == WARM:
            began, spent = time.monotonic(), cpu(pid)
        on_the_way.append(service.call_async(Advance.Request(samples=1)))
        while len(on_the_way) >= (waiting if k < count + WARM - 1 else 1):
            future = on_the_way.popleft()
            client.until(future.done)
            answer = future.result()
            if answer is None or not answer.success:
                raise SystemExit("refused" if answer is None else answer.message)
    wall = time.monotonic() - began
    client.node.destroy_client(service)
    return count / wall, (cpu(pid) - spent) / count * 1e6


def main() -> None:
    """Print the figures."""
    import rclpy

    from rb_sim.ros import build_interfaces
    from rb_sim.ros import build_interfaces as interfaces

    parser = argparse.ArgumentParser(description="How soon the node answers.")
    parser.add_argument("--count", type=int, default=500, help="of wrenches, and of requests")
    parser.add_argument("--rate", type=float, default=500.0, help="samples per second")
    given = parser.parse_args()
    if not interfaces.is_there("rb_sim_interfaces"):
        sys.path.append(str(build_interfaces.build("rb_sim_interfaces")))
    rclpy.init()
    client = Client()
    node = [sys.executable, "-m", "rb_sim.ros.main", SCENE, "--ros-args", "-p"]
    with alone():
        print(line(describe()))
        period = 1e3 / given.rate
        print(f"latency [ms]      p50    p95   (a sample is {period:g} ms)")
        for name, command in (
            ("bare echo", [sys.executable, "-c", ECHO]),
            ("node", [*node, f"rate:={given.rate}"]),
        ):
            process = start(command)
            try:
                p50, p95 = np.percentile(latencies(client, given.count), [50, 95])
                print(f"{name:15} {p50:6.2f} {p95:6.2f}")
            finally:
                stop(process)
        process = start([*node, "start_paused:=true"])
        try:
            for waiting in (1, WAITING):
                rate, spent = requests(client, process.pid, given.count, waiting)
                print(
                    f"{waiting} on the way: {rate:.0f} requests per second; {spent:.0f} us of CPU"
                    " of the node for each"
                )
            if lockstep_client.possible():
                with tempfile.TemporaryDirectory() as folder:
                    program = lockstep_client.compiled(Path(folder))
                    before, count = cpu(process.pid), 4 * given.count
                    rate = lockstep_client.requests(program, "/rb_sim/advance", count, WARM)
                spent = (cpu(process.pid) - before) / (count + WARM) * 1e6
                print(
                    f"in C, one on the way: {rate:.0f} requests per second; {spent:.0f} us of CPU"
                )
        finally:
            stop(process)
    rclpy.shutdown()


def start(command: list[str]) -> subprocess.Popen[bytes]:
    """The program, in the background."""
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def stop(process: subprocess.Popen[bytes]) -> None:
    """End it, and let the graph forget it."""
    process.terminate()
    process.wait(60)
    time.sleep(1.0)


if __name__ == "__main__":
    main()
