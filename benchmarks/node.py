"""The node beside a bare rclpy program that publishes the same messages, in one run.

`python -m benchmarks.node [--seconds S] [--rate HZ] [--rounds N]`: CPU per sample of the node
without and with logs (their process included) and of the bare program, and the period in which
/clock arrives. The programs run in turn, one round after the other, so that each round has them
under the same load; medians over the rounds, ratios within each. The first samples do not count.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.machine import alone, describe, line

SCENE = "rolling_sphere_commanded"
FIRST = 2000
"""Samples before those that count."""
BARE = """
import sys, time
import rclpy
from rb_sim import Simulation
from rb_sim.ros.topic_sink import TopicSink
rclpy.init()
node = rclpy.create_node("rb_sim")
simulation = Simulation(sys.argv[1])
sink = TopicSink(node, 10)
sink.open(simulation.scene, simulation.layout)
(instant,) = sink._table.messages(simulation.sample().block)
pairs = list(zip(sink._publishers, instant.messages))
due, period = time.monotonic(), 1 / float(sys.argv[2])
while True:
    for publisher, data in pairs:
        publisher.publish(data)
    due += period
    time.sleep(max(0.0, due - time.monotonic()))
"""


def cpu(pid: int) -> float:
    """CPU time of a process and its children so far [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    own = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return own + sum(cpu(int(child)) for child in children)


def measure(command: list[str], seconds: float) -> tuple[float, np.ndarray]:
    """CPU per sample [us], and the periods in which samples arrived [ms]."""
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rosgraph_msgs.msg import Clock

    node, arrived = rclpy.create_node("listener"), []
    node.create_subscription(Clock, "/clock", lambda _: arrived.append(time.monotonic()), 1000)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        while len(arrived) < FIRST:  # /clock is there while it compiles, too, but slowly
            executor.spin_once(timeout_sec=0.1)
            if process.poll() is not None:
                raise SystemExit(f"ended: {' '.join(command)}")
        arrived.clear()
        before, end = cpu(process.pid), time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        spent = cpu(process.pid) - before
    finally:
        process.terminate()
        process.wait(60)
        executor.shutdown()
        node.destroy_node()
    return spent / len(arrived) * 1e6, np.diff(arrived) * 1e3


def show(rows: dict[str, list[list[float]]], heading: str) -> None:
    """Print the table."""
    print(heading)
    print(f"{'':15} CPU [us]  times  samples/s     p50 [ms] times  p99    times   p99.9  times")
    bare = np.array(rows["bare rclpy"])
    for name, found in rows.items():
        spent, held, *periods = np.median(found, axis=0)
        times = np.median(np.array(found) / bare, axis=0)
        told = " ".join(f"{p:7.3f} {r:6.2f}" for p, r in zip(periods, times[2:], strict=True))
        print(f"{name:15} {spent:8.1f} {times[0]:6.2f} {held:10.1f}     {told}")


def main() -> None:
    """Print the table."""
    import rclpy

    parser = argparse.ArgumentParser(description="The node beside a bare rclpy program.")
    parser.add_argument("--seconds", type=float, default=30.0, help="of each program")
    parser.add_argument("--rate", type=float, default=1000.0, help="samples per second")
    parser.add_argument("--rounds", type=int, default=1, help="of all programs")
    given = parser.parse_args()
    rclpy.init()
    rate = ["-p", f"rate:={given.rate}"]
    rows: dict[str, list[list[float]]] = {}
    with alone(), tempfile.TemporaryDirectory() as folder:
        node = [sys.executable, "-m", "rb_sim.ros.main", SCENE, "--ros-args", *rate]
        programs = {
            "bare rclpy": [sys.executable, "-c", BARE, SCENE, str(given.rate)],
            "node": node,
            "node, all logs": [*node, "-p", f"out:={folder}/run-{{time}}"],
        }
        for _ in range(given.rounds):
            for name, command in programs.items():
                spent, periods = measure(command, given.seconds)
                found = [spent, 1e3 / np.mean(periods), *np.percentile(periods, [50, 99, 99.9])]
                rows.setdefault(name, []).append(found)
    show(rows, f"{line(describe())}; {given.rounds} rounds of {given.seconds:g} s")
    rclpy.shutdown()


if __name__ == "__main__":
    main()
